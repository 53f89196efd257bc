//! Nothing is overwritten that is read, and nothing is rendered that cannot be written.

use std::collections::BTreeMap;
use std::path::Path;

use pileus_film::read_exr;
use serde_json::{Value, json};

use crate::{folder, path, run, stderr};

/// A job that would take forever, if it were rendered.
fn endless(output: Value) -> Value {
    json!({
        "lights": [{ "type": "environment", "radiance": 1 }],
        "camera": { "position": [0, 0, 0], "look_at": [0, 0, -1] },
        "film": { "resolution": [8, 8] },
        "sampling": { "spp": 1_000_000_000 },
        "output": output
    })
}

/// A job that takes no time.
fn quick(output: Value) -> Value {
    let mut job = endless(output);
    job["sampling"]["spp"] = 2.into();
    job
}

/// All files of a folder, with what is in them; links and pipes by name alone.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    entries
        .map(|entry| {
            let name = entry.file_name().to_string_lossy().into_owned();
            let plain = entry.file_type().unwrap().is_file();
            (name, if plain { std::fs::read(entry.path()).unwrap() } else { Vec::new() })
        })
        .collect()
}

fn names(folder: &Path) -> Vec<String> {
    contents(folder).into_keys().collect()
}

/// Runs `render` and `check` on a job: both must refuse it, with the code and words, and touch
/// nothing.
fn refused(folder: &Path, job: &Value, code: i32, words: &[&str]) {
    std::fs::write(folder.join("job.json"), job.to_string()).unwrap();
    let before = contents(folder);
    for command in ["check", "render"] {
        let output = run(folder, &[command, "job.json"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{command} {job}: {said}");
        for word in words {
            assert!(said.contains(word), "{command} {job}: {said}");
        }
        assert!(said.contains("help: ") || code == 4, "{said}");
        assert!(contents(folder) == before, "{command} {job} changed files");
    }
}

fn sky(folder: &Path) {
    exr::prelude::write_rgb_file(folder.join("sky.exr"), 4, 2, |_, _| (1f32, 1f32, 1f32)).unwrap();
}

#[test]
fn outputs_do_not_overwrite_each_other() {
    let folder = folder(&[("sub/x", "")]);
    for output in [
        json!({ "image": "both.exr", "stats": "both.exr" }),
        json!({ "image": "a.exr", "stats": "a.png", "preview": "a.png" }),
        json!({ "image": "a.exr", "stats": "sub/../a.exr" }),
        json!({ "image": "a.exr", "stats": "./a.png" }),
        json!({ "image": "a.exr", "layers": "a.exr" }),
        json!({ "image": "a.exr", "stats": "a.layers.exr" }),
    ] {
        let word = "would overwrite";
        refused(folder.path(), &endless(output), 3, &[word, "job.json:1:", "/output"]);
    }
    // By options the command line is at fault.
    let job = endless(json!({ "stats": "b.png" }));
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let output = run(folder.path(), &["render", "job.json", "--preview", "b.png"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let output = run(folder.path(), &["render", "job.json", "-o", "a.exr", "--save-job", "a.exr"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
}

#[test]
fn inputs_are_not_overwritten() {
    let folder = folder(&[
        ("table.csv", "0, 1\n180, 1\n"),
        ("law.txt", "0, 1\n1, 0.3\n"),
        ("wood.png", "any"),
        ("mesh.bin", "any"),
        ("sub/x", ""),
        (
            "scene.gltf",
            r#"{"asset":{"version":"2.0"},"images":[{"uri":"wood.png"}],
                "buffers":[{"uri":"mesh.bin","byteLength":3}]}"#,
        ),
    ]);
    sky(folder.path());
    let cloud = path("scenes/assets/syn_sphere.vdb");
    std::fs::copy(cloud, folder.path().join("cloud.0001.vdb")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("sky.exr", folder.path().join("link.exr")).unwrap();
        std::fs::hard_link(folder.path().join("sky.exr"), folder.path().join("hard.exr")).unwrap();
        std::os::unix::fs::symlink("sub", folder.path().join("other")).unwrap();
    }
    let with = |output: Value| {
        let mut job = endless(output);
        job["lights"] = json!([{ "type": "environment", "image": "sky.exr" }]);
        job["scene"] = "scene.gltf".into();
        job["volumes"] = json!([
            {
                "vdb": "cloud.####.vdb", "frame": 1,
                "phase": { "type": "tabulated", "file": "table.csv" }
            },
            {
                "homogeneous": { "sigma_t": 1, "bounds": [[0, 0, 0], [1, 1, 1]] },
                "law": { "type": "table", "file": "law.txt" }
            }
        ]);
        job
    };
    let mut cases = vec![
        json!({ "image": "sky.exr" }),
        json!({ "image": "sub/../sky.exr" }),
        json!({ "image": "a.exr", "stats": "job.json" }),
        json!({ "image": "a.exr", "stats": "cloud.0001.vdb" }),
        json!({ "image": "a.exr", "stats": "table.csv" }),
        json!({ "image": "a.exr", "stats": "law.txt" }),
        json!({ "image": "a.exr", "stats": "scene.gltf" }),
        json!({ "image": "a.exr", "stats": "mesh.bin" }),
        json!({ "image": "a.exr", "preview": "wood.png" }),
        // Nobody named the preview.
        json!({ "image": "wood.exr" }),
        json!({ "image": "a.exr", "layers": "sky.exr" }),
    ];
    if cfg!(unix) {
        cases.push(json!({ "image": "link.exr" }));
        cases.push(json!({ "image": "hard.exr" }));
        cases.push(json!({ "image": "other/../sky.exr" }));
    }
    for output in cases {
        refused(folder.path(), &with(output), 3, &["would overwrite", "which is read"]);
    }
    // What is refused by default is possible by request.
    let mut job =
        with(json!({ "image": "wood.exr", "preview": null, "stats": null, "layers": null }));
    job["sampling"]["spp"] = 1.into();
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let before = names(folder.path());
    let output = run(folder.path(), &["render", "job.json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let mut after = names(folder.path());
    after.retain(|name| !before.contains(name));
    assert_eq!(after, ["wood.exr"]);
}

#[cfg(feature = "lab")]
#[test]
fn other_commands_overwrite_nothing_either() {
    let folder = folder(&[("a.json", &quick(json!({ "image": "a.exr" })).to_string())]);
    let here = folder.path();
    assert!(run(here, &["render", "a.json"]).status.success());
    std::fs::create_dir_all(here.join("sub")).unwrap();
    std::fs::copy(here.join("a.json"), here.join("sub/a.json")).unwrap();
    std::fs::write(here.join("render-a.csv"), "scene,renderer,seconds,relmse\n").unwrap();
    let before = contents(here);
    for arguments in [
        vec!["compare", "a.exr", "a.exr", "--difference", "a.exr"],
        vec!["chart", "render", "a.json", "-o", ".", "--peers", "render-a.csv", "--seconds", "1"],
        vec!["chart", "render", "a.json", "sub/a.json", "-o", "charts", "--seconds", "1"],
        vec!["chart", "majorants", "a.json", "sub/a.json", "-o", "charts"],
    ] {
        let output = run(here, &arguments);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("overwrite"), "{arguments:?}: {said}");
        assert!(contents(here) == before, "{arguments:?}");
    }
}

#[test]
fn what_cannot_be_written_is_found_before_rendering() {
    let long = format!("{}.exr", "x".repeat(300));
    let folder = folder(&[("file", ""), ("folder.exr/x", "")]);
    std::fs::create_dir_all(folder.path().join("folder.json")).unwrap();
    for (output, word) in [
        (json!({ "image": "folder.exr" }), "folder"),
        (json!({ "image": "a.exr", "stats": "folder.json" }), "folder"),
        (json!({ "image": "no/a.exr" }), "create it first"),
        (json!({ "image": "a.exr", "preview": "no/a.png" }), "create it first"),
        (json!({ "image": "file/a.exr" }), "not a folder"),
        (json!({ "image": long }), "cannot be written"),
        (json!({ "image": "a\u{0}.exr" }), "a"),
    ] {
        let code = if word == "a" { 3 } else { 4 };
        refused(folder.path(), &endless(output), code, &[word]);
    }
    let protected = folder.path().join("protected.exr");
    std::fs::write(&protected, "kept").unwrap();
    let mut permissions = std::fs::metadata(&protected).unwrap().permissions();
    permissions.set_readonly(true);
    std::fs::set_permissions(&protected, permissions).unwrap();
    refused(folder.path(), &endless(json!({ "image": "protected.exr" })), 4, &["protected"]);
    // Nobody but the superuser writes everywhere.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let closed = folder.path().join("closed");
        std::fs::create_dir(&closed).unwrap();
        std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
        if std::fs::write(closed.join("x"), "").is_err() {
            let job = endless(json!({ "image": "closed/a.exr" }));
            refused(folder.path(), &job, 4, &["not writable"]);
        }
    }
}

/// Names of 255 bytes are as long as names can be, and can be written.
#[test]
fn long_names_are_written() {
    let name = format!("{}.exr", "x".repeat(251));
    let job = quick(json!({ "image": name, "preview": "a.png", "stats": null, "layers": null }));
    let folder = folder(&[("job.json", &job.to_string())]);
    let output = run(folder.path(), &["render", "job.json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(folder.path().join(&name).is_file());
}

#[cfg(target_os = "linux")]
#[test]
fn devices_are_not_replaced() {
    use std::os::unix::fs::FileTypeExt;
    use std::process::Command;
    let folder = folder(&[("a", "")]);
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    refused(folder.path(), &endless(json!({ "image": "a.exr", "stats": "pipe" })), 4, &["pipe"]);
    assert!(std::fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
    // The library that writes refuses as well.
    let error = pileus_film::write_atomically(&pipe, |_| Ok(())).unwrap_err();
    assert!(error.place() == pipe && error.to_string().contains("a device or pipe"), "{error}");
    assert!(std::fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
}

/// A limit on the size of files stands for a full disk: what is larger is refused before hours are
/// spent, and nothing is left.
#[cfg(target_os = "linux")]
#[test]
fn space_is_tried_out_before_rendering() {
    use std::process::Command;
    let mut job = endless(json!({ "image": "a.exr" }));
    job["film"]["resolution"] = json!([256, 256]);
    let folder = folder(&[("job.json", &job.to_string())]);
    for command in ["check", "render"] {
        let script = format!(
            "trap '' XFSZ; ulimit -f 64; exec '{}' {command} job.json",
            env!("CARGO_BIN_EXE_pileus")
        );
        let mut shell = Command::new("sh");
        let output = shell.args(["-c", &script]).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
        assert!(stderr(&output).contains("a.exr"), "{}", stderr(&output));
        assert_eq!(names(folder.path()), ["job.json"]);
    }
}

#[test]
fn pictures_and_statistics_stand_beside_the_image_unless_refused() {
    let image = json!({ "image": "a.exr" });
    for (output, options, expected) in [
        (image.clone(), vec![], vec!["a.exr", "a.layers.exr", "a.png", "a.stats.json"]),
        (image.clone(), vec!["--no-stats"], vec!["a.exr", "a.layers.exr", "a.png"]),
        (image.clone(), vec!["--no-layers"], vec!["a.exr", "a.png", "a.stats.json"]),
        (image.clone(), vec!["--no-preview"], vec!["a.exr", "a.layers.exr", "a.stats.json"]),
        (
            json!({ "image": "a.exr", "preview": null, "stats": null, "layers": null }),
            vec![],
            vec!["a.exr"],
        ),
        (
            json!({ "image": "a.exr", "preview": "b.png", "layers": "b.exr" }),
            vec![],
            vec!["a.exr", "a.stats.json", "b.exr", "b.png"],
        ),
        (
            json!({ "image": "a.exr", "layers": "b.exr" }),
            vec!["-o", "c.exr"],
            vec!["c.exr", "c.layers.exr", "c.png", "c.stats.json"],
        ),
    ] {
        let folder = folder(&[("job.json", &quick(output).to_string())]);
        let mut arguments = vec!["check", "job.json"];
        if options.is_empty() {
            let output = run(folder.path(), &arguments);
            let said = String::from_utf8(output.stdout).unwrap();
            for name in &expected {
                assert!(said.contains(&format!("writes {name}")), "{said}");
            }
            assert_eq!(said.matches("writes ").count(), expected.len(), "{said}");
        }
        arguments[0] = "render";
        arguments.extend(&options);
        let output = run(folder.path(), &arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        let mut written = names(folder.path());
        written.retain(|name| name != "job.json");
        assert_eq!(written, expected);
    }
    // Scenes and volumes without a job do the same.
    let gltf = r#"{"asset":{"version":"2.0"},"cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":1}}],
        "nodes":[{"camera":0}],"scenes":[{"nodes":[0]}]}"#;
    let folder = folder(&[("shot.gltf", gltf)]);
    let small = ["--spp", "1", "--resolution", "8x8"];
    let output = run(folder.path(), &[&["render", "shot.gltf"], &small[..]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let expected = ["shot.exr", "shot.gltf", "shot.layers.exr", "shot.png", "shot.stats.json"];
    assert_eq!(names(folder.path()), expected);
}

#[test]
fn frame_numbers_are_not_filled_into_outputs() {
    let folder = folder(&[]);
    for output in [
        json!({ "image": "a.exr", "layers": "fire.#.exr" }),
        json!({ "image": "a.exr", "preview": "fire.#.png" }),
        json!({ "image": "a.exr", "stats": "fire.#.json" }),
        json!({ "image": "fire.####.exr" }),
    ] {
        refused(folder.path(), &endless(output), 5, &["no frame number", "/output/"]);
    }
    let job = endless(json!({ "image": "a.exr" }));
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    let output = run(folder.path(), &["render", "job.json", "-o", "fire.##.exr"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
}

#[test]
fn what_killed_programs_left_is_removed() {
    let job = quick(json!({ "image": "a.exr", "preview": null, "stats": null, "layers": null }));
    let left = [
        (".pileus-a8Bc01.tmp", "part of an image"),
        (".pileus-a8Bc012.tmp", "not ours"),
        (".pileus-4194305-0.tmp", ""),
        (".pileus-1-77.tmp", "part of an image"),
        (".pileus-x-77.tmp", "not ours"),
        ("pileus-1-77.tmp", "not ours"),
        (".pileus-1-77.tmp2", "not ours"),
    ];
    let folder = folder(&left);
    std::fs::write(folder.path().join("job.json"), job.to_string()).unwrap();
    // Another program is writing this one.
    let locked = std::fs::File::create(folder.path().join(".pileus-2-2.tmp")).unwrap();
    locked.lock().unwrap();
    let output = run(folder.path(), &["render", "job.json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(
        names(folder.path()),
        [
            ".pileus-1-77.tmp2",
            ".pileus-2-2.tmp",
            ".pileus-a8Bc012.tmp",
            ".pileus-x-77.tmp",
            "a.exr",
            "job.json",
            "pileus-1-77.tmp"
        ]
    );
}

#[test]
fn saved_jobs_render_the_same_image() {
    let cloud = path("scenes/assets/syn_sphere.vdb");
    let folder = folder(&[("jobs/x", ""), ("elsewhere/x", "")]);
    let small = ["--spp", "3", "--seed", "5", "--resolution", "12x8"];
    let arguments = [&["render", &cloud, "--save-job", "jobs/sphere.json"], &small[..]].concat();
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let elsewhere = folder.path().join("elsewhere");
    let output = run(&elsewhere, &["render", "../jobs/sphere.json", "-o", "again.exr"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let first = read_exr(&folder.path().join("syn_sphere.exr")).unwrap();
    let again = read_exr(&elsewhere.join("again.exr")).unwrap();
    for channel in ["R", "G", "B", "A"] {
        assert_eq!(first.channel(channel).unwrap(), again.channel(channel).unwrap());
    }
    let png = |path: &Path| std::fs::read(path).unwrap();
    assert_eq!(png(&folder.path().join("syn_sphere.png")), png(&elsewhere.join("again.png")));
    // It is not written over anything, the volume included.
    let output = run(folder.path(), &["render", &cloud, "--save-job", &cloud]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(std::fs::read(&cloud).unwrap().starts_with(b" BDV"));
}

/// In a job a `#` stands for digits of a frame; on the command line a name is a name.
#[test]
fn files_on_the_command_line_may_have_a_hash_in_their_name() {
    let folder = folder(&[]);
    let name = "take#2.vdb";
    std::fs::copy(path("scenes/assets/syn_sphere.vdb"), folder.path().join(name)).unwrap();
    let output = run(folder.path(), &["render", name, "--spp", "1", "--resolution", "8x8"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(folder.path().join("take#2.exr").exists());
}
