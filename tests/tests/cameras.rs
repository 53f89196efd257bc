//! Cameras in whole pictures: lenses against closed forms and quadratures, orthographic cameras
//! and panoramas against perspective ones, bodies of glass that a camera is in.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_film::{Film, Image};
use pileus_integrator::{Plan, RenderSettings, Renderer, Unmonitored};
use pileus_media::Phase;
use pileus_scene::volume::DefaultScale;
use pileus_scene::{
    Camera, CameraRequest, EnvironmentImage, Focus, GlassRule, Lens, LensRequest, Place,
    Projection, Scene, SceneRequest,
};
use pileus_tests::*;
use serde_json::{Value, json};
use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

/// A scene of nothing, seen by this camera.
fn seen_by(camera: Camera) -> Scene {
    let mut scene = scene(vec![], DVec3::Z, DVec3::ZERO, 30.0);
    scene.camera = camera;
    scene
}

fn camera(position: DVec3, target: DVec3, projection: Projection, resolution: [u32; 2]) -> Camera {
    Camera::new(position, target, DVec3::Y, projection, resolution).expect("a camera")
}

fn lens(aperture: f64, focus_distance: f64, blades: u32) -> Lens {
    Lens::new(aperture, focus_distance, blades).expect("a lens")
}

/// The share of the unit disc beyond a chord at distance `a` from its middle.
fn share_of_disc(a: f64) -> f64 {
    let a = a.clamp(-1.0, 1.0);
    (a.acos() - a * (1.0 - a * a).sqrt()) / PI
}

/// The share of the regular polygon with corners on the unit circle, one of them on top, that lies
/// beyond `x = a`: its corners clipped there, and the shoelace formula.
fn share_of_polygon(sides: u32, a: f64) -> f64 {
    let corners: Vec<[f64; 2]> = (0..sides)
        .map(|i| TAU * f64::from(i) / f64::from(sides))
        .map(|angle| [angle.sin(), angle.cos()])
        .collect();
    let area = |polygon: &[[f64; 2]]| {
        let pairs = (0..polygon.len()).map(|i| (polygon[i], polygon[(i + 1) % polygon.len()]));
        0.5 * pairs.map(|(p, q)| p[0] * q[1] - p[1] * q[0]).sum::<f64>().abs()
    };
    let mut kept = Vec::new();
    for i in 0..corners.len() {
        let (p, q) = (corners[i], corners[(i + 1) % corners.len()]);
        if p[0] > a {
            kept.push(p);
        }
        if (p[0] > a) != (q[0] > a) {
            let t = (a - p[0]) / (q[0] - p[0]);
            kept.push([a, p[1] + t * (q[1] - p[1])]);
        }
    }
    area(&kept) / area(&corners)
}

/// Half of all space is hidden by a sheet at depth `z` whose edge is seen from its side; light
/// comes from everywhere. A pixel is the share of the aperture from which the edge does not hide
/// the background, in closed form, whichever side of the plane of focus the edge is on; in that
/// plane it is sharp.
///
/// Null hypothesis: every pixel has that expectation; see `assert_expected` (false alarm 2e-9 each,
/// six of them). A radius taken for the diameter changes the shares of blurred pixels by up to 0.2,
/// a hundred times the standard error of a block.
#[test]
fn edges_are_blurred_by_the_shape_of_the_aperture() {
    let (aperture, focus) = (0.9, 5.0);
    for (k, projection) in
        [Projection::Perspective { fov_y_degrees: 40.0 }, Projection::Orthographic { height: 3.0 }]
            .into_iter()
            .enumerate()
    {
        for (blades, z) in [(0, 2.0), (5, 12.0), (0, focus)] {
            let plain = camera(DVec3::ZERO, DVec3::NEG_Z, projection, [64, 64]);
            let mut scene =
                seen_by(plain.clone().with_lens(lens(aperture, focus, blades)).unwrap());
            scene.environment.constant = Vec3::ONE;
            let sheet = quad([-100.0, -100.0, -z as f32], [100.0, 0.0, 0.0], [0.0, 200.0, 0.0]);
            scene.surfaces = Some(surfaces(&[(sheet, lambert([0.0; 3]))]));
            let settings = point_filter(64, 70 + 3 * k as u64 + u64::from(blades));
            let what = format!("{projection:?}, {blades} blades, edge at {z}");
            assert_expected(&what, &rendered(&scene, &settings), 7e-4, |x, y| {
                // Where the pinhole's ray passes the plane of the edge, and how far from there one
                // through the rim of the aperture does.
                let (o, d) = plain.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]);
                let at_edge = o.x - d.x as f64 / d.z as f64 * z;
                let blur = 0.5 * aperture * (1.0 - z / focus);
                let share = match blades {
                    _ if blur == 0.0 => f64::from(at_edge > 0.0),
                    0 => share_of_disc(-at_edge / blur.abs()),
                    // Seen from behind the plane of focus the aperture stands on its head, which
                    // changes nothing from left to right.
                    n => share_of_polygon(n, -at_edge / blur.abs()),
                };
                [share; 3]
            });
        }
    }
}

