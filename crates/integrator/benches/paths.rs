//! Whole paths per second on three assets under sun and sky, and on a field of two hundred clouds
//! made of one grid. Run with `cargo bench -p pileus-integrator`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DAffine3, DVec3, Vec3};
use pileus_film::Film;
use pileus_integrator::{RenderSettings, Renderer, Unmonitored};
use pileus_media::Bounds3;
use pileus_media::{Albedo, Medium, Phase, VoxelGrid, VoxelGridOptions};
use pileus_scene::{Camera, Environment, Light, Scene, Sun, Volume, VolumeSource};
use pileus_vdb::VdbFile;
use std::sync::Arc;

fn scene(name: &str, scale: f32, albedo: [f32; 3], g: f32) -> Scene {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/assets/");
    let file = VdbFile::open(format!("{path}{name}")).expect("an asset");
    let grid = file.read(file.find("density").expect("density")).expect("a grid");
    let matrix = grid.info.transform.index_to_world().expect("a linear transform");
    let tree = grid.to_float().expect("a scalar grid");
    let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid");
    let medium = Medium::from_grid(
        Arc::new(grid),
        pileus_scene::volume::affine(matrix),
        [scale; 3],
        Albedo::Constant(albedo),
        Phase::henyey_greenstein(g),
    );
    let medium = medium.expect("a medium");
    let Bounds3 { low, high } = medium.bounds_world().expect("bounds");
    let (middle, size) = (0.5 * (low + high), (high - low).max_element());
    let eye = middle + DVec3::new(1.3, 0.4, 0.8) * size;
    Scene {
        camera: Camera::look_at(eye, middle, DVec3::Y, 35.0, [64, 64]).expect("a camera"),
        volumes: vec![Volume {
            name: name.to_owned(),
            medium: Arc::new(medium),
            emission: None,
            source: VolumeSource::Homogeneous,
        }],
        lights: vec![Light::Sun(Sun {
            to_light: Vec3::new(0.5, 0.8, -0.3).normalize(),
            irradiance: Vec3::splat(3.0),
            angular_diameter: 0.0,
        })],
        environment: Environment { constant: Vec3::new(0.3, 0.4, 0.6), image: None },
        surfaces: None,
        not_modelled: Vec::new(),
    }
}

fn benches(c: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let mut group = c.benchmark_group("paths_one_thread");
    group.sample_size(10);
    for (name, scale, albedo, g) in [
        ("cumulus.vdb", 0.4, [0.999; 3], 0.8),
        ("cumulus_small.vdb", 0.4, [0.999; 3], 0.8),
        ("arnold_smoke.vdb", 1.19, [0.6, 0.5, 0.4], 0.0),
    ] {
        let scene = scene(name, scale, albedo, g);
        let settings = RenderSettings { samples: 0..4, ..RenderSettings::default() };
        group.throughput(Throughput::Elements(64 * 64 * 4));
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut film = Film::new([64, 64], None).expect("a film");
                pool.install(|| {
                    Renderer::new(&scene, &settings)
                        .expect("a plan")
                        .render(&mut film, &Unmonitored)
                })
                .expect("a render")
            });
        });
    }
    // The same cloud alone, as the first of two media (the second far off), and among two hundred:
    // what a list and its index cost.
    for (name, count) in [("one_cloud", 1), ("two_clouds", 2), ("two_hundred_clouds", 200)] {
        let scene = field(count);
        let settings = RenderSettings { samples: 0..4, ..RenderSettings::default() };
        group.bench_function(name, |b| {
            b.iter(|| {
                let mut film = Film::new([64, 64], None).expect("a film");
                pool.install(|| {
                    Renderer::new(&scene, &settings)
                        .expect("a plan")
                        .render(&mut film, &Unmonitored)
                })
                .expect("a render")
            });
        });
    }
    group.finish();
}

/// Instances of one cloud on a lattice three clouds wide, around the first, which fills the
/// picture.
fn field(count: usize) -> Scene {
    let mut scene = scene("cumulus_small.vdb", 0.4, [0.999; 3], 0.8);
    let medium = Arc::clone(&scene.volumes[0].medium);
    let first = medium.grid().expect("a grid");
    let Bounds3 { low, high } = medium.bounds_world().expect("bounds");
    let step = 3.0 * (high - low).max_element();
    for i in 1..count {
        let at = DVec3::new((i % 15) as f64 - 7.0, 0.0, (i / 15) as f64 - 7.0) * step;
        let at = if at == DVec3::ZERO { DVec3::new(8.0, 0.0, 0.0) * step } else { at };
        let placed = Medium::from_grid(
            Arc::clone(first.voxels()),
            DAffine3::from_translation(at) * first.index_to_world(),
            [first.sigma_t_scale(); 3],
            medium.optics().albedo().clone(),
            medium.phase().clone(),
        );
        scene.volumes.push(Volume {
            name: format!("cloud {i}"),
            medium: Arc::new(placed.expect("a medium")),
            source: VolumeSource::Homogeneous,
            emission: None,
        });
    }
    scene
}

criterion_group!(paths, benches);
criterion_main!(paths);
