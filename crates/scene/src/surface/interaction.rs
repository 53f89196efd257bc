//! What there is to know where a ray hits a surface.

use glam::{DMat3, DVec3, Vec3};

use super::material::Interior;
use super::parameters::SurfaceParameters;

/// Where a ray hit a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// Number of the instance.
    pub instance: u32,
    /// Number of the triangle in the instance's mesh.
    pub triangle: u32,
    /// Weights of the triangle's second and third vertex.
    pub barycentrics: [f64; 2],
    /// Whether the front was hit: the side on which the vertices run counter-clockwise.
    pub front_face: bool,
    /// How far faces that coincide with this one may be from it; 0 if there are none.
    pub(crate) slack: f32,
    /// Of a sheet that lies on both sides of an opaque one in the same place: whether its front is
    /// on the outside.
    pub(crate) outer_front: bool,
}

/// Everything about a hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interaction {
    /// The point, in world space.
    pub p: DVec3,
    /// Unit normal of the triangle, on its front side.
    pub geometric_normal: Vec3,
    /// Unit normal for shading, on the same side of the triangle: the vertices' normals
    /// interpolated, turned by the normal map, and turned back as far as needed for the ray to
    /// come from the same side of it as of the triangle.
    pub shading_normal: Vec3,
    /// Whether the ray came from the front.
    pub front_face: bool,
    /// What the material says here.
    pub parameters: SurfaceParameters,
    /// Radiance emitted against the ray; zero on the back of a single-sided surface.
    pub emission: Vec3,
    /// What is behind the surface, seen from its front, if it bounds a medium.
    pub interior: Option<Interior>,
    /// Number of the material in the file; the last one is glTF's default material.
    pub material: u32,
    /// Number of the instance.
    pub instance: u32,
    /// Number of the triangle in the instance's mesh.
    pub triangle: u32,
    /// Number of the triangle among [`super::Surfaces::emitters`].
    pub emitter: Option<u32>,
    /// How far the point may be off its plane, or off the faces that coincide with it.
    pub(crate) offset: f64,
    /// How far faces that coincide with this one may be from it; 0 if there are none.
    pub(crate) slack: f32,
    /// Of a sheet that lies on both sides of an opaque one in the same place: whether its front is
    /// on the outside.
    pub(crate) outer_front: bool,
}

impl Interaction {
    /// The origin of a ray that leaves along `direction`, moved off the surface to that side.
    ///
    /// The distance is a bound of what rounds (the point, and the next ray's way into the space
    /// of the mesh), some 1e-14 of the coordinates: a ray that leaves does not hit the triangle it
    /// leaves, and light does not leak past surfaces that are further apart than that. Where other
    /// faces coincide with this one, ask [`super::Surfaces::next_layer`] first: the origin is past
    /// all of them.
    pub fn spawn(&self, direction: Vec3) -> DVec3 {
        let normal = self.geometric_normal.as_dvec3();
        let side = direction.as_dvec3().dot(normal);
        self.p + normal * self.offset.copysign(side)
    }
}

/// How rounding in an instance's transforms moves points: bounds by sums of absolute values
/// (as in Pharr, Jakob, Humphreys, "Physically based rendering", section 6.8).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rounding {
    /// Absolute values of the matrix to the world.
    matrix: DMat3,
    /// Absolute values of the matrix to the world, times those of its inverse.
    round_trip: DMat3,
    /// What does not depend on the point.
    constant: DVec3,
}

/// Roundings that a coordinate goes through, generously, times the largest relative error of one.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Rounding {
    pub(crate) fn new(to_world: &glam::DAffine3, to_local: &glam::DAffine3) -> Self {
        let abs = |m: &DMat3| DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs());
        let matrix = abs(&to_world.matrix3);
        Self {
            matrix,
            round_trip: matrix * abs(&to_local.matrix3),
            constant: to_world.translation.abs() + matrix * to_local.translation.abs(),
        }
    }

    /// How far along `normal` a point of the world may be off, if it was made from a triangle of
    /// vertices of at most `reach` in the mesh's space and is the origin of a ray into it.
    pub(crate) fn offset(&self, reach: DVec3, p_world: DVec3, normal: Vec3) -> f64 {
        let error = self.matrix * reach + self.round_trip * p_world.abs() + self.constant;
        // The next ray's distance to the triangle is made from all coordinates, whatever the
        // normal: a floor at height zero is no exact plane to it.
        let error = error.max_element() * f64::from(normal.abs().element_sum());
        // Something above zero even at the origin of everything.
        (error * ROUNDING).max(f64::MIN_POSITIVE)
    }
}

/// The normal closest to `normal` that lies on the same side of the triangle as its
/// `geometric_normal` and of which the viewer (towards `wo`) is on the side on which they are of
/// the triangle.
pub(crate) fn consistent_normal(normal: Vec3, geometric_normal: Vec3, wo: Vec3) -> Vec3 {
    /// Least cosine, so that what is sampled about the normal is visible.
    const LEAST: f32 = 1e-3;
    let side = if wo.dot(geometric_normal) < 0.0 { -1.0 } else { 1.0 };
    let wo = wo * side;
    let mut turned = normal;
    if !(turned.dot(geometric_normal) > 0.0) {
        return geometric_normal;
    }
    let cosine = turned.dot(wo);
    if cosine < LEAST {
        // Towards the viewer, as far as it takes. The viewer sees the triangle less flat than
        // that only if there is room for it.
        let least = LEAST.min(geometric_normal.dot(wo));
        turned = (turned + wo * (least - cosine)).normalize_or_zero();
        if !(turned.dot(geometric_normal) > 0.0 && turned.dot(wo) > 0.0) {
            return geometric_normal;
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shading_normals_stay_on_the_viewers_side() {
        let ng = Vec3::Z;
        for i in 0..2000u32 {
            let random = |k: u32| {
                let h = (i * 5 + k).wrapping_mul(0x9e37_79b9) >> 8;
                h as f32 / (1u32 << 23) as f32 - 1.0
            };
            let normal = Vec3::new(random(0), random(1), random(2)).normalize();
            let wo = Vec3::new(random(3), random(4), random(5) * 0.1).normalize();
            let turned = consistent_normal(normal, ng, wo);
            assert!((turned.length() - 1.0).abs() < 1e-5);
            assert!(turned.dot(ng) > 0.0, "{normal} {wo}");
            assert!(turned.dot(wo) * ng.dot(wo) > 0.0, "{normal} {wo} {turned}");
            // Nothing is changed that need not be.
            if normal.z > 0.0 && normal.dot(wo) * wo.z.signum() > 1e-3 {
                assert_eq!(turned, normal);
            }
        }
    }
}
