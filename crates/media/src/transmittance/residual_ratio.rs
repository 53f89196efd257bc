//! Residual ratio tracking [Novak et al. 2014]: a control of known depth, and ratio tracking of
//! what it leaves.

use crate::channels::Channels;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::{exponential, happens};
use rand_core::Rng;

/// The control extinction of a majorant segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Control {
    /// The minorant: factors and estimate stay in [0, 1], and the rate is what the majorant exceeds
    /// it by.
    #[default]
    Minorant,
    /// The middle of minorant and majorant: half that rate, factors in [0, 2], estimates may exceed
    /// one.
    Middle,
}

/// An unbiased estimate of the transmittance.
///
/// `exp(-control depth)` times the product of `1 - (sigma_t - control) / rate` over a Poisson
/// process of that rate, per majorant segment. Relative variance
/// `exp(integral of (sigma_t - control)^2 / rate) - 1`; segments of constant extinction take no
/// lookup.
#[inline(always)]
pub fn residual_ratio_tracking<F: RayField, C: Channels, R: Rng + ?Sized>(
    mut field: F,
    channels: C,
    control: Control,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let mut product = C::Value::ONE;
    let mut depth = exponential(rng);
    'ray: while let Some(segment) = field.next_segment() {
        let minorant = field.minorant();
        let (rate, control) = match control {
            Control::Minorant => (segment.majorant - minorant, minorant),
            Control::Middle => {
                (0.5 * (segment.majorant - minorant), 0.5 * (segment.majorant + minorant))
            }
        };
        // Zero lengths and zero extinction have no depth, also times infinity.
        let control_depth = channels
            .of(control * (segment.t1 - segment.t0))
            .map(|depth| if depth > 0.0 { -depth } else { 0.0 });
        product = product.times(control_depth.exp());
        let mut t = segment.t0;
        if rate > 0.0 {
            loop {
                let available = (segment.t1 - t) * rate;
                if !(depth < available) {
                    depth -= available;
                    break;
                }
                t = (t + depth / rate).min(segment.t1);
                depth = exponential(rng);
                let sigma_t = tally.looked_up(field.sigma_t(t), segment.majorant);
                let residual = channels.of((sigma_t - control) / rate);
                product = product.times(residual.complement(rng));
                if product.max_abs() == 0.0 {
                    break 'ray;
                }
            }
        }
        let size = product.max_abs();
        if size == 0.0 {
            break;
        }
        if size < threshold {
            let survival = size / threshold;
            if !happens(survival, rng) {
                product = C::Value::ZERO;
                break;
            }
            product *= 1.0 / survival;
        }
    }
    tally.majorant_steps += field.steps();
    product
}
