//! The plan: the simplest machinery that is exact for a scene, chosen once per render, and why.
//! Data: a function of scene and settings that traces no path.

mod axes;
mod lights;
mod media;
mod methods;
mod report;
pub(crate) mod thickness;
pub(crate) mod warnings;

pub use axes::{Channels, Events, KernelAxes, PhaseFunctions, World};
pub use media::PlannedVolume;
pub(crate) use media::extinguishes;

use crate::counters::Counters;
use crate::dispatch::PlannedMedia;
use crate::error::{Error, Parameter, Remedy};
use crate::lights::Lights;
use crate::media::Methods;
use crate::settings::{RenderSettings, by_name};
use media::{DENSE, densest, describe};
use pileus_media::Medium;
use pileus_media::distance::DistanceSampler;
use pileus_media::majorant::MajorantStructure;
use pileus_media::method::Expectation;
use pileus_media::transmittance::Estimator;
use pileus_scene::{Scene, Surfaces};
use serde::Serialize;

/// What is modelled, by which methods, and why. Prints itself for people and serialises for `stats`
/// and image metadata.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Which path kernel runs.
    pub kernel: KernelAxes,
    /// Whether paths and shadow rays are weighted against each other.
    pub mis: bool,
    /// Free-flight sampler in use.
    #[serde(serialize_with = "by_name")]
    pub distance: DistanceSampler,
    /// Transmittance estimator in use.
    #[serde(serialize_with = "by_name")]
    pub transmittance: Estimator,
    /// Whether points seen by point-like lights at equal angles are sampled besides flights.
    #[serde(skip)]
    pub(crate) equiangular: bool,
    /// Whether flights end with the density of the media and carry no weight.
    #[serde(skip)]
    pub(crate) analog_flights: bool,
    #[serde(skip)]
    pub(crate) methods: Methods,
    /// Factor on the majorants of grids.
    pub majorant_scale: f32,
    /// What makes the mean of the image differ from the truth, by its settings' names.
    pub biased: Vec<String>,
    /// Majorant structure in use.
    pub majorants: String,
    /// Lights that shadow rays are sent to.
    pub shadow_ray_lights: usize,
    /// Most scattering events on a path; none: unlimited.
    pub max_bounces: Option<u32>,
    /// Most events of any kind on a path; none: unlimited.
    pub max_events: Option<u64>,
    /// The media.
    pub volumes: Vec<PlannedVolume>,
    /// Reasons for the choices.
    pub reasons: Vec<String>,
    /// What the files contain and the picture leaves out.
    pub not_modelled: Vec<String>,
    /// What is legal and probably not meant: pictures that will be black, volumes that nobody will
    /// see.
    pub warnings: Vec<String>,
}

/// What of a scene and its settings decides the kernel.
struct Facts {
    /// Number of volumes that have any extinction.
    volumes: usize,
    /// Whether the only volume is a grid that the kernels of one grid can walk.
    one_grid: bool,
    /// Whether extinction is the same in all channels of every volume.
    grey: bool,
    /// Whether all phase functions are isotropic or Henyey-Greenstein, the same everywhere.
    hg_or_isotropic: bool,
    wide: bool,
    /// Whether walks by tentative collisions would be very long.
    dense: bool,
    microflakes: bool,
    /// Whether some transmittance function is not exponential.
    non_exponential: bool,
    emissive_volumes: usize,
}

