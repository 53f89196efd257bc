//! Values of grids that count as something else are said.

use serde_json::json;

use crate::{folder, path, run, stderr};

/// Albedos that are not in [0, 1] were clamped in silence: now file, grid and count are named, as
/// those of density are.
#[test]
fn albedos_out_of_range_are_said() {
    let vdb = path("tests/data/conformance/nan_inf_negative.vdb");
    let job = json!({
        "volumes": [{
            "vdb": vdb,
            "density": { "grid": "density", "scale": 1e-20 },
            "albedo": { "grid": "density" },
            "phase": {
                "type": "henyey_greenstein",
                "g": { "grid": "density", "scale": 100 }
            }
        }],
        "lights": [{ "type": "environment", "radiance": 1 }],
        "film": { "resolution": [4, 4] },
        "sampling": { "spp": 1 }
    });
    let folder = folder(&[("job.json", &job.to_string())]);
    let output = run(folder.path(), &["check", "job.json"]);
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    for expected in [
        "grid `density`, albedo: ",
        "values are not finite and count as 0",
        "values are below 0 and count as 0",
        "values are above 1 and count as 1, the largest is ",
        "grid `density`, mean cosine: ",
    ] {
        assert!(said.contains(expected), "no `{expected}` in\n{said}");
    }
}
