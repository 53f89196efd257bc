//! The plan: the simplest machinery that is exact for a scene, chosen once per render, and why.

use crate::Error;
use crate::cost::PathCost;
use crate::counters::Counters;
use crate::expected::Expected;
use crate::lights::Lights;
use crate::media::{MediaIndex, Methods};
use crate::pilot::Pilot;
use crate::settings::{Distance, RenderSettings, ShadowRoulette, Transmittance};
use crate::thickness::typical_depth;
use crate::warnings;
use crate::world::luminance;
use pileus_media::distance::DistanceSampler;
use pileus_media::law::Law;
use pileus_media::transmittance::Estimator;
use pileus_media::{Albedo, GridShape, MajorantStructure, Medium};
use pileus_scene::{Light, Scene, Surfaces};
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

/// Which path kernel runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum KernelKind {
    /// No medium: the environment alone.
    Empty,
    /// One grid, grey extinction.
    SingleGrey,
    /// One grid, extinction per channel: channels part where their events differ.
    SingleChromatic,
    /// A list of media, per channel.
    Overlapping,
    /// The same with surfaces and light from volumes.
    Whole,
    /// The same for media that follow laws which are not exponential.
    UnderLaw,
}

/// A volume as planned.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannedVolume {
    /// The user's name for it.
    pub name: String,
    /// `grid` or `homogeneous`.
    pub kind: &'static str,
    /// Whether all channels have the same extinction.
    pub grey: bool,
    /// Largest extinction, 1/scene unit.
    pub sigma_t_max: f64,
    /// Stored precision of the voxels; none for homogeneous media.
    pub voxels: Option<&'static str>,
    /// Bytes of voxels, bounds and tables.
    pub bytes: u64,
    /// Transmittance law; none is the exponential one.
    pub law: Option<String>,
    /// Phase function.
    pub phase: String,
    /// Albedo.
    pub albedo: String,
}

/// The media that a plan renders: those of the scene, with the majorants it chose.
#[derive(Debug, Clone)]
pub(crate) struct PlannedMedia {
    pub(crate) media: Vec<Arc<Medium>>,
    pub(crate) index: Arc<MediaIndex>,
}

impl PartialEq for PlannedMedia {
    /// Plans are compared by what they choose; what they are made for is the scene's to say.
    fn eq(&self, _: &PlannedMedia) -> bool {
        true
    }
}

/// The lights that a plan renders by: made once, since fires bring tables.
#[derive(Debug, Clone)]
pub(crate) struct PlannedLights(pub(crate) Arc<Lights>);

impl PartialEq for PlannedLights {
    /// As of [`PlannedMedia`].
    fn eq(&self, _: &PlannedLights) -> bool {
        true
    }
}

/// Paths of the pilot: some milliseconds; a tenth of error, up to a half where few paths scatter for long (`docs/charts/majorants.md`).
const PILOT_PATHS: u32 = 512;

/// Optical depth of a voxel above which no paths are traced ahead: null collisions before a real
/// one grow as its root.
const MAX_PILOT_DEPTH: f64 = 1e5;

/// What is modelled, by which methods, and why. Prints itself for people and serialises for `stats` and image metadata.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    pub(crate) kernel: KernelKind,
    /// Whether paths and shadow rays are weighted against each other.
    pub mis: bool,
    /// Free-flight sampler in use.
    pub distance: Distance,
    /// Transmittance estimator in use.
    pub transmittance: Transmittance,
    /// Whether points seen by point-like lights at equal angles are sampled besides flights.
    #[serde(skip)]
    pub(crate) equiangular: bool,
    /// Whether flights end with the density of the media and carry no weight.
    #[serde(skip)]
    pub(crate) analog_flights: bool,
    #[serde(skip)]
    pub(crate) methods: Methods,
    #[serde(skip)]
    pub(crate) media: PlannedMedia,
    #[serde(skip)]
    pub(crate) lights: PlannedLights,
    /// What shadow rays may bring, where a pilot was asked.
    #[serde(skip)]
    pub(crate) expected: Option<Arc<Expected>>,
    /// Factor on the majorants of grids.
    pub majorant_scale: f32,
    /// What makes the mean of the image differ from the truth, by its settings' names.
    pub biased: Vec<String>,
    /// Majorant structure in use.
    pub majorants: String,
    /// Expected cost per path, for grids under delta and ratio tracking; none for other methods.
    pub predicted: Option<PathCost>,
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

