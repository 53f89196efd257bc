//! How a ray gets through a medium of a list: what has to be walked, what has closed forms, what
//! flies by itself.

use super::index::Walk;
use super::{Ray, Shadow};
use glam::Vec3;
use pileus_media::transmittance_function::TransmittanceFunction;
use pileus_media::{Medium, Span, Spectrum};

/// Transmittance of a grey homogeneous medium up to `t_max`: closed form; `None` for other media.
pub(super) fn closed_form(medium: &Medium, ray: &Ray, t_max: f64) -> Option<f32> {
    let shape = medium.homogeneous_box()?;
    if !medium.is_grey() || medium.transmittance_function().is_some() {
        return None;
    }
    let span = shape.span(ray.origin, ray.direction, t_max);
    let length = span.map_or(0.0, |span| span.length);
    let shown =
        medium.phase().microflakes().map_or(1.0, |flakes| flakes.largest_area(ray.direction));
    let tau = f64::from(shape.sigma_t() * shown) * f64::from(length);
    // 0 x infinity: no extinction in all space.
    Some(if tau.is_nan() { 1.0 } else { libm::exp(-tau) as f32 })
}

/// Whether a ray never leaves a medium that differs per channel: without end, transmittance is zero
/// or one.
pub(super) fn endless(medium: &Medium, ray: &Ray, t_max: f64) -> bool {
    let Some(shape) = medium.homogeneous_box() else {
        return false;
    };
    let endless = |span: Span| span.length == f32::INFINITY;
    !medium.is_grey() && shape.span(ray.origin, ray.direction, t_max).is_some_and(endless)
}

/// Optical depth of the strongest channel, and its extinction over the weakest one's, above which a
/// segment through a homogeneous medium is not walked.
const MAX_WALKED_DEPTH: f64 = 256.0;

/// Whether a medium is homogeneous and its channels differ so much that a segment may be too long
/// to walk.
pub(super) fn is_uneven(medium: &Medium) -> bool {
    let uneven = |s: f32| s > 0.0 && f64::from(s) * MAX_WALKED_DEPTH < 1.0;
    let ratio = medium.chromatic_ratio();
    medium.homogeneous_box().is_some() && ratio.to_array().into_iter().any(uneven)
}

/// The strongest channel's optical depth of a segment through a homogeneous medium whose channels
/// differ so much that a walk by the strongest one's collisions, which are null for the others,
/// would be very long: there flights and transmittances are closed forms, and weights leave the way
/// out on both sides. `None` elsewhere.
pub(super) fn too_long_to_walk(medium: &Medium, ray: &Ray, t_max: f64) -> Option<f64> {
    if !is_uneven(medium) {
        return None;
    }
    let shape = medium.homogeneous_box()?;
    let length = shape.span(ray.origin, ray.direction, t_max)?.length;
    let shown =
        medium.phase().microflakes().map_or(1.0, |flakes| flakes.largest_area(ray.direction));
    let depth = f64::from(shape.sigma_t() * shown) * f64::from(length);
    (depth > MAX_WALKED_DEPTH).then_some(depth)
}

/// Whether a medium's flights and shadow rays run on a drawn rate: homogeneous media have closed
/// forms.
pub(super) fn runs_on_rates(medium: &Medium, function: &TransmittanceFunction) -> bool {
    medium.grid().is_some() && function.is_mixture_of_exponentials()
}

/// Whether flights through a medium invert its optical depth whatever the plan's methods are.
pub(crate) fn flies_by_depth(medium: &Medium) -> bool {
    is_uneven(medium)
        || medium.transmittance_function().is_some_and(|function| !runs_on_rates(medium, function))
}

/// Whether a medium has no exact depths, so that it is walked whatever the plan's methods are.
pub(super) fn has_to_be_walked(medium: &Medium) -> bool {
    medium.phase().microflakes().is_some_and(|flakes| flakes.by_grid())
}

/// What a medium needs of a flight.
pub(super) fn walk_of(medium: &Medium) -> Walk {
    match (medium.default_grid(), medium.transmittance_function()) {
        (Some(_), None) => Walk::Grid,
        (Some(_), Some(function)) if runs_on_rates(medium, function) => Walk::GridOnRates,
        _ => Walk::Other,
    }
}

/// Whether a medium of a list may need a flight of its own, or a rate.
pub(super) fn is_special(medium: &Medium) -> bool {
    medium.transmittance_function().is_some() || is_uneven(medium)
}

/// Transmittance that needs no walk, with the null probability that weights count; `None` where a
/// ray has to be walked.
#[inline]
pub(super) fn known_transmittance(medium: &Medium, ray: &Ray, t_max: f64) -> Option<Shadow> {
    if medium.homogeneous_box().is_none() || medium.transmittance_function().is_some() {
        return None;
    }
    if let Some(factor) = closed_form(medium, ray, t_max) {
        let factor = Vec3::splat(factor);
        return Some(Shadow { transmittance: factor, null_probability: factor });
    }
    let ratio = medium.chromatic_ratio();
    if let Some(depth) = too_long_to_walk(medium, ray, t_max) {
        let passed = |s: f32| if s > 0.0 { libm::exp(-f64::from(s) * depth) as f32 } else { 1.0 };
        return Some(Shadow { transmittance: Spectrum::map(ratio, passed), ..Shadow::CLEAR });
    }
    if endless(medium, ray, t_max) {
        let clear = |s: f32| if s > 0.0 { 0.0 } else { 1.0 };
        return Some(Shadow { transmittance: Spectrum::map(ratio, clear), ..Shadow::CLEAR });
    }
    None
}
