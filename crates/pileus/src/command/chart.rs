//! `pileus chart`: experiments of the lab on the user's files.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use pileus_film::write_atomically;
use pileus_lab::ProfileCase;
use pileus_lab::chart::Chart;
use pileus_lab::experiment::{
    RenderExperiment, RenderMethod, Subject, TransmittanceMethod, TransmittanceSettings,
    chart_debiasing, chart_majorants, chart_render, chart_transmittance, classed_rays, stability,
};
use pileus_scene::json::Document;
use pileus_scene::{Error, Place};
use serde::Deserialize;

use crate::cli::{
    ChartMajorantsOptions, ChartOptions, ChartRenderOptions, ChartStabilityOptions,
    ChartTransmittanceOptions, Experiment, InputOptions,
};
use crate::command::prepare;
use crate::failure::Failure;
use crate::input::read_text;
use crate::outputs::{self, Target};
use crate::report::Report;
use crate::settings::Overrides;

/// Seconds that a method may take on one ray.
const SECONDS_PER_RAY: f64 = 0.5;
/// Largest file of closed forms or timings.
const MAX_TEXT: u64 = 64 << 20;

pub(crate) fn run(options: &ChartOptions, report: &Report) -> Result<(), Failure> {
    match &options.experiment {
        Experiment::Transmittance(options) => transmittance(options, report),
        Experiment::Render(options) => render(options, report),
        Experiment::Majorants(options) => majorants(options, report),
        Experiment::Stability(options) => {
            ready(&options.output)?;
            stability_chart(options, report)
        }
        Experiment::Debiasing(options) => {
            ready(&options.output)?;
            write(&chart_debiasing()?, &options.output, report)
        }
    }
}

/// Makes the folder of charts, and finds out whether it can be written.
fn ready(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|source| Failure::Io {
        path: folder.to_owned(),
        what: "this folder cannot be made".into(),
        source,
    })?;
    outputs::check(&[], &[Target::by_option("the chart", &folder.join("chart.csv"), 0)])
}

/// Refuses charts that would overwrite what they are made from, or each other, before anything is
/// measured. Their files are called like the chart, with an ending.
fn check_names(
    folder: &Path,
    kind: &str,
    names: &[String],
    reads: &[&PathBuf],
) -> Result<(), Failure> {
    let same = |path: &Path| {
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let parent = std::fs::canonicalize(parent).ok();
        parent.is_some() && parent == std::fs::canonicalize(folder).ok()
    };
    for (i, name) in names.iter().enumerate() {
        if names[..i].contains(name) {
            return Err(Failure::usage(
                format!("two charts would be called {kind}-{name} and overwrite each other"),
                "draw them into different folders with -o",
            ));
        }
        let chart = format!("{kind}-{name}");
        let would_write = |path: &&&PathBuf| {
            // A link may lead anywhere.
            let whole = std::fs::canonicalize(path).unwrap_or(path.to_path_buf());
            [path.as_path(), whole.as_path()].into_iter().any(|path| {
                let file = path.file_name().map(|n| n.to_string_lossy().into_owned());
                let rest = file.as_deref().and_then(|file| file.strip_prefix(&chart));
                let ours = |rest: &str| {
                    rest.starts_with(['.', '-'])
                        && [".csv", ".html", ".svg", ".png"].iter().any(|end| rest.ends_with(end))
                };
                rest.is_some_and(ours) && same(path)
            })
        };
        if let Some(read) = reads.iter().find(would_write) {
            return Err(Failure::usage(
                format!("the chart would overwrite {}, which is read", read.display()),
                "draw it into another folder with -o",
            ));
        }
    }
    ready(folder)
}

fn write(chart: &Chart, folder: &Path, report: &Report) -> Result<(), Failure> {
    for path in chart.write(folder)? {
        tracing::debug!("{} written", path.display());
    }
    let page = folder.join(format!("{}.html", chart.name));
    report.text(format!("{}\n{}", page.display(), chart.table.markdown()));
    Ok(())
}

fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "asset".into(), |s| s.to_string_lossy().into_owned())
}

/// What the chart of an asset is called: after its file, or the case of a file.
fn name_of(asset: &Path) -> String {
    match asset.to_string_lossy().rsplit_once('#') {
        Some((_, case)) if !asset.exists() => case.to_owned(),
        _ => stem(asset),
    }
}

