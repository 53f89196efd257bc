//! Nanoseconds per shadow ray of every estimator, and per flight of every sampler. Run with
//! `cargo bench -p pileus-media --bench transmittance`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::distance::DistanceSampler;
use pileus_media::kernel::{GridShape, Voxel, VoxelKernel};
use pileus_media::random::uniform;
use pileus_media::transmittance::Estimator;
use pileus_media::{
    Albedo, Grey, Medium, Phase, PhaseAt, Span, Tally, VoxelGrid, VoxelGridOptions,
};
use pileus_vdb::VdbFile;
use rand_pcg::Pcg32;
use std::hint::black_box;
use std::sync::Arc;

fn medium(name: &str, scale: f32) -> Medium {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/assets/");
    let file = VdbFile::open(format!("{path}{name}")).expect("an asset");
    let grid = file.read(file.find("density").expect("density")).expect("a grid");
    let m = grid.info.transform.index_to_world().expect("a linear transform");
    let row = |i: usize| DVec3::new(m[i][0], m[i][1], m[i][2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2));
    let tree = grid.to_float().expect("a scalar grid");
    let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid");
    let to_world = DAffine3::from_mat3_translation(matrix, row(3));
    let albedo = Albedo::Constant([1.0; 3]);
    Medium::from_grid(Arc::new(grid), to_world, [scale; 3], albedo, Phase::Isotropic)
        .expect("a medium")
}

/// Rays from dense points in random directions.
fn spans(medium: &Medium, n: usize) -> Vec<Span> {
    let Bounds3 { low, high } = medium.bounds_world().expect("bounds");
    let mut rng = Pcg32::new(1, 1);
    let mut spans = Vec::new();
    while spans.len() < n {
        let u = DVec3::new(
            uniform(&mut rng).into(),
            uniform(&mut rng).into(),
            uniform(&mut rng).into(),
        );
        let p = low + (high - low) * u;
        let d = PhaseAt::Isotropic.sample(Vec3::Z, [uniform(&mut rng), uniform(&mut rng)]).0;
        if medium.sigma_t_at(p) > 0.0 {
            spans.extend(medium.span(p, d, f64::INFINITY));
        }
    }
    spans
}

struct Rays<'a> {
    grid: &'a GridShape,
    spans: &'a [Span],
    criterion: &'a mut Criterion,
    name: &'a str,
}

impl VoxelKernel for Rays<'_> {
    type Output = ();
    fn run<V: Voxel>(self, voxels: &[V]) {
        let Rays { grid, spans, criterion, name } = self;
        let mut group = criterion.benchmark_group(format!("transmittance/{name}"));
        group.sample_size(20).throughput(Throughput::Elements(spans.len() as u64));
        for estimator in Estimator::ALL {
            group.bench_function(estimator.name(), |b| {
                b.iter(|| {
                    let (mut rng, mut tally) = (Pcg32::new(2, 2), Tally::default());
                    let mut sum = 0.0;
                    for span in spans {
                        let field = grid.ray(voxels, span, 1.0);
                        sum += estimator.estimate(field, Grey, 0.3, &mut rng, &mut tally);
                    }
                    black_box(sum)
                });
            });
        }
        group.finish();
        let mut group = criterion.benchmark_group(format!("distance/{name}"));
        group.sample_size(20).throughput(Throughput::Elements(spans.len() as u64));
        for sampler in DistanceSampler::ALL {
            // The closed form of constant extinction, and what is made of several flights.
            if sampler == DistanceSampler::Analytic || !sampler.is_one_flight() {
                continue;
            }
            group.bench_function(sampler.name(), |b| {
                b.iter(|| {
                    let (mut rng, mut tally) = (Pcg32::new(2, 2), Tally::default());
                    let mut sum = 0.0;
                    for span in spans {
                        let field = grid.ray(voxels, span, 1.0);
                        sum += sampler.fly(field, Grey, 1.0, None, &mut rng, &mut tally).weight;
                    }
                    black_box(sum)
                });
            });
        }
        group.finish();
    }
}

fn benches(criterion: &mut Criterion) {
    for (name, scale) in [("cumulus_small.vdb", 0.4), ("arnold_smoke.vdb", 2.0)] {
        let medium = medium(name, scale);
        let spans = spans(&medium, 4096);
        let grid = medium.default_grid().expect("a grid");
        grid.with_voxels(Rays { grid, spans: &spans, criterion, name });
    }
}

criterion_group!(transmittance, benches);
criterion_main!(transmittance);
