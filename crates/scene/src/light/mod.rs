//! Lights without extent: suns, points and spots; and below, light from all around.

pub mod environment;
mod environment_file;
mod radiance_hdr;
pub(crate) mod sky;

use glam::{DVec3, Vec3};

/// A light of the scene, in world space.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// Light from infinitely far away.
    Sun(Sun),
    /// Light from a point, the same in all directions.
    Point(Point),
    /// Light from a point into a cone.
    Spot(Spot),
}

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

/// A point light.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Position in scene units.
    pub position: DVec3,
    /// Radiant intensity per steradian, linear Rec. 709: irradiance at distance one facing it.
    pub intensity: Vec3,
}

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

impl Spot {
    /// Radiant intensity into a unit direction away from the light.
    ///
    /// Between the cones the falloff is the square of a linear ramp in the cosine, as the glTF
    /// extension `KHR_lights_punctual` recommends.
    #[inline]
    pub fn intensity_toward(&self, direction: Vec3) -> Vec3 {
        let scale = 1.0 / (self.cos_inner - self.cos_outer).max(1e-3);
        let ramp = ((self.direction.dot(direction) - self.cos_outer) * scale).clamp(0.0, 1.0);
        self.intensity * (ramp * ramp)
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