/// Points of a disc of unit diameter and their weights, by radius and angle.
fn disc_quadrature(rings: u32, spokes: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..rings * spokes).map(move |i| {
        // Rings of equal area.
        let radius = 0.5 * ((f64::from(i / spokes) + 0.5) / f64::from(rings)).sqrt();
        let angle = TAU * (f64::from(i % spokes) + 0.25) / f64::from(spokes);
        [radius * angle.cos(), radius * angle.sin()]
    })
}

/// A ray from a point of the aperture to where the pinhole's meets the plane of focus, by its
/// definition.
fn through_lens(plain: &Camera, lens: &Lens, film: [f64; 2], [x, y]: [f64; 2]) -> (DVec3, DVec3) {
    let (origin, direction) = plain.ray(film);
    let direction = direction.as_dvec3();
    let focus = origin + direction * (lens.focus_distance() / direction.dot(plain.forward()));
    let right = plain.forward().cross(plain.up());
    let start = origin + (right * x + plain.up() * y) * lens.aperture();
    (start, (focus - start).normalize())
}

/// A cloud that absorbs, before light from everywhere: a pixel is the mean over the aperture of the
/// exact transmittances of its rays.
///
/// Null hypothesis: it has that expectation, a quadrature with 640 points whose error is some 1e-4;
/// see `assert_expected`. Blocks keep their mean under any blur, so that the blur itself is
/// measured besides: the scalar product of the picture's difference from its expectation with what
/// the lens changes about the pinhole's picture, over that of the latter with itself; 0 is
/// expected, -1 is a pinhole, 3 some twice as wide an aperture. |z| < 6.5: false alarm 2e-10 for
/// both projections. With a standard error below 0.016 a tenth too much or too little in the
/// diameter, a fifth of the blur, is seen with certainty.
#[test]
fn clouds_are_blurred_by_the_mean_over_the_aperture() {
    let cloud = lumpy_grid(1.0, [1.4, 0.7, 0.2], [0.0; 3], Phase::Isotropic);
    let mut scene = scene(vec![cloud], DVec3::Z, DVec3::ZERO, 30.0);
    scene.environment.constant = Vec3::ONE;
    for (k, projection) in
        [Projection::Perspective { fov_y_degrees: 38.0 }, Projection::Orthographic { height: 2.6 }]
            .into_iter()
            .enumerate()
    {
        let plain = camera(DVec3::new(1.5, 1.0, 3.5), DVec3::ZERO, projection, [32, 32]);
        let lens = lens(1.0, 2.6, 0);
        scene.camera = plain.clone().with_lens(lens.clone()).unwrap();
        let what = format!("a cloud, {projection:?}");
        let found = rendered(&scene, &point_filter(192, 80 + k as u64));
        let passed = |(o, d): (DVec3, DVec3)| transmittance(&scene, o, d, f64::INFINITY);
        let film = |i: u32| [f64::from(i % 32) + 0.5, f64::from(i / 32) + 0.5];
        let expected: Vec<DVec3> = (0..32 * 32)
            .map(|i| {
                let rays = disc_quadrature(16, 40).map(|p| through_lens(&plain, &lens, film(i), p));
                rays.map(passed).sum::<DVec3>() / (16.0 * 40.0)
            })
            .collect();
        assert_expected(&what, &found, 2.6e-3, |x, y| expected[(32 * y + x) as usize].to_array());
        let (mut off, mut blur, mut noise) = (0.0, 0.0, 0.0f64);
        for (i, expected) in (0u32..).zip(&expected) {
            let (o, d) = plain.ray(film(i));
            let changed = expected.x - passed((o, d.as_dvec3())).x;
            let of = |image: &Image| f64::from(image.get("R", i % 32, i / 32).expect("a pixel"));
            off += changed * (of(&found.image) - expected.x);
            blur += changed * changed;
            noise += changed * changed * of(&found.variance);
        }
        let (off, error) = (off / blur, noise.sqrt() / blur);
        println!("{what}: blur off by {off:+.3} of itself, standard error {error:.3}");
        assert!(error < 0.016, "{what}: standard error {error}, the test is too weak");
        assert!(off.abs() < 6.5 * error, "{what}: the blur is off by {off}, error {error}");
    }
}

