//! `pileus chart`.

use crate::{folder, path, run, sphere_job, stderr};

fn files(folder: &std::path::Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// All estimators on an asset and on closed forms: every file is there, the figures say what was
/// run, the page is whole.
#[test]
fn transmittance_is_charted() {
    let folder = folder(&[]);
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let profile = format!("{}#ramp_up_4", path("tests/data/oracle/closed_forms.json"));
    let arguments = [
        "chart",
        "transmittance",
        &sphere,
        &profile,
        "--rays",
        "2",
        "--samples",
        "64",
        "--seed",
        "5",
    ];
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let charts = folder.path().join("charts");
    let names = files(&charts);
    for name in [
        "transmittance-syn_sphere.csv",
        "transmittance-syn_sphere.html",
        "transmittance-syn_sphere-cost.svg",
        "transmittance-syn_sphere-error-all.png",
        "transmittance-ramp_up_4.csv",
        "transmittance-ramp_up_4-error-ramp-up-4.svg",
    ] {
        assert!(names.iter().any(|n| n == name), "{name} is not among {names:?}");
    }
    let csv = std::fs::read_to_string(charts.join("transmittance-syn_sphere.csv")).unwrap();
    for wanted in
        ["# machine: ", "# program: pileus ", "# compiler: rustc", "# seed: 5", "\nregular,all,"]
    {
        assert!(csv.contains(wanted), "{wanted} is not in\n{csv}");
    }
    for estimator in pileus_media::transmittance::Estimator::ALL {
        assert!(csv.contains(&format!("\n{},all,", estimator.name())));
    }
    let page = std::fs::read_to_string(charts.join("transmittance-syn_sphere.html")).unwrap();
    assert!(page.ends_with("</html>\n") && page.contains("unbiased_ray_marching"));
    assert!(!page.contains("http://") || !page.contains("src=\"http"), "nothing is fetched");
    assert!(["{title}", "{plots}", "{table}", "{notes}"].iter().all(|hole| !page.contains(hole)));
}

/// Methods on a small picture, with another renderer's timing in the plot.
#[test]
fn renders_are_charted() {
    let mut job = sphere_job();
    job["film"]["resolution"] = serde_json::json!([16, 12]);
    let timings = "scene,renderer,seconds,relmse\njob,other,1.5,0.01\nelse,other,2,0.1\n";
    let folder = folder(&[("job.json", &job.to_string()), ("peers.csv", timings)]);
    let arguments = [
        "chart",
        "render",
        "job.json",
        "--methods",
        "auto+auto,delta+delta,auto+ray_marching,analytic+ratio",
        "--seconds",
        "0.05",
        "--reference-spp",
        "16",
        "--peers",
        "peers.csv",
        "-o",
        "out",
    ];
    let output = run(folder.path(), &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let out = folder.path().join("out");
    assert_eq!(
        files(&out),
        ["render-job-error.png", "render-job-error.svg", "render-job.csv", "render-job.html"]
    );
    let csv = std::fs::read_to_string(out.join("render-job.csv")).unwrap();
    assert!(csv.contains("\nauto+auto,delta+ratio,") && csv.contains("\ndelta+delta,"), "{csv}");
    assert!(!csv.contains("\nanalytic"), "refused for grids");
    let page = std::fs::read_to_string(out.join("render-job.html")).unwrap();
    assert!(page.contains("Left out: analytic+ratio") && page.contains("data:image/png;base64,"));
    assert!(page.contains("\"other\""), "the other renderer is drawn");
}

#[test]
fn wrong_questions_get_an_answer() {
    let sphere = path("scenes/assets/syn_sphere.vdb");
    let profiles = path("tests/data/oracle/closed_forms.json");
    let folder = folder(&[
        ("peers.csv", "scene,renderer,seconds\n"),
        ("number.csv", "scene,renderer,seconds,relmse\na,b,fast,1\n"),
        ("cases.json", "{\"cases\": [{\"name\": \"a\"}]}"),
    ]);
    for (arguments, code, said) in [
        (vec!["transmittance", "missing.vdb"], 4, "missing.vdb"),
        (vec!["transmittance", &format!("{profiles}#nothing")], 2, "ramp_up_4"),
        (vec!["transmittance", "cases.json"], 3, "cases.json"),
        (vec!["transmittance", &sphere, "--density-scale", "0"], 2, "density-scale"),
        (vec!["render", &sphere, "--methods", "delta+rato"], 2, "delta+rato"),
        (vec!["render", &sphere, "--peers", "peers.csv"], 3, "relmse"),
        (vec!["render", &sphere, "--peers", "number.csv"], 3, "number.csv:2"),
        (vec!["render"], 2, "JOB"),
    ] {
        let output = run(folder.path(), &[&["chart"], &arguments[..]].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(said), "{arguments:?}: {}", stderr(&output));
    }
}
