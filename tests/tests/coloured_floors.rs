//! Coloured floors in media whose extinction differs per channel, under every kind of light and
//! every pair of methods, against quadratures.
//!
//! Furnaces cannot see a wrong weight that colours share: theirs are grey, or their surfaces white,
//! so that the throughput on both sides of a vertex is the same up to a factor. Here it is not: a
//! floor that reflects one channel alone under air that absorbs another one shows every decision
//! that is weighed by the wrong side's throughput.
//!
//! Null hypothesis of each row: the mean of every channel is the integral of BSDF, radiance and
//! exact transmittance. |z| < 6.2, two-sided 5.6e-10 a channel: 2e-7 for the 354 channels of the
//! suite, 1.6e-5 for the 28,080 of the whole product. Each row's standard error is below 0.115 % of
//! the mean, by a number of samples that a render of another seed has chosen: a bias of 1 % is seen
//! with probability .99.
//!
//! The suite runs a covering array: every pair of values of two axes occurs. `PILEUS_SLOW_TESTS=1`
//! runs the whole product.

use glam::{DAffine3, DVec3, Vec3};
use pileus_film::Film;
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::distance::DistanceSampler;
use pileus_media::method::name_or_auto;
use pileus_media::transmittance::Estimator;
use pileus_media::{Interpolation, Medium, Phase};
use pileus_scene::{Bsdf, Camera, EnvironmentImage, Light, Point, Scene, Spot};
use pileus_tests::*;
use pileus_vdb::Tree;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::sync::Arc;

const HALF: f64 = 2.0;
/// Height of the floor inside the cube of media.
const FLOOR: f64 = -1.0;
/// The camera is this far above it.
const ABOVE: f64 = 0.05;
const LARGEST_Z: f64 = 6.2;
/// Largest relative standard error of a channel.
const POWER: f64 = 0.00115;
/// Of the quadratures.
const TOLERANCE: f64 = 3e-4;

fn metal(color: [f32; 3]) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [color[0], color[1], color[2], 1.0],
        "metallicFactor": 1.0, "roughnessFactor": 0.6}})
}

fn floors() -> Vec<(&'static str, Value)> {
    vec![
        ("red", lambert([1.0, 0.05, 0.05])),
        ("blue", lambert([0.02, 0.3, 0.9])),
        ("metal", metal([0.1, 1.0, 0.3])),
    ]
}

const ABSORBS: [f32; 3] = [0.0; 3];

/// Some 0.5 of optical depth above the floor in the strongest channel.
fn media() -> Vec<(&'static str, Vec<Medium>)> {
    let phase = Phase::Isotropic;
    let homogeneous = |sigma_t: [f32; 3]| cube_homogeneous(HALF, sigma_t, ABSORBS, phase.clone());
    let grid = |sigma_t: [f32; 3]| cube_grid(HALF, sigma_t, ABSORBS, phase.clone());
    let lumpy = |sigma_t: [f32; 3]| lumpy_grid(HALF, sigma_t, ABSORBS, phase.clone());
    // A slab of voxels across the upper half: begins and ends within the others.
    let tree = Tree::from_dense(0.0f32, [0; 3], [16, 4, 16], &[1.0; 16 * 4 * 16]);
    let slab = DAffine3::from_scale(DVec3::splat(HALF / 8.0))
        * DAffine3::from_translation(DVec3::new(-7.5, 0.5, -7.5));
    let slab =
        |sigma_t| grid_medium(&tree, Interpolation::Nearest, slab, sigma_t, ABSORBS, phase.clone());
    vec![
        ("homogeneous", vec![homogeneous([0.17, 0.034, 0.008])]),
        ("clear in a channel", vec![homogeneous([0.0, 0.15, 0.03])]),
        ("lumpy grid", vec![lumpy([0.03, 0.1, 0.2])]),
        ("grey and coloured", vec![homogeneous([0.06; 3]), grid([0.01, 0.1, 0.03])]),
        (
            "three overlap",
            vec![
                lumpy([0.08, 0.01, 0.04]),
                slab([0.02, 0.12, 0.01]),
                homogeneous([0.01, 0.01, 0.06]),
            ],
        ),
    ]
}

