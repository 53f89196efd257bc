//! The extensions of glTF that are modelled.

use super::instances::INSTANCING;
use super::material;
use super::volume::EXTENSION;

/// The extension that hides nodes with all that is below them.
pub(super) const VISIBILITY: &str = "KHR_node_visibility";

/// Extensions that are modelled, besides those of materials. `KHR_mesh_quantization` only allows
/// more types of components, `KHR_animation_pointer` more targets of animations, which are not
/// played.
pub(super) const MODELLED: [&str; 7] = [
    EXTENSION,
    INSTANCING,
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    VISIBILITY,
    "KHR_texture_transform",
];

/// Whether an extension is modelled, of the file or of its materials.
pub(super) fn is_modelled(extension: &str) -> bool {
    MODELLED.contains(&extension) || material::MODELLED.contains(&extension)
}
