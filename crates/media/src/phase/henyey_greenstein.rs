//! Henyey and Greenstein 1941: one parameter, the mean cosine `g`.
//!
//! Everything is a function of how far a direction is from the peak, `1 - cos` for `g >= 0` and
//! `1 + cos` for `g < 0`: at the peak of `g = 0.999` the value falls by 36 % while the cosine
//! changes by its last digit.

use super::ISOTROPIC;
use super::cosine::Cosine;
use glam::Vec3;

/// Largest |g| in single precision.
pub const MAX_G: f32 = 0.999;

/// Value, 1/sr, for `|g|` and the distance from the peak.
#[inline(always)]
fn value(g: f32, from_peak: f32) -> f32 {
    // (1-g)^2 + 2g(1-cos) loses no digits near the forward peak, where 1 + g^2 - 2g cos cancels.
    let d = (1.0 - g) * (1.0 - g) + 2.0 * g * from_peak;
    ISOTROPIC * (1.0 - g * g) / (d * d.sqrt())
}

/// The distance from the peak for `|g|` and a random number, by inversion.
///
/// With q = 1 - g + 2 g u the inverse is `cos = (1 + g^2 - ((1 - g^2) / q)^2) / (2 g)`; this form
/// of `1 - cos` divides by no g and loses no digits near the forward peak.
#[inline(always)]
pub(super) fn sample_from_peak(g: f32, u: f32) -> f32 {
    let q = 1.0 - g + 2.0 * g * u;
    (2.0 * (1.0 - g) * (1.0 - g) * (1.0 - u) * (1.0 + g * u) / (q * q)).clamp(0.0, 2.0)
}

/// Value, 1/sr, for unit vectors of propagation before and after the scattering.
#[inline(always)]
pub(super) fn eval_directions(g: f32, incoming: Vec3, wi: Vec3) -> f32 {
    // Half the squared length of the difference, or of the sum, as in `Cosine::between`.
    let peak = incoming * 1f32.copysign(g);
    value(g.abs(), (0.5 * (wi - peak).length_squared()).min(2.0))
}

/// Cosine and sine of the scattering angle for a random number, and the value there, 1/sr.
#[inline(always)]
pub(super) fn sample_with_value(g: f32, u: f32) -> (f32, f32, f32) {
    let from_peak = sample_from_peak(g.abs(), u);
    let cos = (1.0 - from_peak).copysign((1.0 - from_peak) * g);
    (cos, (from_peak * (2.0 - from_peak)).sqrt(), value(g.abs(), from_peak))
}

/// Value, 1/sr, at a scattering angle.
pub(super) fn eval(g: f32, cosine: Cosine) -> f32 {
    value(g.abs(), if g < 0.0 { cosine.one_plus } else { cosine.one_minus })
}

/// The angle for a random number.
pub(super) fn sample(g: f32, u: f32) -> Cosine {
    let x = sample_from_peak(g.abs(), u);
    let forward = Cosine { one_minus: x, one_plus: 2.0 - x };
    if g < 0.0 { forward.mirrored() } else { forward }
}
