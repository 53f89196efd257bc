//! The values of one node as they lie in the file: a code for the inactive ones, then one block.

use crate::compression::{Block, Compression, Unpacker};
use crate::cursor::Cursor;
use crate::error::Fault;
use crate::value::{HalfScratch, Value};

/// What of the file and the grid decides how node values are stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Encoding {
    /// Version of the file format.
    pub(crate) version: u32,
    pub(crate) compression: Compression,
    /// Whether the grid was saved as half.
    pub(crate) half: bool,
}

/// Since this version a node says how its inactive values are made up.
pub(crate) const MASK_COMPRESSION: u32 = 222;

/// Which inactive values a node has, as OpenVDB numbers it.
mod code {
    /// All are the background.
    pub(super) const BACKGROUND: u8 = 0;
    /// All are one value that is stored.
    pub(super) const ONE: u8 = 2;
    /// The background or its negative (1 is: all are the negative), by a stored mask.
    pub(super) const MASK: u8 = 3;
    /// The background or a stored value, by a stored mask.
    pub(super) const MASK_ONE: u8 = 4;
    /// One of two stored values, by a stored mask.
    pub(super) const MASK_TWO: u8 = 5;
    /// They are stored like the active ones.
    pub(super) const ALL: u8 = 6;
}

/// Values of a node, found but not unpacked yet.
pub(crate) struct Packed<'a, V> {
    /// Inactive values where the selection is off and on.
    inactive: [V; 2],
    selection: Option<&'a [u8]>,
    /// Number of values in the block: all, or the active ones.
    stored: usize,
    /// Bytes per value in the block.
    size: usize,
    half: bool,
    block: Block<'a>,
    plain: bool,
}

impl<'a, V: Value> Packed<'a, V> {
    /// Finds the values of a node with `total` values, `active` of them active, and steps over
    /// them.
    #[inline]
    pub(crate) fn read(
        cursor: &mut Cursor<'a>,
        encoding: &Encoding,
        background: V,
        total: usize,
        active: usize,
    ) -> Result<Packed<'a, V>, Fault> {
        let start = cursor.offset();
        let code = if encoding.version >= MASK_COMPRESSION {
            cursor.u8("the code of inactive values")?
        } else {
            code::ALL
        };
        if code > code::ALL {
            let what = format!("{code} is no code of inactive values");
            return Err(Fault::invalid(start, what));
        }
        let mut inactive = [background; 2];
        if code != code::BACKGROUND {
            inactive[0] = background.negative();
        }
        if matches!(code, code::ONE | code::MASK_ONE | code::MASK_TWO) {
            inactive[0] = V::from_bytes(cursor.take(V::SIZE, "an inactive value")?);
        }
        if code == code::MASK_TWO {
            inactive[1] = V::from_bytes(cursor.take(V::SIZE, "an inactive value")?);
        }
        let selection = match code {
            code::MASK | code::MASK_ONE | code::MASK_TWO => {
                Some(cursor.take(total / 8, "the mask of inactive values")?)
            }
            _ => None,
        };
        let all = code == code::ALL || !encoding.compression.active_mask;
        let stored = if all { total } else { active };
        let (half, size) = match V::HALF_SIZE.filter(|_| encoding.half) {
            Some(size) => (true, size),
            None => (false, V::SIZE),
        };
        // OpenVDB writes nothing at all, not even a length, when it has no value to narrow to half.
        let block = if half && stored == 0 {
            Block::Plain(&[])
        } else {
            Block::read(cursor, encoding.compression, stored.saturating_mul(size))?
        };
        let plain = code == code::BACKGROUND && stored == 0;
        Ok(Packed { inactive, selection, stored, size, half, block, plain })
    }

    /// Whether all values are inactive and the background.
    pub(crate) fn is_background(&self) -> bool {
        self.plain
    }

    /// Unpacks into `out`, which has as many values as the node. `mask` is its active mask, 64 bits
    /// a word.
    pub(crate) fn unpack(
        &self,
        decoder: &mut Decoder<V>,
        mask: impl Iterator<Item = u64>,
        out: &mut [V],
    ) -> Result<(), Fault> {
        let bytes = decoder.unpacker.unpack(self.block, self.stored.saturating_mul(self.size))?;
        let mut decode = |to: &mut [V]| {
            if self.half {
                V::decode_half(bytes, to, &mut decoder.half);
            } else {
                V::decode(bytes, to);
            }
        };
        if self.stored == out.len() {
            decode(out);
            return Ok(());
        }
        decoder.active.resize(self.stored, V::default());
        decode(&mut decoder.active);
        self.scatter(&decoder.active, mask, out);
        Ok(())
    }

    /// Puts the active values where the mask is on, and inactive ones elsewhere.
    fn scatter(&self, mut active: &[V], mask: impl Iterator<Item = u64>, out: &mut [V]) {
        let mut selection = self.selection.unwrap_or(&[]).as_chunks::<8>().0.iter();
        for (values, word) in out.as_chunks_mut::<64>().0.iter_mut().zip(mask) {
            let selected = selection.next().map_or(0, |bytes| u64::from_le_bytes(*bytes));
            if word == u64::MAX {
                if let Some((head, rest)) = active.split_first_chunk::<64>() {
                    *values = *head;
                    active = rest;
                }
                continue;
            }
            *values = [self.inactive[0]; 64];
            if selected != 0 {
                for (bit, value) in values.iter_mut().enumerate() {
                    if selected >> bit & 1 != 0 {
                        *value = self.inactive[1];
                    }
                }
            }
            let mut left = word;
            let count = left.count_ones() as usize;
            let (head, rest) = active.split_at(count.min(active.len()));
            for value in head {
                values[(left.trailing_zeros() & 63) as usize] = *value;
                left &= left.wrapping_sub(1);
            }
            active = rest;
        }
    }
}

