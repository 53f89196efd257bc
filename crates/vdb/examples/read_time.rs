//! Wall and processor time of reading all float grids of a file and adding up their active values,
//! best of several runs: `cargo run --release --example read_time -- FILE [REPEATS]`
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::time::Instant;

use pileus_vdb::{Tree, ValueType, VdbFile};
use rayon::prelude::*;

/// Milliseconds of processor time of this process with all its threads, where the system tells
/// (Linux).
fn cpu_ms() -> f64 {
    let total = std::fs::read_dir("/proc/self/task").ok().map(|tasks| {
        let times = tasks.flatten().filter_map(|task| {
            let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
            text.split_whitespace().next()?.parse::<f64>().ok()
        });
        times.sum::<f64>() / 1e6
    });
    total.unwrap_or(f64::NAN)
}

fn sum(tree: &Tree<f32>) -> (u64, f64) {
    let leaves = tree.values().par_chunks(512).zip(tree.leaves()).map(|(values, leaf)| {
        let mut sum = 0.0;
        for (values, word) in values.chunks_exact(64).zip(leaf.mask) {
            if word == u64::MAX {
                sum += values.iter().map(|value| f64::from(*value)).sum::<f64>();
            } else {
                let mut left = word;
                while left != 0 {
                    sum += f64::from(values[left.trailing_zeros() as usize]);
                    left &= left - 1;
                }
            }
        }
        sum
    });
    let tiles = tree.tiles().iter().filter(|tile| tile.active);
    let tiles = tiles.map(|tile| f64::from(tile.value) * f64::from(1u32 << tile.log2_size).powi(3));
    (tree.active_voxel_count(), leaves.sum::<f64>() + tiles.sum::<f64>())
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("name a file")?;
    let repeats: usize = args.next().map_or(Ok(5), |text| text.parse())?;
    let mut best = [f64::INFINITY; 4];
    let (mut count, mut total) = (0, 0.0);
    for _ in 0..repeats {
        let (wall, cpu) = (Instant::now(), cpu_ms());
        let file = VdbFile::open(&path)?;
        let mut trees = Vec::new();
        for (position, info) in file.grids().iter().enumerate() {
            if info.value_type == ValueType::Float {
                trees.push(file.read(position)?.to_float()?);
            }
        }
        let read = [cpu_ms() - cpu, wall.elapsed().as_secs_f64() * 1e3];
        (count, total) = trees.iter().map(sum).fold((0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let all = [cpu_ms() - cpu, wall.elapsed().as_secs_f64() * 1e3];
        for (best, now) in best.iter_mut().zip(read.into_iter().chain(all)) {
            *best = best.min(now);
        }
    }
    println!("{path}: active voxels {count}, sum {total:.6}");
    println!("read only: cpu {:.1} ms, wall {:.1} ms", best[0], best[1]);
    println!("read + sum: cpu {:.1} ms, wall {:.1} ms (best of {repeats})", best[2], best[3]);
    Ok(())
}
