//! The voxel values of the leaves: a scan finds where each lies in a window of the file, then these
//! are decoded in parallel, straight to their places in one array.

use rayon::prelude::*;

use crate::compression::{Block, Compression};
use crate::cursor::Cursor;
use crate::error::Fault;
use crate::packed::{Decoder, Encoding, MASK_COMPRESSION, Packed, words};
use crate::source::{Failure, Window};
use crate::topology::Topology;
use crate::tree::{Coord, LEAF_VALUES, Leaf, Tree};
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

/// Steps over the buffer of a leaf.
pub(crate) fn step_over<V: Value>(
    cursor: &mut Cursor<'_>,
    encoding: &Encoding,
    layout: LeafLayout,
    background: V,
    leaf: &Leaf,
) -> Result<(), Fault> {
    let extra = enter(cursor, encoding, layout)?;
    match layout {
        LeafLayout::Packed => {
            Packed::read(cursor, encoding, background, LEAF_VALUES, count_active(leaf))?;
            skip_old_buffers::<V>(cursor, encoding, extra)
        }
        LeafLayout::Bits => cursor.take(LEAF_VALUES / 8, "the values of a leaf").map(drop),
        LeafLayout::Mask => Ok(()),
    }
}

/// Steps over what stands in front of the values of a leaf; returns the number of further buffers
/// behind them.
#[inline]
fn enter(cursor: &mut Cursor<'_>, encoding: &Encoding, layout: LeafLayout) -> Result<u8, Fault> {
    // The mask stands here a second time.
    cursor.take(64, "the mask of a leaf")?;
    let old = encoding.version < MASK_COMPRESSION;
    if old || layout != LeafLayout::Packed {
        cursor.coord("the origin of a leaf")?;
    }
    if old && layout == LeafLayout::Packed {
        return Ok(cursor.u8("the number of buffers of a leaf")?.saturating_sub(1));
    }
    Ok(0)
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

/// Reads all leaf buffers, which begin at `start`, and returns the tree with its leaves sorted.
/// Decodes on the current rayon pool, one window of bytes after the other.
pub(crate) fn read<V: Value>(
    window: &mut Window<'_>,
    start: u64,
    encoding: &Encoding,
    layout: LeafLayout,
    topology: Topology<V>,
) -> Result<Tree<V>, Failure> {
    let Topology { background, leaves, tiles } = topology;
    let least = (leaves.len() as u64).saturating_mul(65);
    if least > window.end().saturating_sub(start) {
        let what = format!("{} leaves need at least {least} bytes", leaves.len());
        return Err(Fault::truncated(start, u64::MAX, what).into());
    }
    let mut order: Vec<(Coord, usize)> =
        leaves.iter().enumerate().map(|(index, leaf)| (leaf.origin, index)).collect();
    order.sort_unstable();

    // Zeroed memory comes from the system untouched, so each page is first written by the task that
    // decodes into it.
    let mut values = vec![V::default(); leaves.len() * LEAF_VALUES];
    let mut slots: Vec<&mut [V]> = Vec::new();
    slots.resize_with(leaves.len(), Default::default);
    for (values, (_, index)) in values.chunks_exact_mut(LEAF_VALUES).zip(&order) {
        slots[*index] = values;
    }

    let batches = Batches { encoding, layout, background };
    let (mut at, mut done) = (start, 0);
    let mut starts = Vec::new();
    while done < leaves.len() {
        let mut cursor = window.cursor(at);
        starts.clear();
        let mut fault = None;
        for leaf in &leaves[done..] {
            let begin = cursor.position();
            if let Err(short) = step_over(&mut cursor, encoding, layout, background, leaf) {
                fault = Some(short);
                cursor = cursor.at(begin);
                break;
            }
            starts.push(begin);
        }
        at = cursor.offset();
        let end = done + starts.len();
        batches.decode(&cursor, &leaves[done..end], &starts, &mut slots[done..end])?;
        done = end;
        match fault {
            Some(fault) if window.can_show(&fault) => {
                window.advance(at, fault.needed().unwrap_or(0)).map_err(Failure::Io)?;
            }
            Some(fault) => return Err(fault.into()),
            None => {}
        }
    }
    let leaves = order.iter().map(|(_, index)| leaves[*index].clone()).collect();
    Ok(Tree { background, leaves, values, tiles })
}

/// What all leaves of a grid have in common.
struct Batches<'e, V> {
    encoding: &'e Encoding,
    layout: LeafLayout,
    background: V,
}

impl<V: Value> Batches<'_, V> {
    /// Decodes leaves that begin at `starts` of the cursor's slice into their slots.
    fn decode(
        &self,
        cursor: &Cursor<'_>,
        leaves: &[Leaf],
        starts: &[usize],
        slots: &mut [&mut [V]],
    ) -> Result<(), Fault> {
        let tasks = (
            slots.par_chunks_mut(LEAVES_PER_TASK),
            leaves.par_chunks(LEAVES_PER_TASK),
            starts.par_chunks(LEAVES_PER_TASK),
        );
        let fault = tasks
            .into_par_iter()
            .map_init(Decoder::new, |decoder, (slots, leaves, starts)| {
                let leaves = leaves.iter().zip(starts);
                slots.iter_mut().zip(leaves).try_for_each(|(out, (leaf, start))| {
                    self.decode_leaf(&mut cursor.at(*start), decoder, leaf, out)
                })
            })
            .find_first(Result::is_err);
        fault.unwrap_or(Ok(()))
    }

    fn decode_leaf(
        &self,
        cursor: &mut Cursor<'_>,
        decoder: &mut Decoder<V>,
        leaf: &Leaf,
        out: &mut [V],
    ) -> Result<(), Fault> {
        enter(cursor, self.encoding, self.layout)?;
        match self.layout {
            LeafLayout::Packed => {
                let active = count_active(leaf);
                Packed::read(cursor, self.encoding, self.background, LEAF_VALUES, active)?.unpack(
                    decoder,
                    leaf.mask.into_iter(),
                    out,
                )?;
            }
            LeafLayout::Bits => {
                let bits = cursor.take(LEAF_VALUES / 8, "the values of a leaf")?;
                fill_from_bits(words(bits), out);
            }
            LeafLayout::Mask => fill_from_bits(leaf.mask.into_iter(), out),
        }
        Ok(())
    }
}

fn fill_from_bits<V: Value>(bits: impl Iterator<Item = u64>, out: &mut [V]) {
    for (values, word) in out.chunks_exact_mut(64).zip(bits) {
        for (bit, value) in values.iter_mut().enumerate() {
            *value = V::from_bytes(&[(word >> bit & 1) as u8]);
        }
    }
}

fn count_active(leaf: &Leaf) -> usize {
    leaf.mask.iter().map(|word| word.count_ones() as usize).sum()
}