const LIGHTS: [&str; 8] =
    ["sun", "sun's disc", "point", "spot", "constant", "image", "mesh", "emissive volume"];

fn image() -> EnvironmentImage {
    // Two rows of the upper half; the columns differ.
    let rows = [[4.0f32, 1.0, 0.2, 2.0], [0.5, 3.0, 1.0, 0.1], [0.0; 4], [0.0; 4]];
    let texels = rows.iter().flatten().map(|v| [*v, 0.8 * v, 0.5 * v]).collect();
    EnvironmentImage::new(4, 4, texels, 1.0, 0.0).expect("an image")
}

const AREA_LIGHT: [f32; 3] = [2.0, 1.5, 1.0];
const GLOW: [f32; 3] = [1.0, 0.7, 0.4];
const INTENSITY: Vec3 = Vec3::new(2.0, 1.0, 0.5);
const COSINES: (f32, f32) = (0.95, 0.8);
fn to_sun() -> Vec3 {
    Vec3::new(0.4, 1.0, -0.3).normalize()
}
fn position() -> DVec3 {
    DVec3::new(0.4, 0.6, -0.3)
}
fn axis() -> DVec3 {
    DVec3::new(-0.3, -1.0, 0.2).normalize()
}
/// Corner and edges of the mesh light, which faces the floor.
const SQUARE: [[f32; 3]; 3] = [[-0.5, 0.6, -0.4], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];

struct Case {
    scene: Scene,
    expected: [f64; 3],
}

/// The scene of a floor, a list of media and a light, and what its camera sees of light that the
/// floor has scattered once.
fn case((_, floor): &(&str, Value), (_, media): (&str, Vec<Medium>), light: usize) -> Case {
    let mut media = media;
    let wide = 40.0f32;
    let plane = quad([-wide, FLOOR as f32, -wide], [0.0, 0.0, 2.0 * wide], [2.0 * wide, 0.0, 0.0]);
    let mut meshes = vec![(plane, floor.clone())];
    if LIGHTS[light] == "mesh" {
        meshes.push((quad(SQUARE[0], SQUARE[1], SQUARE[2]), area_light([0.0; 3], AREA_LIGHT)));
    }
    let glow = (LIGHTS[light] == "emissive volume")
        .then(|| glowing_cube(0.4, [0.02, 0.01, 0.05], ABSORBS, GLOW));
    let mut made = scene(std::mem::take(&mut media), DVec3::Z, DVec3::ZERO, 20.0);
    made.surfaces = Some(surfaces(&meshes));
    let eye = DVec3::new(0.01, FLOOR + ABOVE, 0.0);
    made.camera = Camera::look_at(eye, DVec3::new(0.0, FLOOR, 0.0), DVec3::Z, 0.05, [4, 4])
        .expect("a camera");
    made.volumes.extend(glow);
    match LIGHTS[light] {
        "sun" => made.lights.push(sun(to_sun(), INTENSITY, 0.0)),
        "sun's disc" => made.lights.push(sun(to_sun(), INTENSITY, 0.4)),
        "point" => {
            made.lights.push(Light::Point(Point { position: position(), intensity: INTENSITY }))
        }
        "spot" => made.lights.push(Light::Spot(Spot {
            position: position(),
            direction: axis().as_vec3(),
            intensity: INTENSITY,
            cos_inner: COSINES.0,
            cos_outer: COSINES.1,
        })),
        "constant" => made.environment.constant = Vec3::new(1.0, 0.8, 0.6),
        "image" => made.environment.image = Some(Arc::new(image())),
        _ => {}
    }
    let expected = expected(&made, light);
    Case { scene: made, expected }
}

