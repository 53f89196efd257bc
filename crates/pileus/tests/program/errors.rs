//! What the program says about bad inputs, and its exit codes.

use crate::{folder, path, run, sphere_job, stderr};

/// Checks a job; returns the exit code and what was said.
fn check(text: &str) -> (i32, String) {
    let folder = folder(&[("job.json", text)]);
    let output = run(folder.path(), &["check", "job.json"]);
    (output.status.code().unwrap(), stderr(&output))
}

/// A job with one change: a JSON pointer and what stands there afterwards.
fn changed(pointer: &str, value: serde_json::Value) -> String {
    let mut job = sphere_job();
    match job.pointer_mut(pointer) {
        Some(place) => *place = value,
        None => {
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            job.pointer_mut(parent).unwrap()[key] = value;
        }
    }
    serde_json::to_string_pretty(&job).unwrap()
}

#[test]
fn unknown_keys_name_the_nearest_key_and_their_place() {
    let text = "{\n  \"volumes\": [\n    { \"vdb\": \"a.vdb\",\n      \"density\": { \"sclae\": 2 } }\n  ]\n}";
    let (code, said) = check(text);
    assert_eq!(code, 3);
    assert!(said.contains("job.json:4:20 (/volumes/0/density/sclae)"), "{said}");
    assert!(said.contains("unknown key `sclae`"), "{said}");
    assert!(said.contains("did you mean `scale`?"), "{said}");
}

#[test]
fn syntax_errors_and_comments_are_refused_with_their_place() {
    let (code, said) = check("{\n  // the cloud\n  \"volumes\": []\n}");
    assert_eq!(code, 3);
    assert!(said.contains("job.json:2:3") && said.contains("comments"), "{said}");
    let (code, said) = check("{\n  \"volumes\": [,]\n}");
    assert_eq!(code, 3);
    assert!(said.contains("job.json:2:15") && said.contains("not JSON"), "{said}");
}

#[test]
fn missing_files_are_named_with_who_asked_for_them() {
    for (pointer, value, key) in [
        ("/volumes/0/vdb", serde_json::json!("nothing.vdb"), "/volumes/0/vdb"),
        ("/scene", "nothing.gltf".into(), "nothing.gltf"),
        (
            "/lights/1",
            serde_json::json!({"type": "environment", "image": "nothing.exr"}),
            "/lights/1/image",
        ),
    ] {
        let (code, said) = check(&changed(pointer, value));
        assert_eq!(code, 4, "{said}");
        assert!(said.contains("nothing.") && said.contains(key), "{said}");
    }
    let folder = folder(&[]);
    for command in ["render", "check", "info", "plan"] {
        let output = run(folder.path(), &[command, "none.json"]);
        assert_eq!(output.status.code(), Some(4));
        assert!(stderr(&output).contains("none.json"));
    }
}

