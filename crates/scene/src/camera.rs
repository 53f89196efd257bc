//! A pinhole camera that turns points of the film into rays.

use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;

use crate::error::{Error, Place};

/// A perspective pinhole camera in world space, bound to the resolution of the full image.
///
/// Film coordinates are pixels from the top left corner of the full image: the centre of the
/// first pixel is (0.5, 0.5). Pixels are square.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    resolution: [u32; 2],
    tan_half_fov_y: f64,
}

impl Camera {
    /// A camera at `position` (scene units) that looks at `target`.
    ///
    /// `fov_y_degrees` is the full vertical opening angle in degrees, between 0 and 180 without
    /// its ends; `resolution` is the full image in pixels. Fails when the view direction is
    /// undefined: coinciding points, `up` along the view, values that are not finite.
    pub fn look_at(
        position: DVec3,
        target: DVec3,
        up: DVec3,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        let invalid = |what: &str, remedy: &str| {
            Error::invalid(Place { part: Some("camera".into()), ..Place::default() }, what, remedy)
        };
        let view = target - position;
        if !(position.is_finite() && target.is_finite() && up.is_finite()) {
            return Err(invalid("the camera has coordinates that are not finite", "use numbers"));
        }
        let Some(forward) = view.try_normalize() else {
            return Err(invalid(
                "the camera looks at its own position",
                "move `position` away from `look_at`",
            ));
        };
        let right = up.try_normalize().map(|up| forward.cross(up));
        let Some(right) = right.filter(|r| r.length() > 1e-9).and_then(DVec3::try_normalize) else {
            return Err(invalid(
                "the camera's `up` is zero or along its view",
                "choose an `up` across the direction from `position` to `look_at`",
            ));
        };
        if !(fov_y_degrees > 0.0 && fov_y_degrees < 180.0) {
            return Err(invalid(
                &format!("the camera's vertical field of view is {fov_y_degrees} degrees"),
                "choose an angle between 0 and 180 degrees",
            ));
        }
        if resolution.contains(&0) {
            return Err(invalid(
                "the image has no pixels",
                "give a width and a height of at least 1",
            ));
        }
        Ok(Self {
            position,
            right,
            up: right.cross(forward),
            forward,
            resolution,
            tan_half_fov_y: libm::tan(fov_y_degrees.to_radians() * 0.5),
        })
    }

    /// A camera placed by a transform as glTF does it: at the origin of its local space, looking
    /// along local -Z with local +Y up. Scale and shear of the transform are ignored.
    pub fn from_transform(
        local_to_world: &DAffine3,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        let position = local_to_world.translation;
        let forward = local_to_world.transform_vector3(DVec3::NEG_Z).normalize_or_zero();
        let up = local_to_world.transform_vector3(DVec3::Y);
        // A target far away would lose digits when the position is large; one unit is exact enough.
        let target = position + forward * position.length().max(1.0);
        Self::look_at(position, target, up, fov_y_degrees, resolution)
    }

    /// A three-quarter view from slightly above that shows a whole box with a small margin.
    ///
    /// `bounds` are in world space. An empty or flat box is framed
    /// as if it were a little larger.
    pub fn framing(
        bounds: Bounds3,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        Self::framing_balls(bounds.corners(), 0.0, fov_y_degrees, resolution)
    }

    /// A three-quarter view from slightly above that shows balls around points as large as they
    /// fit, with a small margin.
    ///
    /// `centres` and the `radius` that all balls have are in world space, in scene units.
    ///
    /// With the direction of view given, each point bounds the camera's distance and offset along
    /// each axis of the film linearly, so that the closest camera is found without iteration.
    pub fn framing_balls(
        centres: impl IntoIterator<Item = DVec3>,
        radius: f64,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        /// Share of the image that may be filled.
        const FILL: f64 = 0.9;
        let backward = DVec3::new(0.83, 0.24, 0.5).normalize();
        let mut centres = centres.into_iter();
        let reference = centres.next().unwrap_or(DVec3::ZERO);
        let mut camera = Self::look_at(
            reference + backward * (1.0 + reference.length()),
            reference,
            DVec3::Y,
            fov_y_degrees,
            resolution,
        )?;
        let tangents = camera.tan_half_fov().map(|tan| tan * FILL);
        let axes = [camera.right, camera.up];
        // Largest of `x + tan z` and of `tan z - x` over all points, z towards the camera.
        let mut reach = [[0.0f64; 2]; 2];
        let mut nearest = 0.0f64;
        for offset in centres.map(|centre| centre - reference) {
            let z = offset.dot(backward);
            nearest = nearest.max(z);
            for (axis, reach) in reach.iter_mut().enumerate() {
                let (x, tan) = (offset.dot(axes[axis]), tangents[axis]);
                reach[0] = reach[0].max(x + tan * z);
                reach[1] = reach[1].max(tan * z - x);
            }
        }
        let mut distance = 0.0f64;
        let mut position = reference;
        for axis in 0..2 {
            let tan = tangents[axis];
            let [plus, minus] = reach[axis].map(|r| r + radius * (1.0 + tan * tan).sqrt());
            distance = distance.max((plus + minus) / (2.0 * tan));
            position += axes[axis] * ((plus - minus) / 2.0);
        }
        let least = nearest + radius + (1e-6 * reference.length()).max(1e-30);
        camera.position = position + backward * distance.max(least);
        Ok(camera)
    }

