//! Is the variance that a film reports that of its means? And does light of any size reach them?
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus::input::{Input, VdbOptions};
use pileus::settings::{Overrides, Settings};
use pileus_film::{Crop, Film};
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::Phase;
use pileus_scene::{EnvironmentImage, Scene};
use pileus_tests::{
    cube_homogeneous, lambert, lumpy_grid, quad, root, scene, settings, sun, surfaces,
};
use std::path::Path;
use std::sync::Arc;

/// Seeds that tell the true variance.
const SEEDS: u64 = 200;

/// The scene of a file as the program loads it.
fn load(path: &Path, resolution: Option<[u32; 2]>) -> (Scene, RenderSettings) {
    let input = Input::open(path, &VdbOptions::default()).expect("an input");
    let overrides = Overrides { resolution, ..Overrides::default() };
    let settings = Settings::resolve(input, &overrides).expect("a sound job");
    let scene = settings.load().expect("a sound scene").scene;
    (scene, settings.render)
}

/// A window of this size in the middle of the scene's image.
fn middle(scene: &Scene, size: u32) -> Crop {
    let [width, height] = scene.camera.resolution();
    Crop { x0: (width - size) / 2, y0: (height - size) / 2, width: size, height: size }
}

/// Mean reported variance over the variance of the means over seeds, of radiance and of alpha, for
/// each count of samples.
///
/// Null hypothesis: the ratio is one. Its standard error is estimated from the pixels, which are
/// independent of each other, and must be below `power`. At 0.02 a ratio of one leaves [.9, 1.15]
/// with probability 6e-7, a ratio of .82 or 1.24 stays in with as little; sums of squares of single
/// samples give 1.2 to 6 here. Radiances are weighted by one over the square of their pixel's mean
/// and a tenth of the image's, so that no bright pixel decides.
fn check(what: &str, scene: &Scene, base: &RenderSettings, size: u32, counts: &[u64], power: f64) {
    let crop = middle(scene, size);
    for &count in counts {
        // Per pixel and channel: sum and sum of squares of means, sum of variances.
        let mut sums = vec![[[0.0f64; 3]; 4]; (size * size) as usize];
        for seed in 0..SEEDS {
            let settings = RenderSettings { samples: 0..count, seed: 900 + seed, ..base.clone() };
            let mut film = Film::new(scene.camera.resolution(), Some(crop)).expect("a film");
            let counters = Renderer::new(scene, &settings)
                .expect("a plan")
                .render(&mut film, &Unmonitored)
                .expect("one");
            assert_eq!((counters.violations, counters.dropped), (0, 0), "{what}");
            for (i, pixel) in (0..).zip(&mut sums) {
                let moments = film.pixel(crop.x0 + i % size, crop.y0 + i / size).expect("a pixel");
                let (mean, variance) = (moments.mean(), moments.variance_of_mean());
                for (c, [sum, squares, reported]) in pixel.iter_mut().enumerate() {
                    *sum += mean[c];
                    *squares += mean[c] * mean[c];
                    *reported += variance[c];
                }
            }
        }
        let n = SEEDS as f64;
        let level: f64 = sums.iter().flat_map(|p| &p[..3]).map(|[sum, ..]| sum / n).sum::<f64>()
            / (3 * sums.len()) as f64;
        for (part, channels) in [("radiance", 0..3), ("alpha", 3..4)] {
            let pixels: Vec<[f64; 2]> = sums
                .iter()
                .map(|pixel| {
                    pixel[channels.clone()].iter().fold([0.0; 2], |[a, b], [sum, squares, all]| {
                        let mean = sum / n;
                        let weight = if part == "alpha" {
                            1.0
                        } else {
                            1.0 / (mean * mean + 0.01 * level * level)
                        };
                        let truth = (squares - sum * mean) / (n - 1.0);
                        [a + weight * all / n, b + weight * truth]
                    })
                })
                .collect();
            let [reported, truth] = pixels.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            if truth == 0.0 {
                assert_eq!(reported, 0.0, "{what}: {part}");
                continue;
            }
            let ratio = reported / truth;
            let error = pixels.iter().map(|p| (p[0] - ratio * p[1]).powi(2)).sum::<f64>().sqrt();
            let error = error / truth;
            println!("{what}, {count} samples, {part}: reported / true {ratio:.3} +- {error:.3}");
            assert!((0.9..=1.15).contains(&ratio), "{what}, {count}, {part}: {ratio} +- {error}");
            assert!(error < power, "{what}, {count}, {part}: error {error}, the test is too weak");
        }
    }
}

fn front(media: Vec<pileus_media::Medium>) -> Scene {
    let mut scene = scene(media, DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, 40.0);
    scene.environment.constant = Vec3::new(0.2, 0.3, 0.5);
    scene
}

#[test]
fn of_a_thin_medium_with_alpha() {
    let albedo = [0.9, 0.8, 0.7];
    let mut thin = front(vec![cube_homogeneous(1.0, [0.1; 3], albedo, Phase::Isotropic)]);
    thin.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(1.0), 0.0));
    check("thin", &thin, &settings(0, 0), 12, &[16, 64], 0.02);
}

#[test]
fn of_a_thick_medium() {
    let phase = Phase::henyey_greenstein(0.6);
    let mut thick = front(vec![lumpy_grid(1.0, [4.0; 3], [0.9, 0.8, 0.7], phase)]);
    thick.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(3.0), 0.0));
    check("thick", &thick, &settings(0, 0), 12, &[16, 40], 0.02);
}

