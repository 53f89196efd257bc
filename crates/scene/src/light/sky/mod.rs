//! Skies: that of scenes that bring no light, and that of a clear day.

mod clear;
mod sunlight;

pub use clear::{ClearSky, SkyFault};

use std::sync::Arc;

use glam::Vec3;

use crate::error::Error;
use crate::light::environment::{Environment, EnvironmentImage};
use crate::light::punctual::{Light, Sun};

/// A clear day: a warm sun 49 degrees above the horizon and a blue gradient with a pale horizon.
///
/// Nothing physical is claimed for it; it makes a cloud look like one. The sun's irradiance is
/// about 6, the sky's radiance between 0.03 and 0.6.
pub fn default_sky() -> Result<(Light, Environment), Error> {
    let sun = Light::Sun(Sun {
        // Beside the default camera, so that it shows form.
        to_light: Vec3::new(-0.45, 1.0, 0.75).normalize(),
        irradiance: Vec3::new(6.0, 5.6, 4.9),
        angular_diameter: 0.0,
    });
    const WIDTH: usize = 4;
    const HEIGHT: usize = 64;
    let zenith = Vec3::new(0.03, 0.1, 0.36);
    let horizon = Vec3::new(0.22, 0.36, 0.6);
    let ground = Vec3::new(0.1, 0.13, 0.17);
    let texels = (0..WIDTH * HEIGHT)
        .map(|i| {
            let polar = ((i / WIDTH) as f32 + 0.5) / HEIGHT as f32 * std::f32::consts::PI;
            let up = libm::cosf(polar);
            let colour = if up >= 0.0 {
                horizon.lerp(zenith, 1.0 - (1.0 - up).powi(3))
            } else {
                horizon.lerp(ground, 1.0 - (1.0 + up).powi(4))
            };
            colour.to_array()
        })
        .collect();
    let image = EnvironmentImage::new(WIDTH, HEIGHT, texels, 1.0, 0.0)?;
    Ok((sun, Environment { constant: Vec3::ZERO, image: Some(Arc::new(image)) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_bluer_above_and_never_black() {
        let (sun, sky) = default_sky().unwrap();
        assert!(matches!(sun, Light::Sun(_)));
        let (up, side) = (sky.radiance(Vec3::Y), sky.radiance(Vec3::X));
        assert!(up.z / up.x > side.z / side.x);
        assert!(sky.radiance(Vec3::NEG_Y).min_element() > 0.05);
    }
}
