//! The sum of one channel of one pixel in 16 bytes, without a variance.

use crate::binned::{LAST_WINDOW, MAX_ADDED, joined, lower_step, moved_up, split, window_of};

/// Most values of one sum, 2^31 - 1: each bin then leaves two bits of its 64 for the window.
pub(crate) const MAX_SUMMED: u32 = (1 << 31) - 1;

/// Bytes of one sum, in memory and in a state file.
pub(crate) const SUM_BYTES: usize = 16;

/// Bits of a word that belong to the window.
const WINDOW_BITS: u32 = 2;
const WINDOW_MASK: i64 = (1 << WINDOW_BITS) - 1;

/// A binned sum (see [`crate::binned`]): exact and associative, for up to [`MAX_SUMMED`] values.
///
/// The upper bin is the first word over 4, the lower one the second; what is left of the words are
/// the lower and the upper bits of the window. How many values there are the pixel knows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ChannelSum([i64; 2]);

impl ChannelSum {
    fn window(self) -> u8 {
        ((self.0[0] & WINDOW_MASK) | (self.0[1] & WINDOW_MASK) << WINDOW_BITS) as u8
    }

    fn bins(self) -> [i64; 2] {
        self.0.map(|word| word >> WINDOW_BITS)
    }

    fn new(bins: [i64; 2], window: u8) -> Self {
        let window = i64::from(window);
        Self([
            bins[0] << WINDOW_BITS | window & WINDOW_MASK,
            bins[1] << WINDOW_BITS | window >> WINDOW_BITS,
        ])
    }

    fn raised(self, window: u8) -> Self {
        let own = self.window();
        if own < window { Self::new(moved_up(self.bins(), own, window), window) } else { self }
    }

    /// Adds a finite value.
    #[inline]
    pub(crate) fn add(&mut self, v: f32) {
        let window = window_of(v);
        if window > self.window() {
            *self = self.raised(window);
        }
        let added = split(v, self.window());
        for (word, added) in self.0.iter_mut().zip(added) {
            *word += added << WINDOW_BITS;
        }
    }

    /// Adds the values of another sum; both together must be at most [`MAX_SUMMED`].
    pub(crate) fn merge(&mut self, other: Self) {
        let window = self.window().max(other.window());
        let (own, other) = (self.raised(window).bins(), other.raised(window).bins());
        *self = Self::new([own[0] + other[0], own[1] + other[1]], window);
    }

    /// The mean of `count` values; zero without any.
    pub(crate) fn mean(self, count: u32) -> f64 {
        joined(self.bins()) as f64 * lower_step(self.window()) / f64::from(count.max(1))
    }

    /// The bytes of a state file, little endian.
    pub(crate) fn to_bytes(self) -> [u8; SUM_BYTES] {
        let mut bytes = [0; SUM_BYTES];
        for (part, word) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(self.0) {
            *part = word.to_le_bytes();
        }
        bytes
    }

    /// Reads what [`Self::to_bytes`] wrote; None for what no `count` values add up to.
    pub(crate) fn from_bytes(bytes: &[u8; SUM_BYTES], count: u32) -> Option<Self> {
        let (low, high) = bytes.split_first_chunk().zip(bytes.last_chunk())?;
        let sum = Self([i64::from_le_bytes(*low.0), i64::from_le_bytes(*high)]);
        // With these bounds nothing that is done with a sum can overflow.
        let most = u64::from(count) * MAX_ADDED;
        let sound = count <= MAX_SUMMED
            && sum.window() <= LAST_WINDOW
            && sum.bins().iter().all(|bin| bin.unsigned_abs() <= most);
        sound.then_some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_sum_of_extreme_values_does_not_overflow() {
        for extreme in [f32::MAX, -f32::MAX, 15.999_999, 2f32.powi(-126), f32::from_bits(1)] {
            let mut power = ChannelSum::default();
            power.add(extreme);
            // 1 + 2 + 4 + ... + 2^30 = 2^31 - 1 values.
            let mut all = power;
            for _ in 1..31 {
                power.merge(power);
                all.merge(power);
            }
            assert_eq!(all.mean(MAX_SUMMED), f64::from(extreme));
            assert_eq!(ChannelSum::from_bytes(&all.to_bytes(), MAX_SUMMED), Some(all));
            // Nothing is much larger, so that half as many do not add up to this.
            if extreme.abs() == f32::MAX {
                assert_eq!(ChannelSum::from_bytes(&all.to_bytes(), MAX_SUMMED / 2), None);
            }
        }
    }

    #[test]
    fn every_window_survives_packing() {
        for window in 0..=LAST_WINDOW {
            for bins in [[0, 0], [-1, 1], [1, -1], [1 << 60, -(1 << 60)]] {
                let sum = ChannelSum::new(bins, window);
                assert_eq!((sum.window(), sum.bins()), (window, bins));
            }
        }
        // Windows 9 to 15 are none.
        for window in LAST_WINDOW + 1..16 {
            let bytes = ChannelSum::new([0, 0], window).to_bytes();
            assert_eq!(ChannelSum::from_bytes(&bytes, 1), None);
        }
    }

    #[test]
    fn a_channel_takes_what_is_documented() {
        assert_eq!(size_of::<ChannelSum>(), SUM_BYTES);
    }
}