    /// The ray through a film point: its origin in world space (scene units) and its unit
    /// direction.
    #[inline]
    pub fn ray(&self, film: [f64; 2]) -> (DVec3, Vec3) {
        let [width, height] = self.resolution.map(f64::from);
        let scale = 2.0 * self.tan_half_fov_y / height;
        let x = (film[0] - 0.5 * width) * scale;
        let y = (0.5 * height - film[1]) * scale;
        let direction = self.forward + self.right * x + self.up * y;
        (self.position, direction.normalize().as_vec3().normalize())
    }

    /// The film point on which a world point appears; `None` at or behind the camera's plane.
    pub fn project(&self, p_world: DVec3) -> Option<[f64; 2]> {
        let offset = p_world - self.position;
        let depth = offset.dot(self.forward);
        (depth > 0.0).then(|| {
            let [width, height] = self.resolution.map(f64::from);
            let scale = height / (2.0 * self.tan_half_fov_y * depth);
            [
                0.5 * width + offset.dot(self.right) * scale,
                0.5 * height - offset.dot(self.up) * scale,
            ]
        })
    }

    /// Where the camera stands, in world space and scene units.
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// The unit direction through the middle of the film.
    pub fn forward(&self) -> DVec3 {
        self.forward
    }

    /// The unit vector that points to the top of the film.
    pub fn up(&self) -> DVec3 {
        self.up
    }

    /// Width and height of the full image in pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// The full vertical opening angle in degrees.
    pub fn fov_y_degrees(&self) -> f64 {
        2.0 * self.tan_half_fov_y.atan().to_degrees()
    }

    fn tan_half_fov(&self) -> [f64; 2] {
        let [width, height] = self.resolution.map(f64::from);
        [self.tan_half_fov_y * width / height, self.tan_half_fov_y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::look_at(DVec3::new(1.0, 2.0, 8.0), DVec3::ZERO, DVec3::Y, 40.0, [200, 100]).unwrap()
    }

    #[test]
    fn centre_looks_at_target_and_top_is_up() {
        let camera = camera();
        let (origin, direction) = camera.ray([100.0, 50.0]);
        assert!((direction.as_dvec3() - (DVec3::ZERO - origin).normalize()).length() < 1e-6);
        let (_, top) = camera.ray([100.0, 0.0]);
        let angle = top.dot(direction).acos().to_degrees();
        assert!((angle - 20.0).abs() < 1e-2, "{angle}");
        assert!(top.y > direction.y);
        let (_, right) = camera.ray([200.0, 50.0]);
        assert!(right.x > direction.x);
        // Square pixels: twice as wide as high.
        let tan = right.dot(direction).acos().tan();
        assert!((tan - 2.0 * 20f32.to_radians().tan()).abs() < 1e-4);
    }

    #[test]
    fn project_inverts_ray() {
        let camera = camera();
        for film in [[0.5, 0.5], [37.25, 81.5], [199.0, 3.0]] {
            let (origin, direction) = camera.ray(film);
            let back = camera.project(origin + direction.as_dvec3() * 7.0).unwrap();
            assert!((back[0] - film[0]).abs() < 1e-3 && (back[1] - film[1]).abs() < 1e-3);
        }
        assert_eq!(camera.project(camera.position() - camera.forward()), None);
    }

    #[test]
    fn framing_holds_every_corner_and_is_tight() {
        for (low, high) in [
            (DVec3::new(-3.0, 10.0, 2.0), DVec3::new(4.0, 11.0, 30.0)),
            (DVec3::splat(-1.0), DVec3::splat(1.0)),
            (DVec3::splat(1e6), DVec3::splat(1e6 + 2.0)),
        ] {
            let camera = Camera::framing(Bounds3::new(low, high), 35.0, [480, 270]).unwrap();
            let (mut inside, mut margin) = (true, f64::INFINITY);
            for corner in 0..8 {
                let p = DVec3::new(
                    if corner & 1 == 0 { low.x } else { high.x },
                    if corner & 2 == 0 { low.y } else { high.y },
                    if corner & 4 == 0 { low.z } else { high.z },
                );
                let [x, y] = camera.project(p).unwrap();
                inside &= x > 0.0 && x < 480.0 && y > 0.0 && y < 270.0;
                margin = margin.min(x).min(480.0 - x).min(y).min(270.0 - y);
            }
            assert!(inside && margin < 25.0, "{margin}");
        }
        assert!(Camera::framing(Bounds3::new(DVec3::ZERO, DVec3::ZERO), 35.0, [4, 4]).is_ok());
    }

    #[test]
    fn refuses_undefined_views() {
        let p = DVec3::new(0.0, 1.0, 0.0);
        assert!(Camera::look_at(p, p, DVec3::Y, 35.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::Y, 35.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, 180.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, f64::NAN, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, 35.0, [0, 4]).is_err());
    }

    #[test]
    fn gltf_cameras_look_along_minus_z_whatever_their_scale() {
        let transform = DAffine3::from_scale_rotation_translation(
            DVec3::new(3.0, 2.0, 5.0),
            glam::DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
            DVec3::new(1.0, 2.0, 3.0),
        );
        let camera = Camera::from_transform(&transform, 35.0, [10, 10]).unwrap();
        assert!((camera.forward() - DVec3::NEG_X).length() < 1e-12);
        assert!((camera.up() - DVec3::Y).length() < 1e-12);
    }
}
