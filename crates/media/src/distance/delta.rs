//! Delta tracking [Woodcock 1965]: exact free flights through any field with a bound.

use super::spectral::real_probability;
use super::tracking::track;
use super::{Flight, WeightedFlight};
use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::happens_of;
use rand_core::Rng;

/// Flies to the next real collision.
///
/// Exact: the collision has density `sigma_t(t) exp(-tau(0, t))`. Mean lookups: the majorant
/// optical depth up to the end of the flight. `null` is told the probability with which each null
/// collision was a null one, which multiple importance sampling multiplies up. A lookup above its
/// majorant (a wrong bound) counts as a violation and is accepted as a collision: the flight is
/// then biased.
#[inline(always)]
pub fn delta_tracking<F: RayField, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    rng: &mut R,
    tally: &mut Tally,
    mut null: impl FnMut(f32),
) -> Flight {
    let flight = loop {
        let Some(tentative) = walk.next(rng) else {
            break Flight::Escape;
        };
        let sigma_t = walk.sigma_t(tentative, tally);
        if happens_of(sigma_t, tentative.majorant, rng) {
            tally.collisions += 1;
            break Flight::Collision(tentative.t);
        }
        tally.null_collisions += 1;
        null(1.0 - sigma_t / tentative.majorant);
    };
    tally.majorant_steps += walk.field().steps();
    flight
}

/// Delta tracking of several channels, real or null by their plain mean, whatever their throughput;
/// all are weighted.
///
/// Unbiased for bounds that hold. The weight of a channel with less than the mean extinction grows
/// at every null collision, without limit: what spectral tracking is for. (Deciding by one channel
/// alone would be biased: where it fills its majorant nothing would ever get through for the
/// others.)
#[inline(always)]
pub(crate) fn delta_tracking_by_mean<F: RayField, C: Channels, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    channels: C,
    rng: &mut R,
    tally: &mut Tally,
) -> WeightedFlight<C::Value> {
    track(walk, channels, C::Value::ONE, rng, tally, |real, _| {
        real_probability(real, C::Value::ONE)
    })
}
