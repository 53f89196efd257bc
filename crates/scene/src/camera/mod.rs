//! Cameras: what turns points of the film into rays.
//!
//! A camera is a place and a direction, a [`Projection`] and, beside panoramas, a [`Lens`] or none.
//! `framing.rs` finds places from which all is seen, `sight.rs` tells what cannot be seen.

mod framing;
mod lens;
mod projection;
mod sight;

use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;

use crate::error::{Error, Place};

pub use framing::Orbit;
pub use lens::Lens;
pub use projection::Projection;
use projection::{panorama_direction, panorama_point};

/// A camera in world space, bound to the resolution of the full image.
///
/// Film coordinates are pixels from the top left corner of the full image: the centre of the
/// first pixel is (0.5, 0.5). Pixels are square, but for those of panoramas. Rays count alike
/// wherever they pass the lens and the film: no picture darkens towards its corners.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// What it was told to look at, and what was said to be up: the other three follow.
    look_at: DVec3,
    told_up: DVec3,
    resolution: [u32; 2],
    projection: Projection,
    /// Half the height of the film: at depth 1 of a perspective, in scene units of an orthographic
    /// projection, in pixels of a panorama.
    half_height: f64,
    lens: Option<Lens>,
}

impl Camera {
    /// A perspective camera at `position` (scene units) that looks at `target`.
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
        Self::new(position, target, up, Projection::Perspective { fov_y_degrees }, resolution)
    }

    /// A camera at `position` (scene units) that looks at `target` and has the direction `up` at
    /// the top of its film; `resolution` is the full image in pixels. It is a pinhole until
    /// [`Camera::with_lens`] gives it a lens.
    ///
    /// # Errors
    /// If the view direction is undefined (coinciding points, `up` along the view, values that are
    /// not finite), the projection out of its range, or the image without pixels.
    pub fn new(
        position: DVec3,
        target: DVec3,
        up: DVec3,
        projection: Projection,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
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
        let half_height = projection.half_height(resolution)?;
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
            look_at: target,
            told_up: up,
            resolution,
            projection,
            half_height,
            lens: None,
        })
    }

    /// A camera placed by a transform as glTF does it: at the origin of its local space, looking
    /// along local -Z with local +Y up. Scale and shear of the transform are ignored.
    pub fn from_transform(
        local_to_world: &DAffine3,
        projection: Projection,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        let position = local_to_world.translation;
        let forward = local_to_world.transform_vector3(DVec3::NEG_Z).normalize_or_zero();
        let up = local_to_world.transform_vector3(DVec3::Y);
        // A target far away would lose digits when the position is large; one unit is exact enough.
        let target = position + forward * position.length().max(1.0);
        Self::new(position, target, up, projection, resolution)
    }

    /// This camera with a lens in the place of its pinhole, in the middle of the aperture.
    ///
    /// An orthographic camera has it before each point of its film. All that is in the plane of
    /// focus stays where it was on the film.
    ///
    /// # Errors
    /// Of a panorama, which looks into all directions.
    pub fn with_lens(self, lens: Lens) -> Result<Self, Error> {
        if self.projection == Projection::Panorama {
            return Err(invalid(
                "the camera is a panorama with a lens",
                "remove the lens: all that a panorama shows is sharp",
            ));
        }
        Ok(Self { lens: Some(lens), ..self })
    }

    /// The ray through a film point and the middle of the aperture: its origin in world space
    /// (scene units) and its unit direction.
    #[inline]
    pub fn ray(&self, film: [f64; 2]) -> (DVec3, Vec3) {
        if let Projection::Perspective { .. } = self.projection {
            let [x, y] = self.on_film(film);
            let direction = self.forward + self.right * x + self.up * y;
            return (self.position, direction.normalize().as_vec3().normalize());
        }
        self.ray_at(film, [0.0; 2])
    }

    /// The ray through a film point and a point of the aperture, which is uniform over its area for
    /// two canonical random numbers; without a lens that of [`Camera::ray`].
    pub fn ray_through_lens(&self, film: [f64; 2], u: [f32; 2]) -> (DVec3, Vec3) {
        match &self.lens {
            Some(lens) => self.ray_at(film, lens.sample(u)),
            None => self.ray(film),
        }
    }

    /// The ray through a film point that passes the lens at `offset` right and up from its middle,
    /// scene units. Out of line, so that pinholes do not pay for it.
    #[inline(never)]
    fn ray_at(&self, film: [f64; 2], offset: [f64; 2]) -> (DVec3, Vec3) {
        let [x, y] = self.on_film(film);
        // All rays of a film point meet at the depth of focus.
        let focus = self.lens.as_ref().map_or(f64::INFINITY, Lens::focus_distance);
        let bend = offset.map(|offset| offset / focus);
        let (start, direction) = match self.projection {
            Projection::Perspective { .. } => (offset, [x - bend[0], y - bend[1], 1.0]),
            Projection::Orthographic { .. } => {
                ([x + offset[0], y + offset[1]], [-bend[0], -bend[1], 1.0])
            }
            Projection::Panorama => ([0.0; 2], panorama_direction(film, self.resolution)),
        };
        let origin = self.position + self.right * start[0] + self.up * start[1];
        let [right, up, forward] = direction;
        let direction = self.right * right + self.up * up + self.forward * forward;
        (origin, direction.normalize().as_vec3().normalize())
    }

    /// Right and up from the middle of the film, in the units of `half_height`.
    #[inline]
    fn on_film(&self, film: [f64; 2]) -> [f64; 2] {
        let (width, height) = (f64::from(self.resolution[0]), f64::from(self.resolution[1]));
        let scale = 2.0 * self.half_height / height;
        [(film[0] - 0.5 * width) * scale, (0.5 * height - film[1]) * scale]
    }

    /// The film point on which a world point appears, in the middle of its blur if there is a lens;
    /// `None` at or behind the camera's plane, and of a panorama where it stands.
    pub fn project(&self, p_world: DVec3) -> Option<[f64; 2]> {
        let offset = p_world - self.position;
        let [x, y, depth] = [self.right, self.up, self.forward].map(|axis| offset.dot(axis));
        if self.projection == Projection::Panorama {
            return panorama_point([x, y, depth], self.resolution);
        }
        (depth > 0.0).then(|| {
            let [width, height] = self.resolution.map(f64::from);
            let depth = if self.projection.is_perspective() { depth } else { 1.0 };
            let scale = height / (2.0 * self.half_height * depth);
            [0.5 * width + x * scale, 0.5 * height - y * scale]
        })
    }

    /// How far a point is in front of the camera, along its view axis, scene units; negative
    /// behind it.
    pub fn depth(&self, p_world: DVec3) -> f64 {
        (p_world - self.position).dot(self.forward)
    }

    /// The box that holds the origins of all rays through the film and through `margin` pixels
    /// around it, in world space: a point without extent where all have one origin.
    pub fn origins(&self, margin: f64) -> Bounds3 {
        let aperture = self.lens.as_ref().map_or(0.0, |lens| 0.5 * lens.aperture());
        let film = match self.projection {
            Projection::Orthographic { .. } => {
                let [width, height] = self.resolution.map(f64::from);
                let pixel = 2.0 * self.half_height / height;
                [width, height].map(|side| (0.5 * side + margin) * pixel)
            }
            _ => [0.0; 2],
        };
        let [x, y] = film.map(|half| half + aperture);
        let reach = self.right.abs() * x + self.up.abs() * y;
        Bounds3::new(self.position - reach, self.position + reach)
    }

    /// Whether all rays have one origin, [`Camera::position`].
    pub fn has_one_origin(&self) -> bool {
        self.lens.is_none() && !matches!(self.projection, Projection::Orthographic { .. })
    }

    /// Where the camera stands, in world space and scene units: the pinhole, the middle of the
    /// aperture, or the middle of an orthographic camera's film.
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

    /// A point that it looks at and a vector that is up: of these and its position
    /// [`Camera::new`] makes the same camera, to the last bit but for framing cameras to whose
    /// direction no point was found that rounds well.
    pub fn placement(&self) -> [DVec3; 2] {
        [self.look_at, self.told_up]
    }

    /// Width and height of the full image in pixels.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// How it maps directions or points to the film.
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Its lens; `None`: everything is sharp.
    pub fn lens(&self) -> Option<&Lens> {
        self.lens.as_ref()
    }

    /// The full vertical opening angle in degrees; `None` if it is no perspective camera.
    pub fn fov_y_degrees(&self) -> Option<f64> {
        match self.projection {
            Projection::Perspective { fov_y_degrees } => Some(fov_y_degrees),
            _ => None,
        }
    }

    fn half_film(&self) -> [f64; 2] {
        let [width, height] = self.resolution.map(f64::from);
        [self.half_height * width / height, self.half_height]
    }
}

