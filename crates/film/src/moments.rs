//! Sums of one pixel in fixed point: any split of its samples, in any order, gives the same bits.
//!
//! Floating-point addition is not associative, so a render that is split over threads, machines or
//! sessions would differ from the whole in its last bits. Integers do not have that fault. Each
//! sample is rounded once, to nearest, to a multiple of a quantum, and from then on everything is
//! exact.
//!
//! | quantity | range of one sample | quantum | accumulator |
//! | --- | --- | --- | --- |
//! | radiance | below 2^30 in magnitude (about 1.07e9) | 2^-64 (5.4e-20) | 128 bit, signed |
//! | its square | below 2^60 | 2^-68 (3.4e-21) | 160 bit |
//! | alpha | at most 16 in magnitude | 2^-27 (7.5e-9) | 64 bit, signed |
//! | its square | at most 256 | 2^-24 (6.0e-8) | 64 bit |
//!
//! With these widths 2^32 - 1 samples at the end of the range cannot overflow. A 32-bit float has
//! 24 significant bits, so radiance from 2^-41 (4.5e-13) upwards is summed without any rounding,
//! and its square (48 bits) from 2^-10.5 (7e-4) upwards; below, a sample errs by at most half a
//! quantum. A pixel takes 128 bytes: 265 MB at 1920 x 1080, 1.06 GB at 3840 x 2160.

/// Radiance of this magnitude or more is not added (2^30).
pub const RADIANCE_LIMIT: f32 = (1u64 << 30) as f32;
/// Alpha beyond this magnitude is not added.
///
/// Alpha lies in `[0, 1]`; estimators of transmittance that are unbiased but not bounded may leave
/// that range, and clamping them would bias the mean.
pub const ALPHA_LIMIT: f32 = 16.0;
/// Step of a summed radiance, 2^-64.
pub const RADIANCE_QUANTUM: f64 = 1.0 / RADIANCE_SCALE;
/// Step of a summed square of radiance, 2^-68.
pub const SQUARE_QUANTUM: f64 = 1.0 / SQUARE_SCALE;
/// Step of a summed alpha, 2^-27.
pub const ALPHA_QUANTUM: f64 = 1.0 / ALPHA_SCALE;

const RADIANCE_SCALE: f64 = (1u128 << 64) as f64;
const SQUARE_SCALE: f64 = (1u128 << 68) as f64;
const ALPHA_SCALE: f64 = (1u64 << 27) as f64;
const ALPHA_SQUARE_SCALE: f64 = (1u64 << 24) as f64;

/// Bytes of one pixel in memory and in a state file.
pub(crate) const PIXEL_BYTES: usize = 128;

/// One estimate of what a pixel sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSample {
    /// Radiance, linear Rec. 709 primaries, W/(m2 sr) or whatever unit the lights use.
    pub rgb: [f32; 3],
    /// One minus the transmittance towards the background, in `[0, 1]` in the mean.
    pub alpha: f32,
}

/// Sums and sums of squares of the samples of one pixel, exact and associative.
///
/// ```
/// use pileus_film::{PixelMoments, PixelSample};
///
/// let samples = [0.1f32, 0.7, 1e-7, 3e5].map(|v| PixelSample { rgb: [v; 3], alpha: 1.0 });
/// let (mut whole, mut left, mut right) = <(PixelMoments, PixelMoments, PixelMoments)>::default();
/// for (i, s) in samples.iter().enumerate() {
///     whole.add(s);
///     if i % 2 == 0 { left.add(s) } else { right.add(s) };
/// }
/// right.merge(&left);
/// assert_eq!(whole, right);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelMoments {
    sum: [i128; 3],
    square_low: [u128; 3],
    square_high: [u32; 3],
    count: u32,
    alpha: i64,
    alpha_square: u64,
}

