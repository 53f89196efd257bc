//! Layers beside the image, and the film's memory.

use std::path::Path;

use pileus_film::{Image, read_exr};
use serde_json::{Value, json};

use crate::{folder, json as json_of, run, sphere_job, stderr};

fn job(output: Value) -> Value {
    let mut job = sphere_job();
    job["output"] = output;
    job
}

fn render(job: &Value, arguments: &[&str]) -> tempfile::TempDir {
    let folder = folder(&[("job.json", &job.to_string())]);
    let output = run(folder.path(), &[&["render", "job.json"], arguments].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    folder
}

fn channels(image: &Image) -> Vec<&str> {
    image.channels().iter().map(|c| c.name.as_str()).collect()
}

fn bits(image: &Image, name: &str) -> Vec<u32> {
    image.channel(name).unwrap().iter().map(|v| v.to_bits()).collect()
}

fn read(folder: &Path, name: &str) -> Image {
    read_exr(&folder.join(name)).unwrap()
}

#[test]
fn the_image_has_four_channels_and_the_layers_a_file_of_their_own() {
    let plain = render(&job(json!({ "image": "a.exr", "half": true })), &[]);
    let asked = render(&job(json!({ "image": "a.exr", "half": true, "aovs": ["samples"] })), &[]);
    let image = read(asked.path(), "a.exr");
    assert_eq!(channels(&image), ["A", "B", "G", "R"]);
    let layers = read(asked.path(), "a.layers.exr");
    assert_eq!(
        channels(&layers),
        ["samples.Y", "variance.B", "variance.G", "variance.R", "variance_alpha.Y"]
    );
    assert_eq!(layers.metadata, image.metadata);
    // No sample of this scene is dropped.
    assert!(layers.channel("samples.Y").unwrap().iter().all(|v| *v == 4.0));
    // Asking for a layer changes no bit of what is always there.
    let (plain_image, plain_layers) =
        (read(plain.path(), "a.exr"), read(plain.path(), "a.layers.exr"));
    for name in channels(&image) {
        assert_eq!(bits(&image, name), bits(&plain_image, name), "{name}");
    }
    assert_eq!(channels(&plain_layers).len(), 4);
    for name in channels(&plain_layers) {
        assert_eq!(bits(&layers, name), bits(&plain_layers, name), "{name}");
        assert!(layers.channel(name).unwrap().iter().any(|v| *v > 0.0 && v.is_finite()), "{name}");
    }
}

#[test]
fn layers_in_the_image_are_the_same_layers() {
    let apart = render(&job(json!({ "image": "a.exr", "aovs": ["samples"] })), &[]);
    let output =
        json!({ "image": "a.exr", "aovs": ["variance", "samples"], "layers_in_image": true });
    let together = render(&job(output), &[]);
    assert!(!together.path().join("a.layers.exr").exists());
    let together = read(together.path(), "a.exr");
    assert_eq!(together.channels().len(), 9);
    for name in ["a.exr", "a.layers.exr"] {
        let image = read(apart.path(), name);
        for name in channels(&image) {
            assert_eq!(bits(&image, name), bits(&together, name), "{name}");
        }
    }
    let nowhere = render(&job(json!({ "image": "b.exr", "aovs": ["samples"] })), &["--no-layers"]);
    assert!(!nowhere.path().join("b.layers.exr").exists());
}

/// `compare` finds the noise of an image in it, or in the file beside it if that is of the same
/// render.
#[test]
fn variances_are_found_beside_the_image() {
    let apart = render(&job(json!({ "image": "a.exr" })), &[]);
    let together = render(&job(json!({ "image": "b.exr", "layers_in_image": true })), &[]);
    std::fs::copy(together.path().join("b.exr"), apart.path().join("b.exr")).unwrap();
    let found = json_of(apart.path(), &["compare", "a.exr", "b.exr", "--json"]);
    assert!(found["stderr_a"][1].as_f64().unwrap() > 0.0);
    assert_eq!((&found["stderr_a"], &found["mse"]), (&found["stderr_b"], &json!(0.0)));

    // The layers of another render do not count.
    std::fs::rename(apart.path().join("a.layers.exr"), apart.path().join("c.layers.exr")).unwrap();
    let output =
        run(apart.path(), &["render", "job.json", "--seed", "7", "-o", "c.exr", "--no-layers"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let output = run(apart.path(), &["compare", "c.exr", "b.exr", "--json"]);
    assert!(stderr(&output).contains("its variance is not used"), "{}", stderr(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(found["stderr_a"].is_null() && !found["stderr_b"].is_null(), "{found}");
}

#[test]
fn the_films_memory_is_told_before_and_after() {
    let mut job = job(json!({ "image": "a.exr", "aovs": ["samples"] }));
    let folder = folder(&[("job.json", &job.to_string())]);
    let text = |arguments: &[&str]| {
        let output = run(folder.path(), arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        let said = stderr(&output);
        String::from_utf8(output.stdout).unwrap() + &said
    };
    // 640 pixels of 552 bytes, and of 4 samples of 16 bytes.
    let line = "32 x 20 pixels, layers beauty, alpha, variance, samples: 0.4 MB, of which 0.0 MB";
    for arguments in
        [&["plan", "job.json"][..], &["check", "job.json"], &["-v", "render", "job.json"]]
    {
        let said = text(arguments);
        assert!(said.contains(line), "{arguments:?}: {said}");
    }
    let expected = json!({
        "resolution": [32, 20], "crop": [0, 0, 32, 20],
        "layers": ["beauty", "alpha", "variance", "samples"],
        "bytes_sums": 640 * 552, "bytes_tiles": 640 * 4 * 16, "bytes": 640 * (552 + 64)
    });
    assert_eq!(json_of(folder.path(), &["plan", "job.json", "--json"])["film"], expected);
    let stats = std::fs::read_to_string(folder.path().join("a.stats.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&stats).unwrap()["film"], expected);

    // A film of 138 GiB is told, not taken.
    job["film"]["resolution"] = json!([16384, 16384]);
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let said = text(&["plan", "job.json"]);
    assert!(said.contains("165356.2 MB"), "{said}");
}

#[test]
fn outputs_of_layers_that_contradict_themselves_are_refused() {
    for (output, code, word) in [
        (json!({ "layers": "b.exr", "layers_in_image": true }), 3, "/output"),
        (json!({ "layers": null, "aovs": ["samples"] }), 3, "/output"),
        (json!({ "layers": "b.png" }), 3, "/output/layers"),
        (json!({ "aovs": ["beauty"] }), 5, "/output/aovs/0"),
        (json!({ "aovs": ["samples", "depht"] }), 5, "/output/aovs/1"),
        (json!({ "aovs": ["samples", "samples"] }), 3, "/output/aovs/1"),
    ] {
        let folder = folder(&[("job.json", &job(output.clone()).to_string())]);
        let said = run(folder.path(), &["check", "job.json"]);
        let text = stderr(&said);
        assert_eq!(said.status.code(), Some(code), "{output}: {text}");
        assert!(text.contains(word) && text.contains("help: "), "{output}: {text}");
    }
}

/// A file of layers is no picture, neither for `compare` nor as an environment.
#[test]
fn files_of_layers_are_not_taken_for_pictures() {
    let folder = render(&job(json!({ "image": "a.exr" })), &[]);
    let said = run(folder.path(), &["compare", "a.layers.exr", "a.layers.exr"]);
    assert!(!said.status.success() && said.stdout.is_empty());
    assert!(stderr(&said).contains("a.layers.exr"), "{}", stderr(&said));
    let mut job = sphere_job();
    job["lights"] = json!([{ "type": "environment", "image": "a.layers.exr" }]);
    std::fs::write(folder.path().join("lit.json"), job.to_string()).unwrap();
    let said = run(folder.path(), &["check", "lit.json"]);
    assert!(!said.status.success());
    assert!(stderr(&said).contains("a.layers.exr"), "{}", stderr(&said));
}
