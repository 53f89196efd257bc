//! Prints what the grids of OpenVDB files are and what is in them:
//! `cargo run --release --example list_grids -- FILE...`
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::error::Error;
use std::fmt::Debug;
use std::process::ExitCode;

use pileus_vdb::{Tree, Values, VdbFile};

fn describe<T: Copy + PartialEq + PartialOrd + Debug>(tree: &Tree<T>) -> String {
    let mut text = format!(
        "background {:?}, {} leaves, {} tiles, {} active voxels",
        tree.background(),
        tree.leaves().len(),
        tree.tiles().len(),
        tree.active_voxel_count()
    );
    if let Some((min, max)) = tree.active_bbox() {
        text += &format!(" in {min:?}..={max:?}");
    }
    if let Some((min, max)) = tree.min_max() {
        text += &format!(", values {min:?} to {max:?}");
    }
    text
}

fn list(path: &str) -> Result<(), Box<dyn Error>> {
    let file = VdbFile::open(path)?;
    let (major, minor) = file.library_version();
    println!("{path}: format {}, written by library {major}.{minor}", file.version());
    for (key, value) in file.metadata().iter() {
        println!("  {key} = {value}");
    }
    for (position, info) in file.grids().iter().enumerate() {
        let half = if info.saved_as_half { " (stored as half)" } else { "" };
        println!("  {}: {}{half}, {}", info.full_name(), info.value_type, info.class);
        if let Some(parent) = &info.instance_of {
            println!("    shares the tree of {parent}");
        }
        println!("    {:?}", info.compression);
        match info.transform.matrix() {
            Ok(matrix) => println!("    {} {matrix:?}", info.transform.kind().map_name()),
            Err(error) => println!("    {error}"),
        }
        for (key, value) in info.metadata.iter() {
            println!("    {key} = {value}");
        }
        let text = match file.read(position)?.values {
            Values::Float(tree) => describe(&tree),
            Values::Double(tree) => describe(&tree),
            Values::Int32(tree) => describe(&tree),
            Values::Int64(tree) => describe(&tree),
            Values::Bool(tree) | Values::Mask(tree) => describe(&tree),
            Values::Vec3f(tree) => describe(&tree),
            Values::Vec3d(tree) => describe(&tree),
            Values::Vec3i(tree) => describe(&tree),
        };
        println!("    {text}");
    }
    Ok(())
}

fn main() -> ExitCode {
    let mut code = ExitCode::SUCCESS;
    for path in std::env::args().skip(1) {
        if let Err(error) = list(&path) {
            eprintln!("{error}");
            code = ExitCode::FAILURE;
        }
    }
    code
}
