//! Volumes that emit light, as what paths are drawn to.
//!
//! No shadow rays are sent to emissive volumes: a share of the directions in which paths go on is
//! drawn by what the vertex sees of them, and the flight collects whatever lies on its way, light
//! that smoke scatters included. The density of the mixture is known, so that nothing else needs
//! weights.

use glam::{DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_media::emission::{EmissionDirections, EmissionView};
use pileus_media::phase::ISOTROPIC;
use pileus_scene::{Scene, Volume};
use smallvec::SmallVec;
use std::sync::Arc;

/// Share of directions drawn by emissive volumes, where they are all the light there is.
const SHARE_AT_SURFACES: f32 = 0.75;
const SHARE_IN_MEDIA: f32 = 0.5;

/// Part of that which is kept whatever other light there is: it may not arrive.
const LEAST_PART: f32 = 1.0 / 3.0;

/// All emissive volumes of a scene.
#[derive(Debug, Clone, Default)]
pub(crate) struct EmissiveVolumes {
    volumes: Vec<EmissiveVolume>,
}

#[derive(Debug, Clone)]
struct EmissiveVolume {
    directions: Arc<EmissionDirections>,
    centre: DVec3,
    /// Square of half its size: within it, it is no nearer.
    size2: f64,
    power: f64,
}

/// How a vertex is drawn to emissive volumes.
#[derive(Debug, Clone)]
pub(crate) struct EmissionMixture {
    /// Probability of drawing a direction by the emissive volumes.
    pub(crate) share: f32,
    /// Of each volume: the probability of its choice, and how it is seen.
    views: SmallVec<[(f32, EmissionView); 1]>,
}

impl EmissiveVolume {
    /// An emissive volume seen through all volumes of a scene; `None` if nothing emits.
    fn new(scene: &Scene, field: &pileus_media::emission::EmissionField) -> Option<EmissiveVolume> {
        let Bounds3 { low, high } = field.bounds_world()?;
        // Somewhat more than the volume, as the tables are.
        let more = high - low;
        let near = |volume: &&Volume| {
            volume.medium.bounds_world().is_none_or(|Bounds3 { low: from, high: to }| {
                from.cmple(high + more).all() && to.cmpge(low - more).all()
            })
        };
        let media: Vec<_> = scene.volumes.iter().filter(near).map(|v| &v.medium).collect();
        let mean: Vec<f64> = media
            .iter()
            .map(|medium| f64::from(medium.chromatic_ratio().element_sum()) / 3.0)
            .collect();
        let sigma_t = |p: DVec3| {
            media.iter().zip(&mean).map(|(medium, mean)| mean * medium.sigma_t_at(p)).sum()
        };
        Some(EmissiveVolume {
            directions: Arc::new(EmissionDirections::new(field, sigma_t)?),
            centre: 0.5 * (low + high),
            size2: (0.5 * (high - low)).length_squared() / 3.0,
            power: field.power(),
        })
    }

    /// Power over the square of the distance, unshadowed.
    fn received(&self, p: DVec3) -> f32 {
        let distance2 = (self.centre - p).length_squared().max(self.size2).max(1e-30);
        (self.power / distance2) as f32
    }
}

impl EmissiveVolumes {
    pub(crate) fn new(scene: &Scene) -> EmissiveVolumes {
        EmissiveVolumes {
            volumes: scene
                .emissive_volumes()
                .filter_map(|field| EmissiveVolume::new(scene, field))
                .collect(),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.volumes.is_empty()
    }

    /// How a vertex at `p`, in a medium or at a surface, is drawn to the emissive volumes beside
    /// other light of which it would scatter `others` if it did so in all directions alike. A
    /// function of these alone; `None` if none is seen.
    pub(crate) fn emission_mixture(
        &self,
        p: DVec3,
        in_medium: bool,
        others: f32,
    ) -> Option<EmissionMixture> {
        let mut views: SmallVec<[(f32, EmissionView); 1]> = self
            .volumes
            .iter()
            .map(|volume| {
                let view = volume.directions.view(p);
                (if view.sees() { volume.received(p) } else { 0.0 }, view)
            })
            .collect();
        let total: f32 = views.iter().map(|(received, _)| received).sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        for (received, _) in &mut views {
            *received /= total;
        }
        let part = total * ISOTROPIC / (total * ISOTROPIC + others.max(0.0));
        let most = if in_medium { SHARE_IN_MEDIA } else { SHARE_AT_SURFACES };
        Some(EmissionMixture { share: most * (LEAST_PART + (1.0 - LEAST_PART) * part), views })
    }

    /// A direction towards an emissive volume; `None`, rarely, where rounding leaves none: the path
    /// ends then.
    pub(crate) fn sample(&self, mixture: &EmissionMixture, mut u: [f32; 4]) -> Option<Vec3> {
        for (volume, (probability, view)) in self.volumes.iter().zip(&mixture.views) {
            if u[0] < *probability {
                u[0] = (u[0] / probability).min(1.0 - f32::EPSILON);
                return volume.directions.sample(view, u);
            }
            u[0] -= probability;
        }
        None
    }

    /// Density of a direction in which a path goes on, 1/sr, if scattering alone draws it with
    /// density `own`.
    pub(crate) fn pdf(&self, mixture: &EmissionMixture, wi: Vec3, own: f32) -> f32 {
        let mut pdf = 0.0;
        for (volume, (probability, view)) in self.volumes.iter().zip(&mixture.views) {
            if *probability > 0.0 {
                pdf += probability * volume.directions.pdf(view, wi);
            }
        }
        mixture.share * pdf + (1.0 - mixture.share) * own
    }
}