impl Facts {
    fn of(scene: &Scene, settings: &RenderSettings) -> Facts {
        let media =
            || scene.volumes.iter().map(|volume| &*volume.medium).filter(|m| extinguishes(m));
        let wide = |medium: &Medium| medium.grid().is_some_and(|grid| grid.is_wide());
        let microflakes = media().any(|medium| medium.phase().microflakes().is_some());
        let non_exponential = media().any(|medium| medium.transmittance_function().is_some());
        let grid = media().all(|m| m.grid().is_some() && !wide(m));
        let volumes = media().count();
        Facts {
            volumes,
            one_grid: volumes == 1 && grid && !microflakes && !non_exponential,
            grey: media().all(Medium::is_grey),
            hg_or_isotropic: media().all(|medium| medium.phase().hg_or_isotropic().is_some()),
            wide: media().any(wide),
            dense: densest(scene, settings).is_some_and(|(depth, _)| depth > DENSE),
            microflakes,
            non_exponential,
            emissive_volumes: scene.emissive_volumes().count(),
        }
    }

    /// The kernel for methods that the settings ask for or the plan has chosen.
    fn axes(&self, scene: &Scene, settings: &RenderSettings, methods: Methods) -> KernelAxes {
        let split = !self.dense && methods::channels_may_decouple(settings);
        let channels = match (self.grey, split) {
            (true, _) => Channels::Grey,
            (false, true) => Channels::Split,
            (false, false) => Channels::Spectral,
        };
        let tracked = methods.transmittance == Estimator::Ratio
            && (channels == Channels::Split || methods.distance == DistanceSampler::Delta);
        let default_majorants = settings.majorants == MajorantStructure::default();
        let one_grid = self.one_grid
            && tracked
            && channels != Channels::Spectral
            && default_majorants
            && !settings.shared_kernel;
        let events = match self.volumes {
            0 => Events::None,
            _ if one_grid => Events::OneGrid,
            _ => Events::MergedList,
        };
        let surfaces = scene.surfaces.is_some() || self.emissive_volumes > 0;
        KernelAxes {
            events,
            channels,
            world: if surfaces { World::VolumesAndSurfaces } else { World::Volumes },
            phase: if self.hg_or_isotropic && events == Events::OneGrid {
                PhaseFunctions::IsotropicOrHenyeyGreenstein
            } else {
                PhaseFunctions::Any
            },
        }
    }

    /// Why the kernel is what it is.
    fn explain(&self, kernel: KernelAxes, scene: &Scene, reasons: &mut Vec<String>) {
        reasons.push(match kernel.events {
            Events::None => "no volume".to_owned(),
            Events::OneGrid => "one grid: the kernel knows no list of media".to_owned(),
            Events::MergedList if self.volumes == 1 => {
                let why = match () {
                    () if self.wide => {
                        "a grid of more than 8192 voxels along an axis: rays are walked in parts, since single precision does not count so far"
                    }
                    () if self.microflakes => "microflakes: extinction differs by the direction of the ray",
                    () if self.non_exponential => {
                        "a transmittance function that is not exponential: flights and shadow rays know whether they start at one of its scatterers, and are one piece from there to their end"
                    }
                    () if !self.one_grid => "the medium is no grid",
                    () => "the kernels of one grid fly by tentative collisions on default majorants, and their shadow rays by ratio tracking",
                };
                format!("one medium, walked as a list: {why}")
            }
            Events::MergedList => format!(
                "{} media: collisions are taken in order along the ray; a ray that meets one of them walks it as if it were alone",
                self.volumes
            ),
        });
        if self.volumes > 1 && self.non_exponential {
            reasons.push(
                "a transmittance function that is not exponential: flights and shadow rays know whether they start at one of its scatterers, and are one piece from there to their end"
                    .into(),
            );
        }
        if self.volumes > 1 && self.wide {
            reasons.push(
                "a grid of more than 8192 voxels along an axis: its rays are walked in parts, since single precision does not count so far"
                    .into(),
            );
        }
        match kernel.channels {
            Channels::Grey => {}
            Channels::Split => {
                let decouple = "extinction differs per channel: channels fly coupled by delta tracking and decouple where their events differ";
                let weighted: Vec<String> = methods::weighted_beside_split(scene)
                    .map(|volume| format!("`{}`", volume.name))
                    .collect();
                reasons.push(match weighted.as_slice() {
                    [] => format!("{decouple}, so that none is weighted"),
                    _ => format!(
                        "{decouple}; flights that invert the optical depth are all channels' at once, weighted: in volume {}",
                        weighted.join(", ")
                    ),
                });
            }
            Channels::Spectral => reasons.push(
                "extinction differs per channel: one flight for all channels on the strongest one's majorant, weighted"
                    .into(),
            ),
        }
        if kernel.phase == PhaseFunctions::Any && kernel.events == Events::OneGrid {
            reasons.push(
                "a phase function beside isotropic and Henyey-Greenstein ones, or one by grid: the kernel has all of them"
                    .into(),
            );
        }
        if kernel.world == World::VolumesAndSurfaces {
            let counts = scene.surfaces.as_deref().map(Surfaces::counts).unwrap_or_default();
            let emissive = scene.surfaces.as_ref().map_or(0, |surfaces| surfaces.emitters().len());
            reasons.push(format!(
                "{} triangles in {} instances ({emissive} of them emissive), {} emissive volumes: surfaces are events along the ray, in order with the \
                 collisions",
                counts.triangles, counts.instances, self.emissive_volumes,
            ));
        }
    }
}

