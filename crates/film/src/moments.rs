//! Sums of one pixel in integers: any split of its samples, in any order, gives the same bits.
//!
//! Each channel has a binned sum of its own, see [`crate::binned`]; each sample is rounded once to
//! 2^-31 of the largest of its pixel and channel, or finer.
//!
//! Variances come from replicates. A pixel's samples are stratified, and the spread of single
//! samples then says how far a mean of independent samples would be off, up to seven times more
//! than theirs is. So sums are kept per replicate, see [`REPLICATES`].
//!
//! A pixel takes 552 bytes (548 in a state file): 1.14 GB at 1920 x 1080.

use crate::binned::{
    LAST_WINDOW, MAX_ADDED, joined, lower_step, moved_up, power_of_two, split, window_of,
};

/// Replicates of a pixel: sample number `s` belongs to replicate `s` modulo 8.
///
/// The samples of one replicate may depend on each other in any way that makes their mean better
/// than that of independent ones; those of different replicates must be independent.
pub const REPLICATES: usize = 8;

/// Most samples of one replicate: 2^32 - 8 in a pixel.
const MAX_SAMPLES_OF_REPLICATE: u32 = (1 << 29) - 1;
/// Bytes of one pixel in a state file.
pub(crate) const PIXEL_BYTES: usize = 2 * 8 * 4 * REPLICATES + 4 * REPLICATES + 4;

/// One estimate of what a pixel sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSample {
    /// Radiance, linear Rec. 709 primaries, W/(m2 sr) or whatever unit the lights use.
    pub rgb: [f32; 3],
    /// One minus the transmittance towards the background, in `[0, 1]` in the mean.
    pub alpha: f32,
}

impl PixelSample {
    /// A sample of which radiance and alpha alone are known.
    pub const fn new(rgb: [f32; 3], alpha: f32) -> Self {
        Self { rgb, alpha }
    }
}

/// A float within 2^-52 of an integer, relatively. Not by the operator, which is a call.
#[inline]
fn to_f64(v: i128) -> f64 {
    const TWO_64: f64 = power_of_two(64);
    let size = v.unsigned_abs();
    let size = (size >> 64) as u64 as f64 * TWO_64 + size as u64 as f64;
    if v < 0 { -size } else { size }
}

/// Sums of the samples of one pixel, per replicate, exact and associative.
///
/// ```
/// use pileus_film::{PixelMoments, PixelSample};
///
/// let samples = [0.1f32, 0.7, 1e-7, 3e35].map(|v| PixelSample::new([v; 3], 1.0));
/// let (mut whole, mut left, mut right) = <(PixelMoments, PixelMoments, PixelMoments)>::default();
/// for (number, s) in (0..).zip(&samples) {
///     whole.add(number, s);
///     if number % 2 == 0 { left.add(number, s) } else { right.add(number, s) };
/// }
/// right.merge(&left);
/// assert_eq!(whole, right);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelMoments {
    /// Per replicate, then R, G, B and alpha: sums in the upper steps.
    high: [[i64; 4]; REPLICATES],
    /// What remains, in the lower steps.
    low: [[i64; 4]; REPLICATES],
    count: [u32; REPLICATES],
    window: [u8; 4],
}

impl PixelMoments {
    /// Adds the sample of a number; false if a value is not finite, or if it is one too many for
    /// its replicate (2^29 - 1), and left out.
    ///
    /// The number tells the replicate alone: that no sample is added twice is for the caller to
    /// know.
    #[inline]
    pub fn add(&mut self, number: u64, sample: &PixelSample) -> bool {
        let [r, g, b] = sample.rgb;
        let values = [r, g, b, sample.alpha];
        let replicate = (number % REPLICATES as u64) as usize;
        let count = &mut self.count[replicate];
        if !values.iter().all(|v| v.is_finite()) || *count >= MAX_SAMPLES_OF_REPLICATE {
            return false;
        }
        *count += 1;
        for (channel, &v) in values.iter().enumerate() {
            let window = window_of(v);
            if window > self.window[channel] {
                self.raise(channel, window);
            }
            let [high, low] = split(v, self.window[channel]);
            self.high[replicate][channel] += high;
            self.low[replicate][channel] += low;
        }
        true
    }

