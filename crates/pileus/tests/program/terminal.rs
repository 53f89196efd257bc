//! What reaches the terminal, and what happens where nobody listens.

use std::io::Write;
use std::process::{Output, Stdio};

use serde_json::json;

use crate::{folder, path, pileus, run, stderr};

fn job() -> serde_json::Value {
    json!({
        "lights": [{ "type": "environment", "radiance": 1 }],
        "camera": { "position": [0, 0, 0], "look_at": [0, 0, -1] },
        "film": { "resolution": [8, 8] },
        "sampling": { "spp": 2 },
        "output": { "image": "a.exr" }
    })
}

#[cfg(target_os = "linux")]
fn full() -> Stdio {
    std::fs::File::options().write(true).open("/dev/full").unwrap().into()
}

#[cfg(target_os = "linux")]
#[test]
fn lost_messages_cost_no_picture() {
    let folder = folder(&[("job.json", &job().to_string()), ("bad.json", "{")]);
    for arguments in [vec!["render", "job.json"], vec!["-vv", "render", "job.json"]] {
        let mut command = pileus(folder.path());
        let status = command.args(&arguments).stderr(full()).status().unwrap();
        assert_eq!(status.code(), Some(0), "{arguments:?}");
        assert!(folder.path().join("a.exr").is_file());
        std::fs::remove_file(folder.path().join("a.exr")).unwrap();

        // A pipe that nobody reads.
        let mut command = pileus(folder.path());
        let mut child = command.args(&arguments).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{arguments:?}");
        assert!(folder.path().join("a.exr").is_file());
        std::fs::remove_file(folder.path().join("a.exr")).unwrap();
    }
    // Failures keep their code.
    let mut command = pileus(folder.path());
    let status = command.args(["check", "bad.json"]).stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(3));
}

#[cfg(target_os = "linux")]
#[test]
fn lost_results_are_errors() {
    let cloud = path("scenes/assets/syn_sphere.vdb");
    let folder = folder(&[("job.json", &job().to_string())]);
    for arguments in [
        vec!["schema"],
        vec!["schema", "--properties"],
        vec!["check", "job.json"],
        vec!["plan", "job.json"],
        vec!["info", &cloud, "--json"],
        vec!["--version"],
        vec!["--help"],
    ] {
        let mut command = pileus(folder.path());
        let output = command.args(&arguments).stdout(full()).stderr(Stdio::piped()).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(4), "{arguments:?}: {}", stderr(&output));
    }
    // Who had enough of it need not be told, and nothing failed.
    let mut command = pileus(folder.path());
    let mut child =
        command.arg("schema").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(stderr(&output), "");
}

/// Whether a terminal would obey something in the output.
fn has_controls(output: &Output) -> bool {
    let text = [output.stdout.clone(), output.stderr.clone()].concat();
    let text = String::from_utf8(text).unwrap();
    text.chars()
        .any(|c| c.is_control() && c != '\n' && c != '\t' || ('\u{202a}'..='\u{202e}').contains(&c))
}

#[test]
fn names_do_not_speak_to_the_terminal() {
    let bad = "a\u{1b}[31m\u{9b}2J\u{7}\r\u{202e}b";
    let cloud = path("scenes/assets/syn_sphere.vdb");
    let mut named = job();
    named["volumes"] = json!([{ "name": bad, "vdb": cloud }]);
    let mut missing = job();
    missing["volumes"] = json!([{ "vdb": format!("{bad}.vdb") }]);
    let mut grid = job();
    grid["volumes"] = json!([{ "vdb": cloud, "density": { "grid": bad } }]);
    let mut unknown = job();
    unknown[bad] = 1.into();
    let gltf = json!({
        "asset": { "version": "2.0" },
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 1 } }],
        "nodes": [{ "camera": 0, "name": bad }],
        "scenes": [{ "nodes": [0] }],
        "extensionsUsed": [bad]
    });
    let folder = folder(&[
        ("named.json", &named.to_string()),
        ("missing.json", &missing.to_string()),
        ("grid.json", &grid.to_string()),
        ("unknown.json", &unknown.to_string()),
        ("scene.gltf", &gltf.to_string()),
    ]);
    for arguments in [
        vec!["-v", "render", "named.json"],
        vec!["plan", "named.json"],
        vec!["plan", "named.json", "--json"],
        vec!["info", "named.json"],
        vec!["info", "named.json", "--json"],
        vec!["info", "missing.json"],
        vec!["check", "missing.json"],
        vec!["check", "grid.json"],
        vec!["check", "unknown.json"],
        vec!["check", "scene.gltf"],
        vec!["info", "scene.gltf"],
        vec!["info", "scene.gltf", "--json"],
        vec!["render", &format!("{bad}.vdb")],
    ] {
        let output = run(folder.path(), &arguments);
        assert!(!has_controls(&output), "{arguments:?}: {output:?}");
        assert!(!output.stdout.is_empty() || !output.stderr.is_empty());
    }
    // The names are still told, in a form that a program reads back.
    let plan = run(folder.path(), &["info", "named.json", "--json"]);
    let plan: serde_json::Value = serde_json::from_slice(&plan.stdout).unwrap();
    assert_eq!(plan["job"]["volumes"][0]["name"], bad);
}

#[cfg(unix)]
#[test]
fn jobs_come_through_pipes() {
    let text = format!("\n  {}", job());
    for text in [text.clone(), format!("\u{feff}{text}"), text.replace("\n  ", "")] {
        let folder = folder(&[]);
        for command in ["check", "info", "plan", "render"] {
            let mut child = pileus(folder.path())
                .args([command, "/dev/stdin"])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
            let output = child.wait_with_output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{command}: {}", stderr(&output));
        }
        // Names in it are relative to the current folder.
        assert!(folder.path().join("a.exr").is_file());
    }
}
