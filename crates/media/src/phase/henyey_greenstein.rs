//! Henyey and Greenstein 1941: one parameter, the mean cosine `g`.

use super::ISOTROPIC;
use super::cosine::Cosine;

/// Largest |g| in single precision.
pub const MAX_G: f32 = 0.999;

/// Value, 1/sr, for `g` in [0, 1) and `one_minus_cos = 1 - cos_theta`.
#[inline(always)]
pub(super) fn value(g: f32, one_minus_cos: f32) -> f32 {
    // (1-g)^2 + 2g(1-cos) loses no digits near the forward peak, where 1 + g^2 - 2g cos cancels.
    let d = (1.0 - g) * (1.0 - g) + 2.0 * g * one_minus_cos;
    ISOTROPIC * (1.0 - g * g) / (d * d.sqrt())
}

/// `1 - cos` of the scattering angle for mean cosine `g` in [0, 1), by inversion.
///
/// With q = 1 - g + 2 g u the inverse is `cos = (1 + g^2 - ((1 - g^2) / q)^2) / (2 g)`; this form of `1 - cos` divides by no g
/// and loses no digits near the forward peak.
#[inline(always)]
pub(super) fn one_minus_cos(g: f32, u: f32) -> f32 {
    let q = 1.0 - g + 2.0 * g * u;
    (2.0 * (1.0 - g) * (1.0 - g) * (1.0 - u) * (1.0 + g * u) / (q * q)).clamp(0.0, 2.0)
}

/// Value, 1/sr, for `g` of either sign.
pub(super) fn eval(g: f32, cosine: Cosine) -> f32 {
    value(g.abs(), if g < 0.0 { cosine.one_plus } else { cosine.one_minus })
}

/// The angle for a random number, `g` of either sign.
pub(super) fn sample(g: f32, u: f32) -> Cosine {
    let x = one_minus_cos(g.abs(), u);
    let forward = Cosine { one_minus: x, one_plus: 2.0 - x };
    if g < 0.0 { forward.mirrored() } else { forward }
}
