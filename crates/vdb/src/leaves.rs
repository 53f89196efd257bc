//! The voxel values of the leaves: one pass finds where each lies, then all are decoded in parallel into one array.

use rayon::prelude::*;

use crate::compression::{Block, Compression};
use crate::cursor::Cursor;
use crate::error::Fault;
use crate::packed::{Decoder, Encoding, MASK_COMPRESSION, Packed};
use crate::topology::Topology;
use crate::tree::{LEAF_VALUES, Leaf, Tree};
use crate::value::Value;

/// Leaves that one task decodes.
const LEAVES_PER_TASK: usize = 32;

/// How a leaf stores its values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeafLayout {
    /// Active mask, then packed values.
    Packed,
    /// Active mask, origin, then one bit per value.
    Bits,
    /// Active mask, origin; the mask is the value.
    Mask,
}

/// Values that a single bit can stand for.
pub(crate) trait FromBit: Value {
    fn from_bit(bit: bool) -> Self;
}

impl<V: Value> FromBit for V {
    fn from_bit(bit: bool) -> V {
        V::from_bytes(&[u8::from(bit)])
    }
}

/// Steps over all leaf buffers and tells where in the cursor's slice the values of each begin.
pub(crate) fn scan<V: Value>(
    cursor: &mut Cursor<'_>,
    encoding: &Encoding,
    layout: LeafLayout,
    topology: &Topology<V>,
) -> Result<Vec<usize>, Fault> {
    cursor.check_count(topology.leaves.len() as u64, 64, "leaves")?;
    let mut starts = Vec::with_capacity(topology.leaves.len());
    for leaf in &topology.leaves {
        // The mask stands here a second time.
        cursor.take(64, "the mask of a leaf")?;
        if layout == LeafLayout::Packed {
            let extra = if encoding.version < MASK_COMPRESSION {
                cursor.coord("the origin of a leaf")?;
                cursor.u8("the number of buffers of a leaf")?.saturating_sub(1)
            } else {
                0
            };
            starts.push(cursor.position());
            let active = count_active(leaf);
            Packed::read(cursor, encoding, topology.background, LEAF_VALUES, active)?;
            skip_old_buffers::<V>(cursor, encoding, extra)?;
        } else {
            cursor.coord("the origin of a leaf")?;
            starts.push(cursor.position());
            if layout == LeafLayout::Bits {
                cursor.take(64, "the values of a leaf")?;
            }
        }
    }
    Ok(starts)
}

/// Very old files may hold further buffers, which OpenVDB reads and drops as well.
fn skip_old_buffers<V: Value>(
    cursor: &mut Cursor<'_>,
    encoding: &Encoding,
    count: u8,
) -> Result<(), Fault> {
    let size = V::HALF_SIZE.filter(|_| encoding.half).unwrap_or(V::SIZE);
    let compression = Compression { zip: encoding.compression.zip, ..Compression::default() };
    for _ in 0..count {
        Block::read(cursor, compression, LEAF_VALUES * size)?;
    }
    Ok(())
}

/// Decodes all leaves, sorted by origin, on the current rayon pool. `starts` is what [`scan`] found on the same slice.
pub(crate) fn decode<V: Value>(
    cursor: &Cursor<'_>,
    encoding: &Encoding,
    layout: LeafLayout,
    topology: Topology<V>,
    starts: Vec<usize>,
) -> Result<Tree<V>, Fault> {
    let Topology { background, leaves, tiles } = topology;
    let mut order: Vec<(Leaf, usize)> = leaves.into_iter().zip(starts).collect();
    order.sort_unstable_by_key(|(leaf, _)| leaf.origin);
    let (leaves, starts): (Vec<Leaf>, Vec<usize>) = order.into_iter().unzip();

    // Zeroed memory comes from the system untouched, so each page is first written by the task that decodes into it.
    let mut values = vec![V::default(); leaves.len() * LEAF_VALUES];
    let tasks = (
        values.par_chunks_mut(LEAVES_PER_TASK * LEAF_VALUES),
        leaves.par_chunks(LEAVES_PER_TASK),
        starts.par_chunks(LEAVES_PER_TASK),
    );
    let fault = tasks
        .into_par_iter()
        .map_init(Decoder::new, |decoder, (values, leaves, starts)| {
            let leaves = leaves.iter().zip(starts);
            for (out, (leaf, start)) in values.chunks_exact_mut(LEAF_VALUES).zip(leaves) {
                let mut cursor = cursor.at(*start);
                match layout {
                    LeafLayout::Packed => {
                        let active = count_active(leaf);
                        Packed::read(&mut cursor, encoding, background, LEAF_VALUES, active)?
                            .unpack(decoder, leaf.mask.into_iter(), out)?;
                    }
                    LeafLayout::Bits => {
                        let bits = cursor.take(LEAF_VALUES / 8, "the values of a leaf")?;
                        for (values, byte) in out.chunks_exact_mut(8).zip(bits) {
                            for (bit, value) in values.iter_mut().enumerate() {
                                *value = V::from_bit(byte >> bit & 1 != 0);
                            }
                        }
                    }
                    LeafLayout::Mask => {
                        for (values, word) in out.chunks_exact_mut(64).zip(leaf.mask) {
                            for (bit, value) in values.iter_mut().enumerate() {
                                *value = V::from_bit(word >> bit & 1 != 0);
                            }
                        }
                    }
                }
            }
            Ok(())
        })
        .find_first(Result::is_err);
    match fault {
        Some(Err(fault)) => Err(fault),
        _ => Ok(Tree { background, leaves, values, tiles }),
    }
}

fn count_active(leaf: &Leaf) -> usize {
    leaf.mask.iter().map(|word| word.count_ones() as usize).sum()
}
