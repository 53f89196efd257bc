//! Damages OpenVDB files in many ways and checks that reading them never panics, never takes long
//! and never takes much memory.
//!
//! `cargo run --release --example fuzz -- --seconds 3600 --seed 1 --out DIR
//! [--keep DIR] FILE_OR_FOLDER...`
//!
//! Every candidate is one of the given files with one to four mutations, which know about lengths,
//! counts, offsets and compressed blocks. It depends only on the seed, its number and the files.
//! What fails is saved under `--out` with its story. `--keep` collects small candidates, one for
//! each error text not met before (digits aside), cut as short as the error allows.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use pileus_vdb::{Error, VdbFile};

mod counting_alloc;
mod mutate;

use mutate::{Random, Sample, candidate};

#[global_allocator]
static ALLOCATOR: counting_alloc::Counting = counting_alloc::Counting;

/// Longest time that reading one candidate may take.
const TIME_LIMIT: Duration = Duration::from_secs(2);
/// Most bytes that reading one candidate may hold at once.
const MEMORY_LIMIT: usize = 256 << 20;
/// Largest candidate that is kept.
const KEEP_LIMIT: usize = 48 << 10;

struct Options {
    seconds: u64,
    seed: u64,
    first: u64,
    out: PathBuf,
    keep: Option<PathBuf>,
    inputs: Vec<PathBuf>,
}

fn options() -> Result<Options, String> {
    let mut options = Options {
        seconds: 60,
        seed: 1,
        first: 0,
        out: "fuzz-findings".into(),
        keep: None,
        inputs: Vec::new(),
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().ok_or_else(|| format!("{arg} needs a value"));
        let mut number = || value()?.parse::<u64>().map_err(|error| format!("{arg}: {error}"));
        match arg.as_str() {
            "--seconds" => options.seconds = number()?,
            "--seed" => options.seed = number()?,
            "--first" => options.first = number()?,
            "--out" => options.out = value()?.into(),
            "--keep" => options.keep = Some(value()?.into()),
            _ => options.inputs.push(arg.into()),
        }
    }
    Ok(options)
}

/// All `.vdb` files of the given files and folders, sorted, those above 2 MB left out.
fn load(inputs: &[PathBuf]) -> std::io::Result<Vec<Sample>> {
    let mut paths = Vec::new();
    for input in inputs {
        if input.is_dir() {
            for entry in std::fs::read_dir(input)? {
                paths.push(entry?.path());
            }
        } else {
            paths.push(input.clone());
        }
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "vdb"));
    paths.sort();
    let mut samples = Vec::new();
    for path in paths {
        let bytes = std::fs::read(&path)?;
        if bytes.len() <= 2 << 20 {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            samples.push(Sample::new(name, bytes));
        }
    }
    Ok(samples)
}

/// Every so often a candidate is read from disk as well, in parts, which must end the same way.
const FROM_DISK_EVERY: u64 = 16;

/// Reads everything a file has and asks everything there is to ask.
fn exercise(file: VdbFile) -> Result<u64, Error> {
    let mut seen = 0u64;
    let mut failure = None;
    for (position, info) in file.grids().iter().enumerate() {
        seen = seen.wrapping_add(file.find(&info.full_name())? as u64);
        let inverse = info.transform.world_to_index();
        match file.read(position).and_then(|grid| grid.to_float()) {
            Ok(tree) => {
                seen = seen.wrapping_add(tree.active_voxel_count());
                if let Some((min, _)) = tree.active_bbox() {
                    seen = seen.wrapping_add(u64::from(tree.value(min).1));
                }
            }
            Err(error) => failure = Some(error),
        }
        if let Err(error) = inverse {
            failure.get_or_insert(error);
        }
    }
    failure.map_or(Ok(seen), Err)
}

#[derive(Debug)]
enum Outcome {
    Read,
    Refused(String),
    Broken(String),
}

/// Runs one candidate and judges it.
fn judge(bytes: &[u8]) -> (Outcome, Duration, usize) {
    let copy = bytes.to_vec();
    judge_file(|| VdbFile::from_bytes("candidate.vdb", copy))
}

fn judge_file(open: impl FnOnce() -> Result<VdbFile, Error>) -> (Outcome, Duration, usize) {
    let start = Instant::now();
    let run = || catch_unwind(AssertUnwindSafe(|| open().and_then(exercise)));
    let (result, peak) = counting_alloc::peak_of(run);
    let time = start.elapsed();
    let outcome = match result {
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Outcome::Broken(format!("panic: {}", text.unwrap_or("without text")))
        }
        Ok(_) if time > TIME_LIMIT => Outcome::Broken(format!("took {time:?}")),
        Ok(_) if peak > MEMORY_LIMIT => Outcome::Broken(format!("held {peak} bytes")),
        Ok(Ok(_)) => Outcome::Read,
        Ok(Err(error)) => match &error {
            Error::Invalid { place, .. } | Error::Unsupported { place, .. }
                if place.file.is_empty()
                    || (place.offset.is_none() && !error.to_string().contains("single number")) =>
            {
                Outcome::Broken(format!("an error without a place: {error}"))
            }
            _ => Outcome::Refused(shape(&error.to_string())),
        },
    };
    (outcome, time, peak)
}