#[test]
fn values_out_of_range_are_placed() {
    for (pointer, value) in [
        ("/volumes/0/albedo", serde_json::json!(1.5)),
        ("/volumes/0/extinction", serde_json::json!([1, -1, 1])),
        ("/volumes/0/phase", serde_json::json!({"type": "henyey_greenstein", "g": 1})),
        ("/volumes/0/phase", serde_json::json!({"type": "draine", "g": 0.5, "alpha": -1})),
        ("/volumes/0/phase", serde_json::json!({"type": "mie", "droplet": 10})),
        (
            "/volumes/0/phase",
            serde_json::json!({"type": "mixture", "lobes": [{"weight": -1, "phase": {"type": "rayleigh"}}]}),
        ),
        ("/volumes/0/law", serde_json::json!({"type": "power", "k": 1})),
        ("/volumes/0/law", serde_json::json!({"type": "davis_weinstein", "h": 0.5, "c": 1})),
        ("/volumes/0/transform", serde_json::json!({"scale": [1, 0, 1]})),
        ("/volumes/0/density/scale", serde_json::json!(-1)),
        ("/volumes/0/density/grid", serde_json::json!("smoke")),
        ("/volumes/0/emission", serde_json::json!({"type": "grid", "grid": "flame"})),
        (
            "/volumes/0/emission",
            serde_json::json!({"type": "grid", "grid": "density", "ramp": [{"value": 0, "color": 1}]}),
        ),
        ("/sampling/level_exponent", serde_json::json!(1)),
        ("/sampling/spp", serde_json::json!(0)),
        ("/sampling/spp", serde_json::json!(1.5)),
        ("/film/resolution", serde_json::json!([0, 4])),
        ("/film/resolution", serde_json::json!([100_000, 100_000])),
        ("/film/crop", serde_json::json!([30, 0, 8, 8])),
        ("/film/filter", serde_json::json!({"radius": 0})),
        ("/lights/0/to_light", serde_json::json!([0, 0, 0])),
        ("/lights/0/irradiance", serde_json::json!(-3)),
        ("/lights/1", serde_json::json!({"type": "environment"})),
        ("/camera", serde_json::json!({"position": [0, 0, 0]})),
        ("/camera", serde_json::json!({"node": "Camera"})),
        ("/gltf", serde_json::json!({"lumens_per_watt": 0})),
        ("/output/image", serde_json::json!("cloud.jpg")),
        ("/sampling/transmittance", serde_json::json!("rato")),
        ("/sampling/clamp", serde_json::json!(0)),
    ] {
        let (code, said) = check(&changed(pointer, value));
        assert_eq!(code, 3, "{pointer}: {said}");
        let part = pointer.rsplit_once('/').map_or(pointer, |(parent, _)| parent);
        assert!(said.contains("job.json:") && said.contains(part), "{pointer}: {said}");
        assert!(said.contains("help: ") || said.contains("; "), "{pointer}: {said}");
    }
}

#[test]
fn skies_out_of_range_are_placed() {
    for (key, keys) in [
        ("", serde_json::json!({})),
        ("", serde_json::json!({"azimuth": 10})),
        ("", serde_json::json!({"to_sun": [0, 1, 0], "elevation": 10})),
        ("/to_sun", serde_json::json!({"to_sun": [0, 0, 0]})),
        ("/to_sun", serde_json::json!({"to_sun": [1, -1, 0]})),
        ("/elevation", serde_json::json!({"elevation": -7})),
        ("/elevation", serde_json::json!({"elevation": 91})),
        ("/turbidity", serde_json::json!({"elevation": 9, "turbidity": 0.9})),
        ("/turbidity", serde_json::json!({"elevation": 9, "turbidity": 11})),
        ("/ground_albedo/1", serde_json::json!({"elevation": 9, "ground_albedo": [0, 1.1, 0]})),
        ("/intensity", serde_json::json!({"elevation": 9, "intensity": -1})),
        ("/sun_angular_diameter", serde_json::json!({"elevation": 9, "sun_angular_diameter": 180})),
    ] {
        let mut sky = keys.clone();
        sky["type"] = "sky".into();
        let (code, said) = check(&changed("/lights/1", sky));
        assert_eq!(code, 3, "{keys}: {said}");
        let place = format!("(/lights/1{key})");
        assert!(said.contains("job.json:") && said.contains(&place), "{keys}: {said}");
        assert!(said.contains("help: ") || said.contains("; "), "{keys}: {said}");
    }
}

#[test]
fn there_is_one_image_of_the_environment() {
    let sky = serde_json::json!({"type": "sky", "elevation": 30});
    let image = serde_json::json!({"type": "environment", "image": "sky.exr"});
    for (first, second) in [(&sky, &sky), (&sky, &image), (&image, &sky)] {
        let (code, said) = check(&changed("/lights", serde_json::json!([first, second])));
        assert_eq!(code, 5, "{said}");
        assert!(said.contains("(/lights/1)") && said.contains("help: "), "{said}");
    }
    let constant = serde_json::json!({"type": "environment", "radiance": 0.1});
    let (code, said) = check(&changed("/lights", serde_json::json!([sky, constant])));
    assert_eq!(code, 0, "{said}");
}

#[test]
fn what_later_versions_may_render_is_told_apart() {
    for (pointer, value) in [
        ("/volumes/0/interpolation", "tricubic".into()),
        ("/camera", serde_json::json!({"shutter": [0.0, 0.5]})),
        ("/output/aovs", serde_json::json!(["velocity"])),
    ] {
        let (code, said) = check(&changed(pointer, value));
        assert_eq!(code, 5, "{pointer}: {said}");
        assert!(said.contains(pointer) && said.contains("help: "), "{pointer}: {said}");
    }
}

