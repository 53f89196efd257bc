//! Everyday wishes on the command line: what each changes, and that the job it stands for renders
//! the same picture.

use std::path::Path;

use pileus_film::{Image, read_exr};
use serde_json::{Value, json};

use super::{folder, path, run, sphere_job, stderr};

/// Renders with options, and returns the saved job and the image.
fn rendered(folder: &Path, input: &str, options: &[&str]) -> (Value, Image) {
    let small = ["--spp", "2", "--resolution", "24x16", "-o", "a.exr", "--save-job", "a.json"];
    let output = run(folder, &[&["render", input], &small[..], options].concat());
    assert!(output.status.success(), "{options:?}: {}", stderr(&output));
    let job = serde_json::from_slice(&std::fs::read(folder.join("a.json")).unwrap()).unwrap();
    let image = read_exr(&folder.join("a.exr")).unwrap();
    for name in ["a.exr", "a.png", "a.layers.exr"] {
        std::fs::rename(folder.join(name), folder.join(format!("first-{name}"))).unwrap();
    }
    (job, image)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn close(value: &Value, expected: &[f64]) {
    let found = numbers(value);
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < 1e-9, "{found:?} for {expected:?}");
    }
}

/// The picture of each wish is that of the job it saves, and another than without it.
#[test]
fn wishes_change_the_picture_and_are_saved() {
    let cloud = path("scenes/assets/syn_sphere.vdb");
    let sky = path("scenes/assets/sky.exr");
    let folder = folder(&[]);
    let (_, plain) = rendered(folder.path(), &cloud, &[]);
    let wishes: [&[&str]; 9] = [
        &["--camera-orbit", "-60,30"],
        &["--camera-orbit", "10,90,40"],
        &["--sun", "200,5"],
        &["--env", &sky],
        &["--env", &sky, "--sun", "90,45"],
        &["--albedo", "0.9,0.5,0.2"],
        &["--g", "-0.3"],
        &["--density-scale", "0.5", "--albedo", "0.7", "--g", "0"],
        &["--exposure", "-2.5", "--aov", "samples"],
    ];
    for wish in wishes {
        let (job, image) = rendered(folder.path(), &cloud, wish);
        let same = image.channel("R").unwrap() == plain.channel("R").unwrap();
        assert_eq!(same, wish.contains(&"--exposure"), "{wish:?}");
        let output = run(folder.path(), &["render", "a.json"]);
        assert!(output.status.success(), "{wish:?}: {}", stderr(&output));
        for name in ["a.exr", "a.layers.exr"] {
            let [first, again] = [format!("first-{name}"), name.into()]
                .map(|name| read_exr(&folder.path().join(name)).unwrap());
            assert_eq!(first.channels(), again.channels(), "{wish:?}");
        }
        let png = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
        assert_eq!(png("first-a.png"), png("a.png"), "{wish:?}");
        if wish.contains(&"--aov") {
            assert_eq!(job["output"]["exposure"], -2.5);
            let layers = read_exr(&folder.path().join("a.layers.exr")).unwrap();
            assert!(layers.channels().iter().any(|channel| channel.name.starts_with("samples")));
        }
    }
}

/// A camera that the job places turns around what it looks at; the distance stays unless told.
#[test]
fn orbits_turn_around_what_the_camera_looks_at() {
    let mut job = sphere_job();
    job["camera"] = json!({ "position": [1, 2, 8], "look_at": [1, 2, 3], "fov_y": 40 });
    let folder = folder(&[("job.json", &job.to_string())]);
    let (east, _) = rendered(folder.path(), "job.json", &["--camera-orbit", "90,0"]);
    close(&east["camera"]["position"], &[6.0, 2.0, 3.0]);
    close(&east["camera"]["look_at"], &[1.0, 2.0, 3.0]);
    assert_eq!(east["camera"]["fov_y"], 40.0);
    let (above, _) = rendered(folder.path(), "job.json", &["--camera-orbit", "0,90,7"]);
    close(&above["camera"]["position"], &[1.0, 9.0, 3.0]);
    // From above, what lies behind the middle is up.
    close(&above["camera"]["up"], &[0.0, 0.0, 1.0]);
}

