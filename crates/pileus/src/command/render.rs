//! `pileus render`.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use pileus_film::{
    BEAUTY, DENOISED, ExrSettings, Film, Image, ToneMap, VARIANCE, write_atomically, write_exr,
    write_png,
};
use pileus_integrator::{Monitor, PathCost, Renderer};
use serde::Serialize;

use crate::cli::RenderOptions;
use crate::command::{Prepared, prepare_to_write};
use crate::failure::Failure;
use crate::machine::Signals;
use crate::record::{PlanAndCost, Seconds, Stats, VERSION, metadata};
use crate::report::{Progress, Report};
use crate::settings::{LayersTo, Outputs, job_hash};
use crate::words;

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
    let Prepared { settings, loaded, film: film_plan, .. } =
        prepare_to_write(&options.input, &options.overrides())?;
    let scene = &loaded.scene;
    if let Some(path) = &options.save_job {
        write_json(path, &settings.saved_job(scene))?;
        tracing::info!("{}: the job, to go on from", path.display());
    }
    let renderer =
        Renderer::new(scene, &settings.render).map_err(|error| words::of_job(&settings, error))?;
    let prepass = renderer.prepass();
    for warning in &prepass.warnings {
        tracing::warn!("{warning}");
    }
    tracing::debug!("plan:\n{}{prepass}{film_plan}", renderer.plan());
    let mut film =
        Film::with_layers(film_plan.resolution, settings.crop, &settings.outputs.further)?;
    let mut seconds =
        Seconds { load: loaded.seconds_load, build: loaded.seconds_build, ..Seconds::default() };

    let pixels = film_plan.pixels();
    let spp = settings.render.samples.end - settings.render.samples.start;
    let progress = report.progress(pixels.saturating_mul(spp), pixels);
    let watch = Watch { signals, progress: &progress };
    let sampling = Instant::now();
    signals.wait_for_the_first();
    let counters = renderer.render(&mut film, &watch);
    seconds.render = sampling.elapsed().as_secs_f64();
    progress.finish();
    let counters = counters.map_err(|error| words::of_job(&settings, error))?;
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
    let plan = renderer.plan().clone().settled(&counters);
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

    if film.values_left_out() > 0 {
        tracing::warn!(
            "{} values of layers were not finite and count as zero",
            film.values_left_out()
        );
    }

    let writing = Instant::now();
    let job = settings.recorded_job(scene);
    let job_hash = job_hash(&job);
    // The sums are large: they are gone through once.
    let all = film.image_of(film.layers())?;
    let in_one = settings.outputs.layers == LayersTo::Image;
    let (mut image, mut layers) =
        if in_one { (all.clone(), all) } else { all.split(is_of_the_picture) };
    let variances = VARIANCE.channels.iter().filter_map(|name| layers.channel(name));
    let beyond = variances.flatten().filter(|v| **v == f32::MAX);
    match beyond.count() {
        0 => {}
        n => tracing::warn!("{n} variances exceed 3.4e38 and are written as that: dim the lights"),
    }
    let outputs = &settings.outputs;
    let exr = ExrSettings {
        half: settings.outputs.half,
        parallel: rayon::current_num_threads() > 1,
        metadata: metadata(&settings, (&job, &job_hash), &plan, &counters, film.samples()),
        ..ExrSettings::default()
    };
    // The image is safe before anything else is made of it, unless it holds that.
    let holds_denoised = in_one && outputs.denoised_layer;
    let mut shown = None;
    if holds_denoised {
        shown = denoised(outputs, &film);
        add_channels(&mut image, shown.as_ref())?;
    }
    let written = write_exr(&outputs.image, &image, &exr)?;
    if !holds_denoised {
        shown = denoised(outputs, &film);
        if outputs.denoised_layer {
            add_channels(&mut layers, shown.as_ref())?;
        }
    }
    if written.half_clamped > 0 {
        tracing::warn!(
            "{} values exceed 65504 and are clamped: write 32-bit floats",
            written.half_clamped
        );
    }
    if let LayersTo::File(path) = &outputs.layers {
        write_exr(path, &layers, &exr)?;
    }
    if let Some(preview) = &outputs.preview {
        let tone = ToneMap { exposure_stops: outputs.exposure, ..ToneMap::default() };
        let denoised = shown.filter(|_| outputs.denoise).and_then(|shown| shown.layer(DENOISED));
        write_png(preview, denoised.as_ref().unwrap_or(&image), &tone)?;
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
        plan: PlanAndCost { plan: &plan, predicted: prepass.predicted, measured },
        film: &film_plan,
        version: VERSION,
        job_hash: &job_hash,
        interrupted: was_interrupted,
        threads: rayon::current_num_threads(),
        resolution: film.resolution(),
        crop: film_plan.crop,
        image: &outputs.image.to_string_lossy(),
    };
    if let Some(path) = &outputs.stats {
        write_json(path, &stats)?;
    }
    tracing::info!(
        "{}: {} samples per pixel in {:.1} s{}",
        outputs.image.display(),
        film.samples(),
        seconds.render,
        relative_noise(&image, &layers)
            .map_or(String::new(), |noise| format!(", noise {:.2} % of the mean", 100.0 * noise)),
    );
    tracing::debug!("{:.2} M paths/s", counters.paths as f64 / seconds.render.max(1e-9) * 1e-6);
    if let (Some(measured), false) = (measured, plan.volumes.is_empty()) {
        tracing::debug!("measured: {measured}");
    }
    if let Some(predicted) = prepass.predicted {
        tracing::debug!("expected: {predicted}");
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

fn add_channels(image: &mut Image, others: Option<&Image>) -> Result<(), Failure> {
    for channel in others.into_iter().flat_map(Image::channels) {
        image.add_channel(&channel.name, channel.samples.clone())?;
    }
    Ok(())
}

/// The denoised picture, if it is shown or kept, and what is said of it.
fn denoised(outputs: &Outputs, film: &Film) -> Option<Image> {
    let shown = outputs.denoise && outputs.preview.is_some();
    if !shown && !outputs.denoised_layer {
        return None;
    }
    let denoised = film.denoised();
    let what = match (shown, outputs.denoised_layer) {
        (true, true) => "the preview and the layer `denoised` are",
        (true, false) => "the preview is",
        (false, _) => "the layer `denoised` is",
    };
    if denoised.is_some() {
        tracing::info!("{what} denoised by non-local means; the image is not");
    } else {
        tracing::info!("too few samples to denoise: four a pixel tell how noisy they are");
    }
    denoised
}

/// Whether a channel of a film belongs to its picture: those of other layers have their names.
fn is_of_the_picture(channel: &str) -> bool {
    !channel.contains('.')
}

/// Standard error over the mean of the picture's luminance, the root of the mean variance of its
/// pixels over their mean; `None` where it is black or the variance is not known.
fn relative_noise(image: &Image, layers: &Image) -> Option<f64> {
    let mean = |image: &Image, channels: &[&str]| -> Option<f64> {
        let mut sum = 0.0;
        for channel in channels {
            let plane = image.channel(channel)?;
            sum += plane.iter().map(|&v| f64::from(v)).sum::<f64>() / plane.len().max(1) as f64;
        }
        Some(sum / channels.len() as f64)
    };
    let brightness = mean(image, BEAUTY.channels)?;
    let variance = mean(layers, VARIANCE.channels.get(..BEAUTY.channels.len())?)?;
    let noise = variance.sqrt() / brightness;
    (brightness > 0.0 && noise.is_finite()).then_some(noise)
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, value)?;
        writeln!(out)
    })?;
    Ok(())
}
