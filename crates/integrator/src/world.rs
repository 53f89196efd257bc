//! What a path can meet besides media: surfaces and light from volumes. Scenes without either run kernels in which none of this is compiled.

use crate::interior::Inside;
use crate::media::Ray;
use glam::{DVec3, Vec3};
use pileus_media::{EmissionField, PhaseAt};
use pileus_scene::{Bsdf, Hit, Interaction, Interior, Surfaces};
use rand_core::Rng;
use std::sync::Arc;

/// What scatters light at a vertex of a path.
pub(crate) trait Vertex {
    /// For light that arrives from `wi`: the value (a phase function, or a BSDF times the cosine), one number that stands for it, and the density with which
    /// paths are continued towards `wi`, 1/sr.
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32);

    /// Where a ray towards `wi` starts from a vertex at `p`.
    fn origin(&self, p: DVec3, wi: Vec3) -> DVec3;

    /// The surface that it is on.
    fn surface(&self) -> Option<&Interaction> {
        None
    }

    /// The body that a ray towards `wi` starts in, of a path that came in `inside`: across a surface it is another.
    fn body<'a>(&'a self, inside: &'a Inside, wi: Vec3) -> Option<&'a Interior>;

    /// All bodies that a ray towards `wi` starts in, of a path that came in `inside`.
    fn inside(&self, inside: &Inside, wi: Vec3) -> Inside;
}

/// A scattering in a medium.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InMedium<'a> {
    pub(crate) phase: PhaseAt<'a>,
    /// Propagation direction before the scattering.
    pub(crate) incoming: Vec3,
}

impl Vertex for InMedium<'_> {
    #[inline(always)]
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32) {
        let value = self.phase.eval(self.incoming, wi);
        (Vec3::splat(value), value, value)
    }

    #[inline(always)]
    fn origin(&self, p: DVec3, _: Vec3) -> DVec3 {
        p
    }

    #[inline(always)]
    fn body<'a>(&'a self, inside: &'a Inside, _: Vec3) -> Option<&'a Interior> {
        inside.last()
    }

    #[inline(always)]
    fn inside(&self, inside: &Inside, _: Vec3) -> Inside {
        inside.clone()
    }
}

/// A scattering in a medium or at a surface.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "two on the stack of a path")]
pub(crate) enum Anywhere<'a> {
    Medium(InMedium<'a>),
    Surface { bsdf: Bsdf, wo: Vec3, interaction: Interaction },
}

impl Vertex for Anywhere<'_> {
    #[inline]
    fn eval(&self, wi: Vec3) -> (Vec3, f32, f32) {
        match self {
            Anywhere::Medium(vertex) => vertex.eval(wi),
            Anywhere::Surface { bsdf, wo, .. } => {
                let (value, pdf) = bsdf.eval_pdf(*wo, wi);
                (value, luminance(value), pdf)
            }
        }
    }

    #[inline]
    fn origin(&self, p: DVec3, wi: Vec3) -> DVec3 {
        match self {
            Anywhere::Medium(_) => p,
            Anywhere::Surface { interaction, .. } => interaction.spawn(wi),
        }
    }

    #[inline]
    fn surface(&self) -> Option<&Interaction> {
        match self {
            Anywhere::Medium(_) => None,
            Anywhere::Surface { interaction, .. } => Some(interaction),
        }
    }

    #[inline]
    fn body<'a>(&'a self, inside: &'a Inside, wi: Vec3) -> Option<&'a Interior> {
        match self {
            Anywhere::Surface { wo, interaction, .. } if crosses(interaction, *wo, wi) => {
                inside.across(interaction)
            }
            _ => inside.last(),
        }
    }

    fn inside(&self, inside: &Inside, wi: Vec3) -> Inside {
        let mut inside = inside.clone();
        if let Anywhere::Surface { wo, interaction, .. } = self
            && crosses(interaction, *wo, wi)
        {
            inside.cross(interaction);
        }
        inside
    }
}

/// Whether light that comes from `wi` and leaves towards `wo` crosses the surface of a body.
#[inline]
fn crosses(interaction: &Interaction, wo: Vec3, wi: Vec3) -> bool {
    let normal = interaction.geometric_normal;
    !interaction.parameters.thin_walled && wi.dot(normal) * wo.dot(normal) < 0.0
}