fn expected(scene: &Scene, light: usize) -> [f64; 3] {
    let surfaces = scene.surfaces.as_ref().expect("a floor");
    let (o, d) = scene.camera.ray([2.0, 2.0]);
    let mut rng = Pcg32::new(1, 1);
    let hit = surfaces.intersect(o, d, 1e9, &mut rng).expect("the floor");
    let interaction = surfaces.interaction(&hit, d);
    let bsdf = Bsdf::new(
        &interaction.parameters,
        interaction.shading_normal,
        interaction.geometric_normal,
        true,
    );
    let p = o + d.as_dvec3() * hit.t;
    // BSDF times cosine times transmittance from a direction.
    let towards = |wi: DVec3, t_max: f64| {
        let value = bsdf.eval_pdf(-d, wi.as_vec3()).0.as_dvec3();
        if value == DVec3::ZERO { value } else { value * transmittance(scene, p, wi, t_max) }
    };
    let endless = f64::INFINITY;
    let intensity = INTENSITY.as_dvec3();
    // Midpoints of the hemisphere by projected solid angle; `f` is per cosine.
    let hemisphere = |f: &dyn Fn(DVec3) -> DVec3, (rings, sectors): (usize, usize)| {
        let mut sum = DVec3::ZERO;
        for i in 0..rings {
            for j in 0..sectors {
                let r2 = (i as f64 + 0.5) / rings as f64;
                let phi = 2.0 * PI * (j as f64 + 0.5) / sectors as f64;
                let (r, y) = (r2.sqrt(), (1.0 - r2).sqrt());
                let wi = DVec3::new(r * phi.cos(), y, r * phi.sin());
                sum += f(wi) / y;
            }
        }
        sum * (PI / (rings * sectors) as f64)
    };
    let radiance = match LIGHTS[light] {
        "sun" => towards(to_sun().as_dvec3(), endless) * intensity,
        "sun's disc" => {
            // Equal steps of the cosine and around the axis: equal solid angles; the irradiance is
            // what a plane across its axis gets.
            let w = to_sun().as_dvec3();
            let (u, v) = w.any_orthonormal_pair();
            let edge = 0.2f64.cos();
            let (rings, sectors) = (40, 80);
            let (mut sum, mut plane) = (DVec3::ZERO, 0.0);
            for i in 0..rings {
                for j in 0..sectors {
                    let z = 1.0 - (1.0 - edge) * (i as f64 + 0.5) / f64::from(rings);
                    let phi = 2.0 * PI * (f64::from(j) + 0.5) / f64::from(sectors);
                    let r = (1.0 - z * z).sqrt();
                    let wi = u * (r * phi.cos()) + v * (r * phi.sin()) + w * z;
                    sum += towards(wi, endless);
                    plane += z;
                }
            }
            sum * intensity / plane
        }
        "point" | "spot" => {
            let to = position() - p;
            let (distance, wi) = (to.length(), to.normalize());
            let ramp = if LIGHTS[light] == "spot" {
                let (inner, outer) = (f64::from(COSINES.0), f64::from(COSINES.1));
                ((-wi.dot(axis()) - outer) / (inner - outer)).clamp(0.0, 1.0)
            } else {
                1.0
            };
            towards(wi, distance) * intensity * (ramp * ramp / (distance * distance))
        }
        "constant" => {
            hemisphere(&|wi| towards(wi, endless), (96, 192))
                * scene.environment.constant.as_dvec3()
        }
        "image" => hemisphere(
            &|wi| towards(wi, endless) * scene.environment.radiance(wi.as_vec3()).as_dvec3(),
            (256, 512),
        ),
        "mesh" => {
            let [corner, a, b] = SQUARE.map(|v| Vec3::from_array(v).as_dvec3());
            let normal = a.cross(b).normalize();
            let (n, mut sum) = (48, DVec3::ZERO);
            for i in 0..n {
                for j in 0..n {
                    let at = |k: usize| (k as f64 + 0.5) / n as f64;
                    let to = corner + a * at(i) + b * at(j) - p;
                    let (distance, wi) = (to.length(), to.normalize());
                    let facing = (-wi.dot(normal)).max(0.0);
                    sum += towards(wi, distance) * (facing / (distance * distance));
                }
            }
            sum * (a.cross(b).length() / (n * n) as f64) * Vec3::from_array(AREA_LIGHT).as_dvec3()
        }
        _ => {
            // Points of the cube, each the emission of its volume element.
            let (n, mut sum) = (20, DVec3::ZERO);
            for i in 0..n * n * n {
                let at = |k: usize| 0.8 * ((k % n) as f64 + 0.5) / n as f64 - 0.4;
                let to = DVec3::new(at(i), at(i / n), at(i / (n * n))) - p;
                let (distance, wi) = (to.length(), to.normalize());
                sum += towards(wi, distance) / (distance * distance);
            }
            sum * (0.8 / n as f64).powi(3) * Vec3::from_array(GLOW).as_dvec3()
        }
    };
    (radiance * transmittance(scene, o, d.as_dvec3(), hit.t)).to_array()
}

