//! Maps between the index spaces of grids that share a file but not a transform.

use glam::DAffine3;
use pileus_math::Bounds3;

/// The map, with numbers that are whole but for rounding made whole: grids of one transform then
/// share voxels exactly.
pub(crate) fn snapped(map: DAffine3) -> DAffine3 {
    /// Largest rounding taken for one, in voxels.
    const ROUNDING: f64 = 1e-9;
    let whole = map.to_cols_array().map(f64::round);
    let close = map.to_cols_array().iter().zip(&whole).all(|(a, b)| (a - b).abs() < ROUNDING);
    if close { DAffine3::from_cols_array(&whole) } else { map }
}

/// The box parallel to the axes around a moved box, in the same closed sense.
pub(crate) fn box_over(to: &DAffine3, bounds: Bounds3) -> Bounds3 {
    if *to == DAffine3::IDENTITY {
        return bounds;
    }
    let middle = to.transform_point3(bounds.centre());
    let half = 0.5 * bounds.size();
    let m = to.matrix3;
    let reach = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
    // Rounding must not narrow it.
    let slack = (middle.abs() + reach) * 1e-12;
    Bounds3::new(middle - reach - slack, middle + reach + slack)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    #[test]
    fn rounding_is_taken_off_and_nothing_else() {
        let map = DAffine3::from_translation(DVec3::new(3.0, -2.0 + 1e-12, 0.0));
        assert_eq!(snapped(map).translation, DVec3::new(3.0, -2.0, 0.0));
        let half = DAffine3::from_translation(DVec3::splat(0.5));
        assert_eq!(snapped(half), half);
    }

    proptest! {
        #[test]
        fn moved_points_stay_in_the_moved_box(
            axis in prop::array::uniform3(-1.0..1.0f64),
            angle in 0.0..6.0f64,
            scale in prop::array::uniform3(-3.0..3.0f64),
            u in prop::array::uniform3(0.0..=1.0f64),
        ) {
            let rotation = DQuat::from_scaled_axis(DVec3::from_array(axis) * angle);
            let map = DAffine3::from_scale_rotation_translation(
                DVec3::from_array(scale), rotation, DVec3::new(1.0, 20.0, -300.0));
            let bounds = Bounds3::new(DVec3::new(-4.0, 2.0, 8.0), DVec3::new(4.0, 10.0, 16.0));
            let p = map.transform_point3(bounds.at(DVec3::from_array(u)));
            prop_assert!(box_over(&map, bounds).contains(p));
        }
    }
}
