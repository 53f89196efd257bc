//! What holds for any surface in range and any pair of directions.

use glam::Vec3;
use pileus_scene::{Bsdf, SurfaceParameters};
use proptest::prelude::*;

/// A number in [0, 1], often one of its ends.
fn share() -> impl Strategy<Value = f32> {
    prop_oneof![2 => 0.0f32..=1.0, 1 => Just(0.0f32), 1 => Just(1.0f32), 1 => 0.0f32..0.05]
}

fn color() -> impl Strategy<Value = Vec3> {
    (share(), share(), share()).prop_map(|(r, g, b)| Vec3::new(r, g, b))
}

fn surface() -> impl Strategy<Value = SurfaceParameters> {
    let index = prop_oneof![
        4 => 1.0f32..3.0,
        1 => Just(1.0f32),
        1 => Just(f32::INFINITY),
        1 => 1.0f32..1.001,
        1 => 1.0f32..1e6,
    ];
    let first = (color(), share(), share(), index, share(), color(), share());
    let second = (share(), color(), share(), share(), color(), share(), any::<bool>());
    (first, second).prop_map(|(a, b)| SurfaceParameters {
        base_color: a.0,
        metallic: a.1,
        roughness: a.2,
        ior: a.3,
        specular: a.4,
        // The extension allows more than 1.
        specular_color: a.5 * 3.0,
        transmission: a.6,
        diffuse_transmission: b.0,
        diffuse_transmission_color: b.1,
        clearcoat: b.2,
        clearcoat_roughness: b.3,
        sheen_color: b.4,
        sheen_roughness: b.5,
        thin_walled: b.6,
    })
}

/// Any unit direction, often nearly in the plane of the normal z, or along it.
fn direction() -> impl Strategy<Value = Vec3> {
    let z = prop_oneof![
        3 => -1.0f32..=1.0,
        1 => -1e-3f32..1e-3,
        1 => Just(0.0f32),
        1 => Just(1.0f32),
        1 => Just(-1.0f32),
    ];
    (z, 0.0f32..std::f32::consts::TAU).prop_map(|(z, phi)| {
        let sin = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(sin * phi.cos(), sin * phi.sin(), z).normalize()
    })
}

/// A unit number below 1, often an end.
fn canonical() -> impl Strategy<Value = f32> {
    prop_oneof![4 => 0.0f32..1.0, 1 => Just(0.0f32), 1 => Just(1.0f32 - f32::EPSILON / 2.0)]
}

fn sound(v: Vec3) -> bool {
    v.is_finite() && v.min_element() >= 0.0
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 40_000, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(6),
        ..ProptestConfig::default()
    })]

    /// Values, densities and weights are finite and not negative; a sample's weight is value over
    /// density, to the last bit.
    #[test]
    fn values_are_sound(
        p in surface(), entering in any::<bool>(), tilt in direction(), amount in 0.0f32..0.9,
        wo in direction(), wi in direction(), u in (canonical(), canonical(), canonical()),
    ) {
        let geometric = (Vec3::Z + amount * tilt).normalize();
        let bsdf = Bsdf::new(&p, Vec3::Z, geometric, entering);
        let (value, pdf) = bsdf.eval_pdf(wo, wi);
        prop_assert!(sound(value) && pdf.is_finite() && pdf >= 0.0, "{value} {pdf}");
        prop_assert!(sound(bsdf.albedo()) && bsdf.albedo().max_element() <= 1.0);
        if bsdf.is_delta() {
            prop_assert_eq!((value, pdf), (Vec3::ZERO, 0.0));
        }
        if let Some(s) = bsdf.sample(wo, [u.0, u.1, u.2]) {
            prop_assert!(sound(s.weight) && (s.wi.length() - 1.0).abs() < 1e-5, "{s:?}");
            prop_assert_eq!(s.transmitted, geometric.dot(s.wi) < 0.0);
            if s.delta {
                prop_assert_eq!(s.pdf, 0.0);
            } else {
                prop_assert!(!bsdf.is_delta());
                let (value, pdf) = bsdf.eval_pdf(wo, s.wi);
                prop_assert_eq!(pdf, s.pdf);
                prop_assert_eq!(value / pdf, s.weight);
            }
        }
    }
}
