//! Light without extent through panes and bodies that bend nothing, and single-sided sheets in the
//! way of light.

use glam::{DVec3, Vec3};
use pileus_integrator::{Plan, RenderSettings};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance_function::{Power, TransmittanceFunction};
use pileus_media::{Medium, Phase};
use pileus_scene::{Camera, Interaction, Light, Point, Scene, Spot};
use pileus_tests::*;
use rand_pcg::Pcg32;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::sync::Arc;

/// A smooth thin wall of this index and colour.
fn thin(ior: f32, [r, g, b]: [f32; 3]) -> Value {
    json!({"name": "pane", "doubleSided": true,
        "pbrMetallicRoughness": {"roughnessFactor": 0.0, "metallicFactor": 0.0, "baseColorFactor": [r, g, b, 1.0]},
        "extensions": {"KHR_materials_ior": {"ior": ior}, "KHR_materials_transmission": {"transmissionFactor": 1.0}}})
}

/// A level square at this height, its front up or down.
fn level(y: f32, half: f32, up: bool) -> Triangles {
    let (x, z) = ([2.0 * half, 0.0, 0.0], [0.0, 0.0, 2.0 * half]);
    let (a, b) = if up { (z, x) } else { (x, z) };
    quad([-half, y, -half], a, b)
}

/// A cube of smoke seen from the side, with these surfaces around.
fn smoke(medium: Medium, lights: &[Light], meshes: &[(Triangles, Value)]) -> Scene {
    let mut scene = scene(vec![medium], DVec3::new(0.0, 0.0, 9.0), DVec3::ZERO, 12.0);
    scene.lights = lights.to_vec();
    if !meshes.is_empty() {
        scene.surfaces = Some(surfaces(meshes));
    }
    scene
}

/// The lights times a colour.
fn dimmed(lights: &[Light], by: Vec3) -> Vec<Light> {
    let dim = |light: &Light| match light.clone() {
        Light::Sun(mut sun) => {
            sun.irradiance *= by;
            Light::Sun(sun)
        }
        Light::Point(mut point) => {
            point.intensity *= by;
            Light::Point(point)
        }
        Light::Spot(mut spot) => {
            spot.intensity *= by;
            Light::Spot(spot)
        }
        other => other,
    };
    lights.iter().map(dim).collect()
}

fn grey(sigma_t: f32) -> Medium {
    cube_homogeneous(1.0, [sigma_t; 3], [0.7; 3], Phase::Isotropic)
}

/// A sun of no size overhead, a point and a spot above the panes.
fn lights() -> [Light; 3] {
    let spot = Spot {
        position: DVec3::new(-0.4, 5.0, 0.2),
        direction: Vec3::NEG_Y,
        intensity: Vec3::splat(60.0),
        cos_inner: 0.98,
        cos_outer: 0.9,
    };
    let point = Point { position: DVec3::new(0.5, 4.5, 0.3), intensity: Vec3::splat(40.0) };
    [sun(Vec3::Y, Vec3::splat(3.0), 0.0), Light::Point(point), Light::Spot(spot)]
}

/// Single scattering of a sun through a thin pane of index 1 and of index 1.5 is the closed form
/// times what the pane lets through, in every pixel.
///
/// Null hypothesis: the means are exact; see [`assert_expected`]. Standard error of a block some
/// 0.3 %: a pane that stops light, or counts as a bounce, is off by all of it, a missing or doubled
/// Fresnel factor by 4 %.
#[test]
fn single_scattering_through_a_pane_is_the_closed_form() {
    for (ior, passes) in [(1.0, 1.0), (1.5, 0.96)] {
        let pane = (level(3.0, 3.0, false), thin(ior, [1.0; 3]));
        let scene = smoke(grey(0.8), &lights()[..1], &[pane]);
        let settings = RenderSettings { max_bounces: Some(1), ..point_filter(64, 1) };
        let image = rendered(&scene, &settings);
        assert_expected(&format!("a pane of index {ior}"), &image, 6e-4, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let Some((near, far)) = cube_span(o, d, 1.0) else { return [0.0; 3] };
            let n = 400;
            let step = (far - near) / f64::from(n);
            let sum: f64 = (0..n)
                .map(|i| {
                    let t = near + step * (f64::from(i) + 0.5);
                    let depth = 0.8 * (t - near + 1.0 - (o + d * t).y);
                    (-depth).exp() * step
                })
                .sum();
            [3.0 * passes * 0.7 * 0.8 * sum / (4.0 * PI); 3]
        });
    }
}

