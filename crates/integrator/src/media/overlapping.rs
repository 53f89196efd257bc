//! Any number of media, overlapping or not, grey or per channel.
//!
//! Overlapping media are independent Poisson processes: their tentative collisions are taken in order along the ray, transmittances
//! multiply. Where extinction differs per channel all channels share the largest one's majorant, and real or null is decided by
//! the mean of the throughput-weighted channels: spectral tracking [Kutz et al. 2017]. Under that rule the mean of the
//! throughput over channels is the same before and after every event, so that no channel's weight exceeds the number of channels;
//! it is single-sample multiple importance sampling over channels by the balance heuristic [Miller et al. 2019].

use super::{Collision, Flown, Media, Ray, Shadow};
use glam::{DVec3, Vec3};
use pileus_media::random::{exponential, uniform};
use pileus_media::transmittance::ratio_tracking_with_roulette;
use pileus_media::{
    AnyGridRay, HomogeneousRay, MajorantSegment, Medium, Phase, RayField, Tally, Tentative,
    TentativeCollisions,
};
use rand_core::Rng;
use smallvec::SmallVec;
use std::sync::Arc;

/// All media of a scene, as a list.
pub(crate) struct Overlapping<'a> {
    pub(crate) media: &'a [Arc<Medium>],
    /// Delta tracking instead of ratio tracking for transmittance.
    pub(crate) delta: bool,
}

/// A field of either kind of medium.
#[expect(clippy::large_enum_variant, reason = "a few on the stack per flight, nearly all grids")]
enum AnyRay<'a> {
    Grid(AnyGridRay<'a>),
    Homogeneous(HomogeneousRay),
}

impl RayField for AnyRay<'_> {
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        match self {
            AnyRay::Grid(ray) => ray.next_segment(),
            AnyRay::Homogeneous(ray) => ray.next_segment(),
        }
    }
    fn minorant(&self) -> f32 {
        match self {
            AnyRay::Grid(ray) => ray.minorant(),
            AnyRay::Homogeneous(ray) => ray.minorant(),
        }
    }
    fn sigma_t(&self, t: f32) -> f32 {
        match self {
            AnyRay::Grid(ray) => ray.sigma_t(t),
            AnyRay::Homogeneous(ray) => ray.sigma_t(t),
        }
    }
    fn steps(&self) -> u64 {
        match self {
            AnyRay::Grid(ray) => ray.steps(),
            AnyRay::Homogeneous(ray) => ray.steps(),
        }
    }
}

/// A medium met by a ray, with its next tentative collision.
struct Walker<'a> {
    medium: usize,
    t_enter: f64,
    relative: Vec3,
    walk: TentativeCollisions<AnyRay<'a>>,
    next: Option<Tentative>,
}

impl Walker<'_> {
    fn t(&self) -> f64 {
        self.next.map_or(f64::INFINITY, |next| self.t_enter + f64::from(next.t))
    }
}

fn enter<'a>(medium: &'a Medium, ray: &Ray, t_max: f64) -> Option<(f64, AnyRay<'a>)> {
    match medium {
        Medium::Grid(grid) => {
            let span = grid.span(ray.origin, ray.direction, t_max)?;
            Some((span.t_enter, AnyRay::Grid(grid.any_ray(&span))))
        }
        Medium::Homogeneous(homogeneous) => {
            let (t_enter, length) = homogeneous.span(ray.origin, ray.direction, t_max)?;
            Some((t_enter, AnyRay::Homogeneous(homogeneous.ray(length))))
        }
    }
}

/// Transmittance of a grey homogeneous medium up to `t_max`: closed form; `None` for other media.
fn closed_form(medium: &Medium, ray: &Ray, t_max: f64) -> Option<f32> {
    let Medium::Homogeneous(medium) = medium else {
        return None;
    };
    if !medium.is_grey() {
        return None;
    }
    let length = medium.span(ray.origin, ray.direction, t_max).map_or(0.0, |(_, length)| length);
    let tau = f64::from(medium.scale()) * f64::from(length);
    // 0 x infinity: no extinction in all space.
    Some(if tau.is_nan() { 1.0 } else { (-tau).exp() as f32 })
}

