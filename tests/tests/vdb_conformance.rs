//! Reads every file of `data/conformance` and compares it with what OpenVDB itself read back after
//! writing it (`NAME.json`).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pileus_vdb::{
    Coord, Grid, GridInfo, MetaValue, Metadata, Transform, TransformKind, Tree, Values, VdbFile,
};
use serde_json::Value as Json;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name)
}

/// A voxel's value as the numbers of its components.
trait Numbers: Copy + PartialEq + std::fmt::Debug {
    fn numbers(self) -> Vec<f64>;
}

macro_rules! numbers {
    ($($type:ty),*) => { $(
        impl Numbers for $type {
            fn numbers(self) -> Vec<f64> {
                vec![self as f64]
            }
        }
        impl Numbers for [$type; 3] {
            fn numbers(self) -> Vec<f64> {
                self.map(|value| value as f64).to_vec()
            }
        }
    )* };
}
numbers!(f32, f64, i32, i64);

impl Numbers for bool {
    fn numbers(self) -> Vec<f64> {
        vec![f64::from(u8::from(self))]
    }
}

/// Numbers of a JSON value; `nan` and `inf` are strings there.
fn numbers(json: &Json) -> Vec<f64> {
    match json {
        Json::Array(items) => items.iter().flat_map(numbers).collect(),
        Json::Bool(value) => vec![f64::from(u8::from(*value))],
        Json::String(text) => vec![text.parse().expect("a number in text")],
        _ => vec![json.as_f64().expect("a number")],
    }
}

fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

fn coord(json: &Json) -> Coord {
    let numbers = numbers(json);
    std::array::from_fn(|axis| numbers[axis] as i32)
}

fn items(json: &Json) -> &[Json] {
    json.as_array().map_or(&[], Vec::as_slice)
}

fn check_tree<T: Numbers + PartialOrd>(tree: &Tree<T>, expected: &Json, place: &str) {
    let background = numbers(&expected["background"]);
    assert!(same(&tree.background().numbers(), &background), "{place}: background");
    let count = expected["active_voxel_count"].as_u64().expect("a count");
    assert_eq!(tree.active_voxel_count(), count, "{place}: active voxels");
    if let Some(leaves) = expected["leaf_count"].as_u64() {
        assert_eq!(tree.leaves().len() as u64, leaves, "{place}: leaves");
    }
    let bbox = expected["active_bbox"].as_array().map(|b| (coord(&b[0]), coord(&b[1])));
    assert_eq!(tree.active_bbox(), bbox.filter(|_| count > 0), "{place}: box");

    if !expected["min"].is_null() {
        // Vectors are ordered by their first component, then the next, by OpenVDB as by Rust.
        let (min, max) = tree.min_max().expect("active values");
        assert!(same(&min.numbers(), &numbers(&expected["min"])), "{place}: {min:?}");
        assert!(same(&max.numbers(), &numbers(&expected["max"])), "{place}: {max:?}");
    }
    let tiles = items(&expected["active_tiles"]);
    if !tiles.is_empty() && tiles.len() < 64 {
        assert_eq!(tree.tiles().iter().filter(|t| t.active).count(), tiles.len(), "{place}");
    }
    for tile in tiles {
        let (min, max) = (coord(&tile["min"]), coord(&tile["max"]));
        let found = tree.tiles().iter().find(|found| found.origin == min && found.active);
        let found = found.unwrap_or_else(|| panic!("{place}: no tile at {min:?}"));
        assert_eq!(max[0] - min[0] + 1, 1 << found.log2_size, "{place}: size of tile {min:?}");
        assert!(same(&found.value.numbers(), &numbers(&tile["value"])), "{place}: {min:?}");
    }
    let mut accessor = tree.accessor();
    for sample in items(&expected["samples"]) {
        let ijk = coord(&sample["ijk"]);
        let (value, active) = accessor.value(ijk);
        assert_eq!(Some(active), sample["active"].as_bool(), "{place}: state at {ijk:?}");
        let wanted = numbers(&sample["value"]);
        assert!(same(&value.numbers(), &wanted), "{place}: {ijk:?}: {wanted:?}");
        assert_eq!(tree.value(ijk).1, active);
    }
    check_order(tree, place);
}

/// What the documentation of `Tree` promises.
fn check_order<T: Numbers>(tree: &Tree<T>, place: &str) {
    let leaves = tree.leaves();
    assert!(leaves.windows(2).all(|pair| pair[0].origin < pair[1].origin), "{place}: leaf order");
    assert!(leaves.iter().all(|leaf| leaf.origin.iter().all(|axis| axis & 7 == 0)), "{place}");
    assert_eq!(tree.values().len(), 512 * leaves.len());
    let tiles = tree.tiles();
    assert!(tiles.windows(2).all(|pair| pair[0].origin < pair[1].origin), "{place}: tile order");
    let kept = |t: &pileus_vdb::Tile<T>| t.active || t.value != *tree.background();
    assert!(tiles.iter().all(kept), "{place}: a tile of background");
}