/// Sun, point and spot, each alone and all together, through two tinted panes, one of them half
/// there: the picture of dimmer lights without panes. In grey and chromatic smoke, smoke that is
/// not exponential, and with equiangular points.
///
/// Null hypothesis: both pictures have one mean; see [`assert_same`].
#[test]
fn panes_dim_and_tint() {
    let tint = Vec3::new(0.5, 0.8, 1.0);
    let mut half = thin(1.0, tint.to_array());
    half["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5, 0.8, 1.0, 0.5]);
    half["alphaMode"] = json!("BLEND");
    let panes =
        [(level(3.0, 3.0, false), thin(1.0, tint.to_array())), (level(2.0, 3.0, true), half)];
    let passes = tint * (0.5 + 0.5 * tint);
    let function = TransmittanceFunction::Power(Power::new(2.0).unwrap());
    let chromatic = cube_homogeneous(1.0, [0.8, 0.4, 0.2], [0.7; 3], Phase::henyey_greenstein(0.3));
    let all = lights();
    for (k, (name, medium, lights, distance)) in [
        ("sun", grey(0.8), &all[..1], None),
        ("point", grey(0.8), &all[1..2], None),
        ("spot", grey(0.8), &all[2..], None),
        ("all, chromatic", chromatic, &all[..], None),
        (
            "all, a power law",
            grey(0.8).with_transmittance_function(Some(Arc::new(function))),
            &all[..],
            None,
        ),
        ("point and spot, equal angles", grey(0.1), &all[1..], Some(DistanceSampler::Equiangular)),
    ]
    .into_iter()
    .enumerate()
    {
        let by = |scene: &Scene, seed| {
            rendered(scene, &RenderSettings { distance, ..settings(72, seed) })
        };
        let open = by(&smoke(medium.clone(), &dimmed(lights, passes), &[]), 10 + k as u64);
        let closed = by(&smoke(medium, lights, &panes), 20 + k as u64);
        assert_same(name, &open, &closed, 7e-3);
    }
}

/// A box of panes around smoke, lights and sky outside: the picture without it, whatever
/// `max_bounces` is.
#[test]
fn panes_are_no_bounces() {
    let mut wall = thin(1.0, [1.0; 3]);
    wall["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 0.0});
    let walls = [(cube(1.3), wall)];
    for bounces in [Some(0), Some(1), Some(2), None] {
        let by = |meshes: &[(Triangles, Value)], seed| {
            let mut scene = smoke(grey(0.8), &lights(), meshes);
            scene.environment.constant = Vec3::splat(0.2);
            rendered(&scene, &RenderSettings { max_bounces: bounces, ..settings(48, seed) })
        };
        assert_same(&format!("{bounces:?} bounces"), &by(&[], 1), &by(&walls, 2), 7e-3);
    }
}

/// A body that neither bends nor reflects, with this colour after length 0.7 inside. Its roughness
/// does not matter.
fn straight(color: [f32; 3], roughness: f32) -> Value {
    let mut material = glass(1.0);
    material["pbrMetallicRoughness"]["roughnessFactor"] = json!(roughness);
    material["extensions"]["KHR_materials_volume"] =
        json!({"thicknessFactor": 1.0, "attenuationDistance": 0.7, "attenuationColor": color});
    material
}

/// Moved.
fn at(triangles: Triangles, by: DVec3) -> Triangles {
    let by = by.as_vec3();
    triangles.into_iter().map(|t| t.map(|p| (Vec3::from_array(p) + by).to_array())).collect()
}

fn floor(half: f32, albedo: f32) -> (Triangles, Value) {
    (level(0.0, half, true), lambert([albedo; 3]))
}

/// A camera below `y = 0.45` that sees the floor alone.
fn below(meshes: &[(Triangles, Value)]) -> Scene {
    let mut scene = scene(Vec::new(), DVec3::Z, DVec3::ZERO, 30.0);
    let (eye, target) = (DVec3::new(0.0, 0.45, 1.5), DVec3::new(0.0, 0.0, 0.2));
    scene.camera = Camera::look_at(eye, target, DVec3::Y, 15.0, [64, 64]).unwrap();
    scene.surfaces = Some(surfaces(meshes));
    scene
}

/// Shadow rays cross bodies of index 1: above the floor, one in the other, and one that the floor
/// reaches into, in which they start. Beer-Lambert in every pixel, for a sun and for a point inside
/// of the outer body: one light has no noise.
#[test]
fn bodies_of_index_one_absorb_on_the_way_to_the_light() {
    let colors = [[0.2f32, 0.5, 1.0], [0.9, 0.3, 0.6], [0.4, 0.7, 0.8]];
    let places = [DVec3::new(0.2, 1.2, 0.1), DVec3::new(0.2, 1.2, 0.1), DVec3::new(-0.1, 0.1, 0.2)];
    let halves = [0.6f32, 0.3, 0.25];
    let mut meshes = vec![floor(9.0, 0.6)];
    for i in 0..3 {
        meshes.push((at(cube(halves[i]), places[i]), straight(colors[i], 0.3 * i as f32)));
    }
    let mut scene = below(&meshes);
    let to_sun = Vec3::new(0.15, 1.0, 0.05).normalize();
    let position = DVec3::new(0.3, 1.7, 0.2);
    let lengths = |o: DVec3, d: DVec3, end: f64| {
        [0, 1, 2].map(|i| {
            let span = cube_span(o - places[i], d, f64::from(halves[i]));
            span.map_or(0.0, |(a, b)| (b.min(end) - a.max(0.0)).max(0.0))
        })
    };
    let passed = |lengths: [f64; 3], c: usize| {
        let [outer, inner, low] = lengths;
        let depth = |i: usize, l: f64| f64::from(colors[i][c]).powf(l / 0.7);
        depth(0, outer - inner) * depth(1, inner) * depth(2, low)
    };
    for light in [
        sun(to_sun, Vec3::splat(2.0), 0.0),
        Light::Point(Point { position, intensity: Vec3::splat(4.0) }),
    ] {
        scene.lights = vec![light.clone()];
        let image =
            rendered(&scene, &RenderSettings { max_bounces: Some(1), ..point_filter(4, 1) });
        let (mut shaded, mut started) = (0, 0);
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let (o, d) = pixel_ray(&scene, x, y);
            let p = o - d * (o.y / d.y);
            let (wi, end, irradiance) = match &light {
                Light::Point(_) => {
                    let to = position - p;
                    (to.normalize(), to.length(), 4.0 * to.normalize().y / to.length_squared())
                }
                _ => (to_sun.as_dvec3(), f64::INFINITY, 2.0 * f64::from(to_sun.y)),
            };
            let (seen, lit) = (lengths(o, d, (p - o).length()), lengths(p, wi, end));
            shaded += u32::from(lit[1] > 0.0);
            started += u32::from(lit[2] > 0.0);
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                let expected = 0.6 / PI * irradiance * passed(seen, c) * passed(lit, c);
                let found = f64::from(image.image.get(name, x, y).unwrap());
                // The filter is 1e-4 of a pixel wide, and edges of bodies are steps of a length
                // only.
                assert!(
                    (found - expected).abs() < 2e-3 * expected + 1e-6,
                    "{x} {y}: {found} {expected}"
                );
            }
        }
        assert!(shaded > 200 && started > 200, "{shaded} {started}");
    }
}

