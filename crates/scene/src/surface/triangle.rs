//! Where a ray meets a triangle.

use glam::{DVec3, Vec3};

/// A ray prepared for the watertight test: axes permuted and sheared so that it runs along z.
///
/// Woop, Benthin, Wald, "Watertight ray/triangle intersection" (JCGT 2013), in double precision
/// for triangles in single precision. An edge that two triangles share is tested with the same
/// products by both, so that a ray never passes between them; a ray through an edge or a vertex
/// hits all triangles there.
#[derive(Debug, Clone, Copy)]
pub struct ShearedRay {
    origin: DVec3,
    axes: [usize; 3],
    shear: DVec3,
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleHit {
    /// Distance in lengths of the ray's direction, above 0.
    pub t: f64,
    /// Weights of the second and third vertex; that of the first is what is missing to 1.
    pub barycentrics: [f64; 2],
    /// Whether the ray comes from the side on which the vertices run counter-clockwise.
    pub front_face: bool,
}

impl ShearedRay {
    /// A ray from `origin` along `direction`, which is not zero.
    #[inline]
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        let size = direction.abs();
        let z = if size.x > size.y && size.x > size.z {
            0
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        // Keeps the winding.
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let inverse = 1.0 / direction[z];
        let shear = DVec3::new(direction[x] * inverse, direction[y] * inverse, inverse);
        Self { origin, axes: [x, y, z], shear }
    }

    /// The hit with a `t` in (0, `t_max`]; `None` for a triangle seen exactly from its edge.
    // The innermost step of every ray: a call would cost a percent of whole paths.
    #[inline(always)]
    pub fn intersect(&self, vertices: &[Vec3; 3], t_max: f64) -> Option<TriangleHit> {
        let [x, y, z] = self.axes;
        let sheared = |vertex: Vec3| {
            let p = (vertex.as_dvec3() - self.origin).to_array();
            (p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z], self.shear.z * p[z])
        };
        // Not by `map`, which is called, not inlined, once a vertex.
        let [a, b, c] = *vertices;
        let (a, b, c) = (sheared(a), sheared(b), sheared(c));
        // The vertices' weights, each an area opposite.
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let area = u + v + w;
        if area == 0.0 {
            return None;
        }
        let inverse = 1.0 / area;
        let t = (u * a.2 + v * b.2 + w * c.2) * inverse;
        if !(t > 0.0 && t <= t_max) {
            return None;
        }
        Some(TriangleHit { t, barycentrics: [v * inverse, w * inverse], front_face: area > 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

    #[test]
    fn hits_have_the_right_side_distance_and_weights() {
        for axis in 0..3 {
            // The triangle turned through the axes, seen from both sides.
            let turn = |p: Vec3| {
                let p = p.to_array();
                Vec3::from_array([0, 1, 2].map(|i| p[(i + axis) % 3]))
            };
            let triangle = TRIANGLE.map(turn);
            for (from, front) in [(2.0, true), (-2.0, false)] {
                let origin = turn(Vec3::new(0.25, 0.5, from)).as_dvec3();
                let direction = turn(Vec3::new(0.0, 0.0, -from * 0.25)).as_dvec3();
                let hit = ShearedRay::new(origin, direction).intersect(&triangle, 9.0).unwrap();
                assert_eq!(hit.t, 4.0);
                assert_eq!(hit.barycentrics, [0.25, 0.5]);
                assert_eq!(hit.front_face, front, "axis {axis}");
                let ray = ShearedRay::new(origin, direction);
                assert!(ray.intersect(&triangle, 3.9).is_none());
                assert!(ShearedRay::new(origin, -direction).intersect(&triangle, 9.0).is_none());
            }
        }
    }

    #[test]
    fn edges_and_vertices_are_hit_and_edge_on_is_not() {
        let origin = DVec3::new(0.3, 0.2, 1.0);
        for target in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [0.5, 0.0], [0.0, 0.25]] {
            let target = DVec3::new(target[0], target[1], 0.0);
            let ray = ShearedRay::new(target + DVec3::Z, DVec3::NEG_Z);
            assert!(ray.intersect(&TRIANGLE, 2.0).is_some(), "{target}");
        }
        let ray = ShearedRay::new(origin, DVec3::X);
        assert!(ray.intersect(&TRIANGLE, 2.0).is_none());
        let ray = ShearedRay::new(DVec3::new(-1.0, 0.2, 0.0), DVec3::X);
        assert!(ray.intersect(&TRIANGLE, 9.0).is_none());
    }
}
