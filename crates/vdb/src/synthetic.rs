//! Small files made up byte by byte, for versions and oddities that no library at hand writes.
//! Tests only.

use std::io::Write;

use crate::cursor::Cursor;
use crate::grid::{ValueType, Values};
use crate::tree::Tree;
use crate::{Error, VdbFile};

/// A grid to be written: a tree of one leaf at the origin (value `i` in voxel `i`, even ones
/// active), a tile of 8 with value 600 beside it, and a tile of 128 with value 700.
struct Made {
    name: &'static str,
    type_name: &'static str,
    parent: &'static str,
    half: bool,
    zip: bool,
    frustum: bool,
}

const PLAIN: Made = Made {
    name: "density",
    type_name: "Tree_float_5_4_3",
    parent: "",
    half: false,
    zip: false,
    frustum: false,
};

fn text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

impl Made {
    /// One value as the tree stores it; `packed` inside a block of values.
    fn value(&self, number: u16, packed: bool) -> Vec<u8> {
        let half = half::f16::from_f32(f32::from(number)).to_le_bytes().to_vec();
        match self.type_name {
            "Tree_half_5_4_3" => half,
            _ if self.half && packed => half,
            "Tree_double_5_4_3" => f64::from(number).to_le_bytes().to_vec(),
            "Tree_int32_5_4_3" => i32::from(number).to_le_bytes().to_vec(),
            _ => f32::from(number).to_le_bytes().to_vec(),
        }
    }

    fn block(&self, out: &mut Vec<u8>, numbers: impl Iterator<Item = u16>) {
        let bytes: Vec<u8> = numbers.flat_map(|number| self.value(number, true)).collect();
        if self.zip {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
            encoder.write_all(&bytes).unwrap();
            let packed = encoder.finish().unwrap();
            out.extend((packed.len() as i64).to_le_bytes());
            out.extend(packed);
        } else {
            out.extend(bytes);
        }
    }

    /// An internal node with a child in slot 0 and an active tile of `number` in slot 1.
    fn node(&self, out: &mut Vec<u8>, version: u32, slots: usize, number: u16) {
        for first in [1u8, 2] {
            out.push(first);
            out.resize(out.len() + slots / 8 - 1, 0);
        }
        let tile = |slot| if slot == 1 { number } else { 0 };
        if version < 222 {
            self.block(out, (1..slots).map(tile));
        } else {
            out.push(6);
            self.block(out, (0..slots).map(tile));
        }
    }

    fn tree(&self, out: &mut Vec<u8>, version: u32) {
        out.extend(1i32.to_le_bytes());
        out.extend(self.value(0, false));
        out.extend([0i32, 1, 0, 0, 0].iter().flat_map(|number| number.to_le_bytes()));
        self.node(out, version, 32768, 700);
        self.node(out, version, 4096, 600);
        out.extend([0x55; 64]);
        out.extend([0x55; 64]);
        if version < 222 {
            out.extend([0; 12]);
            out.push(2);
            self.block(out, 0..512);
            self.block(out, (0..512).map(|_| 9)); // the second buffer is to be dropped
        } else {
            out.push(6);
            self.block(out, 0..512);
        }
    }

    fn head(&self, out: &mut Vec<u8>, version: u32) {
        if version >= 222 {
            out.extend((u32::from(self.zip) | 2).to_le_bytes());
        }
        out.extend(0u32.to_le_bytes());
        if self.frustum {
            text(out, "NonlinearFrustumMap");
            out.resize(out.len() + if version < 221 { 40 } else { 64 }, 0);
        }
        text(out, "TranslationMap");
        out.extend([1.0f64, 2.0, 3.0].iter().flat_map(|number| number.to_le_bytes()));
    }
}

