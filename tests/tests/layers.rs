//! Layers of the film against closed forms.
//!
//! Means over the middle of an image, over renders with different seeds: the spread of the renders
//! tells the standard error. Null hypothesis: the layer is what it says; |z| < 8.5 with 15 degrees
//! of freedom, false alarm 4e-7 a mean.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DAffine3, DVec3, Vec3};
use pileus_film::{
    ALBEDO, BACKGROUND, BEAUTY, DEPTH, DIRECT, EMISSION, Film, INDIRECT, Image, Layer, NORMAL,
    POSITION, TRANSMITTANCE,
};
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::{Interpolation, Medium, Phase};
use pileus_scene::{Light, Point, Scene};
use pileus_tests::*;
use pileus_vdb::Tree;

const SEEDS: u64 = 16;

/// Layers of a render in which no value was left out.
fn layers(scene: &Scene, settings: &RenderSettings, wanted: &[&'static Layer]) -> Image {
    let mut film = Film::with_layers(scene.camera.resolution(), None, wanted).unwrap();
    Renderer::new(scene, settings).unwrap().render(&mut film, &Unmonitored).unwrap();
    assert_eq!((film.dropped(), film.values_left_out()), (0, 0));
    film.image_of(film.layers()).unwrap()
}

/// Mean over seeds of what `of` takes from a render, and its standard error.
fn over_seeds(of: impl Fn(u64) -> f64) -> (f64, f64) {
    let values: Vec<f64> = (0..SEEDS).map(of).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}

/// A mean of differences is zero; `power`: the largest standard error that sees what it should.
fn assert_zero(what: &str, (mean, error): (f64, f64), power: f64) {
    let z = mean / error.max(1e-12);
    println!("{what}: off by {mean:.3e}, z {z:.2}, standard error {error:.2e}");
    assert!(error < power, "{what}: the test is too weak: standard error {error}");
    assert!(z.abs() < 8.5 || mean.abs() < 1e-6, "{what}: off by {mean}, z {z}");
}

/// Mean over the pixels of the middle quarter of the difference between a channel and `expected`.
fn off(image: &Image, channel: &str, expected: impl Fn(u32, u32) -> f64) -> f64 {
    let (width, height) = (image.width(), image.height());
    let (mut sum, mut count) = (0.0, 0.0);
    for y in height / 4..3 * height / 4 {
        for x in width / 4..3 * width / 4 {
            sum += f64::from(image.get(channel, x, y).unwrap()) - expected(x, y);
            count += 1.0;
        }
    }
    sum / count
}

fn seen(media: Vec<Medium>) -> Scene {
    let mut scene = scene(media, DVec3::new(1.0, 0.5, 5.0), DVec3::ZERO, 24.0);
    scene.environment.constant = Vec3::splat(0.4);
    scene
}

/// Where on its ray a path that collides in a homogeneous segment does so in the mean: of an
/// exponential that ends.
fn mean_depth(sigma_t: f64, length: f64) -> f64 {
    let passed = (-sigma_t * length).exp();
    1.0 / sigma_t - length * passed / (1.0 - passed)
}

#[test]
fn depth_and_position_of_a_box_and_of_a_thin_slab() {
    for (sigma_t, half) in [(1.3f32, 1.0), (0.1, 1.0), (40.0, 1.0)] {
        for grid in [false, true] {
            let make = if grid { cube_grid } else { cube_homogeneous };
            let scene = seen(vec![make(half, [sigma_t; 3], [0.8; 3], Phase::Isotropic)]);
            let met = |x: u32, y: u32| {
                let (o, d) = pixel_ray(&scene, x, y);
                let (a, b) = cube_span(o, d, half).unwrap();
                o + d * (a + mean_depth(f64::from(sigma_t), b - a))
            };
            // Enough that each pixel has met something: one in 1e13 has not.
            let spp = if sigma_t < 1.0 { 160 } else { 32 };
            let image = |seed| layers(&scene, &point_filter(spp, seed), &[&DEPTH, &POSITION]);
            let images: Vec<Image> = (0..SEEDS).map(image).collect();
            let at = |seed: u64| &images[seed as usize];
            let what = format!("sigma_t {sigma_t}, grid {grid}");
            let depth =
                over_seeds(|seed| off(at(seed), "depth.Z", |x, y| scene.camera.depth(met(x, y))));
            assert_zero(&format!("{what}: depth"), depth, 2e-3);
            for (k, channel) in POSITION.channels.iter().enumerate() {
                let place = over_seeds(|seed| off(at(seed), channel, |x, y| met(x, y)[k]));
                assert_zero(&format!("{what}: {channel}"), place, 2e-3);
            }
        }
    }
}

/// Where channels part, each has its own first event; albedo and transmittance are their means.
#[test]
fn albedo_and_transmittance_of_a_box() {
    let albedo = [0.9, 0.5, 0.2];
    for sigma_t in [[1.3f32; 3], [1.3, 0.5, 0.2]] {
        let scene = seen(vec![cube_grid(1.0, sigma_t, albedo, Phase::Isotropic)]);
        let passed = |x: u32, y: u32| {
            let (o, d) = pixel_ray(&scene, x, y);
            let (a, b) = cube_span(o, d, 1.0).unwrap();
            sigma_t.map(|sigma_t| (-f64::from(sigma_t) * (b - a)).exp())
        };
        let wanted: [&Layer; 2] = [&ALBEDO, &TRANSMITTANCE];
        let images: Vec<Image> =
            (0..SEEDS).map(|seed| layers(&scene, &point_filter(64, seed), &wanted)).collect();
        for c in 0..3 {
            let transmittance = over_seeds(|seed| {
                off(&images[seed as usize], TRANSMITTANCE.channels[c], |x, y| passed(x, y)[c])
            });
            assert_zero(&format!("{sigma_t:?}: transmittance {c}"), transmittance, 1e-3);
            let seen = over_seeds(|seed| {
                off(&images[seed as usize], ALBEDO.channels[c], |x, y| {
                    let met = 1.0 - passed(x, y).iter().sum::<f64>() / 3.0;
                    met * f64::from(albedo[c])
                })
            });
            assert_zero(&format!("{sigma_t:?}: albedo {c}"), seen, 1e-3);
        }
        // Transmittance is what alpha leaves, sample by sample.
        for (x, y) in [(20, 20), (32, 40), (0, 0)] {
            let get = |channel: &str| f64::from(images[0].get(channel, x, y).unwrap());
            let mean = TRANSMITTANCE.channels.iter().map(|c| get(c)).sum::<f64>() / 3.0;
            assert!((1.0 - get("A") - mean).abs() < 1e-6);
        }
    }
}

/// A ball whose density falls with the square of the radius: its gradient is radial everywhere, and
/// one sample a pixel tells place and normal of one event. The interpolation between 48 voxels
/// across leaves some degrees.
#[test]
fn normals_of_a_ball_of_density_are_radial() {
    const N: usize = 48;
    let values: Vec<f32> = (0..N * N * N)
        .map(|i| {
            let [x, y, z] = [i / (N * N), i / N % N, i % N].map(|i| i as f64 - 23.5);
            (1.0 - (x * x + y * y + z * z) / (22.0 * 22.0)).max(0.0) as f32
        })
        .collect();
    let tree = Tree::from_dense(0.0f32, [0; 3], [N; 3], &values);
    // Stretched and turned: normals are those of the ellipsoid.
    let stretch = DVec3::new(1.0, 0.6, 1.4) / 22.0;
    let turn = DAffine3::from_rotation_z(0.7) * DAffine3::from_scale(stretch);
    let index_to_world = turn * DAffine3::from_translation(DVec3::splat(-23.5));
    let ball = grid_medium(
        &tree,
        Interpolation::Trilinear,
        index_to_world,
        [4.0; 3],
        [0.8; 3],
        Phase::Isotropic,
    );
    let scene = seen(vec![ball]);
    let image = layers(&scene, &point_filter(1, 3), &[&POSITION, &NORMAL]);
    let vector = |layer: &Layer, x, y| {
        Vec3::from_array([0, 1, 2].map(|k| image.get(layer.channels[k], x, y).unwrap())).as_dvec3()
    };
    let (mut count, mut sum, mut least) = (0, 0.0, 1.0f64);
    for y in 0..64 {
        for x in 0..64 {
            let (p, normal) = (vector(&POSITION, x, y), vector(&NORMAL, x, y));
            let radial = turn.inverse().transform_point3(p);
            // Near the middle and the rim the gradient is short.
            if image.get("A", x, y) == Some(1.0) && (6.0..21.0).contains(&radial.length()) {
                let exact = turn.matrix3.inverse().transpose() * radial;
                let cos = normal.dot(exact.normalize());
                assert!((normal.length() - 1.0).abs() < 1e-5);
                (count, sum, least) = (count + 1, sum + cos, least.min(cos));
            }
        }
    }
    println!("{count} normals, mean cosine {:.5}, least {least:.4}", sum / f64::from(count));
    assert!(count > 500 && sum / f64::from(count) > 0.999 && least > 0.98);
}

/// A square across the view: its plane's depth, its normal towards the camera from either side, its
/// colour; nothing beside it.
#[test]
fn surfaces_have_exact_layers() {
    let mut two_sided = lambert([0.6, 0.3, 0.1]);
    two_sided["doubleSided"] = serde_json::json!(true);
    for turned in [false, true] {
        let (a, b) = ([1.0f32, 0.0, 0.0], [0.0f32, 1.0, 0.0]);
        let (a, b) = if turned { (b, a) } else { (a, b) };
        let mut scene = scene(vec![], DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, 40.0);
        scene.environment.constant = Vec3::ONE;
        let square = quad([-0.5, -0.5, 0.0], a, b);
        scene.surfaces = Some(surfaces(&[(square, two_sided.clone())]));
        let wanted: [&Layer; 5] = [&DEPTH, &POSITION, &NORMAL, &ALBEDO, &TRANSMITTANCE];
        let image = layers(&scene, &point_filter(4, 1), &wanted);
        let values = |layer: &Layer, x, y| -> Vec<f32> {
            layer.channels.iter().map(|c| image.get(c, x, y).unwrap()).collect()
        };
        for (x, y) in [(32, 32), (22, 40), (40, 25)] {
            let (o, d) = pixel_ray(&scene, x, y);
            let p = o + d * (3.0 / -d.z);
            assert!((values(&DEPTH, x, y)[0] - 3.0).abs() < 1e-5);
            for (found, exact) in values(&POSITION, x, y).iter().zip(p.to_array()) {
                assert!((f64::from(*found) - exact).abs() < 1e-3);
            }
            let normal = values(&NORMAL, x, y);
            assert!((normal[2] - 1.0).abs() < 1e-6 && normal[0].abs() < 1e-6, "{normal:?}");
            for (found, exact) in values(&ALBEDO, x, y).iter().zip([0.6, 0.3, 0.1]) {
                assert!((found - exact).abs() < 1e-6);
            }
            assert_eq!(values(&TRANSMITTANCE, x, y), [0.0; 3]);
        }
        assert_eq!(values(&DEPTH, 1, 1), [1e10]);
        assert_eq!(values(&POSITION, 1, 1), [0.0; 3]);
        assert_eq!(values(&ALBEDO, 1, 1), [0.0; 3]);
        assert_eq!(values(&TRANSMITTANCE, 1, 1), [1.0; 3]);
    }
}

/// Direct light is the picture of paths with one scattering, without what is seen directly:
/// whatever else the full picture holds, by shadow rays, by paths that run into light, by
/// equiangular points, in media, at surfaces, where channels part.
#[test]
fn direct_light_is_the_picture_of_one_scattering() {
    let medium = |sigma_t| cube_grid(1.0, sigma_t, [0.9, 0.8, 0.7], Phase::henyey_greenstein(0.5));
    let mut sunlit = seen(vec![medium([2.0; 3])]);
    sunlit.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(3.0), 0.3));
    let mut lamp = seen(vec![medium([2.0; 3])]);
    let position = DVec3::new(0.1, 0.2, 1.3);
    lamp.lights.push(Light::Point(Point { position, intensity: Vec3::splat(2.0) }));
    let mut parting = sunlit.clone();
    parting.volumes = seen(vec![medium([2.0, 0.7, 0.3])]).volumes;
    let mut floor = sunlit.clone();
    let lamp_above = quad([-0.6, 1.5, -0.4], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
    let below = quad([-1.5, -1.1, -1.5], [0.0, 0.0, 3.0], [3.0, 0.0, 0.0]);
    floor.surfaces = Some(surfaces(&[
        (below, lambert([0.6, 0.5, 0.4])),
        (lamp_above, area_light([0.2; 3], [2.0, 1.0, 0.5])),
    ]));
    let mut fire = seen(vec![]);
    fire.volumes.push(glowing_cube(1.0, [1.5; 3], [0.6; 3], [1.0, 0.6, 0.2]));
    for (what, scene) in
        [("sun", sunlit), ("lamp", lamp), ("parting", parting), ("floor", floor), ("fire", fire)]
    {
        let wanted: [&Layer; 4] = [&BACKGROUND, &EMISSION, &DIRECT, &INDIRECT];
        let once = |seed| RenderSettings { max_bounces: Some(1), ..point_filter(24, 1000 + seed) };
        let all: Vec<Image> =
            (0..SEEDS).map(|seed| layers(&scene, &point_filter(24, seed), &wanted)).collect();
        let short: Vec<Image> =
            (0..SEEDS).map(|seed| layers(&scene, &once(seed), &wanted)).collect();
        for c in 0..3 {
            let mean = |image: &Image, layer: &Layer| off(image, layer.channels[c], |_, _| 0.0);
            let difference = over_seeds(|seed| {
                let (all, short) = (&all[seed as usize], &short[seed as usize]);
                let rest = mean(short, &BEAUTY) - mean(short, &BACKGROUND) - mean(short, &EMISSION);
                mean(all, &DIRECT) - rest
            });
            let direct = mean(&all[0], &DIRECT);
            assert!(direct > 0.01 && mean(&all[0], &INDIRECT) > 0.01 * direct, "{what}");
            assert_eq!(what == "fire", mean(&all[0], &EMISSION) > 1e-3, "{what}");
            assert_zero(&format!("{what}: direct {c}"), difference, 0.02 * direct);
            // Nothing is left for indirect light where paths scatter once.
            let left = mean(&short[0], &INDIRECT).abs();
            assert!(left < 1e-6 * direct.max(1.0), "{what}: {left} of {direct}");
        }
    }
}