/// An error about the camera, whose place the caller may know better.
fn invalid(what: impl Into<String>, remedy: &str) -> Error {
    Error::invalid(Place { part: Some("camera".into()), ..Place::default() }, what, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSPECTIVE: Projection = Projection::Perspective { fov_y_degrees: 35.0 };
    const FLAT: Projection = Projection::Orthographic { height: 3.0 };

    /// The place of [`camera`] under another projection.
    fn other(projection: Projection) -> Camera {
        let position = DVec3::new(1.0, 2.0, 8.0);
        Camera::new(position, DVec3::ZERO, DVec3::Y, projection, [200, 100]).unwrap()
    }

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
    fn refuses_undefined_views() {
        let p = DVec3::new(0.0, 1.0, 0.0);
        assert!(Camera::look_at(p, p, DVec3::Y, 35.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::Y, 35.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, 180.0, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, f64::NAN, [4, 4]).is_err());
        assert!(Camera::look_at(p, DVec3::ZERO, DVec3::X, 35.0, [0, 4]).is_err());
        for height in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let projection = Projection::Orthographic { height };
            assert!(Camera::new(p, DVec3::ZERO, DVec3::X, projection, [4, 4]).is_err());
        }
    }

    #[test]
    fn gltf_cameras_look_along_minus_z_whatever_their_scale() {
        let transform = DAffine3::from_scale_rotation_translation(
            DVec3::new(3.0, 2.0, 5.0),
            glam::DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2),
            DVec3::new(1.0, 2.0, 3.0),
        );
        let camera = Camera::from_transform(&transform, PERSPECTIVE, [10, 10]).unwrap();
        assert!((camera.forward() - DVec3::NEG_X).length() < 1e-12);
        assert!((camera.up() - DVec3::Y).length() < 1e-12);
    }

    /// The numbers that place a camera make the same one, wherever it stands.
    #[test]
    fn placements_make_the_same_camera() {
        for scale in [1e-3, 1.0, 1e5] {
            let transform = DAffine3::from_scale_rotation_translation(
                DVec3::new(1.0, 2.0, 0.5),
                glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.7),
                DVec3::new(1.1, -2.7, 3.3) * scale,
            );
            for projection in [PERSPECTIVE, FLAT, Projection::Panorama] {
                let camera = Camera::from_transform(&transform, projection, [10, 10]).unwrap();
                let [target, up] = camera.placement();
                let again = Camera::new(camera.position(), target, up, projection, [10, 10]);
                assert_eq!(again.unwrap(), camera);
            }
        }
    }

    #[test]
    fn orthographic_rays_are_parallel_and_start_in_the_plane_of_the_camera() {
        let camera = other(FLAT);
        for film in [[0.0, 0.0], [200.0, 0.0], [100.0, 50.0], [13.5, 77.25]] {
            let (origin, direction) = camera.ray(film);
            assert!((direction.as_dvec3() - camera.forward()).length() < 1e-7);
            assert!(camera.depth(origin).abs() < 1e-12);
            let back = camera.project(origin + camera.forward() * 7.0).unwrap();
            assert!((back[0] - film[0]).abs() < 1e-9 && (back[1] - film[1]).abs() < 1e-9);
        }
        let [top, bottom] = [[100.0, 0.0], [100.0, 100.0]].map(|film| camera.ray(film).0);
        assert!(((top - bottom).length() - 3.0).abs() < 1e-12);
        assert!((top - bottom).normalize().dot(camera.up()) > 1.0 - 1e-12);
        let [left, right] = [[0.0, 50.0], [200.0, 50.0]].map(|film| camera.ray(film).0);
        assert!(((right - left).length() - 6.0).abs() < 1e-12);
        assert_eq!(camera.project(camera.position() - camera.forward()), None);
        // The box of origins is theirs, with the pixels around the film and the aperture.
        let corners = |camera: &Camera, u| {
            let rays = [[-2.0, -2.0], [202.0, -2.0], [-2.0, 102.0], [202.0, 102.0]];
            rays.map(|film| camera.ray_through_lens(film, u).0)
        };
        let pinholes = Bounds3::of_points(corners(&camera, [0.5; 2]));
        let origins = camera.origins(2.0);
        assert!((origins.low - pinholes.low).length() < 1e-12);
        assert!((origins.high - pinholes.high).length() < 1e-12);
        let camera = camera.with_lens(Lens::new(0.5, 2.0, 0).unwrap()).unwrap();
        let origins = camera.origins(2.01);
        for u in [[0.0, 0.5], [0.99, 0.5], [0.5, 0.0], [0.5, 0.99], [0.1, 0.9]] {
            assert!(corners(&camera, u).into_iter().all(|p| origins.contains(p)));
        }
    }

    /// The panorama of a camera that looks along -Z has the directions of an environment image.
    #[test]
    fn panoramas_have_the_layout_of_environment_images() {
        use crate::light::environment::EnvironmentImage;
        let camera = Camera::new(
            DVec3::ONE,
            DVec3::new(1.0, 1.0, 0.0),
            DVec3::Y,
            Projection::Panorama,
            [8, 4],
        )
        .unwrap();
        let texels: Vec<[f32; 3]> = (0..32).map(|i| [i as f32, (i % 8) as f32, 1.0]).collect();
        let image = EnvironmentImage::new(8, 4, texels.clone(), 1.0, 0.0).unwrap();
        for (i, texel) in (0u32..).zip(&texels) {
            let film = [f64::from(i % 8) + 0.5, f64::from(i / 8) + 0.5];
            let (origin, direction) = camera.ray(film);
            assert_eq!(origin, DVec3::ONE);
            let found = image.radiance(direction);
            assert!((found - Vec3::from_array(*texel)).length() < 1e-3, "{film:?}: {found}");
        }
        let (_, forward) = camera.ray([4.0, 2.0]);
        assert!((forward.as_dvec3() - camera.forward()).length() < 1e-7);
    }

    #[test]
    fn panoramas_show_all_directions_once() {
        let camera = other(Projection::Panorama);
        for film in [[0.5, 0.5], [37.25, 81.5], [199.0, 3.0], [100.0, 50.0]] {
            let (origin, direction) = camera.ray(film);
            let back = camera.project(origin + direction.as_dvec3() * 7.0).unwrap();
            assert!((back[0] - film[0]).abs() < 1e-3 && (back[1] - film[1]).abs() < 1e-3);
        }
        let (_, right) = camera.ray([150.0, 50.0]);
        assert!((right.as_dvec3() - camera.forward().cross(camera.up())).length() < 1e-6);
        let (_, top) = camera.ray([20.0, 0.0]);
        assert!((top.as_dvec3() - camera.up()).length() < 1e-6);
        // A filter that is wider than a pixel reaches around the sphere and over the poles.
        for (out, on) in [
            ([-3.0, 20.0], [197.0, 20.0]),
            ([30.0, -2.0], [130.0, 2.0]),
            ([30.0, 103.0], [130.0, 97.0]),
        ] {
            let [a, b] = [out, on].map(|film| camera.ray(film).1);
            assert!((a - b).length() < 1e-6, "{out:?} {on:?}");
        }
        assert_eq!(camera.project(camera.position()), None);
        assert!(camera.with_lens(Lens::new(0.5, 2.0, 0).unwrap()).is_err());
    }

    /// Rays through one point of the film start on the aperture and meet in the plane of focus,
    /// where the pinhole's ray does.
    #[test]
    fn rays_through_a_lens_meet_in_the_plane_of_focus() {
        for projection in [PERSPECTIVE, FLAT] {
            let pinhole = other(projection);
            for blades in [0, 5] {
                let lens = Lens::new(0.8, 5.0, blades).unwrap();
                let camera = pinhole.clone().with_lens(lens).unwrap();
                assert!(!camera.has_one_origin() && camera.position() == pinhole.position());
                for film in [[3.0, 4.0], [100.0, 50.0], [180.5, 90.0]] {
                    let (origin, direction) = pinhole.ray(film);
                    assert_eq!(camera.ray(film), (origin, direction));
                    let along = |direction: Vec3, depth: f64| {
                        let direction = direction.as_dvec3();
                        direction * (depth / direction.dot(camera.forward()))
                    };
                    let focus = origin + along(direction, 5.0);
                    let mut widest = 0.0f64;
                    for i in 0..64u32 {
                        let u = [(i % 8) as f32 / 8.0, (i / 8) as f32 / 8.0];
                        let (start, direction) = camera.ray_through_lens(film, u);
                        assert!(camera.depth(start).abs() < 1e-12);
                        assert!((direction.length() - 1.0).abs() < 1e-6);
                        assert!((start + along(direction, 5.0) - focus).length() < 2e-6);
                        widest = widest.max((start - origin).length());
                    }
                    assert!(widest > 0.35 && widest < 0.4 + 1e-9, "{widest}");
                }
            }
        }
    }
}
