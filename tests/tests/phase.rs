//! Phase functions in whole pictures: energy, and laws that are the same by two ways.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DAffine3, DVec3, Vec3};
use pileus_integrator::RenderSettings;
use pileus_media::distance::DistanceSampler;
use pileus_media::phase::{CosineGrid, Draine, Lobe, MieFit, Mixture, Tabulated};
use pileus_media::{Albedo, Interpolation, Medium, Phase, VoxelGrid, VoxelGridOptions};
use pileus_scene::{EnvironmentImage, Light, Point};
use pileus_tests::*;
use pileus_vdb::Tree;
use std::sync::Arc;

const EYE: DVec3 = DVec3::new(3.0, 2.0, 4.0);

fn mie(diameter: f64) -> Phase {
    Phase::mixture(MieFit::new(diameter).unwrap().mixture().unwrap())
}

fn water() -> Phase {
    let text = std::fs::read_to_string(root().join("scenes/phase/water_10um.csv")).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let rows: Vec<(f64, f64)> = lines
        .map(|line| {
            let (angle, value) = line.split_once(',').unwrap();
            (angle.parse().unwrap(), value.parse().unwrap())
        })
        .collect();
    Phase::mixture(Mixture::of(Lobe::Tabulated(Tabulated::new(&rows).unwrap())))
}

fn laws() -> Vec<(&'static str, Phase)> {
    let one = |lobe| Phase::mixture(Mixture::of(lobe));
    vec![
        ("rayleigh", one(Lobe::Rayleigh)),
        ("draine", one(Lobe::Draine(Draine::new(-0.6, 30.0).unwrap()))),
        ("mie", mie(10.0)),
        ("table", water()),
    ]
}

fn two_lobes() -> Phase {
    let lobe = |g| Mixture::of(Lobe::henyey_greenstein(g));
    Phase::mixture(Mixture::new([(0.7, lobe(0.8)), (0.3, lobe(-0.4))]).unwrap())
}

/// A cube whose mean cosine goes from -0.8 to 0.8 along x, by a grid of half the resolution.
fn by_grid(sigma_t: f32) -> Medium {
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &[1.0; 16 * 16 * 16]);
    let half = DAffine3::from_scale(DVec3::splat(0.5));
    // Index i of a dense tree is x fastest or slowest; the same number along the diagonal either
    // way.
    let values: Vec<f32> = (0..512).map(|i| (i / 64) as f32).collect();
    let cosine = Tree::from_dense(0.0f32, [0; 3], [8; 3], &values);
    let cosine = CosineGrid::new(&cosine, 0.2, -0.8, half).unwrap();
    let options = VoxelGridOptions { interpolation: Interpolation::Nearest };
    let grid = Arc::new(VoxelGrid::from_tree(&tree, &options).unwrap());
    let to_world =
        DAffine3::from_scale(DVec3::splat(0.125)) * DAffine3::from_translation(DVec3::splat(-7.5));
    let (albedo, phase) = (Albedo::Constant([1.0; 3]), Phase::ByGrid(Arc::new(cosine)));
    Medium::from_grid(grid, to_world, [sigma_t; 3], albedo, phase).unwrap()
}

/// Albedo one inside uniform light: every sample is one, whatever the law.
#[test]
fn white_furnace_is_exact_in_constant_light() {
    let mut media: Vec<(&str, Medium)> = laws()
        .into_iter()
        .map(|(name, phase)| (name, cube_grid(1.0, [3.0; 3], [1.0; 3], phase)))
        .collect();
    media.push(("by grid", by_grid(3.0)));
    for (name, medium) in media {
        let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
        scene.environment.constant = Vec3::ONE;
        let result = rendered(&scene, &settings(4, 1));
        assert!(result.counters.bounces > 0);
        for c in ["R", "G", "B"] {
            let plane = result.image.channel(c).unwrap();
            assert!(plane.iter().all(|v| (v - 1.0).abs() < 1e-6), "{name}");
        }
    }
}

