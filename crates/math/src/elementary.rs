//! Elementary functions that give the same bits on every machine, which those of system libraries
//! do not promise.

/// Natural logarithm of a positive normal number, relative error below 2e-7.
///
/// The same bits on every machine, which a system library does not promise. With `x = m 2^e`, `m`
/// in [sqrt(1/2), sqrt(2)], and `s = (m - 1) / (m + 1)`: `ln m = 2 artanh s`, a series in
/// `s^2 <= 0.0295`.
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

/// `-ln(bits / 2^32)` of a positive number of bits: as [`ln`], with the division in the exponent.
#[inline(always)]
pub(crate) fn minus_ln_of_share(bits: u32) -> f32 {
    let bits = (bits as f32).to_bits().wrapping_sub(0x4f35_04f3);
    let e = (bits as i32) >> 23;
    let m = f32::from_bits((bits & 0x007f_ffff) + 0x3f35_04f3);
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = s + s * z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    e as f32 * -std::f32::consts::LN_2 - 2.0 * series
}

/// `e^x`, relative error below 2e-7; zero below -87.3, infinite above 88.7.
///
/// The same bits on every machine: `x = k ln 2 + r`, `|r| <= ln(2) / 2`, and seven terms of the
/// series in `r`.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    // Negated so that NaN passes through.
    if x < -87.3 {
        return 0.0;
    }
    if x > 88.7 {
        return f32::INFINITY;
    }
    let k = (x * std::f32::consts::LOG2_E).round_ties_even();
    // ln 2 in two parts: the first has few bits, so that its product with k is exact.
    let r = (x - k * 0.693_359_4) + k * 2.121_944_4e-4;
    let series = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0
                    + r * (1.0 / 24.0
                        + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0)))))));
    // In two steps, since 2^128 is no number and 2^-127 no normal one.
    let half = (k as i32) >> 1;
    let power = |e: i32| f32::from_bits(((127 + e) as u32) << 23);
    series * power(half) * power(k as i32 - half)
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
    fn logarithms_of_shares_are_those_of_numbers() {
        for i in 1..500_000u32 {
            let bits = i.wrapping_mul(2_654_435_769).max(256);
            let share = bits as f32 * (1.0 / 4_294_967_296.0);
            assert_eq!(minus_ln_of_share(bits), -ln(share), "{bits}");
        }
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
    fn exp_is_accurate_over_its_range() {
        let mut worst = 0.0f64;
        for i in 0..=2_000_000 {
            let x = -87.0 + 175.5 * i as f32 / 2_000_000.0;
            let exact = f64::from(x).exp();
            worst = worst.max((f64::from(exp(x)) - exact).abs() / exact);
        }
        assert!(worst < 2e-7, "worst relative error {worst:e}");
        assert_eq!(exp(0.0), 1.0);
        assert_eq!(exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(exp(f32::INFINITY), f32::INFINITY);
        assert!(exp(f32::NAN).is_nan());
    }
}
