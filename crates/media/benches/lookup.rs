//! Nanoseconds per lookup, per majorant step and per shadow ray. Run with
//! `cargo bench -p pileus-media`.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use pileus_media::random::uniform;
use pileus_media::transmittance::ratio_tracking;
use pileus_media::{
    Albedo, MajorantSegment, Medium, Phase, PhaseAt, RayField, Tally, TentativeCollisions,
    VoxelGrid, VoxelGridOptions,
};
use pileus_vdb::{Tree, VdbFile};
use rand_pcg::Pcg32;
use std::hint::black_box;
use std::sync::Arc;

fn tree(name: &str) -> (Tree<f32>, DAffine3) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/assets/");
    let file = VdbFile::open(format!("{path}{name}")).expect("an asset");
    let grid = file.read(file.find("density").expect("density")).expect("a grid");
    let m = grid.info.transform.index_to_world().expect("a linear transform");
    let row = |i: usize| DVec3::new(m[i][0], m[i][1], m[i][2]);
    let matrix = DMat3::from_cols(row(0), row(1), row(2));
    (grid.to_float().expect("a scalar grid"), DAffine3::from_mat3_translation(matrix, row(3)))
}

fn medium(name: &str, scale: f32) -> Medium {
    let (tree, index_to_world) = tree(name);
    let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid");
    let albedo = Albedo::Constant([1.0; 3]);
    Medium::from_grid(Arc::new(grid), index_to_world, [scale; 3], albedo, Phase::Isotropic)
        .expect("a medium")
}

fn direction(rng: &mut Pcg32) -> Vec3 {
    PhaseAt::Isotropic.sample(Vec3::Z, [uniform(rng), uniform(rng)]).0
}

fn point_in(medium: &Medium, rng: &mut Pcg32) -> DVec3 {
    let pileus_media::Bounds3 { low, high } = medium.bounds_world().expect("bounds");
    let u = DVec3::new(uniform(rng).into(), uniform(rng).into(), uniform(rng).into());
    low + (high - low) * u
}

/// Points at which the medium is dense.
fn dense_points(medium: &Medium, n: usize) -> Vec<DVec3> {
    let mut rng = Pcg32::new(1, 1);
    std::iter::repeat_with(|| point_in(medium, &mut rng))
        .filter(|p| medium.sigma_t_at(*p) > 0.0)
        .take(n)
        .collect()
}

fn benches(c: &mut Criterion) {
    let cumulus = medium("cumulus.vdb", 0.4);

    let mut group = c.benchmark_group("lookup");
    // The same segment again and again: voxels in the first cache.
    let p = dense_points(&cumulus, 1)[0];
    let span = cumulus.span(p, Vec3::X, 1e9).expect("a span");
    let mut ray = cumulus.any_ray(&span, 1.0);
    let MajorantSegment { t0, t1, .. } = ray.next_segment().expect("a segment");
    let steps = 1024;
    group.throughput(Throughput::Elements(steps));
    group.bench_function("first_cache", |b| {
        b.iter(|| {
            let mut sum = 0.0;
            for i in 0..steps {
                sum += ray.sigma_t(t0 + (t1 - t0) * (i as f32 / steps as f32));
            }
            black_box(sum)
        });
    });
    // First segment and first lookup of rays from random dense points: brick and voxels from
    // memory.
    let points = dense_points(&cumulus, 1 << 16);
    let mut rng = Pcg32::new(2, 2);
    let rays: Vec<_> = points.iter().map(|p| (*p, direction(&mut rng))).collect();
    let mut next = 0;
    group.throughput(Throughput::Elements(1));
    group.bench_function("random_with_entry", |b| {
        b.iter(|| {
            next = (next + 1) & 0xffff;
            let (p, d) = rays[next];
            let span = cumulus.span(p, d, 1e9).expect("a span");
            let mut ray = cumulus.any_ray(&span, 1.0);
            let segment = ray.next_segment().expect("a segment");
            black_box(ray.sigma_t(segment.t0))
        });
    });
    group.finish();

    for (name, scale) in
        [("cumulus.vdb", 0.4), ("cumulus_small.vdb", 0.4), ("arnold_smoke.vdb", 1.19)]
    {
        let medium = medium(name, scale);
        let mut rng = Pcg32::new(3, 3);
        let rays: Vec<_> = (0..4096)
            .map(|_| {
                let d = direction(&mut rng);
                (point_in(&medium, &mut rng) - d.as_dvec3() * 1e4, d)
            })
            .collect();
        let mut group = c.benchmark_group(name);
        group.sample_size(20);
        let walk = |visit: &mut dyn FnMut(u64)| {
            for (p, d) in &rays {
                if let Some(span) = medium.span(*p, *d, 1e9) {
                    let mut ray = medium.any_ray(&span, 1.0);
                    while let Some(segment) = ray.next_segment() {
                        black_box(segment);
                    }
                    visit(ray.steps());
                }
            }
        };
        let mut steps = 0;
        walk(&mut |n| steps += n);
        group.throughput(Throughput::Elements(steps));
        group.bench_function("majorant_step", |b| b.iter(|| walk(&mut |_| ())));

        let mut rng = Pcg32::new(4, 4);
        let shadow: Vec<_> = dense_points(&medium, 4096);
        group.throughput(Throughput::Elements(shadow.len() as u64));
        group.bench_function("shadow_ray_ratio", |b| {
            b.iter_batched(
                || Pcg32::new(5, 5),
                |mut random| {
                    let mut tally = Tally::default();
                    let mut sum = 0.0;
                    for p in &shadow {
                        let d = direction(&mut rng);
                        let span = medium.span(*p, d, 1e9).expect("a span");
                        let walk = TentativeCollisions::new(medium.any_ray(&span, 1.0));
                        sum += ratio_tracking(walk, &mut random, &mut tally);
                    }
                    black_box(sum)
                },
                BatchSize::SmallInput,
            );
        });
        group.finish();
    }

    let (tree, _) = tree("cumulus.vdb");
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    group.throughput(Throughput::Elements(tree.values().len() as u64));
    group.bench_function("cumulus.vdb", |b| {
        b.iter(|| VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).expect("a grid"));
    });
    group.finish();
}

criterion_group!(lookup, benches);
criterion_main!(lookup);