impl PixelMoments {
    /// Adds one sample; false if it is not finite, out of range or one too many, and left out.
    pub fn add(&mut self, sample: &PixelSample) -> bool {
        // Written so that NaN fails the comparison.
        let in_range = sample.rgb.iter().all(|v| v.abs() < RADIANCE_LIMIT)
            && sample.alpha.abs() <= ALPHA_LIMIT
            && self.count < u32::MAX;
        if !in_range {
            return false;
        }
        // Sums of valid samples cannot wrap (see the table above); those of a doctored state file
        // may, and must not panic.
        for (channel, &v) in sample.rgb.iter().enumerate() {
            let v = f64::from(v);
            let step = (v * RADIANCE_SCALE).round_ties_even() as i128;
            self.sum[channel] = self.sum[channel].wrapping_add(step);
            // The square of a 24-bit significand is exact in 53 bits.
            let square = (v * v * SQUARE_SCALE).round_ties_even() as u128;
            let (low, carry) = self.square_low[channel].overflowing_add(square);
            self.square_low[channel] = low;
            self.square_high[channel] = self.square_high[channel].wrapping_add(u32::from(carry));
        }
        let alpha = f64::from(sample.alpha);
        let step = (alpha * ALPHA_SCALE).round_ties_even() as i64;
        self.alpha = self.alpha.wrapping_add(step);
        let step = (alpha * alpha * ALPHA_SQUARE_SCALE).round_ties_even() as u64;
        self.alpha_square = self.alpha_square.wrapping_add(step);
        self.count += 1;
        true
    }

    /// Adds the samples of another part of the same pixel, exactly.
    ///
    /// False, and nothing is added, if the pixel would exceed 2^32 - 1 samples.
    pub fn merge(&mut self, other: &Self) -> bool {
        let Some(count) = self.count.checked_add(other.count) else {
            return false;
        };
        self.count = count;
        for channel in 0..3 {
            // Wrapping as in `add`.
            self.sum[channel] = self.sum[channel].wrapping_add(other.sum[channel]);
            let (low, carry) = self.square_low[channel].overflowing_add(other.square_low[channel]);
            self.square_low[channel] = low;
            self.square_high[channel] = self.square_high[channel]
                .wrapping_add(other.square_high[channel])
                .wrapping_add(u32::from(carry));
        }
        self.alpha = self.alpha.wrapping_add(other.alpha);
        self.alpha_square = self.alpha_square.wrapping_add(other.alpha_square);
        true
    }

    /// Number of samples in the sums; dropped ones are not among them.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Mean of R, G, B and alpha; zero without samples.
    pub fn mean(&self) -> [f64; 4] {
        if self.count == 0 {
            return [0.0; 4];
        }
        let n = f64::from(self.count);
        let rgb = self.sum.map(|s| s as f64 * RADIANCE_QUANTUM / n);
        [rgb[0], rgb[1], rgb[2], self.alpha as f64 * ALPHA_QUANTUM / n]
    }

    /// Unbiased estimate of the variance of each mean of R, G, B and alpha.
    ///
    /// It is `(n sum(x^2) - sum(x)^2) / (n^2 (n - 1))`, the difference taken in 256-bit integers, so
    /// that no digits cancel. Infinite (unknown) with fewer than two samples. Being measured from
    /// the same samples as the mean, it is correlated with it, and too small where rare bright
    /// samples have not been met yet.
    pub fn variance_of_mean(&self) -> [f64; 4] {
        if self.count < 2 {
            return [f64::INFINITY; 4];
        }
        let n = f64::from(self.count);
        let norm = 1.0 / (n * n * (n - 1.0));
        let mut variance = [0.0; 4];
        for (channel, v) in variance.iter_mut().take(3).enumerate() {
            // Both terms in steps of 2^-128.
            let squares =
                Wide::product_u160(self.square_high[channel], self.square_low[channel], self.count)
                    .shifted_left_60();
            let square_of_sum = Wide::square(self.sum[channel].unsigned_abs());
            *v = squares.saturating_sub(square_of_sum).to_f64()
                * (RADIANCE_QUANTUM * RADIANCE_QUANTUM)
                * norm;
        }
        // Steps of 2^-54; 32 + 64 + 30 bits.
        let squares = (u128::from(self.alpha_square) * u128::from(self.count)) << 30;
        let magnitude = u128::from(self.alpha.unsigned_abs());
        let difference = squares.saturating_sub(magnitude * magnitude);
        variance[3] = difference as f64 * (ALPHA_QUANTUM * ALPHA_QUANTUM) * norm;
        variance
    }

