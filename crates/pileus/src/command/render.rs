//! `pileus render`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use pileus_film::{ExrSettings, Film, ToneMap, write_atomically, write_exr, write_png};
use pileus_integrator::{Monitor, PathCost};

use crate::cli::RenderOptions;
use crate::command::{Prepared, prepare};
use crate::failure::Failure;
use crate::machine::Signals;
use crate::record::{PlanAndCost, Seconds, Stats, VERSION, metadata};
use crate::report::{Progress, Report};
use crate::settings::Outputs;

struct Watch<'a> {
    signals: &'a Signals,
    progress: &'a Progress,
}

impl Monitor for Watch<'_> {
    fn cancelled(&self) -> bool {
        self.signals.came()
    }

    fn progress(&self, done: u64, _total: u64) {
        self.progress.set(done);
    }
}

pub(crate) fn run(options: &RenderOptions, report: &Report) -> Result<(), Failure> {
    let start = Instant::now();
    let signals = Signals::handled();
    let Prepared { settings, loaded, mut plan } = prepare(&options.input, &options.overrides())?;
    let scene = &loaded.scene;
    check_outputs(&settings.outputs)?;
    tracing::debug!("plan:\n{plan}");
    let mut film = Film::new(scene.camera.resolution(), settings.crop)?;
    let mut seconds =
        Seconds { load: loaded.seconds_load, build: loaded.seconds_build, ..Seconds::default() };

    let crop = film.crop();
    let pixels = u64::from(crop.width) * u64::from(crop.height);
    let spp = settings.render.samples.end - settings.render.samples.start;
    let progress = report.progress(pixels.saturating_mul(spp), pixels);
    let watch = Watch { signals, progress: &progress };
    let sampling = Instant::now();
    signals.wait_for_the_first();
    let counters = pileus_integrator::render(scene, &plan, &settings.render, &mut film, &watch);
    seconds.render = sampling.elapsed().as_secs_f64();
    progress.finish();
    let counters = counters?;
    if film.samples() == 0 {
        return Err(Failure::Interrupted {
            what: "stopped before every pixel had a sample: nothing was written".into(),
            exit: signals.exit(),
        });
    }
    if film.samples() < 2 {
        tracing::warn!("one sample per pixel: the variance is not known and written as infinite");
    }
    if counters.violations > 0 && settings.render.majorant_scale >= 1.0 {
        tracing::error!("{} lookups exceeded their majorant: this is a bug", counters.violations);
    }
    plan.settle(&counters);
    if counters.cut_by_max_events > 0 {
        tracing::warn!(
            "{} of {} paths were cut by sampling.max_events: what they would have brought is missing",
            counters.cut_by_max_events,
            counters.paths
        );
    }
    if counters.dropped > 0 {
        tracing::warn!("{} samples were not finite and are left out", counters.dropped);
    }

    let writing = Instant::now();
    let job_hash = settings.job_hash();
    let mut image = film.image();
    let variance = film.variance();
    let beyond = variance.channels().iter().flat_map(|c| &c.samples).filter(|v| **v == f32::MAX);
    match beyond.count() {
        0 => {}
        n => tracing::warn!("{n} variances exceed 3.4e38 and are written as that: dim the lights"),
    }
    image.add_layer("variance", &variance)?;
    let exr = ExrSettings {
        half: settings.outputs.half,
        parallel: rayon::current_num_threads() > 1,
        metadata: metadata(&settings, &plan, &counters, film.samples(), &job_hash),
        ..ExrSettings::default()
    };
    let outputs = &settings.outputs;
    let written = write_exr(&outputs.image, &image, &exr)?;
    if written.half_clamped > 0 {
        tracing::warn!(
            "{} values exceed 65504 and are clamped: write 32-bit floats",
            written.half_clamped
        );
    }
    if let Some(preview) = &outputs.preview {
        let tone = ToneMap { exposure_stops: outputs.exposure, ..ToneMap::default() };
        write_png(preview, &image, &tone)?;
    }
    seconds.write = writing.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();

    let measured = PathCost::measured(&counters);
    let was_interrupted = film.samples() < spp;
    let stats = Stats {
        seconds,
        samples: film.samples(),
        counters: &counters,
        peak_memory_bytes: Stats::peak_memory(),
        plan: PlanAndCost { plan: &plan, measured },
        version: VERSION,
        job_hash: &job_hash,
        interrupted: was_interrupted,
        threads: rayon::current_num_threads(),
        resolution: film.resolution(),
        crop: [crop.x0, crop.y0, crop.width, crop.height],
        image: &outputs.image.to_string_lossy(),
    };
    write_stats(&outputs.stats, &stats)?;
    tracing::info!(
        "{}: {} samples per pixel in {:.1} s, {:.2} M paths/s",
        outputs.image.display(),
        film.samples(),
        seconds.render,
        counters.paths as f64 / seconds.render.max(1e-9) * 1e-6,
    );
    if let (Some(measured), false) = (measured, plan.volumes.is_empty()) {
        tracing::info!("measured: {measured}");
    }
    if let Some(predicted) = plan.predicted {
        tracing::info!("expected: {predicted}");
    }
    // Also when the last pass was done: who stops one render means those that would follow.
    if was_interrupted || signals.came() {
        let what = format!(
            "stopped after {} of {spp} samples per pixel; {} is written",
            film.samples(),
            outputs.image.display()
        );
        return Err(Failure::Interrupted { what, exit: signals.exit() });
    }
    Ok(())
}

/// Folders of the outputs must exist before hours are spent on what cannot be written.
fn check_outputs(outputs: &Outputs) -> Result<(), Failure> {
    let paths: [Option<&PathBuf>; 3] =
        [Some(&outputs.image), outputs.preview.as_ref(), Some(&outputs.stats)];
    for path in paths.into_iter().flatten() {
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(Failure::Io {
                path: path.clone(),
                what: format!(
                    "cannot be written: there is no folder {}; create it first",
                    folder.display()
                ),
                source: std::io::ErrorKind::NotFound.into(),
            });
        }
    }
    Ok(())
}

fn write_stats(path: &Path, stats: &Stats<'_>) -> Result<(), Failure> {
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, stats)?;
        writeln!(out)
    })?;
    Ok(())
}
