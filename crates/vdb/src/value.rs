//! Types a voxel can have, and how their bytes are read.

use half::f16;
use half::slice::HalfFloatSliceExt;

/// A voxel's type as the file stores it (little endian).
pub(crate) trait Value: Copy + PartialEq + Default + Send + Sync + 'static {
    /// Bytes of one value.
    const SIZE: usize;
    /// Bytes of one value in a grid that was saved as half, for types of which OpenVDB narrows the
    /// buffers.
    const HALF_SIZE: Option<usize>;
    /// One value; missing bytes count as zero.
    fn from_bytes(bytes: &[u8]) -> Self;
    /// As many values as both sides hold.
    fn decode(bytes: &[u8], out: &mut [Self]);
    /// As many values as both sides hold, from half floats; `scratch` is free to use.
    fn decode_half(bytes: &[u8], out: &mut [Self], scratch: &mut HalfScratch);
    /// What OpenVDB calls the negative: sign change (wrapping), or the opposite of a truth value.
    fn negative(self) -> Self;
    /// Equal as numbers or, for NaN, in their bits.
    fn is_same(self, other: Self) -> bool;
}

/// Buffers for widening half floats.
#[derive(Default)]
pub(crate) struct HalfScratch {
    halves: Vec<f16>,
    floats: Vec<f32>,
}

impl HalfScratch {
    fn widen_into(&mut self, bytes: &[u8], out: &mut [f32]) {
        let count = out.len().min(bytes.len() / 2);
        self.halves.resize(count, f16::ZERO);
        for (half, bytes) in self.halves.iter_mut().zip(bytes.as_chunks::<2>().0) {
            *half = f16::from_le_bytes(*bytes);
        }
        if let Some(out) = out.get_mut(..count) {
            self.halves.convert_to_f32_slice(out);
        }
    }

    fn widen(&mut self, bytes: &[u8]) -> &[f32] {
        let mut floats = std::mem::take(&mut self.floats);
        floats.clear();
        floats.resize(bytes.len() / 2, 0.0);
        self.widen_into(bytes, &mut floats);
        self.floats = floats;
        &self.floats
    }
}

fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    out.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
    out
}

fn decode_each<T: Value>(bytes: &[u8], out: &mut [T]) {
    for (value, chunk) in out.iter_mut().zip(bytes.chunks_exact(T::SIZE)) {
        *value = T::from_bytes(chunk);
    }
}

impl Value for f32 {
    const SIZE: usize = 4;
    const HALF_SIZE: Option<usize> = Some(2);
    #[inline]
    fn from_bytes(bytes: &[u8]) -> f32 {
        f32::from_le_bytes(array(bytes))
    }
    fn decode(bytes: &[u8], out: &mut [f32]) {
        for (value, b) in out.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *value = f32::from_le_bytes(*b);
        }
    }
    fn decode_half(bytes: &[u8], out: &mut [f32], scratch: &mut HalfScratch) {
        scratch.widen_into(bytes, out);
    }
    fn negative(self) -> f32 {
        -self
    }
    fn is_same(self, other: f32) -> bool {
        self == other || self.to_bits() == other.to_bits()
    }
}

impl Value for f64 {
    const SIZE: usize = 8;
    const HALF_SIZE: Option<usize> = Some(2);
    fn from_bytes(bytes: &[u8]) -> f64 {
        f64::from_le_bytes(array(bytes))
    }
    fn decode(bytes: &[u8], out: &mut [f64]) {
        decode_each(bytes, out);
    }
    fn decode_half(bytes: &[u8], out: &mut [f64], scratch: &mut HalfScratch) {
        for (value, wide) in out.iter_mut().zip(scratch.widen(bytes)) {
            *value = f64::from(*wide);
        }
    }
    fn negative(self) -> f64 {
        -self
    }
    fn is_same(self, other: f64) -> bool {
        self == other || self.to_bits() == other.to_bits()
    }
}

/// Values of the half grids of file version 225: two bytes everywhere, also for background and
/// tiles.
impl Value for f16 {
    const SIZE: usize = 2;
    const HALF_SIZE: Option<usize> = None;
    fn from_bytes(bytes: &[u8]) -> f16 {
        f16::from_le_bytes(array(bytes))
    }
    fn decode(bytes: &[u8], out: &mut [f16]) {
        decode_each(bytes, out);
    }
    fn decode_half(bytes: &[u8], out: &mut [f16], _: &mut HalfScratch) {
        Self::decode(bytes, out);
    }
    fn negative(self) -> f16 {
        -self
    }
    fn is_same(self, other: f16) -> bool {
        self == other || self.to_bits() == other.to_bits()
    }
}