#[test]
fn level_sets_and_vectors_are_no_densities() {
    let multi = path("tests/data/conformance/multi.vdb");
    for (grid, word) in [("surface", "level set"), ("vel", "vectors")] {
        let volume = serde_json::json!({"vdb": multi, "density": {"grid": grid}});
        let (code, said) = check(&changed("/volumes/0", volume));
        assert_eq!(code, 5, "{said}");
        assert!(said.contains(word) && said.contains("/volumes/0/density/grid"), "{said}");
    }
    let level_set = path("tests/data/conformance/levelset_bg.vdb");
    let (code, said) = check(&changed("/volumes/0", serde_json::json!({"vdb": level_set})));
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("level set") && said.contains("not clear which grid"), "{said}");
}

#[test]
fn bad_scenes_are_told_apart() {
    let asset = r#""asset":{"version":"2.0"}"#;
    for (text, code, word) in [
        ("{".to_owned(), 3, "not JSON"),
        ("{}".into(), 3, "`asset` is missing"),
        (r#"{"asset":{"version":"1.0"}}"#.into(), 5, "version"),
        (format!(r#"{{{asset},"extensionsRequired":["VENDOR_fog"]}}"#), 5, "VENDOR_fog"),
        (
            format!(r#"{{{asset},"nodes":[{{"children":[0]}}],"scenes":[{{"nodes":[0]}}]}}"#),
            3,
            "two parents",
        ),
        (
            format!(
                r#"{{{asset},"nodes":[{{"extras":{{"pileus_vdb":"a.vdb","pileus_grd":"d"}}}}],"scenes":[{{"nodes":[0]}}]}}"#
            ),
            3,
            "did you mean `pileus_grid`?",
        ),
    ] {
        let folder = folder(&[("a.gltf", &text)]);
        let output = run(folder.path(), &["render", "a.gltf"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{text}: {said}");
        assert!(said.contains("a.gltf") && said.contains(word), "{text}: {said}");
    }
}

#[test]
fn wrong_command_lines_end_with_two() {
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let job = serde_json::to_string(&sphere_job()).unwrap();
    let folder = folder(&[("job.json", &job), ("what.dat", "????")]);
    let probe = ["probe", "transmittance", &sphere, "--grid", "density", "--rays", "r.json"];
    for (arguments, words) in [
        (&["render"][..], &["<INPUT>"][..]),
        (&["rendr", "job.json"], &["rendr", "render"]),
        (&["render", "job.json", "--resolution", "40"], &["--resolution", "40"]),
        (&["render", "job.json", "--threads", "0"], &["--threads", "0"]),
        (&["render", "job.json", "-q", "-v"], &["--quiet", "--verbose"]),
        (&["render", "job.json", "-o", "cloud.png"], &["cloud.png", ".exr"]),
        (&["render", "job.json", "--preview", "cloud.exr"], &["cloud.exr", ".png"]),
        (&["render", "job.json", "--grid", "density"], &["--grid", "belong to OpenVDB files"]),
        (&["info", "what.dat"], &["what.dat: the kind of this file is not known"]),
        (&[&probe[..], &["--estimator", "tailor"]].concat(), &["'tailor'", "'taylor'"]),
    ] {
        let output = run(folder.path(), arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(words.iter().all(|word| said.contains(word)), "{arguments:?}: {said}");
    }
    let help = run(folder.path(), &["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let text = String::from_utf8(help.stdout).unwrap();
    assert!(text.contains("Exit codes") && text.contains("130"));
}

#[test]
fn outputs_that_cannot_be_written_are_found_before_rendering() {
    let mut job = sphere_job();
    job["sampling"]["spp"] = 1_000_000_000.into();
    let folder = folder(&[("job.json", &job.to_string())]);
    let output = run(folder.path(), &["render", "job.json", "-o", "no/such/folder/a.exr"]);
    assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
    assert!(stderr(&output).contains("no/such/folder"));
}
