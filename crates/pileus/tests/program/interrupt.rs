//! Ctrl-C.

#[cfg(unix)]
#[test]
fn ctrl_c_writes_the_image_and_ends_with_130() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    let mut job = crate::sphere_job();
    job["sampling"]["spp"] = 100_000_000.into();
    let folder = crate::folder(&[("job.json", &job.to_string())]);
    let mut child = crate::pileus(folder.path())
        .args(["-v", "render", "job.json", "--preview", "sphere.png"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains("the first sample of every pixel is done")));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let said: Vec<String> = lines.map(Result::unwrap).collect();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said:?}");
    assert!(said.iter().any(|line| line.contains("stopped after")), "{said:?}");

    let image = pileus_film::read_exr(&folder.path().join("sphere.exr")).unwrap();
    assert_eq!((image.width(), image.height()), (32, 20));
    assert!(image.channel("R").unwrap().iter().all(|v| v.is_finite()));
    assert!(folder.path().join("sphere.png").is_file());
    let stats = std::fs::read_to_string(folder.path().join("sphere.stats.json")).unwrap();
    let stats: serde_json::Value = serde_json::from_str(&stats).unwrap();
    let samples = stats["samples"].as_u64().unwrap();
    assert!((1..100_000_000).contains(&samples));
    assert_eq!(stats["interrupted"], true);
    // Every pixel has exactly that many samples.
    assert_eq!(stats["paths"].as_u64().unwrap(), samples * 32 * 20);
    // Nothing unfinished is left behind.
    let names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(!names.iter().any(|name| name.to_string_lossy().contains("tmp")), "{names:?}");
}
