//! Materials: what glTF says about a surface, evaluated at a point.

use glam::{Vec2, Vec3, Vec4};

use super::parameters::SurfaceParameters;
use super::texture::Texture;
use crate::bsdf::Passing;

/// A homogeneous medium inside a surface.
///
/// `KHR_materials_volume` gives the extinction: `sigma_t = -ln(attenuationColor) /
/// attenuationDistance`. Without `KHR_materials_volume_scatter` all of it is absorption.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interior {
    /// Absorption in 1/m, per channel.
    pub sigma_a: Vec3,
    /// Scattering in 1/m, per channel.
    pub sigma_s: Vec3,
    /// Mean cosine of Henyey and Greenstein's phase function.
    pub g: f32,
}

/// How much of a surface is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Alpha {
    Opaque,
    /// There where alpha is at least this.
    Mask(f32),
    /// There with probability alpha.
    Blend,
}

/// A material of a glTF file; every texture multiplies its factor.
#[derive(Debug, Clone)]
pub(crate) struct Material {
    pub(crate) name: String,
    pub(crate) base_color: Vec4,
    pub(crate) base_color_texture: Option<Texture>,
    pub(crate) metallic: f32,
    pub(crate) roughness: f32,
    /// Metallic in blue, roughness in green.
    pub(crate) metallic_roughness_texture: Option<Texture>,
    pub(crate) normal_texture: Option<(Texture, f32)>,
    /// Radiance, factor times `emissiveStrength`.
    pub(crate) emission: Vec3,
    pub(crate) emission_texture: Option<Texture>,
    /// `KHR_materials_unlit`: emits its base colour and scatters nothing.
    pub(crate) unlit: bool,
    pub(crate) alpha: Alpha,
    pub(crate) double_sided: bool,
    pub(crate) ior: f32,
    pub(crate) specular: f32,
    pub(crate) specular_texture: Option<Texture>,
    pub(crate) specular_color: Vec3,
    pub(crate) specular_color_texture: Option<Texture>,
    pub(crate) transmission: f32,
    pub(crate) transmission_texture: Option<Texture>,
    pub(crate) diffuse_transmission: f32,
    pub(crate) diffuse_transmission_texture: Option<Texture>,
    pub(crate) diffuse_transmission_color: Vec3,
    pub(crate) diffuse_transmission_color_texture: Option<Texture>,
    pub(crate) clearcoat: f32,
    pub(crate) clearcoat_texture: Option<Texture>,
    pub(crate) clearcoat_roughness: f32,
    pub(crate) clearcoat_roughness_texture: Option<Texture>,
    pub(crate) sheen_color: Vec3,
    pub(crate) sheen_color_texture: Option<Texture>,
    pub(crate) sheen_roughness: f32,
    pub(crate) sheen_roughness_texture: Option<Texture>,
    /// `KHR_materials_volume`: whether its thickness is above 0, so that the surface bounds a body;
    /// `None` without the extension.
    pub(crate) volume: Option<bool>,
    /// The medium behind the surface, if it is not clear.
    pub(crate) interior: Option<Interior>,
    /// What textures make of its medium where a path enters it.
    pub(crate) scatter: Option<Box<Scatter>>,
}

/// Scattering in a body whose albedo differs over its surface: where a path enters it says what
/// the path finds inside. This is what the extensions intend, and not reciprocal, as they say.
#[derive(Debug, Clone)]
pub(crate) struct Scatter {
    /// Extinction in 1/m, per channel.
    pub(crate) sigma_t: Vec3,
    /// Diffuse albedo of a half space of the medium, per channel, strength included.
    pub(crate) multiscatter: Vec3,
    pub(crate) multiscatter_texture: Option<Texture>,
    /// Strength in its alpha.
    pub(crate) strength_texture: Option<Texture>,
    /// Mean cosine of the phase function.
    pub(crate) g: f32,
}

impl Scatter {
    /// The medium that a path finds which enters at a point.
    #[inline(never)]
    fn at(&self, point: &Point) -> Interior {
        let color = eval(&self.multiscatter_texture, point).truncate();
        let multiscatter = self.multiscatter * color * eval(&self.strength_texture, point).w;
        Interior::of_albedo(self.sigma_t, multiscatter, self.g)
    }
}

impl Interior {
    /// A medium of this extinction that reflects `multiscatter` of diffuse light from a half space.
    pub(crate) fn of_albedo(sigma_t: Vec3, multiscatter: Vec3, g: f32) -> Self {
        let albedo = multiscatter.to_array().map(|c| single_scattering_albedo(c, g));
        let albedo = Vec3::from_array(albedo);
        Self { sigma_a: sigma_t * (1.0 - albedo), sigma_s: sigma_t * albedo, g }
    }
}

/// Coordinates and colour of a point of a mesh, interpolated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) uv: [Vec2; 2],
    pub(crate) color: Vec4,
}

