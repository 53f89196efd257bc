//! What the loader of volumes is asked for, and what it answers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DAffine3;
use pileus_media::emission::EmissionField;
use pileus_media::{BuildReport, Medium};

use super::scale::DefaultScale;
use crate::error::Place;
use crate::spec::volume_spec::{EmissionSpec, VolumeSpec};

/// A volume of the scene: a medium in world space and where it came from.
#[derive(Debug, Clone)]
pub struct Volume {
    /// The user's name for it, or that of its file.
    pub name: String,
    /// The medium, in world space.
    pub medium: Arc<Medium>,
    /// The light that it emits, in world space.
    pub emission: Option<Arc<EmissionField>>,
    /// Where its values came from.
    pub source: VolumeSource,
}

/// Where the values of a volume came from.
#[derive(Debug, Clone)]
pub enum VolumeSource {
    /// A grid of an OpenVDB file.
    Vdb {
        /// The file.
        path: PathBuf,
        /// The grid as it is addressed: `density` or `density[1]`.
        grid: String,
        /// Extinction per scene unit where the grid is 1, before the channels' `extinction`.
        density_scale: f64,
        /// The light and the albedo of a fire that nobody described, see [`DefaultScale::Cloud`].
        fire: Option<Box<(EmissionSpec, f64)>>,
        /// What the render grid takes; shared by all volumes made of the same grid.
        build: BuildReport,
    },
    /// A formula.
    Homogeneous,
}

/// One volume to load: what the user wrote, where it goes and where it was written.
pub struct VolumeRequest<'a> {
    /// What the user wrote; `vdb` is a path by now.
    pub spec: &'a VolumeSpec,
    /// Applied last: the world transform of the glTF node, or the identity.
    pub to_world: DAffine3,
    /// What to call it if the specification has no name.
    pub fallback_name: &'a str,
    /// The place of a key of the specification (a JSON pointer relative to it), for messages.
    pub place: &'a dyn Fn(&str) -> Place,
    /// The extinction of a grid value of 1 if the specification does not say.
    pub default_scale: DefaultScale,
}

/// What a volume is called.
pub(super) fn name(request: &VolumeRequest<'_>) -> String {
    let file = request.spec.vdb.as_ref().map(Path::new).and_then(Path::file_stem);
    match &request.spec.name {
        Some(name) => name.clone(),
        None if !request.fallback_name.is_empty() => request.fallback_name.to_owned(),
        None => file.map_or_else(|| "volume".into(), |stem| stem.to_string_lossy().into_owned()),
    }
}
