//! Which camera is asked for, and with which lens.

use glam::DVec3;
use pileus_scene::{CameraRequest, Focus, LensRequest, Orbit, Projection};

use super::places::Places;
use crate::job::{CameraKind, CameraSpec};

/// The camera that a job asks for. How it is placed the schema has checked: by a node, by a
/// position and a target, or not at all; and which keys its type has. `orbit`: from where one that
/// has no place frames what there is.
pub(super) fn resolve(
    spec: Option<&CameraSpec>,
    orbit: Option<Orbit>,
    places: &Places,
) -> CameraRequest {
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
            projection: match spec.kind() {
                CameraKind::Perspective => Projection::Perspective { fov_y_degrees: spec.fov_y() },
                CameraKind::Orthographic => {
                    Projection::Orthographic { height: spec.height.unwrap_or_default() }
                }
                CameraKind::Panorama => Projection::Panorama,
            },
            place: places.at("/camera"),
        },
        _ if spec.kind() == CameraKind::Orthographic => {
            CameraRequest::FramedOrthographic { height: spec.height, orbit }
        }
        _ => CameraRequest::Auto { fov_y_degrees: spec.fov_y(), orbit },
    }
}

/// The lens that a job asks for, if any. What it is focused on the schema has checked.
pub(super) fn lens(spec: Option<&CameraSpec>, places: &Places) -> Option<LensRequest> {
    let spec = spec?;
    let (focus, key) = match (spec.focus_distance, spec.focus_on, spec.look_at) {
        (Some(distance), ..) => (Focus::Distance(distance), "/camera/focus_distance"),
        (None, Some(point), _) => (Focus::Point(DVec3::from_array(point)), "/camera/focus_on"),
        (None, None, target) => {
            (Focus::Point(DVec3::from_array(target.unwrap_or_default())), "/camera")
        }
    };
    let (aperture, blades) = (spec.aperture(), spec.blades());
    (aperture > 0.0).then(|| LensRequest { aperture, blades, focus, place: places.at(key) })
}
