//! Shadow rays that pass panes: smooth thin walls and bodies of index 1 let light go straight on,
//! dimmed and tinted.
//!
//! A light without extent behind a pane is found by no other technique: no path runs into it. So
//! shadow rays to such lights carry what the delta lobes of all panes on their way would, and
//! nothing is counted twice. Lights with extent are met by the paths that pass the pane; shadow
//! rays to them are stopped by it, and what is drawn as a delta lobe has weight one.

use super::interior::{self, MediumStack};
use crate::media::{Media, Ray, RaySegment, Shadow, StartCorrelation};
use glam::Vec3;
use pileus_media::Tally;
use pileus_scene::{Bsdf, Interaction, Surfaces};
use rand_core::Rng;
use smallvec::SmallVec;

/// Panes after which a shadow ray counts as stopped: none of a scene has so many in a row, but a
/// ray has to end whatever the scene.
const MAX_PANES: usize = 1 << 16;

/// What a shadow ray has passed on its way to a light without extent.
#[derive(Debug, Clone)]
pub(crate) struct Passage {
    /// Share of light per channel that panes and the insides of bodies let through.
    pub(crate) attenuation: Vec3,
    /// Distances of the panes, ascending.
    crossed: SmallVec<[f64; 4]>,
}

impl Passage {
    /// Follows a ray that starts in `inside`, and on the surface `from` if that is one, up to
    /// `distance`; `None` if something stops it. What is there of surfaces that blend is drawn, so
    /// the mean is exact.
    pub(crate) fn along<R: Rng>(
        surfaces: &Surfaces,
        (ray, from): (&Ray, Option<&Interaction>),
        distance: f64,
        mut inside: MediumStack,
        rng: &mut R,
    ) -> Option<Passage> {
        let mut passage = Passage { attenuation: Vec3::ONE, crossed: SmallVec::new() };
        let (mut from, mut passed) = (from.copied(), 0.0);
        for _ in 0..MAX_PANES {
            let left = distance - passed;
            let hit = match &from {
                Some(from) => surfaces.intersect_from(from, ray.direction, left, rng),
                None => surfaces.intersect(ray.origin, ray.direction, left, rng),
            };
            if let Some(hit) = &hit
                && !surfaces.may_pass_straight(hit)
            {
                return None;
            }
            // As for paths: a ray that goes on forever without a surface is in no body.
            if let Some(body) = inside.last()
                && (hit.is_some() || left < f64::INFINITY)
            {
                let length = hit.as_ref().map_or(left, |hit| hit.t);
                passage.attenuation *= interior::transmittance(body, length);
            }
            let Some(hit) = hit else { return Some(passage) };
            let interaction = surfaces.interaction(&hit, ray.direction);
            passage.attenuation *= bsdf(&interaction).straight_through(-ray.direction);
            if !(passage.attenuation.max_element() > 0.0) {
                return None;
            }
            if !interaction.parameters.thin_walled {
                inside.cross(&interaction);
            }
            passed += hit.t;
            passage.crossed.push(passed);
            from = Some(interaction);
        }
        None
    }

    /// Transmittance along the whole ray of media for which it matters where a ray starts: it
    /// starts anew at every pane, as a path does that goes through, so that a sun of no size is the
    /// limit of small ones.
    pub(crate) fn transmittance<M: Media, R: Rng + Clone>(
        &self,
        media: &M,
        (segment, threshold): (RaySegment<'_>, f32),
        beta: Vec3,
        rng: &mut R,
        tally: &mut Tally,
    ) -> Shadow {
        let mut shadow = Shadow::CLEAR;
        let (mut begin, mut start): (f64, StartCorrelation) = (0.0, segment.start);
        for end in self.crossed.iter().copied().chain([segment.t_max]) {
            let ray = Ray { origin: segment.ray.at(begin), direction: segment.ray.direction };
            let part = RaySegment { ray: &ray, start, t_max: end - begin };
            shadow.transmittance *=
                media.transmittance(part, threshold, beta, rng, tally).transmittance;
            (begin, start) = (end, None);
        }
        shadow
    }
}

/// How the surface that a ray has hit scatters.
#[inline(always)]
pub(crate) fn bsdf(interaction: &Interaction) -> Bsdf {
    let side = if interaction.front_face { 1.0 } else { -1.0 };
    Bsdf::new(
        &interaction.parameters,
        interaction.shading_normal * side,
        interaction.geometric_normal * side,
        interaction.front_face,
    )
}