/// A half sky and its complement, lit by shadow rays and by paths under multiple importance
/// sampling. Null hypothesis: the mean of the pictures' sum is one; |z| below 5.8 in five cases,
/// false alarm 3e-8.
#[test]
fn white_furnace_of_two_half_skies() {
    let mut media: Vec<(&str, Medium)> = laws()
        .into_iter()
        .map(|(name, phase)| (name, lumpy_grid(1.0, [4.0; 3], [1.0; 3], phase)))
        .collect();
    media.push(("by grid", by_grid(4.0)));
    for (k, (name, medium)) in media.into_iter().enumerate() {
        let (mut total, mut variance, mut n) = (0.0f64, 0.0f64, 0.0f64);
        for half in [false, true] {
            let mut scene = scene(vec![medium.clone()], EYE, DVec3::ZERO, 40.0);
            let texels: Vec<[f32; 3]> = (0..64 * 32)
                .map(|i| if (i % 64 < 32) == half { [1.0; 3] } else { [0.0; 3] })
                .collect();
            let image = EnvironmentImage::new(64, 32, texels, 1.0, 0.0).unwrap();
            scene.environment.image = Some(Arc::new(image));
            let result = rendered(&scene, &settings(64, 31 + k as u64));
            assert!(result.counters.shadow_rays > 0);
            let (mean, var) = (result.image.channel("R"), result.variance.channel("R"));
            total += mean.unwrap().iter().map(|v| f64::from(*v)).sum::<f64>();
            variance += var.unwrap().iter().map(|v| f64::from(*v)).sum::<f64>();
            n = mean.unwrap().len() as f64;
        }
        let (mean, error) = (total / n, variance.sqrt() / n);
        let z = (mean - 1.0) / error;
        println!("{name}: mean {mean:.6}, error {error:.6}, z {z:.2}");
        assert!(z.abs() < 5.8 && error < 4e-3, "{name}: mean {mean}, error {error}, z {z}");
    }
}

/// A table of Henyey-Greenstein, a mixture that is Henyey-Greenstein, and Henyey-Greenstein.
#[test]
fn a_tabulated_henyey_greenstein_is_henyey_greenstein() {
    let g = 0.7f64;
    let rows: Vec<(f64, f64)> = (0..=1800)
        .map(|i| {
            let angle = f64::from(i) * 0.1;
            let c = angle.to_radians().cos();
            (angle, (1.0 - g * g) / (1.0 + g * g - 2.0 * g * c).powf(1.5))
        })
        .collect();
    let table = Mixture::of(Lobe::Tabulated(Tabulated::new(&rows).unwrap()));
    let same = Mixture::new([
        (0.5, Mixture::of(Lobe::henyey_greenstein(0.7))),
        (0.5, Mixture::of(Lobe::Draine(Draine::new(0.7, 0.0).unwrap()))),
    ]);
    let render = |phase: Phase, seed| {
        let medium = lumpy_grid(1.0, [4.0; 3], [0.99; 3], phase);
        let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
        scene.lights.push(sun(Vec3::new(-0.5, 0.8, -0.3), Vec3::splat(3.0), 5.0));
        scene.environment.constant = Vec3::splat(0.2);
        rendered(&scene, &settings(64, seed))
    };
    let exact = render(Phase::henyey_greenstein(0.7), 1);
    assert_same("table", &render(Phase::mixture(table), 2), &exact, 1.8e-3);
    assert_same("mixture", &render(Phase::mixture(same.unwrap()), 3), &exact, 1.8e-3);
}

/// Points at equal angles evaluate the same laws as flights.
#[test]
fn equiangular_points_see_the_same_law() {
    let position = DVec3::new(1.6, 0.3, -0.4);
    // The sharper the law, the fewer paths find its peak.
    for (k, (name, medium, spp, power)) in [
        ("two lobes", cube_homogeneous(1.0, [0.5; 3], [0.9; 3], two_lobes()), 512, 6e-3),
        ("mie", cube_homogeneous(1.0, [0.5; 3], [0.9; 3], mie(2.0)), 768, 0.0145),
        ("by grid", by_grid(0.5), 256, 4.4e-3),
    ]
    .into_iter()
    .enumerate()
    {
        let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
        scene.lights.push(Light::Point(Point { position, intensity: Vec3::ONE }));
        let render = |distance, seed| {
            let settings = RenderSettings { distance, ..settings(spp, seed) };
            rendered(&scene, &settings)
        };
        let flights = render(Some(DistanceSampler::Delta), 2 * k as u64);
        let points = render(Some(DistanceSampler::Equiangular), 2 * k as u64 + 1);
        assert_same(name, &flights, &points, power);
    }
}
