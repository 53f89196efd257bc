//! Majorant structures: time to build and time per step along random rays through three assets.
//! Steps per ray are printed. Run with `cargo bench -p pileus-media --bench majorants`.
#![allow(clippy::print_stdout, reason = "steps per ray are worth reading beside times")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::majorant::MajorantStructure;
use pileus_media::random::uniform;
use pileus_media::{Albedo, Medium, Phase, RayField, VoxelGrid, VoxelGridOptions};
use pileus_vdb::VdbFile;
use rand_pcg::Pcg32;
use std::hint::black_box;
use std::sync::Arc;

fn medium(name: &str, scale: f32) -> Medium {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/assets/");
    let file = VdbFile::open(format!("{path}{name}")).expect("an asset");
    let grid = file.read(file.find("density").expect("density")).expect("a grid");
    let tree = grid.to_float().expect("a scalar grid");
    let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid");
    Medium::from_grid(
        Arc::new(grid),
        glam::DAffine3::IDENTITY,
        [scale; 3],
        Albedo::Constant([1.0; 3]),
        Phase::Isotropic,
    )
    .expect("a medium")
}

/// Rays from random points of the box in random directions.
fn rays(medium: &Medium) -> Vec<(DVec3, Vec3)> {
    let Bounds3 { low, high } = medium.bounds_world().expect("bounds");
    let mut rng = Pcg32::new(3, 3);
    (0..4096)
        .map(|_| {
            let mut u = || f64::from(uniform(&mut rng));
            let from = low + (high - low) * DVec3::new(u(), u(), u());
            let to = low + (high - low) * DVec3::new(u(), u(), u());
            (from, (to - from).normalize().as_vec3())
        })
        .collect()
}

fn benches(c: &mut Criterion) {
    for (name, scale) in
        [("cumulus.vdb", 0.4), ("cumulus_small.vdb", 1.6), ("arnold_smoke.vdb", 0.567)]
    {
        let medium = medium(name, scale);
        let rays = rays(&medium);
        let mut group = c.benchmark_group(format!("majorants/{name}"));
        group.sample_size(10);
        for structure in [
            MajorantStructure::Adaptive,
            MajorantStructure::Hierarchy,
            MajorantStructure::KdTree,
            MajorantStructure::Uniform(8),
            MajorantStructure::Uniform(32),
            MajorantStructure::Global,
        ] {
            group.throughput(Throughput::Elements(1));
            group.bench_function(format!("build/{}", structure.name()), |b| {
                b.iter(|| medium.with_majorants(structure, 1.0).expect("a structure"));
            });
            let medium = medium.with_majorants(structure, 1.0).expect("a structure");
            let walk = || {
                let mut steps = 0;
                for (p, d) in &rays {
                    if let Some(span) = medium.span(*p, *d, 1e9) {
                        let mut ray = medium.any_ray(&span, 1.0);
                        while let Some(segment) = ray.next_segment() {
                            black_box(segment);
                        }
                        steps += ray.steps();
                    }
                }
                steps
            };
            let steps = walk();
            let per_ray = steps as f64 / rays.len() as f64;
            println!("{name}, {}: {per_ray:.1} steps per ray", structure.name());
            group.throughput(Throughput::Elements(steps));
            group.bench_function(format!("step/{}", structure.name()), |b| b.iter(walk));
        }
        group.finish();
    }
}

criterion_group!(majorants, benches);
criterion_main!(majorants);