fn distances() -> Vec<Option<DistanceSampler>> {
    let by = [
        DistanceSampler::Delta,
        DistanceSampler::Spectral,
        DistanceSampler::WeightedDelta,
        DistanceSampler::Decomposition,
        DistanceSampler::Regular,
    ];
    std::iter::once(None).chain(by.map(Some)).collect()
}

fn transmittances() -> Vec<Option<Estimator>> {
    let by = Estimator::ALL.into_iter().filter(|e| e.is_unbiased()).map(Some);
    std::iter::once(None).chain(by).collect()
}

/// Mean and standard error of each channel.
fn measure(scene: &Scene, settings: &RenderSettings) -> [[f64; 2]; 3] {
    let mut film = Film::new(scene.camera.resolution(), None).expect("a film");
    let counters = Renderer::new(scene, settings)
        .expect("a plan")
        .render(&mut film, &Unmonitored)
        .expect("a render");
    assert_eq!((counters.violations, counters.dropped), (0, 0), "{counters:?}");
    let (image, variance) = (film.image(), film.variance());
    ["R", "G", "B"].map(|c| {
        let sum = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
        let n = 16.0;
        [sum(image.channel(c).unwrap()) / n, sum(variance.channel(c).unwrap()).sqrt() / n]
    })
}

type Row = [usize; 5];

/// One row; `None` if it holds, else what was found. The number of samples for the wanted standard
/// error is chosen by a render of another seed.
fn check(row: Row, number: u64) -> Option<String> {
    let [floor, medium, light, distance, transmittance] = row;
    let (floors, mut media) = (floors(), media());
    let medium = media.swap_remove(medium);
    let name = format!(
        "{} floor, {}, {}, {} + {}",
        floors[floor].0,
        medium.0,
        LIGHTS[light],
        name_or_auto(distances()[distance]),
        name_or_auto(transmittances()[transmittance])
    );
    let Case { scene, expected } = case(&floors[floor], medium, light);
    let settings = |spp: u64, seed: u64| RenderSettings {
        distance: distances()[distance],
        transmittance: transmittances()[transmittance],
        max_bounces: Some(1),
        samples: 0..spp,
        ..point_filter(spp, seed)
    };
    let relative = |found: &[[f64; 2]; 3]| {
        found.iter().zip(expected).map(|(f, e)| f[1] / e).fold(0.0, f64::max)
    };
    let pilot = 2048u64;
    let first = measure(&scene, &settings(pilot, 2 * number + 1));
    let wanted = relative(&first) / (0.75 * POWER);
    let mut spp = (pilot as f64 * wanted * wanted).ceil().clamp(256.0, 2e6) as u64;
    let mut found = measure(&scene, &settings(spp, 2 * number + 2));
    // Rare events may have been missed by the first render: more samples, all of them new.
    for attempt in 1..4 {
        if relative(&found) <= POWER {
            break;
        }
        spp *= 2;
        found = measure(&scene, &settings(spp, 2 * number + 2 + (attempt << 32)));
    }
    let mut worst = 0.0f64;
    for ([mean, error], expected) in found.iter().zip(expected) {
        let off = ((mean - expected).abs() - TOLERANCE * expected).max(0.0);
        worst = worst.max(off / error.max(1e-7 * expected));
    }
    let weak = relative(&found) > POWER;
    (worst > LARGEST_Z || weak).then(|| {
        format!("{name}: z {worst:.1}, {spp} samples a pixel, {found:.5?}, expected {expected:.5?}")
    })
}

