//! Orthonormal frames around a direction.

use crate::elementary::sin_cos_turn;
use glam::Vec3;

/// Two unit vectors that form a right-handed orthonormal basis with the unit vector `n`
/// [Duff et al. 2017].
#[inline(always)]
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// The unit vector at an angle to the unit vector `axis`, given by its cosine and sine, and turned
/// around it by `u` in [0, 1) of a full turn.
#[inline(always)]
pub fn around(axis: Vec3, (cos_theta, sin_theta): (f32, f32), u: f32) -> Vec3 {
    let (sin_phi, cos_phi) = sin_cos_turn(u);
    let (x, y) = basis(axis);
    let w = x * (sin_theta * cos_phi) + y * (sin_theta * sin_phi) + axis * cos_theta;
    // One Newton step keeps the direction a unit vector over thousands of scatterings.
    w * (1.5 - 0.5 * w.length_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::uniform;
    use rand_pcg::Pcg32;

    fn direction(rng: &mut Pcg32) -> Vec3 {
        let cos = 1.0 - 2.0 * uniform(rng);
        around(Vec3::Z, (cos, (1.0 - cos * cos).sqrt()), uniform(rng))
    }

    #[test]
    fn basis_is_orthonormal_and_right_handed() {
        let mut rng = Pcg32::new(3, 3);
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
        let all = axes.into_iter().chain((0..10_000).map(|_| direction(&mut rng)));
        for n in all {
            let (x, y) = basis(n);
            assert!((x.cross(y) - n).length() < 1e-5, "{n}");
            assert!(x.dot(y).abs() < 1e-6 && (x.length() - 1.0).abs() < 1e-5, "{n}");
        }
    }

    #[test]
    fn directions_around_an_axis_have_its_angle_and_go_round() {
        let mut rng = Pcg32::new(4, 4);
        for _ in 0..10_000 {
            let axis = direction(&mut rng);
            let cos = 1.0 - 2.0 * uniform(&mut rng);
            let angle = (cos, (1.0 - cos * cos).sqrt());
            let (a, b) = (around(axis, angle, 0.2), around(axis, angle, 0.45));
            assert!((a.length() - 1.0).abs() < 1e-6 && (a.dot(axis) - cos).abs() < 1e-5);
            // A quarter turn apart: what is left of both beside the axis is orthogonal.
            assert!((a - axis * cos).dot(b - axis * cos).abs() < 1e-5);
        }
    }
}
