//! Sine and cosine from basic arithmetic alone.
//!
//! The functions of the system's library differ in their last bits between systems, and even
//! between processors under one library; where a sample lands must not depend on that.

/// (sin, cos) of `t` full turns, `t` in `[-4, 4]`; absolute error below 1e-15.
#[inline]
pub(crate) fn sin_cos_turns(t: f64) -> (f64, f64) {
    // |x| <= pi / 4, where the Taylor series to x^15 and x^16 err by less than 5e-17.
    let quarter = (4.0 * t).round();
    let x = std::f64::consts::TAU * (t - 0.25 * quarter);
    let x2 = x * x;
    let series = |coefficients: &[f64; 8]| coefficients.iter().fold(0.0, |sum, c| sum * x2 + c);
    let (sin, cos) = (x * series(&SIN), 1.0 + x2 * series(&COS));
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Coefficients of x^15, x^13, ..., x.
const SIN: [f64; 8] = taylor(15);
/// Coefficients of x^16, x^14, ..., x^2.
const COS: [f64; 8] = taylor(16);

/// `(-1)^(k / 2) / k!` for eight orders `k` from `highest` down in steps of two.
const fn taylor(highest: usize) -> [f64; 8] {
    let mut coefficients = [0.0; 8];
    let mut i = 0;
    while i < 8 {
        let order = highest - 2 * i;
        let mut factorial = 1.0; // exact to 18!
        let mut k = 2;
        while k <= order {
            factorial *= k as f64;
            k += 1;
        }
        let sign = if (order / 2).is_multiple_of(2) { 1.0 } else { -1.0 };
        coefficients[i] = sign / factorial;
        i += 1;
    }
    coefficients
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_library() {
        for i in -4000..=4000 {
            let t = f64::from(i) / 1000.0;
            let (sin, cos) = sin_cos_turns(t);
            let (s, c) = (std::f64::consts::TAU * t).sin_cos();
            assert!((sin - s).abs() < 1e-14 && (cos - c).abs() < 1e-14, "{t}: {sin} {cos}");
        }
        assert_eq!(sin_cos_turns(0.25), (1.0, 0.0));
        assert_eq!(sin_cos_turns(0.5), (0.0, -1.0));
    }
}
