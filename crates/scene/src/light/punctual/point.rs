//! A point light.

use super::Punctual;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

/// A point light.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Position in scene units.
    pub position: DVec3,
    /// Radiant intensity per steradian, linear Rec. 709: irradiance at distance one facing it.
    pub intensity: Vec3,
}

impl Punctual for Point {
    const NAMES: [&'static str; 2] = ["point light", "point lights"];

    fn strength(&self) -> Vec3 {
        self.intensity
    }

    fn position(&self) -> Option<DVec3> {
        Some(self.position)
    }

    #[inline]
    fn intensity_toward(&self, _: Vec3) -> Vec3 {
        self.intensity
    }

    fn description(&self) -> Value {
        json!({
            "type": "point",
            "position": self.position.to_array(),
            "intensity": self.intensity.to_array(),
        })
    }
}