fn check_transform(transform: &Transform, expected: &Json, place: &str) {
    let name = expected["transform"]["type"].as_str().expect("a name");
    assert_eq!(transform.kind().map_name(), name, "{place}");
    if transform.kind() == TransformKind::Frustum {
        let text = transform.matrix().expect_err("a frustum has no matrix").to_string();
        assert!(text.contains("frustum") && text.contains(place.split(' ').next().unwrap_or("")));
        return;
    }
    let matrix = transform.matrix().expect("a linear transform");
    let wanted = numbers(&expected["transform"]["matrix_row_vector"]);
    // The expectations were got by mapping points, which rounds.
    let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * (1.0 + b.abs());
    assert!(matrix.as_flattened().iter().zip(&wanted).all(near), "{place}: {matrix:?}");
    let inverse = transform.world_to_index().expect("an invertible transform");
    for pair in items(&expected["world_samples"]) {
        let (index, world) = (numbers(&pair["ijk"]), numbers(&pair["world"]));
        let apply = |m: &[[f64; 4]; 4], p: &[f64]| -> [f64; 3] {
            std::array::from_fn(|c| m[3][c] + (0..3).map(|r| p[r] * m[r][c]).sum::<f64>())
        };
        let near = |a: &[f64], b: &[f64]| {
            a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9 * (1.0 + b.abs()))
        };
        assert!(near(&apply(&matrix, &index), &world), "{place}: world of {index:?}");
        assert!(near(&apply(&inverse, &world), &index), "{place}: index of {world:?}");
    }
    let voxel = transform.voxel_size().expect("a linear transform");
    let wanted = numbers(&expected["voxel_size"]);
    assert!(voxel.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= 1e-12 * b), "{place}: voxel");
}

/// A metadata value as Python prints it, which is how the expectations were written.
fn python(value: &MetaValue) -> String {
    match value {
        MetaValue::Bool(true) => "True".into(),
        MetaValue::Bool(false) => "False".into(),
        value => value.to_string(),
    }
}

fn check_metadata(metadata: &Metadata, expected: &Json, place: &str) {
    for (name, wanted) in expected.as_object().expect("an object") {
        let value = metadata.get(name).unwrap_or_else(|| panic!("{place}: no {name}"));
        let wanted = match wanted {
            Json::String(text) => text.clone(),
            Json::Bool(true) => "True".into(),
            Json::Bool(false) => "False".into(),
            number => number.to_string(),
        };
        assert_eq!(python(value), wanted, "{place}: {name}");
    }
}

fn check_grid(grid: &Grid, expected: &Json, place: &str) {
    let info: &GridInfo = &grid.info;
    assert_eq!(info.value_type.to_string(), expected["type"].as_str().expect("a type"), "{place}");
    assert_eq!(
        info.class.to_string(),
        expected["grid_class"].as_str().expect("a class"),
        "{place}"
    );
    assert_eq!(Some(info.saved_as_half), expected["saved_as_half"].as_bool(), "{place}");
    check_transform(&info.transform, expected, place);
    check_metadata(&info.metadata, &expected["metadata"], place);
    match &grid.values {
        Values::Float(tree) => check_tree(tree, expected, place),
        Values::Double(tree) => check_tree(tree, expected, place),
        Values::Int32(tree) => check_tree(tree, expected, place),
        Values::Int64(tree) => check_tree(tree, expected, place),
        Values::Bool(tree) | Values::Mask(tree) => check_tree(tree, expected, place),
        Values::Vec3f(tree) => check_tree(tree, expected, place),
        Values::Vec3d(tree) => check_tree(tree, expected, place),
        Values::Vec3i(tree) => check_tree(tree, expected, place),
    }
}

#[test]
fn every_grid_of_every_file() {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(data("conformance"))
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "vdb"))
        .collect();
    paths.sort();
    assert_eq!(paths.len(), 36);
    let mut grids = 0;
    for path in paths {
        let text = std::fs::read_to_string(path.with_extension("json")).expect("expectations");
        let json: Json = serde_json::from_str(&text).expect("JSON");
        let file = VdbFile::open(&path).unwrap_or_else(|error| panic!("{error}"));
        let place = path.file_name().expect("a name").to_string_lossy().into_owned();
        assert_eq!(json["file_format_version"], file.version());
        let (major, minor) = file.library_version();
        assert_eq!(json["writer_library"], format!("{major}.{minor}"), "{place}");
        check_metadata(file.metadata(), &json["file_metadata"], &place);

        let expected = items(&json["grids"]);
        assert_eq!(file.grids().len(), expected.len(), "{place}");
        // The order of the expectations is the library's, not the file's; equal names are told
        // apart by their boxes.
        let mut left: BTreeMap<String, Vec<&Json>> = BTreeMap::new();
        for grid in expected {
            left.entry(grid["name"].as_str().expect("a name").into()).or_default().push(grid);
        }
        for (position, info) in file.grids().iter().enumerate() {
            assert_eq!(file.find(&info.full_name()).ok(), Some(position), "{place}");
            let grid = file.read(position).unwrap_or_else(|error| panic!("{error}"));
            let wanted = left.get_mut(&info.name).expect("an expected name");
            let bbox = |grid: &Json| coord(&grid["active_bbox"][0]);
            let which = match &grid.values {
                Values::Float(tree) if wanted.len() > 1 => {
                    let min = tree.active_bbox().expect("active voxels").0;
                    wanted.iter().position(|grid| bbox(grid) == min).expect("an expected box")
                }
                _ => 0,
            };
            let wanted = wanted.remove(which);
            check_grid(&grid, wanted, &format!("{} {}", path.display(), info.full_name()));
            grids += 1;
        }
    }
    assert_eq!(grids, 55);
}

