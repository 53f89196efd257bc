//! The null-collision series from both ends, every split of every order combined by the balance
//! heuristic.

use crate::channels::Channels;
use crate::field::RayField;
use crate::ray_interval::{RayInterval, product_over_intervals};
use crate::tally::Tally;
use pileus_math::Spectrum;
use pileus_math::elementary::exp;
use pileus_math::random::exponential;
use rand_core::Rng;
use smallvec::SmallVec;

/// Majorant depth of an interval: pairs of vertices grow with its square.
pub(crate) const BIDIRECTIONAL_INTERVAL_DEPTH: f32 = 8.0;

/// A vertex of a walk from one end.
#[derive(Debug, Clone, Copy)]
struct Vertex<S> {
    /// Majorant depth from this end.
    depth: f32,
    /// Product of null ratios up to it.
    weight: S,
    /// Sum of `exp` of the gaps up to it.
    gaps: f32,
}

/// The vertices from one end; the first is the end itself.
fn walk<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: &F,
    interval: &RayInterval,
    channels: C,
    backward: bool,
    rng: &mut R,
    tally: &mut Tally,
) -> SmallVec<[Vertex<C::Value>; 16]> {
    let mut vertices = SmallVec::new();
    let mut vertex = Vertex { depth: 0.0, weight: C::Value::ONE, gaps: 0.0 };
    loop {
        vertices.push(vertex);
        let gap = exponential(rng);
        vertex.depth += gap;
        if vertex.depth >= interval.depth {
            return vertices;
        }
        let from_start = if backward { interval.depth - vertex.depth } else { vertex.depth };
        let real = interval.real_ratio(field, from_start, channels, tally);
        vertex.weight = vertex.weight.times(real.complement(rng));
        vertex.gaps += exp(gap);
        if vertex.weight.max_abs() == 0.0 {
            return vertices;
        }
    }
}

/// An unbiased estimate of the transmittance; exact where the majorant is tight.
///
/// A walk from each end by the majorants' Poisson process. The first `i` vertices of one and the
/// first `j` of the other, if they do not cross, are a sample of the term of order `i + j`; its
/// density under every split is known, and the balance heuristic over the splits gives each pair
/// the value `product of null ratios / sum of exp(gap)` over the gaps between neighbours. All pairs
/// are used. After the bidirectional view of Georgiev et al. 2019; the closed form of the weights
/// is ours.
pub(crate) fn bidirectional<F: RayField, C: Channels, R: Rng + ?Sized>(
    field: F,
    channels: C,
    interval: f32,
    threshold: f32,
    rng: &mut R,
    tally: &mut Tally,
) -> C::Value {
    product_over_intervals(
        field,
        channels,
        interval,
        threshold,
        rng,
        tally,
        |field, interval, rng, tally| {
            let forward = walk(field, interval, channels, false, rng, tally);
            let backward = walk(field, interval, channels, true, rng, tally);
            let mut sum = C::Value::ZERO;
            for a in &forward {
                for b in &backward {
                    let gap = interval.depth - a.depth - b.depth;
                    if gap < 0.0 {
                        break;
                    }
                    let densities = a.gaps + b.gaps + exp(gap);
                    sum += a.weight.times(b.weight) * (1.0 / densities);
                }
            }
            sum
        },
    )
}
