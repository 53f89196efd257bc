//! Volumes that give off light, as lights.

use glam::{DVec3, Vec3};
use pileus_media::EmissionDirections;
use pileus_media::random::uniform;
use pileus_scene::{Scene, Volume};
use rand_core::Rng;
use std::sync::Arc;

/// A volume that gives off light. Shadow rays are sent in a direction and collect what lies along it, as paths do.
#[derive(Debug, Clone)]
pub(crate) struct Fire {
    directions: Arc<EmissionDirections>,
    /// Number among the scene's fires.
    number: usize,
    centre: DVec3,
    /// Square of half its size: within it, it is no nearer.
    size2: f64,
    strength: f32,
}

impl Fire {
    /// Fire number `number` of a scene, seen through all its volumes; `None` if nothing emits.
    pub(crate) fn new(scene: &Scene, number: usize) -> Option<Fire> {
        let field = scene.fires().nth(number)?;
        let (low, high) = field.bounds_world()?;
        let strength = field.power() as f32;
        if !(strength > 0.0) {
            return None;
        }
        // Somewhat more than the fire, as the tables are.
        let more = high - low;
        let near = |volume: &&Volume| {
            volume.medium.bounds_world().is_none_or(|(from, to)| {
                from.cmple(high + more).all() && to.cmpge(low - more).all()
            })
        };
        let media: Vec<_> = scene.volumes.iter().filter(near).map(|v| &v.medium).collect();
        let grey: Vec<f64> = media
            .iter()
            .map(|medium| f64::from(medium.relative_extinction().element_sum()) / 3.0)
            .collect();
        let sigma_t = |p: DVec3| {
            media.iter().zip(&grey).map(|(medium, grey)| grey * medium.sigma_t_at(p)).sum()
        };
        Some(Fire {
            directions: Arc::new(EmissionDirections::new(field, sigma_t)?),
            number,
            centre: 0.5 * (low + high),
            size2: (0.5 * (high - low)).length_squared() / 3.0,
            strength,
        })
    }

    pub(crate) fn number(&self) -> usize {
        self.number
    }

    /// Power over the square of the distance, unshadowed.
    pub(crate) fn received(&self, p: DVec3) -> f32 {
        let distance2 = (self.centre - p).length_squared().max(self.size2).max(1e-30);
        (f64::from(self.strength) / distance2) as f32
    }

    /// A direction from `p` and its density, 1/sr.
    pub(crate) fn sample<R: Rng + ?Sized>(
        &self,
        p: DVec3,
        u: [f32; 2],
        rng: &mut R,
    ) -> Option<(Vec3, f32)> {
        let view = self.directions.view(p);
        let wi = self.directions.sample(&view, [u[0], uniform(rng), u[1], uniform(rng)])?;
        let pdf = self.directions.pdf(&view, wi);
        (pdf > 0.0 && pdf.is_finite()).then_some((wi, pdf))
    }

    /// Density of [`sample`](Fire::sample), 1/sr.
    pub(crate) fn pdf(&self, p: DVec3, wi: Vec3) -> f32 {
        self.directions.pdf(&self.directions.view(p), wi)
    }
}
