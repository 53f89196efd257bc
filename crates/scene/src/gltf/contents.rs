//! What is read out of a glTF file.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DAffine3;

use crate::error::Place;
use crate::light::punctual::Light;
use crate::spec::volume_spec::VolumeSpec;

/// What a glTF file contributes to a scene.
#[derive(Debug, Clone)]
pub struct GltfScene {
    /// Cameras of the file, in the order of the node walk.
    pub cameras: Vec<GltfCamera>,
    /// Punctual lights of the file in radiometric units.
    pub lights: Vec<Light>,
    /// Volumes of the file.
    pub volumes: Vec<GltfVolume>,
    /// Nodes of the file that have meshes.
    pub meshes: Vec<GltfMesh>,
    /// What it contains and this version leaves out, as sentences.
    pub not_modelled: Vec<String>,
    /// What was chosen in it, as sentences for people.
    pub notes: Vec<String>,
    /// What is likely not meant so, as sentences for people.
    pub warnings: Vec<String>,
    /// The program that wrote it, by its own name.
    pub generator: Option<String>,
    /// Whether it has nodes that hold nothing: an empty that lost its properties, perhaps.
    pub has_empties: bool,
    /// World transforms of the nodes, if a mesh is placed by the joints of a skin; `None` for nodes
    /// that are their own ancestors.
    pub(crate) transforms: Vec<Option<DAffine3>>,
    /// Numbers of things in the file, for `info`.
    pub counts: GltfCounts,
    /// The files that its buffers and images are in, whether they are needed or not.
    pub files: Vec<PathBuf>,
}

/// A camera of a glTF file.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfCamera {
    /// Name of its node; empty if it has none.
    pub node: String,
    /// Number of its node in the file.
    pub index: usize,
    /// Name of the camera itself; empty if it has none.
    pub name: String,
    /// From the camera's space (it looks along -Z) to the world.
    pub to_world: DAffine3,
    /// Full vertical opening angle in degrees of a perspective camera.
    pub fov_y_degrees: Option<f64>,
    /// `xmag` and `ymag` of an orthographic camera, as the file has them: half the width and half
    /// the height of the view, in scene units.
    pub magnification: Option<[f64; 2]>,
    /// Width over height of the view it was made for.
    pub aspect_ratio: Option<f64>,
}

/// A volume of a glTF file.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfVolume {
    /// Name of its node; empty if it has none.
    pub node: String,
    /// What the node says; its file names are resolved. Instances of a node share it.
    pub spec: Arc<VolumeSpec>,
    /// World transform of the node, or of its instance.
    pub to_world: DAffine3,
    /// Where the specification stands, a JSON pointer.
    pub pointer: String,
    /// File, line and column of the specification.
    pub place: Place,
}

/// Numbers of things in a glTF file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
#[expect(missing_docs, reason = "named as glTF names them")]
pub struct GltfCounts {
    pub nodes: usize,
    pub meshes: usize,
    pub materials: usize,
    pub textures: usize,
    pub animations: usize,
    pub skins: usize,
}

/// A node with a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct GltfMesh {
    /// Name of the node; empty if it has none.
    pub name: String,
    /// Number of the node in the file.
    pub node: usize,
    /// Number of the mesh in the file.
    pub mesh: usize,
    /// World transform of the node.
    pub to_world: DAffine3,
    /// Number of the skin in the file, whose joints place the mesh instead of `to_world`.
    pub skin: Option<usize>,
    /// Weights of the mesh's morph targets at rest; empty if all are zero.
    pub weights: Vec<f32>,
}
