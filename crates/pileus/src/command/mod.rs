//! One file per command.

pub(crate) mod chart;
pub(crate) mod check;
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
use crate::input::Input;
use crate::settings::{Overrides, Settings};

/// A scene, ready to render.
pub(crate) struct Prepared {
    pub(crate) settings: Settings,
    pub(crate) loaded: Loaded,
    pub(crate) plan: Plan,
}

/// Resolves and loads what a command was given, and logs what was chosen or left out.
pub(crate) fn prepare(input: &InputOptions, overrides: &Overrides) -> Result<Prepared, Failure> {
    let input = Input::open(&input.input, &input.vdb_options())?;
    let mut settings = Settings::resolve(input, overrides)?;
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
        if let VolumeSource::Vdb { path, grid, density_scale, build } = &volume.source {
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
    let plan = Plan::new(&loaded.scene, &settings.render)?;
    Ok(Prepared { settings, loaded, plan })
}