fn file(version: u32, offsets: bool, grids: &[Made]) -> Vec<u8> {
    let mut out = vec![0x20, 0x42, 0x44, 0x56, 0, 0, 0, 0];
    out.extend([version, 1, 0].iter().flat_map(|number| number.to_le_bytes()));
    out.push(u8::from(offsets));
    if version < 222 {
        out.push(u8::from(grids.first().is_some_and(|grid| grid.zip)));
    }
    out.extend([b'-'; 36]);
    out.extend(0u32.to_le_bytes());
    out.extend((grids.len() as i32).to_le_bytes());
    for grid in grids {
        text(&mut out, grid.name);
        let suffix = if grid.half { "_HalfFloat" } else { "" };
        text(&mut out, &format!("{}{suffix}", grid.type_name));
        text(&mut out, grid.parent);
        let positions = out.len();
        out.extend([0; 24]);
        let start = out.len() as i64;
        grid.head(&mut out, version);
        if grid.parent.is_empty() {
            grid.tree(&mut out, version);
        }
        if offsets {
            let end = out.len() as i64;
            for (field, position) in [start, start, end].into_iter().enumerate() {
                let at = positions + 8 * field;
                out[at..at + 8].copy_from_slice(&position.to_le_bytes());
            }
        }
    }
    out
}

fn open(version: u32, offsets: bool, grids: &[Made]) -> Result<VdbFile, Error> {
    VdbFile::from_bytes("made.vdb", file(version, offsets, grids))
}

fn check(tree: &Tree<f32>, what: &str) {
    assert_eq!(tree.leaves().len(), 1, "{what}");
    for number in 0..512 {
        let ijk = [number >> 6, number >> 3 & 7, number & 7];
        assert_eq!(tree.value(ijk), (number as f32, number % 2 == 0), "{what}: {ijk:?}");
    }
    assert_eq!(tree.value([0, 0, 8]), (600.0, true), "{what}");
    assert_eq!(tree.value([0, 0, 128]), (700.0, true), "{what}");
    assert_eq!(tree.value([8, 0, 0]), (0.0, false), "{what}");
    assert_eq!(tree.tiles().len(), 2, "{what}");
}

#[test]
fn every_version_with_and_without_zip() {
    for version in 220..=225 {
        for (zip, half, offsets) in
            [(false, false, true), (true, false, false), (true, true, true), (false, true, false)]
        {
            for type_name in ["Tree_float_5_4_3", "Tree_double_5_4_3", "Tree_int32_5_4_3"] {
                if half && type_name == "Tree_int32_5_4_3" {
                    continue; // not narrowed
                }
                let made = file(version, offsets, &[Made { zip, half, type_name, ..PLAIN }]);
                let file = VdbFile::from_bytes("made.vdb", made).unwrap();
                assert_eq!(file.version(), version);
                assert_eq!(file.grids()[0].saved_as_half, half);
                let tree = file.read(0).unwrap().to_float().unwrap();
                check(&tree, &format!("{type_name} {version} zip {zip} half {half}"));
            }
        }
    }
}

#[test]
fn half_grids_of_version_225() {
    for offsets in [true, false] {
        let file = open(225, offsets, &[Made { type_name: "Tree_half_5_4_3", ..PLAIN }]).unwrap();
        assert_eq!(file.grids()[0].value_type, ValueType::Half);
        let grid = file.read(0).unwrap();
        assert!(matches!(grid.values, Values::Float(_)));
        check(&grid.to_float().unwrap(), "half grid");
    }
}

#[test]
fn other_versions_are_refused() {
    for version in [0, 219, 226, u32::MAX] {
        let error = open(version, true, &[PLAIN]).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains(&format!("version {version}")), "{error}");
    }
}

#[test]
fn every_cut_is_an_error() {
    let whole = file(224, true, &[Made { zip: true, ..PLAIN }]);
    let stream = file(221, false, &[Made { zip: true, ..PLAIN }]);
    for bytes in [whole, stream] {
        for length in 0..bytes.len() {
            let file = VdbFile::from_bytes("cut.vdb", bytes[..length].to_vec());
            let error = file.and_then(|file| file.read(0)).err();
            assert!(error.is_some(), "{length} of {} bytes", bytes.len());
        }
    }
}

