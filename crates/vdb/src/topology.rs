//! The nodes of a tree: root, two internal levels, and the masks of the leaves, which the file
//! stores before all voxel values.

use crate::cursor::Cursor;
use crate::error::Fault;
use crate::packed::{Decoder, Encoding, MASK_COMPRESSION, Packed, words};
use crate::tree::{Coord, Leaf, Tile};
use crate::value::Value;

/// A tree without its voxel values; leaves in the order of the file.
pub(crate) struct Topology<V> {
    pub(crate) background: V,
    pub(crate) leaves: Vec<Leaf>,
    pub(crate) tiles: Vec<Tile<V>>,
}

/// Edge of a child of the root in voxels, as a power of two.
const ROOT_CHILD: u32 = 12;

/// An internal level: edges of the node and of its children, as powers of two.
#[derive(Clone, Copy)]
struct Level {
    log2_dim: u32,
    log2_child: u32,
}
const UPPER: Level = Level { log2_dim: 5, log2_child: 7 };
const LOWER: Level = Level { log2_dim: 4, log2_child: 3 };

impl Level {
    /// Number of children.
    fn slots(self) -> usize {
        1 << (3 * self.log2_dim)
    }

    /// Origin of the child in a slot; z runs fastest.
    fn child_origin(self, origin: Coord, slot: usize) -> Coord {
        let edge_mask = (1 << self.log2_dim) - 1;
        let slot = slot as i32;
        let steps = [slot >> (2 * self.log2_dim), slot >> self.log2_dim, slot];
        std::array::from_fn(|axis| {
            origin[axis].wrapping_add((steps[axis] & edge_mask) << self.log2_child)
        })
    }
}

/// Reads everything up to the first leaf buffer.
pub(crate) fn read<V: Value>(
    cursor: &mut Cursor<'_>,
    encoding: &Encoding,
) -> Result<Topology<V>, Fault> {
    let start = cursor.offset();
    let buffers = cursor.i32("the number of buffers")?;
    if buffers != 1 {
        return Err(Fault::unsupported(
            start,
            format!("the tree has {buffers} buffers"),
            "write the grid with OpenVDB 1.0 or newer, which has one",
        ));
    }
    let background = V::from_bytes(cursor.take(V::SIZE, "the background value")?);
    let mut builder = Builder {
        encoding: *encoding,
        topology: Topology { background, leaves: Vec::new(), tiles: Vec::new() },
        decoder: Decoder::new(),
        values: Vec::new(),
    };
    builder.root(cursor)?;
    let mut topology = builder.topology;
    topology.tiles.sort_unstable_by_key(|tile| tile.origin);
    Ok(topology)
}

struct Builder<V> {
    encoding: Encoding,
    topology: Topology<V>,
    decoder: Decoder<V>,
    values: Vec<V>,
}

impl<V: Value> Builder<V> {
    fn root(&mut self, cursor: &mut Cursor<'_>) -> Result<(), Fault> {
        let start = cursor.offset();
        let tiles = cursor.u32("the number of root tiles")?;
        let children = cursor.u32("the number of root children")?;
        cursor.check_count(tiles.into(), (13 + V::SIZE) as u64, "root tiles")?;
        cursor.check_count(children.into(), 12 + 2 * UPPER.slots() as u64 / 8, "root children")?;
        let mut origins = Vec::new();
        for _ in 0..tiles {
            let origin = root_origin(cursor)?;
            let value = V::from_bytes(cursor.take(V::SIZE, "the value of a root tile")?);
            let active = cursor.u8("the state of a root tile")? != 0;
            origins.push(origin);
            self.tile(origin, ROOT_CHILD, value, active);
        }
        for _ in 0..children {
            let origin = root_origin(cursor)?;
            origins.push(origin);
            self.internal(cursor, origin, UPPER)?;
        }
        origins.sort_unstable();
        if let Some(pair) = origins.windows(2).find(|pair| pair[0] == pair[1]) {
            let what = format!("the root has two entries at {:?}", pair[0]);
            return Err(Fault::invalid(start, what));
        }
        Ok(())
    }

    fn tile(&mut self, origin: Coord, log2_size: u32, value: V, active: bool) {
        if active || !value.is_same(self.topology.background) {
            self.topology.tiles.push(Tile { origin, log2_size, value, active });
        }
    }

    fn internal(
        &mut self,
        cursor: &mut Cursor<'_>,
        origin: Coord,
        level: Level,
    ) -> Result<(), Fault> {
        let slots = level.slots();
        let child_mask = cursor.take(slots / 8, "the child mask of a node")?;
        let value_mask = cursor.take(slots / 8, "the value mask of a node")?;
        self.tiles(cursor, origin, level, child_mask, value_mask)?;

        let least = if level.log2_child == LOWER.log2_child { 64 } else { LOWER.slots() / 4 };
        cursor.check_count(count_ones(child_mask) as u64, least as u64, "child nodes")?;
        for (index, mut word) in words(child_mask).enumerate() {
            while word != 0 {
                let slot = 64 * index + word.trailing_zeros() as usize;
                word &= word - 1;
                let child = level.child_origin(origin, slot);
                if level.log2_child == LOWER.log2_child {
                    self.leaf(cursor, child)?;
                } else {
                    self.internal(cursor, child, LOWER)?;
                }
            }
        }
        Ok(())
    }

