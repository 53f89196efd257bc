//! Files as others write and name them, from the command line.

use serde_json::json;

use crate::{folder, json, path, root, run, stderr};

const SIZE: [&str; 4] = ["--resolution", "8x8", "--spp", "16"];

/// A scene of two cameras and one before them that shows nothing.
fn cameras() -> String {
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2, 3]}],
        "nodes": [
            {"camera": 0, "name": "Above"},
            {"camera": 1, "name": "Back", "translation": [0, 0, 5]},
            {"camera": 1, "name": "Camera", "translation": [0, 0, 3]},
            {"extensions": {"PILEUS_volume":
                {"homogeneous": {"sigma_t": 1, "bounds": [[-1, -1, -1], [1, 1, 1]]}}}},
        ],
        "cameras": [
            {"type": "orthographic",
                "orthographic": {"xmag": 1.0, "ymag": 0.0, "znear": 0.0, "zfar": 9.0}},
            {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}},
        ],
    })
    .to_string()
}

#[test]
fn cameras_are_chosen_by_name() {
    let folder = folder(&[("shot.gltf", &cameras()), ("job.json", r#"{"scene": "shot.gltf"}"#)]);
    for input in ["shot.gltf", "job.json"] {
        let output = run(folder.path(), &["check", input]);
        assert!(output.status.success(), "{}", stderr(&output));
        let log = stderr(&output);
        assert!(log.contains("`Back` is taken, the first of 3"), "{log}");
        assert!(log.contains("passed over: `Above`"), "{log}");
        let output = run(folder.path(), &["check", input, "--camera", "Camera"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let output = run(folder.path(), &["check", input, "--camera", "camera"]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(stderr(&output).contains("`Above`, `Back`, `Camera`"), "{}", stderr(&output));
        let output = run(folder.path(), &["check", input, "--camera", "Above"]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(stderr(&output).contains("a ymag of 0"), "{}", stderr(&output));
    }
    let plan =
        |camera: &str| json(folder.path(), &["plan", "shot.gltf", "--json", "--camera", camera]);
    assert_eq!(plan("Back")["kernel"], plan("Camera")["kernel"]);
}

#[test]
fn hidden_and_instanced_things_are_drawn_so() {
    let data = "AADAvwAAAAAAAAAAAADAPwAAAAAAAAAA";
    let scene = |visible: bool, instanced: bool| {
        let mut extensions = json!({
            "PILEUS_volume": {
                "homogeneous": {"sigma_t": 50.0, "bounds": [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]},
                "albedo": 0.0,
            },
            "KHR_node_visibility": {"visible": visible},
        });
        if instanced {
            extensions["EXT_mesh_gpu_instancing"] = json!({"attributes": {"TRANSLATION": 0.0}});
        }
        json!({
            "asset": {"version": "2.0"},
            "scene": 0.0,
            "scenes": [{"nodes": [0.0, 1.0]}],
            "nodes": [
                {"camera": 0.0, "translation": [0.0, 0.0, 20.0]},
                {"extensions": extensions},
            ],
            "cameras": [{"type": "perspective", "perspective":
                {"yfov": 0.5, "znear": 0.1, "aspectRatio": 1.0}}],
            "accessors": [{"bufferView": 0.0, "componentType": 5126.0, "count": 2.0, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0.0, "byteLength": 24.0}],
            "buffers": [{"byteLength": 24.0, "uri": format!("data:;base64,{data}")}],
        })
        .to_string()
    };
    let job = r#"{"scene": "a.gltf", "lights": [{"type": "environment", "radiance": 1}],
        "film": {"resolution": [8, 8]}, "sampling": {"spp": 256}}"#;
    // Black boxes before a sky of 1: how many pixels' worth of it is missing. The camera sees
    // 2 x 19 tan(0.25) = 9.7 units where the boxes of 2 units begin, so that one covers
    // (8 x 2 / 9.7)^2 = 2.7 pixels, and two at 1.5 to the sides 5.4 and something of their sides.
    // Each pixel has an error of sqrt(0.25 / 256) = 0.03 at most, 64 together of 0.25.
    for (visible, instanced, range) in [
        (true, false, 2.0..3.4),
        (true, true, 4.8..7.5),
        (false, false, 0.0..1e-6),
        (false, true, 0.0..1e-6),
    ] {
        let folder = folder(&[("a.gltf", &scene(visible, instanced)), ("job.json", job)]);
        let output = run(folder.path(), &["render", "job.json"]);
        assert!(output.status.success(), "{}", stderr(&output));
        let image = pileus_film::read_exr(&folder.path().join("job.exr")).unwrap();
        let values = image.channel("R").unwrap();
        let dark: f64 = values.iter().map(|&value| 1.0 - f64::from(value)).sum();
        assert!(range.contains(&dark.max(0.0)), "{visible} {instanced}: {dark}");
    }
}

#[test]
fn names_with_hashes_are_names_and_runs_of_any_length_are_no_panic() {
    let sphere = std::fs::read(root().join("tests/data/conformance/single_voxel.vdb")).unwrap();
    let folder = folder(&[("take#2/job.json", r##"{"volumes": [{"vdb": "a#1.vdb"}]}"##)]);
    for name in ["take#2/a#1.vdb", "b##.vdb", "take#2/frame_07.vdb"] {
        std::fs::write(folder.path().join(name), &sphere).unwrap();
    }
    std::fs::write(
        folder.path().join("take#2/frame.json"),
        r###"{"volumes": [{"vdb": "frame_##.vdb", "frame": 7.0}]}"###,
    )
    .unwrap();
    for name in ["b##.vdb", "take#2/a#1.vdb", "take#2/job.json", "take#2/frame.json"] {
        let output = run(folder.path(), &["check", name]);
        assert!(output.status.success(), "{name}: {}", stderr(&output));
    }
    let long = "#".repeat(70_000);
    let job = json!({"volumes": [{"vdb": long, "frame": 1}]}).to_string();
    std::fs::write(folder.path().join("long.json"), job).unwrap();
    let output = run(folder.path(), &["check", "long.json"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let output = run(folder.path(), &["check", "none#.vdb"]);
    assert!(stderr(&output).contains("does not exist"), "{}", stderr(&output));
}

#[test]
fn files_rendered_without_a_job_say_what_was_taken() {
    let folder = folder(&[]);
    let output = run(folder.path(), &["render", &path("tests/data/conformance/empty_grid.vdb")]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(stderr(&output).contains("is empty"), "{}", stderr(&output));

    let output = run(folder.path(), &["check", &path("tests/data/conformance/names_same.vdb")]);
    assert!(stderr(&output).contains("3 grids are named `density`"), "{}", stderr(&output));
    let output = run(folder.path(), &["check", &path("scenes/assets/smoke_plume.vdb")]);
    assert!(stderr(&output).contains("`--up-axis z`"), "{}", stderr(&output));

    let mut arguments = vec!["render"];
    let fire = path("scenes/assets/fire_0003.vdb");
    arguments.extend([fire.as_str(), "--up-axis", "z"]);
    arguments.extend(SIZE);
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("grid `flame` burns"), "{}", stderr(&output));
    // There is no other light, and the fire is red.
    let image = pileus_film::read_exr(&folder.path().join("fire_0003.exr")).unwrap();
    let [red, green, blue] = ["R", "G", "B"].map(|name| {
        let plane = image.channel(name).unwrap();
        plane.iter().map(|&value| f64::from(value)).sum::<f64>() / plane.len() as f64
    });
    assert!(red > 1.5 * green && green > blue, "{red} {green} {blue}");
    assert!(red > 0.05, "{red}");
}
