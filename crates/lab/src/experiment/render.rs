//! Whole images by different methods: error against time.

use crate::chart::{Axis, Cell, Chart, Picture, Plot, Provenance, Series, Table};
use crate::compare::{CompareSettings, compare_with};
use crate::difference::{difference_image, difference_view};
use crate::{Error, block_z_test};
use pileus_film::{Curve, Film, Image, ToneMap, png_bytes, preview_rgb8};
use pileus_integrator::{Counters, LightSampling, RenderSettings, Renderer, Unmonitored};
use pileus_media::distance::DistanceSampler;
use pileus_media::majorant::MajorantStructure;
use pileus_media::method::{from_name_or_auto, name_or_auto};
use pileus_media::transmittance::Estimator;
use pileus_scene::Scene;
use std::time::Instant;

/// How a scene is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderMethod {
    /// Distances; `None`: what the plan chooses.
    pub distance: Option<DistanceSampler>,
    /// Transmittance; `None`: what the plan chooses.
    pub transmittance: Option<Estimator>,
    /// Majorant structure.
    pub majorants: MajorantStructure,
    /// Factor on the majorants.
    pub majorant_scale: f32,
    /// Which techniques find light that both can meet.
    pub light_sampling: LightSampling,
}

impl RenderMethod {
    /// What the plan chooses.
    pub const AUTO: RenderMethod = RenderMethod {
        distance: None,
        transmittance: None,
        majorants: MajorantStructure::Adaptive,
        majorant_scale: 1.0,
        light_sampling: LightSampling::Both,
    };

    /// The methods of a chart: the plan's choice, every estimator beside its flights, every sampler
    /// beside ratio tracking, both regular, looser majorants.
    pub fn all() -> Vec<RenderMethod> {
        let auto = RenderMethod::AUTO;
        let mut methods = vec![auto];
        for estimator in Estimator::ALL {
            methods.push(RenderMethod { transmittance: Some(estimator), ..auto });
        }
        let ratio = RenderMethod { transmittance: Some(Estimator::Ratio), ..auto };
        for sampler in DistanceSampler::ALL {
            methods.push(RenderMethod { distance: Some(sampler), ..ratio });
        }
        methods.push(RenderMethod {
            distance: Some(DistanceSampler::Regular),
            transmittance: Some(Estimator::Regular),
            ..auto
        });
        for majorants in [
            MajorantStructure::Hierarchy,
            MajorantStructure::KdTree,
            MajorantStructure::Uniform(16),
            MajorantStructure::Global,
        ] {
            methods.push(RenderMethod { majorants, ..ratio });
        }
        for majorant_scale in [4.0, 16.0] {
            methods.push(RenderMethod { majorant_scale, ..ratio });
        }
        methods
    }

    /// `distance+transmittance`, with `@structure` where it is not the default, `*factor` where
    /// majorants are scaled and `/paths` where no shadow ray is sent to what paths can meet.
    pub fn name(&self) -> String {
        let structure = if self.majorants == MajorantStructure::default() {
            String::new()
        } else {
            format!("@{}", self.majorants.name())
        };
        let scale = if self.majorant_scale == 1.0 {
            String::new()
        } else {
            format!("*{}", self.majorant_scale)
        };
        let light = match self.light_sampling {
            LightSampling::Both => "",
            LightSampling::Paths => "/paths",
        };
        format!(
            "{}+{}{structure}{scale}{light}",
            name_or_auto(self.distance),
            name_or_auto(self.transmittance)
        )
    }

    /// The method of a name.
    ///
    /// # Errors
    /// If the name is not of that form.
    pub fn from_name(name: &str) -> Result<RenderMethod, Error> {
        let wrong = || Error::Argument {
            what: format!("`{name}` is not a method"),
            remedy: "write distance+transmittance, for example delta+ratio, auto+regular, delta+ratio@uniform_16, delta+ratio*4 or auto+auto/paths",
        };
        let (name, light_sampling) = match name.strip_suffix("/paths") {
            Some(name) => (name, LightSampling::Paths),
            None => (name, LightSampling::Both),
        };
        let (methods, scale) = match name.split_once('*') {
            Some((methods, scale)) => (methods, scale.parse().map_err(|_| wrong())?),
            None => (name, 1.0),
        };
        let (methods, majorants) = match methods.split_once('@') {
            Some((methods, name)) => {
                (methods, MajorantStructure::from_name(name).ok_or_else(wrong)?)
            }
            None => (methods, MajorantStructure::default()),
        };
        let (distance, transmittance) = methods.split_once('+').ok_or_else(wrong)?;
        let distance = from_name_or_auto(distance).ok_or_else(wrong)?;
        let transmittance = from_name_or_auto(transmittance).ok_or_else(wrong)?;
        Ok(RenderMethod {
            distance,
            transmittance,
            majorants,
            majorant_scale: scale,
            light_sampling,
        })
    }

