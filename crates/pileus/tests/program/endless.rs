//! Scenes whose paths would not end, pictures that would be black, and what stops a render.

use std::path::Path;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use pileus_film::{ExrSettings, Image, MetaValue, read_exr, write_exr};
use serde_json::{Value, json};

use crate::{folder, pileus, run, sphere_job, stderr};

/// Seconds after which a program that should have ended is taken to hang.
const PATIENCE: u64 = 60;

/// Waits for a program to end, and kills it where it does not.
fn within(mut child: Child, seconds: u64) -> Output {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(seconds) {
        if child.try_wait().unwrap().is_some() {
            return child.wait_with_output().unwrap();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    panic!("no end after {seconds} s: {:?}", child.wait_with_output());
}

/// Runs the program, which has to end; its exit code and what it said.
fn ends(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let mut command = pileus(folder);
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    let output = within(command.spawn().unwrap(), PATIENCE);
    let said = stderr(&output) + &String::from_utf8_lossy(&output.stdout);
    (output.status.code().unwrap_or(-1), said)
}

/// What `check` and `render` say of a job, with their exit codes, which have to be equal.
fn checked_and_rendered(job: &Value) -> (i32, String, String) {
    let folder = folder(&[("job.json", &job.to_string())]);
    let (check, said) = ends(folder.path(), &["check", "job.json"]);
    let (render, log) = ends(folder.path(), &["render", "job.json"]);
    assert_eq!(check, render, "{said}\n{log}");
    (check, said, log)
}

/// A picture of 4 x 4 pixels along -z, whose middle ray is the axis.
fn small(volumes: Value, lights: Value) -> Value {
    json!({
        "volumes": volumes,
        "camera": { "position": [0, 0, 5], "look_at": [0, 0, 0], "fov_y": 2 },
        "lights": lights,
        "film": { "resolution": [4, 4] },
        "sampling": { "spp": 2 },
        "output": { "image": "out.exr" }
    })
}

fn white() -> Value {
    json!([{ "type": "environment", "radiance": 1 }])
}

fn fog(sigma_t: f64, albedo: Value) -> Value {
    json!({ "name": "mist", "homogeneous": { "sigma_t": sigma_t }, "albedo": albedo })
}

fn means(folder: &Path) -> [f64; 3] {
    let image = read_exr(&folder.join("out.exr")).unwrap();
    ["R", "G", "B"].map(|name| {
        let plane = image.channel(name).unwrap();
        plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64
    })
}

fn text(image: &Image, name: &str) -> String {
    match image.meta(name) {
        Some(MetaValue::Text(text)) => text.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

fn stats(folder: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("out.stats.json")).unwrap()).unwrap()
}

#[test]
fn fog_without_end_that_absorbs_nothing_is_refused() {
    let sphere = sphere_job()["volumes"][0].clone();
    let colour = |extinction: Value, albedo: Value| json!({ "name": "mist", "homogeneous": { "sigma_t": 0.2 }, "extinction": extinction, "albedo": albedo });
    for (volumes, refused) in [
        (json!([fog(0.2, json!(1))]), Some("albedo 1)")),
        (json!([fog(1e-9, json!(1))]), Some("albedo 1)")),
        (json!([fog(0.2, json!([0.9, 1, 1]))]), Some("green and blue")),
        // A cloud that absorbs is finite: most walks in space never find it again.
        (json!([fog(0.2, json!(1)), sphere]), Some("`mist`")),
        (json!([colour(json!([1, 0, 0.5]), json!([1, 1, 0.9]))]), Some("in red)")),
        // Channels in which nothing is scattered do not count.
        (json!([colour(json!([0, 1, 1]), json!([1, 0.9, 0.9]))]), None),
        (json!([fog(0.2, json!(1)), fog(0.01, json!(0.5))]), None),
        (json!([fog(0.0, json!(1))]), None),
        (
            json!([{ "homogeneous": { "sigma_t": 2, "bounds": [[-1, -1, -1], [1, 1, 1]] }, "albedo": 1 }]),
            None,
        ),
    ] {
        let (code, said, log) = checked_and_rendered(&small(volumes.clone(), white()));
        match refused {
            Some(why) => {
                assert_eq!(code, 3, "{volumes}: {said}");
                for said in [&said, &log] {
                    assert!(said.contains(why) && said.contains("`mist`"), "{volumes}: {said}");
                    assert!(said.contains("bounds, or an albedo below 1"), "{said}");
                }
            }
            None => assert_eq!(code, 0, "{volumes}: {said} {log}"),
        }
    }
    let mut limited = small(json!([fog(0.2, json!(1))]), white());
    limited["sampling"]["max_bounces"] = 8.into();
    let (code, _, log) = checked_and_rendered(&limited);
    assert_eq!(code, 0, "{log}");
}

/// Extinction that differs by eight orders: by the strongest channel's collisions a flight of the
/// weakest would take 1e8 of them.
#[test]
fn channels_that_differ_by_orders_end() {
    let uneven = |homogeneous: Value| json!({ "homogeneous": homogeneous, "extinction": [1, 1e-4, 1e-8], "albedo": 0.9 });
    let mut sphere = sphere_job()["volumes"][0].clone();
    sphere["law"] = json!({ "type": "power", "k": 2 });
    for volumes in [
        json!([uneven(json!({ "sigma_t": 1 }))]),
        json!([uneven(json!({ "sigma_t": 1 })), sphere_job()["volumes"][0]]),
        json!([uneven(json!({ "sigma_t": 1 })), sphere]),
        json!([uneven(json!({ "sigma_t": 1 })), fog(1e-9, json!(0.5))]),
        json!([uneven(json!({ "sigma_t": 1, "bounds": [[-1e9, -1e9, -1e9], [1e9, 1e9, 1e9]] }))]),
    ] {
        for lights in [white(), sphere_job()["lights"].clone()] {
            let (code, said, log) = checked_and_rendered(&small(volumes.clone(), lights));
            assert_eq!(code, 0, "{volumes}: {said} {log}");
        }
    }
}

/// The same in closed form: what passes a slab that absorbs, and a furnace, a slab that absorbs
/// nothing in light of one from all around, which is one everywhere. The furnace mixes legs that
/// are walked (across the slab) with those that are not (along it), and is lit by an image, so that
/// shadow rays and paths are weighted against each other. Null hypothesis: means are exact. Their
/// errors are estimated from 64 independent means; |z| < 6 on 6 means, false alarm 1e-7 (t with 63
/// degrees of freedom). It sees a bias of some 2 %.
#[test]
fn channels_that_differ_by_orders_are_exact() {
    let slab = |albedo: f64| {
        json!([{
            "homogeneous": { "sigma_t": 1, "bounds": [[-1000, -1, -1000], [1000, 1, 1000]] },
            "extinction": [1, 1e-3, 1e-4],
            "albedo": albedo
        }])
    };
    let mut job = small(slab(0.0), white());
    job["camera"] = json!({ "position": [0, 0, 2000], "look_at": [0, 0, 0], "fov_y": 0.01 });
    let absorbed = folder(&[("job.json", &job.to_string())]);
    assert_eq!(ends(absorbed.path(), &["render", "job.json", "--spp", "4096"]).0, 0);
    // 65536 paths, of which a share of exp(-depth) passes; z below 6.
    for (found, depth) in means(absorbed.path()).into_iter().zip([2000.0, 2.0, 0.2f64]) {
        let exact = (-depth).exp();
        let error = (3.0 * exact / 65536.0).sqrt();
        assert!((found - exact).abs() < 6.0 * error + 1e-6, "{found} {exact}");
    }

    let mut job = small(slab(1.0), json!([{ "type": "environment", "image": "white.exr" }]));
    job["camera"] = json!({ "position": [0, 0, 0], "look_at": [1, 0.0, 0], "fov_y": 40 });
    job["film"]["resolution"] = json!([8, 8]);
    let furnace = folder(&[("job.json", &job.to_string())]);
    let mut image = Image::new(4, 2, &["R", "G", "B"]).unwrap();
    for name in ["R", "G", "B"] {
        image.channel_mut(name).unwrap().fill(1.0);
    }
    write_exr(&furnace.path().join("white.exr"), &image, &ExrSettings::default()).unwrap();
    let (code, log) = ends(furnace.path(), &["render", "job.json", "--spp", "2048"]);
    assert_eq!(code, 0, "{log}");
    let image = read_exr(&furnace.path().join("out.exr")).unwrap();
    for name in ["R", "G", "B"] {
        let values: Vec<f64> = image.channel(name).unwrap().iter().map(|v| f64::from(*v)).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let error = (variance / n).sqrt();
        assert!((mean - 1.0).abs() < 6.0 * error + 1e-5 && error < 0.01, "{name} {mean} ± {error}");
    }
}

#[test]
fn black_pictures_are_warned_of() {
    let sphere = sphere_job()["volumes"][0].clone();
    let sun = json!({ "type": "sun", "to_light": [0, 1, 0], "irradiance": 3 });
    let point = json!({ "type": "point", "position": [0, 2, 0], "intensity": 5 });
    let red = json!({ "name": "mist", "homogeneous": { "sigma_t": 0.1 }, "extinction": [1, 0, 0], "albedo": 0.5 });
    let away = |mut job: Value| {
        job["camera"]["look_at"] = json!([0, 0, 90]);
        job
    };
    for (job, expected) in [
        (
            small(
                json!([fog(0.01, json!(0.9)), sphere]),
                json!([sun, { "type": "environment", "radiance": 1 }]),
            ),
            Some("the picture is black"),
        ),
        (
            small(json!([fog(0.01, json!(0.9))]), json!([{ "type": "sky", "elevation": 30 }])),
            Some("no light of a sun, a sky"),
        ),
        (
            small(json!([fog(0.01, json!(0.9))]), json!([sun, point])),
            Some("what else shines lights the scene alone"),
        ),
        (small(json!([red]), white()), Some("no red light")),
        (
            small(json!([sphere]), json!([{ "type": "environment", "radiance": 0 }])),
            Some("nothing shines"),
        ),
        (
            away(small(json!([sphere]), white())),
            Some("no volume and no surface lies in the picture"),
        ),
        (small(json!([fog(0.01, json!(0.9))]), json!([point])), None),
        (small(json!([sphere]), white()), None),
        (away(small(json!([fog(0.01, json!(0.9))]), json!([point]))), None),
    ] {
        let folder = folder(&[("job.json", &job.to_string())]);
        for command in ["check", "plan", "render"] {
            let (code, said) = ends(folder.path(), &[command, "job.json"]);
            assert_eq!(code, 0, "{command} {job}: {said}");
            let warned = said.contains("WARN");
            match expected {
                Some(expected) => {
                    assert!(warned && said.contains(expected), "{command} {job}: {said}");
                }
                None => assert!(!warned, "{command} {job}: {said}"),
            }
            if command == "plan" {
                assert_eq!(said.contains("warning        "), expected.is_some(), "{said}");
            }
        }
        let warnings = stats(folder.path())["plan"]["warnings"].to_string();
        assert!(warnings.contains(expected.unwrap_or("")), "{warnings}");
        let image = read_exr(&folder.path().join("out.exr")).unwrap();
        assert_eq!(text(&image, "pileus:warnings").is_empty(), expected.is_none());
        if expected.is_some_and(|e| e.contains("black") || e.contains("shines:")) {
            assert_eq!(means(folder.path()), [0.0; 3]);
        }
    }
}

/// A glTF scene with boxes of the given materials, corners and names.
fn boxes(boxes: &[(&str, Value, [f32; 3], [f32; 3])]) -> (Value, Vec<u8>) {
    // Faces of the unit cube, counter-clockwise seen from outside.
    let faces: [u32; 36] = [
        0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6,
        1, 3, 5, 3, 7, 5,
    ];
    let mut bin: Vec<u8> = faces.iter().flat_map(|i| i.to_le_bytes()).collect();
    let (mut accessors, mut views) = (
        vec![json!({ "bufferView": 0, "componentType": 5125, "count": 36, "type": "SCALAR" })],
        vec![json!({ "buffer": 0, "byteOffset": 0, "byteLength": 144 })],
    );
    let (mut meshes, mut nodes, mut materials) = (vec![], vec![], vec![]);
    for (i, (name, material, low, high)) in boxes.iter().enumerate() {
        views.push(json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": 96 }));
        for corner in 0..8 {
            let at = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
            bin.extend((0..3).flat_map(|axis| at(axis).to_le_bytes()));
        }
        accessors.push(json!({
            "bufferView": i + 1, "componentType": 5126, "count": 8, "type": "VEC3", "min": low, "max": high
        }));
        meshes.push(json!({ "primitives": [{ "attributes": { "POSITION": i + 1 }, "indices": 0, "material": i }] }));
        nodes.push(json!({ "mesh": i, "name": name }));
        materials.push(material.clone());
    }
    let scene = json!({
        "asset": { "version": "2.0" }, "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes, "meshes": meshes, "materials": materials,
        "accessors": accessors, "bufferViews": views,
        "buffers": [{ "uri": "boxes.bin", "byteLength": bin.len() }]
    });
    (scene, bin)
}

#[test]
fn volumes_inside_opaque_meshes_are_warned_of() {
    let opaque = json!({ "name": "Smoke Domain Material" });
    let clear = json!({ "name": "clear", "alphaMode": "BLEND", "pbrMetallicRoughness": { "baseColorFactor": [1, 1, 1, 0] } });
    let glass = json!({
        "name": "glass", "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 },
        "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } }
    });
    let one =
        |material: &Value, half: f32| vec![("Domain", material.clone(), [-half; 3], [half; 3])];
    // Half outside.
    let half_in = vec![("Domain", opaque.clone(), [-1.2, -1.2, -1.2], [0.0, 1.2, 1.2])];
    // Inside a room with the camera, as all things are.
    let room = vec![("Room", opaque.clone(), [-9.0; 3], [9.0; 3])];
    let both = [room.clone(), one(&opaque, 1.2)].concat();
    let volume = json!([{ "name": "smoke", "homogeneous": { "sigma_t": 2, "bounds": [[-1, -1, -1], [1, 1, 1]] }, "albedo": 0.9 }]);
    for (meshes, warned) in [
        (one(&opaque, 1.2), true),
        // The domain's own box.
        (one(&opaque, 1.0), true),
        (both, true),
        (one(&opaque, 0.5), false),
        (one(&clear, 1.2), false),
        (one(&glass, 1.2), false),
        (half_in, false),
        (room, false),
    ] {
        let (scene, bin) = boxes(&meshes);
        let mut job = small(volume.clone(), white());
        job["scene"] = "boxes.gltf".into();
        let folder = folder(&[("job.json", &job.to_string()), ("boxes.gltf", &scene.to_string())]);
        std::fs::write(folder.path().join("boxes.bin"), bin).unwrap();
        let (code, said) = ends(folder.path(), &["check", "job.json"]);
        assert_eq!(code, 0, "{said}");
        let found = said.contains("volume `smoke` lies wholly inside mesh `Domain`");
        assert_eq!(found, warned, "{meshes:?}: {said}");
        if warned {
            assert!(said.contains("`Smoke Domain Material`") && said.contains("Blender"), "{said}");
        }
    }

    // A grid that no path meets is told of by those who trace some.
    let (scene, bin) = boxes(&[("Wall", opaque, [-50.0, -50.0, 3.0], [50.0, 50.0, 4.0])]);
    let mut job = small(json!([sphere_job()["volumes"][0]]), white());
    job["scene"] = "boxes.gltf".into();
    let folder = folder(&[("job.json", &job.to_string()), ("boxes.gltf", &scene.to_string())]);
    std::fs::write(folder.path().join("boxes.bin"), bin).unwrap();
    let (code, said) = ends(folder.path(), &["render", "job.json"]);
    assert!(code == 0 && said.contains("trial paths met volume"), "{said}");
}

/// Light diffuses out of an optical radius of 1e5 after some 1e10 scatterings.
fn trap() -> Value {
    json!([{ "name": "trap", "homogeneous": { "sigma_t": 1e5, "bounds": [[-9, -9, -9], [9, 9, 9]] }, "albedo": 1 }])
}

#[test]
fn paths_without_end_are_cut_and_counted() {
    let mut job = small(trap(), white());
    let folder = folder(&[("job.json", &job.to_string())]);
    let (code, said) = ends(folder.path(), &["check", "job.json"]);
    assert_eq!(code, 0, "{said}");
    assert!(said.contains("max_events 1048576: may cut paths in volume `trap`"), "{said}");

    job["sampling"]["max_events"] = 20_000.into();
    let folder = crate::folder(&[("job.json", &job.to_string())]);
    let (code, said) = ends(folder.path(), &["check", "job.json"]);
    assert!(code == 0 && said.contains("max_events 20000: longer paths are cut"), "{said}");
    let (code, said) = ends(folder.path(), &["render", "job.json", "--threads", "1"]);
    assert!(code == 0 && said.contains("32 of 32 paths were cut by sampling.max_events"), "{said}");
    let found = stats(folder.path());
    assert_eq!(found["cut_by_max_events"], 32);
    // An even rate of three events a bounce is met to a bounce or two.
    let count = |key: &str| found[key].as_u64().unwrap();
    let events = count("bounces") + count("lookups") + count("majorant_steps");
    assert!((32 * 20_000..32 * 20_010).contains(&events), "{events}");
    let line = "max_events 20000: 32 of 32 paths were cut";
    assert_eq!(found["plan"]["biased"], json!([line]));
    let image = read_exr(&folder.path().join("out.exr")).unwrap();
    assert_eq!(text(&image, "pileus:biased"), line);
    assert_eq!(text(&image, "pileus:max_events"), "20000");
    // Where nothing was cut nothing is biased, and the limit costs no bit.
    let plain = |max_events: Value| {
        let mut job = sphere_job();
        job["output"]["image"] = "out.exr".into();
        job["sampling"]["max_events"] = max_events;
        let folder = crate::folder(&[("job.json", &job.to_string())]);
        assert_eq!(ends(folder.path(), &["render", "job.json"]).0, 0);
        let found = stats(folder.path());
        assert_eq!(
            (&found["cut_by_max_events"], &found["plan"]["biased"]),
            (&json!(0), &json!([]))
        );
        read_exr(&folder.path().join("out.exr")).unwrap().channel("R").unwrap().to_vec()
    };
    assert_eq!(plain(json!(100_000)), plain(Value::Null));
    // What is cut is a function of the path.
    let again = |threads: &str, seed: &str| {
        let arguments = ["render", "job.json", "--threads", threads, "--seed", seed, "--spp", "4"];
        let mut job = sphere_job();
        job["volumes"][0]["albedo"] = 1.into();
        job["volumes"][0]["density"]["scale"] = 400.into();
        job["output"]["image"] = "out.exr".into();
        job["sampling"]["max_events"] = 24.into();
        let folder = crate::folder(&[("job.json", &job.to_string())]);
        assert_eq!(ends(folder.path(), &arguments).0, 0);
        assert!(stats(folder.path())["cut_by_max_events"].as_u64().unwrap() > 0);
        read_exr(&folder.path().join("out.exr")).unwrap().channel("R").unwrap().to_vec()
    };
    assert_eq!(again("1", "3"), again("3", "3"));

    for (value, code) in
        [(json!(0), 3), (json!(1.5), 3), (json!(-1), 3), (json!(1), 0), (Value::Null, 0)]
    {
        let mut job = sphere_job();
        job["sampling"]["max_events"] = value.clone();
        let folder = crate::folder(&[("job.json", &job.to_string())]);
        let (found, said) = ends(folder.path(), &["check", "job.json"]);
        assert_eq!(found, code, "{value}: {said}");
        assert!(code == 0 || said.contains("/sampling/max_events"), "{said}");
    }
}

/// A body that scatters without absorbing, whose mesh is one quad: no path that entered it finds a
/// way out.
#[test]
fn bodies_without_a_back_end() {
    let scene = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0 },
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 1 },
                "KHR_materials_ior": { "ior": 1.0 },
                "KHR_materials_volume": { "thicknessFactor": 1, "attenuationDistance": 0.3, "attenuationColor": [0.5, 0.5, 0.5] },
                "KHR_materials_volume_scatter": { "multiscatterColor": [1, 1, 1], "scatterAnisotropy": 0 }
            }
        }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-9, -9, 0], "max": [9, 9, 0] }],
        "bufferViews": [{ "buffer": 0, "byteOffset": 0, "byteLength": 36 }],
        "buffers": [{ "uri": "quad.bin", "byteLength": 36 }]
    });
    let mut job = small(json!([]), white());
    job["scene"] = "quad.gltf".into();
    job["sampling"]["max_events"] = 5000.into();
    let folder = folder(&[("job.json", &job.to_string()), ("quad.gltf", &scene.to_string())]);
    let corners = [[-9.0f32, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]];
    let bin: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.path().join("quad.bin"), bin).unwrap();
    let (code, said) = ends(folder.path(), &["render", "job.json"]);
    assert_eq!(code, 0, "{said}");
}

