//! The sky of scenes that bring no light.

use std::sync::Arc;

use glam::Vec3;

use crate::environment::{Environment, EnvironmentImage};
use crate::error::Error;
use crate::light::{Light, Sun};

/// A clear day: a warm sun 45 degrees above the horizon and a blue gradient with a pale horizon.
///
/// Nothing physical is claimed for it; it makes a cloud look like one. The sun's irradiance is
/// about 4, the sky's radiance between 0.1 and 0.7.
pub fn default_sky() -> Result<(Light, Environment), Error> {
    let sun = Light::Sun(Sun {
        // Beside the default camera, so that it shows form.
        to_light: Vec3::new(-0.02, 1.0, 1.0).normalize(),
        irradiance: Vec3::new(4.0, 3.8, 3.4),
        angular_diameter: 0.0,
    });
    const WIDTH: usize = 4;
    const HEIGHT: usize = 64;
    let zenith = Vec3::new(0.09, 0.21, 0.5);
    let horizon = Vec3::new(0.42, 0.54, 0.68);
    let ground = Vec3::new(0.24, 0.3, 0.38);
    let texels = (0..WIDTH * HEIGHT)
        .map(|i| {
            let polar = ((i / WIDTH) as f32 + 0.5) / HEIGHT as f32 * std::f32::consts::PI;
            let up = polar.cos();
            let colour = if up >= 0.0 {
                horizon.lerp(zenith, 1.0 - (1.0 - up).powi(3))
            } else {
                horizon.lerp(ground, 1.0 - (1.0 + up).powi(6))
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
