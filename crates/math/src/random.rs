//! Canonical random numbers, decisions and exponential variates from any [`rand_core::Rng`].
//!
//! A canonical number is a multiple of 2^-24: taken at its word, whatever is less likely than that
//! would still happen so often, or never. Decisions and variates therefore treat it as the step
//! that the true number lies in, and draw the place within the step where that matters, once in
//! 2^24 times.

use crate::elementary::{ln, minus_ln_of_share};
use glam::{BVec3, Vec3};
use rand_core::Rng;

/// Distance of neighbouring canonical numbers.
const STEP: f32 = 1.0 / 16_777_216.0;
/// Distance of neighbouring stratified numbers.
const STRATIFIED_STEP: f32 = 2.0 * STEP;

/// A uniform number in [0, 1) with 24 random bits, exactly representable in `f32`.
#[inline(always)]
pub fn uniform<R: Rng + ?Sized>(rng: &mut R) -> f32 {
    (rng.next_u32() >> 8) as f32 * STEP
}

/// A uniform number in (0, 1) in double precision, of full relative precision however small it is.
fn within_step<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    let mut unit = 1.0 / 4_294_967_296.0;
    loop {
        let bits = rng.next_u32();
        if bits != 0 {
            return (f64::from(bits) + f64::from(rng.next_u32()) / 4_294_967_296.0) * unit;
        }
        unit /= 4_294_967_296.0;
    }
}

/// Whether an event of probability `probability` happens: exact for all probabilities of single
/// precision. Below zero and NaN count as zero.
#[inline(always)]
pub fn happens<R: Rng + ?Sized>(probability: f32, rng: &mut R) -> bool {
    Decision::new(rng).is_below(probability, rng)
}

/// Whether an event of probability `part / whole` happens, exact for all numbers of single
/// precision of which the second is positive. Below zero and NaN count as zero.
#[inline(always)]
pub fn happens_of<R: Rng + ?Sized>(part: f32, whole: f32, rng: &mut R) -> bool {
    let u = uniform(rng);
    // Most decisions end here, or at the next line.
    if !(u * whole < part) {
        return false;
    }
    (u + STEP) * whole <= part || happens_within_step(u, f64::from(part) / f64::from(whole), rng)
}

#[cold]
#[inline(never)]
fn happens_within_step<R: Rng + ?Sized>(u: f32, probability: f64, rng: &mut R) -> bool {
    // Exact: probabilities of few bits less a multiple of 2^-24.
    within_step(rng) < (probability - f64::from(u)) / f64::from(STEP)
}

/// One uniform number that may be compared with several probabilities: the events of smaller ones
/// are part of those of larger ones.
#[derive(Debug, Clone, Copy)]
pub struct Decision {
    /// The step's lower end.
    u: f32,
    /// Its width.
    step: f32,
    /// The place within the step, from 0 to 1; NaN until it is needed.
    rest: f64,
}

impl Decision {
    /// Draws a number.
    #[inline(always)]
    pub fn new<R: Rng + ?Sized>(rng: &mut R) -> Decision {
        Decision { u: uniform(rng), step: STEP, rest: f64::NAN }
    }

    /// The number that a stratified one stands for, a multiple of 2^-23 in [0, 1).
    #[inline(always)]
    pub fn of_stratified(u: f32) -> Decision {
        Decision { u, step: STRATIFIED_STEP, rest: f64::NAN }
    }

    /// Whether the number lies below `probability`.
    #[inline(always)]
    pub fn is_below<R: Rng + ?Sized>(&mut self, probability: f32, rng: &mut R) -> bool {
        if !(self.u < probability) {
            return false;
        }
        self.u + self.step <= probability || self.is_below_within_step(f64::from(probability), rng)
    }

    /// Whether the number lies below each of three probabilities.
    #[inline(always)]
    pub fn is_below_each<R: Rng + ?Sized>(&mut self, probability: Vec3, rng: &mut R) -> BVec3 {
        let below = Vec3::splat(self.u).cmplt(probability);
        if !below.any() || below == Vec3::splat(self.u + self.step).cmple(probability) {
            return below;
        }
        let [x, y, z] = probability.to_array();
        BVec3::new(self.is_below(x, rng), self.is_below(y, rng), self.is_below(z, rng))
    }

    /// Whether the number lies below a probability in double precision, such as a sum of two.
    #[inline]
    pub fn is_below_exactly<R: Rng + ?Sized>(&mut self, probability: f64, rng: &mut R) -> bool {
        if !(f64::from(self.u) < probability) {
            return false;
        }
        f64::from(self.u + self.step) <= probability || self.is_below_within_step(probability, rng)
    }

    #[cold]
    #[inline(never)]
    fn is_below_within_step<R: Rng + ?Sized>(&mut self, probability: f64, rng: &mut R) -> bool {
        if self.rest.is_nan() {
            self.rest = within_step(rng);
        }
        self.rest < (probability - f64::from(self.u)) / f64::from(self.step)
    }
}

