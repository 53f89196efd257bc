//! Images, their metadata and stats; `pileus compare`.

use std::path::Path;

use pileus_film::{Image, MetaValue, read_exr};
use serde_json::Value;

use crate::{folder, json, path, run, sphere_job, stderr};

fn render(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

fn text<'a>(image: &'a Image, name: &str) -> &'a str {
    match image.meta(name) {
        Some(MetaValue::Text(text)) => text,
        other => panic!("{name}: {other:?}"),
    }
}

fn mean(image: &Image, channel: &str) -> f64 {
    let plane = image.channel(channel).unwrap();
    plane.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.len() as f64
}

#[test]
fn a_job_gives_an_image_that_knows_how_it_came_about() {
    let folder = folder(&[("sub/job.json", &sphere_job().to_string())]);
    render(folder.path(), &["render", "sub/job.json", "--seed", "9"]);
    let image = read_exr(&folder.path().join("sub/sphere.exr")).unwrap();
    assert_eq!((image.width(), image.height()), (32, 20));
    assert_eq!(image.channels().len(), 4);
    let job: Value = serde_json::from_str(text(&image, "pileus:job")).unwrap();
    assert_eq!(job["sampling"]["seed"], 9);
    assert_eq!(job["volumes"][0]["density"]["grid"], "density");
    assert!(job["camera"]["position"].is_array());
    assert_eq!(text(&image, "pileus:samples"), "4");
    assert_eq!(text(&image, "pileus:version"), env!("CARGO_PKG_VERSION"));
    let counters: Value = serde_json::from_str(text(&image, "pileus:counters")).unwrap();
    assert_eq!(counters["paths"], 32 * 20 * 4);
    assert!(serde_json::from_str::<Value>(text(&image, "pileus:plan")).unwrap().is_object());

    let stats = std::fs::read_to_string(folder.path().join("sub/sphere.stats.json")).unwrap();
    let stats: Value = serde_json::from_str(&stats).unwrap();
    for key in ["load", "build", "render", "write", "total"] {
        assert!(stats["seconds"][key].as_f64().unwrap() >= 0.0, "{key}");
    }
    for key in ["paths", "lookups", "majorant_steps", "collisions", "null_collisions"] {
        assert!(stats[key].as_u64().unwrap() > 0, "{key}");
    }
    assert_eq!(
        (&stats["samples"], &stats["violations"], &stats["dropped"]),
        (&4.into(), &0.into(), &0.into())
    );
    assert_eq!(stats["job_hash"].as_str().unwrap(), text(&image, "pileus:job_hash"));
    // What the plan expected and what was measured, of 2560 paths: within three standard deviations
    // of the prepass's 512, some 5 % each.
    let (expected, measured) = (&stats["plan"]["predicted"], &stats["plan"]["measured"]);
    for key in
        ["lookups_per_path", "steps_per_path", "lookups_per_collision", "steps_per_collision"]
    {
        let ratio = measured[key].as_f64().unwrap() / expected[key].as_f64().unwrap();
        assert!((0.8..1.25).contains(&ratio), "{key}: {ratio}");
    }
    let count = |key: &str| stats[key].as_f64().unwrap();
    let per_path = count("lookups") / count("paths");
    assert_eq!(measured["lookups_per_path"].as_f64().unwrap(), per_path);
    let per_collision = measured["steps_per_collision"].as_f64().unwrap();
    assert!((per_collision * count("collisions") / count("majorant_steps") - 1.0).abs() < 1e-12);
    if cfg!(target_os = "linux") {
        assert!(stats["peak_memory_bytes"].as_u64().unwrap() > 1_000_000);
    }
    // The recorded job renders the same image again.
    std::fs::write(folder.path().join("sub/again.json"), text(&image, "pileus:job")).unwrap();
    render(folder.path(), &["render", "sub/again.json", "-o", "again.exr"]);
    let again = read_exr(&folder.path().join("again.exr")).unwrap();
    assert_eq!(text(&again, "pileus:job_hash"), text(&image, "pileus:job_hash"));
    assert_eq!(mean(&again, "G"), mean(&image, "G"));
}

#[test]
fn threads_change_no_bit_and_seeds_do() {
    let folder = folder(&[("job.json", &sphere_job().to_string())]);
    let bytes = |arguments: &[&str]| {
        let mut all = vec!["render", "job.json", "-o", "a.exr"];
        all.extend(arguments);
        render(folder.path(), &all);
        std::fs::read(folder.path().join("a.exr")).unwrap()
    };
    let one = bytes(&["--threads", "1"]);
    assert_eq!(one, bytes(&["--threads", "3"]));
    assert_ne!(one, bytes(&["--seed", "1"]));
    let image = |arguments: &[&str]| {
        bytes(arguments);
        read_exr(&folder.path().join("a.exr")).unwrap()
    };
    let small = image(&["--resolution", "7x5", "--spp", "2"]);
    assert_eq!((small.width(), small.height()), (7, 5));
    assert_eq!(text(&small, "pileus:samples"), "2");
}

