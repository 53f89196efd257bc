//! How a surface scatters light: glTF's metallic-roughness model with its extensions.
//!
//! From the outside in: clear coat, sheen, base. The base has facets (GGX) of metal and dielectric,
//! which reflect and let through, and cosine-shaped lobes for diffuse light and for light that
//! bounced between facets. Every layer is scaled by what the layers above leave, reciprocally. See
//! the book's page on surfaces for the formulas and their accuracy.
//!
//! **Radiance.** Values are for camera paths: light that crosses an interface of a body towards
//! `wo` is scaled by `(n_o / n_i)^2`, so that `f(wo, wi) n_i^2 = f(wi, wo) n_o^2`; everything else
//! is symmetric.

mod base;
mod clearcoat;
mod compensation;
mod dielectric;
mod fresnel;
mod ggx;
mod sheen;
mod table;

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use pileus_math::basis;

pub(crate) use self::base::Passing;
use self::base::{Base, BaseView};
use self::clearcoat::Clearcoat;
use self::sheen::Sheen;
use crate::surface::SurfaceParameters;

/// Viewers behind the shading normal are lifted to this cosine: seen there at grazing angles
/// instead of black.
const MIN_COS: f32 = 1e-4;

/// The scattering of a point of a surface, resolved into lobes. World space.
///
/// Light is reflected only if `wi` is above both the shading and the geometric normal and
/// transmitted only if it is below both, so that no shading normal lets light leak. What lobes lose
/// by that is lost.
#[derive(Debug, Clone, Copy)]
pub struct Bsdf {
    x: Vec3,
    y: Vec3,
    normal: Vec3,
    geometric: Vec3,
    base: Base,
    sheen: Option<Sheen>,
    coat: Option<Clearcoat>,
    /// Whether the viewer sees coat and sheen: not from inside of a body.
    layered: bool,
}

/// A direction drawn by [`Bsdf::sample`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BsdfSample {
    /// Unit direction away from the surface.
    pub wi: Vec3,
    /// Value times cosine over density; for a delta lobe its factor over the probability of drawing
    /// it. Finite, not negative.
    pub weight: Vec3,
    /// Density per solid angle as [`Bsdf::pdf`] says; 0 for a delta lobe.
    pub pdf: f32,
    /// Whether the direction is from a delta lobe, which no other technique can draw.
    pub delta: bool,
    /// Whether the path crosses the surface.
    pub transmitted: bool,
}

/// Lobes in the order in which they are drawn.
#[derive(Clone, Copy)]
enum Lobe {
    Facets,
    Passed,
    Cosine(usize),
    Sheen,
    Coat,
}

const LOBES: [Lobe; 6] =
    [Lobe::Facets, Lobe::Passed, Lobe::Cosine(0), Lobe::Cosine(1), Lobe::Sheen, Lobe::Coat];

/// What is looked up once for a direction of view.
struct View {
    /// `wo`, local.
    o: Vec3,
    base: BaseView,
    /// What coat and sheen take from the layers below.
    coat_loss: f32,
    sheen_loss: f32,
    /// Probability of each lobe.
    p: [f32; 6],
}

impl Bsdf {
    /// Resolves the parameters into lobes.
    ///
    /// `normal`: unit shading normal on the viewer's side; `geometric`: unit geometric normal on
    /// the viewer's side; `entering`: whether the viewer is outside of the body (front face).
    /// Parameters must be in their ranges. The first call with a rough material fills a table of
    /// albedos, the first with sheen another (the first took 74 ms where it was timed).
    pub fn new(
        parameters: &SurfaceParameters,
        normal: Vec3,
        geometric: Vec3,
        entering: bool,
    ) -> Bsdf {
        let (x, y) = basis(normal);
        let base = Base::new(parameters, entering);
        Bsdf {
            x,
            y,
            normal,
            geometric,
            layered: entering || !base.is_body(),
            base,
            sheen: Sheen::new(parameters.sheen_color, parameters.sheen_roughness),
            coat: Clearcoat::new(parameters.clearcoat, parameters.clearcoat_roughness),
        }
    }