    /// The 128 bytes of a state file, little endian.
    pub(crate) fn to_bytes(self) -> [u8; PIXEL_BYTES] {
        let mut bytes = [0; PIXEL_BYTES];
        let mut rest = bytes.as_mut_slice();
        let mut put = |part: &[u8]| {
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(part.len());
            head.copy_from_slice(part);
            rest = tail;
        };
        self.sum.iter().for_each(|v| put(&v.to_le_bytes()));
        self.square_low.iter().for_each(|v| put(&v.to_le_bytes()));
        self.square_high.iter().for_each(|v| put(&v.to_le_bytes()));
        put(&self.count.to_le_bytes());
        put(&self.alpha.to_le_bytes());
        put(&self.alpha_square.to_le_bytes());
        bytes
    }

    /// Reads what [`Self::to_bytes`] wrote.
    pub(crate) fn from_bytes(bytes: &[u8; PIXEL_BYTES]) -> Self {
        fn part<const N: usize>(bytes: &[u8; PIXEL_BYTES], at: usize) -> [u8; N] {
            std::array::from_fn(|i| bytes[at + i])
        }
        Self {
            sum: std::array::from_fn(|c| i128::from_le_bytes(part(bytes, 16 * c))),
            square_low: std::array::from_fn(|c| u128::from_le_bytes(part(bytes, 48 + 16 * c))),
            square_high: std::array::from_fn(|c| u32::from_le_bytes(part(bytes, 96 + 4 * c))),
            count: u32::from_le_bytes(part(bytes, 108)),
            alpha: i64::from_le_bytes(part(bytes, 112)),
            alpha_square: u64::from_le_bytes(part(bytes, 120)),
        }
    }
}

/// An unsigned 256-bit integer, as far as the variance needs one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Wide {
    high: u128,
    low: u128,
}

impl Wide {
    /// `(high 2^128 + low) n`, at most 192 bits.
    fn product_u160(high: u32, low: u128, n: u32) -> Self {
        let n = u128::from(n);
        let mask = u128::from(u64::MAX);
        let bottom = (low & mask) * n;
        let middle = (low >> 64) * n + (bottom >> 64);
        Self { high: u128::from(high) * n + (middle >> 64), low: (middle << 64) | (bottom & mask) }
    }

    /// `v^2`.
    fn square(v: u128) -> Self {
        let mask = u128::from(u64::MAX);
        let (a, b) = (v >> 64, v & mask);
        let (cross, bottom) = (a * b, b * b);
        let (low, carry) = bottom.overflowing_add(cross << 65);
        // a * a + (2 cross) / 2^64 + carry is the high half of a product: it fits.
        Self { high: a * a + (cross >> 63) + u128::from(carry), low }
    }

    /// `self 2^60`; bits beyond 256 are lost, which 192-bit values do not have.
    fn shifted_left_60(self) -> Self {
        Self { high: (self.high << 60) | (self.low >> 68), low: self.low << 60 }
    }

    /// `max(self - other, 0)`; rounding of tiny samples can leave the difference below zero.
    fn saturating_sub(self, other: Self) -> Self {
        let (low, borrow) = self.low.overflowing_sub(other.low);
        match self.high.checked_sub(other.high).and_then(|h| h.checked_sub(u128::from(borrow))) {
            Some(high) => Self { high, low },
            None => Self { high: 0, low: 0 },
        }
    }

