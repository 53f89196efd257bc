//! Reads damaged files: no panic, no hang, no large allocation, and errors that say where.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use pileus_vdb::{Error, Grid, Tree, VdbFile};
use proptest::prelude::*;
use serde_json::Value as Json;

#[path = "../../crates/vdb/examples/fuzz/counting_alloc.rs"]
mod counting_alloc;

#[global_allocator]
static ALLOCATOR: counting_alloc::Counting = counting_alloc::Counting;

/// The allocator counts for the whole process, so one file is read at a time.
static ALONE: Mutex<()> = Mutex::new(());

const TIME_LIMIT: Duration = Duration::from_secs(2);
const MEMORY_LIMIT: usize = 256 << 20;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name)
}

/// All grids of a file as floats.
fn read_all(path: &Path) -> Result<Vec<Tree<f32>>, Error> {
    let file = VdbFile::open(path)?;
    let mut trees = Vec::new();
    for (position, grid) in file.grids().iter().enumerate() {
        grid.transform.world_to_index()?;
        trees.push(file.read(position).and_then(Grid::to_float)?);
    }
    Ok(trees)
}

/// Reads under the limits that every file has to keep.
fn read_within_limits(path: &Path) -> Result<Vec<Tree<f32>>, Error> {
    let alone = ALONE.lock().unwrap_or_else(|poison| poison.into_inner());
    let start = Instant::now();
    let read = || catch_unwind(AssertUnwindSafe(|| read_all(path)));
    let (result, peak) = counting_alloc::peak_of(read);
    let time = start.elapsed();
    drop(alone);
    let name = path.display();
    assert!(time < TIME_LIMIT, "{name}: took {time:?}");
    assert!(peak < MEMORY_LIMIT, "{name}: held {peak} bytes");
    result.unwrap_or_else(|_| panic!("{name}: panicked"))
}

/// Errors name the file and, but for missing names, the byte.
fn check_error(error: &Error, path: &Path) {
    let (place, text) = (error.place(), error.to_string());
    assert_eq!(place.file, path.display().to_string(), "{text}");
    assert!(text.starts_with(&place.file), "{text}");
    assert!(!error.remedy().is_empty());
    match error {
        Error::Invalid { .. } | Error::Unsupported { .. } => {
            let offset = place.offset.unwrap_or_else(|| panic!("no offset: {text}"));
            assert!(text.contains(&format!("byte {offset}")), "{text}");
        }
        _ => panic!("{text}: damaged bytes are neither missing nor unreadable"),
    }
}

#[test]
fn broken_files_do_what_is_expected() {
    let folder = data("conformance/broken");
    let text = std::fs::read_to_string(folder.join("broken.json")).expect("expectations");
    let json: Json = serde_json::from_str(&text).expect("JSON");
    let original = read_all(&data("conformance/affine_rotated.vdb")).expect("the original");
    let (mut files, mut errors, mut with_grid) = (0, 0, 0);
    for entry in json["files"].as_array().expect("a list") {
        let name = entry["file"].as_str().expect("a name");
        let path = folder.join(name);
        assert_eq!(std::fs::metadata(&path).map(|m| m.len()).ok(), entry["size"].as_u64());
        let result = read_within_limits(&path);
        if let Err(error) = &result {
            check_error(error, &path);
            errors += 1;
            with_grid += usize::from(error.place().grid.is_some());
            // Behind the header everything belongs to the grid.
            let known = name.starts_with("offset_") || name.starts_with("flip_");
            if known && !matches!(name, "flip_tree_1.vdb" | "flip_tree_5.vdb") {
                assert_eq!(error.place().grid.as_deref(), Some("density"), "{error}");
            }
        }
        match entry["expect"].as_str().expect("an expectation") {
            "an error, within 2 s and without allocating more than 256 MiB" => {
                assert!(result.is_err(), "{name} was read");
            }
            "an error, or the same grid (the last byte is not needed by every reader)"
            | "an error, or a warning and a correct read; no crash"
            | "an error, or a correct read (the end offset need not be used); no crash" => {
                assert!(result.is_err() || result.as_ref().ok() == Some(&original), "{name}");
            }
            "an empty list or an error; no crash" => {
                assert!(result.as_ref().is_ok_and(Vec::is_empty), "{name}: {result:?}");
            }
            "the same grid as the original" => assert_eq!(result.ok(), Some(original.clone())),
            "an error or the grid skipped with a message; no crash"
            | "an error or some grid; no crash, no hang, memory within 256 MiB" => {}
            other => panic!("{name}: expectation {other:?} is new"),
        }
        files += 1;
    }
    assert_eq!(files, 40);
    assert!(errors >= 30 && with_grid >= 10, "{errors} errors, {with_grid} name the grid");
}

/// Files that the fuzz target found to be refused each for another reason.
#[test]
fn the_fuzz_corpus_keeps_the_limits() {
    let mut count = 0;
    for entry in std::fs::read_dir(data("vdb_corpus")).expect("the folder").flatten() {
        if entry.path().extension().is_some_and(|extension| extension == "vdb") {
            let path = entry.path();
            let Err(error) = read_within_limits(&path) else { continue };
            check_error(&error, &path);
            count += 1;
        }
    }
    assert!(count > 40, "{count} files are refused");
}

#[test]
fn what_is_no_file_is_an_io_error() {
    for path in [data("no such file.vdb"), data("conformance")] {
        let error = VdbFile::open(&path).expect_err("no file");
        assert!(matches!(&error, Error::Io { .. }), "{error}");
        assert_eq!(error.place().file, path.display().to_string());
    }
}

#[test]
fn a_file_that_shrinks_after_opening_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("shrinking.vdb");
    let bytes = std::fs::read(data("conformance/float_none.vdb")).expect("a file");
    std::fs::write(&path, &bytes).expect("a copy");
    let file = VdbFile::open(&path).expect("a file");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("half a copy");
    let error = file.read(0).expect_err("half of the bytes are gone");
    assert!(matches!(&error, Error::Io { .. }), "{error}");
    assert_eq!(error.place().grid.as_deref(), Some("density"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..Default::default() })]

    /// Any bytes in any places of any conformance file end in a grid or an error.
    #[test]
    fn mutations_never_panic(
        file in 0usize..36,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..24),
        cut in prop::option::of(any::<prop::sample::Index>()),
        flip_header in any::<bool>(),
    ) {
        let mut paths: Vec<_> = std::fs::read_dir(data("conformance"))
            .expect("the folder")
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "vdb"))
            .collect();
        paths.sort();
        let mut bytes = std::fs::read(&paths[file]).expect("a file");
        if let Some(cut) = cut {
            let length = bytes.len();
            bytes.truncate(1 + cut.index(length));
        }
        let end = if flip_header { bytes.len().min(1024) } else { bytes.len() };
        for (index, byte) in changes {
            bytes[index.index(end)] = byte;
        }
        if let Ok(file) = VdbFile::from_bytes("mutant.vdb", bytes) {
            for grid in 0..file.grids().len() {
                if let Err(error) = file.read(grid) {
                    prop_assert_eq!(&error.place().file, "mutant.vdb");
                }
            }
        }
    }

    #[test]
    fn noise_never_panics(mut bytes in prop::collection::vec(any::<u8>(), 0..4096), magic in any::<bool>()) {
        if magic {
            let head = [0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0, 224, 0, 0, 0];
            bytes.iter_mut().zip(head).for_each(|(to, from)| *to = from);
        }
        if let Ok(file) = VdbFile::from_bytes("noise.vdb", bytes) {
            for grid in 0..file.grids().len() {
                drop(file.read(grid));
            }
        }
    }
}