    fn settings(&self, base: &RenderSettings, samples: std::ops::Range<u64>) -> RenderSettings {
        RenderSettings {
            samples,
            distance: self.distance,
            transmittance: self.transmittance,
            majorants: self.majorants,
            majorant_scale: self.majorant_scale,
            light_sampling: self.light_sampling,
            ..base.clone()
        }
    }
}

/// What is rendered, and how far.
pub struct RenderExperiment<'a> {
    /// Name for files.
    pub name: String,
    /// The scene.
    pub scene: &'a Scene,
    /// Settings but for methods and samples.
    pub settings: RenderSettings,
    /// Methods to compare.
    pub methods: Vec<RenderMethod>,
    /// Seconds after which a method is given no further doubling of its samples.
    pub seconds: f64,
    /// Samples per pixel of the reference, by the plan's choice with a seed of its own.
    pub reference_spp: u64,
    /// Exposure of the pictures, stops.
    pub exposure_stops: f32,
    /// Timings of other renderers: name, seconds, relMSE.
    pub peers: Vec<(String, f64, f64)>,
}

struct Run<'a> {
    method: RenderMethod,
    renderer: Renderer<'a>,
    film: Film,
    counters: Counters,
    seconds: f64,
    /// Of the last doubling alone.
    last: f64,
    points: Vec<[f64; 2]>,
    done: bool,
}

impl Run<'_> {
    /// Whether the methods have the right mean; limits that a job sets count for all methods alike.
    fn is_unbiased(&self) -> bool {
        let plan = self.renderer.plan();
        plan.transmittance.is_unbiased() && plan.distance.is_unbiased()
    }

    /// Renders up to `spp` samples per pixel in total.
    fn extend(&mut self, spp: u64) -> Result<(), Error> {
        let samples = self.film.samples()..spp;
        let start = Instant::now();
        let counters = self
            .renderer
            .render_samples(samples, &mut self.film, &Unmonitored)
            .map_err(Error::Render)?;
        self.last = start.elapsed().as_secs_f64();
        self.seconds += self.last;
        self.counters.merge(&counters);
        Ok(())
    }
}

