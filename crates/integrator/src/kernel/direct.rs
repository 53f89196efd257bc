//! Next-event estimation: light at a vertex, by one shadow ray.

use super::Kernel;
use super::interior::{self, MediumStack};
use super::passage::Passage;
use super::path::{Path, PathVertex, Tracing};
use super::recorder::{DirectLight, Recorder};
use super::world::{World, luminance};
use crate::lights::{EmissionMixture, LightSample};
use crate::media::channels::ChannelMode;
use crate::media::{Media, Ray, RaySegment, Shadow, StartCorrelation};
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::{happens, uniform};
use pileus_media::{Spectrum, Tally};

/// A shadow ray is certain if the lights' importance times the throughput is at least this; below
/// it undergoes Russian roulette. Importance one is what isotropic scattering gives.
const SHADOW_IMPORTANCE: f32 = 1.0;

/// Shadow rays that are sent with less than this probability are decided by numbers of full
/// precision.
const MIN_STRATIFIED_SURVIVAL: f32 = 1.0 / 4096.0;

/// Shadow walks whose product of transmittance and importance falls below this undergo Russian
/// roulette.
pub(super) const SHADOW_ROULETTE: f32 = 0.3;

/// What of a shadow ray's way no medium decides.
struct Way {
    /// What surfaces and interior media let through.
    attenuation: Vec3,
    /// Where it goes straight through surfaces, if it does.
    passage: Option<Passage>,
}