    /// Moves the window of a channel up.
    #[cold]
    fn raise(&mut self, channel: usize, window: u8) {
        let own = self.window[channel];
        for (high, low) in self.high.iter_mut().zip(&mut self.low) {
            [high[channel], low[channel]] = moved_up([high[channel], low[channel]], own, window);
        }
        self.window[channel] = window;
    }

    /// Whether [`Self::merge`] has room for the samples of `other`.
    pub(crate) fn has_room_for(&self, other: &Self) -> bool {
        self.count.iter().zip(&other.count).all(|(a, b)| a + b <= MAX_SAMPLES_OF_REPLICATE)
    }

    /// Adds the samples of another part of the same pixel, exactly.
    ///
    /// False, and nothing is added, if a replicate would exceed 2^29 - 1 samples.
    pub fn merge(&mut self, other: &Self) -> bool {
        if !self.has_room_for(other) {
            return false;
        }
        let mut other = *other;
        for channel in 0..4 {
            let window = self.window[channel].max(other.window[channel]);
            for part in [&mut *self, &mut other] {
                if part.window[channel] < window {
                    part.raise(channel, window);
                }
            }
        }
        for replicate in 0..REPLICATES {
            self.count[replicate] += other.count[replicate];
            for channel in 0..4 {
                self.high[replicate][channel] += other.high[replicate][channel];
                self.low[replicate][channel] += other.low[replicate][channel];
            }
        }
        true
    }

    /// Number of samples in the sums; dropped ones are not among them.
    pub fn count(&self) -> u32 {
        self.count.iter().sum()
    }

    /// The sum of a channel over one replicate in its lower step, below 2^91 in magnitude.
    fn sum(&self, replicate: usize, channel: usize) -> i128 {
        joined([self.high[replicate][channel], self.low[replicate][channel]])
    }

    /// Mean of R, G, B and alpha; zero without samples.
    pub fn mean(&self) -> [f64; 4] {
        std::array::from_fn(|channel| self.mean_of(channel))
    }

    /// Means of R, G, B and alpha over the even and over the odd replicates; NaN for those without
    /// samples.
    pub(crate) fn halves(&self) -> [[f64; 4]; 2] {
        [0, 1].map(|half| {
            let replicates = || (half..REPLICATES).step_by(2);
            let count: u32 = replicates().map(|r| self.count[r]).sum();
            std::array::from_fn(|channel| {
                let sum: i128 = replicates().map(|r| self.sum(r, channel)).sum();
                to_f64(sum) * lower_step(self.window[channel]) / f64::from(count)
            })
        })
    }

    /// Mean of one channel of R, G, B and alpha.
    pub(crate) fn mean_of(&self, channel: usize) -> f64 {
        let n = f64::from(self.count().max(1));
        // Below 2^62: see `MAX_SAMPLES_OF_REPLICATE` and `MAX_ADDED`.
        let over = |bins: &[[i64; 4]; REPLICATES]| -> i64 { bins.iter().map(|r| r[channel]).sum() };
        let sum = joined([over(&self.high), over(&self.low)]);
        to_f64(sum) * lower_step(self.window[channel]) / n
    }

    /// Estimate of the variance of each mean of R, G, B and alpha, from the spread of the
    /// replicates' means.
    ///
    /// With replicates of `n_r` samples and means `m_r`, `R` of them with samples, and the mean `m`
    /// of all `n`, it is `sum(n_r (m_r - m)^2) / (n (R - 1))`. It is unbiased where the replicates
    /// are independent and have equally many samples, 16 in all at least, however the samples
    /// within each are stratified; with 7 degrees of freedom the estimate of one pixel is off by
    /// half of itself, sums over many pixels are sharper. Where some replicates have a sample more
    /// it is too large by a fraction that falls with the square of their number, since more
    /// samples are better stratified: below 16 samples take it as an upper bound, of `n - 1`
    /// degrees of freedom at most. Infinite (unknown) where fewer than two replicates have
    /// samples. Being measured from the same samples as the mean, it is correlated with it, and
    /// too small where rare bright samples have not been met yet.
    ///
    /// No digits cancel: all differences are taken in integers.
    pub fn variance_of_mean(&self) -> [f64; 4] {
        let filled = self.count.iter().filter(|count| **count > 0).count();
        if filled < 2 {
            return [f64::INFINITY; 4];
        }
        let n = self.count();
        let each = self.count[0];
        let even = self.count == [each; REPLICATES];
        let norm = 1.0 / (f64::from(n) * (filled - 1) as f64);
        std::array::from_fn(|channel| {
            let step = lower_step(self.window[channel]);
            let sums: [i128; REPLICATES] = std::array::from_fn(|r| self.sum(r, channel));
            let sum: i128 = sums.iter().sum();
            if even {
                // R n_r (m_r - m) in lower steps: what most pixels have, without divisions.
                let squares = sums.map(|own| {
                    let off = to_f64(REPLICATES as i128 * own - sum) * step;
                    off * off
                });
                let spread: f64 = squares.iter().sum();
                return spread * norm / (f64::from(n) * REPLICATES as f64);
            }
            let mut spread = 0.0;
            for (own, count) in sums.into_iter().zip(self.count).filter(|(_, count)| *count > 0) {
                // n n_r (m_r - m) in lower steps, below 2^124.
                let off = own * i128::from(n) - sum * i128::from(count);
                let off = to_f64(off) * step / f64::from(n);
                spread += off * off / f64::from(count);
            }
            spread * norm
        })
    }

