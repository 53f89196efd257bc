//! Random numbers of one path: Owen-scrambled Sobol points for its first decisions, a
//! counter-seeded generator for the rest.
//!
//! Sample number `s` of a pixel belongs to replicate `s` modulo [`REPLICATES`]; each replicate has
//! a sequence of its own, scrambled independently of the others. So the spread of the replicates'
//! means tells the variance of stratified samples.

use pileus_film::REPLICATES;
use rand_core::{Infallible, Rng, TryRng};
use rand_pcg::Pcg32;

/// Samples of a replicate after which its Sobol sequence starts anew with another scrambling (the
/// length of `sobol_burley`'s points), as a power of two.
const SEQUENCE_BITS: u32 = 16;

/// The set of stratified numbers for the point of a lens that the camera's ray passes. Sets 0 to 2
/// belong to the film and the first flight, and to the first scattering.
pub(crate) const LENS: u32 = 3;

/// The random numbers of one sample of one pixel: a function of (seed, pixel, sample) alone.
#[derive(Debug, Clone)]
pub struct PathSampler {
    index: u32,
    sobol_seed: u32,
    rng: Pcg32,
}

/// Stafford's finaliser "variant 13" of MurmurHash3: every input bit changes every output bit.
fn mix(mut x: u64) -> u64 {
    x ^= x >> 30;
    x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x ^= x >> 27;
    x = x.wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

impl PathSampler {
    /// The numbers of sample `sample` of the pixel at (`x`, `y`) of the full image.
    pub fn new(seed: u64, x: u32, y: u32, sample: u64) -> PathSampler {
        let pixel = mix(mix(seed ^ 0x9e37_79b9_7f4a_7c15) ^ (u64::from(x) << 32 | u64::from(y)));
        let (replicate, number) = (sample % REPLICATES as u64, sample / REPLICATES as u64);
        let sequence = (number >> SEQUENCE_BITS) * REPLICATES as u64 + replicate;
        let sequence = mix(pixel ^ sequence.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let state = mix(pixel.wrapping_add(sample.wrapping_mul(0xd134_2543_de82_ef95)));
        PathSampler {
            index: (number & ((1 << SEQUENCE_BITS) - 1)) as u32,
            sobol_seed: sequence as u32,
            rng: Pcg32::new(state, pixel),
        }
    }

    /// Four numbers in [0, 1), stratified over the samples of the replicate; `set` below 64 selects
    /// independent dimensions.
    #[inline]
    pub fn stratified(&self, set: u32) -> [f32; 4] {
        sobol_burley::sample_4d(self.index, set, self.sobol_seed)
    }
}

impl TryRng for PathSampler {
    type Error = Infallible;

    #[inline(always)]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok(self.rng.next_u32())
    }

    #[inline(always)]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.rng.next_u64())
    }

    fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
        self.rng.fill_bytes(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_and_repeat() {
        let first = |x, y, s| PathSampler::new(1, x, y, s).next_u32();
        assert_eq!(first(3, 4, 5), first(3, 4, 5));
        let mut seen: Vec<u32> =
            (0..1000).map(|i| first(i % 10, i / 100, u64::from(i / 10 % 10))).collect();
        seen.sort_unstable();
        seen.dedup();
        assert!(seen.len() >= 999);
    }

    #[test]
    fn stratified_numbers_fill_strata() {
        for replicate in 0..REPLICATES as u64 {
            for set in 0..=LENS {
                let mut bins = [0u32; 64];
                for i in 0..64 {
                    let sampler = PathSampler::new(9, 1, 2, REPLICATES as u64 * i + replicate);
                    bins[(sampler.stratified(set)[2] * 64.0) as usize] += 1;
                }
                assert_eq!(bins, [1; 64]);
            }
        }
    }

    /// Null hypothesis: the first numbers of replicates are independent and uniform. The
    /// correlation of two over 4096 pixels has a standard deviation of 1/64; the largest of 28
    /// pairs times four dimensions is beyond six of them with probability 2e-7. Replicates that
    /// share a scrambling have 1.
    #[test]
    fn replicates_are_independent() {
        let first = |pixel: u32, replicate: u64| {
            let numbers = PathSampler::new(5, pixel % 64, pixel / 64, replicate).stratified(0);
            numbers.map(|u| (f64::from(u) - 0.5) * 12f64.sqrt())
        };
        for (a, b) in (0..8).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let mut sums = [0.0; 4];
            for pixel in 0..4096 {
                let (u, v) = (first(pixel, a), first(pixel, b));
                (0..4).for_each(|k| sums[k] += u[k] * v[k]);
            }
            assert!(sums.iter().all(|sum| (sum / 64.0).abs() < 6.0), "{a} {b} {sums:?}");
        }
    }
}
