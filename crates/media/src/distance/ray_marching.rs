//! Plain ray marching to a collision: biased.

use super::WeightedFlight;
use super::depth::fly_by_depth;
use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::RayInterval;
use crate::tally::Tally;
use pileus_math::random::uniform;
use rand_core::Rng;

/// Steps along a whole ray.
pub(crate) const MARCHING_STEPS: u32 = 64;

/// A **biased** flight: the extinction is taken for constant in each of `steps` equal parts of the
/// ray's segments, at the value of one random point, the same in all parts.
///
/// Collisions are smeared over a part and the transmittance is too bright by Jensen's inequality;
/// the error falls with the square of the parts' length where the extinction is smooth. `drawn`: an
/// exponential variate.
pub fn ray_marching_flight<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    beta: C::Value,
    steps: u32,
    drawn: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    let (interval, field) = RayInterval::whole(field);
    tally.majorant_steps += field.steps();
    let offset = f64::from(uniform(rng));
    fly_by_depth(channels, beta, drawn, rng, tally, |depth, tally| {
        if !(interval.length < f32::INFINITY) {
            // Constant extinction without end, by the contract of fields.
            let sigma_t = f64::from(field.sigma_t_anywhere(0.0));
            return if sigma_t > 0.0 { Ok((depth / sigma_t) as f32) } else { Err(0.0) };
        }
        let step = f64::from(interval.length) / f64::from(steps);
        let mut passed = 0.0;
        if !(step > 0.0) {
            return Err(0.0);
        }
        for i in 0..steps {
            let t = interval.at_length(((f64::from(i) + offset) * step) as f32);
            let sigma_t = f64::from(field.sigma_t_anywhere(t));
            tally.lookups += 1;
            if passed + sigma_t * step > depth {
                let part = (depth - passed) / sigma_t;
                return Ok(interval.at_length((f64::from(i) * step + part) as f32));
            }
            passed += sigma_t * step;
        }
        Err(passed)
    })
}
