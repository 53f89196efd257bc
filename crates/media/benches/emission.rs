//! Nanoseconds per emission point and per direction. Run with
//! `cargo bench -p pileus-media --bench emission`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::emission::{
    BlackbodyRadiance, EmissionDirections, EmissionField, EmissionSource,
};
use pileus_media::random::uniform;
use pileus_media::{Albedo, Phase, Tally, VoxelGrid, VoxelGridOptions};
use pileus_vdb::VdbFile;
use rand_pcg::Pcg32;
use std::hint::black_box;
use std::sync::Arc;

fn fire(name: &str) -> (Arc<VoxelGrid>, DAffine3) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/assets/fire_0003.vdb");
    let file = VdbFile::open(path).expect("an asset");
    let grid = file.read(file.find(name).expect("a grid")).expect("a grid");
    let m = grid.info.transform.index_to_world().expect("a linear transform");
    let row = |i: usize| DVec3::new(m[i][0], m[i][1], m[i][2]);
    let to_world =
        DAffine3::from_mat3_translation(DMat3::from_cols(row(0), row(1), row(2)), row(3));
    let tree = grid.to_float().expect("a scalar grid");
    let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid");
    (Arc::new(grid), to_world)
}

fn flames() -> (EmissionSource, DAffine3) {
    let (grid, to_world) = fire("flame");
    (EmissionSource::Grid { grid, color: [20.0, 7.0, 1.6] }, to_world)
}

fn soot() -> (EmissionSource, DAffine3) {
    let (density, to_world) = fire("density");
    let source = EmissionSource::Blackbody {
        density,
        sigma_t: [4.0; 3],
        albedo: Albedo::Constant([0.5; 3]),
        temperature: fire("temperature").0,
        to_temperature: DAffine3::IDENTITY,
        kelvin_per_unit: 1000.0,
        kelvin_offset: 0.0,
        radiance: BlackbodyRadiance::Absolute,
        intensity: 1.0,
        phase: Phase::Isotropic,
    };
    (source, to_world)
}

fn point_in(bounds: Bounds3, rng: &mut Pcg32) -> DVec3 {
    bounds.at(DVec3::from_array([(); 3].map(|()| f64::from(uniform(rng)))))
}

fn benches(c: &mut Criterion) {
    for (name, (source, to_world)) in [("flames", flames()), ("soot", soot())] {
        let field = EmissionField::new(source.clone(), to_world).expect("a field");
        let bounds = field.bounds_world().expect("a fire");
        let mut rng = Pcg32::new(1, 1);
        let rays: Vec<(DVec3, Vec3)> = (0..4096)
            .map(|_| {
                let (a, b) = (point_in(bounds, &mut rng), point_in(bounds, &mut rng));
                let d = (b - a).normalize();
                (a - 3.0 * d, d.as_vec3())
            })
            .collect();
        let walk = || {
            let mut tally = Tally::default();
            for (i, (origin, d)) in rays.iter().enumerate() {
                let u = (i as f32 + 0.5) / 4096.0;
                field.points(*origin, *d, 1e9, u, &mut tally, |point| {
                    black_box(point);
                });
            }
            tally.lookups
        };
        let mut group = c.benchmark_group(format!("emission/{name}"));
        group.throughput(Throughput::Elements(walk()));
        group.bench_function("point", |b| b.iter(walk));
        let n = 4096;
        group.throughput(Throughput::Elements(n));
        let directions = EmissionDirections::new(&field, |_| 1.0).expect("a fire");
        let eye = bounds.at(DVec3::new(1.5, 2.0, 0.7));
        group.bench_function("view", |b| {
            b.iter(|| {
                for _ in 0..n {
                    black_box(directions.view(black_box(eye)));
                }
            });
        });
        let view = directions.view(eye);
        let u: Vec<[f32; 4]> = (0..n).map(|_| [(); 4].map(|()| uniform(&mut rng))).collect();
        group.bench_function("sample", |b| {
            b.iter(|| {
                for u in &u {
                    black_box(directions.sample(&view, *u));
                }
            });
        });
        let wi: Vec<Vec3> = u.iter().filter_map(|u| directions.sample(&view, *u)).collect();
        group.bench_function("pdf", |b| {
            b.iter(|| wi.iter().map(|wi| directions.pdf(&view, *wi)).sum::<f32>());
        });
        group.sample_size(10);
        group.throughput(Throughput::Elements(1));
        group.bench_function("directions", |b| {
            b.iter(|| EmissionDirections::new(&field, |_| 1.0).expect("a fire"));
        });
        group.bench_function("build", |b| {
            b.iter(|| EmissionField::new(source.clone(), to_world).expect("a field"));
        });
        group.finish();
    }
}

criterion_group!(emission, benches);
criterion_main!(emission);
