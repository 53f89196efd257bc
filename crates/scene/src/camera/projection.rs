//! How a camera maps what it sees to its film.

use std::f64::consts::{PI, TAU};

use super::invalid;
use crate::error::Error;

/// How a camera maps directions or points to its film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Central projection to a plane.
    Perspective {
        /// Full vertical opening angle in degrees, between 0 and 180 without its ends.
        fov_y_degrees: f64,
    },
    /// Parallel projection: rays start in the plane through the camera's position and go along its
    /// view axis.
    Orthographic {
        /// Height of what the film shows, above 0, scene units.
        height: f64,
    },
    /// All directions, by longitude along the film's width and latitude along its height.
    ///
    /// The middle of the film looks along the view axis and the top along `up`; to the right
    /// longitude grows to the camera's right. An environment image has the same layout, so that the
    /// panorama of a camera which looks along -Z is one of its surroundings. Pixels towards the
    /// poles show less.
    Panorama,
}

impl Projection {
    pub(super) fn is_perspective(self) -> bool {
        matches!(self, Self::Perspective { .. })
    }

    /// Half the height of the film, in the units of the camera.
    pub(super) fn half_height(self, resolution: [u32; 2]) -> Result<f64, Error> {
        match self {
            Self::Perspective { fov_y_degrees } => {
                if !(fov_y_degrees > 0.0 && fov_y_degrees < 180.0) {
                    return Err(invalid(
                        format!("the camera's vertical field of view is {fov_y_degrees} degrees"),
                        "choose an angle between 0 and 180 degrees",
                    ));
                }
                Ok(libm::tan(fov_y_degrees.to_radians() * 0.5))
            }
            Self::Orthographic { height } => {
                if !(height > 0.0 && height.is_finite()) {
                    return Err(invalid(
                        format!("the orthographic camera shows a height of {height}"),
                        "give a height above 0 in scene units",
                    ));
                }
                Ok(0.5 * height)
            }
            Self::Panorama => Ok(0.5 * f64::from(resolution[1])),
        }
    }
}

/// Right, up and forward parts of the unit direction that a panorama has at a film point. Beyond
/// the film it goes on around the sphere, and over the poles to the other side.
pub(super) fn panorama_direction(film: [f64; 2], [width, height]: [u32; 2]) -> [f64; 3] {
    let (sin, cos) = libm::sincos((film[0] / f64::from(width) - 0.5) * TAU);
    let (up, level) = libm::sincos((0.5 - film[1] / f64::from(height)) * PI);
    [level * sin, up, level * cos]
}

/// The film point of a panorama that shows a direction of any length; `None` without a direction.
pub(super) fn panorama_point(
    [right, up, forward]: [f64; 3],
    [width, height]: [u32; 2],
) -> Option<[f64; 2]> {
    let level = (right * right + forward * forward).sqrt();
    if !(level > 0.0 || up != 0.0) {
        return None;
    }
    let longitude = libm::atan2(right, forward) / TAU + 0.5;
    let latitude = 0.5 - libm::atan2(up, level) / PI;
    Some([longitude * f64::from(width), latitude * f64::from(height)])
}
