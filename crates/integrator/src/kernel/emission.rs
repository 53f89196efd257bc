//! Light of emissive volumes along a flight.

use super::Kernel;
use super::direct::{SHADOW_ROULETTE, shadow};
use super::interior::{self, MediumStack};
use super::path::Tracing;
use super::recorder::Recorder;
use super::world::{World, luminance};
use crate::media::{Media, RaySegment};
use glam::Vec3;
use pileus_media::random::uniform;

/// Distance of the points on flights after the first, over that on the first: what is seen directly
/// is worth more of them.
const SPACING_AFTER_FIRST: f32 = 2.0;

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// Adds the light of emissive volumes along a flight with throughput `beta` that ends at
    /// `t_end` (and would have ended at the segment's end at last).
    ///
    /// Points lie at equal steps of a rate that bounds the emission's strength. Where flights end
    /// with the medium's own density and without weights, the points up to the end are counted as
    /// they are: a flight survives to each with the transmittance. Else one of all points is drawn,
    /// and the transmittance to it estimated.
    #[inline(never)]
    pub(super) fn add_emission<R: Recorder>(
        &self,
        (segment, t_end): (RaySegment<'_>, f64),
        (beta, bounces, scatterings): (Vec3, u32, u32),
        interiors: &MediumStack,
        tracing: &mut Tracing<'_, R>,
    ) {
        let Tracing { radiance, tally, sampler, recorder } = tracing;
        let spacing = if bounces == 0 { 1.0 } else { SPACING_AFTER_FIRST };
        let mut found = Vec3::ZERO;
        // One of all points by weighted reservoir sampling, for flights with weights.
        let (mut total, mut chosen) = (0.0f32, None);
        let analog = self.analog_flights && interiors.is_empty();
        let RaySegment { ray, t_max, .. } = segment;
        for emission in self.world.emissive_volumes() {
            let to = if analog { t_end } else { t_max };
            let u = uniform(*sampler);
            let at = (u, spacing);
            emission.sparse_points(ray.origin, ray.direction, to, at, tally, |point| {
                let light = point.contribution;
                if analog {
                    found += light;
                    return;
                }
                let strength = luminance(light);
                if strength > 0.0 {
                    total += strength;
                    if uniform(*sampler) * total < strength {
                        chosen = Some((point.t, light / strength));
                    }
                }
            });
        }
        if let Some((t, light)) = chosen {
            let segment = (RaySegment { t_max: t, ..segment }, SHADOW_ROULETTE);
            recorder.shadow_ray(ray, t, SHADOW_ROULETTE);
            let shadow = shadow(&self.media, segment, beta, sampler, tally);
            let interior = interiors.last().map_or(Vec3::ONE, |i| interior::transmittance(i, t));
            found += light * total * shadow.transmittance * interior;
        }
        *radiance += beta * found;
        if let Some(layers) = recorder.layers() {
            layers.light(beta * found, scatterings);
        }
    }
}
