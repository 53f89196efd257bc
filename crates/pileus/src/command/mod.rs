//! One file per command.

#[cfg(feature = "lab")]
pub(crate) mod chart;
pub(crate) mod check;
#[cfg(feature = "lab")]
pub(crate) mod compare;
pub(crate) mod info;
pub(crate) mod plan;
pub(crate) mod probe;
pub(crate) mod render;
pub(crate) mod schema;

use pileus_integrator::Plan;
use pileus_scene::{Loaded, VolumeSource};

use crate::cli::InputOptions;
use crate::failure::Failure;
use crate::film_plan::FilmPlan;
use crate::input::Input;
use crate::outputs;
use crate::settings::{Overrides, Settings};
use crate::words;

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
    load(resolve(input, overrides)?)
}

/// Resolves, loads and plans what a command was given that writes files, and logs what was chosen.
///
/// # Errors
/// If an output cannot be written or would overwrite what is read: what can be known of that is
/// looked at before anything is loaded. Further, where [`prepare`] fails.
pub(crate) fn prepare_to_write(
    input: &InputOptions,
    overrides: &Overrides,
) -> Result<Prepared, Failure> {
    let settings = resolve(input, overrides)?;
    outputs::check(&settings.reads(None), &settings.targets(0))?;
    let prepared = load(settings)?;
    let Prepared { settings, loaded, film, .. } = &prepared;
    outputs::check(&settings.reads(Some(loaded)), &settings.targets(film.pixels()))?;
    Ok(prepared)
}

fn resolve(input: &InputOptions, overrides: &Overrides) -> Result<Settings, Failure> {
    let overrides = Overrides { camera: input.camera.clone(), ..overrides.clone() };
    Settings::resolve(Input::open(&input.input, &input.vdb_options())?, &overrides)
}

fn load(settings: Settings) -> Result<Prepared, Failure> {
    let loaded = settings.load()?;
    for note in &loaded.notes {
        tracing::info!("{note}");
    }
    for hint in &loaded.hints {
        tracing::info!("{}", words::hint(*hint));
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
    let plan = Plan::new(&loaded.scene, &settings.render)
        .map_err(|error| words::of_job(&settings, error))?;
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
