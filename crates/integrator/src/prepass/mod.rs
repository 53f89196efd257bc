//! What needs paths before a render: what they will cost, and what shadow rays may bring. A few
//! paths of the real kernel, heard by a recorder: nothing here decides what the picture's mean is.

mod cost;
mod radiance;

pub use cost::RecordedRays;
pub(crate) use radiance::RadianceCache;

use crate::cost::PathCost;
use crate::dispatch::Parts;
use crate::plan::warnings;
use crate::settings::ShadowRoulette;
use serde::Serialize;
use std::fmt;

/// Paths that predict costs: some milliseconds; a tenth of error, up to a half where few paths
/// scatter for long (`docs/charts/majorants.md`).
const COST_PATHS: u32 = 512;

/// Optical depth of a voxel above which no paths are traced ahead: null collisions before a real
/// one grow as its root.
const MAX_VOXEL_DEPTH: f64 = 1e5;

/// Scatterings per path below which shadow rays undergo Russian roulette by what a prepass expects
/// of them. Measured: `docs/charts/methods.md`.
const MAX_CACHED_SCATTERINGS: f64 = 1.5;

/// What a few paths ahead of a render have told.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Prepass {
    /// Expected cost per path, where there are volumes.
    pub predicted: Option<PathCost>,
    /// What was decided, and why.
    pub reasons: Vec<String>,
    /// What is probably not meant: volumes that no path met.
    pub warnings: Vec<String>,
    #[serde(skip)]
    pub(crate) radiance_cache: Option<RadianceCache>,
}

impl Prepass {
    /// Traces some paths: at most some seconds of work, whatever the scene.
    pub(crate) fn new(parts: &Parts<'_>) -> Prepass {
        let mut prepass = Prepass::default();
        let media = || parts.scene.volumes.iter().map(|volume| &*volume.medium);
        if let Some(depth) = warnings::depth_of_a_voxel(media()).filter(|d| *d > MAX_VOXEL_DEPTH) {
            prepass.reasons.push(format!(
                "no paths are traced to predict costs: a voxel has an optical depth of up to {depth:.2e}, and walks would be long"
            ));
            return prepass;
        }
        if media().any(|medium| medium.grid().is_some()) {
            let (cost, met) = cost::predict(parts, COST_PATHS);
            if !met {
                prepass.warnings.extend(warnings::met_by_none(parts.scene, COST_PATHS));
            }
            prepass.predicted = Some(cost);
        }
        prepass.choose_shadow_roulette(parts);
        prepass
    }

    /// Asks what shadow rays may bring, where that pays.
    fn choose_shadow_roulette(&mut self, parts: &Parts<'_>) {
        let (plan, lights) = (parts.plan, parts.lights);
        let distant = lights.positions().next().is_none() && !lights.is_empty();
        let possible = distant && !plan.volumes.is_empty();
        let roulette = parts.settings.shadow_roulette;
        let asked = roulette == Some(ShadowRoulette::AdjointDriven);
        if !possible || roulette == Some(ShadowRoulette::Importance) {
            if asked {
                self.reasons.push(
                    "shadow rays undergo Russian roulette by importance: a radiance cache is for media under distant lights"
                        .into(),
                );
            }
            return;
        }
        let by_importance = |scatterings: f64| {
            format!(
                "shadow rays undergo Russian roulette by importance: {scatterings:.2} scatterings a path, and a radiance cache pays below {MAX_CACHED_SCATTERINGS}"
            )
        };
        // Where the cost's paths know the answer, no more are traced.
        let known = self.predicted.map(|cost| cost.collisions_per_path);
        if let Some(scatterings) = known.filter(|n| !asked && *n >= MAX_CACHED_SCATTERINGS) {
            self.reasons.push(by_importance(scatterings));
            return;
        }
        let Some(cache) = RadianceCache::new(parts) else { return };
        let scatterings = cache.scatterings();
        if asked || scatterings < MAX_CACHED_SCATTERINGS {
            self.reasons.push(format!(
                "shadow rays undergo Russian roulette by what a radiance cache expects of them: {scatterings:.2} scatterings a path"
            ));
            self.radiance_cache = Some(cache);
        } else {
            self.reasons.push(by_importance(scatterings));
        }
    }
}

impl fmt::Display for Prepass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(cost) = self.predicted {
            writeln!(f, "expected       {cost}")?;
        }
        for reason in &self.reasons {
            writeln!(f, "because        {reason}")?;
        }
        for item in &self.warnings {
            writeln!(f, "warning        {item}")?;
        }
        Ok(())
    }
}

/// A point of the film for path number `number`: a lattice of rank one covers the picture evenly
/// whatever the number of paths.
fn lattice([width, height]: [u32; 2], number: u32) -> [f64; 2] {
    let at = |step: f64, n: u32| (f64::from(number) * step).fract() * f64::from(n);
    [at(0.754_877_666_246_692_7, width), at(0.569_840_290_998_053_3, height)]
}