/// Suns of a job move, its environment makes way, and its other lights stay.
#[test]
fn lights_are_changed_by_kind() {
    let folder = folder(&[("sub/job.json", "")]);
    std::fs::copy(path("scenes/assets/sky.exr"), folder.path().join("own.exr")).unwrap();
    let lights = |lights: Value, options: &[&str]| {
        let mut job = sphere_job();
        job["lights"] = lights;
        std::fs::write(folder.path().join("sub/job.json"), job.to_string()).unwrap();
        rendered(folder.path(), "sub/job.json", options).0["lights"].clone()
    };
    let point = json!({ "type": "point", "position": [9, 9, 9], "intensity": 1 });
    let sun = json!({ "type": "sun", "to_light": [0, 1, 0], "irradiance": 2 });
    let constant = json!({ "type": "environment", "radiance": 0.3 });
    let sky = json!({ "type": "sky", "to_sun": [0, 1, 0], "turbidity": 5 });

    let found = lights(json!([point, sun, constant]), &["--sun", "90,0"]);
    close(&found[1]["to_light"], &[1.0, 0.0, 0.0]);
    assert_eq!((&found[0]["type"], &found[2]["radiance"]), (&json!("point"), &json!(0.3)));
    assert_eq!(found[1]["irradiance"], 2.0);

    let found = lights(json!([sky]), &["--sun", "30,10"]);
    assert_eq!((&found[0]["elevation"], &found[0]["azimuth"]), (&json!(10.0), &json!(30.0)));
    assert_eq!((found[0].get("to_sun"), &found[0]["turbidity"]), (None, &json!(5.0)));

    // Beside an environment there is a sun, in the dark a sky.
    let found = lights(json!([constant]), &["--sun", "30,10"]);
    assert_eq!((&found[0]["type"], &found[1]["type"]), (&json!("environment"), &json!("sun")));
    let found = lights(json!([point]), &["--sun", "30,10"]);
    assert_eq!(found[1]["type"], "sky");

    // Names on the command line are relative to the current folder, those of the job to its own.
    let found = lights(json!([sky, point, constant, sun]), &["--env", "own.exr"]);
    let kinds: Vec<&Value> = found.as_array().unwrap().iter().map(|l| &l["type"]).collect();
    assert_eq!(kinds, ["point", "sun", "environment"]);
    assert!(found[2]["image"].as_str().unwrap().ends_with("own.exr"));
}

#[test]
fn wishes_that_cannot_be_say_why() {
    let scene = r#"{"asset":{"version":"2.0"}}"#;
    let folder = folder(&[("scene.gltf", scene), ("job.json", &sphere_job().to_string())]);
    for (options, says) in [
        (["--camera-orbit", "10"], "give an azimuth and an elevation"),
        (["--camera-orbit", "10,91"], "-90 to 90"),
        (["--camera-orbit", "10,20,0"], "distance above 0"),
        (["--camera-orbit", "10,nan"], "give an azimuth"),
        (["--sun", "10,-7"], "-6 to 90"),
        (["--albedo", "1.1"], "0 to 1"),
        (["--albedo", "0.5,0.5"], "or three"),
        (["--g", "1"], "between -1 and 1"),
        (["--exposure", "65"], "-64 to 64"),
        (["--aov", "depht"], "samples"),
    ] {
        let output = run(folder.path(), &[&["render", "job.json"], &options[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{options:?}");
        assert!(stderr(&output).contains(says), "{options:?}: {}", stderr(&output));
    }
    for pair in [["--aov=samples", "--no-layers"], ["--camera-orbit=0,0", "--camera=a"]] {
        let output = run(folder.path(), &[&["render", "job.json"], &pair[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{pair:?}: {}", stderr(&output));
    }
    let output = run(folder.path(), &["render", "job.json", "--env", "none.exr"]);
    assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
    assert!(stderr(&output).contains("none.exr"), "{}", stderr(&output));
    let output = run(folder.path(), &["render", "scene.gltf", "--albedo", "0.5"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("--albedo"), "{}", stderr(&output));
    // An environment that is read is not written over.
    std::fs::copy(path("scenes/assets/sky.exr"), folder.path().join("own.exr")).unwrap();
    let before = std::fs::read(folder.path().join("own.exr")).unwrap();
    let output = run(folder.path(), &["render", "job.json", "--env", "own.exr", "-o", "own.exr"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert_eq!(std::fs::read(folder.path().join("own.exr")).unwrap(), before);
}