/// The rim of the disc crosses pixels; its radiance is 1.5e9.
#[test]
fn of_a_suns_disc() {
    let mut disc = scene(vec![], DVec3::ZERO, DVec3::NEG_Z, 1.0);
    disc.lights.push(sun(Vec3::NEG_Z, Vec3::splat(1e5), 0.53f32.to_radians()));
    check("disc", &disc, &settings(0, 0), 38, &[16, 40], 0.02);
}

#[test]
fn of_an_environments_image() {
    let thin = cube_homogeneous(1.0, [0.3; 3], [0.9; 3], Phase::henyey_greenstein(0.5));
    let mut image = front(vec![thin]);
    image.environment.constant = Vec3::ZERO;
    let texels = (0..64 * 32).map(|i| [if i % 7 == 0 { 3.0 } else { 0.2 }, 0.4, 0.1]).collect();
    image.environment.image =
        Some(Arc::new(EnvironmentImage::new(64, 32, texels, 1.0, 0.0).expect("an image")));
    check("image", &image, &settings(0, 0), 12, &[16, 64], 0.02);
}

/// All assets under the program's own light and the peers' jobs, with `PILEUS_SLOW_TESTS` (some
/// minutes). Small pictures of all there is.
#[test]
fn of_every_asset() {
    if std::env::var_os("PILEUS_SLOW_TESTS").is_none() {
        return;
    }
    let assets = [
        "assets/syn_plume.vdb",
        "assets/syn_sphere.vdb",
        "assets/syn_rotated.vdb",
        "assets/smoke_plume.vdb",
        "assets/fire_0003.vdb",
        "assets/arnold_smoke.vdb",
        "assets/cumulus_small.vdb",
        "assets/cumulus.vdb",
        "peers/plume.json",
        "peers/plume_chromatic.json",
        "peers/arnold_smoke.json",
        "peers/cumulus_small.json",
    ];
    for asset in assets {
        let (scene, base) = load(&root().join("scenes").join(asset), Some([16, 16]));
        check(asset, &scene, &base, 12, &[16, 64], 0.035);
    }
}

/// Renders a scene and returns the mean of its pixels; no sample may be dropped.
fn mean(scene: &Scene, settings: &RenderSettings, size: u32) -> [f64; 4] {
    let crop = middle(scene, size);
    let mut film = Film::new(scene.camera.resolution(), Some(crop)).expect("a film");
    let counters = Renderer::new(scene, settings)
        .expect("a plan")
        .render(&mut film, &Unmonitored)
        .expect("a render");
    assert_eq!((counters.dropped, film.dropped()), (0, 0));
    let image = film.image();
    ["R", "G", "B", "A"].map(|name| {
        let plane = image.channel(name).expect("a channel");
        plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64
    })
}

/// Jobs that look into a sun of 100 klx and brighter: irradiance over the disc's solid angle, which
/// fills the picture.
#[test]
fn a_suns_disc_has_its_radiance() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sun.json");
    for (irradiance, degrees) in [(7e4, 0.53), (1e5, 0.53), (1.3e5, 0.2), (1e9, 1.0), (1e28, 0.53)]
    {
        let job = serde_json::json!({
            "lights": [{"type": "sun", "to_light": [0, 0, -1], "irradiance": irradiance,
                "angular_diameter": degrees}],
            "camera": {"position": [0, 0, 0], "look_at": [0, 0, -1], "fov_y": 0.1},
            "film": {"resolution": [8, 8]}, "sampling": {"spp": 16},
        });
        std::fs::write(&path, job.to_string()).expect("a job");
        let (scene, settings) = load(&path, None);
        let radius = f64::to_radians(degrees) / 2.0;
        let expected = irradiance / (std::f64::consts::PI * radius.sin().powi(2));
        for got in &mean(&scene, &settings, 8)[..3] {
            assert!((got / expected - 1.0).abs() < 2e-3, "{irradiance}: {got} for {expected}");
        }
    }
}

/// A texel of any size lights a floor, a medium and the camera in proportion: the same numbers are
/// drawn.
#[test]
fn a_texel_of_any_size_counts() {
    let of = |value: f32| {
        let mut scene = scene(
            vec![cube_homogeneous(1.0, [0.3; 3], [0.9; 3], Phase::Isotropic)],
            DVec3::new(0.0, 0.5, 5.0),
            DVec3::ZERO,
            60.0,
        );
        let floor = quad([-2.0, -1.5, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0]);
        scene.surfaces = Some(surfaces(&[(floor, lambert([0.5; 3]))]));
        // A row a little above the horizon, all around: seen, and lighting the floor.
        let texels = (0..16 * 8).map(|i| [if i / 16 == 3 { value } else { 0.0 }; 3]).collect();
        scene.environment.image =
            Some(Arc::new(EnvironmentImage::new(16, 8, texels, 1.0, 0.0).expect("an image")));
        mean(&scene, &settings(16, 3), 32)
    };
    let unit = of(1.0);
    assert!(unit[0] > 0.05 && unit[3] > 0.1, "{unit:?}");
    for value in [1e-20f32, 1e-6, 1.2e9, 1e12, 1e20, 1e30] {
        let got = of(value);
        let ratio = got[0] / f64::from(value) / unit[0];
        assert!((ratio - 1.0).abs() < 1e-4, "{value:e}: {ratio}");
        assert!((got[3] - unit[3]).abs() < 1e-6, "{value:e}: alpha {got:?}");
    }
}
