//! How fast files are read: megabytes of the file per second, values decoded on all cores.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use pileus_vdb::VdbFile;

/// Files of `scenes/assets`; one that is not there is left out.
const FILES: [&str; 5] =
    ["cumulus.vdb", "arnold_smoke.vdb", "smoke_plume.vdb", "fire_0003.vdb", "syn_sphere.vdb"];

fn load(criterion: &mut Criterion) {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/assets");
    let mut group = criterion.benchmark_group("load");
    group.sample_size(20);
    for name in FILES {
        let path = assets.join(name);
        let Ok(metadata) = std::fs::metadata(&path) else { continue };
        group.throughput(Throughput::Bytes(metadata.len()));
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let file = VdbFile::open(&path).expect("the file opens");
                for grid in 0..file.grids().len() {
                    black_box(file.read(grid).expect("the grid reads"));
                }
            });
        });
    }
    group.finish();
    criterion.bench_function("open/cumulus.vdb", |bencher| {
        let path = assets.join("cumulus.vdb");
        bencher.iter(|| black_box(VdbFile::open(&path).is_ok()));
    });
}

criterion_group!(benches, load);
criterion_main!(benches);
