//! Cameras of jobs: their errors, what is remembered of them, and the command line.

use std::path::Path;

use pileus_film::{Image, MetaValue, read_exr};
use serde_json::{Value, json};

use crate::{folder, json, run, sphere_job, stderr};

fn render(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

/// A small job of a sphere with this camera.
fn job(camera: Value) -> String {
    let mut job = sphere_job();
    job["camera"] = camera;
    job.to_string()
}

fn check(camera: Value) -> (Option<i32>, String) {
    let folder = folder(&[("job.json", &job(camera))]);
    let output = run(folder.path(), &["check", "job.json"]);
    (output.status.code(), stderr(&output))
}

/// A scene with an orthographic camera, one of perspective, and a volume.
fn shot() -> String {
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"camera": 0, "name": "Flat", "translation": [0.3, 0.7, 5.1],
                "rotation": [0.1, 0.2, 0.3, 0.927_361_849_549_570_3]},
            {"camera": 1, "name": "Deep", "translation": [0, 0, 5]},
            {"extensions": {"PILEUS_volume":
                {"homogeneous": {"sigma_t": 1, "bounds": [[-1, -1, -1], [1, 1, 1]]}}}},
        ],
        "cameras": [
            {"type": "orthographic",
                "orthographic": {"xmag": 2.0, "ymag": 1.5, "znear": 0.0, "zfar": 9.0}},
            {"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}},
        ],
    })
    .to_string()
}

#[test]
fn wrong_cameras_are_named_with_place_and_remedy() {
    let placed = |mut keys: Value| {
        keys["position"] = json!([0, 0, 90]);
        keys["look_at"] = json!([0, 0, 0]);
        keys
    };
    for (camera, place, said) in [
        (placed(json!({"aperture": -0.1})), "/camera/aperture", "-0.1"),
        (placed(json!({"aperture": 1, "focus_on": [0, 0, 91]})), "/camera/focus_on", "focus"),
        (placed(json!({"aperture": 1, "focus_distance": -2})), "/camera/focus_distance", "-2"),
        (placed(json!({"aperture": 1, "focus_distance": 0})), "/camera/focus_distance", "0"),
        (placed(json!({"aperture": 1, "blades": 1})), "/camera/blades", "no area"),
        (placed(json!({"aperture": 1, "blades": 2})), "/camera/blades", "no area"),
        (placed(json!({"type": "orthographic", "height": 0})), "/camera/height", "0"),
        (placed(json!({"type": "orthographic"})), "/camera", "`height`"),
        (placed(json!({"type": "orthographic", "height": 1, "fov_y": 9})), "/camera", "`fov_y`"),
        (placed(json!({"type": "panorama", "fov_y": 9})), "/camera", "`fov_y`"),
        (placed(json!({"type": "panorama", "aperture": 9})), "/camera", "no lens"),
        (placed(json!({"type": "fisheye"})), "/camera/type", "panorama"),
        (placed(json!({"height": 9})), "/camera", "orthographic"),
        (placed(json!({"blades": 5})), "/camera", "no aperture"),
        (json!({"type": "panorama"}), "/camera", "no place"),
        (json!({"aperture": 1}), "/camera", "focused on"),
    ] {
        let (code, log) = check(camera.clone());
        assert_eq!(code, Some(3), "{camera}: {log}");
        assert!(log.contains(&format!("({place})")) && log.contains(said), "{camera}: {log}");
        assert!(log.contains("job.json:") && log.contains("help: "), "{camera}: {log}");
    }
}

fn pixels(image: &Image) -> [&[f32]; 4] {
    ["R", "G", "B", "A"].map(|name| image.channel(name).unwrap())
}

