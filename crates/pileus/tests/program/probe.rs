//! `pileus probe`.

use pileus_vdb::{Values, VdbFile};
use serde_json::{Value, json};

use crate::{folder, json, path, root, run, stderr};

#[test]
fn stored_values_are_those_of_the_library() {
    for (name, grid) in [
        ("multi", "density"),
        ("multi", "ids"),
        ("multi", "solid"),
        ("multi", "vel"),
        ("nan_inf_negative", "density"),
        ("far_negative", "density"),
        ("tile_only", "density"),
    ] {
        let expected =
            std::fs::read_to_string(path(&format!("tests/data/conformance/{name}.json"))).unwrap();
        let expected: Value = serde_json::from_str(&expected).unwrap();
        let grids = expected["grids"].as_array().unwrap();
        let wanted = grids.iter().find(|g| g["name"] == grid).unwrap_or(&grids[0]);
        let samples = wanted["samples"].as_array().unwrap();
        let points: Vec<&Value> = samples.iter().map(|s| &s["ijk"]).collect();
        let folder =
            folder(&[("p.json", &json!({"space": "index", "points": points}).to_string())]);
        let file = path(&format!("tests/data/conformance/{name}.vdb"));
        let arguments = [
            "probe",
            "values",
            &file,
            "--grid",
            wanted["name"].as_str().unwrap(),
            "--points",
            "p.json",
        ];
        let answer = json(folder.path(), &arguments);
        for (i, sample) in samples.iter().enumerate() {
            let (value, wanted) = (&answer["values"][i], &sample["value"]);
            let same = match (value.as_f64(), wanted.as_f64()) {
                (Some(a), Some(b)) => (a - b).abs() <= 1e-6 * b.abs(),
                _ if value.is_array() => (0..3).all(|c| {
                    let (a, b) = (value[c].as_f64().unwrap(), wanted[c].as_f64().unwrap());
                    (a - b).abs() <= 1e-6 * b.abs()
                }),
                _ => value == wanted,
            };
            assert!(same, "{name} {sample}: {value}");
            assert_eq!(answer["active"][i], sample["active"], "{name} {sample}");
        }
    }
}

#[test]
fn values_between_voxels_are_trilinear_in_either_space() {
    let file = VdbFile::open(root().join("scenes/assets/syn_rotated.vdb")).unwrap();
    let grid = file.read(0).unwrap();
    let matrix = grid.info.transform.index_to_world().unwrap();
    let Values::Float(tree) = &grid.values else { panic!("{:?}", grid.info) };
    let (low, high) = tree.active_bbox().unwrap();
    let at = |axis: usize, t: f64| f64::from(low[axis]) + t * f64::from(high[axis] - low[axis]);
    let points: Vec<[f64; 3]> = (0..50)
        .map(|i| {
            let u = |k: f64| (f64::from(i) * k).fract();
            [at(0, u(0.7548776662)), at(1, u(0.5698402909)), at(2, u(0.4301597090))]
        })
        .collect();
    let world: Vec<Vec<f64>> = points
        .iter()
        .map(|p| {
            (0..3)
                .map(|c| {
                    p[0] * matrix[0][c] + p[1] * matrix[1][c] + p[2] * matrix[2][c] + matrix[3][c]
                })
                .collect()
        })
        .collect();
    let folder = folder(&[
        ("index.json", &json!({"space": "index", "points": points}).to_string()),
        ("world.json", &json!({"space": "world", "points": world}).to_string()),
    ]);
    let vdb = path("scenes/assets/syn_rotated.vdb");
    let ask = |points: &str| {
        json(folder.path(), &["probe", "values", &vdb, "--grid", "density", "--points", points])
    };
    let (index, world) = (ask("index.json"), ask("world.json"));
    let mut positive = 0;
    for (i, p) in points.iter().enumerate() {
        let mut expected = 0.0;
        for corner in 0..8i32 {
            let ijk: [i32; 3] = std::array::from_fn(|a| p[a].floor() as i32 + (corner >> a & 1));
            let weight: f64 = (0..3)
                .map(|a| {
                    let f = p[a] - p[a].floor();
                    if corner >> a & 1 == 1 { f } else { 1.0 - f }
                })
                .product();
            expected += weight * f64::from(tree.value(ijk).0);
        }
        let value = index["values"][i].as_f64().unwrap();
        assert!((value - expected).abs() < 1e-12, "{value} {expected}");
        assert!((world["values"][i].as_f64().unwrap() - expected).abs() < 1e-9);
        positive += u32::from(expected > 0.0);
    }
    assert!(positive > 10);
}