/// A scene of everything: smoke, glass, a floor, a sun and a sky that differs from place to place.
fn still_life(camera: Camera) -> Scene {
    let smoke = lumpy_grid(0.6, [1.5, 1.5, 1.5], [0.8; 3], Phase::henyey_greenstein(0.5));
    let mut scene = scene(vec![smoke], DVec3::Z, DVec3::ZERO, 30.0);
    scene.camera = camera;
    let floor = quad([-3.0, -0.8, -3.0], [0.0, 0.0, 6.0], [6.0, 0.0, 0.0]);
    scene.surfaces = Some(surfaces(&[
        (floor, lambert([0.6, 0.4, 0.3])),
        (sphere(DVec3::new(0.9, -0.3, 0.5), 0.4, 8), glass(1.4)),
    ]));
    scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.4), Vec3::splat(0.8), 20.0));
    let texels = (0..32 * 16).map(|i| {
        let (x, y) = ((i % 32) as f32 / 32.0, (i / 32) as f32 / 16.0);
        [0.4 + 0.3 * (x * TAU as f32).sin(), 0.5, 0.7 - 0.4 * y]
    });
    let sky = EnvironmentImage::new(32, 16, texels.collect(), 1.0, 0.0).unwrap();
    scene.environment.image = Some(Arc::new(sky));
    scene
}

/// From afar a narrow perspective is a parallel projection, but for what two thousandths of its
/// distance make: sizes differ by 5e-4 over the depth of the scene, a seventieth of a pixel.
///
/// Null hypothesis: both pictures have the same expectation; see `assert_same`.
#[test]
fn orthographic_is_perspective_from_afar() {
    let (direction, height, far) = (DVec3::new(0.5, 0.4, 1.0).normalize(), 2.4, 2000.0);
    let flat = Projection::Orthographic { height };
    let flat = camera(direction * 5.0, DVec3::ZERO, flat, [48, 48]);
    let fov_y_degrees = (2.0 * (0.5 * height / far).atan()).to_degrees();
    let narrow = Projection::Perspective { fov_y_degrees };
    let narrow = camera(direction * far, DVec3::ZERO, narrow, [48, 48]);
    let flat = rendered(&still_life(flat), &settings(160, 90));
    let narrow = rendered(&still_life(narrow), &settings(160, 91));
    assert_same("orthographic and far perspective", &flat, &narrow, 8.5e-4);
}

/// Sums over all directions of radiance times [`harmonics`], by an image whose film shows
/// directions by `direction` and has solid angles of `solid_angle` a pixel; with the variances of
/// the sums. Each pixel's weight is its mean over 3 x 3 points.
fn moments(
    rendered: &Rendered,
    direction: impl Fn([f64; 2]) -> DVec3,
    solid_angle: impl Fn([f64; 2]) -> f64,
) -> ([f64; 9], [f64; 9]) {
    let (mut sums, mut variances) = ([0.0; 9], [0.0; 9]);
    let value = |image: &Image, x, y| f64::from(image.get("G", x, y).expect("a pixel"));
    let (width, height) = (rendered.image.width(), rendered.image.height());
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let mut weight = [0.0; 9];
        for i in 0..9u32 {
            let at = |pixel: u32, part: u32| f64::from(pixel) + f64::from(2 * part + 1) / 6.0;
            let film = [at(x, i % 3), at(y, i / 3)];
            for (sum, w) in weight.iter_mut().zip(harmonics(direction(film))) {
                *sum += w * solid_angle(film) / 9.0;
            }
        }
        for k in 0..9 {
            sums[k] += weight[k] * value(&rendered.image, x, y);
            variances[k] += weight[k].powi(2) * value(&rendered.variance, x, y);
        }
    }
    (sums, variances)
}

/// Polynomials of a unit direction up to the second order.
fn harmonics(direction: DVec3) -> [f64; 9] {
    let [x, y, z] = direction.to_array();
    [1.0, x, y, z, x * y, y * z, z * x, x * x - y * y, 1.5 * z * z - 0.5]
}

