//! Lights that next-event estimation can aim at, and the choice among them.

mod emissive_volumes;
mod tree;

pub(crate) use emissive_volumes::{EmissionMixture, EmissiveVolumes};

use crate::kernel::luminance;
use crate::settings::LightSampling;
use glam::{DVec3, Vec3};
use pileus_math::elementary::sin_cos_turn;
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::uniform;
use pileus_scene::{EnvironmentImage, Light, Scene, Surfaces};
use rand_core::Rng;
use std::sync::Arc;
use tree::{LightTree, TreeLight};

/// A light as sampled from a vertex in a medium.
#[derive(Debug, Clone)]
pub(crate) enum EmitterTechnique {
    /// A delta direction.
    Direction { to_light: Vec3, irradiance: Vec3, strength: f32 },
    /// A disc of constant radiance at infinity.
    Disc(Disc),
    /// A light with a position, by number.
    Position(usize),
    /// All lights with positions, if there are many.
    Positions(LightTree),
    /// What is bright in the environment image.
    Image { image: Arc<EnvironmentImage>, strength: f32 },
    /// All emissive triangles.
    EmissiveTriangles(EmissiveTriangles),
}

/// Most lights with positions that are chosen among one by one, with their phase function's value;
/// more are put under a tree, which knows their distance alone.
const MAX_LISTED_POSITIONS: usize = 8;

/// A light that has a position; the scene's light holds the angular law.
#[derive(Debug, Clone)]
pub(crate) struct PointLight {
    light: Light,
    position: DVec3,
    strength: f32,
}

impl PointLight {
    fn new(light: &Light) -> Option<PointLight> {
        let position = light.position()?;
        let strength = luminance(light.strength());
        (strength > 0.0).then(|| PointLight { light: light.clone(), position, strength })
    }

    fn for_tree(&self) -> TreeLight {
        let (axis, cos_emission) = self.light.cone();
        let p = [self.position; 3];
        TreeLight { p, axis, cos_emission, strength: self.strength, two_sided: false }
    }

    fn sample(&self, p: DVec3) -> Option<LightSample> {
        let to = self.position - p;
        let distance = to.length();
        if !(distance > 0.0) {
            return None;
        }
        let wi = (to / distance).as_vec3();
        let intensity = self.light.intensity_toward(-wi);
        let weight = (intensity.as_dvec3() / (distance * distance)).as_vec3();
        (weight != Vec3::ZERO).then_some(LightSample {
            wi,
            distance,
            end: None,
            position: Some(self.position),
            weight,
            pdf: 0.0,
            everywhere: false,
        })
    }
}

/// Emissive triangles under a tree.
#[derive(Debug, Clone)]
pub(crate) struct EmissiveTriangles {
    surfaces: Arc<Surfaces>,
    tree: LightTree,
}

impl EmissiveTriangles {
    fn new(surfaces: &Arc<Surfaces>) -> EmissiveTriangles {
        let lights: Vec<TreeLight> = surfaces
            .emitters()
            .iter()
            .map(|triangle| TreeLight {
                p: [triangle.p0, triangle.p0 + triangle.e1, triangle.p0 + triangle.e2],
                axis: triangle.normal,
                cos_emission: 0.0,
                strength: luminance(triangle.radiance) * triangle.area as f32,
                two_sided: triangle.two_sided,
            })
            .collect();
        EmissiveTriangles { surfaces: Arc::clone(surfaces), tree: LightTree::new(&lights) }
    }

    /// A point on a triangle as seen from `p`. `u`: where on it; `which`: which one.
    fn sample(&self, p: DVec3, u: [f32; 2], which: f32) -> Option<LightSample> {
        let (number, probability) = self.tree.choose(p, which)?;
        let triangle = self.surfaces.emitters().get(number as usize)?;
        // Uniform barycentric coordinates [Turk 1990].
        let root = u[0].sqrt();
        let [b1, b2] = [root * (1.0 - u[1]), root * u[1]];
        let end = triangle.point([b1, b2], p);
        let to = end - p;
        let distance = to.length();
        let wi = (to / distance).as_vec3();
        let pdf = probability * pdf_of_area(triangle.area, distance, triangle.normal.dot(wi));
        // Also refuses NaN, of points on the triangle itself.
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        let radiance = self.surfaces.emitted(number, [b1, b2], wi);
        Some(LightSample {
            wi,
            distance,
            end: Some((end, number)),
            position: None,
            weight: radiance / pdf,
            pdf,
            everywhere: false,
        })
    }
}