/// Largest ratio whose complement [`complement`] does not leave to rounding.
const TINY: f32 = 1.0 / 65_536.0;

/// `1 - ratio`, without bias where the ratio is lost to rounding: ratios below 2^-16 count as 2^-16
/// as often as their share of it says.
///
/// Products of many complements, as a ray collects that crosses a very dense cell, would else
/// forget all that is thin in it.
#[inline(always)]
pub fn complement<R: Rng + ?Sized>(ratio: f32, rng: &mut R) -> f32 {
    if ratio < TINY && ratio > 0.0 { complement_of_tiny(ratio, rng) } else { 1.0 - ratio }
}

#[cold]
#[inline(never)]
fn complement_of_tiny<R: Rng + ?Sized>(ratio: f32, rng: &mut R) -> f32 {
    if happens_of(ratio, TINY, rng) { 1.0 - TINY } else { 1.0 }
}

/// Random bits from which on a variate lies so near zero that rounding would show.
const NEAR_ZERO: u32 = u32::MAX - (1 << 20) + 1;
/// Random bits below which it lies so far out.
const FAR_OUT: u32 = 1 << 8;

/// An exponentially distributed number of mean one; exact also for what is as rare as single
/// precision can say, near zero and far out.
#[inline(always)]
pub fn exponential<R: Rng + ?Sized>(rng: &mut R) -> f32 {
    let bits = rng.next_u32();
    // One comparison for both ends.
    if bits.wrapping_sub(FAR_OUT) < NEAR_ZERO - FAR_OUT {
        minus_ln_of_share(bits)
    } else {
        exponential_at_an_end(bits, 1.0, rng)
    }
}

/// The exponential variate of a stratified number, a multiple of 2^-23 in [0, 1): as exact.
#[inline]
pub fn exponential_of_stratified<R: Rng + ?Sized>(u: f32, rng: &mut R) -> f32 {
    let bits = (u * 4_294_967_296.0) as u32;
    if bits.wrapping_sub(FAR_OUT) < NEAR_ZERO - FAR_OUT {
        exponential_from(bits)
    } else {
        exponential_at_an_end(bits, 512.0, rng)
    }
}

/// The exponential variate that belongs to 32 random bits, within [0, 22.9]; decreasing in `bits`.
#[inline(always)]
pub fn exponential_from(bits: u32) -> f32 {
    -ln((bits as f32 + 0.5) * (1.0 / 4_294_967_296.0))
}

