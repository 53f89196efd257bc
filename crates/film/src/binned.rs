//! Sums of floats in pairs of integers: any split of the values, in any order, gives the same bits.
//!
//! Floating-point addition is not associative, so a render that is split over threads, machines or
//! sessions would differ from the whole in its last bits. Integers do not have that fault.
//!
//! Every finite 32-bit float is kept, whatever its size. Steps are powers of two, 2^31 apart: step
//! `k` is 2^(31 k - 150), so that nine of them span all floats. A sum has two bins, of two
//! neighbouring steps, that is 62 bits of values at a time; which two, its window, follows from the
//! largest value that it has met. A value is rounded to the upper step, what remains to the lower
//! one, and both integers are added. When a value is too large for the window the window moves up:
//! the upper bin becomes the lower one and the former lower one is forgotten. What the bins hold in
//! the end depends on the set of values alone: any smaller value, rounded to the upper steps, would
//! have been the integer that moved there (zero, two windows up).
//!
//! So each value is rounded once to 2^-31 of the largest of its sum, or finer, up to 2^-62; the
//! values within 2^7 of the largest, with 24 significant bits as they have, are not rounded at all.
//! A bin of 64 bits has room for 2^32 values. This is the binned summation of Demmel and Nguyen
//! ("Parallel Reproducible Summation", 2015) in integers.

/// Binary digits between one step and the next.
pub(crate) const BIN_BITS: i32 = 31;
/// The lowest step is two to this power, half of the smallest float.
pub(crate) const LOWEST_STEP: i32 = -150;
/// The window of the largest finite floats; the first is 0.
pub(crate) const LAST_WINDOW: u8 = 8;
/// Largest magnitude of what one value adds to a bin.
pub(crate) const MAX_ADDED: u64 = 1 << (BIN_BITS - 1);

/// Two to the power of `exponent`, for normal numbers.
pub(crate) const fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((1023 + exponent) as u64) << 52)
}

/// One over the upper step of each window.
pub(crate) const SCALES: [f64; LAST_WINDOW as usize + 1] = {
    let mut scales = [0.0; LAST_WINDOW as usize + 1];
    let mut window = 0;
    while window < scales.len() {
        scales[window] = power_of_two(-(BIN_BITS * window as i32 + LOWEST_STEP));
        window += 1;
    }
    scales
};

/// The lower step of a window: what one of the sum that [`joined`] gives stands for.
pub(crate) fn lower_step(window: u8) -> f64 {
    power_of_two(BIN_BITS * (i32::from(window) - 1) + LOWEST_STEP)
}

/// The lowest window for a finite float: below half the step above the window's two.
#[inline]
pub(crate) fn window_of(v: f32) -> u8 {
    // |v| < 2^(exponent - 126), for denormal numbers (exponent 0) too. It is to be at most
    // 2^(31 (window + 1) - 151).
    let exponent = (v.to_bits() >> 23) & 0xff;
    ((exponent + 24) / 31) as u8
}

/// What a finite value adds to the upper and the lower bin; its window must not be above `window`.
#[inline]
pub(crate) fn split(v: f32, window: u8) -> [i64; 2] {
    // Exact but for the two roundings: a power of two, and differences of few digits.
    let scaled = f64::from(v) * SCALES[usize::from(window)];
    let high = nearest(scaled);
    let low = nearest((scaled - high) * const { power_of_two(BIN_BITS) });
    [high as i64, low as i64]
}

/// Both bins as one integer, in the window's lower step; below 2^94 in magnitude.
pub(crate) fn joined([high, low]: [i64; 2]) -> i128 {
    (i128::from(high) << BIN_BITS) + i128::from(low)
}

/// The bins of a sum whose window moves up from `from` to `to`.
pub(crate) fn moved_up([high, _]: [i64; 2], from: u8, to: u8) -> [i64; 2] {
    [0, if to == from + 1 { high } else { 0 }]
}

/// The nearest integer, ties to even, of a magnitude up to 2^31.
#[inline]
fn nearest(v: f64) -> f64 {
    // Adding 1.5 * 2^52 leaves no binary places; the rounding of the addition is the one wanted.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    (v + SHIFT) - SHIFT
}
