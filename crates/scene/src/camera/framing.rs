//! Cameras from which all that there is is seen.

use glam::DVec3;
use pileus_math::Bounds3;

use super::{Camera, Projection};
use crate::error::Error;
use crate::light::sky::ClearSky;

/// Share of the image that may be filled.
const FILL: f64 = 0.9;

/// From where a camera looks at all that there is.
///
/// Angles are degrees, as those of a sky's sun: the azimuth runs clockwise seen from above, 0 is at
/// -Z and 90 at +X; the elevation is above the horizon, from -90 to 90.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Where the camera stands around the scene.
    pub azimuth_degrees: f64,
    /// How high it stands.
    pub elevation_degrees: f64,
    /// From the middle of the scene, in scene units; `None`: as near as everything fits.
    pub distance: Option<f64>,
}

impl Orbit {
    /// From what is looked at to the camera, a unit vector.
    pub fn backward(&self) -> DVec3 {
        ClearSky::direction(self.elevation_degrees, self.azimuth_degrees)
    }

    /// What is up in the image, a unit vector across [`backward`](Orbit::backward): defined from
    /// straight above and below, too.
    pub fn up(&self) -> DVec3 {
        ClearSky::direction(self.elevation_degrees + 90.0, self.azimuth_degrees)
    }
}

/// The direction of view of a camera that has no place yet.
#[derive(Clone, Copy)]
struct View {
    backward: DVec3,
    up: DVec3,
    distance: Option<f64>,
}

impl View {
    /// Around what is framed, or a three-quarter view from slightly above.
    fn new(orbit: Option<Orbit>) -> View {
        let three_quarters = DVec3::new(0.83, 0.24, 0.5).normalize();
        let default = View { backward: three_quarters, up: DVec3::Y, distance: None };
        orbit.map_or(default, |orbit| View {
            backward: orbit.backward(),
            up: orbit.up(),
            distance: orbit.distance,
        })
    }

    /// A camera somewhere in that direction.
    fn camera(
        &self,
        reference: DVec3,
        projection: Projection,
        resolution: [u32; 2],
    ) -> Result<Camera, Error> {
        let position = reference + self.backward * (1.0 + reference.length());
        Camera::new(position, reference, self.up, projection, resolution)
    }
}

impl Camera {
    /// A three-quarter view from slightly above that shows a whole box with a small margin.
    ///
    /// `bounds` are in world space. An empty or flat box is framed
    /// as if it were a little larger.
    pub fn framing(
        bounds: Bounds3,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        Self::framing_balls(bounds.corners(), 0.0, None, fov_y_degrees, resolution)
    }