impl Default for Material {
    /// glTF's default material: white, metallic and rough factors of 1, single-sided.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            emission: Vec3::ZERO,
            emission_texture: None,
            unlit: false,
            alpha: Alpha::Opaque,
            double_sided: false,
            ior: 1.5,
            specular: 1.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            diffuse_transmission: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color: Vec3::ONE,
            diffuse_transmission_color_texture: None,
            clearcoat: 0.0,
            clearcoat_texture: None,
            clearcoat_roughness: 0.0,
            clearcoat_roughness_texture: None,
            sheen_color: Vec3::ZERO,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            sheen_roughness_texture: None,
            volume: None,
            interior: None,
            scatter: None,
        }
    }
}

/// The value of a texture, or 1.
#[inline]
fn eval(texture: &Option<Texture>, point: &Point) -> Vec4 {
    texture.as_ref().map_or(Vec4::ONE, |texture| texture.eval(&point.uv))
}

impl Material {
    /// Whether light passes through it, so that its inside is seen.
    pub(crate) fn transmits(&self) -> bool {
        self.transmission > 0.0 || self.diffuse_transmission > 0.0
    }

    /// Whether the camera's rays pass its back unseen: glTF culls back faces of single-sided
    /// materials; those that transmit are kept, a path has to leave the body again.
    pub(crate) fn culls_back(&self) -> bool {
        !self.double_sided && !self.transmits()
    }

    /// Whether it may emit anything.
    pub(crate) fn emits(&self) -> bool {
        self.emission != Vec3::ZERO || self.unlit
    }

    /// Whether a texture uses a set of coordinates.
    pub(crate) fn uses_set(&self, set: usize) -> bool {
        let textures = [
            &self.base_color_texture,
            &self.metallic_roughness_texture,
            &self.emission_texture,
            &self.specular_texture,
            &self.specular_color_texture,
            &self.transmission_texture,
            &self.diffuse_transmission_texture,
            &self.diffuse_transmission_color_texture,
            &self.clearcoat_texture,
            &self.clearcoat_roughness_texture,
            &self.sheen_color_texture,
            &self.sheen_roughness_texture,
        ];
        let normal = self.normal_texture.iter().map(|(texture, _)| texture);
        let scatter = self.scatter.iter().flat_map(|scatter| {
            [&scatter.multiscatter_texture, &scatter.strength_texture].into_iter().flatten()
        });
        textures.into_iter().flatten().chain(normal).chain(scatter).any(|t| t.set == set)
    }

    /// The medium of the body that a path enters at a point.
    #[inline(always)]
    pub(crate) fn interior_at(&self, point: &Point) -> Option<Interior> {
        match &self.scatter {
            None => self.interior,
            Some(scatter) => Some(scatter.at(point)),
        }
    }

    /// What becomes of light that it lets through at a roughness; `None` if it lets none through.
    fn passing(&self, roughness: f32, solid: bool) -> Option<Passing> {
        let metal = self.metallic >= 1.0 && self.metallic_roughness_texture.is_none();
        if !(self.transmission > 0.0) || metal {
            return None;
        }
        let body = (solid && self.ior.is_finite()).then_some(self.ior);
        Some(Passing::of(roughness.clamp(0.0, 1.0), body))
    }

    /// What becomes of light that it lets through where it is roughest.
    pub(crate) fn passing_at_most(&self, solid: bool) -> Option<Passing> {
        self.passing(self.roughness, solid)
    }

    /// Whether light may go straight through somewhere; `solid` if the surface bounds a body.
    pub(crate) fn may_pass_straight(&self, solid: bool) -> bool {
        // A texture may make it smooth.
        let least = if self.metallic_roughness_texture.is_some() { 0.0 } else { self.roughness };
        self.passing(least, solid) == Some(Passing::Straight)
    }

    fn base_color(&self, point: &Point) -> Vec4 {
        self.base_color * eval(&self.base_color_texture, point) * point.color
    }