/// Density per solid angle of uniform points on an area seen at a distance under a cosine; infinite
/// edge-on.
fn pdf_of_area(area: f64, distance: f64, cos: f32) -> f32 {
    (distance * distance / (area * f64::from(cos.abs()))) as f32
}

impl EmitterTechnique {
    /// Whether a path can run into it.
    fn met_by_paths(&self) -> bool {
        !matches!(
            self,
            EmitterTechnique::Direction { .. }
                | EmitterTechnique::Position(_)
                | EmitterTechnique::Positions(_)
        )
    }
}

/// A sun of finite size.
#[derive(Debug, Clone)]
pub(crate) struct Disc {
    to_light: Vec3,
    radiance: Vec3,
    one_minus_cos: f32,
    pdf: f32,
    strength: f32,
}

impl Disc {
    fn new(to_light: Vec3, irradiance: Vec3, angular_diameter: f32) -> Disc {
        let radius = f64::from(0.5 * angular_diameter);
        let one_minus_cos = 2.0 * libm::sin(0.5 * radius).powi(2);
        // A plane that faces the sun sees the projected solid angle pi sin^2.
        let projected = std::f64::consts::PI * libm::sin(radius).powi(2);
        Disc {
            to_light,
            radiance: (irradiance.as_dvec3() / projected).as_vec3(),
            one_minus_cos: one_minus_cos as f32,
            pdf: (1.0 / (std::f64::consts::TAU * one_minus_cos)) as f32,
            strength: luminance(irradiance),
        }
    }

    /// Whether a ray to infinity hits the disc.
    #[inline(always)]
    fn contains(&self, direction: Vec3) -> bool {
        0.5 * (direction - self.to_light).length_squared() <= self.one_minus_cos
    }

    fn sample(&self, u: [f32; 2]) -> Vec3 {
        let one_minus = u[0] * self.one_minus_cos;
        let sin = (one_minus * (2.0 - one_minus)).sqrt();
        let (sin_phi, cos_phi) = sin_cos_turn(u[1]);
        let (x, y) = pileus_math::basis(self.to_light);
        (self.to_light * (1.0 - one_minus) + x * (sin * cos_phi) + y * (sin * sin_phi)).normalize()
    }
}

/// A direction towards a light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LightSample {
    pub(crate) wi: Vec3,
    /// Distance to the light; infinite for distant ones.
    pub(crate) distance: f64,
    /// The point itself and its emitter's number, if it lies on a surface.
    pub(crate) end: Option<(DVec3, u32)>,
    /// Where the light is, if it is point-like.
    pub(crate) position: Option<DVec3>,
    /// Radiance over the density of the direction; irradiance for delta lights.
    pub(crate) weight: Vec3,
    /// Density of the direction, 1/sr, for lights that a path can also run into; zero for delta
    /// lights.
    pub(crate) pdf: f32,
    /// Whether the direction may lie anywhere, so that the choice of the light did not know the
    /// phase function's value.
    pub(crate) everywhere: bool,
}

/// All lights of a scene that shadow rays are sent to.
#[derive(Debug, Clone, Default)]
pub(crate) struct Lights {
    techniques: Vec<EmitterTechnique>,
    /// Lights with positions.
    points: Vec<PointLight>,
    /// Discs and images that no shadow ray is sent to.
    paths_only: Vec<EmitterTechnique>,
    /// Volumes that paths are drawn to.
    emissive_volumes: EmissiveVolumes,
    have_extent: bool,
}

