//! A distant light.

use super::Punctual;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

/// A distant light, a single direction or a small uniform disc around it.
#[derive(Debug, Clone, PartialEq)]
pub struct Sun {
    /// Unit direction from the scene to the middle of the sun.
    pub to_light: Vec3,
    /// Irradiance on a plane facing the sun, linear Rec. 709.
    pub irradiance: Vec3,
    /// Full opening angle of the disc in radians; 0 is a delta direction.
    pub angular_diameter: f32,
}

impl Punctual for Sun {
    const NAMES: [&'static str; 2] = ["sun of no size", "suns of no size"];

    fn strength(&self) -> Vec3 {
        self.irradiance
    }

    fn position(&self) -> Option<DVec3> {
        None
    }

    fn has_extent(&self) -> bool {
        self.angular_diameter > 0.0
    }

    /// None: it has no position.
    fn intensity_toward(&self, _: Vec3) -> Vec3 {
        Vec3::ZERO
    }

    fn description(&self) -> Value {
        json!({
            "type": "sun",
            "to_light": self.to_light.to_array(),
            "irradiance": self.irradiance.to_array(),
            "angular_diameter": f64::from(self.angular_diameter).to_degrees(),
        })
    }
}