#[derive(Deserialize)]
struct ClosedForms {
    cases: Vec<ProfileCase>,
}

/// The closed forms in a JSON file, if that is what it holds; `FILE#NAME` is one of them.
fn closed_forms(asset: &Path) -> Result<Option<(String, Vec<ProfileCase>)>, Failure> {
    let name = asset.to_string_lossy();
    let (file, wanted) = match name.rsplit_once('#') {
        Some((file, wanted)) if !asset.exists() => (PathBuf::from(file), Some(wanted.to_owned())),
        _ => (asset.to_owned(), None),
    };
    if file.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("json")) {
        return Ok(None);
    }
    let text = read_text(&file, MAX_TEXT)?;
    let value: Option<serde_json::Value> = serde_json::from_str(&text).ok();
    if value.is_none_or(|value| value.get("cases").is_none()) {
        return Ok(None);
    }
    let ClosedForms { mut cases } = Document::new(&file, text).parse()?;
    for case in &cases {
        let numbers = [case.length, case.bound(), case.optical_depth()];
        if !numbers.iter().all(|x| x.is_finite() && *x >= 0.0) {
            let what = format!("case `{}` has no finite depth, length or bound", case.name);
            let remedy = "give finite numbers of at least 0";
            return Err(Error::invalid(Place::file(&file), what, remedy).into());
        }
    }
    let mut name = stem(&file);
    if let Some(wanted) = wanted {
        let names: Vec<String> = cases.iter().map(|c| c.name.clone()).collect();
        cases.retain(|case| case.name == wanted);
        if cases.is_empty() {
            return Err(Failure::usage(
                format!("{}: there is no case `{wanted}`", file.display()),
                format!("take one of {}", names.join(", ")),
            ));
        }
        name = wanted;
    }
    Ok(Some((name, cases)))
}

fn transmittance(options: &ChartTransmittanceOptions, report: &Report) -> Result<(), Failure> {
    let reads: Vec<&PathBuf> = options.assets.iter().collect();
    let names: Vec<String> = options.assets.iter().map(|asset| name_of(asset)).collect();
    check_names(&options.output, "transmittance", &names, &reads)?;
    let settings = TransmittanceSettings {
        samples: options.samples,
        seed: options.seed,
        methods: TransmittanceMethod::all(),
        seconds_per_ray: SECONDS_PER_RAY,
    };
    for asset in &options.assets {
        if let Some((name, cases)) = closed_forms(asset)? {
            let chart = chart_transmittance(&name, &Subject::Profiles(cases), &settings);
            write(&chart, &options.output, report)?;
            continue;
        }
        let input = InputOptions {
            input: asset.clone(),
            grid: options.grid.clone(),
            density_scale: options.density_scale,
            up_axis: None,
            camera: None,
        };
        let prepared = prepare(&input, &Overrides::default())?;
        let grids: Vec<_> = prepared
            .loaded
            .scene
            .volumes
            .iter()
            .filter(|volume| volume.medium.grid().is_some())
            .map(|volume| (volume.name.clone(), &*volume.medium))
            .collect();
        let [(_, medium), others @ ..] = grids.as_slice() else {
            return Err(Failure::usage(
                format!("{}: there is no grid to take rays from", asset.display()),
                "give a volume, or a job with one",
            ));
        };
        if !others.is_empty() {
            tracing::warn!("{}: rays of the first grid only", asset.display());
        }
        let rays = classed_rays(medium, options.rays as usize, options.seed);
        if rays.is_empty() {
            return Err(Failure::usage(
                format!(
                    "{}: no ray of an optical depth from 1e-6 to 15 was found",
                    asset.display()
                ),
                "set --density-scale so that light gets through",
            ));
        }
        let mut chart =
            chart_transmittance(&stem(asset), &Subject::Rays { medium, rays }, &settings);
        chart.provenance = chart.provenance.with(
            "extinction at grid value 1",
            medium.grid().map_or(0.0, |grid| grid.sigma_t_scale()),
        );
        write(&chart, &options.output, report)?;
    }
    Ok(())
}