/// A choice among the lights from one vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Choice {
    pub(crate) index: usize,
    /// Probability of the choice.
    pub(crate) probability: f32,
    /// What all lights together may contribute, unshadowed, over what they would if scattering were
    /// isotropic.
    pub(crate) importance: f32,
}

impl Lights {
    /// The lights of a scene, with what draws paths to its emissive volumes.
    pub(crate) fn new(scene: &Scene, sampling: LightSampling) -> Lights {
        let mut lights = Lights::without_emissive_volumes(scene, sampling);
        if sampling == LightSampling::Both {
            lights.emissive_volumes = EmissiveVolumes::new(scene);
        }
        lights
    }

    /// The lights that shadow rays are sent to: what a plan has to know.
    pub(crate) fn without_emissive_volumes(scene: &Scene, sampling: LightSampling) -> Lights {
        let mut techniques = Vec::new();
        for light in &scene.lights {
            match light {
                Light::Sun(sun) if luminance(sun.irradiance) <= 0.0 => {}
                Light::Sun(sun) if sun.angular_diameter > 0.0 => {
                    techniques.push(EmitterTechnique::Disc(Disc::new(
                        sun.to_light,
                        sun.irradiance,
                        sun.angular_diameter,
                    )))
                }
                Light::Sun(sun) => techniques.push(EmitterTechnique::Direction {
                    to_light: sun.to_light,
                    irradiance: sun.irradiance,
                    strength: luminance(sun.irradiance),
                }),
                _ => {}
            }
        }
        let points: Vec<PointLight> = scene.lights.iter().filter_map(PointLight::new).collect();
        if points.len() > MAX_LISTED_POSITIONS {
            let lights: Vec<TreeLight> = points.iter().map(PointLight::for_tree).collect();
            techniques.push(EmitterTechnique::Positions(LightTree::new(&lights)));
        } else {
            techniques.extend((0..points.len()).map(EmitterTechnique::Position));
        }
        if let Some(image) = &scene.environment.image
            && image.sampled_power() > 0.0
        {
            let strength = image.sampled_power();
            techniques.push(EmitterTechnique::Image { image: Arc::clone(image), strength });
        }
        if let Some(surfaces) = &scene.surfaces {
            let emissive = EmissiveTriangles::new(surfaces);
            if !emissive.tree.is_empty() {
                techniques.push(EmitterTechnique::EmissiveTriangles(emissive));
            }
        }
        let mut paths_only = Vec::new();
        if sampling == LightSampling::Paths {
            (paths_only, techniques) =
                techniques.into_iter().partition(EmitterTechnique::met_by_paths);
        }
        let emissive_volumes = EmissiveVolumes::default();
        let mut lights =
            Lights { techniques, points, paths_only, emissive_volumes, have_extent: false };
        lights.have_extent =
            lights.need_mis() || lights.techniques.len() > 1 || lights.many_positions();
        lights
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.techniques.is_empty()
    }

    /// Whether a direction towards a light may take random numbers.
    #[inline(always)]
    pub(crate) fn have_extent(&self) -> bool {
        self.have_extent
    }

    /// Lights, those under a tree of points counted one by one.
    pub(crate) fn count(&self) -> usize {
        let under_tree = if self.many_positions() { self.points.len() - 1 } else { 0 };
        self.techniques.len() + under_tree
    }

    /// Positions of the point-like lights, by number.
    pub(crate) fn positions(&self) -> impl Iterator<Item = (usize, DVec3)> {
        self.points.iter().enumerate().map(|(number, light)| (number, light.position))
    }

    /// Whether the point-like lights are too many to be gone through at every vertex.
    pub(crate) fn many_positions(&self) -> bool {
        self.points.len() > MAX_LISTED_POSITIONS
    }

    /// The direction towards point-like light `number` from `p`; `None` where it sends nothing.
    pub(crate) fn sample_position(&self, number: usize, p: DVec3) -> Option<LightSample> {
        self.points.get(number)?.sample(p)
    }

    /// Whether a path can run into what shadow rays are sent to, so that both must be weighted.
    pub(crate) fn need_mis(&self) -> bool {
        self.techniques.iter().chain(&self.paths_only).any(EmitterTechnique::met_by_paths)
    }

