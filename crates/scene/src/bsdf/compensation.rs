//! What a microfacet reflection loses to its own shadowing, and how it is given back.
//!
//! A single bounce between facets loses light: at roughness 1 a white metal keeps 1 - ln 2 = 0.31
//! along the normal. The light lost has bounced more than once; after Kulla and Conty (2017) it
//! leaves as a reciprocal lobe `(1 - E(o)) (1 - E(i)) / (pi (1 - E_avg))`, coloured by the Fresnel
//! factors of its bounces.

use glam::Vec3;

use super::fresnel::{SCHLICK_AVERAGE, schlick};
use super::ggx::Ggx;
use super::table::{CosineTable, Row};

/// Directional albedo of a GGX reflection: without Fresnel factor, and with Schlick's `(1 - cos)^5`
/// as factor.
static REFLECTION: CosineTable<2> =
    CosineTable::new(|r| r * r, |cos, r| quadrature(cos, r, [16, 48]));

/// Midpoint rule over the random numbers of the sampling of visible normals; half a turn by
/// symmetry.
fn quadrature(cos: f32, roughness: f32, [turns, caps]: [u32; 2]) -> [f32; 2] {
    // At zero all terms of the shadowing vanish; a tiny width stands for the edge of a smooth
    // surface.
    let cos = cos.max(1e-7);
    let ggx = Ggx::of_width((roughness * roughness).max(1e-5));
    let o = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let mut sum = [0.0f64; 2];
    for a in 0..turns {
        for b in 0..caps {
            // Squared towards 1: the tail of the distribution, whose light is lost.
            let rest = 1.0 - (b as f32 + 0.5) / caps as f32;
            let u = [(a as f32 + 0.5) / (2 * turns) as f32, 1.0 - rest * rest];
            let h = ggx.sample(o, u);
            let oh = o.dot(h).max(0.0);
            let cos_i = 2.0 * oh * h.z - o.z;
            if cos_i > 0.0 {
                let weight = f64::from(ggx.weight_mirrored(cos, cos_i) * 2.0 * rest);
                sum[0] += weight;
                sum[1] += weight * f64::from(schlick(oh));
            }
        }
    }
    sum.map(|s| (s / f64::from(turns * caps)) as f32)
}

/// Directional albedo of a GGX reflection over the cosine, for one roughness.
///
/// An albedo is a pair: for the Fresnel factor 1, and for Schlick's `(1 - cos)^5`. So that of
/// `f0 + (1 - f0) schlick` is `f0 first + (1 - f0) second`.
#[derive(Debug, Clone, Copy)]
pub(super) enum ReflectionAlbedo {
    /// A mirror: loses nothing.
    Smooth,
    /// From the table.
    Rough(Row<2>),
}

impl ReflectionAlbedo {
    /// For a perceptual roughness and its distribution.
    pub(super) fn new(roughness: f32, ggx: Option<Ggx>) -> ReflectionAlbedo {
        match ggx {
            Some(_) => ReflectionAlbedo::Rough(REFLECTION.row(roughness)),
            None => ReflectionAlbedo::Smooth,
        }
    }

    /// At a cosine in [0, 1].
    #[inline]
    pub(super) fn at(&self, cos: f32) -> [f32; 2] {
        match self {
            ReflectionAlbedo::Smooth => [1.0, schlick(cos)],
            ReflectionAlbedo::Rough(row) => row.at(cos),
        }
    }

    /// Mean over the hemisphere, weighted by the cosine.
    #[inline]
    pub(super) fn average(&self) -> [f32; 2] {
        match self {
            ReflectionAlbedo::Smooth => [1.0, SCHLICK_AVERAGE],
            ReflectionAlbedo::Rough(row) => row.average(),
        }
    }
}

/// Share of the light lost by single bounces that leaves in the end, per channel.
///
/// `fresnel` is the mean Fresnel factor, `albedo` the mean albedo without it: a geometric series of
/// bounces, in which the first is already accounted for (Kulla and Conty 2017 with the correction
/// of Hill 2018). 1 for a white metal.
#[inline]
pub(super) fn multiple_bounces(fresnel: Vec3, albedo: f32) -> Vec3 {
    let bounced = Vec3::ONE - fresnel * (1.0 - albedo);
    fresnel * fresnel * albedo / bounced.max(Vec3::splat(1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The interpolated table against a finer quadrature, off its nodes. Where facets are narrow
    /// the albedo falls steeply at grazing angles.
    #[test]
    fn table_is_the_albedo() {
        for (roughness, bound) in [
            (0.05f32, 4e-3f32),
            (0.11, 2e-3),
            (0.23, 2e-3),
            (0.41, 2e-3),
            (0.63, 1e-3),
            (1.0, 1e-3),
        ] {
            let row = REFLECTION.row(roughness);
            for k in 0..40 {
                let cos = (k as f32 + 0.5) / 40.0;
                let fine = quadrature(cos, roughness, [64, 256]);
                let table = row.at(cos);
                let error = (fine[0] - table[0]).abs().max((fine[1] - table[1]).abs());
                assert!(error < bound, "roughness {roughness}, cos {cos}: {table:?} for {fine:?}");
            }
        }
    }

    /// For alpha = 1 seen along the normal the value times cosine is `c / (2 pi (1 + c))`, its
    /// integral `1 - ln 2`.
    #[test]
    fn known_value() {
        let albedo = REFLECTION.row(1.0).at(1.0)[0];
        assert!((albedo - (1.0 - std::f32::consts::LN_2)).abs() < 1e-3, "{albedo}");
    }

    #[test]
    fn white_metal_keeps_all() {
        assert!((multiple_bounces(Vec3::ONE, 0.6) - Vec3::ONE).abs().max_element() < 1e-6);
        assert_eq!(multiple_bounces(Vec3::ZERO, 0.6), Vec3::ZERO);
    }
}
