//! A spot light.

use super::Punctual;
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

/// A spot light with the falloff that `KHR_lights_punctual` recommends.
#[derive(Debug, Clone, PartialEq)]
pub struct Spot {
    /// Position in scene units.
    pub position: DVec3,
    /// Unit direction of the cone's axis, away from the light.
    pub direction: Vec3,
    /// Radiant intensity on the axis, linear Rec. 709.
    pub intensity: Vec3,
    /// Cosine of the half angle inside which the intensity is full.
    pub cos_inner: f32,
    /// Cosine of the half angle outside which the light is dark; below `cos_inner`.
    pub cos_outer: f32,
}

impl Punctual for Spot {
    const NAMES: [&'static str; 2] = ["spot", "spots"];

    fn strength(&self) -> Vec3 {
        self.intensity
    }

    fn position(&self) -> Option<DVec3> {
        Some(self.position)
    }

    fn cone(&self) -> (Vec3, f32) {
        (self.direction, self.cos_outer)
    }

    /// Between the cones the falloff is the square of a linear ramp in the cosine, as the glTF
    /// extension `KHR_lights_punctual` recommends.
    #[inline]
    fn intensity_toward(&self, direction: Vec3) -> Vec3 {
        let scale = 1.0 / (self.cos_inner - self.cos_outer).max(1e-3);
        let ramp = ((self.direction.dot(direction) - self.cos_outer) * scale).clamp(0.0, 1.0);
        self.intensity * (ramp * ramp)
    }

    fn description(&self) -> Value {
        json!({
            "type": "spot",
            "position": self.position.to_array(),
            "direction": self.direction.to_array(),
            "intensity": self.intensity.to_array(),
            "inner_angle": f64::from(self.cos_inner).acos().to_degrees(),
            "outer_angle": f64::from(self.cos_outer).acos().to_degrees(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spot_is_full_inside_and_dark_outside() {
        let spot = Spot {
            position: DVec3::ZERO,
            direction: Vec3::NEG_Z,
            intensity: Vec3::splat(2.0),
            cos_inner: 0.9,
            cos_outer: 0.7,
        };
        let at = |cos: f32| spot.intensity_toward(Vec3::new((1.0 - cos * cos).sqrt(), 0.0, -cos)).x;
        assert_eq!(at(1.0), 2.0);
        assert_eq!(at(0.95), 2.0);
        assert!((at(0.8) - 0.5).abs() < 1e-3);
        assert_eq!(at(0.69), 0.0);
        assert_eq!(at(-1.0), 0.0);
    }
}