    /// Unshadowed contribution of a light, as scattered by `phase` (a value for a direction), and
    /// if scattering were isotropic.
    #[inline(always)]
    fn estimate(
        &self,
        technique: &EmitterTechnique,
        p: DVec3,
        phase: impl Fn(Vec3) -> f32,
    ) -> (f32, f32) {
        match technique {
            EmitterTechnique::Direction { to_light, strength, .. } => {
                (strength * phase(*to_light), strength * ISOTROPIC)
            }
            EmitterTechnique::Disc(disc) => {
                (disc.strength * phase(disc.to_light), disc.strength * ISOTROPIC)
            }
            EmitterTechnique::Position(number) => {
                let light = &self.points[*number];
                let to = light.position - p;
                let distance2 = to.length_squared().max(1e-30);
                let received = (f64::from(light.strength) / distance2) as f32;
                (received * phase((to / distance2.sqrt()).as_vec3()), received * ISOTROPIC)
            }
            EmitterTechnique::Image { strength, .. } => {
                (strength * ISOTROPIC, strength * ISOTROPIC)
            }
            EmitterTechnique::Positions(tree) => {
                let received = tree.estimate(p) * ISOTROPIC;
                (received, received)
            }
            // Lights of some size: their middle says little of what a vertex sees of them.
            EmitterTechnique::EmissiveTriangles(emissive) => {
                let received = emissive.tree.estimate(p) * ISOTROPIC;
                (received, received)
            }
        }
    }

    /// Chooses a light in proportion to what it may contribute; `None` if there is nothing to
    /// choose.
    #[inline(always)]
    pub(crate) fn choose(&self, p: DVec3, phase: impl Fn(Vec3) -> f32, u: f32) -> Option<Choice> {
        if let [technique] = self.techniques.as_slice() {
            let (estimate, isotropic) = self.estimate(technique, p, &phase);
            let importance = if isotropic > 0.0 { estimate / isotropic } else { 0.0 };
            return (importance > 0.0).then_some(Choice { index: 0, probability: 1.0, importance });
        }
        // One pass of weighted reservoir sampling, reusing the random number.
        let (mut total, mut isotropic, mut u) = (0.0f32, 0.0f32, u);
        let (mut index, mut chosen) = (usize::MAX, 0.0f32);
        for (i, technique) in self.techniques.iter().enumerate() {
            let (estimate, iso) = self.estimate(technique, p, &phase);
            if !(estimate > 0.0) {
                continue;
            }
            total += estimate;
            isotropic += iso;
            let share = estimate / total;
            if u < share {
                (index, chosen) = (i, estimate);
                u /= share;
            } else {
                u = (u - share) / (1.0 - share);
            }
        }
        (chosen > 0.0).then(|| Choice {
            index,
            probability: chosen / total,
            importance: total / isotropic,
        })
    }

    /// A direction towards light `index` from `p`.
    #[inline(always)]
    pub(crate) fn sample<R: Rng + ?Sized>(
        &self,
        index: usize,
        p: DVec3,
        u: [f32; 2],
        rng: &mut R,
    ) -> Option<LightSample> {
        match &self.techniques[index] {
            EmitterTechnique::Direction { to_light, irradiance, .. } => Some(LightSample {
                wi: *to_light,
                distance: f64::INFINITY,
                end: None,
                position: None,
                weight: *irradiance,
                pdf: 0.0,
                everywhere: false,
            }),
            EmitterTechnique::Disc(disc) => Some(LightSample {
                wi: disc.sample(u),
                distance: f64::INFINITY,
                end: None,
                position: None,
                weight: disc.radiance / disc.pdf,
                pdf: disc.pdf,
                everywhere: false,
            }),
            EmitterTechnique::Position(number) => self.points[*number].sample(p),
            EmitterTechnique::Positions(tree) => {
                let (number, probability) = tree.choose(p, u[0])?;
                let mut sample = self.points[number as usize].sample(p)?;
                sample.weight /= probability;
                // The tree knew no phase function.
                sample.everywhere = true;
                Some(sample)
            }
            EmitterTechnique::Image { image, .. } => {
                let sample = image.sample(u)?;
                Some(LightSample {
                    wi: sample.wi,
                    distance: f64::INFINITY,
                    end: None,
                    position: None,
                    weight: sample.radiance / sample.pdf,
                    pdf: sample.pdf,
                    everywhere: true,
                })
            }
            EmitterTechnique::EmissiveTriangles(emissive) => emissive.sample(p, u, uniform(rng)),
        }
    }

