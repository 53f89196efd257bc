//! Majorant structures on a scene: predicted and measured lookups and steps, time per path.

use crate::Error;
use crate::chart::{Axis, Cell, Chart, Plot, Provenance, Series, Table};
use pileus_film::Film;
use pileus_integrator::{Counters, RecordedRays, RenderSettings, Renderer, Unmonitored};
use pileus_media::distance::DistanceSampler;
use pileus_media::majorant::{MajorantStructure, StructureCost};
use pileus_media::transmittance::Estimator;
use pileus_scene::Scene;
use std::time::Instant;

/// Paths of the prepass that costs are predicted from.
const RECORDED_PATHS: u32 = 8192;

/// All structures, with super-grids of 4 to 128 voxels.
fn structures() -> Vec<MajorantStructure> {
    let mut structures = vec![
        MajorantStructure::Adaptive,
        MajorantStructure::Hierarchy,
        MajorantStructure::KdTree,
        MajorantStructure::Global,
    ];
    structures.extend((2..=7).map(|log2| MajorantStructure::Uniform(1 << log2)));
    structures
}

fn name_of(run: &Run) -> String {
    if run.own_kernel {
        format!("{}, own kernel", run.structure.name())
    } else {
        run.structure.name()
    }
}

struct Run<'a> {
    structure: MajorantStructure,
    /// Whether it runs a kernel compiled for it alone.
    own_kernel: bool,
    predicted: StructureCost,
    renderer: Renderer<'a>,
    counters: Counters,
    seconds: f64,
    cells: u64,
    bytes: u64,
    build: f64,
}

