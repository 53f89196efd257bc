//! White furnaces: nothing reflects more than it receives, and white loses little.

use glam::{DVec3, Vec3};
use pileus_scene::{Bsdf, SurfaceParameters};

use crate::materials::{all, bsdf, direction, metal, plain, thin_glass, white};
use crate::quadrature::{lobes, over_sphere};

const COSINES: [f32; 6] = [0.02, 0.1, 0.3, 0.5, 0.8, 1.0];

/// Directional albedo of all lobes but delta lobes, by quadrature over directions.
fn albedo(p: &SurfaceParameters, cos: f32) -> DVec3 {
    let bsdf = bsdf(p, true);
    let wo = direction(cos, 0.3);
    let [r, t] = over_sphere(&lobes(p, wo, true), 192, |w| bsdf.eval(wo, w).as_dvec3());
    r + t
}

/// Directional albedo of all lobes, by quadrature over random numbers; the scale of radiance taken out.
fn albedo_of_samples(bsdf: &Bsdf, wo: Vec3, scale: f64, n: u32) -> DVec3 {
    let mut sum = DVec3::ZERO;
    let at = |k: u32, n: u32| (k as f32 + 0.5) / n as f32;
    for a in 0..4 * n {
        for b in 0..n {
            for c in 0..n {
                if let Some(s) = bsdf.sample(wo, [at(a, 4 * n), at(b, n), at(c, n)]) {
                    sum += s.weight.as_dvec3() * if s.transmitted { scale } else { 1.0 };
                }
            }
        }
    }
    sum / f64::from(4 * n * n * n)
}

/// A white metal loses less than 1 % at any roughness and angle, and gains no more than the table's error.
#[test]
fn white_metal() {
    let mut range = [2.0f64, 0.0];
    for roughness in [0.05f32, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0] {
        for cos in COSINES {
            let albedo = albedo(&white(metal(roughness)), cos).x;
            range = [range[0].min(albedo), range[1].max(albedo)];
            assert!((0.99..1.008).contains(&albedo), "roughness {roughness}, cos {cos}: {albedo}");
        }
    }
    println!("white metal: {range:?}");
}

/// The same for a white opaque dielectric, at any index, strength and colour of its reflection.
#[test]
fn white_dielectric() {
    let mut range = [2.0f64, 0.0];
    for roughness in [0.1f32, 0.3, 0.6, 1.0] {
        for (ior, specular, tint) in [
            (1.5f32, 1.0f32, Vec3::ONE),
            (1.5, 0.3, Vec3::ONE),
            (2.4, 1.0, Vec3::ONE),
            (f32::INFINITY, 1.0, Vec3::splat(0.4)),
        ] {
            let p = SurfaceParameters { ior, specular, specular_color: tint, ..plain(roughness) };
            for cos in COSINES {
                let albedo = albedo(&white(p), cos).x;
                range = [range[0].min(albedo), range[1].max(albedo)];
                assert!((0.99..1.008).contains(&albedo), "{p:?}, cos {cos}: {albedo}");
            }
        }
    }
    println!("white dielectric: {range:?}");
}

/// A thin white wall keeps all: what bounces between facets leaves on both sides.
#[test]
fn white_thin_wall() {
    for roughness in [0.1f32, 0.4, 1.0] {
        for cos in COSINES {
            let albedo = albedo(&white(thin_glass(roughness)), cos).x;
            assert!((0.99..1.008).contains(&albedo), "roughness {roughness}, cos {cos}: {albedo}");
        }
    }
}

/// Every kind of surface, white, both sides, roughness 0 to 1: never above 1. Prints the least of each.
#[test]
fn never_above_one() {
    for (k, (name, _)) in all(0.0).into_iter().enumerate() {
        let mut least = 2.0f64;
        for roughness in [0.0f32, 0.04, 0.15, 0.4, 0.7, 1.0] {
            let p = white(all(roughness)[k].1);
            for entering in [true, false] {
                let bsdf = bsdf(&p, entering);
                let scale = match (p.thin_walled, entering) {
                    (true, _) => 1.0,
                    (false, true) => f64::from(p.ior).powi(2),
                    (false, false) => f64::from(p.ior).powi(-2),
                };
                for cos in COSINES {
                    let sum = albedo_of_samples(&bsdf, direction(cos, 0.7), scale, 12);
                    assert!(
                        sum.max_element() < 1.012,
                        "{name}, roughness {roughness}, cos {cos}, entering {entering}: {sum}"
                    );
                    least = least.min(sum.x);
                }
            }
        }
        println!("{name}: at least {least:.3}");
    }
}

/// What rough glass loses, since bounces between its facets are not modelled.
#[test]
fn rough_glass_loses_little() {
    for (roughness, bound) in [(0.0f32, 0.0), (0.2, 0.01), (0.5, 0.1), (1.0, 0.5)] {
        for entering in [true, false] {
            let p = white(crate::materials::glass(roughness));
            let bsdf = bsdf(&p, entering);
            let scale = if entering { 2.25 } else { 1.0 / 2.25 };
            let losses = [0.1f32, 0.5, 1.0]
                .map(|cos| 1.0 - albedo_of_samples(&bsdf, direction(cos, 0.1), scale, 16).x);
            println!("glass, roughness {roughness}, entering {entering}: {losses:.3?}");
            assert!(losses[2] < bound + 2e-3, "{losses:?}");
        }
    }
}

/// The estimate of `Bsdf::albedo` against the mean over directions.
#[test]
fn mean_albedo_is_close() {
    for roughness in [0.1f32, 0.5, 1.0] {
        for (name, p) in all(roughness) {
            let bsdf = bsdf(&p, true);
            let scale = if p.thin_walled { 1.0 } else { f64::from(p.ior).powi(2) };
            let n = 12;
            let mut mean = DVec3::ZERO;
            for k in 0..n {
                // Even in the squared cosine: weighted by the cosine.
                let cos = ((k as f32 + 0.5) / n as f32).sqrt();
                let wo = direction(cos, 0.2);
                mean += albedo_of_samples(&bsdf, wo, scale, 8) / f64::from(n);
            }
            let estimate = bsdf.albedo().as_dvec3();
            let error = (estimate - mean).abs().max_element();
            assert!(error < 0.15, "{name}, roughness {roughness}: {estimate} for {mean}");
        }
    }
}