/// Luminance of linear Rec. 709.
#[inline(always)]
pub(crate) fn luminance(c: Vec3) -> f32 {
    c.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// What a kernel is compiled with.
pub(crate) trait World: Sync {
    /// Whether there is anything: all else is left out if not.
    const WHOLE: bool;
    /// What scatters.
    type Vertex<'a>: Vertex + Copy;
    /// A scattering in a medium.
    fn in_medium(vertex: InMedium<'_>) -> Self::Vertex<'_>;
    /// A scattering at a surface.
    fn at_surface<'a>(bsdf: Bsdf, wo: Vec3, interaction: Interaction) -> Option<Self::Vertex<'a>>;
    /// The triangles.
    fn surfaces(&self) -> Option<&Surfaces>;
    /// Volumes that give off light.
    fn fires(&self) -> &[Arc<EmissionField>];

    /// The nearest surface on a ray; `camera`: it is still the camera's own, which backs of
    /// single-sided surfaces do not stop.
    #[inline(always)]
    fn intersect<R: Rng>(&self, ray: &Ray, camera: bool, rng: &mut R) -> Option<Hit> {
        if !Self::WHOLE {
            return None;
        }
        let surfaces = self.surfaces()?;
        if camera {
            return surfaces.seen(ray.origin, ray.direction, f64::INFINITY, rng);
        }
        surfaces.intersect(ray.origin, ray.direction, f64::INFINITY, rng)
    }

    /// The surfaces, if light may go straight through one of them.
    #[inline(always)]
    fn panes(&self) -> Option<&Surfaces> {
        if Self::WHOLE { self.surfaces().filter(|surfaces| surfaces.has_panes()) } else { None }
    }

    /// The surface that a ray meets next in the very place that it leaves: of faces that coincide the one behind.
    #[inline(always)]
    fn next_layer<R: Rng>(&self, from: &Interaction, wi: Vec3, rng: &mut R) -> Option<Hit> {
        if !Self::WHOLE {
            return None;
        }
        self.surfaces()?.next_layer(from, wi, rng)
    }

    /// Whether a surface hides what lies at `distance`, or at `end` if that is a point of an emissive triangle.
    #[inline(always)]
    fn occluded<R: Rng>(
        &self,
        ray: &Ray,
        distance: f64,
        end: Option<(DVec3, u32)>,
        rng: &mut R,
    ) -> bool {
        if !Self::WHOLE {
            return false;
        }
        let Some(surfaces) = self.surfaces() else { return false };
        match end {
            Some((end, emitter)) => surfaces.hides_lamp(ray.origin, end, emitter, rng),
            None => surfaces.occluded(ray.origin, ray.direction, distance, rng),
        }
    }
}

/// Nothing but media.
pub(crate) struct MediaAlone;

impl World for MediaAlone {
    const WHOLE: bool = false;
    type Vertex<'a> = InMedium<'a>;

    #[inline(always)]
    fn in_medium(vertex: InMedium<'_>) -> InMedium<'_> {
        vertex
    }

    #[inline(always)]
    fn at_surface<'a>(_: Bsdf, _: Vec3, _: Interaction) -> Option<InMedium<'a>> {
        None
    }

    #[inline(always)]
    fn surfaces(&self) -> Option<&Surfaces> {
        None
    }

    #[inline(always)]
    fn fires(&self) -> &[Arc<EmissionField>] {
        &[]
    }
}

/// Media, surfaces and fire.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whole<'a> {
    pub(crate) surfaces: Option<&'a Surfaces>,
    pub(crate) fires: &'a [Arc<EmissionField>],
}

impl World for Whole<'_> {
    const WHOLE: bool = true;
    type Vertex<'a> = Anywhere<'a>;

    fn in_medium(vertex: InMedium<'_>) -> Anywhere<'_> {
        Anywhere::Medium(vertex)
    }

    fn at_surface<'a>(bsdf: Bsdf, wo: Vec3, interaction: Interaction) -> Option<Anywhere<'a>> {
        Some(Anywhere::Surface { bsdf, wo, interaction })
    }

    fn surfaces(&self) -> Option<&Surfaces> {
        self.surfaces
    }

    fn fires(&self) -> &[Arc<EmissionField>] {
        self.fires
    }
}