/// A panorama has what six perspective views of 90 degrees have, direction by direction: moments
/// of radiance over the sphere up to the second order, which tell turns, mirror images and sizes.
///
/// Null hypothesis: they are equal but for 1e-3 of the mean, what pixels of finite size may make.
/// |z| < 6.5 in nine moments: false alarm 8e-10. A moment that is off by 1 % of the mean radiance
/// is seen with certainty: the standard error is below 1e-3 of it. The scene has moments of some 10
/// %, whose signs a mirror image changes.
#[test]
fn panoramas_are_six_views() {
    let (at, looks) = (DVec3::new(-0.3, 0.1, 1.7), DVec3::new(0.6, -0.2, -1.0).normalize());
    let panorama = camera(at, at + looks, Projection::Panorama, [128, 64]);
    let right = looks.cross(DVec3::Y).normalize();
    let up = right.cross(looks);
    // In the middle along the view, to the right by longitude, to the top by latitude.
    let angles = |film: [f64; 2]| ((film[0] / 128.0 - 0.5) * TAU, (0.5 - film[1] / 64.0) * PI);
    let direction = |film| {
        let (longitude, latitude) = angles(film);
        let level = looks * longitude.cos() + right * longitude.sin();
        level * latitude.cos() + up * latitude.sin()
    };
    let pixel = |film| angles(film).1.cos() * (TAU / 128.0) * (PI / 64.0);
    let found = rendered(&still_life(panorama), &settings(64, 92));
    let (sums, variances) = moments(&found, direction, pixel);
    let (mut expected, mut noise) = ([0.0; 9], variances);
    let view = Projection::Perspective { fov_y_degrees: 90.0 };
    for (k, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        for side in [1.0, -1.0] {
            let up = if k == 1 { DVec3::Z } else { DVec3::Y };
            let forward = axis * side;
            let face = Camera::new(at, at + forward, up, view, [40, 40]).unwrap();
            let point = |film: [f64; 2]| film.map(|f| f / 20.0 - 1.0);
            let of_face = |film| {
                let [x, y] = point(film);
                (forward + forward.cross(up) * x - up * y).normalize()
            };
            let pixel = |film| {
                let [x, y] = point(film);
                (1.0 + x * x + y * y).powf(-1.5) / 400.0
            };
            let seed = 93 + 2 * k as u64 + u64::from(side > 0.0);
            let found = rendered(&still_life(face), &settings(64, seed));
            let (sums, variances) = moments(&found, of_face, pixel);
            for i in 0..9 {
                expected[i] += sums[i];
                noise[i] += variances[i];
            }
        }
    }
    let mean = expected[0];
    for i in 0..9 {
        let (off, error) = ((sums[i] - expected[i]) / mean, noise[i].sqrt() / mean);
        println!("moment {i}: {:.4}, off {off:+.1e}, error {error:.1e}", expected[i] / mean);
        assert!(error < 1e-3, "moment {i}: standard error {error:e}, the test is too weak");
        assert!((off.abs() - 1e-3).max(0.0) < 6.5 * error, "moment {i} is off by {off:e}");
    }
}

/// A cube that neither bends nor reflects, with this colour after length 0.7 inside.
fn straight(color: [f32; 3]) -> Value {
    let mut material = glass(1.0);
    material["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 1.0, "attenuationDistance": 0.7,
        "attenuationColor": color});
    material
}

/// What a body of this colour lets through of a ray that may start in it.
fn passed(color: [f32; 3], (o, d): (DVec3, DVec3)) -> DVec3 {
    let length = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b.max(0.0) - a.max(0.0));
    DVec3::from_array(color.map(|c| f64::from(c).powf(length / 0.7)))
}

/// The film of an orthographic camera goes through a body: rays that start inside of it are known
/// to. In every sample, without noise: one channel is clear, no path undergoes roulette.
#[test]
fn bodies_hold_parts_of_an_orthographic_film() {
    let color = [0.2f32, 0.5, 1.0];
    let flat = Projection::Orthographic { height: 3.5 };
    let (mut inside, mut outside) = (0, 0);
    for (position, target) in [
        (DVec3::new(0.1, 0.05, 0.2), DVec3::new(2.0, 0.3, 1.0)),
        (DVec3::new(-0.9, 0.05, 0.2), DVec3::new(-0.9, 0.05, 9.0)),
    ] {
        let mut scene = seen_by(camera(position, target, flat, [64, 64]));
        scene.environment.constant = Vec3::ONE;
        scene.surfaces = Some(surfaces(&[(cube(1.0), straight(color))]));
        let image = rendered(&scene, &point_filter(2, 1)).image;
        for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
            let ray = pixel_ray(&scene, x, y);
            // Rays along a wall are on either side of it.
            let walls = ray.0.abs() - 1.0;
            if walls.abs().min_element() < 1e-3 {
                continue;
            }
            if walls.max_element() < 0.0 {
                inside += 1
            } else {
                outside += 1
            }
            let expected = passed(color, ray);
            for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
                let found = f64::from(image.get(name, x, y).unwrap());
                assert!((found - expected[c]).abs() < 1e-3, "{x} {y}: {found} {expected}");
            }
        }
    }
    assert!(inside > 1000 && outside > 1000, "{inside} {outside}");
}

