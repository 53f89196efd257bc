//! Emissive triangles: closed forms, sides, fog, and all lights together.

use crate::{floor, floor_scene, form_factor_pi, on_floor};
use glam::{DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::Phase;
use pileus_scene::{EnvironmentImage, Light, Point, Scene};
use pileus_tests::*;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::sync::Arc;

const COLOR: [f32; 3] = [2.0, 1.0, 0.5];
const TECHNIQUES: [(LightSampling, u64); 2] =
    [(LightSampling::Both, 64), (LightSampling::Paths, 128)];

/// A square of edge one at height one; its front is below unless `up`.
fn square(up: bool) -> Triangles {
    let (a, b) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let (a, b) = if up { (b, a) } else { (a, b) };
    quad([-0.6, 1.0, -0.4], a, b)
}

/// What a Lambertian floor of albedo 0.6 shows of black area lights of radiance [`COLOR`], by
/// Lambert's formula over all triangles that face it.
fn check_floor(what: &str, scene: &Scene, triangles: &Triangles, settings: &RenderSettings) {
    let image = rendered(scene, settings);
    let triangles: Vec<[DVec3; 3]> =
        triangles.iter().map(|t| t.map(|p| Vec3::from_array(p).as_dvec3())).collect();
    assert_expected(what, &image, 6e-3, |x, y| {
        let p = on_floor(pixel_ray(scene, x, y));
        let facing =
            triangles.iter().filter(|[a, b, c]| (*b - *a).cross(*c - *a).dot(p - *a) > 0.0);
        let e: f64 = facing.map(|t| form_factor_pi(p, DVec3::Y, t)).sum();
        COLOR.map(|c| f64::from(c) * 0.6 / PI * e)
    });
}

/// A square of 2 triangles, and a ball of some 1900.
#[test]
fn lamps_light_a_floor_by_lamberts_formula() {
    let ball = sphere(DVec3::new(0.1, 0.8, -0.1), 0.25, 11);
    assert!(ball.len() > 1800, "{}", ball.len());
    for (name, triangles) in [("square", square(false)), ("ball", ball)] {
        let scene =
            floor_scene(&[floor(3.0, 0.6), (triangles.clone(), area_light([0.0; 3], COLOR))]);
        for (light_sampling, spp) in TECHNIQUES {
            let settings = RenderSettings { light_sampling, ..point_filter(spp, 1) };
            check_floor(&format!("{name}, {light_sampling:?}"), &scene, &triangles, &settings);
        }
    }
}

/// Backs of single-sided area lights are dark and not there; those of double-sided ones shine.
#[test]
fn backs_of_lamps() {
    let one_sided = area_light([0.0; 3], COLOR);
    let mut two_sided = one_sided.clone();
    two_sided["doubleSided"] = json!(true);
    for (light_sampling, spp) in TECHNIQUES {
        let settings = RenderSettings { light_sampling, ..point_filter(spp, 2) };
        let scene = floor_scene(&[floor(3.0, 0.6), (square(true), one_sided.clone())]);
        let dark = rendered(&scene, &settings);
        for c in ["R", "G", "B"] {
            assert!(dark.image.channel(c).unwrap().iter().all(|v| *v == 0.0));
        }
        let scene = floor_scene(&[floor(3.0, 0.6), (square(true), two_sided.clone())]);
        check_floor("back of a double-sided area light", &scene, &square(false), &settings);
    }
    // Seen from below: through the back of the one, at the light of the other.
    for (material, shine) in [(one_sided, 0.0), (two_sided, 1.0)] {
        let mut scene = scene(vec![], DVec3::new(0.0, 0.0, 0.1), DVec3::Y, 20.0);
        scene.surfaces = Some(surfaces(&[(square(true), material)]));
        scene.environment.constant = Vec3::new(0.0, 0.0, 0.25);
        let image = rendered(&scene, &settings(8, 3));
        let behind = (1.0 - shine) * 0.25;
        assert_expected("area light from below", &image, 0.0, |_, _| {
            [2.0 * shine, shine, 0.5 * shine + behind]
        });
    }
}

/// An area light in fog that scatters, over a floor: shadow rays and paths together give what paths
/// alone do, grey and per channel; and through fog that absorbs alone it is seen by Beer-Lambert.
#[test]
fn lamps_in_fog() {
    for (k, sigma_t) in [[0.8f32; 3], [1.2, 0.6, 0.1]].into_iter().enumerate() {
        let fog = lumpy_grid(2.0, sigma_t, [0.9, 0.8, 0.7], Phase::henyey_greenstein(0.5));
        let mut scene =
            scene(vec![fog], DVec3::new(0.5, 0.6, 3.0), DVec3::new(0.0, 0.5, 0.0), 40.0);
        scene.surfaces =
            Some(surfaces(&[floor(1.5, 0.6), (square(false), area_light([0.2; 3], COLOR))]));
        let by = |light_sampling, spp, seed| {
            rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
        };
        let both = by(LightSampling::Both, 64, 10 + k as u64);
        let paths = by(LightSampling::Paths, 256, 20 + k as u64);
        assert_same(&format!("fog {sigma_t:?}"), &both, &paths, 9e-3);
        let mut seen = scene.clone();
        seen.volumes = pileus_tests::scene(
            vec![cube_homogeneous(2.0, sigma_t, [0.0; 3], Phase::Isotropic)],
            DVec3::Z,
            DVec3::ZERO,
            20.0,
        )
        .volumes;
        seen.camera = pileus_scene::Camera::look_at(
            DVec3::new(0.1, 0.0, 0.2),
            DVec3::new(0.0, 1.0, 0.1),
            DVec3::Z,
            30.0,
            [64, 64],
        )
        .unwrap();
        // No light that the floor sends back.
        let settings = RenderSettings { max_bounces: Some(0), ..point_filter(64, 12) };
        let image = rendered(&seen, &settings);
        assert_expected("area light through fog", &image, 1.6e-3, |x, y| {
            let (o, d) = pixel_ray(&seen, x, y);
            let t = (1.0 - o.y) / d.y;
            [0, 1, 2].map(|c| f64::from(COLOR[c]) * (-f64::from(sigma_t[c]) * t).exp())
        });
    }
}

/// A scene with every kind of light.
fn all_lights() -> Scene {
    let rough = json!({"pbrMetallicRoughness": {"metallicFactor": 1.0, "roughnessFactor": 0.3}});
    let meshes: Vec<(Triangles, Value)> = vec![
        floor(1.5, 0.6),
        (square(false), area_light([0.2; 3], COLOR)),
        (sphere(DVec3::new(-0.7, 0.3, 0.6), 0.2, 6), area_light([0.3; 3], [0.5, 1.0, 3.0])),
        (sphere(DVec3::new(0.7, 0.3, 0.4), 0.3, 8), rough),
    ];
    let mut scene = scene(vec![], DVec3::new(1.0, 1.2, 3.0), DVec3::new(0.0, 0.3, 0.0), 40.0);
    scene.surfaces = Some(surfaces(&meshes));
    scene.volumes.push(glowing_cube(0.4, [1.5; 3], [0.7; 3], [1.0, 0.6, 0.2]));
    scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(0.6, 0.5, 0.4), 0.2));
    scene.lights.push(sun(Vec3::new(-0.5, 0.6, 0.3), Vec3::new(0.1, 0.2, 0.4), 0.0));
    let position = DVec3::new(-0.9, 0.7, -0.5);
    scene.lights.push(Light::Point(Point { position, intensity: Vec3::splat(0.2) }));
    let texels = (0..32 * 16).map(|i| if i % 32 < 4 { [1.5; 3] } else { [0.1; 3] }).collect();
    let image = EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap();
    scene.environment.image = Some(Arc::new(image));
    scene
}

/// Delta lights, a disc, an image, area lights and fire at once: the choice among them, and all
/// weights.
#[test]
fn all_lights_by_both_techniques_are_all_lights_by_paths() {
    let scene = all_lights();
    let by = |light_sampling, spp, seed| {
        rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
    };
    let both = by(LightSampling::Both, 64, 1);
    let paths = by(LightSampling::Paths, 512, 2);
    assert_same("all lights", &both, &paths, 3e-3);
}