    fn to_f64(self) -> f64 {
        self.high as f64 * 2f64.powi(128) + self.low as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wide_arithmetic() {
        let max = u128::MAX;
        assert_eq!(Wide::square(max), Wide { high: max - 1, low: 1 });
        assert_eq!(Wide::square(1 << 64), Wide { high: 1, low: 0 });
        let product = Wide::product_u160(u32::MAX, max, u32::MAX);
        // (2^160 - 1)(2^32 - 1) = 2^192 - 2^160 - 2^32 + 1
        assert_eq!(product.high, (1 << 64) - (1 << 32) - 1);
        assert_eq!(product.low, max - (1 << 32) + 2);
        let shifted = Wide { high: 1, low: 3 << 126 }.shifted_left_60();
        assert_eq!(shifted, Wide { high: (1 << 60) | (3 << 58), low: 0 });
        let (one, top) = (Wide { high: 0, low: 1 }, Wide { high: 1, low: 0 });
        assert_eq!(top.saturating_sub(one), Wide { high: 0, low: max });
        assert_eq!(one.saturating_sub(top), Wide { high: 0, low: 0 });
        assert_eq!(Wide { high: 3, low: 0 }.saturating_sub(one), Wide { high: 2, low: max });
    }

    #[test]
    fn a_full_pixel_of_extreme_samples_does_not_overflow() {
        let extreme = RADIANCE_LIMIT.next_down();
        let mut power = PixelMoments::default();
        assert!(power.add(&PixelSample { rgb: [extreme, -extreme, extreme], alpha: -16.0 }));
        // 1 + 2 + 4 + ... + 2^31 = 2^32 - 1 samples.
        let mut all = power;
        for _ in 1..32 {
            let copy = power;
            assert!(power.merge(&copy));
            assert!(all.merge(&power));
        }
        assert_eq!(all.count(), u32::MAX);
        let e = f64::from(extreme);
        assert_eq!(all.mean(), [e, -e, e, -16.0]);
        assert_eq!(all.variance_of_mean(), [0.0; 4]);
        assert!(!all.add(&PixelSample::default()) && !all.merge(&power));
        assert_eq!(all.mean(), [e, -e, e, -16.0]);
    }

    #[test]
    fn samples_out_of_range_are_left_out() {
        let mut moments = PixelMoments::default();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, RADIANCE_LIMIT, -RADIANCE_LIMIT] {
            assert!(!moments.add(&PixelSample { rgb: [0.0, bad, 0.0], alpha: 0.0 }));
        }
        for bad in [f32::NAN, f32::INFINITY, 16.5, -16.5] {
            assert!(!moments.add(&PixelSample { rgb: [0.0; 3], alpha: bad }));
        }
        assert_eq!(moments, PixelMoments::default());
        assert!(moments.variance_of_mean().iter().all(|v| *v == f64::INFINITY));
    }

    #[test]
    fn no_digits_cancel_in_the_variance() {
        // 2^20 and 2^20 + 1/8 in turn: variance 2^-8, 2^48 times smaller than the square.
        let mut moments = PixelMoments::default();
        let n = 1000;
        for i in 0..n {
            let v = 1048576.0 + if i % 2 == 0 { 0.0 } else { 0.125 };
            assert!(moments.add(&PixelSample { rgb: [v; 3], alpha: (i % 2) as f32 }));
        }
        let expected = 0.0625f64.powi(2) / f64::from(n - 1);
        let variance = moments.variance_of_mean();
        for v in &variance[..3] {
            assert!((v / expected - 1.0).abs() < 1e-14, "{v} {expected}");
        }
        assert!((variance[3] / (0.25 / f64::from(n - 1)) - 1.0).abs() < 1e-14);
        assert_eq!(moments.mean()[0], 1048576.0625);
    }

    #[test]
    fn doctored_sums_do_not_panic() {
        for byte in [0x7f, 0x80, 0xff] {
            let mut doctored = PixelMoments::from_bytes(&[byte; PIXEL_BYTES]);
            for count in [0, 1, 2, u32::MAX - 1] {
                doctored.count = count;
                for sign in [1.0, -1.0] {
                    let sample = PixelSample { rgb: [sign * 1e9; 3], alpha: sign * 16.0 };
                    let mut copy = doctored;
                    copy.add(&sample);
                }
                let mut copy = doctored;
                copy.merge(&doctored);
                let _ = (doctored.mean(), doctored.variance_of_mean());
            }
        }
    }

    #[test]
    fn sizes_are_as_documented() {
        assert_eq!(size_of::<PixelMoments>(), PIXEL_BYTES);
        assert_eq!(RADIANCE_QUANTUM, 2f64.powi(-64));
        assert_eq!(SQUARE_QUANTUM, 2f64.powi(-68));
        assert_eq!(ALPHA_QUANTUM, 2f64.powi(-27));
        // Every bit of a pixel has its place in the bytes.
        let bytes: [u8; PIXEL_BYTES] = std::array::from_fn(|i| i as u8 ^ 0xa5);
        assert_eq!(PixelMoments::from_bytes(&bytes).to_bytes(), bytes);
    }
}
