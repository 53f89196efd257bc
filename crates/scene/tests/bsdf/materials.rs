//! Surfaces to test, each with one lobe or all of them.

use glam::Vec3;
use pileus_scene::{Bsdf, SurfaceParameters};

/// A shading normal that is along no axis; also the geometric normal unless said otherwise.
pub(crate) const NORMAL: Vec3 = Vec3::new(0.36, -0.48, 0.8);

/// A plain dielectric of this roughness, albedo 0.8.
pub(crate) fn plain(roughness: f32) -> SurfaceParameters {
    SurfaceParameters {
        base_color: Vec3::splat(0.8),
        metallic: 0.0,
        roughness,
        ior: 1.5,
        specular: 1.0,
        specular_color: Vec3::ONE,
        transmission: 0.0,
        diffuse_transmission: 0.0,
        diffuse_transmission_color: Vec3::ONE,
        clearcoat: 0.0,
        clearcoat_roughness: 0.0,
        sheen_color: Vec3::ZERO,
        sheen_roughness: 0.0,
        thin_walled: true,
    }
}

pub(crate) fn metal(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { metallic: 1.0, base_color: Vec3::new(1.0, 0.7, 0.2), ..plain(roughness) }
}

/// A refracting body.
pub(crate) fn glass(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { transmission: 1.0, thin_walled: false, ..plain(roughness) }
}

pub(crate) fn thin_glass(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { transmission: 1.0, ..plain(roughness) }
}

pub(crate) fn leaf(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { diffuse_transmission: 0.6, ..plain(roughness) }
}

/// A coat of this roughness on a rough dielectric.
pub(crate) fn coated(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { clearcoat: 0.9, clearcoat_roughness: roughness, ..plain(0.7) }
}

pub(crate) fn cloth(roughness: f32) -> SurfaceParameters {
    SurfaceParameters {
        sheen_color: Vec3::new(0.9, 0.6, 0.3),
        sheen_roughness: roughness,
        ..plain(0.8)
    }
}

/// Every lobe there is.
pub(crate) fn everything(roughness: f32) -> SurfaceParameters {
    SurfaceParameters {
        base_color: Vec3::new(0.9, 0.6, 0.7),
        metallic: 0.3,
        ior: 1.7,
        specular: 0.8,
        specular_color: Vec3::new(1.0, 0.5, 0.9),
        transmission: 0.4,
        diffuse_transmission: 0.3,
        diffuse_transmission_color: Vec3::new(0.2, 0.9, 0.5),
        clearcoat: 0.5,
        clearcoat_roughness: 0.3,
        sheen_color: Vec3::new(0.4, 0.5, 0.2),
        sheen_roughness: 0.4,
        thin_walled: false,
        ..plain(roughness)
    }
}

/// A coated body, in part refracting, in part metal, in part diffuse.
pub(crate) fn half_glass(roughness: f32) -> SurfaceParameters {
    SurfaceParameters { diffuse_transmission: 0.0, transmission: 0.6, ..everything(roughness) }
}

/// All of the above, by name.
pub(crate) fn all(roughness: f32) -> Vec<(&'static str, SurfaceParameters)> {
    vec![
        ("plain", plain(roughness)),
        ("metal", metal(roughness)),
        ("glass", glass(roughness)),
        ("thin glass", thin_glass(roughness)),
        ("leaf", leaf(roughness)),
        ("coated", coated(roughness)),
        ("cloth", cloth(roughness)),
        ("half glass", half_glass(roughness)),
        ("everything", everything(roughness)),
        ("everything, thin", SurfaceParameters { thin_walled: true, ..everything(roughness) }),
    ]
}

/// The same without absorption.
pub(crate) fn white(p: SurfaceParameters) -> SurfaceParameters {
    SurfaceParameters {
        base_color: Vec3::ONE,
        diffuse_transmission_color: Vec3::ONE,
        sheen_color: if p.sheen_color == Vec3::ZERO { Vec3::ZERO } else { Vec3::ONE },
        ..p
    }
}

/// Seen from the front or the back.
pub(crate) fn bsdf(p: &SurfaceParameters, entering: bool) -> Bsdf {
    Bsdf::new(p, NORMAL, NORMAL, entering)
}

/// A unit direction with this cosine to [`NORMAL`], at an azimuth in turns.
pub(crate) fn direction(cos: f32, turn: f32) -> Vec3 {
    let (x, y) = pileus_math::basis(NORMAL);
    let (sin_phi, cos_phi) = (turn * std::f32::consts::TAU).sin_cos();
    let sin = (1.0 - cos * cos).sqrt();
    (sin * (cos_phi * x + sin_phi * y) + cos * NORMAL).normalize()
}