/// A lens half inside of a body: each ray is in what its own origin is in. By the medium around the
/// middle of the lens alone half of all rays would be as dark, or as bright, as the others.
///
/// Null hypothesis: pixels are the mean over the aperture, by a quadrature with 12800 points whose
/// error is some 1e-4; see `assert_expected`.
#[test]
fn bodies_hold_parts_of_a_lens() {
    let color = [0.3f32, 0.6, 1.0];
    let view = Projection::Perspective { fov_y_degrees: 30.0 };
    // Just outside of the cube, along whose side it looks.
    let plain = camera(DVec3::new(1.04, 0.1, 0.3), DVec3::new(1.2, 0.0, -4.0), view, [32, 32]);
    let lens = lens(0.4, 3.0, 0);
    let mut scene = seen_by(plain.clone().with_lens(lens.clone()).unwrap());
    scene.environment.constant = Vec3::ONE;
    scene.surfaces = Some(surfaces(&[(cube(1.0), straight(color))]));
    let found = rendered(&scene, &point_filter(256, 5));
    assert_expected("a lens half in glass", &found, 1.6e-4, |x, y| {
        let film = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let rays = disc_quadrature(80, 160).map(|p| through_lens(&plain, &lens, film, p));
        (rays.map(|ray| passed(color, ray)).sum::<DVec3>() / (80.0 * 160.0)).to_array()
    });
}

fn state(scene: &Scene, settings: &RenderSettings, threads: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    film(scene, settings, threads).write_state(&mut bytes, b"").unwrap();
    bytes
}

fn film(scene: &Scene, settings: &RenderSettings, threads: usize) -> Film {
    let mut film = Film::new(scene.camera.resolution(), None).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| Renderer::new(scene, settings).unwrap().render(&mut film, &Unmonitored))
        .unwrap();
    film
}

/// Threads, tiles and any split of the samples change no bit of a picture, whatever the camera.
#[test]
fn no_bit_depends_on_threads_tiles_or_splits() {
    let (at, target) = (DVec3::new(1.5, 0.8, 2.6), DVec3::ZERO);
    let view = Projection::Perspective { fov_y_degrees: 40.0 };
    let flat = Projection::Orthographic { height: 2.4 };
    let with_lens = |projection, blades| {
        let camera = camera(at, target, projection, [24, 16]);
        camera.with_lens(lens(0.3, 3.0, blades)).unwrap()
    };
    for camera in [
        with_lens(view, 0),
        with_lens(flat, 6),
        camera(at, target, flat, [24, 16]),
        camera(at, target, Projection::Panorama, [24, 16]),
    ] {
        let scene = still_life(camera);
        let whole = state(&scene, &settings(20, 3), 1);
        let tiled = RenderSettings { tile_size: 5, ..settings(20, 3) };
        assert!(state(&scene, &tiled, 7) == whole, "{:?}", scene.camera);
        let mut merged = Film::new(scene.camera.resolution(), None).unwrap();
        for range in [13..20, 0..1, 1..13] {
            let slice = RenderSettings { samples: range, ..settings(0, 3) };
            merged.merge(&film(&scene, &slice, 2)).unwrap();
        }
        let mut bytes = Vec::new();
        merged.write_state(&mut bytes, b"").unwrap();
        assert!(bytes == whole, "{:?}", scene.camera);
        assert!(state(&scene, &settings(20, 4), 1) != whole, "the seed has no effect");
    }
}

