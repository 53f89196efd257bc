//! Places of what a node holds: one, or one for each instance (`EXT_mesh_gpu_instancing`).

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use serde::Deserialize;

use super::accessor::{Accessors, Use};
use crate::error::Error;

/// Extension that places a node's content many times.
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

#[derive(Debug, Deserialize)]
struct Instancing {
    attributes: Attributes,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct Attributes {
    translation: Option<usize>,
    rotation: Option<usize>,
    scale: Option<usize>,
}

/// Transforms of the instances of node `index`, relative to the node; `None` if it is not
/// instanced. `bytes` is what each instance will take in memory, which counts against what a file
/// of its size may ask for.
pub(crate) fn instances(
    accessors: &Accessors<'_>,
    index: usize,
    bytes: u64,
) -> Result<Option<Vec<DAffine3>>, Error> {
    let buffers = accessors.buffers;
    let node = buffers.root.nodes.get(index);
    let others = node.and_then(|node| node.extensions.as_ref()).map(|e| &e.others);
    let Some(value) = others.and_then(|others| others.get(INSTANCING)) else { return Ok(None) };
    let document = buffers.document;
    let pointer = format!("/nodes/{index}/extensions/{INSTANCING}");
    let invalid =
        |what: String| Error::invalid(document.place(&pointer), what, "export the file again");
    let found = Instancing::deserialize(value).map_err(|error| invalid(error.to_string()))?;
    let attributes = found.attributes;
    let vectors =
        |index: Option<usize>| index.map(|index| accessors.vec3(index, Use::Vector)).transpose();
    let (translations, scales) = (vectors(attributes.translation)?, vectors(attributes.scale)?);
    let rotations = attributes.rotation;
    let rotations = rotations.map(|index| accessors.vec4(index, Use::Rotation)).transpose()?;
    let lengths = [
        translations.as_ref().map(|values| values.len()),
        scales.as_ref().map(|values| values.len()),
        rotations.as_ref().map(|values| values.len()),
    ];
    let count = lengths.iter().flatten().copied().max().unwrap_or(0);
    if lengths.iter().flatten().any(|&length| length != count) {
        return Err(invalid("the instances' attributes have different lengths".into()));
    }
    buffers.reserve(&pointer, (count as u64).saturating_mul(bytes))?;
    let mut transforms = Vec::with_capacity(count);
    for i in 0..count {
        let vector = |values: &Option<Arc<[Vec3]>>, none: DVec3| {
            values.as_ref().and_then(|v| v.get(i)).map_or(none, |v| v.as_dvec3())
        };
        let rotation = rotations.as_ref().and_then(|values| values.get(i));
        let rotation = rotation.map_or(DQuat::IDENTITY, |q| DQuat::from_vec4(q.as_dvec4()));
        if !(rotation.length_squared() > 1e-12) {
            return Err(invalid(format!("the rotation of instance {i} is zero")));
        }
        transforms.push(DAffine3::from_scale_rotation_translation(
            vector(&scales, DVec3::ONE),
            rotation.normalize(),
            vector(&translations, DVec3::ZERO),
        ));
    }
    Ok(Some(transforms))
}
