//! Compares with the `vdb-rs` crate on the float grids that it reads right: the active values of
//! both must be the same.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use crate::{Coord, Grid, Values, VdbFile, from_vdb_rs};

/// Files of the conformance set and grids in them of which version 0.6.0 of `vdb-rs` reads all
/// active values right. On the others it panics, aborts the process, refuses, or gives wrong
/// values: see `docs/decisions/0001-own-vdb-reader.md`.
const READ_RIGHT: [(&str, &str); 27] = [
    ("empty_with_density", "density"),
    ("empty_with_density", "empty_bg"),
    ("far_negative", "density"),
    ("far_positive_split", "density"),
    ("float_blosc", "density"),
    ("float_blosc_nomask", "density"),
    ("float_none", "density"),
    ("float_none_mask", "density"),
    ("float_zip", "density"),
    ("float_zip_nomask", "density"),
    ("half_none", "density"),
    ("half_zip", "density"),
    ("inactive_many", "two_inactive"),
    ("inactive_values", "inactive"),
    ("instanced", "density"),
    ("levelset_bg", "surface"),
    ("mask_grid", "density"),
    ("metadata", "density"),
    ("names_utf8", "a/b[0].c"),
    ("names_utf8", "smoke density"),
    ("nan_inf_negative", "density"),
    ("no_instancing_meta_off", "density"),
    ("scale_negative", "density"),
    ("scale_nonuniform", "density"),
    ("single_voxel", "density"),
    ("tile_only", "tiles"),
    ("tiles_mixed", "density"),
];

/// Place, size and bits of all active values, so that NaN equals itself.
fn active(grid: &Grid) -> BTreeMap<(Coord, u32), u32> {
    let Values::Float(tree) = &grid.values else { panic!("{}: a float grid", grid.info.name) };
    tree.active_values().map(|a| ((a.origin, a.log2_size), a.value.to_bits())).collect()
}

#[test]
fn both_readers_agree() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/conformance");
    for (file, name) in READ_RIGHT {
        let bytes = std::fs::read(folder.join(format!("{file}.vdb"))).expect("a file");
        let mut reader = vdb_rs::VdbReader::new(Cursor::new(bytes.clone())).expect("a header");
        let theirs = reader.read_grid::<f32>(name).expect("a grid of vdb-rs");
        let theirs = from_vdb_rs(&theirs).expect("a whole grid");
        let ours = VdbFile::from_bytes(file, bytes).expect("a file");
        let ours = ours.find(name).and_then(|grid| ours.read(grid)).expect("a grid");
        assert!(active(&theirs) == active(&ours), "{file} {name}: active values");
        assert_eq!(theirs.info.name, ours.info.name);
        assert_eq!(theirs.info.class, ours.info.class, "{file} {name}");
        assert_eq!(theirs.info.compression, ours.info.compression, "{file} {name}");
        assert_eq!(theirs.info.saved_as_half, ours.info.saved_as_half, "{file} {name}");
        let matrix = |grid: &Grid| grid.info.transform.matrix().expect("a linear transform");
        assert_eq!(matrix(&theirs), matrix(&ours), "{file} {name}");
    }
}
