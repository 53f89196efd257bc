//! Where a volume and its grids are: transforms, and boxes under them.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use pileus_math::Bounds3;
use pileus_vdb::GridInfo;

use crate::error::{Error, Place};
use crate::spec::volume_spec::{TransformSpec, UpAxis, VolumeSpec};

/// Everything after the grid's own transform: up axis, the volume's transform, the node's.
pub(super) fn placement(
    spec: &VolumeSpec,
    to_world: &DAffine3,
    place: &dyn Fn(&str) -> Place,
) -> Result<DAffine3, Error> {
    let up = match spec.up_axis().0 {
        UpAxis::Y => DAffine3::IDENTITY,
        // (x, y, z) to (x, z, -y)
        UpAxis::Z => DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y)),
    };
    let own = match &spec.transform {
        None => DAffine3::IDENTITY,
        Some(TransformSpec { translation, rotation, scale }) => {
            let rotation = DQuat::from_array(rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
            if !(rotation.is_finite() && (rotation.length() - 1.0).abs() < 1e-2) {
                return Err(Error::invalid(
                    place("/transform/rotation"),
                    "the rotation is not a unit quaternion",
                    "give x, y, z, w with squares that add up to 1; [0, 0, 0, 1] is no rotation",
                ));
            }
            DAffine3::from_scale_rotation_translation(
                DVec3::from_array(scale.unwrap_or([1.0; 3])),
                rotation.normalize(),
                DVec3::from_array(translation.unwrap_or([0.0; 3])),
            )
        }
    };
    let placement = *to_world * own * up;
    if !(placement.is_finite() && placement.matrix3.determinant().is_normal()) {
        return Err(Error::invalid(
            place(if spec.transform.is_some() { "/transform" } else { "" }),
            "the volume's transform is singular or not finite",
            "use scales other than 0",
        ));
    }
    Ok(placement)
}

/// Row vectors as OpenVDB writes them, `world = [i, j, k, 1] * M`, to an affine transform.
pub fn affine(matrix: [[f64; 4]; 4]) -> DAffine3 {
    let [x, y, z, w] = matrix.map(|[a, b, c, _]| DVec3::new(a, b, c));
    DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: w }
}

/// From the index space of the density to that of another grid of the same file; both share the
/// world transform.
pub(super) fn between(
    density: &GridInfo,
    other: &GridInfo,
    place: &dyn Fn() -> Place,
) -> Result<DAffine3, Error> {
    let matrix = |info: &GridInfo| {
        info.transform.matrix().map(affine).map_err(|source| Error::vdb(place(), source))
    };
    let map = matrix(other)?.inverse() * matrix(density)?;
    if map.is_finite() {
        return Ok(map);
    }
    Err(Error::invalid(
        place(),
        format!("the transform of grid `{}` is singular", other.full_name()),
        "write the grid again",
    ))
}

/// A box moved by a transform that keeps it parallel to the axes; `None` for any other transform.
pub(super) fn move_box(bounds: Bounds3, transform: &DAffine3) -> Option<Bounds3> {
    let matrix = transform.matrix3;
    let largest = matrix.to_cols_array().into_iter().fold(0.0f64, |a, v| a.max(v.abs()));
    for column in [matrix.x_axis, matrix.y_axis, matrix.z_axis] {
        let nonzero = column.to_array().iter().filter(|v| v.abs() > 1e-12 * largest).count();
        if nonzero != 1 {
            return None;
        }
    }
    Some(Bounds3::of_points([bounds.low, bounds.high].map(|p| transform.transform_point3(p))))
}
