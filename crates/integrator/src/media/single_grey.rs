//! One grid of grey extinction: the kernel of most clouds. No channels, no list of media, no choice of voxel type, no phase
//! functions but isotropic and Henyey-Greenstein.

use super::{Collision, Flown, Leg, Media, Methods, Ray, Shadow, Together};
use glam::{DVec3, Vec3};
use pileus_media::distance::{DistanceSampler, Flight, delta_tracking};
use pileus_media::transmittance::{Estimator, ratio_tracking_with_roulette};
use pileus_media::{
    AnyRay, ExactField, Grey, GridRay, GridShape, Medium, PhaseAt, Span, Tally,
    TentativeCollisions, Voxel,
};
use rand_core::Rng;
use std::marker::PhantomData;

/// Which majorant structures a kernel is compiled for.
pub(crate) trait Structures: Sync {
    /// The ray field of a span.
    type Ray<'a, V: Voxel>: ExactField;
    /// The ray field of a span, for a share of the extinction.
    fn ray<'a, V: Voxel>(
        one: SingleGrid<'a, V>,
        span: &Span,
        share: f32,
    ) -> Self::Ray<'a, V>;
}

/// A medium of one grid, with its voxels in their type.
#[derive(Clone, Copy)]
pub(crate) struct SingleGrid<'a, V> {
    pub(crate) medium: &'a Medium,
    pub(crate) grid: &'a GridShape,
    pub(crate) voxels: &'a [V],
}

/// The structure that every medium has by default.
pub(crate) struct DefaultStructure;

impl Structures for DefaultStructure {
    type Ray<'a, V: Voxel> = GridRay<'a, V>;
    #[inline(always)]
    fn ray<'a, V: Voxel>(one: SingleGrid<'a, V>, span: &Span, share: f32) -> GridRay<'a, V> {
        one.grid.ray(one.voxels, span, share)
    }
}

/// Any structure.
pub(crate) struct AnyStructure;

impl Structures for AnyStructure {
    type Ray<'a, V: Voxel> = AnyRay<'a>;
    #[inline(always)]
    fn ray<'a, V: Voxel>(one: SingleGrid<'a, V>, span: &Span, share: f32) -> AnyRay<'a> {
        one.medium.any_ray(span, share)
    }
}

/// The phase function and the albedo in the kernels of single grids. The plan gives them no other phase functions than these: none is compiled in.
#[inline(always)]
pub(super) fn plain_properties(medium: &Medium, p_world: DVec3) -> (PhaseAt<'static>, Vec3) {
    (medium.phase().plain().unwrap_or(PhaseAt::Isotropic), medium.albedo_at(p_world))
}

/// As [`Media::scattering`] of a single grid.
pub(super) fn plain_scattering(
    medium: &Medium,
    p_world: DVec3,
    mut visit: impl FnMut(Vec3, PhaseAt<'_>),
) {
    let sigma_t = medium.sigma_t_at(p_world) as f32;
    if sigma_t > 0.0 {
        let (phase, albedo) = plain_properties(medium, p_world);
        visit(albedo * medium.chromatic_ratio() * sigma_t, phase);
    }
}

/// One grey grid medium with voxels of type `V` and majorant structures `S`.
pub(crate) struct SingleGrey<'a, V, S> {
    pub(crate) structures: PhantomData<S>,
    pub(crate) one: SingleGrid<'a, V>,
    pub(crate) methods: Methods,
}

impl<V: Voxel, S: Structures> SingleGrey<'_, V, S> {
    /// Every estimator but ratio tracking: kept out of the kernel that most scenes run.
    #[inline(never)]
    fn other_transmittance<R: Rng>(
        &self,
        span: &Span,
        threshold: f32,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let field = S::ray(self.one, span, 1.0);
        let estimator = self.methods.transmittance;
        let transmittance = Vec3::splat(estimator.estimate(field, Grey, threshold, rng, tally));
        let known = self.methods.weigh_the_way(true);
        Shadow { transmittance, null_probability: if known { transmittance } else { Vec3::ONE } }
    }

    /// Every sampler but delta tracking.
    #[inline(never)]
    fn other_flight<R: Rng>(
        &self,
        span: &Span,
        first: Option<f32>,
        flown: &mut Flown<f32>,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Flight {
        let field = S::ray(self.one, span, 1.0);
        let result = self.methods.distance.fly(field, Grey, 1.0, first, rng, tally);
        flown.beta *= result.weight;
        if self.methods.weigh_the_way(true) {
            flown.null_probability *= result.null_probability;
        }
        result.flight
    }
}

impl<V: Voxel, S: Structures> Media for SingleGrey<'_, V, S> {
    type Nulls = f32;
    type Others = Together;

    #[inline(always)]
    fn flight<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        first: Option<[f32; 2]>,
        flown: &mut Flown<f32>,
        _: &mut Together,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Option<Collision> {
        let first = first.map(|[depth, _]| depth);
        let span = self.one.grid.span(ray.origin, ray.direction, t_max)?;
        let flight = if self.methods.distance == DistanceSampler::Delta {
            let field = S::ray(self.one, &span, 1.0);
            let walk = match first {
                Some(depth) => TentativeCollisions::with_first(field, depth),
                None => TentativeCollisions::new(field),
            };
            let nulls = &mut flown.null_probability;
            let count = self.methods.transmittance == Estimator::Ratio;
            delta_tracking(walk, rng, tally, |p| {
                if count {
                    *nulls *= p
                }
            })
        } else {
            self.other_flight(&span, first, flown, rng, tally)
        };
        match flight {
            Flight::Collision(t) => Some(Collision { t: span.t_enter + f64::from(t), medium: 0 }),
            Flight::Escape => None,
        }
    }

    #[inline(always)]
    fn transmittance<R: Rng>(
        &self,
        Leg { ray, t_max, .. }: Leg<'_>,
        threshold: f32,
        _: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let Some(span) = self.one.grid.span(ray.origin, ray.direction, t_max) else {
            return Shadow::CLEAR;
        };
        if self.methods.transmittance != Estimator::Ratio {
            return self.other_transmittance(&span, threshold, rng, tally);
        }
        let walk = TentativeCollisions::new(S::ray(self.one, &span, 1.0));
        let estimate = ratio_tracking_with_roulette(walk, Grey, threshold, rng, tally);
        let known = self.methods.distance.decides_at_collisions();
        Shadow {
            transmittance: Vec3::splat(estimate.transmittance),
            null_probability: Vec3::splat(if known { estimate.null_probability } else { 1.0 }),
        }
    }

    fn scattering<R: Rng>(
        &self,
        p_world: DVec3,
        _: Vec3,
        _: &mut R,
        visit: impl FnMut(Vec3, PhaseAt<'_>),
    ) {
        plain_scattering(self.one.medium, p_world, visit);
    }

    fn extent(&self, ray: &Ray, t_max: f64) -> Option<(f64, f64)> {
        self.one.grid.span(ray.origin, ray.direction, t_max).map(|span| span.extent())
    }

    #[inline(always)]
    fn properties<R: Rng>(
        &self,
        _: &Collision,
        p_world: DVec3,
        _: Vec3,
        _: &mut R,
    ) -> (PhaseAt<'_>, Vec3) {
        plain_properties(self.one.medium, p_world)
    }
}