    /// Value times |cos| between `wi` and the shading normal, without delta lobes, 1/sr. Both unit,
    /// away from the surface.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        self.eval_pdf(wo, wi).0
    }

    /// Density per solid angle with which [`sample`](Bsdf::sample) draws `wi`, without delta lobes.
    ///
    /// Its integral is below 1 by the probability of delta lobes and of draws that end on the wrong
    /// side.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval_pdf(wo, wi).1
    }

    /// [`eval`](Bsdf::eval) and [`pdf`](Bsdf::pdf) at once.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let i = self.local(wi);
        match self.side(wi, i) {
            None => (Vec3::ZERO, 0.0),
            Some(true) if !self.base.transmits() => (Vec3::ZERO, 0.0),
            Some(transmitted) => self.evaluate(&self.view(wo), i, transmitted),
        }
    }

    /// Draws a direction; `None` if the path ends (absorbed, or on the wrong side of the surface).
    /// `u` in [0, 1)^3.
    pub fn sample(&self, wo: Vec3, u: [f32; 3]) -> Option<BsdfSample> {
        let view = self.view(wo);
        let (lobe, probability, rest) = choose(&view.p, u[0])?;
        let (o, u) = (view.o, [u[1], u[2]]);
        let mirrored = |h: Vec3| 2.0 * o.dot(h) * h - o;
        let (i, transmitted) = match lobe {
            Lobe::Facets => match self.base.ggx() {
                None => {
                    let value = self.base.facet(o.z).0 * self.below(&view, o.z, self.layered);
                    return self.delta(self.world(mirrored(Vec3::Z)), value / probability, false);
                }
                Some(ggx) => {
                    let h = ggx.sample(o, u);
                    if rest < self.base.reflects(self.base.facet(o.dot(h))) {
                        (mirrored(h), false)
                    } else {
                        (self.base.pass(o, h)?, true)
                    }
                }
            },
            Lobe::Passed => {
                if self.base.is_straight() {
                    // Straight on is exact.
                    return self.delta(-wo, self.straight(&view) / probability, true);
                }
                let i = self.base.pass(o, Vec3::Z)?;
                let wi = self.world(i);
                let value = self.base.facet(o.z).1 * self.base.radiance_scale();
                let value = value * self.below(&view, -i.z, true);
                return self.delta(wi, value / probability, true);
            }
            Lobe::Cosine(0) => (ggx::sample_cosine(u), false),
            Lobe::Cosine(_) => (-ggx::sample_cosine(u), true),
            Lobe::Sheen => (ggx::sample_hemisphere(u), false),
            Lobe::Coat => {
                let coat = self.coat.as_ref()?;
                match coat.ggx() {
                    None => {
                        let value = Vec3::splat(coat.fresnel(o.z) / probability);
                        return self.delta(self.world(mirrored(Vec3::Z)), value, false);
                    }
                    Some(ggx) => (mirrored(ggx.sample(o, u)), false),
                }
            }
        };
        let wi = self.world(i);
        // As `eval_pdf` sees it.
        let i = self.local(wi);
        if self.side(wi, i) != Some(transmitted) {
            return None;
        }
        let (value, pdf) = self.evaluate(&view, i, transmitted);
        let weight = value / pdf;
        (pdf > 0.0 && weight.is_finite()).then_some(BsdfSample {
            wi,
            weight,
            pdf,
            delta: false,
            transmitted,
        })
    }

    /// Share of light per channel that reaches the viewer straight through the surface, from `-wo`,
    /// by a delta lobe: what [`sample`](Bsdf::sample) brings from there in the mean. Zero if what
    /// passes is bent or scattered, or if nothing passes.
    ///
    /// Thin walls let light through straight where they are smooth, bodies where their index is
    /// exactly 1, whatever their roughness. In [0, 1].
    #[inline(never)]
    pub fn straight_through(&self, wo: Vec3) -> Vec3 {
        if !self.passes_straight() || !(self.geometric.dot(wo) > 0.0) {
            return Vec3::ZERO;
        }
        let value = self.straight(&self.view(wo));
        if value.is_finite() { value } else { Vec3::ZERO }
    }

    /// Whether some light goes straight through: then it is all that [`sample`](Bsdf::sample) draws
    /// as a transmitted delta lobe.
    #[inline]
    pub fn passes_straight(&self) -> bool {
        self.base.is_straight()
    }

    /// Whether all lobes are delta lobes, so that no shadow ray can find light.
    pub fn is_delta(&self) -> bool {
        let coat = self.layered && self.coat.as_ref().is_some_and(|c| c.ggx().is_some());
        self.base.is_delta() && !coat && !(self.layered && self.sheen.is_some())
    }

    /// Share of light that is not absorbed, mean over all directions, in [0, 1]; an estimate. The
    /// scale of radiance is left out.
    pub fn albedo(&self) -> Vec3 {
        let mut sum = self.base.average();
        if self.layered {
            if let Some(sheen) = &self.sheen {
                let sheen = sheen.average();
                sum = sheen + sum * (1.0 - sheen.max_element());
            }
            if let Some(coat) = &self.coat {
                let coat = coat.average();
                sum = coat + sum * (Vec3::ONE - coat);
            }
        }
        sum.clamp(Vec3::ZERO, Vec3::ONE)
    }

    /// Factor of the lobe that goes straight on.
    #[inline]
    fn straight(&self, view: &View) -> Vec3 {
        self.base.facet(view.o.z).1 * self.below(view, view.o.z, true)
    }

    #[inline]
    fn local(&self, w: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(w), self.y.dot(w), self.normal.dot(w))
    }

    #[inline]
    fn world(&self, w: Vec3) -> Vec3 {
        (self.x * w.x + self.y * w.y + self.normal * w.z).normalize()
    }

    /// Whether `wi` is on the other side of the surface; `None` if the normals disagree.
    #[inline]
    fn side(&self, wi: Vec3, local: Vec3) -> Option<bool> {
        let geometric = self.geometric.dot(wi);
        if local.z > 0.0 && geometric > 0.0 {
            Some(false)
        } else if local.z < 0.0 && geometric < 0.0 {
            Some(true)
        } else {
            None
        }
    }

    /// A sample of a delta lobe, if its direction is on the right side of the geometric surface.
    #[inline]
    fn delta(&self, wi: Vec3, weight: Vec3, transmitted: bool) -> Option<BsdfSample> {
        let below = self.geometric.dot(wi) < 0.0;
        (below == transmitted && weight.is_finite()).then_some(BsdfSample {
            wi,
            weight,
            pdf: 0.0,
            delta: true,
            transmitted,
        })
    }

    /// Lookups and probabilities for a direction of view.
    #[inline]
    fn view(&self, wo: Vec3) -> View {
        let mut o = self.local(wo);
        if o.z < MIN_COS {
            o.z = MIN_COS;
            o = o.normalize();
        }
        let base = self.base.view(o.z);
        let mut p = [base.facets, base.passed, base.cosine[0], base.cosine[1], 0.0, 0.0];
        let (mut coat_loss, mut sheen_loss) = (0.0, 0.0);
        if let Some(sheen) = &self.sheen {
            sheen_loss = sheen.loss(o.z);
            p = p.map(|p| p * (1.0 - sheen_loss));
            if self.layered {
                p[4] = sheen.albedo(o.z).element_sum() * (1.0 / 3.0);
            }
        }
        if let Some(coat) = &self.coat {
            coat_loss = coat.albedo(o.z);
            p = p.map(|p| p * (1.0 - coat_loss));
            if self.layered {
                p[5] = coat_loss;
            }
        }
        let total: f32 = p.iter().sum();
        if total > 0.0 {
            p = p.map(|p| p / total);
        }
        View { o, base, coat_loss, sheen_loss, p }
    }

    /// What coat and sheen leave of light between the viewer and a direction at this cosine in (0,
    /// 1].
    #[inline]
    fn below(&self, view: &View, cos_i: f32, layered: bool) -> f32 {
        if !layered {
            return 1.0;
        }
        self.below_coat(view, cos_i) * self.below_sheen(view, cos_i)
    }

    #[inline]
    fn below_coat(&self, view: &View, cos_i: f32) -> f32 {
        self.coat.as_ref().map_or(1.0, |coat| 1.0 - view.coat_loss.max(coat.albedo(cos_i)))
    }

    #[inline]
    fn below_sheen(&self, view: &View, cos_i: f32) -> f32 {
        self.sheen.as_ref().map_or(1.0, |sheen| 1.0 - view.sheen_loss.max(sheen.loss(cos_i)))
    }

    /// Value times cosine, and density, of a direction on this or the other side.
    #[inline]
    fn evaluate(&self, view: &View, i: Vec3, transmitted: bool) -> (Vec3, f32) {
        let o = view.o;
        let cos_i = i.z.abs();
        let side = usize::from(transmitted);
        let cosine = self.base.cosine(&view.base, side, cos_i);
        let mut pdf = view.p[2 + side] * cos_i * FRAC_1_PI;
        if transmitted {
            let (facets, density) = self.base.transmitted(o, i);
            pdf += view.p[0] * density;
            return ((facets + cosine) * (cos_i * self.below(view, cos_i, true)), pdf);
        }
        let h = (o + i).normalize_or(Vec3::Z);
        let (facets, density) = self.base.reflected(o, i, h);
        pdf += view.p[0] * density;
        let mut value = facets + cosine;
        if self.layered {
            if let Some(sheen) = &self.sheen {
                value = sheen.eval(o, i) + value * self.below_sheen(view, cos_i);
                pdf += view.p[4] * ggx::HEMISPHERE;
            }
            if let Some(coat) = &self.coat {
                value *= self.below_coat(view, cos_i);
                if let Some(ggx) = coat.ggx() {
                    let fresnel = coat.fresnel(o.dot(h));
                    value += fresnel * ggx.density(h) * ggx.visibility(o.z, i.z);
                    pdf += view.p[5] * ggx.pdf_mirrored(o.z, h);
                }
            }
        }
        (value * cos_i, pdf)
    }
}

/// Chooses a lobe by its probability: the lobe, the probability, and a uniform number in [0, 1)
/// left over.
#[inline]
fn choose(p: &[f32; 6], u: f32) -> Option<(Lobe, f32, f32)> {
    let mut left = u;
    let mut last = None;
    for (lobe, &p) in LOBES.iter().zip(p) {
        if p > 0.0 {
            if left < p {
                return Some((*lobe, p, (left / p).min(1.0 - f32::EPSILON)));
            }
            // Where rounding makes the sum fall short of u.
            last = Some((*lobe, p, 1.0 - f32::EPSILON));
        }
        left -= p;
    }
    last
}