impl Plan {
    /// Plans a render: a function of scene and settings, in at most some seconds whatever the
    /// scene.
    ///
    /// # Errors
    /// If the settings ask for what the scene does not allow, or if paths would not end by
    /// construction.
    pub fn new(scene: &Scene, settings: &RenderSettings) -> Result<Plan, Error> {
        let lights = Lights::without_emissive_volumes(scene, settings.light_sampling);
        Plan::with_lights(scene, settings, &lights)
    }

    /// Plans a render whose lights are made already; [`Plan::new`] makes them.
    ///
    /// # Errors
    /// If the settings ask for what the scene does not allow, or if paths would not end by
    /// construction.
    pub(crate) fn with_lights(
        scene: &Scene,
        settings: &RenderSettings,
        lights: &Lights,
    ) -> Result<Plan, Error> {
        if settings.max_events == Some(0) {
            return Err(Error::Parameter {
                parameter: Parameter::MaxEvents,
                value: "0".into(),
                why: "no path could begin".into(),
                remedies: vec![Remedy::Default(&[Parameter::MaxEvents])],
            });
        }
        if settings.max_bounces.is_none() {
            warnings::refuse_endless(scene)?;
        }
        settings.filter.validate().map_err(|error| Error::Parameter {
            parameter: Parameter::Filter,
            value: format!("{:?}", settings.filter),
            why: error.to_string(),
            remedies: vec![Remedy::Default(&[Parameter::Filter])],
        })?;
        if settings.majorants != MajorantStructure::default() || settings.majorant_scale != 1.0 {
            // An experiment's structure has to be possible: this builds it, and drops it.
            PlannedMedia::new(scene, settings)?;
        }
        let facts = Facts::of(scene, settings);
        let mut chosen = Vec::new();
        let methods = methods::choose(scene, settings, (facts.grey, facts.dense), &mut chosen)?;
        let kernel = facts.axes(scene, settings, methods);
        let mut reasons = Vec::new();
        facts.explain(kernel, scene, &mut reasons);
        for volume in scene.volumes.iter().filter(|volume| !extinguishes(&volume.medium)) {
            reasons
                .push(format!("volume `{}` has no extinction: no path asks for it", volume.name));
        }
        reasons.append(&mut chosen);
        if settings.distance == Some(DistanceSampler::Split) && kernel.channels != Channels::Split {
            reasons.push(
                "no channels decouple: extinction is the same for all, or shadow rays do not run by ratio tracking of bounds that hold"
                    .into(),
            );
        }
        let mis = lights.need_mis();
        let suns = scene.lights.iter().filter(|l| l.position().is_none()).count();
        if mis {
            reasons.push(
                "a light can be met by shadow rays and by paths: both are weighted by the densities of the null-scattering path"
                    .into(),
            );
        } else if lights.is_empty() {
            reasons.push("no light that shadow rays could be aimed at: none are sent".into());
        } else {
            reasons.push(format!(
                "{} lights ({suns} distant) can be met by shadow rays only: no weights are needed",
                lights.count()
            ));
        }
        let draws = settings.light_sampling == crate::LightSampling::Both;
        if facts.emissive_volumes > 0 && draws {
            reasons.push(
                "emissive volumes draw paths to themselves: a share of the directions is drawn by what is seen of them, and light is collected all along \
                 each flight"
                    .into(),
            );
        }
        if scene.environment.constant.max_element() > 0.0 {
            reasons.push(
                "constant light from the environment is met by escaping paths alone: scattered directions already sample it \
                 perfectly"
                    .into(),
            );
        }
        if facts.non_exponential {
            methods::check_transmittance_functions(scene, settings, methods, &mut reasons)?;
        }
        let equiangular = !facts.non_exponential
            && methods::choose_equiangular(scene, settings, lights, &mut reasons);
        if mis && facts.non_exponential {
            reasons.push(
                "weights leave the way out through media whose transmittance function is not exponential: it has no null collisions"
                    .into(),
            );
        }
        if mis && facts.volumes > 0 && !methods.weigh_the_way(facts.grey) {
            reasons.push(format!(
                "{} and {} have no common density along a path: weights leave the way out",
                methods.distance.name(),
                methods.transmittance.name()
            ));
        }
        let mut not_modelled = scene.not_modelled.clone();
        if let Some(surfaces) = scene.surfaces.as_deref() {
            lights::describe_panes(scene, surfaces, &mut reasons, &mut not_modelled);
        }
        Ok(Plan {
            kernel,
            mis,
            distance: if equiangular {
                DistanceSampler::Equiangular
            } else if kernel.channels == Channels::Split {
                DistanceSampler::Split
            } else {
                methods.distance
            },
            transmittance: methods.transmittance,
            equiangular,
            analog_flights: methods::are_analog(scene, kernel.channels, methods),
            methods,
            majorant_scale: settings.majorant_scale,
            biased: biased(scene, settings, methods),
            majorants: settings.majorants.name(),
            shadow_ray_lights: lights.count(),
            max_bounces: settings.max_bounces,
            max_events: settings.max_events,
            volumes: scene.volumes.iter().map(|v| describe(&v.name, &v.medium)).collect(),
            reasons,
            not_modelled,
            warnings: warnings::all(scene, settings),
        })
    }

