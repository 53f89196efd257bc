//! Equiangular points near point-like lights [Kulla and Fajardo 2012], weighted against flights by
//! a density that stands for theirs.

use super::Kernel;
use super::direct::{SHADOW_ROULETTE, shadow};
use super::path::{Path, Tracing};
use super::recorder::Recorder;
use super::world::World;
use crate::media::{Media, Ray, RaySegment};
use glam::{DVec3, Vec3};
use pileus_media::distance::Equiangular;
use pileus_media::random::uniform;

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// What of a path's next ray equiangular points cover, up to the surface at `t_surface`.
    #[inline(never)]
    pub(super) fn equiangular_interval(
        &self,
        path: &Path<'_, W::Carried>,
        t_surface: f64,
    ) -> Option<(f64, f64)> {
        // Equal angles ignore interior media: inside one, flights do alone.
        if W::of(&path.carried).is_some_and(|surfaces| !surfaces.interiors.is_empty()) {
            return None;
        }
        self.media.extent(&path.ray, t_surface)
    }

    /// Adds light by one point of the interval, unless the path may not scatter any more.
    #[inline(never)]
    pub(super) fn add_equiangular_light<R: Recorder>(
        &self,
        path: &Path<'_, W::Carried>,
        interval: Option<(f64, f64)>,
        tracing: &mut Tracing<'_, R>,
    ) {
        let scatterings = path.scatterings::<W>();
        if scatterings < self.limits.max_bounces()
            && let Some(interval) = interval
        {
            let light = self.equiangular_light(&path.ray, interval, path.beta, tracing);
            let light = light.unwrap_or(Vec3::ZERO);
            tracing.radiance += light;
            if let Some(layers) = tracing.recorder.layers() {
                layers.light(light, scatterings + 1);
            }
        }
    }

    /// Weight of an equiangular point at `t` against a flight that ends there: the balance
    /// heuristic between the density of the points and that of flights in a medium of typical
    /// extinction. A function of ray, light and `t` alone, the same for both techniques: whatever
    /// it is, the sum of both is unbiased.
    #[inline(never)]
    pub(super) fn equiangular_weight(
        &self,
        ray: &Ray,
        interval: (f64, f64),
        light: DVec3,
        t: f64,
    ) -> f64 {
        let Some(points) = Equiangular::new(ray.origin, ray.direction, light, interval) else {
            return 0.0;
        };
        let share = points.received() / self.received_from_all(ray, interval);
        let pdf = share * points.pdf(t);
        let flights = self.typical_sigma_t * libm::exp(-self.typical_sigma_t * (t - interval.0));
        if pdf > 0.0 { pdf / (pdf + flights) } else { 0.0 }
    }

    /// Sum over the point-like lights of what an interval of a ray receives: a light is chosen in
    /// proportion.
    fn received_from_all(&self, ray: &Ray, interval: (f64, f64)) -> f64 {
        self.lights
            .positions()
            .filter_map(|(_, light)| Equiangular::new(ray.origin, ray.direction, light, interval))
            .map(|points| points.received())
            .sum()
    }

    /// Radiance scattered into a ray from one point-like light at one point seen from it at equal
    /// angles, with its weight against flights.
    fn equiangular_light<R: Recorder>(
        &self,
        ray: &Ray,
        interval: (f64, f64),
        beta: Vec3,
        tracing: &mut Tracing<'_, R>,
    ) -> Option<Vec3> {
        let Tracing { tally, sampler, recorder, .. } = tracing;
        let sampler = &mut **sampler;
        let total = self.received_from_all(ray, interval);
        let mut u = f64::from(uniform(sampler)) * total;
        let mut chosen = None;
        for (index, light) in self.lights.positions() {
            if let Some(points) = Equiangular::new(ray.origin, ray.direction, light, interval) {
                chosen = Some((index, light, points));
                if u < points.received() {
                    break;
                }
                u -= points.received();
            }
        }
        let (t, Some((index, light, points))) = (uniform(sampler), chosen) else {
            return None;
        };
        let t = points.sample(t);
        let weight = self.equiangular_weight(ray, interval, light, t);
        let pdf = points.received() / total * points.pdf(t);
        let p = ray.at(t);
        let sample = self.lights.sample_position(index, p)?;
        let mut scattered = Vec3::ZERO;
        self.media.scattering(p, ray.direction, sampler, |sigma_s, phase| {
            scattered += sigma_s * phase.eval(ray.direction, sample.wi);
        });
        tally.lookups += 1;
        let unshadowed = beta * scattered * sample.weight * (weight / pdf) as f32;
        if !(unshadowed.abs().max_element() > 0.0) {
            return None;
        }
        recorder.counters().shadow_rays += 1;
        let to_light = Ray { origin: p, direction: sample.wi };
        let passed = self.unhidden(&to_light, sample.distance, sampler)?;
        // The plan keeps transmittance functions that are not exponential away from these points:
        // where rays start does not matter.
        let mut transmittance = |ray: &Ray, t_max| {
            recorder.shadow_ray(ray, t_max, SHADOW_ROULETTE);
            let segment = (RaySegment { ray, start: None, t_max }, SHADOW_ROULETTE);
            shadow(&self.media, segment, beta, sampler, tally).transmittance
        };
        let there = transmittance(ray, t);
        if there == Vec3::ZERO {
            return None;
        }
        Some(unshadowed * there * transmittance(&to_light, sample.distance) * passed)
    }
}
