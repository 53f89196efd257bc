//! Transmittance by delta tracking [Woodcock 1965]: whether a free flight gets through.

use crate::collisions::TentativeCollisions;
use crate::distance::{Flight, delta_tracking};
use crate::field::RayField;
use crate::tally::Tally;
use rand_core::Rng;

/// One if a free flight escapes the field, else zero. Unbiased; relative variance `1/T - 1`.
#[inline]
pub fn delta_transmittance<F: RayField, R: Rng + ?Sized>(
    walk: TentativeCollisions<F>,
    rng: &mut R,
    tally: &mut Tally,
) -> f32 {
    match delta_tracking(walk, rng, tally, |_| ()) {
        Flight::Escape => 1.0,
        Flight::Collision(_) => 0.0,
    }
}