fn load(path: &Path, camera: CameraRequest, lens: Option<LensRequest>) -> Scene {
    let request = SceneRequest {
        gltf: Some((path.to_owned(), 683.0)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera,
        lens,
        lights: Vec::new(),
        environment: None,
        resolution: Some([40, 20]),
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    };
    Scene::load(request).expect("a scene").scene
}

/// An orthographic camera of a glTF file shows `2 ymag` of height, and the same picture as one that
/// is placed so, bit for bit; so it does with a lens.
#[test]
fn orthographic_cameras_of_gltf_are_those_of_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.gltf");
    let document = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"camera": 0, "translation": [0.25, 0.5, 4], "scale": [2, 2, 2]},
            {"extensions": {"PILEUS_volume": {"albedo": 0.9,
                "homogeneous": {"sigma_t": 2, "bounds": [[-1, -1, -1], [1, 0.5, 1]]}}}},
        ],
        "cameras": [{"type": "orthographic",
            "orthographic": {"xmag": 2.5, "ymag": 1.25, "znear": 0, "zfar": 9}}],
    });
    std::fs::write(&path, document.to_string()).unwrap();
    let auto = CameraRequest::Auto { fov_y_degrees: 35.0, orbit: None };
    let position = DVec3::new(0.25, 0.5, 4.0);
    let placed = CameraRequest::LookAt {
        position,
        target: DVec3::new(0.25, 0.5, 0.0),
        up: DVec3::Y,
        projection: Projection::Orthographic { height: 2.5 },
        place: Place::default(),
    };
    let focus =
        |focus| Some(LensRequest { aperture: 0.4, blades: 5, focus, place: Place::default() });
    let by_point = focus(Focus::Point(DVec3::new(3.0, 1.0, 1.5)));
    for (lens, same_lens) in [(None, None), (by_point, focus(Focus::Distance(2.5)))] {
        let of_file = state(&load(&path, auto.clone(), lens), &settings(9, 1), 2);
        let of_job = state(&load(&path, placed.clone(), same_lens), &settings(9, 1), 2);
        assert!(of_file == of_job);
    }
}

/// Nobody is told that a picture is empty where it is not, or the other way round, and volumes
/// inside opaque meshes are hidden from cameras that are surely outside alone.
#[test]
fn warnings_are_true_of_every_camera() {
    let smoke = || cube_homogeneous(0.5, [1.0; 3], [0.9; 3], Phase::Isotropic);
    let warnings = |camera: Camera, around: bool| {
        let mut scene = scene(vec![smoke()], DVec3::Z, DVec3::ZERO, 30.0);
        scene.camera = camera;
        scene.environment.constant = Vec3::ONE;
        if around {
            scene.surfaces = Some(surfaces(&[(cube(1.0), lambert([0.5; 3]))]));
        }
        Plan::new(&scene, &settings(1, 1)).expect("a plan").warnings.join("; ")
    };
    let away = |projection| camera(DVec3::Z * 4.0, DVec3::Z * 9.0, projection, [16, 16]);
    let view = Projection::Perspective { fov_y_degrees: 30.0 };
    let flat = |height| Projection::Orthographic { height };
    assert!(warnings(away(view), false).contains("turn it"));
    assert!(warnings(away(flat(2.0)), false).contains("turn it"));
    assert_eq!(warnings(away(Projection::Panorama), false), "");
    // Beside the view, and in it only by the width of the view or of the blur.
    let beside = |projection| {
        camera(DVec3::new(3.0, 0.0, 4.0), DVec3::new(3.0, 0.0, 0.0), projection, [16, 16])
    };
    assert!(warnings(beside(flat(4.0)), false).contains("turn it"));
    assert_eq!(warnings(beside(flat(6.0)), false), "");
    assert!(warnings(beside(view), false).contains("turn it"));
    let blurred = beside(view).with_lens(lens(2.0, 1.0, 0)).unwrap();
    assert_eq!(warnings(blurred, false), "");
    // A mesh around the smoke, and cameras outside of it, through it and inside.
    let at = |z: f64, projection| camera(DVec3::Z * z, DVec3::ZERO, projection, [16, 16]);
    assert!(warnings(at(4.0, view), true).contains("wholly inside"));
    assert!(warnings(at(4.0, flat(9.0)), true).contains("wholly inside"));
    assert_eq!(warnings(at(0.9, flat(9.0)), true), "");
    assert_eq!(warnings(at(0.9, view), true), "");
    assert_eq!(warnings(at(0.9, Projection::Panorama), true), "");
    let lens = |z: f64| at(z, view).with_lens(lens(0.5, 2.0, 0)).unwrap();
    assert_eq!(warnings(lens(0.9), true), "");
    assert!(warnings(lens(1.1), true).contains("wholly inside"));
}