/// Renders a scene under every structure, in turns, until each has had `seconds`; predicts the cost
/// of each from one prepass.
///
/// # Errors
/// If the scene cannot be rendered. Structures that a grid cannot have are left out and named.
pub fn chart_majorants(
    name: &str,
    scene: &Scene,
    settings: &RenderSettings,
    seconds: f64,
) -> Result<Chart, Error> {
    let base = RenderSettings {
        samples: 0..1,
        distance: Some(DistanceSampler::Delta),
        transmittance: Some(Estimator::Ratio),
        majorant_scale: 1.0,
        ..settings.clone()
    };
    let recorded = {
        let renderer = Renderer::new(scene, &base).map_err(Error::Render)?;
        RecordedRays::new(&renderer, RECORDED_PATHS)
    };
    let mut notes = vec![format!(
        "Predicted: the majorants' optical depth and the cells along the rays of {RECORDED_PATHS} paths of a prepass, traced once under the default structure. Measured: what whole \
         renders counted. Structures take turns. Times are of all threads, per path. `adaptive, own kernel` is what renders run, compiled for it; all other rows share one kernel with a branch per step, so that they \
         compare structures alone. Delta and ratio tracking."
    )];
    for volume in &scene.volumes {
        if let Some(grid) = volume.medium.grid() {
            let report = grid.voxels().report();
            notes.push(format!(
                "Bounds of `{}`: {:.1} % of the bytes of its {} voxels; above bricks they took {:.2} ms of {:.1} ms to lay out the grid.",
                volume.name,
                100.0 * report.bytes_bounds as f64 / report.bytes_voxels as f64,
                report.voxels,
                1e3 * report.seconds_bounds,
                1e3 * report.seconds,
            ));
        }
    }
    let mut runs = Vec::new();
    let default = MajorantStructure::default();
    let own = std::iter::once((default, true));
    for (structure, own_kernel) in own.chain(structures().into_iter().map(|s| (s, false))) {
        let settings =
            RenderSettings { majorants: structure, shared_kernel: !own_kernel, ..base.clone() };
        match Renderer::new(scene, &settings) {
            Err(error) => notes.push(format!("Left out: {}: {error}", structure.name())),
            Ok(renderer) => {
                let predicted = recorded.cost(scene, structure, 1.0).map_err(Error::Render)?;
                let (mut cells, mut bytes, mut build) = (0, 0, 0.0);
                for volume in &scene.volumes {
                    let built =
                        volume.medium.with_majorants(structure, 1.0).map_err(Error::Media)?;
                    if let Some(built) = built.grid() {
                        let footprint = built.majorants().footprint();
                        cells += footprint.0;
                        bytes += footprint.1;
                        build += built.majorants().seconds();
                    }
                }
                let counters = Counters::default();
                runs.push(Run {
                    structure,
                    own_kernel,
                    predicted,
                    renderer,
                    counters,
                    seconds: 0.0,
                    cells,
                    bytes,
                    build,
                });
            }
        }
    }
    let mut sample = 0;
    while runs.iter().any(|run| run.seconds < seconds) {
        for run in runs.iter_mut().filter(|run| run.seconds < seconds) {
            let mut film = Film::new(scene.camera.resolution(), None)?;
            let start = Instant::now();
            let samples = sample..sample + 4;
            let counters = run.renderer.render_samples(samples, &mut film, &Unmonitored);
            run.seconds += start.elapsed().as_secs_f64();
            run.counters.merge(&counters.map_err(Error::Render)?);
        }
        sample += 4;
    }
    let mut table = Table::new(&[
        "structure",
        "lookups/path",
        "predicted",
        "ratio",
        "steps/path",
        "predicted steps",
        "ratio of steps",
        "lookups/real collision",
        "ns/path",
        "against adaptive",
        "cells",
        "bytes",
        "build s",
    ]);
    let nanoseconds = |run: &Run| 1e9 * run.seconds / run.counters.paths as f64;
    let adaptive = runs.iter().find(|run| run.structure == default && !run.own_kernel);
    let adaptive = adaptive.map_or(f64::NAN, nanoseconds);
    let (mut predicted, mut measured) = (Vec::new(), Vec::new());
    for run in &runs {
        let paths = run.counters.paths as f64;
        let (lookups, steps) =
            (run.counters.lookups as f64 / paths, run.counters.majorant_steps as f64 / paths);
        table.push(vec![
            name_of(run).into(),
            lookups.into(),
            run.predicted.collisions.into(),
            (run.predicted.collisions / lookups).into(),
            steps.into(),
            run.predicted.steps.into(),
            (run.predicted.steps / steps).into(),
            (run.counters.lookups as f64 / run.counters.collisions as f64).into(),
            nanoseconds(run).into(),
            (nanoseconds(run) / adaptive).into(),
            Cell::Count(run.cells),
            Cell::Count(run.bytes),
            run.build.into(),
        ]);
        predicted.push((run.structure, name_of(run), run.predicted.nanoseconds()));
        measured.push((run.structure, name_of(run), nanoseconds(run)));
    }
    let series = |points: &[(MajorantStructure, String, f64)], what: &str| {
        let mut series = Vec::new();
        let sizes: Vec<[f64; 2]> = points
            .iter()
            .filter_map(|(s, _, y)| match s {
                MajorantStructure::Uniform(size) => Some([f64::from(*size), *y]),
                _ => None,
            })
            .collect();
        series.push(Series {
            name: format!("super-grid, {what}"),
            points: sizes.clone(),
            line: true,
        });
        let (first, last) =
            (sizes.first().map_or(4.0, |p| p[0]), sizes.last().map_or(128.0, |p| p[0]));
        for (structure, name, y) in points {
            if !matches!(structure, MajorantStructure::Uniform(_)) {
                let points = vec![[first, *y], [last, *y]];
                series.push(Series { name: format!("{name}, {what}"), points, line: true });
            }
        }
        series
    };
    let plot = |key: &str, title: &str, y: &str, series| Plot {
        name: key.into(),
        title: format!("{name}: {title}"),
        x: Axis::log("cell of the super-grid, voxels"),
        y: Axis::log(y),
        series,
    };
    Ok(Chart {
        name: format!("majorants-{name}"),
        title: format!("{name}: majorant structures"),
        notes,
        provenance: Provenance::here(settings.seed).with("seconds per structure", seconds),
        table,
        plots: vec![
            plot("measured", "time per path", "ns per path", series(&measured, "measured")),
            plot(
                "predicted",
                "predicted cost of lookups and steps",
                "ns per path and thread",
                series(&predicted, "predicted"),
            ),
        ],
        pictures: Vec::new(),
    })
}
