//! How the scene is sampled.

use pileus_film::Filter;
use pileus_integrator::RenderSettings;
use pileus_media::majorant::MajorantStructure;

use super::places::Places;
use crate::failure::Failure;
use crate::job::Job;

/// The renderer's settings; what a job does not say is their default.
pub(super) fn resolve(
    job: &Job,
    filter: Filter,
    places: &Places,
) -> Result<RenderSettings, Failure> {
    let spec = job.sampling.clone().unwrap_or_default();
    let majorants = match spec.majorants().as_str() {
        "auto" => MajorantStructure::default(),
        name => MajorantStructure::from_name(name).ok_or_else(|| {
            places.invalid(
                "/sampling/majorants",
                format!("there is no majorant structure `{name}`"),
                "take auto, adaptive, hierarchy, kd_tree, uniform_N with N voxels, or global",
            )
        })?,
    };
    Ok(RenderSettings {
        samples: 0..spec.spp(),
        seed: spec.seed(),
        max_bounces: spec.max_bounces,
        max_events: spec.max_events(),
        filter,
        transmittance: spec.transmittance().0,
        distance: spec.distance().0,
        majorants,
        majorant_scale: spec.majorant_scale(),
        shadow_roulette: spec.shadow_roulette().0,
        clamp: spec.clamp,
        continuation_exponent: spec.level_exponent(),
        ..RenderSettings::default()
    })
}
