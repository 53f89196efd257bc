//! Which camera is asked for.

use glam::DVec3;
use pileus_scene::CameraRequest;

use super::places::Places;
use crate::job::CameraSpec;

/// The camera that a job asks for. How it is placed the schema has checked: by a node, by a
/// position and a target, or not at all.
pub(super) fn resolve(spec: Option<&CameraSpec>, places: &Places) -> CameraRequest {
    let default = CameraSpec::default();
    let spec = spec.unwrap_or(&default);
    match (&spec.node, spec.position, spec.look_at) {
        (Some(name), ..) => {
            CameraRequest::Node { name: name.clone(), place: places.at("/camera/node") }
        }
        (None, Some(position), Some(target)) => CameraRequest::LookAt {
            position: DVec3::from_array(position),
            target: DVec3::from_array(target),
            up: DVec3::from_array(spec.up()),
            fov_y_degrees: spec.fov_y(),
            place: places.at("/camera"),
        },
        _ => CameraRequest::Auto { fov_y_degrees: spec.fov_y() },
    }
}
