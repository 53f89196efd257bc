//! Sine and cosine from basic arithmetic alone.
//!
//! The functions of the system's library differ in their last bits between systems, and even
//! between processors under one library; where a sample lands must not depend on that.

/// (sin, cos) of `t` full turns, `t` in `[-4, 4]`; absolute error below 3e-16.
pub(crate) fn sin_cos_turns(t: f64) -> (f64, f64) {
    // |x| <= pi / 4, where the Taylor series to x^15 and x^16 err by less than 5e-17.
    let quarter = (4.0 * t).round();
    let x = std::f64::consts::TAU * (t - 0.25 * quarter);
    let x2 = x * x;
    let series = |first: f64, start: i32, last: i32| {
        // Horner on 1 - x2/((s+1)(s+2)) (1 - x2/((s+3)(s+4)) (...)).
        let mut sum = 1.0;
        let mut k = last;
        while k > start {
            sum = 1.0 - sum * x2 / f64::from(k * (k - 1));
            k -= 2;
        }
        first * sum
    };
    let (sin, cos) = (series(x, 1, 15), series(1.0, 0, 16));
    match (quarter as i64).rem_euclid(4) {
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
    fn agrees_with_the_library() {
        for i in -4000..=4000 {
            let t = f64::from(i) / 1000.0;
            let (sin, cos) = sin_cos_turns(t);
            let (s, c) = (std::f64::consts::TAU * t).sin_cos();
            assert!((sin - s).abs() < 4e-15 && (cos - c).abs() < 4e-15, "{t}: {sin} {cos}");
        }
        assert_eq!(sin_cos_turns(0.25), (1.0, 0.0));
        assert_eq!(sin_cos_turns(0.5), (0.0, -1.0));
    }
}