impl Media for Overlapping<'_> {
    fn flight<R: Rng>(
        &self,
        ray: &Ray,
        first: Option<f32>,
        flown: &mut Flown,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let mut first = first;
        let mut walkers: SmallVec<[Walker; 4]> = SmallVec::new();
        for (index, medium) in self.media.iter().enumerate() {
            if let Some((t_enter, field)) = enter(medium, ray, f64::INFINITY) {
                let depth = first.take().unwrap_or_else(|| exponential(rng));
                let mut walk = TentativeCollisions::with_first(field, depth);
                let next = walk.next(rng);
                let relative = medium.relative_extinction();
                walkers.push(Walker { medium: index, t_enter, relative, walk, next });
            }
        }
        let collision = loop {
            let nearest = walkers.iter_mut().min_by(|a, b| a.t().total_cmp(&b.t()));
            let Some((walker, next)) = nearest.and_then(|w| w.next.map(|next| (w, next))) else {
                break None;
            };
            let sigma_t = walker.walk.sigma_t(next);
            tally.lookups += 1;
            tally.violations += u64::from(sigma_t > next.majorant);
            let real = walker.relative * (sigma_t / next.majorant);
            let total = flown.beta.element_sum();
            let probability = if total > 0.0 {
                (flown.beta.dot(real) / total).min(1.0)
            } else {
                real.max_element()
            };
            if uniform(rng) < probability {
                tally.collisions += 1;
                flown.beta *= real / probability;
                break Some(Collision { t: walker.t(), medium: walker.medium });
            }
            tally.null_collisions += 1;
            // Delta-tracked shadow rays decide at the same collisions: their weights leave the nulls out, and so do these.
            flown.beta *= (Vec3::ONE - real) / (1.0 - probability);
            if !self.delta {
                flown.null_probability *= 1.0 - probability;
            }
            walker.next = walker.walk.next(rng);
        };
        for walker in &walkers {
            tally.majorant_steps += walker.walk.field().steps();
        }
        if collision.is_none() {
            // Light sampling takes these transmittances in closed form; path sampling had to survive them.
            for medium in self.media {
                if let Some(transmittance) = closed_form(medium, ray, f64::INFINITY) {
                    flown.null_probability *= transmittance;
                }
            }
        }
        collision
    }

    fn transmittance<R: Rng>(
        &self,
        ray: &Ray,
        t_max: f64,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let mut shadow = Shadow::CLEAR;
        for medium in self.media {
            if let Some(factor) = closed_form(medium, ray, t_max) {
                shadow.transmittance *= factor;
                shadow.null_probability *= factor;
                continue;
            }
            let Some((_, field)) = enter(medium, ray, t_max) else {
                continue;
            };
            let walk = TentativeCollisions::new(field);
            let relative = medium.relative_extinction();
            if self.delta {
                shadow.transmittance *= channel_delta_tracking(walk, relative, rng, tally);
            } else if relative == Vec3::ONE {
                let estimate = ratio_tracking_with_roulette(walk, threshold, rng, tally);
                shadow.transmittance *= estimate.transmittance;
                shadow.null_probability *= estimate.null_probability;
            } else {
                let product = channel_ratio_tracking(walk, relative, rng, tally);
                shadow.transmittance *= product;
                shadow.null_probability *= product;
            }
            if shadow.transmittance == Vec3::ZERO {
                break;
            }
        }
        shadow
    }

    fn properties(&self, collision: &Collision, p_world: DVec3) -> (Phase, Vec3) {
        let medium = &self.media[collision.medium];
        (*medium.phase(), medium.albedo_at(p_world))
    }
}

/// Ratio tracking with one walk for all channels.
fn channel_ratio_tracking<F: RayField, R: Rng>(
    mut walk: TentativeCollisions<F>,
    relative: Vec3,
    rng: &mut R,
    tally: &mut Tally,
) -> Vec3 {
    let mut product = Vec3::ONE;
    while let Some(next) = walk.next(rng) {
        let sigma_t = walk.sigma_t(next);
        tally.lookups += 1;
        tally.violations += u64::from(sigma_t > next.majorant);
        product *= Vec3::ONE - relative * (sigma_t / next.majorant);
        if product == Vec3::ZERO {
            break;
        }
    }
    tally.majorant_steps += walk.field().steps();
    product
}

/// Delta tracking with one walk and one decision for all channels: channel k is stopped if `u < sigma_t_k / majorant`.
fn channel_delta_tracking<F: RayField, R: Rng>(
    mut walk: TentativeCollisions<F>,
    relative: Vec3,
    rng: &mut R,
    tally: &mut Tally,
) -> Vec3 {
    let mut open = Vec3::ONE;
    while let Some(next) = walk.next(rng) {
        let sigma_t = walk.sigma_t(next);
        tally.lookups += 1;
        tally.violations += u64::from(sigma_t > next.majorant);
        let u = uniform(rng);
        let real = relative * (sigma_t / next.majorant);
        open *= Vec3::from_array(real.to_array().map(|r| if u < r { 0.0 } else { 1.0 }));
        if open == Vec3::ZERO {
            break;
        }
    }
    tally.majorant_steps += walk.field().steps();
    open
}
