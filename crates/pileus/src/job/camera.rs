//! The camera of a job.

use pileus_scene::option::{above, below, unit};
use pileus_scene::options;

use super::rules;

options! {
    /// A perspective camera: `position` and `look_at`, or the `node` of a camera in the glTF scene.
    #[derive(Default)]
    #[schemars(extend("allOf" = rules::camera()))]
    pub struct CameraSpec {
        /// Name of a glTF node with a camera; excludes the keys of placement.
        #[schemars(extend("examples" = ["Camera.001"]))]
        node: String;
        /// Where the camera stands.
        position: [f64; 3], unit("scene units");
        /// What it looks at.
        look_at: [f64; 3], unit("scene units");
        /// What is up in the image.
        up: [f64; 3] = [0.0, 1.0, 0.0], rules::directed;
        /// Full vertical opening angle.
        fov_y: f64 = 35.0, above(0), below(180), unit("degrees");
        /// When the shutter opens and closes. Motion is not rendered by this version: both must be
        /// 0.
        shutter: [f64; 2] = [0.0; 2], rules::shutter, unit("seconds");
    }
}