impl Plan {
    /// Plans a render, by a few paths where they tell what no formula knows: at most some seconds
    /// of work, whatever the scene.
    ///
    /// # Errors
    /// If the settings ask for what the scene does not allow, or if paths would not end by
    /// construction.
    pub fn new(scene: &Scene, settings: &RenderSettings) -> Result<Plan, Error> {
        let mut plan = Plan::without_paths(scene, settings)?;
        plan.ask_pilots(scene, settings);
        Ok(plan)
    }

    /// As [`Plan::new`], without tracing a path: nothing is predicted, and shadow rays are left to
    /// importance. A render by it is right, and slower in some scenes.
    ///
    /// # Errors
    /// If the settings ask for what the scene does not allow, or if paths would not end by
    /// construction.
    pub fn without_paths(scene: &Scene, settings: &RenderSettings) -> Result<Plan, Error> {
        if settings.max_events == Some(0) {
            return Err(Error::Invalid {
                what: "sampling.max_events is 0: no path could begin".into(),
                remedy: "give at least 1, or null for no limit".into(),
            });
        }
        if settings.max_bounces.is_none() {
            warnings::refuse_endless(scene)?;
        }
        settings.filter.validate().map_err(|error| Error::Invalid {
            what: error.to_string(),
            remedy: "correct film.filter".into(),
        })?;
        let mut reasons = Vec::new();
        let volumes: Vec<PlannedVolume> =
            scene.volumes.iter().map(|volume| describe(&volume.name, &volume.medium)).collect();
        let grids = scene.volumes.iter().filter(|v| v.medium.grid().is_some()).count();
        let grey = volumes.iter().all(|v| v.grey);
        let plain = scene.volumes.iter().all(|v| v.medium.phase().plain().is_some());
        let wide = scene.volumes.iter().any(|v| is_wide(&v.medium));
        let dense = densest(scene, settings).is_some_and(|(depth, _)| depth > DENSE);
        let surfaces = scene.surfaces.as_deref();
        let fires = scene.fires().count();
        let flakes = || scene.volumes.iter().filter_map(|volume| volume.medium.phase().flakes());
        let of_flakes = flakes().next().is_some();
        let laws = scene.volumes.iter().any(|volume| volume.medium.transmittance_function().is_some());
        let kernel = match volumes.len() {
            _ if laws => KernelKind::UnderLaw,
            _ if surfaces.is_some() || fires > 0 => KernelKind::Whole,
            0 => KernelKind::Empty,
            1 if grids == 1 && grey && plain && !wide => KernelKind::SingleGrey,
            1 if grids == 1 && !grey && plain && !wide && !dense && channels_may_part(settings) => {
                KernelKind::SingleChromatic
            }
            _ => KernelKind::Overlapping,
        };
        reasons.push(match kernel {
            KernelKind::Empty => "no volume: only the environment is seen".to_owned(),
            KernelKind::SingleGrey => "one grid of grey extinction: the kernel knows no channels of distance and no list of \
                 media"
                .to_owned(),
            KernelKind::Whole => {
                let counts = surfaces.map(Surfaces::counts).unwrap_or_default();
                let lamps = surfaces.map_or(0, |surfaces| surfaces.emitters().len());
                format!(
                    "{} triangles in {} instances ({lamps} of them emissive), {fires} volumes that give off light, {} media: surfaces are events \
                     along the ray, in order with the collisions",
                    counts.triangles,
                    counts.instances,
                    volumes.len()
                )
            }
            KernelKind::Overlapping if of_flakes && volumes.len() == 1 => {
                "flakes: extinction differs by the direction of the ray".to_owned()
            }
            KernelKind::SingleChromatic => "one grid whose extinction differs per channel: channels fly together by delta tracking and part where their events \
                 differ, so that none is weighted; the kernel knows no list of media"
                .to_owned(),
            KernelKind::UnderLaw => "a volume follows a transmittance law that is not exponential: flights and shadow rays know whether they start at one of its \
                 particles, and are one piece from there to their end"
                .to_owned(),
            KernelKind::Overlapping if grey => {
                let phase = if grids == 1 && volumes.len() == 1 {
                    "; the kernel of single grids knows no phase functions but isotropic and Henyey-Greenstein"
                } else {
                    ""
                };
                format!("{} media: collisions are taken in order along the ray{phase}", volumes.len())
            }
            KernelKind::Overlapping => {
                "extinction differs per channel: throughput and transmittance have three channels"
                    .to_owned()
            }
        });
        if wide {
            reasons.push(
                "a grid of more than 8192 voxels along an axis: rays are walked in parts, since single precision does not count so far"
                    .into(),
            );
        }
        let lights = Arc::new(Lights::new(scene, settings.light_sampling));
        let suns = scene.lights.iter().filter(|l| matches!(l, Light::Sun(_))).count();
        let mis = lights.need_mis() || matches!(kernel, KernelKind::Whole | KernelKind::UnderLaw);
        if lights.need_mis() {
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
        if !lights.fires().is_empty() {
            reasons.push(
                "volumes that give off light draw paths to themselves: a share of the directions is drawn by what is seen of them, and light is \
                 collected all along each flight"
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
        let parts = kernel == KernelKind::SingleChromatic;
        if settings.distance == Distance::Split && !parts {
            reasons.push(
                "channels part only in one grid whose extinction differs per channel, without surfaces and light from volumes, under ratio tracking"
                    .into(),
            );
        }
        let by_grid = flakes().any(|flakes| flakes.by_grid());
        let regular = dense && !by_grid;
        let methods = choose(scene, settings, (grey, parts, regular), &mut reasons)?;
        let exact = methods.transmittance == Estimator::Regular
            || methods.distance == DistanceSampler::Regular;
        if exact && by_grid {
            return Err(Error::Invalid {
                what: "`regular` integrates along rays exactly, which flakes by grid do not allow: their projected area is the root of what is interpolated"
                    .into(),
                remedy: "leave sampling.transmittance and sampling.distance to the plan".into(),
            });
        }
        if laws {
            check_laws(scene, settings, methods, &mut reasons)?;
            if by_grid {
                return Err(Error::Invalid {
                    what: "flakes by grid beside a law that is not exponential: it would need exact depths through them".into(),
                    remedy: "give the flakes as numbers, or remove the law".into(),
                });
            }
        }
        let equiangular = !laws && choose_equiangular(scene, settings, &lights, &mut reasons);
        if laws && lights.need_mis() {
            reasons.push("weights leave the way out: a law has no null collisions".into());
        } else if !laws && mis && !methods.weigh_the_way(grey) {
            reasons.push(format!(
                "{} and {} have no common density along a path: weights leave the way out",
                methods.distance.name(),
                methods.transmittance.name()
            ));
        }
        let mut biased = Vec::new();
        if !methods.transmittance.is_unbiased() {
            biased.push(format!(
                "transmittance {}: shadows are too bright",
                methods.transmittance.name()
            ));
        }
        if !methods.distance.is_unbiased() {
            biased.push(format!(
                "distance {}: volumes are too transparent and too smooth",
                methods.distance.name()
            ));
        }
        if let Some(n) = settings.max_bounces {
            biased.push(format!("max_bounces {n}: longer paths are cut"));
        }
        if let Some(most) = settings.clamp {
            biased.push(format!("clamp {most}: brighter samples are darkened"));
        }
        if let Some(line) = warnings::may_cut(scene, settings) {
            biased.push(line);
        }
        let mut not_modelled = scene.not_modelled.clone();
        if let Some(surfaces) = surfaces {
            describe_panes(scene, surfaces, &mut reasons, &mut not_modelled);
        }
        let plan = Plan {
            kernel,
            predicted: None,
            mis,
            distance: if equiangular {
                Distance::Equiangular
            } else if parts {
                Distance::Split
            } else {
                Distance::By(methods.distance)
            },
            transmittance: Transmittance::By(methods.transmittance),
            equiangular,
            // Grey flights of these samplers have weight one.
            analog_flights: grey
                && matches!(
                    methods.distance,
                    DistanceSampler::Delta
                        | DistanceSampler::Spectral
                        | DistanceSampler::Regular
                        | DistanceSampler::Analytic
                        | DistanceSampler::Decomposition
                ),
            methods,
            media: prepare(scene, settings)?,
            lights: PlannedLights(Arc::clone(&lights)),
            expected: None,
            majorant_scale: settings.majorant_scale,
            biased,
            majorants: settings.majorants.name(),
            shadow_ray_lights: lights.count(),
            max_bounces: settings.max_bounces,
            max_events: settings.max_events,
            volumes,
            reasons,
            not_modelled,
            warnings: warnings::all(scene, settings),
        };
        Ok(plan)
    }

    /// Asks pilots what paths cost and what shadow rays may bring.
    fn ask_pilots(&mut self, scene: &Scene, settings: &RenderSettings) {
        let media = || scene.volumes.iter().map(|volume| &*volume.medium);
        if let Some(depth) = warnings::depth_of_a_voxel(media()).filter(|d| *d > MAX_PILOT_DEPTH) {
            self.reasons.push(format!(
                "no paths are traced to predict costs: a voxel has an optical depth of up to {depth:.2e}, and walks would be long"
            ));
            return;
        }
        let grids = media().any(|medium| medium.grid().is_some());
        let of_flakes = media().any(|medium| medium.phase().flakes().is_some());
        let laws = media().any(|medium| medium.transmittance_function().is_some());
        let parts = self.kernel == KernelKind::SingleChromatic;
        let methods = self.methods;
        let tracked = matches!(
            methods.distance,
            DistanceSampler::Delta | DistanceSampler::Spectral | DistanceSampler::WeightedDelta
        );
        // The pilot's flights do not part.
        if grids
            && !of_flakes
            && tracked
            && !parts
            && methods.transmittance == Estimator::Ratio
            && !self.equiangular
            && !laws
        {
            let pilot = Pilot::new(scene, self, settings, PILOT_PATHS);
            let cost = pilot.cost_on(&self.media);
            if cost.steps == 0.0 {
                self.warnings.extend(warnings::met_by_none(scene, PILOT_PATHS));
            }
            self.predicted = Some(PathCost::new(cost.collisions, cost.steps, pilot.collisions()));
        }
        self.choose_shadow_roulette(scene, settings);
    }

    /// Puts what a render counted in the place of what might have happened: which limits did cut
    /// paths.
    pub fn settle(&mut self, counters: &Counters) {
        let Some(n) = self.max_events else { return };
        self.biased.retain(|line| !line.starts_with(warnings::MAX_EVENTS));
        if counters.cut_by_max_events > 0 {
            self.biased.push(format!(
                "{} {n}: {} of {} paths were cut",
                warnings::MAX_EVENTS,
                counters.cut_by_max_events,
                counters.paths
            ));
        }
    }

    /// Asks a second pilot what shadow rays may bring, where that pays.
    fn choose_shadow_roulette(&mut self, scene: &Scene, settings: &RenderSettings) {
        let lights = Arc::clone(&self.lights.0);
        let distant = lights.positions().next().is_none() && !lights.is_empty();
        let possible = distant
            && matches!(
                self.kernel,
                KernelKind::SingleGrey | KernelKind::SingleChromatic | KernelKind::Overlapping
            );
        let asked = settings.shadow_roulette == ShadowRoulette::Expected;
        if !possible || settings.shadow_roulette == ShadowRoulette::Importance {
            if asked {
                self.reasons.push(
                    "shadow rays are played roulette by importance: expectations are for media alone under distant lights"
                        .into(),
                );
            }
            return;
        }
        let by_importance = |scatterings: f64| {
            format!(
                "shadow rays are played roulette by importance: {scatterings:.2} scatterings a path, and expectations pay below {FEW_SCATTERINGS}"
            )
        };
        // Where the first pilot knows the answer, the second is not asked.
        let known = self.predicted.map(|cost| cost.collisions_per_path);
        if let Some(scatterings) = known.filter(|n| !asked && *n >= FEW_SCATTERINGS) {
            self.reasons.push(by_importance(scatterings));
            return;
        }
        let found = Expected::new(scene, &self.media, self.methods, &lights, settings.max_bounces);
        let Some(expected) = found else { return };
        let scatterings = expected.scatterings();
        if asked || scatterings < FEW_SCATTERINGS {
            self.reasons.push(format!(
                "shadow rays are played roulette by what a pilot expects of them: {scatterings:.2} scatterings a path"
            ));
            self.expected = Some(Arc::new(expected));
        } else {
            self.reasons.push(by_importance(scatterings));
        }
    }

    /// Name of the path kernel.
    pub fn kernel_name(&self) -> &'static str {
        match self.kernel {
            KernelKind::Empty => "empty",
            KernelKind::SingleGrey => "single_grey",
            KernelKind::SingleChromatic => "single_chromatic",
            KernelKind::Overlapping => "overlapping",
            KernelKind::Whole => "whole",
            KernelKind::UnderLaw => "under_law",
        }
    }
}

/// Scatterings per path below which shadow rays are played roulette by what a pilot expects of them. Measured: `docs/charts/methods.md`.
const FEW_SCATTERINGS: f64 = 1.5;

/// Mean optical depth of the media below which points seen by point-like lights at equal angles pay for themselves, where the job leaves the
/// choice to the plan. Measured: `docs/charts/methods.md`.
const THIN: f64 = 0.1;

/// Whether rays through a medium are walked in parts.
fn is_wide(medium: &Medium) -> bool {
    medium.grid().is_some_and(GridShape::is_wide)
}

/// Whether the settings allow channels to fly by delta tracking and to part: both walks by tentative collisions of bounds that hold.
fn channels_may_part(settings: &RenderSettings) -> bool {
    let flights =
        matches!(settings.distance, Distance::Auto | Distance::Split | Distance::Equiangular);
    let shadows =
        matches!(settings.transmittance, Transmittance::Auto | Transmittance::By(Estimator::Ratio));
    flights && shadows && settings.majorant_scale >= 1.0
}

/// Whether equiangular points are sampled besides flights.
fn choose_equiangular(
    scene: &Scene,
    settings: &RenderSettings,
    lights: &Lights,
    reasons: &mut Vec<String>,
) -> bool {
    let asked = settings.distance == Distance::Equiangular;
    if lights.positions().next().is_none() || scene.volumes.is_empty() {
        if asked {
            reasons.push(
                "no point or spot light that equiangular points could be aimed at: flights alone"
                    .into(),
            );
        }
        return false;
    }
    if lights.many_positions() && !asked {
        reasons.push(
            "no equiangular points: too many point and spot lights to ask at every flight".into(),
        );
        return false;
    }
    let depth = typical_depth(scene);
    let chosen = asked || settings.distance == Distance::Auto && depth < THIN;
    if chosen {
        reasons.push(format!(
            "points seen by point-like lights at equal angles, weighted against flights by a density that stands for theirs: the media have a mean \
             optical depth of {depth:.2}"
        ));
    } else if settings.distance == Distance::Auto {
        reasons.push(format!(
            "no equiangular points: the media have a mean optical depth of {depth:.2}, and they pay below {THIN}"
        ));
    }
    chosen
}

/// Whether methods can serve the scene's laws, and how they do.
///
/// # Errors
/// If a method that assumes the exponential law was asked for by name, and a volume follows another.
fn check_laws(
    scene: &Scene,
    settings: &RenderSettings,
    methods: Methods,
    reasons: &mut Vec<String>,
) -> Result<(), Error> {
    let refused = |key: &str, name: &str, volume: &str, law: &Law, remedy: &str| Error::Invalid {
        what: format!(
            "sampling.{key} is {name}, which assumes the exponential law, but volume `{volume}` follows another ({law})"
        ),
        remedy: format!("use {remedy}, or `auto`"),
    };
    for volume in &scene.volumes {
        let Some(law) = volume.medium.transmittance_function() else { continue };
        let (name, rates) = (&volume.name, law.is_mixture_of_exponentials());
        let by_rates = rates && volume.medium.grid().is_some();
        let distance_holds = match settings.distance {
            Distance::Auto => true,
            Distance::Equiangular | Distance::Split => false,
            Distance::By(DistanceSampler::Regular | DistanceSampler::Analytic) => true,
            Distance::By(sampler) => rates && sampler.is_unbiased(),
        };
        if !distance_holds {
            return Err(refused("distance", settings.distance.name(), name, law, "`regular`"));
        }
        let transmittance_holds = match settings.transmittance {
            Transmittance::Auto => true,
            Transmittance::By(Estimator::Regular | Estimator::DebiasedRayMarching) => true,
            Transmittance::By(estimator) => rates && estimator.is_unbiased(),
        };
        if !transmittance_holds {
            let name_of = settings.transmittance.name();
            let remedy = "`regular` or `debiased_ray_marching`";
            return Err(refused("transmittance", name_of, name, law, remedy));
        }
        let by_rate = by_rates && methods.distance != DistanceSampler::Regular;
        reasons.push(format!(
            "volume `{name}` follows the law {law}: flights {}, transmittance {}",
            if by_rate {
                "on the extinction times a drawn rate, since the law is a mixture of exponential ones"
            } else {
                "by exact inversion of the depth"
            },
            match methods.transmittance {
                Estimator::DebiasedRayMarching => {
                    format!("by a telescoping series of exponent {}", settings.level_exponent)
                }
                Estimator::Regular => "exact".to_owned(),
                _ if by_rates => "likewise".to_owned(),
                _ => "exact".to_owned(),
            }
        ));
        if volume.emission.is_some() {
            reasons.push(format!(
                "the light that volume `{name}` gives off is taken as uncorrelated with its particles"
            ));
        }
    }
    Ok(())
}

/// The media with their majorants.
fn prepare(scene: &Scene, settings: &RenderSettings) -> Result<PlannedMedia, Error> {
    let (structure, factor) = (settings.majorants, settings.majorant_scale);
    let plain = structure == MajorantStructure::default() && factor == 1.0;
    let media: Vec<Arc<Medium>> = scene
        .volumes
        .iter()
        .map(|volume| {
            if plain {
                return Ok(Arc::clone(&volume.medium));
            }
            volume.medium.with_majorants(structure, factor).map(Arc::new).map_err(|error| {
                Error::Invalid {
                    what: format!("volume `{}`: {error}", volume.name),
                    remedy: "leave sampling.majorants and sampling.majorant_scale to the plan"
                        .into(),
                }
            })
        })
        .collect::<Result<_, Error>>()?;
    let index = Arc::new(MediaIndex::new(&media));
    Ok(PlannedMedia { media, index })
}

/// The methods for flights and shadow rays.
fn choose(
    scene: &Scene,
    settings: &RenderSettings,
    (grey, parts, regular): (bool, bool, bool),
    reasons: &mut Vec<String>,
) -> Result<Methods, Error> {
    let bounded = settings.majorant_scale >= 1.0;
    let distance = match settings.distance {
        Distance::By(sampler) => sampler,
        _ if regular => DistanceSampler::Regular,
        _ if !bounded => DistanceSampler::WeightedDelta,
        _ if grey => DistanceSampler::Delta,
        _ => DistanceSampler::Spectral,
    };
    if distance == DistanceSampler::Spectral && !grey && !parts {
        reasons.push(
            "one flight for all channels on the strongest one's majorant, real or null decided by their throughput-weighted mean"
                .into(),
        );
    }
    if distance == DistanceSampler::Analytic
        && let Some(grid) = scene.volumes.iter().find(|v| v.medium.grid().is_some())
    {
        return Err(Error::Invalid {
            what: format!(
                "sampling.distance is analytic, but volume `{}` is a grid: closed forms need constant extinction",
                grid.name
            ),
            remedy: "use `regular`, which inverts the depth of a grid exactly, or `auto`".into(),
        });
    }
    if !bounded && !distance.is_unbiased_without_bounds() && distance.is_unbiased() {
        return Err(Error::Invalid {
            what: format!(
                "sampling.distance is {}, which needs bounds that hold, but sampling.majorant_scale is {}",
                distance.name(),
                settings.majorant_scale
            ),
            remedy: "use `weighted_delta` or `regular`, or a scale of at least 1".into(),
        });
    }
    let transmittance = match settings.transmittance {
        Transmittance::Auto if regular => Estimator::Regular,
        Transmittance::Auto => {
            reasons.push(
                "transmittance by ratio tracking: of all estimators the least error x time in whole images, within the noise of timing"
                    .into(),
            );
            Estimator::Ratio
        }
        Transmittance::By(estimator) => estimator,
    };
    if !bounded && matches!(transmittance, Estimator::Delta | Estimator::ResidualRatio) {
        return Err(Error::Invalid {
            what: format!(
                "sampling.transmittance is {}, which needs bounds that hold, but sampling.majorant_scale is {}",
                transmittance.name(),
                settings.majorant_scale
            ),
            remedy: "use another estimator, or a scale of at least 1".into(),
        });
    }
    if let Some((depth, name)) = densest(scene, settings).filter(|(depth, _)| *depth > DENSE) {
        reasons.push(format!(
            "volume `{name}` has an optical depth of up to {depth:.1e} per voxel, which tentative collisions would be looked up for one by one: methods that are \
             left to the plan are exact, voxel by voxel"
        ));
        let tracks = !matches!(
            distance,
            DistanceSampler::Regular | DistanceSampler::Analytic | DistanceSampler::RayMarching
        );
        let estimates = !matches!(
            transmittance,
            Estimator::Regular | Estimator::RayMarching | Estimator::DebiasedRayMarching
        );
        if depth > TOO_DENSE && (tracks || estimates) {
            let (key, method) = if tracks {
                ("distance", distance.name())
            } else {
                ("transmittance", transmittance.name())
            };
            return Err(Error::Invalid {
                what: format!(
                    "volume `{name}` has an optical depth of up to {depth:.1e} per voxel, where sampling.{key} {method} would not come to an end"
                ),
                remedy: "use `regular` or `auto`, or lower the density scale (flakes by grid cannot be so dense)"
                    .into(),
            });
        }
    }
    Ok(Methods { distance, transmittance })
}

/// Lights without extent, in words; `None` if there is none that shines.
fn lights_without_extent(scene: &Scene) -> Option<String> {
    let mut counts = [0usize; 3];
    for light in &scene.lights {
        let (kind, strength) = match light {
            Light::Sun(sun) if sun.angular_diameter == 0.0 => (0, sun.irradiance),
            Light::Point(point) => (1, point.intensity),
            Light::Spot(spot) => (2, spot.intensity),
            _ => continue,
        };
        counts[kind] += usize::from(luminance(strength) > 0.0);
    }
    let names =
        [("sun of no size", "suns of no size"), ("point light", "point lights"), ("spot", "spots")];
    let found: Vec<String> = counts
        .into_iter()
        .zip(names)
        .filter(|(count, _)| *count > 0)
        .map(|(count, (one, many))| format!("{count} {}", if count == 1 { one } else { many }))
        .collect();
    (!found.is_empty()).then(|| found.join(", "))
}

/// Says which materials lights without extent shine through, and which not.
fn describe_panes(
    scene: &Scene,
    surfaces: &Surfaces,
    reasons: &mut Vec<String>,
    not_modelled: &mut Vec<String>,
) {
    let Some(lights) = lights_without_extent(scene) else { return };
    let listed = |names: &[String]| {
        let some = names.iter().take(MOST_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        match names.len().saturating_sub(MOST_NAMED) {
            0 => some,
            more => format!("{some} and {more} more"),
        }
    };
    let named = |name: &str| {
        if name.is_empty() { "a material without name".to_owned() } else { format!("`{name}`") }
    };
    let panes: Vec<String> = surfaces.panes().iter().map(|name| named(name)).collect();
    if !panes.is_empty() {
        reasons.push(format!(
            "shadow rays to {lights} go straight through smooth thin walls and bodies of index 1, tinted by them, and these count as no bounces: {}",
            listed(&panes)
        ));
    }
    let (bent, rough): (Vec<_>, Vec<_>) =
        surfaces.obstacles().into_iter().partition(|obstacle| obstacle.bends);
    if !bent.is_empty() {
        let bent: Vec<String> =
            bent.iter().map(|o| format!("{} (index {})", named(&o.name), o.ior)).collect();
        not_modelled.push(format!(
            "light of {lights} through glass that bends it: it does not pass {}, since no path can find a light without extent there; give the sun a \
             size, make the light an emissive mesh, the glass a thin wall, or its index 1",
            listed(&bent)
        ));
    }
    if !rough.is_empty() {
        let rough: Vec<String> = rough
            .iter()
            .map(|o| format!("{} (roughness {})", named(&o.name), o.roughness))
            .collect();
        reasons.push(format!(
            "light of {lights} does not go straight through {}: paths find it from the surface, which scatters it",
            listed(&rough)
        ));
    }
}

/// Most materials that a sentence of the plan names.
const MOST_NAMED: usize = 8;

/// Optical depth per voxel from which on walks by tentative collisions lose to exact ones whatever else there is: they take its root at every edge, and all of it
/// where a cell is empty beside a voxel.
const DENSE: f64 = 16_384.0;

/// That from which on they do not end.
const TOO_DENSE: f64 = 1e7;

/// The largest optical depth per voxel of the majorants, and the volume's name.
fn densest<'a>(scene: &'a Scene, settings: &RenderSettings) -> Option<(f64, &'a str)> {
    let depth = |volume: &'a pileus_scene::Volume| {
        Some((volume.medium.grid()?.majorant_depth_per_voxel(), volume.name.as_str()))
    };
    let densest = scene.volumes.iter().filter_map(depth).max_by(|a, b| a.0.total_cmp(&b.0));
    densest.map(|(depth, name)| (depth * f64::from(settings.majorant_scale.max(1.0)), name))
}

fn describe(name: &str, medium: &Medium) -> PlannedVolume {
    let phase = medium.phase().to_string();
    let color = |c: [f32; 3]| {
        if c[0] == c[1] && c[1] == c[2] { c[0].to_string() } else { format!("{c:?}") }
    };
    let report = medium.grid().map(|grid| grid.voxels().report());
    PlannedVolume {
        name: name.to_owned(),
        kind: if report.is_some() { "grid" } else { "homogeneous" },
        grey: medium.is_grey(),
        sigma_t_max: medium.largest_sigma_t(),
        voxels: report.map(|report| if report.stored_as_half { "binary16" } else { "binary32" }),
        bytes: report.map_or(0, |r| r.bytes_voxels + r.bytes_bounds + r.bytes_index),
        law: medium.transmittance_function().map(ToString::to_string),
        phase,
        albedo: match medium.optics().albedo() {
            Albedo::Constant(albedo) => color(*albedo),
            Albedo::Grid(_) => "grid".to_owned(),
        },
    }
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "kernel         {}", self.kernel_name())?;
        writeln!(f, "distance       {}", self.distance.name())?;
        writeln!(f, "transmittance  {}", self.transmittance.name())?;
        writeln!(f, "majorants      {}", self.majorants)?;
        if self.majorant_scale != 1.0 {
            writeln!(f, "               times {}", self.majorant_scale)?;
        }
        if let Some(cost) = self.predicted {
            writeln!(f, "expected       {cost}")?;
        }
        writeln!(
            f,
            "shadow rays    to {} lights{}",
            self.shadow_ray_lights,
            if self.mis { ", weighted" } else { "" }
        )?;
        match self.max_bounces {
            Some(n) => writeln!(f, "bounces        at most {n}")?,
            None => writeln!(f, "bounces        unlimited")?,
        }
        match self.max_events {
            Some(n) => writeln!(f, "events         at most {n} a path")?,
            None => writeln!(f, "events         unlimited")?,
        }
        for volume in &self.volumes {
            writeln!(
                f,
                "volume         {}: {}{}, sigma_t up to {:.4}{}, phase {}, albedo {}{}",
                volume.name,
                volume.kind,
                if volume.grey { "" } else { " per channel" },
                volume.sigma_t_max,
                volume.law.as_ref().map_or(String::new(), |law| format!(", law {law}")),
                volume.phase,
                volume.albedo,
                volume.voxels.map_or(String::new(), |v| format!(
                    ", {v} voxels, {:.1} MB",
                    volume.bytes as f64 / 1e6
                )),
            )?;
        }
        for item in &self.biased {
            writeln!(f, "biased         {item}")?;
        }
        for reason in &self.reasons {
            writeln!(f, "because        {reason}")?;
        }
        for item in &self.not_modelled {
            writeln!(f, "not modelled   {item}")?;
        }
        for item in &self.warnings {
            writeln!(f, "warning        {item}")?;
        }
        Ok(())
    }
}