macro_rules! integer {
    ($type:ty) => {
        impl Value for $type {
            const SIZE: usize = size_of::<$type>();
            const HALF_SIZE: Option<usize> = None;
            fn from_bytes(bytes: &[u8]) -> $type {
                <$type>::from_le_bytes(array(bytes))
            }
            fn decode(bytes: &[u8], out: &mut [$type]) {
                decode_each(bytes, out);
            }
            fn decode_half(bytes: &[u8], out: &mut [$type], _: &mut HalfScratch) {
                Self::decode(bytes, out);
            }
            fn negative(self) -> $type {
                self.wrapping_neg()
            }
            fn is_same(self, other: $type) -> bool {
                self == other
            }
        }
    };
}
integer!(i32);
integer!(i64);

impl Value for bool {
    const SIZE: usize = 1;
    const HALF_SIZE: Option<usize> = None;
    fn from_bytes(bytes: &[u8]) -> bool {
        bytes.first().is_some_and(|byte| *byte != 0)
    }
    fn decode(bytes: &[u8], out: &mut [bool]) {
        decode_each(bytes, out);
    }
    fn decode_half(bytes: &[u8], out: &mut [bool], _: &mut HalfScratch) {
        Self::decode(bytes, out);
    }
    fn negative(self) -> bool {
        !self
    }
    fn is_same(self, other: bool) -> bool {
        self == other
    }
}

macro_rules! triple {
    ($type:ty, $half:expr, $widen:expr) => {
        impl Value for [$type; 3] {
            const SIZE: usize = 3 * size_of::<$type>();
            const HALF_SIZE: Option<usize> = $half;
            fn from_bytes(bytes: &[u8]) -> [$type; 3] {
                let mut out = [<$type>::default(); 3];
                for (value, chunk) in out.iter_mut().zip(bytes.chunks(size_of::<$type>())) {
                    *value = <$type>::from_bytes(chunk);
                }
                out
            }
            fn decode(bytes: &[u8], out: &mut [[$type; 3]]) {
                decode_each(bytes, out);
            }
            fn decode_half(bytes: &[u8], out: &mut [[$type; 3]], scratch: &mut HalfScratch) {
                let wide: Option<fn(f32) -> $type> = $widen;
                let Some(wide) = wide else { return Self::decode(bytes, out) };
                for (value, chunk) in out.iter_mut().zip(scratch.widen(bytes).chunks_exact(3)) {
                    *value = [wide(chunk[0]), wide(chunk[1]), wide(chunk[2])];
                }
            }
            fn negative(self) -> [$type; 3] {
                self.map(|value| value.negative())
            }
            fn is_same(self, other: [$type; 3]) -> bool {
                self.into_iter().zip(other).all(|(a, b)| a.is_same(b))
            }
        }
    };
}
triple!(f32, Some(6), Some(|value| value));
triple!(f64, Some(6), Some(f64::from));
triple!(i32, None, None);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_widen_exactly() {
        let bytes: Vec<u8> = [0.5f32, -2.0, 65504.0, f32::INFINITY, 1e-7, 3.0]
            .iter()
            .flat_map(|x| f16::from_f32(*x).to_le_bytes())
            .collect();
        let mut floats = [0.0f32; 6];
        f32::decode_half(&bytes, &mut floats, &mut HalfScratch::default());
        assert_eq!(floats[..4], [0.5, -2.0, 65504.0, f32::INFINITY]);
        assert_eq!(floats[4], f16::from_f32(1e-7).to_f32());
        let mut triples = [[0.0f64; 3]; 2];
        <[f64; 3]>::decode_half(&bytes, &mut triples, &mut HalfScratch::default());
        assert_eq!(triples[0], [0.5, -2.0, 65504.0]);
        let mut doubles = [7.0f64; 8];
        f64::decode_half(&bytes, &mut doubles, &mut HalfScratch::default());
        assert_eq!(doubles[5..], [3.0, 7.0, 7.0]);
    }

    #[test]
    fn plain_values_decode() {
        let bytes: Vec<u8> = (0u8..24).collect();
        let mut triples = [[0i32; 3]; 2];
        <[i32; 3]>::decode(&bytes, &mut triples);
        assert_eq!(triples[0][0], 0x0302_0100);
        assert_eq!(triples[1][2], 0x1716_1514);
        let mut ints = [0i64; 3];
        i64::decode(&bytes, &mut ints);
        assert_eq!(ints[1], i64::from_le_bytes([8, 9, 10, 11, 12, 13, 14, 15]));
        let mut flags = [true; 2];
        bool::decode(&bytes, &mut flags);
        assert_eq!(flags, [false, true]);
    }

    #[test]
    fn negatives_and_sameness() {
        assert_eq!(i32::MIN.negative(), i32::MIN);
        assert!(true.is_same(false.negative()));
        assert!(f32::NAN.is_same(f32::NAN));
        assert!(0.0f32.is_same(-0.0));
        assert_eq!([1.0f32, -2.0, 0.5].negative(), [-1.0, 2.0, -0.5]);
    }
}
