//! The built program with good and bad inputs.

mod agreement;
mod cameras;
#[cfg(feature = "lab")]
mod chart;
mod clamped;
mod endless;
mod errors;
mod image_files;
mod images;
mod info;
mod interrupt;
mod jobs;
mod layers;
mod others;
mod outputs;
mod probe;
mod reference;
mod terminal;
mod wishes;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// The repository.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A file of the repository as text.
fn path(name: &str) -> String {
    root().join(name).canonicalize().unwrap().to_string_lossy().into_owned()
}

/// The program, ready for arguments, without the surroundings' logging.
fn pileus(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pileus"));
    command.current_dir(folder).env_remove("RUST_LOG");
    command
}

/// Runs the program in a folder.
fn run(folder: &Path, arguments: &[&str]) -> Output {
    pileus(folder).args(arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Runs the program, which must succeed, and parses what it prints.
fn json(folder: &Path, arguments: &[&str]) -> Value {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A folder with files in it.
fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    }
    folder
}

/// A small job around a synthetic sphere.
fn sphere_job() -> Value {
    serde_json::json!({
        "volumes": [{
            "vdb": path("scenes/assets/syn_sphere.vdb"),
            "density": { "scale": 4.0 },
            "albedo": [0.9, 0.8, 0.7]
        }],
        "lights": [
            { "type": "sun", "to_light": [0.5, 0.8, -0.3], "irradiance": 3 },
            { "type": "environment", "radiance": [0.3, 0.4, 0.6] }
        ],
        "film": { "resolution": [32, 20] },
        "sampling": { "spp": 4 },
        "output": { "image": "sphere.exr" }
    })
}
