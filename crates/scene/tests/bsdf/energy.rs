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
    let m = if p.roughness < 0.15 { 1536 } else { 192 };
    let [r, t] = over_sphere(&lobes(p, wo, true), [256, m], |w| bsdf.eval(wo, w).as_dvec3());
    r + t
}

/// Directional albedo of all lobes, by a quasi-random rule of `n` points; the scale of radiance
/// taken out.
fn albedo_of_samples(bsdf: &Bsdf, wo: Vec3, scale: f64, n: u32) -> DVec3 {
    // Powers of the root of x^4 = x + 1: the sequence of least discrepancy of its kind in three
    // dimensions.
    let root = 1.220_744_084_605_759_5f64;
    let at = |k: u32, axis: i32| {
        ((0.5 + f64::from(k) * root.powi(-axis)).fract() as f32).min(0.999_999_9)
    };
    let sum: DVec3 = (0..n)
        .filter_map(|k| bsdf.sample(wo, [at(k, 1), at(k, 2), at(k, 3)]))
        .map(|s| s.weight.as_dvec3() * if s.transmitted { scale } else { 1.0 })
        .sum();
    sum / f64::from(n)
}

/// A white metal loses less than 1 % at any roughness and angle, and gains no more than the table's
/// error.
#[test]
fn white_metal() {
    let mut range = [2.0f64, 0.0];
    for roughness in [0.05f32, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0] {
        for cos in COSINES {
            let albedo = albedo(&white(metal(roughness)), cos).x;
            range = [range[0].min(albedo), range[1].max(albedo)];
            assert!((0.995..1.003).contains(&albedo), "roughness {roughness}, cos {cos}: {albedo}");
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
                assert!((0.995..1.003).contains(&albedo), "{p:?}, cos {cos}: {albedo}");
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
            assert!((0.995..1.003).contains(&albedo), "roughness {roughness}, cos {cos}: {albedo}");
        }
    }
}

/// Every kind of surface, white, both sides, roughness 0 to 1: never above 1. Prints the least of
/// each.
#[test]
fn never_above_one() {
    for (k, (name, _)) in all(0.0).into_iter().enumerate() {
        let (mut least, mut most) = (2.0f64, 0.0f64);
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
                    let sum = albedo_of_samples(&bsdf, direction(cos, 0.7), scale, 10_000);
                    assert!(
                        sum.max_element() < 1.012,
                        "{name}, roughness {roughness}, cos {cos}, entering {entering}: {sum}"
                    );
                    least = least.min(sum.x);
                    most = most.max(sum.max_element());
                }
            }
        }
        println!("{name}: {least:.3} to {most:.4}");
    }
}

/// What rough glass loses, since bounces between its facets are not modelled.
#[test]
fn rough_glass_loses_little() {
    for (roughness, bound) in [(0.0f32, 0.0), (0.2, 0.002), (0.5, 0.07), (1.0, 0.6)] {
        for entering in [true, false] {
            let p = white(crate::materials::glass(roughness));
            let bsdf = bsdf(&p, entering);
            let scale = if entering { 2.25 } else { 1.0 / 2.25 };
            let losses = [0.1f32, 0.5, 1.0]
                .map(|cos| 1.0 - albedo_of_samples(&bsdf, direction(cos, 0.1), scale, 20_000).x);
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
                mean += albedo_of_samples(&bsdf, wo, scale, 4000) / f64::from(n);
            }
            let estimate = bsdf.albedo().as_dvec3();
            let error = estimate - mean;
            assert!(
                error.min_element() > -0.1 && error.max_element() < 0.2,
                "{name}, roughness {roughness}: {estimate} for {mean}"
            );
        }
    }
}
