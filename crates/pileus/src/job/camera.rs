//! The camera of a job.

use pileus_scene::option::{above, at_least, below, between, unit};
use pileus_scene::{Lens, options, whole};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rules;

options! {
    /// A camera: `position` and `look_at`, or the `node` of a camera in the glTF scene. With an
    /// `aperture` it has a thin lens and one plane that is sharp; without, everything is. Rays
    /// count alike wherever they pass film and lens.
    #[derive(Default)]
    #[schemars(extend("allOf" = rules::camera()))]
    pub struct CameraSpec {
        /// Name of a glTF node with a camera; excludes the keys of placement, `type` and `height`,
        /// not those of a lens, which glTF does not have.
        #[schemars(extend("examples" = ["Camera.001"]))]
        node: String;
        /// How it maps what it sees.
        #[serde(rename = "type")]
        kind: CameraKind = CameraKind::Perspective;
        /// Where the camera stands: the pinhole, the middle of the lens or of an orthographic
        /// film.
        position: [f64; 3], unit("scene units");
        /// What it looks at.
        look_at: [f64; 3], unit("scene units");
        /// What is up in the image.
        up: [f64; 3] = [0.0, 1.0, 0.0], rules::directed;
        /// Full vertical opening angle of a perspective camera.
        fov_y: f64 = 35.0, above(0), below(180), unit("degrees");
        /// Height of what an orthographic camera shows. Default, of a camera that is not placed:
        /// the volumes fit.
        height: f64, above(0), unit("scene units");
        /// Diameter (not radius) of the lens: of a round aperture, or of the circle through the
        /// corners of one with blades. 0 is a pinhole. That of a real lens is its focal length over
        /// its f-number.
        aperture: f64 = 0.0, at_least(0), unit("scene units");
        /// Distance of the sharp plane from the camera, along its view axis. Default: that of
        /// `look_at`.
        focus_distance: f64, above(0), unit("scene units");
        /// A point of the sharp plane, in front of the camera; instead of `focus_distance`.
        focus_on: [f64; 3], unit("scene units");
        /// Blades of the aperture: 0 for a round one, from 3 on those of a regular polygon with a
        /// corner on top.
        #[serde(deserialize_with = "whole::option")]
        blades: u32 = 0, between(0, Lens::MAX_BLADES), rules::blades;
        /// When the shutter opens and closes. Motion is not rendered by this version: both must be
        /// 0.
        shutter: [f64; 2] = [0.0; 2], rules::shutter, unit("seconds");
    }
}

/// How a camera maps what it sees to its film.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraKind {
    /// Central projection, as in an eye: what is farther away is smaller.
    #[default]
    Perspective,
    /// Parallel projection: things keep their size whatever their distance. What is behind the
    /// plane through `position` is not seen.
    Orthographic,
    /// All directions in latitude and longitude, in the layout of environment images: the middle
    /// looks at `look_at`, the top along `up`. An image twice as wide as high has square pixels at
    /// the horizon.
    Panorama,
}