/// What fills the first body on a ray downwards.
fn first_body(scene: &Scene) -> Interaction {
    let surfaces = scene.surfaces.as_deref().unwrap();
    let (from, down) = (DVec3::new(0.01, 5.0, 0.02), Vec3::NEG_Y);
    let hit = surfaces.intersect(from, down, 1e9, &mut Pcg32::new(1, 1)).unwrap();
    surfaces.interaction(&hit, down)
}

/// A body of index 1 that scatters inside is the same medium as a volume under a sun of no size and
/// a point, for vertices inside, on the ground below, and in smoke beside it.
#[test]
fn bodies_of_index_one_scatter_as_volumes_do() {
    let mut material = straight([0.15, 0.3, 0.5], 0.0);
    material["extensions"]["KHR_materials_volume_scatter"] =
        json!({"multiscatterColor": [0.6, 0.8, 0.5], "scatterAnisotropy": 0.4});
    let ground = (level(-1.3, 3.0, true), lambert([0.5, 0.4, 0.3]));
    let view = |media, meshes: &[(Triangles, Value)]| {
        let mut scene = smoke(grey(0.5), &lights()[..2], meshes);
        let beside = cube_homogeneous(0.4, [0.5; 3], [0.9; 3], Phase::Isotropic);
        scene.volumes.clear();
        let mut other = pileus_tests::scene(media, DVec3::new(4.0, 2.5, 5.0), DVec3::ZERO, 34.0);
        other.lights = scene.lights.clone();
        other.surfaces = scene.surfaces.clone();
        let beside = pileus_tests::scene(vec![beside], DVec3::Z, DVec3::ZERO, 30.0).volumes;
        // Inside of the body: both media fill the same place.
        other.volumes.extend(beside);
        other
    };
    let body = view(vec![], &[(cube(1.0), material), ground.clone()]);
    let filling = first_body(&body).interior.unwrap();
    let sigma_t = filling.sigma_a + filling.sigma_s;
    let albedo = filling.sigma_s / sigma_t;
    let medium = cube_homogeneous(
        1.0,
        sigma_t.to_array(),
        albedo.to_array(),
        Phase::henyey_greenstein(filling.g),
    );
    let volume = view(vec![medium], &[ground]);
    let inside = rendered(&body, &settings(64, 3));
    let around = rendered(&volume, &settings(64, 4));
    assert_same("a body and a volume", &inside, &around, 4.6e-3);
}

