//! Rayleigh scattering of unpolarised light: particles far smaller than the wavelength,
//! `3 / (16 pi) (1 + cos^2)`.

use super::cosine::Cosine;
use std::f32::consts::PI;

/// Value, 1/sr.
pub(super) fn eval(cosine: Cosine) -> f32 {
    let c = cosine.value();
    3.0 / (16.0 * PI) * (1.0 + c * c)
}

/// The angle for a random number: solves `c^3 + 3c = 4 (1 - 2u)`.
///
/// By Newton's iteration and not by cubic roots, which are functions of the system and differ
/// between machines. It starts on the concave side of the root's magnitude and converges from
/// above; five steps reach double precision.
pub(super) fn sample(u: f32) -> Cosine {
    let v = 1.0 - 2.0 * f64::from(u);
    let mut c = v;
    for _ in 0..5 {
        c -= (c * (c * c + 3.0) - 4.0 * v) / (3.0 * (c * c + 1.0));
    }
    Cosine::from_one_minus(1.0 - c)
}