/// Densities with which a walk takes a million collisions and more.
#[test]
fn checks_and_plans_trace_nothing_and_predictions_do_little() {
    for (pointer, value) in [
        ("/volumes/0/density/scale", json!(1e12)),
        ("/volumes/0/density/scale", json!(1e20)),
        ("/volumes/0/transform", json!({ "scale": [1e9, 1e9, 1e9] })),
    ] {
        let mut job = sphere_job();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        job.pointer_mut(parent).unwrap()[key] = value;
        let folder = folder(&[("job.json", &job.to_string())]);
        for arguments in
            [&["check", "job.json"][..], &["plan", "job.json"], &["plan", "job.json", "--predict"]]
        {
            let (code, said) = ends(folder.path(), arguments);
            assert_eq!(code, 0, "{said}");
            assert!(!said.contains("expected"), "{said}");
            let asked = arguments.contains(&"--predict");
            assert_eq!(said.contains("no paths are traced"), asked, "{said}");
        }
    }
    let folder = folder(&[("job.json", &sphere_job().to_string())]);
    let (_, said) = ends(folder.path(), &["plan", "job.json", "--predict"]);
    assert!(said.contains("expected       "), "{said}");
    let (_, said) = ends(folder.path(), &["plan", "job.json"]);
    assert!(!said.contains("expected       "), "{said}");
}

