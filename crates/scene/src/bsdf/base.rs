//! The metallic-roughness base of glTF: facets that reflect and let through, and two diffuse lobes.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::compensation::{ReflectionAlbedo, multiple_bounces};
use super::dielectric::{Interface, contrast};
use super::fresnel::{Dielectric, SCHLICK_AVERAGE, at_normal, schlick};
use super::ggx::Ggx;
use crate::surface::SurfaceParameters;

/// Below this product of width and contrast of indices a refracting body bends less than its facets
/// can be told apart by.
const STRAIGHT: f32 = 1e-4;

/// What becomes of the light that a dielectric lets through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Passing {
    /// It goes straight on: a smooth thin wall, or a body of index 1 whatever its roughness.
    Straight,
    /// It is bent into one direction: a smooth body.
    Bent,
    /// It leaves in many directions.
    Scattered,
}

impl Passing {
    /// Of a surface of a perceptual roughness in [0, 1] that bounds a body of an index, at least 1,
    /// or is a thin wall.
    pub(crate) fn of(roughness: f32, body: Option<f32>) -> Passing {
        Passing::at_facets(Ggx::new(roughness), body)
    }

    #[inline(always)]
    fn at_facets(ggx: Option<Ggx>, body: Option<f32>) -> Passing {
        match body.map(contrast) {
            Some(0.0) => Passing::Straight,
            Some(contrast) if ggx.is_none_or(|g| g.alpha() * contrast < STRAIGHT) => Passing::Bent,
            None if ggx.is_none() => Passing::Straight,
            _ => Passing::Scattered,
        }
    }
}

/// Everything below sheen and coat.
///
/// Light meets facets first: metal and dielectric share one distribution, their Fresnel factors are
/// added. What the dielectric lets through is scattered diffusely, refracted (a body) or passes
/// straight (a thin wall). Diffuse light leaves through the same facets:
/// `(1 - E(o)) (1 - E(i)) / (pi (1 - E_avg))` with the albedo `E` of the dielectric's reflection
/// (Kulla and Conty 2017 after Kelemen and Szirmay-Kalos 2001), reciprocal, and together with the
/// reflection exactly 1 for white.
#[derive(Debug, Clone, Copy)]
pub(super) struct Base {
    ggx: Option<Ggx>,
    albedo: ReflectionAlbedo,
    /// Fresnel factor of metal and of dielectrics after Schlick: `[0] + [1] schlick`.
    reflection: [Vec3; 2],
    /// A body's interface and its share of the surface.
    body: Option<(Interface, f32)>,
    /// Colour and share of what is let through, zero if nothing.
    passed: Vec3,
    /// Whether that is a delta lobe.
    passed_is_delta: bool,
    /// Whether it goes straight on.
    straight: bool,
    look: Dielectric,
    /// Albedo of the dielectric's reflection, strongest channel: `[0] + [1] first + [2] second` of
    /// [`ReflectionAlbedo`].
    layer: [f32; 3],
    /// Factors of the cosine-shaped lobes, normalised: diffuse light and that of several bounces,
    /// this side and the other.
    diffuse: [Vec3; 2],
    multiple: [Vec3; 2],
}

/// What the base says about a viewer's direction.
pub(super) struct BaseView {
    /// Share of light that the facets do not reflect, and that is lost by single bounces.
    through: [f32; 2],
    /// Estimates of the albedos of the lobes, mean over channels: in proportion to them lobes are
    /// drawn.
    pub facets: f32,
    pub passed: f32,
    pub cosine: [f32; 2],
}

impl Base {
    pub(super) fn new(p: &SurfaceParameters, entering: bool) -> Base {
        let color = p.base_color;
        let (metal, dielectric) = (p.metallic, 1.0 - p.metallic);
        let ggx = Ggx::new(p.roughness);
        let albedo = ReflectionAlbedo::new(p.roughness, ggx);
        let [one, grazing] = albedo.average();

        let f0 = (at_normal(p.ior) * p.specular_color).clamp(Vec3::ZERO, Vec3::ONE);
        let look = Dielectric { f0, strength: p.specular };
        // The infinite index stands for old materials that know no bodies.
        let refracts = p.transmission > 0.0 && metal < 1.0 && !p.thin_walled && p.ior.is_finite();
        let body =
            refracts.then(|| (Interface::new(p.ior, look, entering), dielectric * p.transmission));
        let schlicks = if refracts { dielectric * (1.0 - p.transmission) } else { dielectric };
        let passed = dielectric * p.transmission * color;
        let passing = Passing::at_facets(ggx, refracts.then_some(p.ior));

        let bounces = |f0: Vec3, strength: f32| {
            multiple_bounces(strength * (f0 + (Vec3::ONE - f0) * SCHLICK_AVERAGE), one)
        };
        let dielectric_bounces = bounces(f0, p.specular);
        let (top, bounced) = (look.f0_max(), dielectric_bounces.max_element());
        let layer = [bounced, p.specular * top - bounced, p.specular * (1.0 - top)];
        let layer_average = layer[0] + layer[1] * one + layer[2] * grazing;

        let scale =
            dielectric * (1.0 - p.transmission) * FRAC_1_PI / (1.0 - layer_average).max(1e-6);
        let transmitted = p.diffuse_transmission;
        let diffuse = [
            scale * (1.0 - transmitted) * color,
            scale * transmitted * p.diffuse_transmission_color,
        ];
        let multiple = if ggx.is_some() {
            let scale = FRAC_1_PI / (1.0 - one).max(1e-6);
            let through = if refracts { Vec3::ZERO } else { passed * (1.0 - bounced).max(0.0) };
            [scale * (metal * bounces(color, 1.0) + schlicks * dielectric_bounces), scale * through]
        } else {
            [Vec3::ZERO; 2]
        };
        Base {
            ggx,
            albedo,
            reflection: [
                metal * color + schlicks * p.specular * f0,
                metal * (Vec3::ONE - color) + schlicks * p.specular * (Vec3::ONE - f0),
            ],
            body,
            passed,
            passed_is_delta: passing != Passing::Scattered,
            straight: passing == Passing::Straight && passed.max_element() > 0.0,
            look,
            layer,
            diffuse,
            multiple,
        }
    }

