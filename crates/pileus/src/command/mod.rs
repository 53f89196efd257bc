//! One file per command.

pub(crate) mod chart;
pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod info;
pub(crate) mod plan;
pub(crate) mod probe;
pub(crate) mod render;
pub(crate) mod schema;

use pileus_integrator::{Plan, RenderSettings};
use pileus_scene::{Loaded, Scene, VolumeSource};

use crate::cli::InputOptions;
use crate::failure::Failure;
use crate::film_plan::FilmPlan;
use crate::input::Input;
use crate::outputs;
use crate::settings::{Overrides, Settings};

/// A scene, ready to render.
pub(crate) struct Prepared {
    pub(crate) settings: Settings,
    pub(crate) loaded: Loaded,
    pub(crate) film: FilmPlan,
    pub(crate) plan: Plan,
}

/// Resolves and loads what a command was given, plans it, and logs what was chosen, left out or is
/// probably not meant.
pub(crate) fn prepare(input: &InputOptions, overrides: &Overrides) -> Result<Prepared, Failure> {
    load(resolve(input, overrides)?, Plan::new)
}

/// Makes the plan of a scene: [`Plan::new`], or [`Plan::without_paths`] for what has to be quick.
pub(crate) type Planned = fn(&Scene, &RenderSettings) -> Result<Plan, pileus_integrator::Error>;

/// As [`prepare`], for commands whose outputs must be writable and overwrite nothing: what can be
/// known of that is looked at before anything is loaded.
pub(crate) fn prepare_to_write(
    planned: Planned,
    input: &InputOptions,
    overrides: &Overrides,
) -> Result<Prepared, Failure> {
    let settings = resolve(input, overrides)?;
    outputs::check(&settings.reads(None), &settings.targets(0))?;
    let prepared = load(settings, planned)?;
    let Prepared { settings, loaded, film, .. } = &prepared;
    outputs::check(&settings.reads(Some(loaded)), &settings.targets(film.pixels()))?;
    Ok(prepared)
}

fn resolve(input: &InputOptions, overrides: &Overrides) -> Result<Settings, Failure> {
    let overrides = Overrides { camera: input.camera.clone(), ..overrides.clone() };
    Settings::resolve(Input::open(&input.input, &input.vdb_options())?, &overrides)
}

fn load(mut settings: Settings, planned: Planned) -> Result<Prepared, Failure> {
    let loaded = settings.load()?;
    for note in &loaded.notes {
        tracing::info!("{note}");
    }
    for warning in &loaded.warnings {
        tracing::warn!("{warning}");
    }
    for item in &loaded.scene.not_modelled {
        tracing::warn!("not modelled: {item}");
    }
    for volume in &loaded.scene.volumes {
        if let VolumeSource::Vdb { path, grid, density_scale, build, .. } = &volume.source {
            tracing::debug!(
                "volume `{}`: grid `{grid}` of {}, scale {density_scale}, {} bricks, {:.1} MB of voxels, {:.2} MB of bounds, built in {:.4} s of which bounds {:.4} s",
                volume.name,
                path.display(),
                build.bricks,
                build.bytes_voxels as f64 * 1e-6,
                (build.bytes_bounds + build.bytes_index) as f64 * 1e-6,
                build.seconds,
                build.seconds_bounds,
            );
        }
    }
    let film = FilmPlan::of(&settings, &loaded.scene)?;
    let plan = planned(&loaded.scene, &settings.render)?;
    // What the plan adds to what the files say.
    for item in plan.not_modelled.iter().skip(loaded.scene.not_modelled.len()) {
        tracing::warn!("not modelled: {item}");
    }
    for warning in &plan.warnings {
        tracing::warn!("{warning}");
    }
    for limit in &plan.biased {
        tracing::info!("biased: {limit}");
    }
    Ok(Prepared { settings, loaded, film, plan })
}