/// An error text without what varies: digits and quoted names.
fn shape(text: &str) -> String {
    let unquoted: String = text.split('"').step_by(2).collect();
    let mut text = unquoted;
    for cut in [
        "flags 0x",
        " is singular",
        "the root entry at",
        "has two entries",
        "of type Tree",
        "an instance of type",
    ] {
        if let Some(at) = text.find(cut) {
            text.truncate(at + cut.len());
        }
    }
    text.chars().filter(|c| !c.is_ascii_digit() && *c != '-').collect()
}

/// Cuts the end off while the error stays the same.
fn shorten(mut bytes: Vec<u8>, error: &str) -> Vec<u8> {
    let mut step = bytes.len() / 2;
    while step > 0 {
        let shorter = &bytes[..bytes.len() - step];
        match judge(shorter).0 {
            Outcome::Refused(text) if text == error => bytes.truncate(bytes.len() - step),
            _ => step /= 2,
        }
        step = step.min(bytes.len() / 2);
    }
    bytes
}

fn save(folder: &Path, name: &str, bytes: &[u8], story: &str) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join(format!("{name}.vdb")), bytes)?;
    if !story.is_empty() {
        std::fs::write(folder.join(format!("{name}.txt")), story)?;
    }
    Ok(())
}

fn run(options: &Options) -> Result<usize, Box<dyn std::error::Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let samples = load(&options.inputs)?;
    if samples.is_empty() {
        return Err("name files or folders with .vdb files".into());
    }
    std::panic::set_hook(Box::new(|_| {}));
    let disk = std::env::temp_dir().join(format!("fuzz_{}.vdb", std::process::id()));
    let (start, limit) = (Instant::now(), Duration::from_secs(options.seconds));
    let (mut count, mut read, mut findings) = (0u64, 0u64, 0usize);
    let (mut slowest, mut largest) = (Duration::ZERO, 0);
    let mut errors: BTreeMap<String, u64> = BTreeMap::new();
    let mut report = Duration::from_secs(10);
    while start.elapsed() < limit {
        let number = options.first + count;
        count += 1;
        let (bytes, story) = candidate(&samples, &mut Random::new(options.seed, number));
        let (mut outcome, time, peak) = judge(&bytes);
        if number.is_multiple_of(FROM_DISK_EVERY) {
            std::fs::write(&disk, &bytes)?;
            let (from_disk, ..) = judge_file(|| VdbFile::open(&disk));
            let same = match (&outcome, &from_disk) {
                (Outcome::Read, Outcome::Read) | (Outcome::Broken(_), _) => true,
                (Outcome::Refused(text), Outcome::Refused(other)) => {
                    text.split_once(": ").map(|t| t.1) == other.split_once(": ").map(|t| t.1)
                }
                _ => false,
            };
            if !same {
                outcome =
                    Outcome::Broken(format!("{outcome:?} from memory, {from_disk:?} from disk"));
            }
        }
        slowest = slowest.max(time);
        largest = largest.max(peak);
        match outcome {
            Outcome::Read => read += 1,
            Outcome::Refused(text) => {
                let met = errors.entry(text.clone()).or_insert(0);
                *met += 1;
                if let (1, Some(keep)) = (*met, &options.keep) {
                    let short = shorten(bytes, &text);
                    if short.len() <= KEEP_LIMIT {
                        save(keep, &format!("{:03}_{number}", errors.len()), &short, "")?;
                    }
                }
            }
            Outcome::Broken(what) => {
                findings += 1;
                let story = format!("seed {}, number {number}: {what}\n{story}\n", options.seed);
                print!("FINDING {story}");
                save(&options.out, &format!("{}_{number}", options.seed), &bytes, &story)?;
            }
        }
        if start.elapsed() > report {
            report = start.elapsed() * 3 / 2;
            println!(
                "{:?}: {count} candidates, {read} read, {} error texts, {findings} findings",
                start.elapsed(),
                errors.len()
            );
        }
    }
    println!(
        "seed {}: {count} candidates in {:?}, {read} read, {findings} findings; slowest {slowest:?}, largest {largest} bytes",
        options.seed,
        start.elapsed()
    );
    std::fs::remove_file(&disk).or_else(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Ok(()),
        _ => Err(error),
    })?;
    for (text, met) in errors {
        println!("{met:9}  {text}");
    }
    Ok(findings)
}

fn main() -> ExitCode {
    match options().map_err(Into::into).and_then(|options| run(&options)) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
