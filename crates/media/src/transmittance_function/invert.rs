//! Inversion of transmittance functions that have no closed form for it.

use libm::{exp, log};

/// Depth beyond which nothing survives, whatever the transmittance function.
const DEEPEST: f64 = 1e30;

/// The depth at which the decreasing function `survival` has fallen to `e^-drawn`, to twelve
/// digits: bracketed by doubling, then Newton's method on the logarithm with the slope `density`,
/// kept between bounds by bisection.
pub(super) fn depth_of(
    drawn: f64,
    survival: impl Fn(f64) -> f64,
    density: impl Fn(f64) -> f64,
) -> f64 {
    if !(drawn > 0.0) {
        return 0.0;
    }
    let target = exp(-drawn);
    let (mut low, mut high) = (0.0, 1.0);
    while survival(high) > target {
        low = high;
        high *= 2.0;
        if high > DEEPEST {
            return f64::INFINITY;
        }
    }
    let mut tau = 0.5 * (low + high);
    for _ in 0..100 {
        let survives = survival(tau);
        if survives > target {
            low = tau;
        } else {
            high = tau;
        }
        if high - low <= 1e-12 * high {
            break;
        }
        // ln X - ln target over its slope -p / X.
        let newton = if survives > f64::MIN_POSITIVE {
            tau + (log(survives) + drawn) * survives / density(tau)
        } else {
            f64::NAN
        };
        if (newton - tau).abs() <= 1e-13 * tau {
            break;
        }
        tau = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
    }
    tau
}