    /// The bytes of a state file, little endian.
    pub(crate) fn to_bytes(self) -> [u8; PIXEL_BYTES] {
        let mut bytes = [0; PIXEL_BYTES];
        let mut rest = bytes.as_mut_slice();
        let mut put = |part: &[u8]| {
            let (head, tail) = std::mem::take(&mut rest).split_at_mut(part.len());
            head.copy_from_slice(part);
            rest = tail;
        };
        self.high.iter().flatten().for_each(|v| put(&v.to_le_bytes()));
        self.low.iter().flatten().for_each(|v| put(&v.to_le_bytes()));
        self.count.iter().for_each(|v| put(&v.to_le_bytes()));
        put(&self.window);
        bytes
    }

    /// Reads what [`Self::to_bytes`] wrote; None for what no samples add up to.
    pub(crate) fn from_bytes(bytes: &[u8; PIXEL_BYTES]) -> Option<Self> {
        fn part<const N: usize>(bytes: &[u8; PIXEL_BYTES], at: usize) -> [u8; N] {
            std::array::from_fn(|i| bytes[at + i])
        }
        let sums = |at: usize| -> [[i64; 4]; REPLICATES] {
            std::array::from_fn(|r| {
                std::array::from_fn(|c| i64::from_le_bytes(part(bytes, at + 32 * r + 8 * c)))
            })
        };
        let pixel = Self {
            high: sums(0),
            low: sums(32 * REPLICATES),
            count: std::array::from_fn(|r| {
                u32::from_le_bytes(part(bytes, 64 * REPLICATES + 4 * r))
            }),
            window: part(bytes, 68 * REPLICATES),
        };
        // With these bounds nothing that is done with a pixel can overflow.
        let sound = pixel.window.iter().all(|window| *window <= LAST_WINDOW)
            && (0..REPLICATES).all(|r| {
                let most = u64::from(pixel.count[r]) * MAX_ADDED;
                let mut sums = pixel.high[r].iter().chain(&pixel.low[r]);
                pixel.count[r] <= MAX_SAMPLES_OF_REPLICATE
                    && sums.all(|sum| sum.unsigned_abs() <= most)
            });
        sound.then_some(pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::binned::{BIN_BITS, LOWEST_STEP, SCALES};

    fn grey(v: f32) -> PixelSample {
        PixelSample::new([v, -v, v], v)
    }

    #[test]
    fn windows_hold_what_they_are_for() {
        for window in 0..=LAST_WINDOW {
            // From here on a sample belongs to the window above.
            let end = BIN_BITS * (i32::from(window) + 1) + LOWEST_STEP - 1;
            let end = if end < -126 { 2f64.powi(end) as f32 } else { power_of_two(end) as f32 };
            let last = if window == LAST_WINDOW { f32::MAX } else { end.next_down() };
            assert_eq!(window_of(last), window, "{last:e}");
            assert!(f64::from(last) * SCALES[usize::from(window)] <= MAX_ADDED as f64);
            if window < LAST_WINDOW {
                assert!(window_of(end) == window + 1 || end < 2f32.powi(-126), "{end:e}");
            }
        }
        assert_eq!(window_of(0.0), 0);
        assert_eq!(window_of(f32::from_bits(1)), 0);
    }

    #[test]
    fn a_full_pixel_of_extreme_samples_does_not_overflow() {
        for extreme in [f32::MAX, 15.999_999, 2f32.powi(-126), f32::from_bits(1)] {
            let mut power = PixelMoments::default();
            for number in 0..8 {
                assert!(power.add(number, &grey(extreme)));
            }
            // 1 + 2 + 4 + ... + 2^28 = 2^29 - 1 samples in each replicate.
            let mut all = power;
            for _ in 1..29 {
                let copy = power;
                assert!(power.merge(&copy));
                assert!(all.merge(&power));
            }
            assert_eq!(all.count(), u32::MAX - 7);
            let e = f64::from(extreme);
            assert_eq!(all.mean(), [e, -e, e, e]);
            assert_eq!(all.variance_of_mean(), [0.0; 4]);
            let before = all;
            assert!(!all.add(5, &PixelSample::default()) && !all.merge(&power));
            assert_eq!(all, before);
            assert_eq!(PixelMoments::from_bytes(&all.to_bytes()), Some(all));
        }
    }

    #[test]
    fn only_what_is_not_finite_is_left_out() {
        let mut moments = PixelMoments::default();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!moments.add(0, &PixelSample::new([0.0, bad, 0.0], 0.0)));
            assert!(!moments.add(1, &PixelSample::new([0.0; 3], bad)));
        }
        assert_eq!(moments, PixelMoments::default());
        assert!(moments.variance_of_mean().iter().all(|v| *v == f64::INFINITY));
        for good in [f32::MAX, f32::MIN, 1.5e9, 17.0, -1e-30, f32::from_bits(1)] {
            let mut one = PixelMoments::default();
            assert!(one.add(3, &grey(good)));
            let v = f64::from(good);
            assert_eq!(one.mean(), [v, -v, v, v]);
        }
    }

