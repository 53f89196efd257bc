//! Furnaces: light that is the same everywhere stays so, whatever is in it.

use crate::floor;
use glam::{DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::{Medium, Phase};
use pileus_scene::Scene;
use pileus_tests::*;
use serde_json::{Value, json};

/// Single precision over some dozens of products.
const ROUNDING: f64 = 2e-5;

fn hg(g: f32) -> Phase {
    Phase::henyey_greenstein(g)
}

/// These media and surfaces in constant light of radiance one.
fn furnace(media: Vec<Medium>, meshes: &[(Triangles, Value)]) -> Scene {
    let mut scene = scene(media, DVec3::new(3.0, 2.0, 4.0), DVec3::ZERO, 24.0);
    scene.surfaces = Some(surfaces(meshes));
    scene.environment.constant = Vec3::ONE;
    scene
}

fn white_ball_on_a_plane() -> Vec<(Triangles, Value)> {
    let (plane, _) = floor(0.9, 1.0);
    let white = lambert([1.0; 3]);
    vec![(plane, white.clone()), (sphere(DVec3::new(0.1, 0.42, 0.0), 0.4, 8), white)]
}

/// White diffuse surfaces in media that only scatter: one grey, one chromatic, two that overlap.
#[test]
fn white_diffuse_surfaces_in_media_that_scatter() {
    let white = |extinction, g| lumpy_grid(1.0, extinction, [1.0; 3], hg(g));
    let exact = furnace(vec![white([2.0; 3], 0.5)], &white_ball_on_a_plane());
    let image = rendered(&exact, &settings(64, 1));
    assert!(image.counters.bounces > 2 * image.counters.paths, "{:?}", image.counters);
    assert_one("grey", &image, ROUNDING, 1e-3);
    let chromatic = furnace(vec![white([2.0, 0.8, 0.2], -0.3)], &white_ball_on_a_plane());
    assert_one("chromatic", &rendered(&chromatic, &settings(96, 2)), ROUNDING, 4e-3);
    let around = cube_homogeneous(1.2, [0.3, 0.6, 0.9], [1.0; 3], Phase::Isotropic);
    let two = furnace(vec![white([2.0, 0.8, 0.2], 0.7), around], &white_ball_on_a_plane());
    assert_one("two that overlap", &rendered(&two, &settings(96, 3)), ROUNDING, 5e-3);
}

/// A ball of smooth glass and one of rough white metal in a medium that only scatters. Glass is
/// exact; metal loses what the table of its albedo interpolates, which the tests of the BSDF hold
/// below 2e-3 a bounce.
#[test]
fn glass_and_metal_in_media_that_scatter() {
    let medium = || vec![lumpy_grid(1.0, [1.0; 3], [1.0; 3], hg(0.5))];
    let ball = || sphere(DVec3::new(0.1, 0.0, 0.2), 0.7, 12);
    let clear = rendered(&furnace(medium(), &[(ball(), glass(1.5))]), &settings(64, 4));
    assert_one("glass", &clear, ROUNDING, 1e-3);
    for roughness in [0.15, 0.5, 1.0] {
        let metal =
            json!({"pbrMetallicRoughness": {"metallicFactor": 1.0, "roughnessFactor": roughness}});
        let image = rendered(&furnace(medium(), &[(ball(), metal)]), &settings(64, 5));
        assert_one(&format!("metal of roughness {roughness}"), &image, 4e-3, 2e-3);
    }
}

/// Glass whose inside only scatters, grey and chromatic, smooth and straight (index 1).
#[test]
fn glass_that_scatters_inside() {
    for (k, (ior, color)) in
        [(1.0, [0.1, 0.1, 0.1]), (1.33, [0.3, 0.3, 0.3]), (1.5, [0.05, 0.3, 0.8])]
            .into_iter()
            .enumerate()
    {
        let mut material = glass(ior);
        material["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 1.0, "attenuationDistance": 1.0,
            "attenuationColor": color});
        material["extensions"]["KHR_materials_volume_scatter"] =
            json!({"multiscatterColor": [1.0, 1.0, 1.0], "scatterAnisotropy": 0.3});
        let scene = furnace(vec![], &[(sphere(DVec3::ZERO, 0.8, 12), material)]);
        let image = rendered(&scene, &settings(256, 6 + k as u64));
        assert!(image.counters.bounces > image.counters.paths);
        assert_one(&format!("index {ior}, {color:?}"), &image, ROUNDING, 4e-3);
    }
}

/// Everything at one temperature: bodies emit what they absorb (Kirchhoff), light is one
/// everywhere. Area lights, fire, media and surfaces at once, by shadow rays and paths, and by
/// paths alone; grey and per channel.
#[test]
fn thermal_equilibrium() {
    let mut meshes = Vec::new();
    let grey_body = |reflected: [f32; 3]| area_light(reflected, reflected.map(|r| 1.0 - r));
    // Its back absorbs, and so has to emit light.
    let mut ground = grey_body([0.6, 0.5, 0.4]);
    ground["doubleSided"] = serde_json::json!(true);
    meshes.push((floor(0.9, 1.0).0, ground));
    meshes.push((sphere(DVec3::new(0.1, 0.42, 0.0), 0.3, 4), grey_body([0.2, 0.5, 0.9])));
    // Glass beside the medium: in it, light is n^2, and fire would have to be.
    meshes.push((sphere(DVec3::new(0.6, 0.0, 1.8), 0.3, 6), glass(1.5)));
    for (k, sigma_t) in [[1.5f32; 3], [2.0, 1.0, 0.3]].into_iter().enumerate() {
        let albedo = [0.6, 0.8, 0.3];
        let color = [0, 1, 2].map(|c: usize| sigma_t[c] * (1.0 - albedo[c]));
        let mut scene = furnace(vec![], &meshes);
        scene.volumes.push(glowing_cube(1.0, sigma_t, albedo, color));
        for (light_sampling, spp) in [(LightSampling::Both, 64), (LightSampling::Paths, 96)] {
            let settings = RenderSettings { light_sampling, ..settings(spp, 30 + k as u64) };
            let image = rendered(&scene, &settings);
            assert_one(&format!("{light_sampling:?}, {sigma_t:?}"), &image, 1e-4, 4e-3);
        }
    }
}