/// What light without extent does not pass is said, by name; what it passes too. A sun with a size,
/// or glass that nothing shines at, is not spoken of.
#[test]
fn what_light_does_not_pass_is_said() {
    let named = |mut material: Value, name: &str| {
        material["name"] = json!(name);
        material
    };
    let mut frosted = thin(1.5, [1.0; 3]);
    frosted["pbrMetallicRoughness"]["roughnessFactor"] = json!(0.4);
    let meshes = [
        (at(cube(0.3), DVec3::new(0.0, 2.0, 0.0)), named(glass(1.5), "lens")),
        (level(3.0, 3.0, false), named(frosted, "frosted")),
        (level(3.5, 3.0, false), named(thin(1.5, [1.0; 3]), "window")),
        (at(cube(0.3), DVec3::new(0.0, 5.0, 0.0)), named(straight([0.5; 3], 0.5), "air")),
        floor(3.0, 0.5),
    ];
    let plan =
        |lights: &[Light]| Plan::new(&smoke(grey(0.8), lights, &meshes), &settings(1, 1)).unwrap();
    let said = plan(&lights());
    let [bent] = said.not_modelled.as_slice() else { panic!("{:?}", said.not_modelled) };
    for word in ["1 sun of no size", "1 point light", "1 spot", "`lens` (index 1.5)"] {
        assert!(bent.contains(word), "{word}: {bent}");
    }
    assert!(
        !bent.contains("frosted") && !bent.contains("window") && !bent.contains("air"),
        "{bent}"
    );
    let reason = |words: &[&str]| {
        said.reasons.iter().any(|reason| words.iter().all(|word| reason.contains(word)))
    };
    assert!(reason(&["straight through", "`window`", "`air`", "no bounces"]), "{:?}", said.reasons);
    assert!(reason(&["does not go straight", "`frosted` (roughness 0.4)"]), "{:?}", said.reasons);
    let quiet = plan(&[sun(Vec3::Y, Vec3::ONE, 0.01), sun(Vec3::Y, Vec3::ZERO, 0.0)]);
    assert!(quiet.not_modelled.is_empty(), "{:?}", quiet.not_modelled);
    // And it is so: nothing arrives through the lens, all of it around.
    let ball = (at(cube(0.9), DVec3::new(0.0, 1.3, 0.0)), glass(1.5));
    let mut scene = below(&[floor(3.0, 0.5), ball]);
    scene.lights = vec![lights()[0].clone()];
    let dark = rendered(&scene, &RenderSettings { max_bounces: Some(1), ..settings(2, 1) });
    assert!(dark.image.channel("G").unwrap()[32 * 64 + 32] == 0.0);
}