    /// The distribution of facets; `None` for a mirror.
    #[inline]
    pub(super) fn ggx(&self) -> Option<&Ggx> {
        self.ggx.as_ref()
    }

    /// Whether light crosses a refracting interface, so that one side is inside of a body.
    #[inline]
    pub(super) fn is_body(&self) -> bool {
        self.body.is_some()
    }

    /// Whether there is light that goes straight on, as if nothing were there that bends it.
    #[inline]
    pub(super) fn is_straight(&self) -> bool {
        self.straight
    }

    /// Whether all lobes are delta lobes.
    pub(super) fn is_delta(&self) -> bool {
        let passes = self.passed.max_element() > 0.0;
        self.ggx.is_none()
            && !self.is_cosine(0)
            && !self.is_cosine(1)
            && (!passes || self.passed_is_delta)
    }

    /// Whether there is a cosine-shaped lobe on this side (0) or the other (1).
    #[inline]
    fn is_cosine(&self, side: usize) -> bool {
        (self.diffuse[side] + self.multiple[side]).max_element() > 0.0
    }

    /// Whether light from the other side can be seen without a delta lobe.
    #[inline]
    pub(super) fn transmits(&self) -> bool {
        self.is_cosine(1) || !self.passed_is_delta && self.passed.max_element() > 0.0
    }

    /// Shares of light not reflected by the dielectric, and lost to several bounces.
    #[inline]
    fn through(&self, [one, grazing]: [f32; 2]) -> [f32; 2] {
        let layer = self.layer[0] + self.layer[1] * one + self.layer[2] * grazing;
        [(1.0 - layer).max(0.0), (1.0 - one).max(0.0)]
    }

    /// What is let through by a thin wall's facet, beside its colour.
    #[inline]
    fn through_thin(&self, schlick: f32) -> f32 {
        let f0 = self.look.f0_max();
        (1.0 - self.look.strength * (f0 + (1.0 - f0) * schlick)).max(0.0)
    }

    /// What a facet reflects and lets through, per channel, at the cosine between `wo` and it.
    #[inline]
    pub(super) fn facet(&self, cos: f32) -> (Vec3, Vec3) {
        let s = schlick(cos);
        let mut reflected = self.reflection[0] + self.reflection[1] * s;
        let through = match &self.body {
            Some((interface, share)) => {
                let (body, through) = interface.split(cos);
                reflected += *share * body;
                through
            }
            None => self.through_thin(s),
        };
        (reflected, self.passed * through)
    }

    /// Probability that a drawn facet reflects.
    #[inline]
    pub(super) fn reflects(&self, (reflected, passed): (Vec3, Vec3)) -> f32 {
        if self.passed_is_delta {
            return 1.0;
        }
        let (r, t) = (reflected.element_sum(), passed.element_sum());
        if r + t > 0.0 { r / (r + t) } else { 1.0 }
    }

    /// Lookups for a viewer at this cosine in (0, 1].
    #[inline]
    pub(super) fn view(&self, cos: f32) -> BaseView {
        let [one, grazing] = self.albedo.at(cos);
        let through = self.through([one, grazing]);
        let mean = |v: Vec3| v.element_sum() * (1.0 / 3.0);
        let mut facets = mean(self.reflection[0] * one + self.reflection[1] * grazing);
        let passed = match &self.body {
            Some((interface, share)) => {
                let (reflected, through) = interface.split(cos);
                facets += share * mean(reflected);
                mean(self.passed) * through
            }
            None if self.ggx.is_none() => mean(self.passed) * self.through_thin(grazing),
            None => {
                let (f0, strength) = (self.look.f0_max(), self.look.strength);
                let reflected = strength * (f0 * one + (1.0 - f0) * grazing);
                mean(self.passed) * (one - reflected).max(0.0)
            }
        };
        let cosine = |side: usize| {
            let pi = std::f32::consts::PI;
            // Diffuse light is spread so that all of `through` leaves; the mean of the other factor
            // is in the scale.
            let (d, m) = (self.diffuse[side], self.multiple[side]);
            let [pd, pm] = [through[0] * pi * mean(d), through[1] * pi * mean(m)];
            let [one, grazing] = self.albedo.average();
            let [ad, am] = self.through([one, grazing]);
            pd * ad + pm * am
        };
        let is = [self.is_cosine(0), self.is_cosine(1)];
        let cosine = [0, 1].map(|side| if is[side] { cosine(side) } else { 0.0 });
        if self.passed_is_delta {
            BaseView { through, facets, passed, cosine }
        } else {
            BaseView { through, facets: facets + passed, passed: 0.0, cosine }
        }
    }