#[cfg(unix)]
mod signals {
    use super::*;
    use std::io::{BufRead, BufReader, Lines};
    use std::process::{ChildStderr, Command};

    /// A render in the background, and what it says.
    fn started(
        command: &mut Command,
        arguments: &[&str],
    ) -> (Child, Lines<BufReader<ChildStderr>>) {
        let mut child = command.args(arguments).stderr(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        (child, lines)
    }

    fn send(signal: &str, child: &Child) {
        let kill = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert!(kill.success());
    }

    /// Whether this process, and so every program it starts, was started with SIGHUP ignored.
    fn hang_up_is_ignored() -> bool {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        u64::from_str_radix(mask.unwrap_or("0").trim(), 16).unwrap_or(0) & 1 == 1
    }

    fn long_job(folder: &Path) {
        let mut job = sphere_job();
        job["sampling"]["spp"] = 100_000_000.into();
        job["output"]["image"] = "out.exr".into();
        std::fs::write(folder.join("job.json"), job.to_string()).unwrap();
    }

    const FIRST: &str = "the first sample of every pixel is done";

    #[test]
    fn each_signal_writes_the_whole_passes_and_has_its_code() {
        for (signal, code) in [("-INT", 130), ("-TERM", 143), ("-HUP", 129)] {
            if signal == "-HUP" && hang_up_is_ignored() {
                continue;
            }
            let folder = folder(&[]);
            long_job(folder.path());
            let arguments = ["-v", "--threads", "1", "render", "job.json"];
            let (child, mut lines) = started(&mut pileus(folder.path()), &arguments);
            assert!(lines.any(|line| line.unwrap().contains(FIRST)));
            send(signal, &child);
            let said: Vec<String> = lines.map(Result::unwrap).collect();
            let output = within(child, PATIENCE);
            assert_eq!(output.status.code(), Some(code), "{said:?}");
            let stats = stats(folder.path());
            assert_eq!(stats["interrupted"], true);
            let samples = stats["samples"].as_u64().unwrap();
            assert!((1..100_000_000).contains(&samples));
            // What a cut path or an unfinished pass counted is in no sum.
            assert_eq!(stats["paths"].as_u64().unwrap(), samples * 32 * 20);
            let image = read_exr(&folder.path().join("out.exr")).unwrap();
            assert_eq!(text(&image, "pileus:samples"), samples.to_string());
            // The same samples, asked for.
            let red = image.channel("R").unwrap().to_vec();
            let spp = samples.to_string();
            if samples < 4000 {
                let again = ends(folder.path(), &["render", "job.json", "--spp", &spp]);
                assert_eq!(again.0, 0, "{}", again.1);
                let image = read_exr(&folder.path().join("out.exr")).unwrap();
                assert_eq!(image.channel("R").unwrap(), red);
            }
        }
    }

    /// The log of a render tells how far it is, without a terminal and while no path gets done; a
    /// signal ends it within a path.
    #[test]
    fn a_signal_ends_a_path() {
        let mut job = small(trap(), white());
        job["sampling"]["max_events"] = Value::Null;
        let folder = folder(&[("job.json", &job.to_string())]);
        let arguments = ["--threads", "1", "render", "job.json"];
        let (child, mut lines) = started(&mut pileus(folder.path()), &arguments);
        let line =
            lines.find(|line| line.as_ref().unwrap().contains("rendering: ")).unwrap().unwrap();
        assert!(line.contains("0.0 of 2 samples per pixel, 2 s elapsed"), "{line}");
        let sent = Instant::now();
        send("-INT", &child);
        let said: Vec<String> = lines.map(Result::unwrap).collect();
        let output = within(child, PATIENCE);
        assert_eq!(output.status.code(), Some(130), "{said:?}");
        assert!(said.iter().any(|line| line.contains("nothing was written")), "{said:?}");
        assert!(!folder.path().join("out.exr").exists());
        // A path has some 1e10 events; a machine under load takes its time all the same.
        assert!(sent.elapsed() < Duration::from_secs(20), "{:?}", sent.elapsed());
    }

    #[test]
    fn nohup_is_heeded_and_quiet_logs_are_quiet() {
        let folder = folder(&[]);
        long_job(folder.path());
        let mut command = Command::new("nohup");
        command.current_dir(folder.path()).env_remove("RUST_LOG").stdout(Stdio::null());
        command.arg(env!("CARGO_BIN_EXE_pileus"));
        let arguments = ["-v", "--threads", "1", "render", "job.json"];
        let (mut child, mut lines) = started(&mut command, &arguments);
        assert!(lines.any(|line| line.unwrap().contains(FIRST)));
        send("-HUP", &child);
        std::thread::sleep(Duration::from_millis(300));
        assert!(child.try_wait().unwrap().is_none(), "hung up");
        send("-TERM", &child);
        let said: Vec<String> = lines.map(Result::unwrap).collect();
        assert_eq!(within(child, PATIENCE).status.code(), Some(143), "{said:?}");

        let output = run(folder.path(), &["-q", "render", "job.json", "--spp", "1"]);
        assert!(output.status.success() && stderr(&output).is_empty(), "{}", stderr(&output));
    }
}

/// What is legal and yet no picture to rely on is said: bounds that are made not to hold, and media
/// in which paths are shorter than positions can tell.
#[test]
fn pictures_that_cannot_be_relied_on_are_said() {
    let said = |change: &dyn Fn(&mut Value)| {
        let mut job = sphere_job();
        change(&mut job);
        let folder = crate::folder(&[("job.json", &job.to_string())]);
        ends(folder.path(), &["check", "job.json"])
    };
    let loose = said(&|job| job["sampling"]["majorant_scale"] = 0.5.into());
    assert!(loose.0 == 0 && loose.1.contains("may be noise alone"), "{}", loose.1);
    let dense = said(&|job| job["volumes"][0]["density"]["scale"] = 1e15.into());
    assert!(dense.0 == 0 && dense.1.contains("its light is wrong"), "{}", dense.1);
    let plain = said(&|job| job["volumes"][0]["density"]["scale"] = 1e9.into());
    assert!(plain.0 == 0 && !plain.1.contains("its light is wrong"), "{}", plain.1);
}