#[test]
fn a_volume_alone_looks_like_a_cloud() {
    let here = tempfile::tempdir().unwrap();
    let cloud = path("scenes/assets/cumulus_small.vdb");
    let said = render(here.path(), &["render", &cloud, "--spp", "8", "--resolution", "64x36"]);
    assert!(said.contains("framed") && said.contains("default sky"), "{said}");
    for name in ["cumulus_small.exr", "cumulus_small.png", "cumulus_small.stats.json"] {
        assert!(here.path().join(name).is_file(), "{name}");
    }
    let image = read_exr(&here.path().join("cumulus_small.exr")).unwrap();
    let alpha = image.channel("A").unwrap();
    let coverage = mean(&image, "A");
    assert!((0.1..0.8).contains(&coverage), "{coverage}");
    let solid = alpha.iter().filter(|&&a| a > 0.9).count() as f64 / alpha.len() as f64;
    assert!(solid > 0.1, "{solid}");
    // Nothing of the volume is cut off: the border shows the sky alone.
    for x in 0..64 {
        assert!(image.get("A", x, 0).unwrap() < 0.2 && image.get("A", x, 35).unwrap() < 0.2);
    }
    // White, and brighter than the sky behind it in places.
    let bright = image.channel("R").unwrap().iter().zip(alpha).filter(|(_, a)| **a > 0.9);
    let brightest = bright.map(|(r, _)| *r).fold(0.0f32, f32::max);
    assert!(brightest > 0.6, "{brightest}");
}

#[test]
fn crops_are_parts_of_the_whole() {
    let mut job = sphere_job();
    let folder = folder(&[("whole.json", &job.to_string())]);
    job["film"]["crop"] = serde_json::json!([8, 5, 10, 6]);
    std::fs::write(folder.path().join("part.json"), job.to_string()).unwrap();
    render(folder.path(), &["render", "whole.json", "-o", "whole.exr"]);
    render(folder.path(), &["render", "part.json", "-o", "part.exr"]);
    let [whole, part] =
        ["whole.exr", "part.exr"].map(|n| read_exr(&folder.path().join(n)).unwrap());
    assert_eq!((part.width(), part.height()), (10, 6));
    for (x, y) in [(0, 0), (9, 5), (4, 3)] {
        assert_eq!(part.get("G", x, y), whole.get("G", x + 8, y + 5));
    }
    render(folder.path(), &["render", "whole.json", "--crop", "8,5,10,6", "-o", "also.exr"]);
    let also = read_exr(&folder.path().join("also.exr")).unwrap();
    assert_eq!(also.channel("G"), part.channel("G"));
    for wrong in ["8,5,10", "8,5,0,6", "30,5,10,6", "-1,0,4,4", "a,b,c,d"] {
        let crop = format!("--crop={wrong}");
        let output = run(folder.path(), &["render", "whole.json", &crop, "-o", "no.exr"]);
        assert_eq!(output.status.code(), Some(2), "{wrong}: {}", stderr(&output));
    }
}

#[test]
fn environment_images_light_the_scene() {
    let here = tempfile::tempdir().unwrap();
    exr::prelude::write_rgb_file(here.path().join("sky.exr"), 16, 8, |_, y| {
        if y < 4 { (0.2f32, 0.4f32, 0.8f32) } else { (0.1, 0.1, 0.1) }
    })
    .unwrap();
    let mut job = sphere_job();
    job["lights"] =
        serde_json::json!([{ "type": "environment", "image": "sky.exr", "intensity": 2 }]);
    job["volumes"] = serde_json::json!([]);
    job["camera"] =
        serde_json::json!({ "position": [0, 0, 0], "look_at": [0, 0, -1], "fov_y": 60 });
    std::fs::write(here.path().join("job.json"), job.to_string()).unwrap();
    render(here.path(), &["render", "job.json"]);
    let image = read_exr(&here.path().join("sphere.exr")).unwrap();
    assert!((image.get("B", 16, 1).unwrap() - 1.6).abs() < 1e-4);
    assert!((image.get("B", 16, 18).unwrap() - 0.2).abs() < 1e-4);
}

#[cfg(feature = "lab")]
#[test]
fn images_are_compared() {
    let folder = folder(&[("job.json", &sphere_job().to_string())]);
    render(folder.path(), &["render", "job.json", "-o", "a.exr"]);
    render(folder.path(), &["render", "job.json", "-o", "b.exr", "--seed", "1", "--spp", "16"]);
    let same = json(folder.path(), &["compare", "a.exr", "a.exr", "--json"]);
    assert_eq!((&same["mse"], &same["flip"]), (&0.0.into(), &0.0.into()));
    let other =
        json(folder.path(), &["compare", "a.exr", "b.exr", "--json", "--difference", "d.exr"]);
    for key in ["mse", "rel_mse", "flip"] {
        assert!(other[key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert!(other["stderr_a"][0].as_f64().unwrap() > 0.0);
    assert!(read_exr(&folder.path().join("d.exr")).is_ok());
    render(folder.path(), &["compare", "a.exr", "b.exr", "--difference", "d.png"]);
    assert!(folder.path().join("d.png").is_file());
    render(folder.path(), &["render", "job.json", "-o", "c.exr", "--resolution", "8x8"]);
    assert_eq!(run(folder.path(), &["compare", "a.exr", "c.exr"]).status.code(), Some(3));
    assert_eq!(run(folder.path(), &["compare", "a.exr", "none.exr"]).status.code(), Some(4));
}