    #[test]
    fn no_digits_cancel_in_the_variance() {
        // 2^20 in even replicates and 2^20 + 1/8 in odd ones.
        let mut moments = PixelMoments::default();
        let n = 1000;
        for i in 0..n {
            let v = 1048576.0 + if i % 2 == 0 { 0.0 } else { 0.125 };
            assert!(moments.add(i, &PixelSample::new([v; 3], (i % 2) as f32)));
        }
        let variance = moments.variance_of_mean();
        for v in &variance[..3] {
            assert!((v / (0.0625f64.powi(2) / 7.0) - 1.0).abs() < 1e-14, "{v}");
        }
        assert!((variance[3] / (0.25 / 7.0) - 1.0).abs() < 1e-14);
        assert_eq!(moments.mean()[0], 1048576.0625);
    }

    #[test]
    fn up_to_eight_samples_the_variance_is_the_textbooks() {
        let values = [0.25f32, 1.0, -3.0, 7.5, 0.0, 0.125, 2.0, 11.0];
        for n in 2..=8 {
            let mut moments = PixelMoments::default();
            for (i, v) in (0..).zip(&values[..n]) {
                moments.add(i, &grey(*v));
            }
            let count = n as f64;
            let mean = values[..n].iter().map(|v| f64::from(*v)).sum::<f64>() / count;
            let squares: f64 = values[..n].iter().map(|v| (f64::from(*v) - mean).powi(2)).sum();
            let expected = squares / (count * (count - 1.0));
            assert!((moments.variance_of_mean()[3] / expected - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn doctored_sums_are_refused() {
        for byte in [0x7f, 0x80, 0xff] {
            assert_eq!(PixelMoments::from_bytes(&[byte; PIXEL_BYTES]), None);
        }
        let mut moments = PixelMoments::default();
        moments.add(3, &grey(f32::MAX));
        let bytes = moments.to_bytes();
        assert_eq!(PixelMoments::from_bytes(&bytes), Some(moments));
        // The top byte of each integer, and the windows.
        for at in (7..64 * REPLICATES).step_by(8).chain(PIXEL_BYTES - 4..PIXEL_BYTES) {
            let mut broken = bytes;
            broken[at] ^= 0x40;
            assert_eq!(PixelMoments::from_bytes(&broken), None, "byte {at}");
        }
    }

    #[test]
    fn sizes_are_as_documented() {
        assert_eq!(size_of::<PixelMoments>(), 552);
        assert_eq!(PIXEL_BYTES, 548);
    }
}