    /// This plan with what a render counted in the place of what might have happened: which limits
    /// did cut paths.
    pub fn settled(mut self, counters: &Counters) -> Plan {
        let Some(n) = self.max_events else { return self };
        self.biased.retain(|line| !line.starts_with(warnings::MAX_EVENTS));
        if counters.cut_by_max_events > 0 {
            self.biased.push(format!(
                "{} {n}: {} of {} paths were cut",
                warnings::MAX_EVENTS,
                counters.cut_by_max_events,
                counters.paths
            ));
        }
        self
    }
}

/// What makes the mean of the image differ from the truth.
fn biased(scene: &Scene, settings: &RenderSettings, methods: Methods) -> Vec<String> {
    let mut biased = Vec::new();
    if let Expectation::Biased(how) = methods.transmittance.facts().expectation {
        biased.push(format!("transmittance {}: {how}", methods.transmittance.name()));
    }
    if let Expectation::Biased(how) = methods.distance.facts().expectation {
        biased.push(format!("distance {}: {how}", methods.distance.name()));
    }
    if let Some(n) = settings.max_bounces {
        biased.push(format!("max_bounces {n}: longer paths are cut"));
    }
    if let Some(most) = settings.clamp {
        biased.push(format!("clamp {most}: brighter samples are darkened"));
    }
    biased.extend(warnings::may_cut(scene, settings));
    biased
}