/// [`Media::transmittance`], compiled once for all that asks seldom enough.
#[inline(never)]
pub(super) fn shadow<M: Media>(
    media: &M,
    (segment, threshold): (RaySegment<'_>, f32),
    beta: Vec3,
    sampler: &mut PathSampler,
    tally: &mut Tally,
) -> Shadow {
    media.transmittance(segment, threshold, beta, sampler, tally)
}

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// Adds the radiance scattered at a vertex from one light.
    ///
    /// `place`: the vertex's position, what of the ray that came there equiangular points cover,
    /// and the medium that scatters. `strongest`: largest channel of the throughput; `u`: numbers
    /// for the choice of the light and of sending a ray. `mixture`: how paths that go on from here
    /// are drawn to emissive volumes.
    #[inline(always)]
    pub(super) fn add_direct_light<V: PathVertex, R: Recorder>(
        &self,
        path: &Path<'_, W::Carried>,
        vertex: &V,
        (p, interval, scattered_by): (DVec3, Option<(f64, f64)>, StartCorrelation),
        (strongest, u): (f32, [f32; 2]),
        mixture: Option<&EmissionMixture>,
        tracing: &mut Tracing<'_, R>,
    ) {
        let Tracing { radiance, tally, sampler, recorder } = tracing;
        let sampler = &mut **sampler;
        let Some(choice) = self.lights.choose(p, |wi| vertex.eval(wi).1, u[0]) else {
            return;
        };
        let direction =
            if self.lights.have_extent() { [uniform(sampler), uniform(sampler)] } else { [0.0; 2] };
        let Some(light) = self.lights.sample(choice.index, p, direction, sampler) else {
            return;
        };
        let (value, size, own) = vertex.eval(light.wi);
        // The choice could not know where in an image the sample would lie; now it is known.
        let aimed = if light.everywhere { size / ISOTROPIC } else { 1.0 };
        let importance = choice.importance * strongest * aimed;
        // What a surface sends on is as dark as its albedo: noise is judged by that, not by
        // absolute light.
        let importance = if V::IN_MEDIUM { importance } else { importance.max(strongest) };
        let mut survival = (importance / SHADOW_IMPORTANCE).min(1.0);
        if V::IN_MEDIUM
            && let Some(cache) = self.radiance_cache
        {
            survival = cache.survival(p, path.expected_first, importance, survival);
        }
        // Stratified numbers cannot say what is very unlikely.
        let sent = if survival < MIN_STRATIFIED_SURVIVAL {
            happens(survival, sampler)
        } else {
            u[1] < survival
        };
        if !sent {
            return;
        }
        recorder.counters().shadow_rays += 1;
        let ray = Ray { origin: vertex.origin(p, light.wi), direction: light.wi };
        let way = if W::SURFACES && !(V::IN_MEDIUM && self.is_clear(path, &ray, light.distance)) {
            let Some(way) = self.way_to_light(path, vertex, &ray, &light, sampler) else {
                return;
            };
            Some(way)
        } else {
            None
        };
        let threshold = (SHADOW_ROULETTE / (importance / survival)).min(0.5);
        let segment = RaySegment { ray: &ray, start: scattered_by, t_max: light.distance };
        recorder.shadow_ray(&ray, light.distance, threshold);
        // A path that goes on towards the light carries the throughput behind the vertex: its
        // decisions along the way are weighed by that.
        let behind = path.beta * value;
        let shadow = match way.as_ref().and_then(|way| way.passage.as_ref()) {
            Some(passage) if self.media.starts_matter() => {
                passage.transmittance(&self.media, (segment, threshold), behind, sampler, tally)
            }
            // Most shadow rays of most scenes.
            _ if V::IN_MEDIUM => {
                self.media.transmittance(segment, threshold, behind, sampler, tally)
            }
            _ => shadow(&self.media, (segment, threshold), behind, sampler, tally),
        };
        if V::IN_MEDIUM {
            recorder.direct_light(DirectLight {
                survival,
                transmittance: shadow.transmittance.max_element(),
                unshadowed: luminance(light.weight) * ISOTROPIC / choice.probability,
            });
        }
        let mut weight = 1.0 / (choice.probability * survival);
        let mut arrives = shadow.transmittance * light.weight;
        if light.pdf > 0.0 {
            // Density of the same path under path sampling.
            let pdf = match mixture {
                Some(mixture) if W::SURFACES => {
                    self.lights.emissive_volumes().pdf(mixture, light.wi, own)
                }
                _ => own,
            };
            let pdf_light = light.pdf * choice.probability;
            if M::Channels::DECOUPLES {
                // Each channel decides for itself.
                let pdf_path = shadow.null_probability * pdf;
                arrives *= Vec3::splat(pdf_light) / (Vec3::splat(pdf_light) + pdf_path);
            } else {
                // Null decisions are weighted by the throughput of their channels.
                let nulls = if M::Channels::GREY {
                    shadow.null_probability.x
                } else {
                    shadow.null_probability.mean_by(behind)
                };
                weight *= pdf_light / (pdf_light + pdf * nulls);
            }
        }
        if V::IN_MEDIUM
            && let (Some(interval), Some(position)) = (interval, light.position)
        {
            let t = (p - path.ray.origin).length();
            weight *= 1.0 - self.equiangular_weight(&path.ray, interval, position, t) as f32;
        }
        if let Some(way) = way {
            arrives *= way.attenuation;
        }
        let light = behind * arrives * weight;
        *radiance += light;
        if let Some(layers) = recorder.layers() {
            layers.light(light, path.scatterings::<W>());
        }
    }

    /// Whether a ray from a medium interaction passes by all surfaces, outside of interior media.
    #[inline(always)]
    fn is_clear(&self, path: &Path<'_, W::Carried>, ray: &Ray, distance: f64) -> bool {
        W::of(&path.carried).is_none_or(|surfaces| surfaces.interiors.is_empty())
            && self
                .world
                .surfaces()
                .is_none_or(|surfaces| !surfaces.may_be_met(ray.origin, ray.direction, distance))
    }

    /// What of a shadow ray's way surfaces and interior media let through; `None` if nothing.
    #[inline(never)]
    fn way_to_light<V: PathVertex>(
        &self,
        path: &Path<'_, W::Carried>,
        vertex: &V,
        ray: &Ray,
        light: &LightSample,
        sampler: &mut PathSampler,
    ) -> Option<Way> {
        let interiors = &W::of(&path.carried)?.interiors;
        // A light without extent shines through panes; in scenes without panes none of this is
        // asked.
        if light.pdf == 0.0
            && let Some(surfaces) = self.world.panes()
        {
            let inside = vertex.interiors(interiors, light.wi);
            let from = (ray, vertex.surface());
            let passage = Passage::along(surfaces, from, light.distance, inside, sampler)?;
            return Some(Way { attenuation: passage.attenuation, passage: Some(passage) });
        }
        let layered = vertex
            .surface()
            .is_some_and(|surface| self.world.next_layer(surface, light.wi, sampler).is_some());
        if layered || self.world.occluded(ray, light.distance, light.end, sampler) {
            return None;
        }
        let mut attenuation = Vec3::ONE;
        if light.distance < f64::INFINITY
            && let Some(interior) = vertex.interior(interiors, light.wi)
        {
            // As for paths: a ray that goes on forever without a surface is in no interior medium.
            attenuation = interior::transmittance(interior, light.distance);
        }
        Some(Way { attenuation, passage: None })
    }

    /// Transmittance of what surfaces let through between `ray`'s origin and `distance`, outside of
    /// all interior media; `None` if nothing.
    pub(super) fn unhidden(
        &self,
        ray: &Ray,
        distance: f64,
        sampler: &mut PathSampler,
    ) -> Option<Vec3> {
        if let Some(surfaces) = self.world.panes() {
            let outside = MediumStack::new();
            let passage = Passage::along(surfaces, (ray, None), distance, outside, sampler)?;
            return Some(passage.attenuation);
        }
        (!self.world.occluded(ray, distance, None, sampler)).then_some(Vec3::ONE)
    }
}
