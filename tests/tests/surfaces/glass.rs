//! Bodies of glass and what is in them.

use glam::{DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::Phase;
use pileus_scene::{EnvironmentImage, Interior, Surfaces};
use pileus_tests::*;
use rand_pcg::Pcg32;
use serde_json::{Value, json};
use std::sync::Arc;

/// A cube that neither bends nor reflects, with this colour after length 0.7 inside.
fn straight(color: [f32; 3]) -> Value {
    let mut material = glass(1.0);
    material["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 1.0, "attenuationDistance": 0.7,
        "attenuationColor": color});
    material
}

/// Absorption inside is Beer-Lambert, in every sample (one channel is clear: no path is played
/// roulette); of two bodies inside each other the inner one counts.
#[test]
fn absorption_inside_is_beer_lambert() {
    let (color, core) = ([0.2f32, 0.5, 1.0], [0.9f32, 0.3, 1.0]);
    let mut scene = scene(vec![], DVec3::new(3.0, 2.0, 4.0), DVec3::ZERO, 34.0);
    scene.environment.constant = Vec3::new(1.0, 2.0, 0.5);
    for nested in [false, true] {
        let mut meshes = vec![(cube(1.0), straight(color))];
        if nested {
            meshes.push((cube(0.5), straight(core)));
        }
        scene.surfaces = Some(surfaces(&meshes));
        let image = rendered(&scene, &point_filter(4, 1));
        for y in 0..64 {
            for x in 0..64 {
                let (o, d) = pixel_ray(&scene, x, y);
                let span = |half| cube_span(o, d, half).map_or(0.0, |(a, b)| b - a);
                let inner = if nested { span(0.5) } else { 0.0 };
                let outer = span(1.0) - inner;
                for (c, (name, light)) in
                    ["R", "G", "B"].into_iter().zip([1.0, 2.0, 0.5]).enumerate()
                {
                    let passed = f64::from(color[c]).powf(outer / 0.7)
                        * f64::from(core[c]).powf(inner / 0.7);
                    let found = f64::from(image.image.get(name, x, y).unwrap());
                    let expected = light * passed;
                    assert!(
                        (found - expected).abs() < 1e-4 * light,
                        "{nested} {x} {y}: {found} {expected}"
                    );
                }
            }
        }
    }
}

/// A camera inside of bodies, and bodies that overlap: what was entered last counts until its own
/// surface is left. Nested bodies around the camera count the inner one first.
#[test]
fn bodies_are_left_by_their_own_surface() {
    let colors = [[0.2f32, 0.5, 1.0], [0.9f32, 0.3, 0.6]];
    let shifted = |half: f32, shift: f32| {
        let mut triangles = cube(half);
        for corner in triangles.iter_mut().flatten() {
            corner[0] += shift;
        }
        triangles
    };
    let span = |(o, d): (DVec3, DVec3), (half, shift): (f64, f64)| {
        cube_span(o - DVec3::new(shift, 0.0, 0.0), d, half)
    };
    // Camera, then half size and shift of both cubes.
    for (camera, cubes) in [
        (DVec3::new(0.1, 0.05, 0.2), [(1.0, 0.0), (0.5, 0.0)]),
        (DVec3::new(-0.6, 0.05, 0.2), [(1.0, 0.0), (0.8, 0.9)]),
        (DVec3::new(-4.0, 0.3, 0.1), [(1.0, 0.0), (0.8, 0.9)]),
    ] {
        let mut scene = scene(vec![], camera, DVec3::new(2.0, 0.0, 0.0), 40.0);
        scene.environment.constant = Vec3::ONE;
        let bodies = [0, 1].map(|i| {
            let (half, shift): (f64, f64) = cubes[i];
            (shifted(half as f32, shift as f32), straight(colors[i]))
        });
        scene.surfaces = Some(surfaces(&bodies));
        let image = rendered(&scene, &point_filter(4, 1));
        let mut two = 0;
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let ray = pixel_ray(&scene, x, y);
            let spans = cubes
                .map(|cube| span(ray, cube).map_or((0.0, 0.0), |(a, b)| (a.max(0.0), b.max(0.0))));
            let [a, b] = spans;
            two += u32::from(a.1 > a.0 && b.1 > b.0);
            // The second begins later or around the same camera is the inner one.
            let b_length = b.1 - b.0;
            let shared = (a.1.min(b.1) - a.0.max(b.0)).max(0.0);
            let lengths = [a.1 - a.0 - shared, b_length];
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                let expected: f64 =
                    (0..2).map(|i| f64::from(colors[i][c]).powf(lengths[i] / 0.7)).product();
                let found = f64::from(image.image.get(name, x, y).unwrap());
                assert!((found - expected).abs() < 1e-3, "{camera} {x} {y}: {found} {expected}");
            }
        }
        assert!(two > 500, "{two} rays meet both");
    }
}

/// What fills the first body on a ray down the axis.
fn interior(surfaces: &Surfaces) -> Interior {
    let (from, down) = (DVec3::new(0.01, 5.0, 0.02), Vec3::NEG_Y);
    let hit = surfaces.intersect(from, down, 1e9, &mut Pcg32::new(1, 1)).unwrap();
    surfaces.interaction(&hit, down).interior.unwrap()
}