/// Buffers for unpacking nodes, kept between them.
pub(crate) struct Decoder<V> {
    unpacker: Unpacker,
    half: HalfScratch,
    active: Vec<V>,
}

impl<V: Value> Decoder<V> {
    pub(crate) fn new() -> Decoder<V> {
        Decoder { unpacker: Unpacker::new(), half: HalfScratch::default(), active: Vec::new() }
    }
}

/// The words of a mask that lies in the file.
pub(crate) fn words(mask: &[u8]) -> impl Iterator<Item = u64> {
    mask.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MASKED: Encoding = Encoding {
        version: 224,
        compression: Compression { zip: false, blosc: false, active_mask: true },
        half: false,
    };

    /// 64 values of which bit 0 and 2 are active (100 and 102), selection on bit 1.
    fn node(code: u8, read: &[i32], selection: bool) -> Vec<i32> {
        let mut bytes = vec![code];
        bytes.extend(read.iter().flat_map(|v| v.to_le_bytes()));
        if selection {
            bytes.extend(2u64.to_le_bytes());
        }
        let stored: Vec<i32> = if code == 6 { (100..164).collect() } else { vec![100, 102] };
        bytes.extend(stored.iter().flat_map(|v| v.to_le_bytes()));
        let mut cursor = Cursor::new(&bytes, 0);
        let packed = Packed::<i32>::read(&mut cursor, &MASKED, 7, 64, 2).unwrap();
        assert_eq!(cursor.remaining(), 0);
        let mut out = vec![0; 64];
        packed.unpack(&mut Decoder::new(), [5].into_iter(), &mut out).unwrap();
        out
    }

    #[test]
    fn every_encoding_of_inactive_values() {
        assert_eq!(node(0, &[], false)[..4], [100, 7, 102, 7]);
        assert_eq!(node(1, &[], false)[..4], [100, -7, 102, -7]);
        assert_eq!(node(2, &[9], false)[..4], [100, 9, 102, 9]);
        assert_eq!(node(3, &[], true)[..4], [100, 7, 102, -7]);
        assert_eq!(node(4, &[9], true)[..4], [100, 7, 102, 9]);
        assert_eq!(node(5, &[9, 8], true)[..4], [100, 8, 102, 9]);
        assert_eq!(node(6, &[], false)[..4], [100, 101, 102, 103]);
    }

    #[test]
    fn unknown_codes_are_refused() {
        let fault = Packed::<i32>::read(&mut Cursor::new(&[7; 99], 50), &MASKED, 0, 64, 2);
        let text = fault.err().unwrap().into_error("f", None).to_string();
        assert!(text.contains("byte 50") && text.contains("7 is no code"));
    }

    #[test]
    fn an_empty_half_block_has_no_length() {
        let mut encoding = MASKED;
        encoding.half = true;
        encoding.compression.blosc = true;
        let mut cursor = Cursor::new(&[0, 1, 2], 0);
        let packed = Packed::<f32>::read(&mut cursor, &encoding, 0.0, 64, 0).unwrap();
        assert_eq!(cursor.remaining(), 2);
        assert!(packed.is_background());
    }
}
