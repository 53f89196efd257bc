//! `pileus info`, `plan` and `check`.

use serde_json::Value;

use crate::{folder, json, path, run, sphere_job, stderr};

#[test]
fn openvdb_files_are_described_as_openvdb_sees_them() {
    let here = tempfile::tempdir().unwrap();
    for name in [
        "multi",
        "names_same",
        "nan_inf_negative",
        "affine_rotated",
        "frustum",
        "mask_grid",
        "metadata",
        "root_tile",
    ] {
        let info = json(
            here.path(),
            &["info", &path(&format!("tests/data/conformance/{name}.vdb")), "--json"],
        );
        let text =
            std::fs::read_to_string(path(&format!("tests/data/conformance/{name}.json"))).unwrap();
        let expected: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(info["file_version"], expected["file_format_version"]);
        let grids = info["grids"].as_array().unwrap();
        let wanted = expected["grids"].as_array().unwrap();
        assert_eq!(grids.len(), wanted.len());
        for grid in grids {
            let same = |w: &&Value| {
                w["name"] == grid["name"] && w["active_voxel_count"] == grid["active_voxels"]
            };
            let wanted = wanted.iter().find(same).unwrap_or_else(|| panic!("{name}: {grid}"));
            for (ours, theirs) in [
                ("type", "type"),
                ("class", "grid_class"),
                ("half", "saved_as_half"),
                ("bbox", "active_bbox"),
            ] {
                if !wanted[theirs].is_null() {
                    assert_eq!(grid[ours], wanted[theirs], "{name} {ours}");
                }
            }
            for key in ["min", "max", "background"] {
                match (grid[key].as_f64(), wanted[key].as_f64()) {
                    (Some(a), Some(b)) => {
                        assert!((a - b).abs() <= 1e-6 * b.abs(), "{name} {key} {a} {b}")
                    }
                    (None, None) if wanted[key].is_string() => assert_eq!(grid[key], wanted[key]),
                    _ => {}
                }
            }
            assert_eq!(grid["transform"]["kind"], wanted["transform"]["type"]);
            if let Some(matrix) = grid["transform"]["matrix"].as_array() {
                let rows = wanted["transform"]["matrix_row_vector"].as_array().unwrap();
                let rows = rows.iter().flat_map(|row| row.as_array().unwrap());
                assert_eq!(matrix.len(), 16);
                for (a, b) in matrix.iter().zip(rows) {
                    assert!((a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-12);
                }
            }
            assert!(grid["metadata"].is_object());
        }
    }
}

#[test]
fn the_render_grid_is_measured() {
    let here = tempfile::tempdir().unwrap();
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let info = json(here.path(), &["info", &sphere, "--json"]);
    let built = &info["render_grid"];
    assert_eq!(built["grid"], "density");
    assert!(built["build_seconds"].as_f64().unwrap() > 0.0);
    let per_voxel = built["bytes_per_voxel"].as_f64().unwrap();
    assert!((1.0..16.0).contains(&per_voxel), "{per_voxel}");
    let text = run(here.path(), &["info", &sphere]).stdout;
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("bytes per stored voxel") && text.contains("built in"), "{text}");
}

#[test]
fn scenes_are_described() {
    let here = tempfile::tempdir().unwrap();
    let info = json(here.path(), &["info", &path("tests/data/gltf/studio.gltf"), "--json"]);
    assert_eq!(info["lights"].as_array().unwrap().len(), 3);
    assert_eq!(info["cameras"][0]["node"], "Camera");
    assert_eq!(info["volumes"][0]["node"], "smoke");
    assert_eq!(info["volumes"][0]["volume"]["density"]["scale"], 8.0);
    assert_eq!(info["counts"]["meshes"], 5);
    assert_eq!(info["not_modelled"].as_array().unwrap().len(), 0);
    let fire = json(here.path(), &["info", &path("tests/data/gltf/fire.glb"), "--json"]);
    assert_eq!(fire["not_modelled"].as_array().unwrap().len(), 0);
    assert_eq!(fire["volumes"][0]["volume"]["emission"]["grid"], "flame");
}

#[test]
fn jobs_are_described_checked_and_planned() {
    let folder = folder(&[("job.json", &sphere_job().to_string())]);
    let info = json(folder.path(), &["info", "job.json", "--json"]);
    assert_eq!(info["samples"], 4);
    assert_eq!(info["files"][0]["exists"], true);
    assert_eq!(info["outputs"]["stats"], "sphere.stats.json");

    let check = run(folder.path(), &["check", "job.json"]);
    assert_eq!(check.status.code(), Some(0), "{}", stderr(&check));
    assert!(String::from_utf8(check.stdout).unwrap().contains("32 x 20 pixels, 4 samples"));
    assert!(!folder.path().join("sphere.exr").exists());

    let plan = json(folder.path(), &["plan", "job.json", "--json"]);
    assert_eq!(plan["transmittance"], "ratio");
    assert!(!plan["reasons"].as_array().unwrap().is_empty());
    let text = run(folder.path(), &["plan", "job.json"]).stdout;
    assert!(String::from_utf8(text).unwrap().contains("because"));
}

#[test]
fn quiet_is_silent_and_the_default_sky_is_said() {
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let here = tempfile::tempdir().unwrap();
    let loud = run(here.path(), &["plan", &sphere]);
    let said = stderr(&loud);
    assert!(said.contains("default sky") && said.contains("looks like a cloud"), "{said}");
    let quiet = run(here.path(), &["-q", "plan", &sphere]);
    assert!(quiet.status.success() && quiet.stderr.is_empty());
}
