//! What a path does at surfaces. Out of line, so that paths in media pay for none of it.

use super::Kernel;
use super::interior::MediumStack;
use super::limits::Cut;
use super::passage::bsdf;
use super::path::{DirectionSample, Path, PathVertex, PreviousVertex, Tracing, weights_of_path};
use super::recorder::Recorder;
use super::world::{World, luminance};
use crate::media::channels::ChannelMode;
use crate::media::{Media, Ray};
use crate::sampler::PathSampler;
use glam::{DVec3, Vec3};
use pileus_media::random::uniform;
use pileus_scene::{Bsdf, Hit, Interaction, Interior};

/// What a path carries on account of surfaces.
#[derive(Debug, Clone)]
pub(crate) struct SurfacePath {
    /// The interior media that it is in.
    pub(super) interiors: MediumStack,
    /// Whether its ray is still the camera's.
    pub(super) camera: bool,
    /// How many surfaces it went straight through: these are no bounces to `max_bounces`.
    pub(super) straight: u32,
    /// What directions drawn towards emissive volumes have put on the throughput.
    pub(super) drawn: f32,
    /// Of faces that coincide, the one after the one that the path has left.
    pub(super) layer: Option<Hit>,
    /// The surface that it left last.
    pub(super) vertex: Option<SurfaceVertex>,
}

impl SurfacePath {
    /// Of the camera's rays where nothing is around them.
    #[inline(always)]
    pub(super) fn begin() -> SurfacePath {
        SurfacePath {
            interiors: MediumStack::new(),
            camera: true,
            straight: 0,
            drawn: 1.0,
            layer: None,
            vertex: None,
        }
    }
}

/// A scattering at a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfaceVertex {
    bsdf: Bsdf,
    wo: Vec3,
    interaction: Interaction,
}

/// Whether light that comes from `wi` and leaves towards `wo` crosses the boundary of an interior
/// medium.
#[inline]
fn crosses(interaction: &Interaction, wo: Vec3, wi: Vec3) -> bool {
    let normal = interaction.geometric_normal;
    !interaction.parameters.thin_walled && wi.dot(normal) * wo.dot(normal) < 0.0
}

impl PathVertex for SurfaceVertex {
    const IN_MEDIUM: bool = false;

    #[inline]
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32) {
        let (value, pdf) = self.bsdf.eval_pdf(self.wo, wi);
        (value, luminance(value), pdf)
    }

    #[inline]
    fn sample(&self, [u0, u1]: [f32; 2], sampler: &mut PathSampler) -> Option<DirectionSample> {
        let sample = self.bsdf.sample(self.wo, [u0, u1, uniform(sampler)])?;
        let transmitted = sample.transmitted;
        Some(DirectionSample {
            wi: sample.wi,
            pdf: sample.pdf,
            weight: sample.weight,
            transmitted,
            straight: transmitted && sample.delta && self.bsdf.passes_straight(),
        })
    }

    #[inline]
    fn scatters(&self) -> bool {
        !self.bsdf.is_delta()
    }

    #[inline]
    fn origin(&self, _: DVec3, wi: Vec3) -> DVec3 {
        self.interaction.spawn(wi)
    }

    #[inline]
    fn surface(&self) -> Option<&Interaction> {
        Some(&self.interaction)
    }

    #[inline]
    fn interior<'a>(&'a self, interiors: &'a MediumStack, wi: Vec3) -> Option<&'a Interior> {
        if crosses(&self.interaction, self.wo, wi) {
            interiors.across(&self.interaction)
        } else {
            interiors.last()
        }
    }

    fn interiors(&self, interiors: &MediumStack, wi: Vec3) -> MediumStack {
        let mut interiors = interiors.clone();
        if crosses(&self.interaction, self.wo, wi) {
            interiors.cross(&self.interaction);
        }
        interiors
    }
}

