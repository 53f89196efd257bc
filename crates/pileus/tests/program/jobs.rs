//! Jobs as people and programs write them, and what is said about those that are wrong.

use serde_json::{Value, json};

use crate::{folder, path, run, sphere_job, stderr};

/// Checks a job's text; returns the exit code and what was said.
fn check(text: &str) -> (i32, String) {
    let folder = folder(&[("job.json", text)]);
    let output = run(folder.path(), &["check", "job.json"]);
    (output.status.code().unwrap(), stderr(&output))
}

fn changed(pointer: &str, value: Value) -> String {
    let mut job = sphere_job();
    match job.pointer_mut(pointer) {
        Some(place) => *place = value,
        None => {
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            job.pointer_mut(parent).unwrap()[key] = value;
        }
    }
    job.to_string()
}

#[test]
fn byte_order_marks_are_passed_over() {
    let text = serde_json::to_string_pretty(&sphere_job()).unwrap();
    let (code, said) = check(&format!("\u{feff}{text}"));
    assert_eq!(code, 0, "{said}");
    // Places count from the first character after it.
    let (code, said) = check("\u{feff}{ \"volums\": [] }");
    assert_eq!(code, 3);
    assert!(said.contains("job.json:1:3 "), "{said}");
    // UTF-16 is told by its name.
    let folder = folder(&[]);
    let wide: Vec<u8> = "\u{feff}{}".encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(folder.path().join("job.json"), wide).unwrap();
    let output = run(folder.path(), &["check", "job.json"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("UTF-16"), "{}", stderr(&output));
}

#[test]
fn whole_numbers_may_have_a_fraction_of_zero() {
    for (from, to) in [
        ("\"spp\":4", "\"spp\":4.0"),
        ("\"spp\":4", "\"spp\":4e0"),
        ("\"spp\":4", "\"spp\":0.4e1"),
        ("[32,20]", "[32.0,2e1]"),
        ("\"spp\":4", "\"spp\":4,\"seed\":7.0,\"max_bounces\":3.0"),
        ("\"resolution\"", "\"crop\":[0.0,0,8.0,8],\"resolution\""),
    ] {
        let text = sphere_job().to_string();
        assert!(text.contains(from), "{text}");
        let (code, said) = check(&text.replace(from, to));
        assert_eq!(code, 0, "{to}: {said}");
    }
    for wrong in ["4.5", "-1.0", "1e20", "\"4\"", "18446744073709551616"] {
        for key in ["spp", "seed"] {
            let text = sphere_job().to_string();
            let text = text.replace("\"spp\":4", &format!("\"{key}\":{wrong}"));
            let (code, said) = check(&text);
            assert_eq!(code, 3, "{key} {wrong}: {said}");
            assert!(said.contains(&format!("/sampling/{key}")), "{wrong}: {said}");
            assert!(said.contains("whole number"), "{wrong}: {said}");
        }
    }
}

#[test]
fn numbers_that_json_does_not_have_are_named() {
    for (text, word) in [
        ("NaN", "`NaN`"),
        ("nan", "`nan`"),
        ("Infinity", "`Infinity`"),
        ("-Infinity", "`Infinity`"),
        ("-inf", "`inf`"),
    ] {
        let (code, said) = check(&sphere_job().to_string().replace("4.0", text));
        assert_eq!(code, 3, "{text}: {said}");
        assert!(said.contains(word) && said.contains("not a number that JSON has"), "{said}");
    }
}

#[test]
fn lists_are_no_objects() {
    for (text, place) in [
        ("[]".to_owned(), "top level"),
        ("[null, \"a.gltf\"]".into(), "top level"),
        (changed("/film", json!([[8, 8]])), "/film"),
        (changed("/film", json!([])), "/film"),
        (changed("/sampling", json!([4])), "/sampling"),
        (changed("/camera", json!([null, [0, 0, 0], [0, 0, -1]])), "/camera"),
        (changed("/lights/0", json!(["point", [0, 0, 0], 1])), "/lights/0"),
        (changed("/volumes/0/density", json!([null, 4.0])), "/volumes/0/density"),
        (changed("/volumes/0/law", json!(["power", 3])), "/volumes/0/law"),
    ] {
        let (code, said) = check(&text);
        assert_eq!(code, 3, "{text}: {said}");
        assert!(said.contains(place), "{text}: {said}");
    }
}

#[test]
fn keys_of_features_that_are_missing_say_so() {
    for (pointer, words) in [
        ("/camera/f_stop", "depth of field"),
        ("/camera/lens_radius", "`aperture`"),
        ("/output/denoise", "denoised"),
        ("/sampling/denoise", "denoised"),
        ("/camera/motion_blur", "motion"),
        ("/frames", "sequences of frames"),
        ("/output/cryptomatte", "such layers"),
        ("/sampling/time_limit", "up to a noise or a time"),
        ("/output/resume", "not resumed"),
        ("/materials", "glTF"),
    ] {
        let mut job = sphere_job();
        job["camera"] = json!({ "position": [0, 0, 9], "look_at": [0, 0, 0] });
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        job.pointer_mut(parent).unwrap()[key] = 1.into();
        let (code, said) = check(&job.to_string());
        assert_eq!(code, 5, "{pointer}: {said}");
        assert!(said.contains(words) && said.contains(pointer), "{pointer}: {said}");
        assert!(said.contains("help: ") && !said.contains("did you mean"), "{pointer}: {said}");
    }
}

/// A wrong command line is 2, a wrong file 3, whatever the value.
#[test]
fn exit_codes_tell_whose_fault_it_is() {
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let folder = folder(&[
        ("job.json", &sphere_job().to_string()),
        ("zero.json", &changed("/sampling/spp", json!(0))),
        ("large.json", &changed("/film/resolution", json!([100_000, 100_000]))),
        ("grid.json", &changed("/volumes/0/density/grid", json!("smoke"))),
        ("rays.json", r#"{"rays":[]}"#),
        ("points.json", r#"{"space":"index","points":[]}"#),
    ]);
    for (arguments, code, word) in [
        (vec!["check", "zero.json"], 3, "/sampling/spp"),
        (vec!["render", "job.json", "--spp", "0"], 2, "--spp"),
        (vec!["render", "job.json", "--spp", "4294967297"], 2, "--spp"),
        (vec!["render", "job.json", "--seed", "18446744073709551616"], 2, "--seed"),
        (vec!["check", "large.json"], 3, "/film/resolution"),
        (vec!["render", "job.json", "--resolution", "100000x100000"], 2, "2^28"),
        (vec!["check", "grid.json"], 3, "smoke"),
        (vec!["check", &sphere, "--grid", "smoke"], 2, "--grid NAME"),
        (
            vec!["probe", "values", &sphere, "--grid", "smoke", "--points", "points.json"],
            2,
            "smoke",
        ),
        #[cfg(feature = "lab")]
        (vec!["chart", "render", "job.json", "--methods", "dleta+ratio"], 2, "dleta+ratio"),
        #[cfg(feature = "lab")]
        (vec!["compare", "a.exr", "b.exr", "--difference", "c.jpg"], 2, "neither"),
    ] {
        let output = run(folder.path(), &arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(said.contains(word), "{arguments:?}: {said}");
    }
    // Advice on the command line is in its words.
    let level_set = path("tests/data/conformance/levelset_bg.vdb");
    let output = run(folder.path(), &["check", &level_set]);
    let said = stderr(&output);
    assert!(said.contains("--grid NAME") && !said.contains("`density`:"), "{said}");
}

#[test]
fn the_version_names_its_commit() {
    let folder = folder(&[]);
    let said = String::from_utf8(run(folder.path(), &["--version"]).stdout).unwrap();
    assert!(said.starts_with(&format!("pileus {}", env!("CARGO_PKG_VERSION"))), "{said}");
    // From an archive there is none.
    let commit = said.trim_end().split_once(" (").map(|(_, rest)| rest.trim_end_matches(')'));
    if let Some(commit) = commit {
        assert!(commit.len() >= 7 && commit.bytes().all(|b| b.is_ascii_hexdigit()), "{said}");
    }
}

#[test]
fn one_table_has_all_custom_properties() {
    let folder = folder(&[]);
    let table = String::from_utf8(run(folder.path(), &["schema", "--properties"]).stdout).unwrap();
    let known = pileus_scene::gltf::custom_properties();
    assert!(known.len() > 30);
    for (name, meaning) in known {
        let row = format!("| `{name}` | {meaning} |");
        assert!(!meaning.is_empty() && table.lines().any(|line| line == row), "{name}");
    }
    let page = std::fs::read_to_string(crate::root().join("docs/book/src/first-pictures.md"));
    assert!(page.unwrap().replace("\r\n", "\n").contains(table.trim_end()), "the book is stale");
}

/// What artists see is noise and time; figures about methods are for those who ask.
#[test]
fn figures_of_methods_are_shown_on_request() {
    let folder = folder(&[("job.json", &sphere_job().to_string())]);
    let said = stderr(&run(folder.path(), &["render", "job.json"]));
    assert!(said.contains("noise") && said.contains("samples per pixel in"), "{said}");
    assert!(!said.contains("lookups") && !said.contains("paths/s"), "{said}");
    let said = stderr(&run(folder.path(), &["-v", "render", "job.json"]));
    assert!(said.contains("lookups") && said.contains("paths/s"), "{said}");
}

/// A limit kept in single precision is the number that is written of it, not the double that it
/// widens to.
#[test]
fn limits_are_the_numbers_that_are_written() {
    let fibre = |roughness: f64| {
        json!({ "type": "sggx", "flakes": "specular",
            "distribution": { "shape": "fibre", "axis": [0, 0, 1], "roughness": roughness } })
    };
    let lobe = |g: f64| json!({ "type": "henyey_greenstein", "g": g });
    for (phase, allowed) in [
        (fibre(0.001), true),
        (fibre(0.000_999_9), false),
        (lobe(0.999), true),
        (lobe(-0.999), true),
        (lobe(0.999_000_01), false),
    ] {
        let mut job = sphere_job();
        job["volumes"] = json!([{
            "homogeneous": { "sigma_t": 1, "bounds": [[-1, -1, -1], [1, 1, 1]] }, "phase": phase
        }]);
        let folder = folder(&[("job.json", &job.to_string())]);
        let said = run(folder.path(), &["plan", "job.json"]);
        assert_eq!(said.status.success(), allowed, "{phase}: {}", stderr(&said));
    }
}