    /// The probability, in [0, 1], that a ray meets the surface at this point.
    pub(crate) fn coverage(&self, point: &Point) -> f32 {
        match self.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask(cutoff) => f32::from(self.base_color(point).w >= cutoff),
            Alpha::Blend => self.base_color(point).w.clamp(0.0, 1.0),
        }
    }

    /// Emitted radiance, the same in all directions of the emitting sides.
    pub(crate) fn emission(&self, point: &Point) -> Vec3 {
        if self.unlit {
            return self.base_color(point).truncate().max(Vec3::ZERO);
        }
        if self.emission == Vec3::ZERO {
            return Vec3::ZERO;
        }
        self.emission * eval(&self.emission_texture, point).truncate()
    }

    /// The parameters of the scattering model; `solid` if the surface bounds a body.
    pub(crate) fn parameters(&self, point: &Point, solid: bool) -> SurfaceParameters {
        let unit = |v: f32| v.clamp(0.0, 1.0);
        let colour = |v: Vec3| v.clamp(Vec3::ZERO, Vec3::ONE);
        let metallic_roughness = eval(&self.metallic_roughness_texture, point);
        let base_color = if self.unlit { Vec3::ZERO } else { self.base_color(point).truncate() };
        SurfaceParameters {
            base_color: colour(base_color),
            metallic: if self.unlit { 0.0 } else { unit(self.metallic * metallic_roughness.z) },
            roughness: unit(self.roughness * metallic_roughness.y),
            ior: self.ior,
            specular: if self.unlit {
                0.0
            } else {
                unit(self.specular * eval(&self.specular_texture, point).w)
            },
            specular_color: (self.specular_color
                * eval(&self.specular_color_texture, point).truncate())
            .max(Vec3::ZERO),
            transmission: unit(self.transmission * eval(&self.transmission_texture, point).x),
            diffuse_transmission: unit(
                self.diffuse_transmission * eval(&self.diffuse_transmission_texture, point).w,
            ),
            diffuse_transmission_color: colour(
                self.diffuse_transmission_color
                    * eval(&self.diffuse_transmission_color_texture, point).truncate(),
            ),
            clearcoat: unit(self.clearcoat * eval(&self.clearcoat_texture, point).x),
            clearcoat_roughness: unit(
                self.clearcoat_roughness * eval(&self.clearcoat_roughness_texture, point).y,
            ),
            sheen_color: colour(
                self.sheen_color * eval(&self.sheen_color_texture, point).truncate(),
            ),
            sheen_roughness: unit(
                self.sheen_roughness * eval(&self.sheen_roughness_texture, point).w,
            ),
            thin_walled: !solid,
        }
    }
}

/// Single-scattering albedo of a half space that reflects `multiscatter` of diffuse light, by
/// inverting Kulla and Conty's fit of van de Hulst's albedo ("Revisiting physically based shading
/// at Imageworks", 2017): with s = sqrt((1 - a) / (1 - g a)),
/// multiscatter = (1 - s) (1 - 0.139 s) / (1 + 1.17 s).
pub(crate) fn single_scattering_albedo(multiscatter: f32, g: f32) -> f32 {
    let rho = multiscatter.clamp(0.0, 1.0);
    let root = (9.592_17 + rho * (41.6808 + 17.7126 * rho)).sqrt();
    let s = (4.097_12 + 4.208_63 * rho - root).clamp(0.0, 1.0);
    ((1.0 - s * s) / (1.0 - g * s * s)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::texture::Wrap;
    use super::super::texture::tests::{image, texture};
    use super::*;

    fn point(x: f32) -> Point {
        Point { uv: [Vec2::new(x, 0.5); 2], color: Vec4::ONE }
    }

    #[test]
    fn albedo_inverts_kulla_and_conty() {
        for g in [-0.7f32, 0.0, 0.9] {
            for albedo in [0.0f32, 0.1, 0.5, 0.9, 0.99, 0.9999, 1.0] {
                let s = ((1.0 - albedo) / (1.0 - g * albedo)).sqrt();
                let multiscatter = (1.0 - s) * (1.0 - 0.139 * s) / (1.0 + 1.17 * s);
                let found = single_scattering_albedo(multiscatter, g);
                assert!((found - albedo).abs() < 2e-4, "{g} {albedo}: {found}");
            }
        }
    }

    #[test]
    fn coverage_by_mode() {
        let mut material = Material {
            base_color: Vec4::new(1.0, 1.0, 1.0, 0.4),
            alpha: Alpha::Mask(0.5),
            ..Material::default()
        };
        let dim = Point { color: Vec4::new(1.0, 1.0, 1.0, 0.5), ..point(0.0) };
        assert_eq!(material.coverage(&point(0.0)), 0.0);
        material.alpha = Alpha::Mask(0.4);
        assert_eq!(material.coverage(&point(0.0)), 1.0);
        assert_eq!(material.coverage(&dim), 0.0);
        material.alpha = Alpha::Blend;
        assert_eq!(material.coverage(&dim), 0.2);
        material.alpha = Alpha::Opaque;
        assert_eq!(material.coverage(&dim), 1.0);
    }

    #[test]
    fn factors_textures_and_vertex_colours_multiply() {
        let map = texture(image(2, &[51, 255]), Wrap::Clamp);
        let material = Material {
            base_color: Vec4::new(0.5, 0.5, 2.0, 1.0),
            base_color_texture: Some(map.clone()),
            transmission: 0.5,
            transmission_texture: Some(map),
            ..Material::default()
        };
        let at = Point { color: Vec4::new(0.5, 1.0, 1.0, 1.0), ..point(0.25) };
        let parameters = material.parameters(&at, true);
        assert!((parameters.base_color - Vec3::new(0.05, 0.5, 1.0)).length() < 1e-6);
        assert!((parameters.transmission - 0.1).abs() < 1e-6);
        assert!(!parameters.thin_walled);
        let unlit = Material { unlit: true, ..material };
        assert_eq!(unlit.parameters(&at, false).base_color, Vec3::ZERO);
        assert!((unlit.emission(&at) - Vec3::new(0.05, 0.5, 2.0)).length() < 1e-6);
    }
}