fn rays(grid: &str, estimator: &str, samples: &str) -> (Value, Value) {
    let oracle = path(&format!("tests/data/oracle/{grid}.json"));
    let here = tempfile::tempdir().unwrap();
    let vdb = path(&format!("scenes/assets/{grid}.vdb"));
    let expected: Value = serde_json::from_str(&std::fs::read_to_string(&oracle).unwrap()).unwrap();
    let arguments = [
        "probe",
        "transmittance",
        &vdb,
        "--grid",
        "density",
        "--density-scale",
        "2",
        "--rays",
        &oracle,
        "--estimator",
        estimator,
        "--samples",
        samples,
        "--seed",
        "5",
    ];
    (json(here.path(), &arguments), expected)
}

#[test]
fn regular_tracking_gives_the_oracles_optical_depths() {
    let (answer, oracle) = rays("syn_rotated", "regular", "1000");
    assert_eq!(answer["estimator"], "regular");
    assert_eq!(answer["dropped"], 0);
    for (ray, expected) in
        answer["rays"].as_array().unwrap().iter().zip(oracle["rays"].as_array().unwrap())
    {
        let (depth, wanted) = (
            ray["optical_depth"].as_f64().unwrap(),
            2.0 * expected["optical_depth"].as_f64().unwrap(),
        );
        assert!((depth - wanted).abs() <= 1e-9 + 1e-8 * wanted, "{depth} {wanted}");
        assert!((ray["mean"].as_f64().unwrap() - (-wanted).exp()).abs() < 1e-8);
        assert_eq!((&ray["samples"], &ray["variance"]), (&1.into(), &0.0.into()));
    }
}

/// Null hypothesis: the mean is exp(-optical depth). 200 rays, 2000 samples each, fixed seed; |z|
/// up to 6.5 for each ray with a variance (false alarm below 1e-7 for all rays together).
#[test]
fn estimators_agree_with_the_oracle() {
    for estimator in ["delta", "ratio", "pseries_cmf", "unbiased_ray_marching"] {
        let (answer, oracle) = rays("syn_sphere", estimator, "2000");
        let mut tested = 0;
        for (ray, expected) in
            answer["rays"].as_array().unwrap().iter().zip(oracle["rays"].as_array().unwrap())
        {
            let wanted = (-2.0 * expected["optical_depth"].as_f64().unwrap()).exp();
            let mean = ray["mean"].as_f64().unwrap();
            let stderr = (ray["variance"].as_f64().unwrap() / 2000.0).sqrt();
            assert_eq!(ray["samples"], 2000);
            assert!(ray["seconds"].as_f64().unwrap() >= 0.0);
            if wanted > 0.01 && wanted < 0.99 {
                assert!((mean - wanted).abs() < 6.5 * stderr, "{mean} {wanted} {stderr}");
                assert!(ray["lookups"].as_u64().unwrap() > 0);
                tested += 1;
            }
        }
        assert!(tested > 20, "{tested}");
    }
}

#[test]
fn wrong_questions_are_placed() {
    let ray = json!({"origin": [0, 0, 0], "direction": [0, 0, 0], "tmin": 0, "tmax": 1});
    let folder = folder(&[
        ("p.json", r#"{"space": "voxel", "points": []}"#),
        ("r.json", &json!({"rays": [ray]}).to_string()),
    ]);
    let vdb = path("scenes/assets/syn_sphere.vdb");
    let output =
        run(folder.path(), &["probe", "values", &vdb, "--grid", "density", "--points", "p.json"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("p.json:1:11 (/space)"), "{}", stderr(&output));
    let output = run(
        folder.path(),
        &[
            "probe",
            "transmittance",
            &vdb,
            "--grid",
            "density",
            "--rays",
            "r.json",
            "--estimator",
            "ratio",
        ],
    );
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("/rays/0/direction"), "{}", stderr(&output));
    let output =
        run(folder.path(), &["probe", "values", &vdb, "--grid", "smoke", "--points", "p.json"]);
    assert_eq!(output.status.code(), Some(3));
}
