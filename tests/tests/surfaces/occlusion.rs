//! Shadows of surfaces in media, what alpha lets through, and paths that are cut.

use crate::{floor, floor_scene, form_factor_pi, on_floor};
use glam::{DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::Phase;
use pileus_scene::Scene;
use pileus_tests::*;
use serde_json::{Value, json};

/// Smoke under a sun, a sheet of black between them that the camera does not see.
fn smoke(irradiance: f32, sheet: Option<Value>) -> Scene {
    let medium = lumpy_grid(1.0, [2.0; 3], [0.9; 3], Phase::henyey_greenstein(0.3));
    let mut scene = scene(vec![medium], DVec3::new(3.0, 0.5, 4.0), DVec3::ZERO, 16.0);
    scene.lights.push(sun(Vec3::new(0.1, 1.0, 0.05), Vec3::splat(irradiance), 0.0));
    let sheet =
        sheet.map(|material| (quad([-3.0, 1.5, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0]), material));
    // Something that is a surface in any case, out of everybody's way.
    let far = (sphere(DVec3::new(0.0, -50.0, 0.0), 0.1, 2), lambert([0.0; 3]));
    scene.surfaces = Some(surfaces(&sheet.into_iter().chain([far]).collect::<Vec<_>>()));
    scene
}

fn black(alpha: f32, mode: &str) -> Value {
    let mut material = lambert([0.0; 3]);
    material["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.0, 0.0, 0.0, alpha]);
    material["alphaMode"] = json!(mode);
    // Seen from below by shadow rays, from where a sheet of one side is not there.
    material["doubleSided"] = json!(true);
    material
}

/// Opaque sheets and masks above the cutoff shade fully, masks below it not at all, and blends let
/// one minus alpha through.
#[test]
fn sheets_shade_smoke_by_their_alpha() {
    let by = |scene: &Scene, seed| rendered(scene, &settings(64, seed));
    let open = by(&smoke(1.0, None), 1);
    let lit = open.image.channel("G").unwrap().iter().sum::<f32>() / 4096.0;
    assert!(lit > 0.01, "{lit}");
    for material in
        [black(1.0, "OPAQUE"), black(0.3, "OPAQUE"), black(0.6, "MASK"), black(1.0, "BLEND")]
    {
        let dark = by(&smoke(1.0, Some(material.clone())), 2);
        assert!(dark.counters.shadow_rays > 10_000);
        let sum = dark.image.channel("G").unwrap().iter().sum::<f32>();
        assert_eq!(sum, 0.0, "{material}");
    }
    for (alpha, mode, passes) in
        [(0.4, "MASK", 1.0), (0.0, "BLEND", 1.0), (0.5, "BLEND", 0.5), (0.75, "BLEND", 0.25)]
    {
        // The sheet takes from paths that scatter up and leave nothing: there is no light but the
        // sun's.
        let image = by(&smoke(1.0 / passes, Some(black(alpha, mode))), 3);
        assert_same(&format!("{mode} {alpha}"), &open, &image, 6e-3);
    }
    // Two sheets take their shares one after the other.
    let mut two = smoke(4.0, None);
    let sheet =
        |y: f32| (quad([-3.0, y, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0]), black(0.5, "BLEND"));
    two.surfaces = Some(surfaces(&[sheet(1.5), sheet(1.6)]));
    assert_same("two sheets", &open, &by(&two, 4), 6e-3);
}

/// No bounces: fire, area lights and background, each behind what is before it.
#[test]
fn no_bounces_show_what_shines() {
    let (sigma_t, e) = (1.5f64, 0.8f64);
    let mut scene = scene(vec![], DVec3::new(0.0, 0.3, 4.0), DVec3::ZERO, 50.0);
    scene.volumes.push(glowing_cube(0.5, [1.5; 3], [0.6; 3], [0.8; 3]));
    let area_light_at = quad([-1.5, -0.6, -2.0], [1.5, 0.0, 0.0], [0.0, 3.0, 0.0]);
    let (plane, material) = floor(1.5, 0.9);
    let plane = plane.into_iter().map(|t| t.map(|[x, y, z]| [x, y - 0.7, z])).collect();
    scene.surfaces =
        Some(surfaces(&[(plane, material), (area_light_at, area_light([0.5; 3], [2.0; 3]))]));
    scene.environment.constant = Vec3::splat(0.3);
    scene.lights.push(sun(Vec3::Y, Vec3::ONE, 0.0));
    for light_sampling in [LightSampling::Both, LightSampling::Paths] {
        let settings =
            RenderSettings { max_bounces: Some(0), light_sampling, ..point_filter(64, 5) };
        let image = rendered(&scene, &settings);
        assert_eq!(image.counters.shadow_rays, 0);
        assert_expected("no bounces", &image, 3.3e-4, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let length = cube_span(o, d, 0.5).map_or(0.0, |(a, b)| b - a);
            let at_floor = o - d * ((o.y + 0.7) / d.y);
            let at_lamp = o - d * ((o.z + 2.0) / d.z);
            let behind = if d.y < 0.0 && at_floor.x.abs() < 1.5 && at_floor.z.abs() < 1.5 {
                0.0
            } else if at_lamp.x > -1.5 && at_lamp.x < 0.0 && at_lamp.y > -0.6 && at_lamp.y < 2.4 {
                2.0
            } else {
                0.3
            };
            let passed = (-sigma_t * length).exp();
            [e / sigma_t * (1.0 - passed) + behind * passed; 3]
        });
    }
}

/// One bounce: a floor beside a wall sees the sky that the wall leaves, and nothing of the light
/// that the wall would reflect; with two it sees more.
#[test]
fn one_bounce_is_single_scattering_off_surfaces() {
    // Behind what the camera sees of the floor, facing it.
    let corners = [[-1.0, 0.0, -0.8], [1.0, 0.0, -0.8], [1.0, 1.5, -0.8], [-1.0, 1.5, -0.8]];
    let [p, a, _, b] = corners.map(Vec3::from_array);
    let wall = (quad(corners[0], (a - p).to_array(), (b - p).to_array()), lambert([0.8; 3]));
    let mut scene = floor_scene(&[floor(3.0, 0.6), wall]);
    scene.environment.constant = Vec3::ONE;
    let by = |bounces, seed| {
        rendered(&scene, &RenderSettings { max_bounces: Some(bounces), ..point_filter(128, seed) })
    };
    let polygon = corners.map(|p| Vec3::from_array(p).as_dvec3());
    let single = by(1, 6);
    let expected = |x, y| {
        let p = on_floor(pixel_ray(&scene, x, y));
        assert!(p.z > -0.79, "{p}");
        [0.6 * (1.0 - form_factor_pi(p, DVec3::Y, &polygon) / std::f64::consts::PI); 3]
    };
    assert_expected("one bounce", &single, 5.4e-4, expected);
    let mean = |r: &Rendered| r.image.channel("G").unwrap().iter().sum::<f32>() / 4096.0;
    assert!(mean(&by(2, 7)) > mean(&single) + 0.01);
}
