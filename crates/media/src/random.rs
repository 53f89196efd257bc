//! Canonical random numbers and exponential variates from any [`rand_core::Rng`].

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

/// Natural logarithm of a positive normal number, relative error below 2e-7.
///
/// The same bits on every machine, which a system library does not promise. With `x = m 2^e`, `m` in
/// [sqrt(1/2), sqrt(2)], and `s = (m - 1) / (m + 1)`: `ln m = 2 artanh s`, a series in `s^2 <= 0.0295`.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    let bits = x.to_bits();
    // Shifts the mantissa so that the exponent rounds to nearest: m below sqrt(2).
    let e = (bits.wrapping_sub(0x3f35_04f3) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((e as u32) << 23));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = s + s * z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    e as f32 * std::f32::consts::LN_2 + 2.0 * series
}

/// Sine and cosine of `2 pi u` for `u` in [0, 1], absolute error below 3e-7.
///
/// The same bits on every machine: reduces to an eighth of a turn and sums the Taylor series there.
#[inline(always)]
pub fn sin_cos_turn(u: f32) -> (f32, f32) {
    // Quarter turns to the nearest, then an angle in [-pi/4, pi/4].
    let quarter = (u * 4.0 + 0.5) as u32;
    let x = (u * 4.0 - quarter as f32) * std::f32::consts::FRAC_PI_2;
    let z = x * x;
    let sin = x + x * z * (-1.0 / 6.0 + z * (1.0 / 120.0 + z * (-1.0 / 5040.0 + z / 362_880.0)));
    let cos = 1.0 + z * (-0.5 + z * (1.0 / 24.0 + z * (-1.0 / 720.0 + z / 40320.0)));
    match quarter & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ln_is_accurate_over_its_range() {
        let mut worst = 0.0f64;
        for i in 0..2_000_000u32 {
            let x = f32::from_bits(0x2e80_0000 + i * 140); // 2^-34 .. about 2
            let exact = f64::from(x).ln();
            let error = (f64::from(ln(x)) - exact).abs() / exact.abs().max(1e-3);
            worst = worst.max(error);
        }
        assert!(worst < 2e-7, "worst relative error {worst:e}");
    }

    #[test]
    fn sin_cos_is_accurate() {
        let mut worst = 0.0f64;
        for i in 0..=1_000_000u32 {
            let u = i as f32 / 1_000_000.0;
            let (s, c) = sin_cos_turn(u);
            let (es, ec) = (f64::from(u) * std::f64::consts::TAU).sin_cos();
            worst = worst.max((f64::from(s) - es).abs()).max((f64::from(c) - ec).abs());
        }
        assert!(worst < 3e-7, "worst absolute error {worst:e}");
    }

    #[test]
    fn exponential_covers_its_ends() {
        assert!(exponential_from(u32::MAX) >= 0.0);
        assert!((exponential_from(0) - 22.87).abs() < 0.01);
    }
}
