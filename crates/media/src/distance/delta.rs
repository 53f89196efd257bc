//! Delta tracking [Woodcock 1965]: exact free flights through any field with a bound.

use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::random::uniform;
use crate::tally::Tally;
use rand_core::Rng;

/// How a free flight ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Flight {
    /// A real collision at this ray parameter.
    Collision(f32),
    /// The ray left the field.
    Escape,
}

/// Flies to the next real collision.
///
/// Exact: the collision has density `sigma_t(t) exp(-tau(0, t))`. Mean lookups: the majorant optical depth up to the end of the flight.
/// `null` is told the probability with which each null collision was a null one, which multiple importance sampling multiplies up.
/// A lookup above its majorant (a wrong bound) counts as a violation and is accepted as a collision: the flight is then biased.
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
        let sigma_t = walk.sigma_t(tentative);
        tally.lookups += 1;
        tally.violations += u64::from(sigma_t > tentative.majorant);
        if uniform(rng) * tentative.majorant < sigma_t {
            tally.collisions += 1;
            break Flight::Collision(tentative.t);
        }
        tally.null_collisions += 1;
        null(1.0 - sigma_t / tentative.majorant);
    };
    tally.majorant_steps += walk.field().steps();
    flight
}
