//! Canonical random numbers and exponential variates from any [`rand_core::Rng`].

use crate::elementary::ln;
use rand_core::Rng;

/// A uniform number in [0, 1) with 24 random bits, exactly representable in `f32`.
#[inline(always)]
pub fn uniform<R: Rng + ?Sized>(rng: &mut R) -> f32 {
    (rng.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// An exponentially distributed number of mean one, in [0, 22.9].
///
/// Inversion of 32 random bits: the tail beyond 22.9 (probability 1.2e-10) is folded into the largest value.
#[inline(always)]
pub fn exponential<R: Rng + ?Sized>(rng: &mut R) -> f32 {
    exponential_from(rng.next_u32())
}

/// The exponential variate that belongs to 32 random bits; decreasing in `bits`.
#[inline(always)]
pub fn exponential_from(bits: u32) -> f32 {
    -ln((bits as f32 + 0.5) * (1.0 / 4_294_967_296.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponential_covers_its_ends() {
        assert!(exponential_from(u32::MAX) >= 0.0);
        assert!((exponential_from(0) - 22.87).abs() < 0.01);
    }
}
