//! The floor plan of `docs/ARCHITECTURE.md`, held against the workspace's metadata.

use cargo_metadata::{DependencyKind, MetadataCommand};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

/// Crate, and the crates of ours that it may use.
const MAY_USE: [(&str, &[&str]); 9] = [
    ("pileus-math", &[]),
    ("pileus-vdb", &[]),
    ("pileus-media", &["pileus-math", "pileus-vdb"]),
    ("pileus-scene", &["pileus-math", "pileus-vdb", "pileus-media", "pileus-film"]),
    ("pileus-film", &[]),
    ("pileus-integrator", &["pileus-math", "pileus-media", "pileus-scene", "pileus-film"]),
    (
        "pileus-lab",
        &[
            "pileus-math",
            "pileus-vdb",
            "pileus-media",
            "pileus-scene",
            "pileus-film",
            "pileus-integrator",
        ],
    ),
    (
        "pileus",
        &[
            "pileus-math",
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
            "pileus-math",
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

/// External crates that only these may use: file formats and the user's interface stay in their
/// rooms.
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

/// The other VDB reader is what tests compare with: no crate turns it on, and without being asked
/// for it is no part of what is built.
#[test]
fn the_program_has_one_vdb_reader() {
    let metadata = MetadataCommand::new()
        .manifest_path(pileus_tests::root().join("Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata");
    for package in metadata.workspace_packages() {
        let name = package.name.as_str();
        let features = package.features.get("default").into_iter().flatten();
        let turned_on = package.dependencies.iter().flat_map(|d| &d.features).chain(features);
        assert!(turned_on.into_iter().all(|feature| !feature.contains("vdb-rs")), "{name}");
        for dependency in package.dependencies.iter().filter(|d| d.name == "vdb-rs") {
            let tests_alone = dependency.kind == DependencyKind::Development;
            let for_those_who_ask = dependency.optional && name == "pileus-vdb";
            assert!(tests_alone || for_those_who_ask, "{name} must not use vdb-rs");
        }
    }
}

/// What stands at the top of the repository, besides hidden files.
const TOP: [&str; 10] = [
    "Cargo.lock",
    "Cargo.toml",
    "LICENSE-APACHE",
    "LICENSE-MIT",
    "README.md",
    "crates",
    "docs",
    "findings",
    "scenes",
    "tests",
];

/// What git tracks at the top of a checkout, sorted; `None` where there is no git or no checkout.
fn tracked(root: &Path) -> Option<Vec<String>> {
    let git = |arguments: &[&str]| -> Option<String> {
        let output = Command::new("git").current_dir(root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8(output.stdout).ok())?
    };
    // An archive may be unpacked inside of a repository of something else.
    let top = git(&["rev-parse", "--show-toplevel"])?;
    if std::fs::canonicalize(top.trim_end()).ok()? != std::fs::canonicalize(root).ok()? {
        return None;
    }
    let files = git(&["ls-files", "-z"])?;
    let mut names: Vec<String> = files
        .split('\0')
        .filter_map(|file| file.split('/').next())
        .filter(|name| !name.is_empty() && !name.starts_with('.'))
        .map(str::to_owned)
        .collect();
    names.sort();
    names.dedup();
    Some(names)
}

/// The files of users, pictures that the README's first command writes among them, are not part of
/// the plan: what git tracks is. In an unpacked archive all of the plan must be there.
#[test]
fn top_level_is_the_floor_plan() {
    let root = pileus_tests::root();
    match tracked(&root) {
        Some(names) => assert_eq!(names, TOP),
        None => {
            for name in TOP {
                assert!(root.join(name).exists(), "{name} is missing");
            }
        }
    }
}

#[test]
fn files_of_users_are_not_part_of_the_plan() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    assert_eq!(tracked(here), None);
    let git = |arguments: &[&str]| {
        let output = Command::new("git").current_dir(here).args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    };
    if !git(&["init", "--quiet"]) {
        return;
    }
    std::fs::create_dir(here.join("crates")).expect("a folder");
    for name in ["README.md", "crates/a.rs", ".gitignore", "cumulus.exr", "cumulus.stats.json"] {
        std::fs::write(here.join(name), "").expect("a file");
    }
    assert!(git(&["add", "README.md", "crates", ".gitignore"]));
    assert_eq!(tracked(here), Some(vec!["README.md".to_owned(), "crates".to_owned()]));
    // A folder of the checkout is not the checkout.
    assert_eq!(tracked(&here.join("crates")), None);
}

#[test]
fn no_crate_uses_unsafe_code() {
    for krate in ["vdb", "media", "scene", "film", "integrator", "lab", "pileus"] {
        let path = pileus_tests::root().join("crates").join(krate).join("src/lib.rs");
        let text = std::fs::read_to_string(&path).expect("a crate root");
        assert!(text.contains("#![forbid(unsafe_code)]"), "{} allows unsafe code", path.display());
    }
}
