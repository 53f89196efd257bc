//! Image files that other programs wrote: exit codes and what is said about them.

use crate::{folder, json, path, run, sphere_job, stderr};

fn case(name: &str) -> String {
    path(&format!("tests/data/cases/environment/{name}"))
}

/// Checks a job lit by an image; exit code and what was said.
fn check(image: &str) -> (i32, String) {
    let job = serde_json::json!({
        "lights": [{ "type": "environment", "image": image }],
        "camera": { "position": [0, 0, 0], "look_at": [0, 0, -1], "fov_y": 5 },
        "film": { "resolution": [4, 4] },
        "output": { "image": "out.exr" }
    });
    let here = folder(&[("job.json", &job.to_string())]);
    let output = run(here.path(), &["check", "job.json"]);
    (output.status.code().unwrap(), stderr(&output))
}

#[test]
fn environments_that_cannot_be_read_say_what_they_are() {
    for (name, words) in [
        ("env_ht.exr", &["HTJ2K256", "ZIP or PIZ"][..]),
        ("zstd.exr", &["ZSTD", "ZIP or PIZ"]),
        ("lj2k.exr", &["LJ2K", "ZIP or PIZ"]),
        ("env_cube.exr", &["cube", "latitude and longitude"]),
    ] {
        let (code, said) = check(&case(name));
        assert_eq!(code, 5, "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
    let here = tempfile::tempdir().unwrap();
    let broken = here.path().join("broken.exr");
    let whole = std::fs::read(case("env_plain.exr")).unwrap();
    std::fs::write(&broken, &whole[..whole.len() - 9]).unwrap();
    let (code, said) = check(&broken.to_string_lossy());
    assert_eq!(code, 3, "{said}");
    assert!(!said.contains("panicked"), "{said}");
    assert_eq!(check("nothing.exr").0, 4);
}

#[test]
fn environments_that_are_read_in_another_way_than_they_stand_say_so() {
    for (name, words) in [
        ("env_plain.exr", &[][..]),
        ("env_ap1.exr", &["ACEScg", "linear Rec. 709"]),
        ("env_crop.exr", &["16 x 4", "16 x 8", "display window"]),
        ("env_exposure.hdr", &["divided by its EXPOSURE, 2"]),
        ("env_rgbe.hdr", &[]),
        ("env_layer.exr", &[]),
        ("env_y.exr", &[]),
    ] {
        let (code, said) = check(&case(name));
        assert_eq!(code, 0, "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{name}: {said}");
        assert!(!words.is_empty() || !said.contains("WARN"), "{name}: {said}");
    }
}

#[test]
fn info_shows_what_an_image_holds() {
    let mut job = sphere_job();
    job["film"]["resolution"] = serde_json::json!([4, 4]);
    let here = folder(&[("job.json", &job.to_string())]);
    let output = run(here.path(), &["render", "job.json", "--spp", "2"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let info = json(here.path(), &["info", "sphere.exr", "--json"]);
    let part = &info["parts"][0];
    assert_eq!(part["color_space"], "linear Rec. 709");
    assert_eq!(part["compression"], "ZIP");
    assert_eq!(part["layers"], serde_json::json!([]));
    assert_eq!(part["data_window"], serde_json::json!([0, 0, 4, 4]));
    let channels = part["channels"].as_array().unwrap();
    assert!(channels.iter().any(|c| c["name"] == "R" && c["type"].is_string()));
    let metadata = &part["metadata"];
    assert_eq!(metadata["pileus:job"]["volumes"][0]["density"]["scale"], 4.0);
    assert_eq!(metadata["pileus:plan"]["kernel"]["events"], "one_grid", "{metadata}");
    assert!(metadata["pileus:counters"].is_object());
    assert_eq!(metadata["pileus:samples"], "2");

    let output = run(here.path(), &["info", "sphere.exr"]);
    let text = String::from_utf8(output.stdout).unwrap();
    for word in ["OpenEXR, 1 part", "4 x 4, ZIP", "\"density\"", "Pileus"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let output = run(here.path(), &["info", "sphere.layers.exr"]);
    let text = String::from_utf8(output.stdout).unwrap();
    for word in ["OpenEXR, 1 part", "layers: variance, variance_alpha", "\"density\"", "Pileus"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    // What cannot be rendered is described too, by its content whatever its name.
    let named = here.path().join("picture");
    std::fs::copy(case("lj2k.exr"), &named).unwrap();
    let output = run(here.path(), &["info", "picture"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("LJ2K"), "{text}");
    std::fs::write(here.path().join("no.exr"), "no image").unwrap();
    assert_eq!(run(here.path(), &["info", "no.exr"]).status.code(), Some(3));
}

#[cfg(feature = "lab")]
#[test]
fn compare_reads_lossy_and_grey_files() {
    use exr::prelude as x;
    let here = tempfile::tempdir().unwrap();
    let write = |name: &str, channel: &str, compression, shift: f32| {
        let value = |i: usize| 0.5 + 0.4 * ((i % 64) as f32 * 0.1).sin() + shift;
        let half = (0..64 * 32).map(|i| x::f16::from_f32(value(i))).collect();
        let list = if channel == "RGB" { vec!["B", "G", "R"] } else { vec![channel] };
        let samples = x::FlatSamples::F16(half);
        let channels = list.into_iter().map(|name| x::AnyChannel::new(name, samples.clone()));
        let encoding = x::Encoding {
            compression,
            blocks: x::Blocks::ScanLines,
            line_order: x::LineOrder::Increasing,
        };
        let channels = x::AnyChannels::sort(channels.collect());
        let layer = x::Layer::new((64, 32), x::LayerAttributes::default(), encoding, channels);
        let image = x::Image::from_layer(layer);
        let path = here.path().join(name);
        x::WritableImage::write(&image).non_parallel().to_file(path).unwrap();
    };
    write("plain.exr", "RGB", x::Compression::ZIP16, 0.0);
    write("dwaa.exr", "RGB", x::Compression::DWAA(None), 0.0);
    write("dwab.exr", "RGB", x::Compression::DWAB(None), 0.0);
    write("grey.exr", "V", x::Compression::ZIP16, 0.25);
    for (name, difference) in [("dwaa.exr", 0.0), ("dwab.exr", 0.0), ("grey.exr", 0.25)] {
        let result = json(here.path(), &["compare", name, "plain.exr", "--json"]);
        for channel in result["mean_difference"].as_array().unwrap() {
            assert!((channel.as_f64().unwrap() - difference).abs() < 3e-3, "{name}: {result}");
        }
    }
    // Numbers in different spaces are compared as they are, not without a word.
    let output = run(here.path(), &["compare", &case("env_ap1.exr"), &case("env_plain.exr")]);
    let said = stderr(&output);
    assert!(output.status.success() && said.contains("A is in linear AP1 (ACEScg)"), "{said}");
}

#[test]
fn files_named_vdb_that_are_none_are_named() {
    let here = tempfile::tempdir().unwrap();
    for (bytes, code, words) in [
        (&b"NanoVDB2\0\0\0\0\0\0\0\0"[..], 5, &["NanoVDB", "nanovdb_convert"][..]),
        (b"\x1f\x8b\x08\0\0\0", 5, &["gzip", "unpack"]),
        (b"version https://git-lfs.github.com/spec/v1\n", 5, &["git lfs pull"]),
        (b"", 3, &["empty"]),
    ] {
        std::fs::write(here.path().join("a.vdb"), bytes).unwrap();
        for command in ["info", "check"] {
            let output = run(here.path(), &[command, "a.vdb"]);
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(code), "{said}");
            assert!(words.iter().all(|word| said.contains(word)), "{said}");
        }
    }
}
