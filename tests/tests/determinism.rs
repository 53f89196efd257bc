//! The same bits on any number of threads, in any tiles and passes, in any split.

use glam::{DVec3, Vec3};
use pileus_film::{
    BACKGROUND, BEAUTY, DIRECT, EMISSION, FIRST_LAYERS, Film, INDIRECT, LAYERS, Layer,
};
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::Phase;
use pileus_scene::{Camera, EnvironmentImage, Light, Point, Scene};
use pileus_tests::*;
use serde_json::json;
use std::sync::Arc;

fn scenes() -> Vec<Scene> {
    let hg = || Phase::henyey_greenstein(0.7);
    let mut grey = scene(
        vec![cube_grid(1.0, [6.0; 3], [0.9, 0.8, 0.7], hg())],
        DVec3::new(3.0, 2.0, 4.0),
        DVec3::ZERO,
        40.0,
    );
    grey.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(3.0), 0.0));
    grey.environment.constant = Vec3::splat(0.3);
    let mut chromatic = grey.clone();
    chromatic.volumes = scene(
        vec![
            cube_grid(1.0, [6.0, 2.0, 0.5], [0.9, 0.8, 0.7], hg()),
            cube_homogeneous(1.4, [0.5; 3], [0.9; 3], Phase::Isotropic),
        ],
        DVec3::Z,
        DVec3::ZERO,
        40.0,
    )
    .volumes;
    let texels = (0..32 * 16).map(|i| [if i == 100 { 300.0 } else { 0.5 }; 3]).collect();
    chromatic.environment.image =
        Some(Arc::new(EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap()));
    let mut parting = grey.clone();
    parting.volumes = scene(
        vec![lumpy_grid(1.0, [6.0, 2.0, 0.5], [0.9, 0.8, 0.7], hg())],
        DVec3::Z,
        DVec3::ZERO,
        40.0,
    )
    .volumes;
    parting.environment.image = chromatic.environment.image.clone();
    let mut fire = blender("fire.glb", "fire_0003.vdb", [32, 32]);
    fire.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(3.0), 0.01));
    vec![grey, chromatic, parting, everything(), fire]
}

/// Every kind of light, of surface and of medium.
fn everything() -> Scene {
    let rough = json!({"pbrMetallicRoughness": {"metallicFactor": 1.0, "roughnessFactor": 0.3}});
    let mut sheet = lambert([0.4; 3]);
    sheet["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.4, 0.4, 0.4, 0.5]);
    sheet["alphaMode"] = json!("BLEND");
    sheet["doubleSided"] = json!(true);
    let mut milky = glass(1.4);
    milky["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 1.0, "attenuationDistance": 0.3,
        "attenuationColor": [0.6, 0.4, 0.2]});
    milky["extensions"]["KHR_materials_volume_scatter"] =
        json!({"multiscatterColor": [0.7, 0.5, 0.3]});
    let plane = quad([-1.5, 0.0, -1.5], [0.0, 0.0, 3.0], [3.0, 0.0, 0.0]);
    let above = quad([-0.6, 1.0, -0.4], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let between = quad([-0.6, 0.8, -0.4], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let mut all = scene(vec![], DVec3::new(1.0, 1.2, 3.0), DVec3::new(0.0, 0.3, 0.0), 40.0);
    all.camera = Camera::look_at(
        DVec3::new(1.0, 1.2, 3.0),
        DVec3::new(0.0, 0.3, 0.0),
        DVec3::Y,
        40.0,
        [48, 48],
    )
    .unwrap();
    all.surfaces = Some(surfaces(&[
        (plane, lambert([0.6, 0.5, 0.4])),
        (above, area_light([0.2; 3], [2.0, 1.0, 0.5])),
        (between, sheet),
        (sphere(DVec3::new(-0.7, 0.3, 0.6), 0.2, 6), area_light([0.3; 3], [0.5, 1.0, 3.0])),
        (sphere(DVec3::new(0.7, 0.3, 0.4), 0.3, 8), rough),
        (sphere(DVec3::new(-0.1, 0.3, 1.0), 0.25, 8), milky),
    ]));
    all.volumes.push(glowing_cube(0.4, [1.5, 1.0, 0.2], [0.7; 3], [1.0, 0.6, 0.2]));
    all.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(0.6, 0.5, 0.4), 0.2));
    let position = DVec3::new(-0.9, 0.7, -0.5);
    all.lights.push(Light::Point(Point { position, intensity: Vec3::splat(0.2) }));
    let texels = (0..32 * 16).map(|i| [if i == 100 { 300.0 } else { 0.5 }; 3]).collect();
    all.environment.image =
        Some(Arc::new(EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap()));
    all
}

