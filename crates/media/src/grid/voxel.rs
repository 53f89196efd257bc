//! How a voxel is stored: half or single precision.

/// A stored voxel; widening to `f32` is exact.
pub trait Voxel: Copy + Send + Sync + 'static {
    /// What orders voxels as their values do, and is compared by vector units without unpacking.
    type Key: Copy + Default + PartialOrd;
    /// The value.
    fn to_f32(self) -> f32;
    /// The key of a value that is finite and not negative.
    fn key(self) -> Self::Key;
    /// The value of a key.
    fn of_key(key: Self::Key) -> f32;
}

impl Voxel for f32 {
    type Key = f32;
    #[inline(always)]
    fn key(self) -> f32 {
        self
    }
    #[inline(always)]
    fn of_key(key: f32) -> f32 {
        key
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

/// Bits of an IEEE binary16 number that is finite and not negative.
///
/// Widening takes a shift and a multiplication and vectorises on any machine, with no need of
/// conversion instructions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(transparent)]
pub(crate) struct Half(u16);

/// 2^112: the difference of the exponent biases of binary32 and binary16.
const BIAS: f32 = f32::from_bits((112 + 127) << 23);

impl Half {
    /// Zero.
    pub(crate) const ZERO: Half = Half(0);

    /// The half that equals `value` exactly, if there is one and it is finite and not negative.
    #[inline(always)]
    pub(crate) fn exact(value: f32) -> Option<Half> {
        let bits = value.to_bits();
        // Normal halves: exponent -14 to 15 and ten bits of mantissa.
        if (0x3880_0000..0x4780_0000).contains(&bits) {
            return (bits & 0x1fff == 0).then_some(Half(((bits - 0x3800_0000) >> 13) as u16));
        }
        if bits == 0 {
            return Some(Half::ZERO);
        }
        Half::rare(value)
    }

    /// [`Half::exact`] of the smallest halves, and of what none equals.
    #[inline(never)]
    fn rare(value: f32) -> Option<Half> {
        let half = half::f16::from_f32(value);
        let exact = half.to_f32() == value && value.is_finite() && value >= 0.0;
        exact.then(|| Half(half.to_bits() & 0x7fff))
    }
}

impl Voxel for Half {
    /// Bits of numbers that are not negative order as the numbers do, also as signed integers.
    type Key = i16;
    #[inline(always)]
    fn key(self) -> i16 {
        self.0 as i16
    }
    #[inline(always)]
    fn of_key(key: i16) -> f32 {
        Half(key as u16).to_f32()
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 13) * BIAS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_widens_exactly() {
        for bits in 0..0x7c00u16 {
            let value = half::f16::from_bits(bits).to_f32();
            let stored = Half::exact(value).map(Voxel::to_f32);
            assert_eq!(stored, Some(value));
        }
        assert_eq!(Half::exact(0.1), None);
        assert_eq!(Half::exact(-1.0), None);
        assert_eq!(Half::exact(1e9), None);
        assert_eq!(Half::exact(f32::NAN), None);
    }
}
