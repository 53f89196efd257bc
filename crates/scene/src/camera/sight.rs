//! What a camera cannot see.

use pileus_math::Bounds3;

use super::{Camera, Projection};

impl Camera {
    /// Whether a box, in world space, may be met by a ray through the film, were nothing in its
    /// way. `false` is certain; `true` may be said of boxes that just miss the picture.
    ///
    /// Through each point of a lens the film shows a pyramid, whose sides pass through those of the
    /// film in the plane of focus. On one side of the film they are, at depth `z`, no farther from
    /// the axis than `w(z) + r |1 - z / f|`, with `w` that of the pinhole and `r` the radius of the
    /// aperture: two half-spaces of which the box would have to be out of both.
    pub fn may_see(&self, bounds: Bounds3) -> bool {
        if self.projection == Projection::Panorama {
            return true;
        }
        // Right, up and depth of each corner.
        let corners = bounds.corners().map(|corner| {
            let offset = corner - self.position;
            [self.right, self.up, self.forward].map(|axis| offset.dot(axis))
        });
        if corners.iter().all(|[.., depth]| *depth < 0.0) {
            return false;
        }
        let blur = |depth: f64| {
            self.lens
                .as_ref()
                .map_or(0.0, |lens| 0.5 * lens.aperture() * (1.0 - depth / lens.focus_distance()))
        };
        let perspective = self.projection.is_perspective();
        let half = self.half_film();
        let beyond = |axis: usize, side: f64, sign: f64| {
            corners.iter().all(|corner| {
                let depth = corner[2];
                let width = if perspective { half[axis] * depth } else { half[axis] };
                side * corner[axis] > width + sign * blur(depth)
            })
        };
        let out = |axis, side| beyond(axis, side, 1.0) && beyond(axis, side, -1.0);
        !(0..2).any(|axis| out(axis, 1.0) || out(axis, -1.0))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::Lens;
    use super::*;

    /// Whether any of many rays through film and lens meets a box.
    fn is_met(camera: &Camera, bounds: Bounds3) -> bool {
        let at = |i: u32| f64::from(i) / 12.0;
        let [width, height] = camera.resolution().map(f64::from);
        (0..13 * 13 * 25).any(|i| {
            let film = [at(i % 13) * width, at(i / 13 % 13) * height];
            let lens = i / 169;
            let u = [(lens % 5) as f32 / 4.0, (lens / 5) as f32 / 4.0];
            let (origin, direction) = camera.ray_through_lens(film, u);
            bounds.clip(origin, direction.as_dvec3(), 0.0, f64::INFINITY).is_some()
        })
    }

    /// What a ray meets may be seen, whatever the camera; and most of what none meets is known.
    #[test]
    fn what_rays_meet_may_be_seen() {
        let (position, target) = (DVec3::new(1.0, 0.5, 4.0), DVec3::new(0.2, 0.1, -0.3));
        for projection in [
            Projection::Perspective { fov_y_degrees: 40.0 },
            Projection::Orthographic { height: 2.0 },
            Projection::Panorama,
        ] {
            let pinhole = Camera::new(position, target, DVec3::Y, projection, [40, 30]).unwrap();
            let mut cameras = vec![pinhole.clone()];
            for (aperture, focus) in [(0.4, 1.5), (1.5, 8.0)] {
                cameras.extend(pinhole.clone().with_lens(Lens::new(aperture, focus, 0).unwrap()));
            }
            for camera in cameras {
                let (mut met, mut missed, mut known) = (0, 0, 0);
                for i in 0..1000u32 {
                    let at = |k: u32| f64::from(k) - 4.5;
                    let low = DVec3::new(at(i % 10), at(i / 10 % 10), at(i / 100));
                    let bounds = Bounds3::new(low, low + 0.6);
                    let seen = camera.may_see(bounds);
                    if is_met(&camera, bounds) {
                        met += 1;
                        assert!(seen, "{bounds:?} {camera:?}");
                    } else {
                        missed += 1;
                        known += u32::from(!seen);
                    }
                }
                let panorama = projection == Projection::Panorama;
                assert!(
                    met > 10 && (panorama || known * 10 > missed * 8),
                    "{met} {missed} {known}"
                );
            }
        }
    }
}
