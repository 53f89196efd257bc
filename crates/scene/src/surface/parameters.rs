//! What a material says at a point of a surface: the input of the scattering model.

use glam::Vec3;

/// Parameters of glTF's surface model at a point, textures and factors multiplied. Colours are
/// linear Rec. 709.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceParameters {
    /// Base colour, in [0, 1] per channel.
    pub base_color: Vec3,
    /// Share of metal, in [0, 1].
    pub metallic: f32,
    /// Perceptual roughness, in [0, 1]; its square is the width `alpha` of the microfacet
    /// distribution.
    pub roughness: f32,
    /// Index of refraction of the dielectric, at least 1; infinite for the special value 0 of
    /// `KHR_materials_ior`.
    pub ior: f32,
    /// Strength of the dielectric reflection, in [0, 1] (`KHR_materials_specular`).
    pub specular: f32,
    /// Colour of the dielectric reflection at normal incidence (`KHR_materials_specular`).
    pub specular_color: Vec3,
    /// Share of light that a dielectric lets through instead of scattering it diffusely, in [0, 1]
    /// (`KHR_materials_transmission`).
    pub transmission: f32,
    /// Share of diffuse light that leaves on the other side, in [0, 1]
    /// (`KHR_materials_diffuse_transmission`).
    pub diffuse_transmission: f32,
    /// Colour of the diffuse transmission, linear Rec. 709.
    pub diffuse_transmission_color: Vec3,
    /// Strength of the clear coat, in [0, 1] (`KHR_materials_clearcoat`).
    pub clearcoat: f32,
    /// Perceptual roughness of the clear coat.
    pub clearcoat_roughness: f32,
    /// Colour of the sheen (`KHR_materials_sheen`).
    pub sheen_color: Vec3,
    /// Perceptual roughness of the sheen.
    pub sheen_roughness: f32,
    /// Whether the surface is an infinitely thin wall, so that what it transmits is not bent; else
    /// it bounds a body of index `ior`.
    pub thin_walled: bool,
}
