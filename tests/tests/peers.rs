//! The peers' scenes against their converged images.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_film::read_exr;
use pileus_integrator::RenderSettings;
use pileus_media::Phase;
use pileus_scene::{Camera, Light, Scene, Sun};
use pileus_tests::{Rendered, asset_medium, rendered, root, scene};
use serde_json::Value;

fn vec3(value: &Value) -> DVec3 {
    let number = |i: usize| value[i].as_f64().expect("a number");
    DVec3::new(number(0), number(1), number(2))
}

/// Builds a peer's scene from its job without the program, so that a fault of the job's parser
/// cannot hide here.
fn load(name: &str) -> (Scene, RenderSettings) {
    let path = root().join(format!("scenes/peers/{name}.json"));
    let job: Value = serde_json::from_slice(&std::fs::read(path).expect("a job")).expect("JSON");
    let volume = &job["volumes"][0];
    let scale = volume["density"]["scale"].as_f64().expect("a scale") as f32;
    let extinction = match &volume["extinction"] {
        Value::Null => Vec3::ONE,
        value => vec3(value).as_vec3(),
    };
    let phase = Phase::henyey_greenstein(volume["phase"]["g"].as_f64().unwrap_or(0.0) as f32);
    let file = volume["vdb"].as_str().expect("a file").rsplit('/').next().expect("a name");
    let albedo = vec3(&volume["albedo"]).as_vec3().to_array();
    let medium = asset_medium(file, (extinction * scale).to_array(), albedo, phase);
    let camera = &job["camera"];
    let mut scene = scene(vec![medium], DVec3::Z, DVec3::ZERO, 30.0);
    let resolution = [0, 1].map(|i| job["film"]["resolution"][i].as_u64().expect("a size") as u32);
    scene.camera = Camera::look_at(
        vec3(&camera["position"]),
        vec3(&camera["look_at"]),
        vec3(&camera["up"]),
        camera["fov_y"].as_f64().expect("an angle"),
        resolution,
    )
    .expect("a camera");
    for light in job["lights"].as_array().expect("lights") {
        match light["type"].as_str() {
            Some("sun") => scene.lights.push(Light::Sun(Sun {
                to_light: vec3(&light["to_light"]).normalize().as_vec3(),
                irradiance: vec3(&light["irradiance"]).as_vec3(),
                angular_diameter: 0.0,
            })),
            _ => scene.environment.constant = vec3(&light["radiance"]).as_vec3(),
        }
    }
    let max_bounces = job["sampling"]["max_bounces"].as_u64().map(|n| n as u32);
    (scene, RenderSettings { max_bounces, ..RenderSettings::default() })
}

/// Relative error of a mean by rounding.
const ROUNDING: f64 = 1e-5;

/// Null hypothesis: our image and the peer's have the same expectation in every block of 16 x 16
/// pixels and channel, their variances known. Both images are sums in single precision: where there
/// is no noise at all they may differ by a relative [`ROUNDING`].
fn check(name: &str, spp: u64) {
    let (scene, settings) = load(name);
    let slow = std::env::var_os("PILEUS_SLOW_TESTS").is_some();
    let samples = 0..if slow { 16 * spp } else { spp };
    let ours = rendered(&scene, &RenderSettings { samples, seed: 5, ..settings });
    let read = |suffix: &str| {
        let path = root().join(format!("tests/data/peers/{name}{suffix}.exr"));
        read_exr(&path).expect("a reference")
    };
    let (theirs, mut variance) = (read(""), read(".var"));
    for c in ["R", "G", "B"] {
        let means = theirs.channel(c).expect("a channel").to_vec();
        for (v, mean) in variance.channel_mut(c).expect("a channel").iter_mut().zip(means) {
            // The mean of a block of 256 pixels is to have this standard error at least.
            *v += (f64::from(mean) * ROUNDING).powi(2) as f32 * 256.0;
        }
    }
    let Rendered { image, variance: our_variance, .. } = &ours;
    let test =
        pileus_lab::block_z_test(image, our_variance, &theirs, &variance, 16).expect("a test");
    println!(
        "{name}: p {:.3}, max |z| {:.2}, chi2 {:?} of {:?}",
        test.p_value, test.max_abs_z, test.chi2, test.dof
    );
    assert!(
        test.p_value > 1e-9,
        "{name}: p {:e}, max |z| {:.2}, chi2 {:?} of {:?}",
        test.p_value,
        test.max_abs_z,
        test.chi2,
        test.dof
    );
}

#[test]
fn cumulus_small() {
    check("cumulus_small", 64);
}

#[test]
fn cumulus() {
    check("cumulus", 64);
}

#[test]
fn arnold_smoke() {
    check("arnold_smoke", 64);
}

#[test]
fn plume() {
    check("plume", 64);
}

/// Where the plume ends, single paths in a block meet it: how much they vary is not known from
/// fewer.
#[test]
fn plume_chromatic() {
    check("plume_chromatic", 256);
}
