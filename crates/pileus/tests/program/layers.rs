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

#[test]
fn every_layer_is_written_under_its_name_and_the_parts_of_light_add_up() {
    let asked = [
        "samples",
        "transmittance",
        "depth",
        "position",
        "normal",
        "albedo",
        "indirect",
        "denoised",
    ];
    let folder = render(&job(json!({ "image": "a.exr", "aovs": asked })), &[]);
    let (image, layers) = (read(folder.path(), "a.exr"), read(folder.path(), "a.layers.exr"));
    // What indirect light comes from is there, too.
    let mut expected: Vec<String> =
        ["samples.Y", "depth.Z", "variance_alpha.Y"].map(String::from).into();
    for (layers, parts) in [
        (&["position", "normal"][..], ["X", "Y", "Z"]),
        (
            &[
                "transmittance",
                "albedo",
                "background",
                "emission",
                "direct",
                "indirect",
                "denoised",
                "variance",
            ],
            ["R", "G", "B"],
        ),
    ] {
        expected.extend(layers.iter().flat_map(|l| parts.map(|part| format!("{l}.{part}"))));
    }
    expected.sort_unstable();
    assert_eq!(channels(&layers), expected);
    let light = ["background", "emission", "direct", "indirect"];
    for c in ["R", "G", "B"] {
        for (i, own) in image.channel(c).unwrap().iter().enumerate() {
            let part = |layer: &str| layers.channel(&format!("{layer}.{c}")).unwrap()[i];
            let sum: f32 = light.iter().map(|layer| part(layer)).sum();
            assert!((sum - own).abs() <= 4.0 * f32::EPSILON * own.abs(), "{sum} for {own}");
        }
    }
}

/// The picture to look at is denoised unless told otherwise, the image never is.
#[test]
fn what_is_shown_is_denoised_and_what_is_kept_is_not() {
    let output = || json!({ "image": "a.exr", "preview": "a.png" });
    let shown = render(&job(output()), &["-v"]);
    let raw = render(&job(output()), &["--no-denoise"]);
    let mut never = job(output());
    never["denoise"] = json!({ "when": "never" });
    let never = render(&never, &[]);
    let kept = render(&job(output()), &["--denoise"]);
    let png = |folder: &tempfile::TempDir| std::fs::read(folder.path().join("a.png")).unwrap();
    assert_ne!(png(&shown), png(&raw));
    assert_eq!(png(&never), png(&raw));
    assert_eq!(png(&kept), png(&shown));
    let image = read(raw.path(), "a.exr");
    for (folder, layers) in [(&shown, 4), (&kept, 7), (&raw, 4)] {
        assert_eq!(bits(&read(folder.path(), "a.exr"), "R"), bits(&image, "R"));
        assert_eq!(channels(&read(folder.path(), "a.layers.exr")).len(), layers);
    }
    // It has less noise: pixels differ less from their neighbours.
    let rough = |image: &Image, name: &str| -> f64 {
        let plane = image.channel(name).unwrap();
        plane.windows(2).map(|pair| f64::from((pair[0] - pair[1]).abs())).sum()
    };
    let denoised = read(kept.path(), "a.layers.exr");
    let (before, after) = (rough(&image, "G"), rough(&denoised, "denoised.G"));
    assert!(after < 0.7 * before, "{after} {before}");

    // Who asks for the layer on the command line gets it, whatever the job says, and the job that is
    // saved is one that renders.
    let mut silent = job(output());
    silent["denoise"] = json!({ "when": "never" });
    let options = ["--aov", "denoised", "--save-job", "b.json"];
    let asked = render(&silent, &options);
    assert_eq!(channels(&read(asked.path(), "a.layers.exr")).len(), 7);
    let again = run(asked.path(), &["render", "b.json"]);
    assert!(again.status.success(), "{}", stderr(&again));
    let contradicts = ["render", "job.json", "--no-denoise", "--aov", "denoised"];
    assert_eq!(run(asked.path(), &contradicts).status.code(), Some(2));
    let mut nowhere = output();
    nowhere["layers"] = json!(null);
    let nowhere = crate::folder(&[("job.json", &job(nowhere).to_string())]);
    for option in ["--denoise", "--aov=depth"] {
        let refused = run(nowhere.path(), &["render", "job.json", option]);
        assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    }

    // Too few samples, and what contradicts itself.
    let folder = folder(&[("job.json", &job(output()).to_string())]);
    let few = run(folder.path(), &["render", "job.json", "--spp", "3", "--denoise"]);
    assert!(few.status.success() && stderr(&few).contains("too few samples to denoise"));
    assert_eq!(channels(&read(folder.path(), "a.layers.exr")).len(), 4);
    let mut both = job(json!({ "image": "a.exr", "aovs": ["denoised"] }));
    both["denoise"] = json!({ "when": "never" });
    let folder = crate::folder(&[("job.json", &both.to_string())]);
    let refused = run(folder.path(), &["check", "job.json"]);
    assert_eq!(refused.status.code(), Some(3), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("remove `denoised` from `aovs`"), "{}", stderr(&refused));
}
