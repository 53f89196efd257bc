//! Transmittance by delta tracking [Woodcock 1965]: whether a free flight gets through.

use crate::channels::Channels;
use crate::collisions::TentativeCollisions;
use crate::field::RayField;
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::random::Decision;
use rand_core::Rng;

/// One if a free flight escapes the field, else zero; one walk and one decision for all channels.
/// Unbiased for a bound; relative variance `1/T - 1`. Lookups above their majorant are counted as
/// violations: the estimate is then too large.
#[inline(always)]
pub(crate) fn delta_transmittance<F: RayField, C: Channels, R: Rng + ?Sized>(
    mut walk: TentativeCollisions<F>,
    channels: C,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    let mut open = C::Value::ONE;
    while let Some(next) = walk.next(rng) {
        let sigma_t = walk.sigma_t(next, tally);
        let ratio = channels.of(sigma_t / next.majorant);
        let mut u = Decision::new(rng);
        for channel in 0..C::Value::COUNT {
            if u.is_below(ratio.channel(channel), rng) {
                open = open.times(C::Value::ONE - C::Value::one_channel(channel, 1.0));
            }
        }
        if open.max_abs() == 0.0 {
            break;
        }
    }
    tally.majorant_steps += walk.field().steps();
    open
}