impl<M: Media, W: World> Kernel<'_, M, W> {
    /// The surface at which a ray ends.
    #[inline(always)]
    pub(super) fn next_surface(
        &self,
        ray: &Ray,
        carried: &mut W::Carried,
        sampler: &mut PathSampler,
    ) -> Option<Hit> {
        let surfaces = W::of_mut(carried)?;
        let (layer, camera) = (surfaces.layer.take(), surfaces.camera);
        let hit = layer.or_else(|| self.world.intersect(ray, camera, sampler));
        if hit.is_none() {
            // Interior media end at their surface: a ray that meets none is in none, whatever holes
            // it came through.
            surfaces.interiors.clear();
        }
        hit
    }

    /// A path has come to a surface; false if it ends there. `met`: the throughput with which layers
    /// hear of it; `null_probability`: of its flight.
    #[inline(never)]
    pub(super) fn surface_event<'k, R: Recorder>(
        &'k self,
        path: &mut Path<'k, W::Carried>,
        (hit, met): (&Hit, Vec3),
        null_probability: <M::Channels as ChannelMode>::Nulls,
        tracing: &mut Tracing<'_, R>,
    ) -> bool {
        let Some(surfaces) = self.world.surfaces() else { return false };
        let interaction = surfaces.interaction(hit, path.ray.direction);
        if interaction.emission != Vec3::ZERO {
            let cos = interaction.geometric_normal.dot(path.ray.direction);
            let met = (hit.t, interaction.emitter, cos);
            let weight = self.weight_of_emissive_triangle(path, met, null_probability);
            let light = path.beta * interaction.emission * weight;
            tracing.radiance += light;
            if let Some(layers) = tracing.recorder.layers() {
                layers.light(light, path.scatterings::<W>());
            }
        }
        if path.bounces == 0
            && let Some(layers) = tracing.recorder.layers()
        {
            layers.first_at_surface(&interaction, met);
        }
        let wo = -path.ray.direction;
        let bsdf = bsdf(&interaction);
        let p = interaction.p;
        let vertex = SurfaceVertex { bsdf, wo, interaction };
        if path.bounces >= path.next_look
            && let Some(cut) = self.cut(path, &tracing.tally)
        {
            path.bounces += 1;
            // What goes straight through a pane has not been scattered: no limit on scatterings
            // stops it.
            let straight =
                if cut == Cut::MaxBounces { bsdf.straight_through(wo) } else { Vec3::ZERO };
            if straight != Vec3::ONE {
                tracing.recorder.counters().count_cut(cut);
            }
            path.beta *= straight;
            if path.beta == Vec3::ZERO {
                return false;
            }
            let direction = path.ray.direction;
            if let Some(surfaces) = W::of_mut(&mut path.carried) {
                surfaces.straight += 1;
                surfaces.interiors.pass_through(&interaction);
                surfaces.layer = self.world.next_layer(&interaction, direction, tracing.sampler);
                surfaces.vertex = Some(vertex);
            }
            path.previous = Some(PreviousVertex { p, pdf: 0.0, medium: None });
            path.ray = Ray { origin: interaction.spawn(direction), direction };
            path.start = None;
            return true;
        }
        path.bounces += 1;
        if !self.scatter(path, &vertex, (p, None, None), tracing) {
            return false;
        }
        if self.mis
            && let Some(surfaces) = W::of_mut(&mut path.carried)
        {
            surfaces.vertex = Some(vertex);
        }
        true
    }

    /// Weight of an emissive triangle that a path has run into, per channel: its distance, its
    /// number and the cosine there.
    #[inline]
    fn weight_of_emissive_triangle(
        &self,
        path: &Path<'_, W::Carried>,
        (t, emitter, cos): (f64, Option<u32>, f32),
        null_probability: <M::Channels as ChannelMode>::Nulls,
    ) -> Vec3 {
        let (Some(previous), Some(emitter)) = (&path.previous, emitter) else { return Vec3::ONE };
        let Some((index, pdf)) = self.lights.met_emissive_triangle(emitter, previous.p, t, cos)
        else {
            return Vec3::ONE;
        };
        let pdf_light = pdf * self.probability(index, previous, &path.carried);
        weights_of_path(null_probability, previous.pdf, pdf_light)
    }
}