    /// For a path from `p` that met emissive triangle `emitter` at a distance under a cosine: the
    /// light it belongs to, and the density of its direction; `None` if no shadow ray is sent
    /// there.
    pub(crate) fn met_emissive_triangle(
        &self,
        emitter: u32,
        p: DVec3,
        distance: f64,
        cos: f32,
    ) -> Option<(usize, f32)> {
        self.techniques.iter().enumerate().find_map(|(index, technique)| match technique {
            EmitterTechnique::EmissiveTriangles(emissive) => {
                let triangle = emissive.surfaces.emitters().get(emitter as usize)?;
                let pdf = pdf_of_area(triangle.area, distance, cos);
                Some((index, emissive.tree.probability(emitter, p) * pdf))
            }
            _ => None,
        })
    }

    /// The emissive volumes that paths are drawn to: none if paths are to find all light by
    /// themselves.
    pub(crate) fn emissive_volumes(&self) -> &EmissiveVolumes {
        &self.emissive_volumes
    }

    /// How a vertex at `p` is drawn to emissive volumes beside the other lights and a constant
    /// environment of luminance `constant`; `None` if it is not.
    #[inline]
    pub(crate) fn emission_mixture(
        &self,
        p: DVec3,
        in_medium: bool,
        constant: f32,
    ) -> Option<EmissionMixture> {
        if self.emissive_volumes.is_empty() {
            return None;
        }
        let others =
            self.techniques.iter().map(|technique| self.estimate(technique, p, |_| ISOTROPIC).1);
        self.emissive_volumes.emission_mixture(p, in_medium, others.sum::<f32>() + constant)
    }

    /// Calls `visit` for every light at infinity that an escaping ray meets: its radiance, and if
    /// shadow rays are sent to it, its index and its density of sampling that direction.
    pub(crate) fn met_at_infinity(
        &self,
        direction: Vec3,
        mut visit: impl FnMut(Vec3, Option<(usize, f32)>),
    ) {
        for (index, technique) in self.techniques.iter().enumerate() {
            match technique {
                EmitterTechnique::Disc(disc) if disc.contains(direction) => {
                    visit(disc.radiance, Some((index, disc.pdf)));
                }
                EmitterTechnique::Image { image, .. } => {
                    visit(image.radiance(direction), Some((index, image.pdf(direction))));
                }
                _ => {}
            }
        }
        for technique in &self.paths_only {
            match technique {
                EmitterTechnique::Disc(disc) if disc.contains(direction) => {
                    visit(disc.radiance, None)
                }
                EmitterTechnique::Image { image, .. } => visit(image.radiance(direction), None),
                _ => {}
            }
        }
    }

    /// Probability with which [`Lights::choose`] picks light `index`.
    pub(crate) fn probability(&self, index: usize, p: DVec3, phase: impl Fn(Vec3) -> f32) -> f32 {
        let (mut total, mut own) = (0.0f32, 0.0f32);
        for (i, technique) in self.techniques.iter().enumerate() {
            let (estimate, _) = self.estimate(technique, p, &phase);
            if estimate > 0.0 {
                total += estimate;
                if i == index {
                    own = estimate;
                }
            }
        }
        if total > 0.0 { own / total } else { 0.0 }
    }

    /// Whether the environment's image is among the lights met at infinity: one with nothing to
    /// sample for is not.
    pub(crate) fn covers_image(&self) -> bool {
        let image = |t: &EmitterTechnique| matches!(t, EmitterTechnique::Image { .. });
        self.techniques.iter().chain(&self.paths_only).any(image)
    }
}
