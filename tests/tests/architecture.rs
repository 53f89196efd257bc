//! The floor plan of `docs/ARCHITECTURE.md`, held against the workspace's metadata.

use cargo_metadata::{DependencyKind, MetadataCommand};
use std::collections::BTreeMap;

/// Crate, and the crates of ours that it may use.
const MAY_USE: [(&str, &[&str]); 8] = [
    ("pileus-vdb", &[]),
    ("pileus-media", &["pileus-vdb"]),
    ("pileus-scene", &["pileus-vdb", "pileus-media", "pileus-film"]),
    ("pileus-film", &[]),
    ("pileus-integrator", &["pileus-media", "pileus-scene", "pileus-film"]),
    (
        "pileus-lab",
        &["pileus-vdb", "pileus-media", "pileus-scene", "pileus-film", "pileus-integrator"],
    ),
    (
        "pileus",
        &[
            "pileus-vdb",
            "pileus-media",
            "pileus-scene",
            "pileus-film",
            "pileus-integrator",
            "pileus-lab",
        ],
    ),
    (
        "pileus-tests",
        &[
            "pileus-vdb",
            "pileus-media",
            "pileus-scene",
            "pileus-film",
            "pileus-integrator",
            "pileus-lab",
            "pileus",
        ],
    ),
];

/// External crates that only these may use: file formats and the user's interface stay in their rooms.
const ONLY: [(&str, &[&str]); 6] = [
    ("gltf", &["pileus-scene"]),
    ("exr", &["pileus-scene", "pileus-film"]),
    ("image", &["pileus-scene", "pileus-film"]),
    ("clap", &["pileus"]),
    ("indicatif", &["pileus"]),
    ("miette", &["pileus"]),
];

#[test]
fn dependencies_point_one_way() {
    let metadata = MetadataCommand::new()
        .manifest_path(pileus_tests::root().join("Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata");
    let rules: BTreeMap<&str, &[&str]> = MAY_USE.into_iter().collect();
    let packages = metadata.workspace_packages();
    assert_eq!(packages.len(), rules.len(), "a crate has no row in the floor plan");
    for package in packages {
        let name = package.name.as_str();
        let allowed = rules.get(name).unwrap_or_else(|| panic!("{name} is not in the floor plan"));
        for dependency in &package.dependencies {
            if dependency.kind != DependencyKind::Normal {
                continue;
            }
            let used = dependency.name.as_str();
            if used.starts_with("pileus") {
                assert!(allowed.contains(&used), "{name} must not use {used}");
            }
            if let Some((_, rooms)) = ONLY.iter().find(|(external, _)| *external == used) {
                assert!(rooms.contains(&name), "{name} must not use {used}");
            }
        }
    }
}

#[test]
fn top_level_is_the_floor_plan() {
    let expected = [
        "Cargo.lock",
        "Cargo.toml",
        "LICENSE-APACHE",
        "LICENSE-MIT",
        "README.md",
        "crates",
        "docs",
        "scenes",
        "tests",
    ];
    let mut found: Vec<String> = std::fs::read_dir(pileus_tests::root())
        .expect("the repository")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| !name.starts_with('.') && name != "target")
        .collect();
    found.sort();
    assert_eq!(found, expected);
}

#[test]
fn no_crate_uses_unsafe_code() {
    for krate in ["vdb", "media", "scene", "film", "integrator", "lab", "pileus"] {
        let path = pileus_tests::root().join("crates").join(krate).join("src/lib.rs");
        let text = std::fs::read_to_string(&path).expect("a crate root");
        assert!(text.contains("#![forbid(unsafe_code)]"), "{} allows unsafe code", path.display());
    }
}