/// Renders a scene by all methods, in turns that double their samples, and judges them against a
/// reference.
///
/// # Errors
/// If the scene cannot be rendered or images not compared. Methods that the scene does not allow
/// are left out and named.
pub fn chart_render(experiment: &RenderExperiment<'_>) -> Result<Chart, Error> {
    let RenderExperiment { scene, settings, .. } = experiment;
    let mut notes = Vec::new();
    let resolution = scene.camera.resolution();
    let reference = {
        let settings = RenderSettings {
            samples: 0..experiment.reference_spp,
            seed: settings.seed ^ 0x5eed_0f2e_fe2e_9ce5,
            ..settings.clone()
        };
        let renderer = Renderer::new(scene, &settings).map_err(Error::Render)?;
        let mut film = Film::new(resolution, None)?;
        renderer.render(&mut film, &Unmonitored).map_err(Error::Render)?;
        film
    };
    let (truth, truth_variance) = (reference.image(), reference.variance());
    let mut runs = Vec::new();
    for method in &experiment.methods {
        match Renderer::new(scene, &method.settings(settings, 0..1)) {
            Ok(renderer) => runs.push(Run {
                method: *method,
                renderer,
                film: Film::new(resolution, None)?,
                counters: Counters::default(),
                seconds: 0.0,
                last: 0.0,
                points: Vec::new(),
                done: false,
            }),
            Err(error) => notes.push(format!("Left out: {}: {error}", method.name())),
        }
    }
    let mut spp = 2;
    while runs.iter().any(|run| !run.done) && spp <= experiment.reference_spp {
        for run in runs.iter_mut().filter(|run| !run.done) {
            run.extend(spp)?;
            let error = rel_mse(&run.film, &truth, &truth_variance)?;
            run.points.push([run.seconds, error.against_reference]);
            // The next doubling takes as long as all so far.
            run.done = 2.0 * run.seconds > experiment.seconds;
        }
        spp *= 2;
    }
    let mut table = Table::new(&[
        "method",
        "ran",
        "spp",
        "seconds",
        "relMSE",
        "relMSE x s",
        "against the best",
        "lookups/path",
        "steps/path",
        "shadow rays/path",
        "worst |z|",
        "p",
        "verdict",
        "dropped",
    ]);
    let mut rows = Vec::new();
    for run in &runs {
        let error = rel_mse(&run.film, &truth, &truth_variance)?;
        let test =
            block_z_test(&run.film.image(), &run.film.variance(), &truth, &truth_variance, 16)?;
        rows.push((run, error.own_noise, test));
    }
    let best = rows
        .iter()
        .filter(|(run, _, _)| run.is_unbiased())
        .map(|(run, error, _)| error * run.seconds)
        .fold(f64::INFINITY, f64::min);
    for (run, error, test) in &rows {
        let paths = run.counters.paths as f64;
        let verdict = if run.counters.dropped > 0 {
            "fails"
        } else if test.p_value < 1e-6 {
            if run.is_unbiased() { "noisy" } else { "biased" }
        } else {
            "ok"
        };
        table.push(vec![
            run.method.name().into(),
            format!(
                "{}+{}",
                run.renderer.plan().distance.name(),
                run.renderer.plan().transmittance.name()
            )
            .into(),
            Cell::Count(run.film.samples()),
            run.seconds.into(),
            (*error).into(),
            (error * run.seconds).into(),
            (error * run.seconds / best).into(),
            (run.counters.lookups as f64 / paths).into(),
            (run.counters.majorant_steps as f64 / paths).into(),
            (run.counters.shadow_rays as f64 / paths).into(),
            test.max_abs_z.into(),
            test.p_value.into(),
            verdict.into(),
            Cell::Count(run.counters.dropped),
        ]);
    }
    let mut series: Vec<Series> = runs
        .iter()
        .map(|run| Series { name: run.method.name(), points: run.points.clone(), line: true })
        .collect();
    for (name, seconds, error) in &experiment.peers {
        match series.iter_mut().find(|s| !s.line && s.name == *name) {
            Some(series) => series.points.push([*seconds, *error]),
            None => series.push(Series {
                name: name.clone(),
                points: vec![[*seconds, *error]],
                line: false,
            }),
        }
    }
    if !experiment.peers.is_empty() {
        notes.push("Points without lines are other renderers' timings, as given: at the resolution they were measured at.".into());
    }
    let tone = ToneMap { exposure_stops: experiment.exposure_stops, ..ToneMap::default() };
    let mut pictures = vec![picture(
        format!("reference, {} samples per pixel", reference.samples()),
        &truth,
        &tone,
    )?];
    for (run, _, _) in &rows {
        let image = run.film.image();
        let (name, spp) = (run.method.name(), run.film.samples());
        pictures.push(picture(format!("{name}, {spp} samples per pixel"), &image, &tone)?);
        let difference = difference_view(&difference_image(&image, &truth)?, 4.0)?;
        let flat = ToneMap { exposure_stops: 0.0, curve: Curve::Srgb };
        pictures.push(picture(
            format!("{name} minus reference, times 4 about grey"),
            &difference,
            &flat,
        )?);
    }
    notes.insert(
        0,
        "relMSE in the curves is against the reference, less the reference's own noise; in the table it is the noise that each image knows of itself, \
         which does not depend on the reference. Methods take turns and double their samples, so that the machine's moods meet all alike. The block \
         test compares 16 x 16 blocks with the reference; below p 1e-6 a biased method is `biased` and an unbiased one `noisy`: too heavy-tailed."
            .into(),
    );
    Ok(Chart {
        name: format!("render-{}", experiment.name),
        title: format!("{}: methods compared on whole images", experiment.name),
        notes,
        provenance: Provenance::here(settings.seed)
            .with("resolution", format!("{} x {}", resolution[0], resolution[1]))
            .with("seconds per method", experiment.seconds)
            .with("reference samples per pixel", experiment.reference_spp)
            .with("threads", rayon::current_num_threads()),
        table,
        plots: vec![Plot {
            name: "error".into(),
            title: format!("{}: error against time", experiment.name),
            x: Axis::log("seconds"),
            y: Axis::log("relMSE"),
            series,
        }],
        pictures,
    })
}

fn picture(caption: String, image: &Image, tone: &ToneMap) -> Result<Picture, Error> {
    let rgb8 = preview_rgb8(image, tone)?;
    Ok(Picture { caption, png: png_bytes(&rgb8, image.width(), image.height())? })
}

struct RelMse {
    against_reference: f64,
    own_noise: f64,
}

fn rel_mse(film: &Film, truth: &Image, truth_variance: &Image) -> Result<RelMse, Error> {
    let variance = film.variance();
    let settings = CompareSettings {
        flip: false,
        variance_a: Some(&variance),
        variance_b: Some(truth_variance),
        ..CompareSettings::default()
    };
    let comparison = compare_with(&film.image(), truth, &settings)?;
    let noise_b = comparison.rel_mse_noise_b.unwrap_or(0.0);
    Ok(RelMse {
        against_reference: (comparison.rel_mse - noise_b).max(0.0),
        own_noise: comparison.rel_mse_noise_a.unwrap_or(f64::NAN),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_named_both_ways() {
        for method in RenderMethod::all() {
            assert_eq!(RenderMethod::from_name(&method.name()).unwrap(), method);
        }
        for wrong in ["delta", "delta+rato", "delta+ratio*x", "+", "a+b"] {
            assert!(RenderMethod::from_name(wrong).is_err(), "{wrong}");
        }
    }
}