/// The variate of a number between `bits` and `bits + width`, over 2^32.
#[cold]
#[inline(never)]
fn exponential_at_an_end<R: Rng + ?Sized>(bits: u32, width: f64, rng: &mut R) -> f32 {
    const ALL: f64 = 4_294_967_296.0;
    let rest = within_step(rng) * width;
    if bits >= NEAR_ZERO {
        // -ln(1 - w), w below 2^-12: what is left of the series is below rounding. The place is
        // counted from one down.
        let w = (ALL - f64::from(bits) - width + rest) / ALL;
        return (w * (1.0 + w * (0.5 + w / 3.0))) as f32;
    }
    let scaled = (f64::from(bits) + rest) as f32;
    32.0 * std::f32::consts::LN_2 - ln(scaled.max(f32::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Infallible, TryRng};
    use rand_pcg::Pcg32;

    /// Begins with one given number, then draws.
    struct Beginning(Option<u32>, Pcg32);

    impl TryRng for Beginning {
        type Error = Infallible;
        fn try_next_u32(&mut self) -> Result<u32, Infallible> {
            Ok(self.0.take().unwrap_or_else(|| self.1.next_u32()))
        }
        fn try_next_u64(&mut self) -> Result<u64, Infallible> {
            Ok(self.1.next_u64())
        }
        fn try_fill_bytes(&mut self, bytes: &mut [u8]) -> Result<(), Infallible> {
            self.1.fill_bytes(bytes);
            Ok(())
        }
    }

    /// How often a decision falls, given the number that the generator begins with.
    fn share(first: u32, n: u32, mut decide: impl FnMut(&mut Beginning) -> bool) -> f64 {
        let mut rng = Beginning(None, Pcg32::new(7, u64::from(first)));
        let hits = (0..n)
            .filter(|_| {
                rng.0 = Some(first);
                decide(&mut rng)
            })
            .count();
        hits as f64 / f64::from(n)
    }

    /// Given that a canonical number falls on step `k`, a decision of probability `p` is made with
    /// `p 2^24 - k`, in [0, 1]: what all steps together make of it is `p`, whatever it is. H0: the
    /// share of 40000 decisions is that; |z| below 5.5, 40 shares: false alarm 2e-6. A share off by
    /// 1.4 % is seen; before, every one of them was 1.
    #[test]
    fn decisions_of_any_probability_are_exact() {
        let step = f64::from(STEP);
        for (k, p) in [
            (0u32, 0.3 * STEP),
            (0, 0.05 * STEP),
            (1, 1.5 * STEP),
            (2, 2.25 * STEP),
            (7, 7.75 * STEP),
            (40_000, 40_000.5 * STEP),
            (0, 1e-12),
            (0, 1e-30),
            (3, 3.0 * STEP),
            (16_777_214, 1.0 - STEP),
        ] {
            let expected = ((f64::from(p) - f64::from(k) * step) / step).clamp(0.0, 1.0);
            let n = 40_000;
            let allowed = 5.5 * (expected * (1.0 - expected) / f64::from(n)).sqrt() + 2e-4;
            let first = k << 8 | 0x5a;
            let found = [
                share(first, n, |rng| happens(p, rng)),
                share(first, n, |rng| happens_of(p * 2048.0, 2048.0, rng)),
                share(first, n, |rng| Decision::new(rng).is_below_exactly(f64::from(p), rng)),
                share(first, n, |rng| Decision::new(rng).is_below_each(Vec3::splat(p), rng).y),
            ];
            for found in found {
                assert!((found - expected).abs() <= allowed, "{k} {p:e}: {found} {expected}");
            }
        }
        // Events of one number are nested, and certain ones are certain.
        let mut rng = Pcg32::new(3, 3);
        for _ in 0..100_000 {
            let mut u = Decision { u: 0.0, step: STEP, rest: f64::NAN };
            let few = u.is_below(0.2 * STEP, &mut rng);
            assert!(!few || u.is_below(0.6 * STEP, &mut rng));
            assert!(happens(1.0, &mut rng) && happens_of(2.0, 2.0, &mut rng));
            assert!(!happens(0.0, &mut rng) && !happens(f32::NAN, &mut rng));
        }
    }

    /// The survival `e^-x` of variates, near zero and far out, where the bits are at an end. H0:
    /// shares below a depth, given the first bits, are what the law says; z as above. Before, a
    /// variate was 0 with the probability 2^-25, never between 0 and 6e-8, and never above 22.9.
    #[test]
    fn exponential_is_exact_at_both_ends() {
        let n = 40_000u32;
        let all = 4_294_967_296.0;
        let check = |first: u32, width: f64, x: f64, stratified: bool| {
            // Given bits, numbers lie between these; below depth x lie those above e^-x.
            let (low, high) = (f64::from(first) / all, (f64::from(first) + width) / all);
            let expected = if x < 1e-3 {
                (((high - 1.0) - (-x).exp_m1()) / (high - low)).clamp(0.0, 1.0)
            } else {
                ((high - (-x).exp()) / (high - low)).clamp(0.0, 1.0)
            };
            let found = share(first, n, |rng| {
                let drawn = if stratified {
                    rng.0 = None;
                    exponential_of_stratified((low) as f32, rng)
                } else {
                    exponential(rng)
                };
                f64::from(drawn) < x
            });
            let allowed = 5.5 * (expected * (1.0 - expected) / f64::from(n)).sqrt() + 2e-4;
            assert!((found - expected).abs() <= allowed, "{first} {x:e}: {found} {expected}");
        };
        for x in [1e-13, 1e-10, 1.9e-10, 2.3e-10] {
            check(u32::MAX, 1.0, x, false);
        }
        for x in [1e-9, 1.6e-8, 5e-8, 1.1e-7] {
            check(u32::MAX - 511, 512.0, x, true);
        }
        for x in [22.3, 23.0, 25.0, 30.0] {
            check(0, 1.0, x, false);
        }
        for x in [16.0, 17.0, 20.0, 25.0] {
            check(0, 512.0, x, true);
        }
        assert!(exponential_from(u32::MAX) >= 0.0);
        assert!((exponential_from(FAR_OUT) - 16.63).abs() < 0.01);
    }

    /// H0: complements of tiny ratios have the right mean over a million; before they were all 1.
    /// Seen: 1 % of the ratio.
    #[test]
    fn complements_of_tiny_ratios_are_not_lost() {
        let mut rng = Pcg32::new(5, 5);
        let ratio = 1e-6f32;
        let n = 1_000_000;
        let sum: f64 = (0..n).map(|_| 1.0 - f64::from(complement(ratio, &mut rng))).sum();
        let expected = f64::from(n) * f64::from(ratio);
        let deviation = (expected * f64::from(TINY)).sqrt();
        assert!((sum - expected).abs() < 5.5 * deviation, "{sum} {expected} {deviation}");
        assert_eq!(complement(0.0, &mut rng), 1.0);
        assert_eq!(complement(0.25, &mut rng), 0.75);
    }
}