    /// Cosine-shaped lobes towards a cosine `cos_i` in (0, 1], this side (0) or the other (1),
    /// 1/sr.
    #[inline]
    pub(super) fn cosine(&self, view: &BaseView, side: usize, cos_i: f32) -> Vec3 {
        if !self.is_cosine(side) {
            return Vec3::ZERO;
        }
        let [diffuse, multiple] = self.through(self.albedo.at(cos_i));
        let value = self.diffuse[side] * (view.through[0] * diffuse)
            + self.multiple[side] * (view.through[1] * multiple);
        if side == 0 { value } else { value * self.radiance_scale() }
    }

    /// Reflection by facets, 1/sr, and the density of drawing it given that a facet is drawn.
    #[inline]
    pub(super) fn reflected(&self, o: Vec3, i: Vec3, h: Vec3) -> (Vec3, f32) {
        let Some(ggx) = &self.ggx else { return (Vec3::ZERO, 0.0) };
        let facet = self.facet(o.dot(h));
        let value = facet.0 * (ggx.density(h) * ggx.visibility(o.z, i.z));
        (value, ggx.pdf_mirrored(o.z, h) * self.reflects(facet))
    }

    /// Light let through by rough facets from `i` below, 1/sr, and the density of drawing it given
    /// that a facet is drawn.
    #[inline]
    pub(super) fn transmitted(&self, o: Vec3, i: Vec3) -> (Vec3, f32) {
        let Some(ggx) = self.ggx.as_ref().filter(|_| !self.passed_is_delta) else {
            return (Vec3::ZERO, 0.0);
        };
        match &self.body {
            Some((interface, _)) => {
                let Some(bent) = interface.facet(o, i) else { return (Vec3::ZERO, 0.0) };
                let facet = self.facet(bent.cos_o);
                // The visibility divides by four cosines, as suits a mirror; 1 / eta^2 of radiance
                // and the eta^2 of the Jacobian cancel.
                let crossing = 4.0 * bent.cos_o * bent.jacobian;
                let value = ggx.density(bent.h) * ggx.visibility(o.z, -i.z) * crossing;
                let eta2 = interface.eta() * interface.eta();
                let pdf = ggx.pdf_mirrored(o.z, bent.h) * crossing * eta2;
                (facet.1 * value, pdf * (1.0 - self.reflects(facet)))
            }
            None => {
                // The lobe of reflection, mirrored to the other side.
                let i = Vec3::new(i.x, i.y, -i.z);
                let h = (o + i).normalize_or(Vec3::Z);
                let facet = self.facet(o.dot(h));
                let value = facet.1 * (ggx.density(h) * ggx.visibility(o.z, i.z));
                (value, ggx.pdf_mirrored(o.z, h) * (1.0 - self.reflects(facet)))
            }
        }
    }

    /// The direction below that a facet passes to `o`; `None` under total reflection.
    #[inline]
    pub(super) fn pass(&self, o: Vec3, h: Vec3) -> Option<Vec3> {
        match &self.body {
            Some((interface, _)) => interface.refract(o, h),
            None => {
                let i = 2.0 * o.dot(h) * h - o;
                Some(Vec3::new(i.x, i.y, -i.z))
            }
        }
    }

    /// Scale of radiance that crosses towards the viewer: `1 / eta^2` of a body.
    #[inline]
    pub(super) fn radiance_scale(&self) -> f32 {
        self.body.as_ref().map_or(1.0, |(interface, _)| 1.0 / (interface.eta() * interface.eta()))
    }

    /// Mean share of light that is not absorbed, over the hemisphere; radiance is not scaled.
    pub(super) fn average(&self) -> Vec3 {
        let pi = std::f32::consts::PI;
        let [one, grazing] = self.albedo.average();
        let [diffuse, multiple] = self.through([one, grazing]);
        let mut sum = self.reflection[0] * one + self.reflection[1] * grazing;
        sum += (self.diffuse[0] + self.diffuse[1]) * (pi * diffuse * diffuse);
        sum += (self.multiple[0] + self.multiple[1]) * (pi * multiple * multiple);
        // At the mean cosine; for bodies what is lost by single bounces is left out, which makes it
        // a bound.
        let (_, passed) = self.facet(2.0 / 3.0);
        match &self.body {
            Some((interface, share)) => sum += passed + *share * interface.split(2.0 / 3.0).0,
            None => sum += passed * one,
        }
        sum
    }
}