/// A single-sided sheet above a floor, facing the lights or turned over: the same shadow, under
/// every kind of light; as a sheet with two sides has it.
///
/// Null hypothesis: the three pictures have one mean; see [`assert_same`]. Turned over it differed
/// by all of the light before.
#[test]
fn sheets_cast_shadows_either_way() {
    let red = lambert([0.8, 0.2, 0.2]);
    let mut both_sides = red.clone();
    both_sides["doubleSided"] = json!(true);
    let area_light_above = (level(2.6, 0.5, false), area_light([0.3; 3], [6.0, 5.0, 4.0]));
    let [sun_light, point, spot] = lights();
    let tilted = sun(Vec3::new(0.1, 1.0, 0.1), Vec3::splat(2.0), 0.5);
    let kinds: [(&str, Option<Light>, bool, f32); 6] = [
        ("a sun of no size", Some(sun_light), false, 0.0),
        ("a sun's disc", Some(tilted), false, 0.0),
        ("a point", Some(point), false, 0.0),
        ("a spot", Some(spot), false, 0.0),
        ("an area light", None, true, 0.0),
        ("a sky", None, false, 1.0),
    ];
    for (k, (name, light, area_light, sky)) in kinds.into_iter().enumerate() {
        // The area light is seen by few paths.
        let (spp, power) = if area_light { (72, 0.0105) } else { (24, 5.5e-3) };
        let by = |sheet: Option<(bool, &Value)>, seed: u64| {
            let mut meshes = vec![floor(4.0, 0.5)];
            meshes.extend(sheet.map(|(up, material)| (level(0.6, 0.5, up), material.clone())));
            meshes.extend(area_light.then(|| area_light_above.clone()));
            let mut scene = below(&meshes);
            scene.lights.extend(light.clone());
            scene.environment.constant = Vec3::splat(sky);
            rendered(&scene, &settings(spp, 10 * k as u64 + seed))
        };
        let mean = |r: &Rendered| r.image.channel("G").unwrap().iter().sum::<f32>() / 4096.0;
        let [facing, away] = [true, false].map(|up| by(Some((up, &red)), 1 + u64::from(up)));
        assert_same(&format!("{name}, turned over"), &facing, &away, power);
        assert_same(
            &format!("{name}, two sides"),
            &facing,
            &by(Some((true, &both_sides)), 3),
            power,
        );
        assert!(mean(&facing) < 0.9 * mean(&by(None, 4)), "{name} is shaded");
    }
}

/// The camera sees a sheet from its front, and through its back the floor in its shadow, straight
/// through a pane as well; a mirror shows the back.
#[test]
fn backs_are_hidden_from_the_camera_alone() {
    let sheet = |up| (level(0.5, 0.5, up), lambert([0.8, 0.2, 0.1]));
    let window = (level(1.5, 3.0, true), thin(1.0, [1.0; 3]));
    let view = |up, window: Option<(Triangles, Value)>| {
        let mut meshes = vec![floor(4.0, 0.5), sheet(up)];
        meshes.extend(window);
        let mut scene = scene(vec![], DVec3::new(0.0, 4.0, 0.01), DVec3::ZERO, 10.0);
        scene.lights = vec![sun(Vec3::new(0.0, 1.0, 0.05), Vec3::splat(PI as f32), 0.0)];
        scene.surfaces = Some(surfaces(&meshes));
        let image =
            rendered(&scene, &RenderSettings { max_bounces: Some(1), ..point_filter(2, 1) });
        image.image.get("R", 32, 32).unwrap()
    };
    let cos = 1.0 / (1.0f32 + 0.05 * 0.05).sqrt();
    for window in [None, Some(window)] {
        assert!((view(true, window.clone()) - 0.8 * cos).abs() < 1e-4);
        assert_eq!(view(false, window), 0.0);
    }
    // Upwards by a mirror on the floor: the sheet's underside, lit by an area light that shines up.
    let mirror = json!({"pbrMetallicRoughness": {"roughnessFactor": 0.0, "metallicFactor": 1.0}});
    let radiance = |up: bool| {
        let mut scene = scene(vec![], DVec3::new(0.0, 1.0, 3.0), DVec3::new(0.0, 0.0, 1.5), 1.0);
        scene.surfaces = Some(surfaces(&[
            (level(0.0, 4.0, true), mirror.clone()),
            (at(level(1.0, 0.6, up), DVec3::ZERO), lambert([0.8, 0.2, 0.1])),
        ]));
        let position = DVec3::new(0.0, 0.5, 0.0);
        let intensity = Vec3::splat(PI as f32);
        scene.lights = vec![Light::Point(Point { position, intensity })];
        let image =
            rendered(&scene, &RenderSettings { max_bounces: Some(2), ..point_filter(2, 1) });
        image.image.get("R", 32, 32).unwrap()
    };
    assert!(radiance(true) > 2.0, "{}", radiance(true));
    assert!((radiance(true) - radiance(false)).abs() < 1e-4);
}