/// Rows in which each pair of values of two axes occurs at least once, greedily.
fn covering(sizes: Row) -> Vec<Row> {
    let mut open: Vec<(usize, usize, usize, usize)> = Vec::new();
    for a in 0..5 {
        for b in a + 1..5 {
            for i in 0..sizes[a] {
                open.extend((0..sizes[b]).map(|j| (a, i, b, j)));
            }
        }
    }
    let mut rows = Vec::new();
    while let Some(&(a, i, b, j)) = open.first() {
        let mut row = [usize::MAX; 5];
        (row[a], row[b]) = (i, j);
        for axis in 0..5 {
            if row[axis] != usize::MAX {
                continue;
            }
            // The value that closes most pairs with those chosen.
            let gain = |value: usize| {
                let with = |other: usize| {
                    let pair = if axis < other {
                        (axis, value, other, row[other])
                    } else {
                        (other, row[other], axis, value)
                    };
                    usize::from(open.contains(&pair))
                };
                (0..5).filter(|o| row[*o] != usize::MAX).map(with).sum::<usize>()
            };
            // Ties go round, so that no value is overused.
            let turn = rows.len();
            row[axis] = (0..sizes[axis])
                .map(|v| (v + turn) % sizes[axis])
                .max_by_key(|v| gain(*v))
                .expect("a value");
        }
        open.retain(|&(a, i, b, j)| row[a] != i || row[b] != j);
        rows.push(row);
    }
    rows
}

fn run(rows: &[Row]) {
    // Side by side: pictures of 4 x 4 pixels are one tile, which one thread renders.
    let failed: Vec<String> =
        rows.par_iter().enumerate().filter_map(|(i, row)| check(*row, i as u64)).collect();
    assert!(failed.is_empty(), "{} of {}:\n{}", failed.len(), rows.len(), failed.join("\n"));
}

fn sizes() -> Row {
    [floors().len(), media().len(), LIGHTS.len(), distances().len(), transmittances().len()]
}

/// Rows in which weights count the way: lights that shadow rays and paths both meet, under methods
/// that share a density. These are few among all pairs.
fn weighted() -> Vec<Row> {
    let axis = |name: &str| LIGHTS.iter().position(|light| *light == name).expect("a light");
    let distance = |s| distances().iter().position(|d| *d == Some(s)).expect("a sampler");
    let estimator = |e| transmittances().iter().position(|t| *t == Some(e)).expect("an estimator");
    let ratio = estimator(Estimator::Ratio);
    let methods = [
        [0, 0],
        [distance(DistanceSampler::Delta), ratio],
        [distance(DistanceSampler::Decomposition), ratio],
        [distance(DistanceSampler::Regular), estimator(Estimator::Regular)],
    ];
    let mut rows = Vec::new();
    for (m, [distance, transmittance]) in methods.into_iter().enumerate() {
        for (l, light) in ["sun's disc", "image", "mesh"].map(axis).into_iter().enumerate() {
            rows.push([(m + l) % 3, (m + 2 * l) % 5, light, distance, transmittance]);
        }
    }
    rows
}

/// Every pair of two axes, and what weights count.
#[test]
fn every_pair_agrees_with_quadrature() {
    let mut rows = covering(sizes());
    rows.extend(weighted());
    run(&rows);
}

/// The whole product, some 10,000 rows.
#[test]
fn every_combination_agrees_with_quadrature() {
    if std::env::var_os("PILEUS_SLOW_TESTS").is_none() {
        return;
    }
    let sizes = sizes();
    let rows: Vec<Row> = (0..sizes.iter().product())
        .map(|mut number: usize| {
            sizes.map(|size| {
                let value = number % size;
                number /= size;
                value
            })
        })
        .collect();
    run(&rows);
}
