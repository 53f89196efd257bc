//! Delta lobes, shading normals and other limits in closed form.

use glam::Vec3;
use pileus_scene::{Bsdf, BsdfSample, SurfaceParameters};

use crate::materials::{
    NORMAL, all, bsdf, coated, direction, glass, metal, plain, thin_glass, white,
};

/// All samples over a fine grid of the number that picks the lobe.
fn picks(bsdf: &Bsdf, wo: Vec3) -> Vec<BsdfSample> {
    (0..4096).filter_map(|k| bsdf.sample(wo, [(k as f32 + 0.5) / 4096.0, 0.4, 0.6])).collect()
}

/// Fresnel's equations in double precision.
fn fresnel(cos: f64, eta: f64) -> f64 {
    let sin2 = (1.0 - cos * cos) / (eta * eta);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let t = (1.0 - sin2).sqrt();
    let s = (cos - eta * t) / (cos + eta * t);
    let p = (eta * cos - t) / (eta * cos + t);
    0.5 * (s * s + p * p)
}

/// Smooth glass obeys Snell and Fresnel; radiance scales by the square of the index.
#[test]
fn smooth_glass() {
    for entering in [true, false] {
        let eta = if entering { 1.5f32 } else { 1.0 / 1.5 };
        let bsdf = bsdf(&white(glass(0.0)), entering);
        assert!(bsdf.is_delta());
        for cos in [0.1f32, 0.5, 0.8, 1.0] {
            let wo = direction(cos, 0.6);
            assert_eq!(bsdf.eval_pdf(wo, direction(-cos, 0.1)), (Vec3::ZERO, 0.0));
            let samples = picks(&bsdf, wo);
            assert_eq!(samples.len(), 4096);
            let mut reflected = 0.0;
            for s in &samples {
                assert!(s.delta && s.pdf == 0.0);
                // Tangential components: continuous across the interface, the same in the mirror.
                let ratio = if s.transmitted { eta } else { 1.0 };
                assert!((wo.cross(NORMAL) + ratio * s.wi.cross(NORMAL)).length() < 2e-6);
                assert_eq!(s.transmitted, NORMAL.dot(s.wi) < 0.0);
                let weight = if s.transmitted { 1.0 / (eta * eta) } else { 1.0 };
                assert!((s.weight - Vec3::splat(weight)).abs().max_element() < 1e-5);
                reflected += f64::from(u8::from(!s.transmitted)) / 4096.0;
            }
            let exact = fresnel(f64::from(cos), f64::from(eta));
            assert!((reflected - exact).abs() < 4e-4, "cos {cos}: {reflected} for {exact}");
        }
    }
}

/// A thin wall lets light pass straight on, rough or not by delta lobes; it takes the base colour.
#[test]
fn thin_wall_is_straight() {
    let bsdf = bsdf(&thin_glass(0.0), true);
    for cos in [0.05f32, 0.5, 1.0] {
        let wo = direction(cos, 0.25);
        let (mut reflected, mut passed) = (0.0f64, 0.0f64);
        for s in picks(&bsdf, wo) {
            if s.transmitted {
                assert_eq!(s.wi, -wo);
                passed += f64::from(s.weight.x) / 4096.0;
            } else {
                reflected += f64::from(s.weight.x) / 4096.0;
            }
        }
        let schlick = 0.04 + 0.96 * (1.0 - f64::from(cos)).powi(5);
        assert!(
            (reflected - schlick).abs() < 5e-4 && (passed - 0.8 * (1.0 - schlick)).abs() < 5e-4
        );
    }
}

/// A mirror of metal: Schlick's factor; under a smooth coat both mirrors together.
#[test]
fn mirrors() {
    let cos = 0.4f32;
    let wo = direction(cos, 0.9);
    let mirror = (2.0 * NORMAL.dot(wo) * NORMAL - wo).normalize();
    let schlick = (1.0 - cos).powi(5);
    let total = |bsdf: &Bsdf| {
        picks(bsdf, wo)
            .iter()
            .filter(|s| s.delta)
            .map(|s| {
                assert!((s.wi - mirror).length() < 1e-6);
                s.weight / 4096.0
            })
            .sum::<Vec3>()
    };
    let p = metal(0.0);
    let fresnel = p.base_color + (Vec3::ONE - p.base_color) * schlick;
    assert!((total(&bsdf(&p, true)) - fresnel).abs().max_element() < 1e-4);
    let coat = 0.5 * (0.04 + 0.96 * schlick);
    let p = SurfaceParameters { clearcoat: 0.5, ..p };
    assert!(bsdf(&p, true).is_delta());
    let both = coat + (1.0 - coat) * fresnel;
    assert!((total(&bsdf(&p, true)) - both).abs().max_element() < 1e-3);
    assert!(!bsdf(&coated(0.0), true).is_delta());
    assert!(!bsdf(&plain(0.0), true).is_delta());
}

/// Seen from inside of a body, coat and sheen cover the other side.
#[test]
fn body_has_its_coat_outside() {
    let p = SurfaceParameters { clearcoat: 1.0, clearcoat_roughness: 0.5, ..glass(0.0) };
    assert!(!bsdf(&p, true).is_delta());
    assert!(bsdf(&p, false).is_delta());
}

/// Indices that are equal bend nothing and reflect nothing, at any roughness.
#[test]
fn body_of_index_one_is_invisible() {
    for roughness in [0.0f32, 0.5] {
        let p = white(SurfaceParameters { ior: 1.0, ..glass(roughness) });
        let wo = direction(0.3, 0.2);
        let bsdf = bsdf(&p, true);
        let passed: Vec<_> = picks(&bsdf, wo).into_iter().filter(|s| s.transmitted).collect();
        let mean: f32 = passed.iter().map(|s| s.weight.x / 4096.0).sum();
        assert!(passed.iter().all(|s| s.delta && (s.wi + wo).length() < 1e-6));
        // Schlick's factor still rises to 1 at grazing angles; the exact one is zero.
        assert!((mean - 1.0).abs() < 1e-3, "roughness {roughness}: {mean}");
    }
}

/// No value and no sample crosses the geometric surface where the shading normal would let it.
#[test]
fn shading_normals_do_not_leak() {
    let geometric = (NORMAL + 0.6 * direction(0.0, 0.1)).normalize();
    let mut rng = rand_pcg::Pcg32::new(4, 4);
    let mut next = || pileus_math::random::uniform(&mut rng);
    for roughness in [0.0f32, 0.3, 1.0] {
        for (name, p) in all(roughness) {
            let bsdf = Bsdf::new(&p, NORMAL, geometric, true);
            for _ in 0..2000 {
                let wo = direction(0.9 * next() + 0.05, next());
                if wo.dot(geometric) <= 0.0 {
                    continue;
                }
                let wi = direction(2.0 * next() - 1.0, next());
                if NORMAL.dot(wi) * geometric.dot(wi) < 0.0 {
                    assert_eq!(bsdf.eval_pdf(wo, wi), (Vec3::ZERO, 0.0), "{name}");
                }
                if let Some(s) = bsdf.sample(wo, [next(), next(), next()]) {
                    assert_eq!(s.transmitted, geometric.dot(s.wi) < 0.0, "{name}");
                    assert!(s.weight.max_element() < 1e3, "{name}: {s:?}");
                }
            }
        }
    }
}