/// A body of index one that scatters inside is the same medium as a volume: a floor below both, a
/// bright spot in the sky.
#[test]
fn scattering_inside_is_a_homogeneous_medium() {
    for (k, (color, scatter)) in
        [([0.15f32; 3], [0.6f32; 3]), ([0.1, 0.3, 0.8], [0.3, 0.8, 0.5])].into_iter().enumerate()
    {
        let mut material = straight(color);
        material["extensions"]["KHR_materials_volume_scatter"] =
            json!({"multiscatterColor": scatter, "scatterAnisotropy": 0.4});
        let plane = quad([-2.0, -1.3, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0]);
        let ground = (plane, lambert([0.5, 0.4, 0.3]));
        let texels = (0..32 * 16)
            .map(|i| if i / 32 < 6 && i % 32 < 8 { [6.0, 4.0, 2.0] } else { [0.2; 3] })
            .collect();
        let sky = Arc::new(EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap());
        let view = |media| {
            let mut scene = scene(media, DVec3::new(3.0, 1.5, 4.0), DVec3::ZERO, 34.0);
            scene.environment.constant = Vec3::splat(0.1);
            scene.environment.image = Some(Arc::clone(&sky));
            scene
        };
        let mut body = view(vec![]);
        let filled = surfaces(&[(cube(1.0), material), ground.clone()]);
        let Interior { sigma_a, sigma_s, g } = interior(&filled);
        assert!((g - 0.4).abs() < 1e-6 && sigma_s.min_element() > 0.0, "{sigma_a} {sigma_s} {g}");
        body.surfaces = Some(filled);
        let sigma_t = sigma_a + sigma_s;
        let medium = cube_homogeneous(
            1.0,
            sigma_t.to_array(),
            (sigma_s / sigma_t).to_array(),
            Phase::henyey_greenstein(g),
        );
        let mut volume = view(vec![medium]);
        volume.surfaces = Some(surfaces(&[ground]));
        let inside = rendered(&body, &settings(192, 10 + k as u64));
        let around = rendered(&volume, &settings(128, 20 + k as u64));
        assert_same(&format!("scattering {color:?}"), &inside, &around, 3.6e-3);
    }
}

/// Bodies that shadow rays can cross, rough glass and wax (diffuse transmission), absorb and
/// scatter inside: shadow rays through their skin towards area lights, a sun and a sky outside, and
/// from outside to an area light inside, find what paths alone find.
#[test]
fn shadow_rays_through_the_skin_of_bodies() {
    let volume = |color: [f32; 3]| json!({"thicknessFactor": 1.0, "attenuationDistance": 0.3, "attenuationColor": color});
    let scatter = json!({"multiscatterColor": [0.7, 0.5, 0.3], "scatterAnisotropy": 0.2});
    let rough = |color| {
        let mut material = glass(1.4);
        material["pbrMetallicRoughness"]["roughnessFactor"] = json!(0.6);
        material["extensions"]["KHR_materials_volume"] = volume(color);
        material
    };
    let mut milky = rough([0.5, 0.4, 0.3]);
    milky["extensions"]["KHR_materials_volume_scatter"] = scatter.clone();
    let mut wax = lambert([0.8; 3]);
    wax["extensions"]["KHR_materials_diffuse_transmission"] = json!({"diffuseTransmissionFactor": 0.7,
        "diffuseTransmissionColorFactor": [0.9, 0.8, 0.7]});
    wax["extensions"]["KHR_materials_volume"] = volume([0.6, 0.5, 0.2]);
    // Paths alone seldom find an area light outside: biases below some 20 % go unseen there.
    for (k, (name, material, area_light_inside, power)) in [
        ("rough", rough([0.6, 0.3, 0.1]), false, 0.022),
        ("milky", milky, true, 7e-3),
        ("wax", wax.clone(), false, 0.016),
        ("wax", wax, true, 7e-3),
    ]
    .into_iter()
    .enumerate()
    {
        let mut scene = scene(vec![], DVec3::new(1.5, 1.2, 3.0), DVec3::ZERO, 26.0);
        let mut meshes = vec![
            (sphere(DVec3::ZERO, 0.7, 8), material.clone()),
            (quad([-2.0, -0.75, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0]), lambert([0.5; 3])),
        ];
        if area_light_inside {
            meshes.push((
                sphere(DVec3::new(0.1, 0.1, 0.0), 0.25, 3),
                area_light([0.3; 3], [3.0, 2.0, 4.0]),
            ));
        } else {
            let a_lamp = quad([-0.8, 1.2, -0.8], [0.8, 0.0, 0.0], [0.0, 0.0, 1.6]);
            meshes.push((a_lamp, area_light([0.0; 3], [3.0, 2.0, 1.0])));
            scene.lights.push(sun(Vec3::new(0.8, 0.5, -0.3), Vec3::splat(1.0), 0.4));
        }
        scene.surfaces = Some(surfaces(&meshes));
        let by = |light_sampling, spp, seed| {
            rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
        };
        let both = by(LightSampling::Both, 64, 30 + k as u64);
        let paths = by(LightSampling::Paths, 192, 40 + k as u64);
        assert_same(
            &format!("{name}, area light inside {area_light_inside}"),
            &both,
            &paths,
            power,
        );
    }
}