#[test]
fn unknown_types_are_listed_but_not_read() {
    let points = Made { name: "points", type_name: "Tree_ptdataidx32_5_4_3", ..PLAIN };
    let file = open(224, true, &[points, PLAIN]).unwrap();
    assert_eq!(file.grids()[0].value_type, ValueType::Other);
    let error = file.read(0).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }));
    assert!(error.to_string().contains("\"points\"") && error.to_string().contains("ptdataidx32"));
    check(&file.read(1).unwrap().to_float().unwrap(), "the grid behind it");
    let points = Made { name: "points", type_name: "Tree_ptdataidx32_5_4_3", ..PLAIN };
    let error = open(224, false, &[points, PLAIN]).unwrap_err();
    assert!(error.to_string().contains("ptdataidx32"), "a stream cannot be read past it: {error}");
    assert!(matches!(file.read(2), Err(Error::Missing { .. })));
}

#[test]
fn instances_follow_their_parents() {
    let instance = |name, parent| Made { name, parent, ..PLAIN };
    for offsets in [true, false] {
        let chain = [instance("c", "b"), instance("b", "density"), PLAIN];
        let file = open(224, offsets, &chain).unwrap();
        assert_eq!(file.grids()[0].instance_of.as_deref(), Some("b"));
        check(&file.read(0).unwrap().to_float().unwrap(), "the end of the chain");
        let circle = [instance("a", "b"), instance("b", "a")];
        let file = open(224, offsets, &circle).unwrap();
        let error = file.read(0).unwrap_err().to_string();
        assert!(error.contains("circle") && error.contains("\"a\""), "{error}");
        let file = open(224, offsets, &[instance("a", "gone")]).unwrap();
        assert!(file.read(0).unwrap_err().to_string().contains("\"gone\", which is missing"));
        let double = Made { type_name: "Tree_double_5_4_3", ..instance("a", "density") };
        let file = open(224, offsets, &[PLAIN, double]).unwrap();
        assert!(file.read(1).unwrap_err().to_string().contains("has a parent of type"));
    }
}

#[test]
fn names_get_the_numbers_of_the_file() {
    let named = |name| Made { name, ..PLAIN };
    let names = |grids: &[Made]| -> Vec<String> {
        open(224, true, grids).unwrap().grids().iter().map(|grid| grid.full_name()).collect()
    };
    let grids = [named("d\x1e1"), named("d\x1e0"), named("e\x1e0")];
    assert_eq!(names(&grids), ["d[1]", "d[0]", "e"]);
    let file = open(224, true, &grids).unwrap();
    assert_eq!((file.find("d").unwrap(), file.find("d[1]").unwrap()), (1, 0));
    assert_eq!(names(&[named("d"), named("d"), named("d\x1e7")]), ["d[0]", "d[1]", "d[2]"]);
    let file = open(224, true, &[named("d[1]"), named("d\x1e0"), named("d\x1e1")]).unwrap();
    assert_eq!(file.find("d[1]").unwrap(), 0, "the whole name goes first");
    let error = open(224, true, &[]).unwrap().find("d").unwrap_err().to_string();
    assert!(error.contains("the file has no grid"), "{error}");
}

#[test]
fn frustums_are_read_over() {
    for version in [220, 221, 224] {
        let frustum = Made { frustum: true, ..PLAIN };
        let file = open(version, false, &[frustum, Made { name: "next", ..PLAIN }]).unwrap();
        let error = file.grids()[0].transform.matrix().unwrap_err();
        assert!(error.to_string().contains("made.vdb: grid \"density\""), "{error}");
        check(&file.read(0).unwrap().to_float().unwrap(), "values under a frustum");
        assert_eq!(file.grids()[1].transform.matrix().unwrap()[3], [1.0, 2.0, 3.0, 1.0]);
    }
}

#[test]
fn vectors_have_no_single_number() {
    let bytes = std::fs::read(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/data/conformance/other_types.vdb"
    ));
    let Ok(bytes) = bytes else { return }; // the crate is used outside the workspace
    let file = VdbFile::from_bytes("types.vdb", bytes).unwrap();
    let error = file.read(file.find("pos").unwrap()).unwrap().to_float().unwrap_err();
    assert!(error.to_string().contains("vec3d") && error.to_string().contains("\"pos\""));
}

#[test]
fn the_cursor_stays_inside() {
    assert_eq!(Cursor::new(&[1, 2], 5).at(99).remaining(), 0);
}