    /// A view that shows balls around points as large as they fit, with a small margin: from an
    /// orbit, or else from the three quarters and slightly above.
    ///
    /// `centres` and the `radius` that all balls have are in world space, in scene units. An
    /// orbit's distance is from the middle of the box around the centres, and nothing need fit.
    ///
    /// With the direction of view given, each point bounds the camera's distance and offset along
    /// each axis of the film linearly, so that the closest camera is found without iteration.
    pub fn framing_balls(
        centres: impl IntoIterator<Item = DVec3>,
        radius: f64,
        orbit: Option<Orbit>,
        fov_y_degrees: f64,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        let view = View::new(orbit);
        let backward = view.backward;
        let mut centres = centres.into_iter();
        let reference = centres.next().unwrap_or(DVec3::ZERO);
        let projection = Projection::Perspective { fov_y_degrees };
        let mut camera = view.camera(reference, projection, resolution)?;
        let tangents = camera.half_film().map(|tan| tan * FILL);
        let axes = [camera.right, camera.up];
        // Largest of `x + tan z` and of `tan z - x` over all points, z towards the camera.
        let mut reach = [[0.0f64; 2]; 2];
        let mut nearest = 0.0f64;
        let mut around = Bounds3::new(DVec3::ZERO, DVec3::ZERO);
        for offset in centres.map(|centre| centre - reference) {
            around = around.union(Bounds3::new(offset, offset));
            let z = offset.dot(backward);
            nearest = nearest.max(z);
            for (axis, reach) in reach.iter_mut().enumerate() {
                let (x, tan) = (offset.dot(axes[axis]), tangents[axis]);
                reach[0] = reach[0].max(x + tan * z);
                reach[1] = reach[1].max(tan * z - x);
            }
        }
        if let Some(distance) = view.distance {
            camera.move_to(reference + around.centre() + backward * distance);
            return Ok(camera);
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
        camera.move_to(position + backward * distance.max(least));
        Ok(camera)
    }

    /// An orthographic view from the direction of [`Camera::framing_balls`]: of this height, or as
    /// large as the balls fit with a small margin, and centred on them.
    ///
    /// `height` is in scene units. The film stands outside of all balls, unless the orbit has a
    /// distance.
    pub fn framing_balls_orthographic(
        centres: impl IntoIterator<Item = DVec3>,
        radius: f64,
        orbit: Option<Orbit>,
        height: Option<f64>,
        resolution: [u32; 2],
    ) -> Result<Self, Error> {
        let direction = View::new(orbit);
        let backward = direction.backward;
        let mut centres = centres.into_iter();
        let reference = centres.next().unwrap_or(DVec3::ZERO);
        // The direction of view alone is asked for.
        let any = Projection::Orthographic { height: 1.0 };
        let view = direction.camera(reference, any, resolution)?;
        let axes = [view.right, view.up, backward];
        let (mut low, mut high) = ([0.0f64; 3], [0.0f64; 3]);
        for offset in centres.map(|centre| centre - reference) {
            for (axis, direction) in axes.into_iter().enumerate() {
                let x = offset.dot(direction);
                (low[axis], high[axis]) = (low[axis].min(x), high[axis].max(x));
            }
        }
        let size: [f64; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 2.0 * radius);
        let rounding = (1e-6 * reference.length()).max(1e-30);
        let height = height.unwrap_or_else(|| {
            let [width, height] = resolution.map(f64::from);
            (size[0] * height / width).max(size[1]).max(rounding) / FILL
        });
        let projection = Projection::Orthographic { height };
        let mut camera = direction.camera(reference, projection, resolution)?;
        let middle = |axis: usize| axes[axis] * (0.5 * (low[axis] + high[axis]));
        // Off the nearest ball by as much as they are deep, so that nothing touches the film.
        let off = match direction.distance {
            Some(distance) => 0.5 * (low[2] + high[2]) + distance,
            None => high[2] + radius + size[2].max(rounding),
        };
        camera.move_to(reference + middle(0) + middle(1) + backward * off);
        Ok(camera)
    }

    /// Moves the camera without turning it.
    fn move_to(&mut self, position: DVec3) {
        /// Distances that are tried for the point to look at: one in some is rounded well.
        const TRIED: u32 = 4096;
        self.position = position;
        let scale = position.length().max(1.0);
        let targets = (0..TRIED).map(|i| {
            position + self.forward * (scale * (1.0 + f64::from(i) * 0.618_033_988_749_894_9))
        });
        let made = |target: DVec3| {
            Self::new(position, target, self.told_up, self.projection, self.resolution)
        };
        let same = |target: &DVec3| {
            made(*target)
                .is_ok_and(|c| [c.right, c.up, c.forward] == [self.right, self.up, self.forward])
        };
        let found = targets.clone().find(same);
        self.look_at = found.unwrap_or(position + self.forward * scale);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOXES: [(DVec3, DVec3); 3] = [
        (DVec3::new(-3.0, 10.0, 2.0), DVec3::new(4.0, 11.0, 30.0)),
        (DVec3::splat(-1.0), DVec3::splat(1.0)),
        (DVec3::splat(1e6), DVec3::splat(1e6 + 2.0)),
    ];

    /// Whether all corners are in the picture, and pixels between the nearest and its edge.
    fn margin(camera: &Camera, bounds: Bounds3) -> (bool, f64) {
        let (mut inside, mut margin) = (true, f64::INFINITY);
        for p in bounds.corners() {
            let [x, y] = camera.project(p).unwrap();
            inside &= x > 0.0 && x < 480.0 && y > 0.0 && y < 270.0;
            margin = margin.min(x).min(480.0 - x).min(y).min(270.0 - y);
        }
        (inside, margin)
    }

    #[test]
    fn framing_holds_every_corner_and_is_tight() {
        for (low, high) in BOXES {
            let bounds = Bounds3::new(low, high);
            let camera = Camera::framing(bounds, 35.0, [480, 270]).unwrap();
            let (inside, pixels) = margin(&camera, bounds);
            assert!(inside && pixels < 25.0, "{pixels}");
            let camera =
                Camera::framing_balls_orthographic(bounds.corners(), 0.0, None, None, [480, 270])
                    .unwrap();
            let (inside, pixels) = margin(&camera, bounds);
            assert!(inside && pixels < 25.0, "{pixels}");
            // The film stands before the box, in its middle whatever its height.
            assert!(camera.depth(bounds.centre()) > bounds.size().length() * 0.5);
            let small = Camera::framing_balls_orthographic(
                bounds.corners(),
                0.0,
                None,
                Some(0.1),
                [480, 270],
            )
            .unwrap();
            assert_eq!(small.projection(), Projection::Orthographic { height: 0.1 });
            assert!((small.position() - camera.position()).length() < 1e-9 * high.length());
        }
        assert!(Camera::framing(Bounds3::new(DVec3::ZERO, DVec3::ZERO), 35.0, [4, 4]).is_ok());
        let flat =
            Camera::framing_balls_orthographic([DVec3::ZERO], 0.0, None, None, [4, 4]).unwrap();
        assert!(flat.depth(DVec3::ZERO) > 0.0);
    }

    /// A framing camera can be said in numbers that make it again, up to the last bit.
    #[test]
    fn what_is_framed_can_be_placed_again() {
        let mut exact = 0;
        for i in 0..200u32 {
            let at = |k: u32| f64::from(i * k % 97) * 1.37 - 50.0;
            let low = DVec3::new(at(3), at(5), at(7)) * 10f64.powi(i as i32 % 7 - 3);
            let bounds = Bounds3::new(low, low + 1.0 + f64::from(i % 9));
            let camera = Camera::framing(bounds, 35.0, [64, 36]).unwrap();
            let [target, up] = camera.placement();
            let again =
                Camera::new(camera.position(), target, up, camera.projection(), [64, 36]).unwrap();
            assert!((again.forward() - camera.forward()).length() < 1e-15);
            exact += u32::from(again == camera);
        }
        assert_eq!(exact, 200);
    }

    /// From any side all fits, straight from above and below too; with a distance the camera
    /// stands there, and looks at the middle.
    #[test]
    fn orbits_show_all_from_their_side() {
        for (low, high) in BOXES {
            let bounds = Bounds3::new(low, high);
            let (fov, film) = (35.0, [480, 270]);
            for azimuth_degrees in [0.0, 90.0, 200.0, -45.0] {
                for elevation_degrees in [-90.0, -30.0, 0.0, 45.0, 90.0] {
                    let orbit = Orbit { azimuth_degrees, elevation_degrees, distance: None };
                    let (corners, orbit) = (bounds.corners(), Some(orbit));
                    let camera = Camera::framing_balls(corners, 0.0, orbit, fov, film).unwrap();
                    let (inside, pixels) = margin(&camera, bounds);
                    assert!(inside && pixels < 25.0, "{orbit:?} {pixels}");
                    let parallel =
                        Camera::framing_balls_orthographic(corners, 0.0, orbit, None, film);
                    let (inside, pixels) = margin(&parallel.unwrap(), bounds);
                    assert!(inside && pixels < 25.0, "{orbit:?} {pixels}");
                    let orbit = orbit.map(|orbit| Orbit { distance: Some(123.0), ..orbit });
                    for camera in [
                        Camera::framing_balls(corners, 0.0, orbit, fov, film).unwrap(),
                        Camera::framing_balls_orthographic(corners, 0.0, orbit, None, film)
                            .unwrap(),
                    ] {
                        assert!((camera.depth(bounds.centre()) - 123.0).abs() < 1e-6);
                        let [x, y] = camera.project(bounds.centre()).unwrap();
                        assert!((x - 240.0).abs() < 1e-6 && (y - 135.0).abs() < 1e-6);
                    }
                }
            }
        }
        let east = Orbit { azimuth_degrees: 90.0, elevation_degrees: 0.0, distance: None };
        assert!((east.backward() - DVec3::X).length() < 1e-15);
        assert!((east.up() - DVec3::Y).length() < 1e-15);
    }
}