/// The job that a picture remembers, and the one that is saved, render it again bit for bit:
/// whatever placed the camera, and with which lens.
#[test]
fn remembered_cameras_render_the_same_picture() {
    let scene = |camera: Value| {
        json!({"scene": "shot.gltf", "camera": camera, "film": {"resolution": [24, 16]},
            "sampling": {"spp": 4}, "output": {"image": "a.exr"}})
        .to_string()
    };
    let lens = json!({"aperture": 0.3, "focus_on": [0.1, 0.2, 0.5], "blades": 7});
    let alone = {
        let mut job: Value = serde_json::from_str(&scene(json!(null))).unwrap();
        job.as_object_mut().unwrap().remove("camera");
        job.to_string()
    };
    let framed = |camera: Value| job(camera).replace("sphere.exr", "a.exr");
    for text in [
        alone,
        scene(lens.clone()),
        scene(json!({"node": "Deep", "aperture": 0.2, "focus_distance": 4.5})),
        scene(json!({"position": [1, 2, 3], "look_at": [0, 0, 0.1], "aperture": 0.4})),
        scene(json!({"type": "panorama", "position": [1, 2, 3], "look_at": [0, 0, 0.1]})),
        scene(json!({"type": "orthographic"})),
        framed(json!({"type": "orthographic", "aperture": 3, "focus_on": [0, 0, 1]})),
        framed(json!({"type": "orthographic", "height": 70})),
        framed(json!({"fov_y": 50, "aperture": 3, "focus_on": [0, 0, 1]})),
    ] {
        let folder = folder(&[("shot.gltf", &shot()), ("job.json", &text)]);
        let here = folder.path();
        render(here, &["render", "job.json", "-o", "a.exr", "--save-job", "saved.json"]);
        let first = read_exr(&here.join("a.exr")).unwrap();
        render(here, &["render", "saved.json", "-o", "b.exr"]);
        let Some(MetaValue::Text(remembered)) = first.meta("pileus:job") else { panic!("no job") };
        std::fs::write(here.join("remembered.json"), remembered).unwrap();
        render(here, &["render", "remembered.json", "-o", "c.exr"]);
        for again in ["b.exr", "c.exr"] {
            let again = read_exr(&here.join(again)).unwrap();
            assert_eq!(pixels(&first), pixels(&again), "{text}");
        }
        let saved: Value =
            serde_json::from_str(&std::fs::read_to_string(here.join("saved.json")).unwrap())
                .unwrap();
        let camera = &saved["camera"];
        assert!(camera["position"].is_array() || camera["node"].is_string(), "{camera}");
    }
}

#[test]
fn the_command_line_keeps_the_lens() {
    let text = json!({"scene": "shot.gltf", "film": {"resolution": [24, 16]},
        "camera": {"position": [1, 2, 3], "look_at": [0, 0, 0.5], "aperture": 0.4, "blades": 5}});
    let folder = folder(&[("shot.gltf", &shot()), ("job.json", &text.to_string())]);
    let arguments = ["render", "job.json", "--camera", "Deep", "--spp", "1", "-o", "a.exr"];
    render(folder.path(), &[&arguments[..], &["--save-job", "saved.json"]].concat());
    let saved = std::fs::read_to_string(folder.path().join("saved.json")).unwrap();
    let saved: Value = serde_json::from_str(&saved).unwrap();
    let expected =
        json!({"node": "Deep", "aperture": 0.4, "focus_on": [0.0, 0.0, 0.5], "blades": 5});
    assert_eq!(saved["camera"], expected);
}

#[test]
fn orthographic_cameras_of_gltf_are_described_and_taken() {
    let folder = folder(&[("shot.gltf", &shot())]);
    let info = json(folder.path(), &["info", "shot.gltf", "--json"]);
    assert_eq!(info["cameras"][0]["type"], "orthographic");
    assert_eq!(info["cameras"][0]["height"], 3.0);
    assert_eq!(info["cameras"][1]["type"], "perspective");
    let output = run(folder.path(), &["info", "shot.gltf"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("camera `Flat`: orthographic, 3.0000 high"), "{text}");
    let output = run(folder.path(), &["check", "shot.gltf"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("640 x 480 pixels"), "{text}");
    assert!(stderr(&output).contains("`Flat` is taken"), "{}", stderr(&output));
}