/// A camera inside a body that absorbs or scatters: weights are one where something was met, albedo
/// is the wall's or the medium's.
#[test]
fn interior_media_are_first_events_too() {
    for (scatters, expected) in [(false, [0.6f32, 0.3, 0.1]), (true, [0.9, 0.5, 0.1])] {
        let mut wall = glass(1.0);
        wall["pbrMetallicRoughness"]["baseColorFactor"] = serde_json::json!([0.6, 0.3, 0.1, 1.0]);
        wall["extensions"]["KHR_materials_volume"] = serde_json::json!({"thicknessFactor": 1.0,
            "attenuationDistance": 0.4, "attenuationColor": [0.1, 0.1, 0.1]});
        if scatters {
            wall["extensions"]["KHR_materials_volume_scatter"] =
                serde_json::json!({"multiscatterColor": [0.7, 0.5, 0.3]});
        }
        let mut scene = scene(vec![], DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.1, 0.2, -1.0), 40.0);
        scene.environment.constant = Vec3::ONE;
        scene.surfaces = Some(surfaces(&[(cube(1.0), wall)]));
        let wanted: [&Layer; 4] = [&ALBEDO, &NORMAL, &DEPTH, &POSITION];
        let image = layers(&scene, &point_filter(64, 1), &wanted);
        let at = |channel: &str| image.get(channel, 30, 33).unwrap();
        let albedo = ["albedo.R", "albedo.G", "albedo.B"].map(at);
        if scatters {
            // Single-scattering albedo of the channels in the order of their colours, none grey.
            assert!(albedo[0] > albedo[1] + 0.02 && albedo[1] > albedo[2] + 0.02, "{albedo:?}");
            assert!(at("depth.Z") < 1.0, "{}", at("depth.Z"));
        } else {
            for (found, expected) in albedo.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-5, "{albedo:?}");
            }
            assert!((at("depth.Z") - 1.3).abs() < 1e-5 && (at("normal.Z") - 1.0).abs() < 1e-5);
        }
        assert_eq!(at("A"), 1.0);
    }
}