#[test]
fn instances_share_the_tree_of_their_parent() {
    let file = VdbFile::open(data("conformance/instanced.vdb")).expect("a file");
    let parents: Vec<_> = file.grids().iter().map(|grid| grid.instance_of.as_deref()).collect();
    assert_eq!(parents.iter().flatten().count(), 2);
    let trees: Vec<_> = (0..3).map(|grid| file.read(grid).expect("a grid").values).collect();
    assert!(trees[0] == trees[1] && trees[1] == trees[2]);
    let matrices: Vec<_> =
        file.grids().iter().map(|grid| grid.transform.matrix().expect("linear")).collect();
    assert!(matrices[0] != matrices[1] && matrices[1] != matrices[2]);
}

#[test]
fn equal_names_are_told_apart() {
    let file = VdbFile::open(data("conformance/names_same.vdb")).expect("a file");
    let names: Vec<_> = file.grids().iter().map(GridInfo::full_name).collect();
    assert_eq!(names, ["density[0]", "density[1]", "density[2]"]);
    assert_eq!(file.find("density").ok(), Some(0));
    assert_eq!(file.find("density[2]").ok(), Some(2));
    let text = file.find("density[3]").expect_err("three grids only").to_string();
    assert!(text.contains("\"density[0]\", \"density[1]\", \"density[2]\""), "{text}");
    let file = VdbFile::open(data("conformance/names_utf8.vdb")).expect("a file");
    for name in ["Dichte-üß", "a/b[0].c", "smoke density", "雲 ☁"] {
        assert_eq!(file.grids()[file.find(name).expect("the name")].name, name);
    }
}

#[test]
fn reading_in_parts_from_disk_equals_reading_from_memory() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/assets");
    let mut paths: Vec<PathBuf> = Vec::new();
    for folder in [data("conformance"), data("vdb_codecs"), assets] {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        paths.extend(entries.map(|entry| entry.path()));
    }
    for path in paths.iter().filter(|path| path.extension().is_some_and(|e| e == "vdb")) {
        let bytes = std::fs::read(path).expect("the file");
        let disk = VdbFile::open(path).expect("a file");
        let memory = VdbFile::from_bytes("memory", bytes).expect("a file");
        assert_eq!(disk.grids().len(), memory.grids().len());
        for grid in 0..disk.grids().len() {
            match (disk.read(grid), memory.read(grid)) {
                // NaN differs from itself, so texts are compared where values differ.
                (Ok(a), Ok(b)) => assert!(
                    a.values == b.values || format!("{:?}", a.values) == format!("{:?}", b.values),
                    "{}",
                    path.display()
                ),
                (Err(a), Err(b)) => assert_eq!(a.place().offset, b.place().offset),
                _ => panic!("{}: only one way reads", path.display()),
            }
        }
    }
}

#[test]
fn every_codec_gives_the_same_grid() {
    let read = |path: PathBuf| VdbFile::open(path).and_then(|file| file.read(0));
    let original = read(data("conformance/affine_sheared.vdb")).expect("the original").values;
    let mut count = 0;
    for entry in std::fs::read_dir(data("vdb_codecs")).expect("the folder").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".vdb") && name != "snappy.vdb" {
            let grid = read(entry.path()).unwrap_or_else(|error| panic!("{error}"));
            assert!(grid.values == original, "{name}");
            count += 1;
        }
    }
    assert_eq!(count, 18);
    let error = read(data("vdb_codecs/snappy.vdb")).expect_err("Snappy").to_string();
    assert!(error.contains("Snappy") && error.contains("byte"), "{error}");
}

/// Written by Houdini with OpenVDB 1.1 in format version 222: figures of the table in
/// `scenes/assets/README.md`.
#[test]
fn an_old_file_of_version_222() {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenes/assets");
    let file = VdbFile::open(assets.join("arnold_smoke.vdb")).expect("a file");
    assert_eq!((file.version(), file.library_version()), (222, (1, 1)));
    let tree = file.read(0).and_then(Grid::to_float).expect("a grid");
    assert_eq!(tree.active_voxel_count(), 1_049_275);
    assert_eq!(tree.active_bbox(), Some(([1, 2, 1], [111, 223, 112])));
    let (min, max) = tree.min_max().expect("values");
    assert!((min - 1.00136e-05).abs() < 1e-10 && (max - 5.71484).abs() < 1e-5, "{min} {max}");
}
