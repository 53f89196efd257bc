//! Grids read by the `vdb-rs` crate as grids of this one.

use crate::compression::Compression;
use crate::error::{Error, Place};
use crate::grid::{Grid, GridClass, GridInfo, ValueType, Values};
use crate::metadata::{MetaValue, Metadata};
use crate::transform::Transform;
use crate::tree::{Coord, LEAF_VALUES, Tile, Tree};

/// Converts a float grid that `vdb-rs` has read.
///
/// That crate keeps neither the background value, which becomes 0, nor root tiles nor inactive
/// values other than 0, so only fog volumes without such come out as
/// [`VdbFile::read`](crate::VdbFile::read) gives them. Names with characters beyond ASCII arrive
/// damaged, and several encodings make it panic or misread; `docs/decisions/0001-own-vdb-reader.md`
/// lists them.
///
/// # Errors
/// [`Error::Invalid`] when a node does not hold as many values as its masks ask for.
pub fn from_vdb_rs(grid: &vdb_rs::Grid<f32>) -> Result<Grid, Error> {
    let descriptor = &grid.descriptor;
    let broken = || Error::Invalid {
        place: Place {
            file: "(vdb-rs)".into(),
            grid: Some(descriptor.name.clone()),
            offset: Some(descriptor.grid_pos),
        },
        what: "a node of the vdb-rs grid has too few values".into(),
        remedy: "read the file with VdbFile::open",
    };
    // Before version 222 the places of children are left out of the values of a node.
    let dense = descriptor.file_version >= 222;
    let mut leaves = Vec::new();
    let mut tiles = Vec::new();
    for upper in &grid.tree.root_nodes {
        let origin = upper.origin.to_array();
        for (slot, value) in active_values(
            upper.value_mask.as_raw_slice(),
            upper.child_mask.as_raw_slice(),
            &upper.data,
            dense,
        ) {
            let value = value.ok_or_else(broken)?;
            tiles.push(Tile {
                origin: child(origin, slot, 5, 7),
                log2_size: 7,
                value,
                active: true,
            });
        }
        for lower in upper.nodes.values() {
            let origin = lower.origin.to_array();
            for (slot, value) in active_values(
                lower.value_mask.as_raw_slice(),
                lower.child_mask.as_raw_slice(),
                &lower.data,
                dense,
            ) {
                let value = value.ok_or_else(broken)?;
                let origin = child(origin, slot, 4, 3);
                tiles.push(Tile { origin, log2_size: 3, value, active: true });
            }
            for leaf in lower.nodes.values() {
                let values: [f32; LEAF_VALUES] =
                    leaf.buffer.as_slice().try_into().map_err(|_| broken())?;
                let mask = leaf.value_mask.as_raw_slice().try_into().map_err(|_| broken())?;
                leaves.push((leaf.origin.to_array(), values, mask));
            }
        }
    }
    let tree = Tree::from_leaves(0.0, leaves).with_tiles(tiles);
    Ok(Grid { info: info(grid), values: Values::Float(tree) })
}

/// Slots of a node that are active but no child, with their values, if they have one.
fn active_values<'n>(
    values: &'n [u64],
    children: &'n [u64],
    data: &'n [f32],
    dense: bool,
) -> impl Iterator<Item = (usize, Option<f32>)> + 'n {
    let bit = |mask: &[u64], slot: usize| mask[slot >> 6] >> (slot & 63) & 1 != 0;
    let slots = 64 * values.len().min(children.len());
    let mut absent = 0;
    (0..slots).filter_map(move |slot| {
        if bit(children, slot) {
            absent += 1;
            return None;
        }
        let index = if dense { slot } else { slot - absent };
        bit(values, slot).then(|| (slot, data.get(index).copied()))
    })
}

fn child(origin: Coord, slot: usize, log2_dim: u32, log2_child: u32) -> Coord {
    let mask = (1 << log2_dim) - 1;
    let slot = slot as i32;
    let steps = [slot >> (2 * log2_dim) & mask, slot >> log2_dim & mask, slot & mask];
    std::array::from_fn(|axis| origin[axis].wrapping_add(steps[axis] << log2_child))
}

fn info(grid: &vdb_rs::Grid<f32>) -> GridInfo {
    let descriptor = &grid.descriptor;
    let metadata = Metadata::from_items(descriptor.meta_data.0.iter().map(|(name, value)| {
        let value = match value {
            vdb_rs::MetadataValue::String(text) => MetaValue::String(text.clone()),
            vdb_rs::MetadataValue::Vec3i(v) => MetaValue::Vec3i(v.to_array()),
            vdb_rs::MetadataValue::I32(v) => MetaValue::Int32(*v),
            vdb_rs::MetadataValue::I64(v) => MetaValue::Int64(*v),
            vdb_rs::MetadataValue::Float(v) => MetaValue::Float(*v),
            vdb_rs::MetadataValue::Bool(v) => MetaValue::Bool(*v),
            vdb_rs::MetadataValue::Unknown { name, data } => {
                MetaValue::Unknown { type_name: name.clone(), bytes: data.clone() }
            }
        };
        (name.clone(), value)
    }));
    let (scale, translation) = match &grid.transform {
        vdb_rs::Map::UniformScaleMap { scale_values, .. } => (scale_values.to_array(), [0.0; 3]),
        vdb_rs::Map::ScaleTranslateMap { scale_values, translation, .. } => {
            (scale_values.to_array(), translation.to_array())
        }
    };
    let mut matrix = [[0.0; 4]; 4];
    for axis in 0..3 {
        matrix[axis][axis] = scale[axis];
        matrix[3][axis] = translation[axis];
    }
    matrix[3][3] = 1.0;
    GridInfo {
        name: descriptor.name.clone(),
        index: 0,
        value_type: ValueType::Float,
        type_name: descriptor.grid_type.clone(),
        class: GridClass::from_metadata(&metadata),
        saved_as_half: descriptor.meta_data.is_half_float(),
        compression: Compression {
            zip: descriptor.compression.contains(vdb_rs::Compression::ZIP),
            blosc: descriptor.compression.contains(vdb_rs::Compression::BLOSC),
            active_mask: descriptor.compression.contains(vdb_rs::Compression::ACTIVE_MASK),
        },
        instance_of: None,
        metadata,
        transform: Transform::from_matrix(matrix),
        shares_name: false,
        unique_name: descriptor.name.clone(),
        parent_name: String::new(),
        tree_start: 0,
        tree_end: 0,
        leaves_start: 0,
    }
}

#[cfg(test)]
mod tests;