fn state(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.write_state(&mut bytes, b"").unwrap();
    bytes
}

/// A film with all layers that there are.
fn film(scene: &Scene, settings: &RenderSettings, threads: usize) -> Film {
    let mut film = Film::with_layers(scene.camera.resolution(), None, &LAYERS).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        Renderer::new(scene, settings).expect("a plan").render(&mut film, &Unmonitored)
    })
    .unwrap();
    film
}

#[test]
fn threads_and_tiles_change_no_bit() {
    for scene in scenes() {
        let whole = state(&film(&scene, &settings(13, 3), 1));
        for (threads, tile_size) in [(2, 16), (7, 16), (7, 5), (2, 64)] {
            let other = RenderSettings { tile_size, ..settings(13, 3) };
            assert!(
                state(&film(&scene, &other, threads)) == whole,
                "{threads} threads, tiles of {tile_size}"
            );
        }
        assert!(state(&film(&scene, &settings(13, 4), 1)) != whole, "the seed has no effect");
    }
}

#[test]
fn any_split_merges_to_the_whole() {
    for scene in scenes() {
        let whole = state(&film(&scene, &settings(20, 3), 2));
        for cuts in [vec![0, 1, 20], vec![0, 7, 8, 20], vec![0, 5, 10, 15, 20]] {
            let mut merged = Film::with_layers(scene.camera.resolution(), None, &LAYERS).unwrap();
            // In reverse: order must not matter either.
            for pair in cuts.windows(2).rev() {
                let slice = RenderSettings { samples: pair[0]..pair[1], ..settings(0, 3) };
                merged.merge(&film(&scene, &slice, 2)).unwrap();
            }
            assert!(state(&merged) == whole, "cuts {cuts:?}");
        }
    }
}

#[test]
fn a_sample_is_what_the_render_adds() {
    for scene in scenes() {
        let settings = settings(3, 9);
        let renderer = Renderer::new(&scene, &settings).unwrap();
        let film = film(&scene, &settings, 2);
        for (x, y) in [(0, 0), (31, 30), (20, 25)] {
            let mut moments = pileus_film::PixelMoments::default();
            for sample in 0..3 {
                let alone = renderer.sample_pixel([x, y], sample).unwrap().unwrap();
                moments.add(sample, &alone);
            }
            assert_eq!(film.pixel(x, y), Some(&moments));
        }
    }
}

#[test]
fn layers_change_no_bit_of_the_picture() {
    for scene in scenes() {
        let settings = settings(5, 3);
        let with = film(&scene, &settings, 2);
        let without = rendered(&scene, &settings).film;
        let first = &LAYERS[..FIRST_LAYERS];
        assert_eq!(with.image_of(first).unwrap(), without.image_of(first).unwrap());
        assert_eq!(with.values_left_out(), 0);
    }
}

/// Background, emission, direct and indirect light are the picture, as the four are written.
#[test]
fn parts_of_the_light_add_up() {
    let ulp = |v: f32| f32::from_bits(v.abs().to_bits() + 1) - v.abs();
    for (i, scene) in scenes().into_iter().enumerate() {
        for most in [f32::MAX, 0.7] {
            let clamp = (most < f32::MAX).then_some(most);
            let film = film(&scene, &RenderSettings { clamp, ..settings(6, 5) }, 2);
            let plane = |layer: &'static Layer, c: usize| {
                let image = film.image_of(&[layer]).unwrap();
                image.channel(layer.channels[c]).unwrap().to_vec()
            };
            for c in 0..3 {
                let beauty = plane(&BEAUTY, c);
                let parts = [&BACKGROUND, &EMISSION, &DIRECT, &INDIRECT].map(|l| plane(l, c));
                for (p, own) in beauty.iter().enumerate() {
                    let sum: f32 = parts.iter().map(|part| part[p]).sum();
                    let largest = parts.iter().fold(*own, |most, part| most.max(part[p].abs()));
                    assert!((sum - own).abs() <= 4.0 * ulp(largest), "{i} {c}: {sum} for {own}");
                }
                // All kinds are there: the first three scenes emit nothing, the last has no sky.
                let total = |k: usize| parts[k].iter().map(|v| f64::from(*v)).sum::<f64>();
                let there = [i < 4, i >= 3, true, true];
                assert_eq!([0, 1, 2, 3].map(|k| total(k) > 0.0), there, "{i}");
            }
        }
    }
}