fn render(options: &ChartRenderOptions, report: &Report) -> Result<(), Failure> {
    let methods = if options.methods.is_empty() {
        RenderMethod::all()
    } else {
        options
            .methods
            .iter()
            .map(|name| {
                // The command line is what names methods.
                RenderMethod::from_name(name).map_err(|error| Failure::usage(error.to_string(), ""))
            })
            .collect::<Result<_, _>>()?
    };
    let reads: Vec<&PathBuf> = options.jobs.iter().chain(&options.peers).collect();
    let names: Vec<String> = options.jobs.iter().map(|job| stem(job)).collect();
    check_names(&options.output, "render", &names, &reads)?;
    let peers = options.peers.as_deref().map(read_peers).transpose()?.unwrap_or_default();
    for job in &options.jobs {
        let input = InputOptions::of(job.clone());
        let overrides = Overrides { resolution: options.resolution, ..Overrides::default() };
        let prepared = prepare(&input, &overrides)?;
        let name = stem(job);
        let experiment = RenderExperiment {
            scene: &prepared.loaded.scene,
            settings: prepared.settings.render.clone(),
            methods: methods.clone(),
            seconds: options.seconds,
            reference_spp: options.reference_spp,
            exposure_stops: prepared.settings.outputs.exposure,
            peers: peers.get(&name).cloned().unwrap_or_default(),
            name,
        };
        write(&chart_render(&experiment)?, &options.output, report)?;
    }
    Ok(())
}

fn majorants(options: &ChartMajorantsOptions, report: &Report) -> Result<(), Failure> {
    let reads: Vec<&PathBuf> = options.jobs.iter().collect();
    let names: Vec<String> = options.jobs.iter().map(|job| stem(job)).collect();
    check_names(&options.output, "majorants", &names, &reads)?;
    for job in &options.jobs {
        let input = InputOptions::of(job.clone());
        let overrides = Overrides { resolution: options.resolution, ..Overrides::default() };
        let prepared = prepare(&input, &overrides)?;
        let (scene, settings) = (&prepared.loaded.scene, &prepared.settings.render);
        let chart = chart_majorants(&stem(job), scene, settings, options.seconds)?;
        write(&chart, &options.output, report)?;
    }
    Ok(())
}

/// Points of other renderers by scene: name, seconds, relMSE.
type Peers = HashMap<String, Vec<(String, f64, f64)>>;

fn read_peers(path: &Path) -> Result<Peers, Failure> {
    let text = read_text(path, MAX_TEXT)?;
    let mut lines =
        text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
    let wrong = |line: usize, what: &str| {
        let place = Place { line: Some(line + 1), ..Place::file(path) };
        let remedy =
            "give comma-separated columns scene, renderer, seconds and relmse, with a header";
        Failure::from(Error::invalid(place, what, remedy))
    };
    let (line, header) = lines.next().ok_or_else(|| wrong(0, "the file is empty"))?;
    let columns: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| {
        columns
            .iter()
            .position(|c| *c == name)
            .ok_or_else(|| wrong(line, &format!("no column `{name}`")))
    };
    let (scene, renderer) = (column("scene")?, column("renderer")?);
    let (seconds, error) = (column("seconds")?, column("relmse")?);
    let mut peers = Peers::new();
    for (line, row) in lines {
        let cells: Vec<&str> = row.split(',').map(str::trim).collect();
        let cell = |i: usize| cells.get(i).copied().ok_or_else(|| wrong(line, "too few columns"));
        let number = |i: usize| -> Result<f64, Failure> {
            let text = cell(i)?;
            text.parse().map_err(|_| wrong(line, &format!("`{text}` is not a number")))
        };
        let name = cell(renderer)?;
        if name != "pileus" {
            let point = (name.to_owned(), number(seconds)?, number(error)?);
            peers.entry(cell(scene)?.to_owned()).or_default().push(point);
        }
    }
    Ok(peers)
}

fn stability_chart(options: &ChartStabilityOptions, report: &Report) -> Result<(), Failure> {
    let stability = stability()?;
    let chart = stability.chart();
    chart.write(&options.output)?;
    let page = options.output.join("stability.md");
    write_atomically(&page, |out| std::io::Write::write_all(out, stability.markdown().as_bytes()))?;
    report.text(format!("{}\n{}", page.display(), stability.matrix().markdown()));
    Ok(())
}