    /// Reads the values of a node that stand where it has no child.
    fn tiles(
        &mut self,
        cursor: &mut Cursor<'_>,
        origin: Coord,
        level: Level,
        child_mask: &[u8],
        value_mask: &[u8],
    ) -> Result<(), Fault> {
        let slots = level.slots();
        // Older files leave the places of children out.
        let dense = self.encoding.version >= MASK_COMPRESSION;
        let total = if dense { slots } else { slots - count_ones(child_mask) };
        let active = count_ones(value_mask);
        let background = self.topology.background;
        let packed = Packed::read(cursor, &self.encoding, background, total, active)?;
        if packed.is_background() {
            return Ok(());
        }
        let mut values = std::mem::take(&mut self.values);
        values.resize(total, background);
        packed.unpack(&mut self.decoder, words(value_mask), &mut values)?;
        let mut next = values.iter();
        for (index, (children, active)) in words(child_mask).zip(words(value_mask)).enumerate() {
            for bit in 0..64 {
                let is_child = children >> bit & 1 != 0;
                if is_child && !dense {
                    continue;
                }
                let Some(value) = next.next() else { break };
                if !is_child {
                    let tile = level.child_origin(origin, 64 * index + bit);
                    self.tile(tile, level.log2_child, *value, active >> bit & 1 != 0);
                }
            }
        }
        self.values = values;
        Ok(())
    }

    fn leaf(&mut self, cursor: &mut Cursor<'_>, origin: Coord) -> Result<(), Fault> {
        let bytes = cursor.take(64, "the mask of a leaf")?;
        let mut mask = [0; 8];
        mask.iter_mut().zip(words(bytes)).for_each(|(to, from)| *to = from);
        self.topology.leaves.push(Leaf { origin, mask });
        Ok(())
    }
}

fn root_origin(cursor: &mut Cursor<'_>) -> Result<Coord, Fault> {
    let start = cursor.offset();
    let origin = cursor.coord("the origin of a root entry")?;
    if origin.iter().any(|axis| axis & ((1 << ROOT_CHILD) - 1) != 0) {
        let what = format!("the root entry at {origin:?} does not lie on the lattice of 4096");
        return Err(Fault::invalid(start, what));
    }
    Ok(origin)
}

fn count_ones(mask: &[u8]) -> usize {
    words(mask).map(|word| word.count_ones() as usize).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compression::Compression;

    const PLAIN: Encoding = Encoding {
        version: 224,
        compression: Compression { zip: false, blosc: false, active_mask: true },
        half: false,
    };

    fn root(tiles: &[(Coord, i32, bool)], children: &[Coord]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for number in [1, 5, tiles.len() as i32, children.len() as i32] {
            bytes.extend(number.to_le_bytes());
        }
        for (origin, value, active) in tiles {
            bytes.extend(origin.iter().chain([value]).flat_map(|v| v.to_le_bytes()));
            bytes.push(u8::from(*active));
        }
        for origin in children {
            bytes.extend(origin.iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend([0; 2 * 4096]); // no children, nothing active
            bytes.push(0); // all background
        }
        bytes
    }

    fn read_root(bytes: &[u8]) -> Result<Topology<i32>, String> {
        read(&mut Cursor::new(bytes, 0), &PLAIN).map_err(|f| f.into_error("f", None).to_string())
    }

    #[test]
    fn root_tiles_are_sorted_and_background_left_out() {
        let tiles = [([4096, 0, 0], 9, true), ([0, 0, 0], 5, false), ([-4096, 0, 0], 8, false)];
        let topology = read_root(&root(&tiles, &[[0, 4096, 0]])).unwrap();
        assert_eq!(topology.background, 5);
        let origins: Vec<_> = topology.tiles.iter().map(|t| (t.origin, t.log2_size)).collect();
        assert_eq!(origins, [([-4096, 0, 0], 12), ([4096, 0, 0], 12)]);
    }

    #[test]
    fn doubled_and_crooked_entries_are_refused() {
        let twice = root(&[([0, 0, 0], 9, true)], &[[0, 0, 0]]);
        assert!(read_root(&twice).err().unwrap().contains("two entries"));
        let crooked = root(&[([1, 0, 0], 9, true)], &[]);
        assert!(read_root(&crooked).err().unwrap().contains("lattice"));
    }

    #[test]
    fn child_origins_run_z_first() {
        assert_eq!(UPPER.child_origin([4096, 0, -4096], 1), [4096, 0, -3968]);
        assert_eq!(UPPER.child_origin([0, 0, 0], 32 * 32 + 32 + 1), [128, 128, 128]);
        assert_eq!(LOWER.child_origin([0, 0, 0], 4095), [120, 120, 120]);
        let last = i32::MAX - 4095;
        assert_eq!(UPPER.child_origin([last; 3], 32767), [i32::MAX - 127; 3]);
    }
}
