//! Which methods a plan takes for flights and shadow rays, and whether they can serve a scene.

use super::axes::Channels;
use super::media::{DENSE, TOO_DENSE, densest, depth_of};
use super::thickness::typical_depth;
use crate::error::{Error, Parameter, Remedy};
use crate::lights::Lights;
use crate::media::{Methods, flies_by_depth};
use crate::settings::RenderSettings;
use pileus_media::distance::DistanceSampler;
use pileus_media::method::{Transmittances, Work};
use pileus_media::transmittance::Estimator;
use pileus_scene::{Scene, Volume};

/// Mean optical depth of the media below which points seen by point-like lights at equal angles pay
/// for themselves, where the job leaves the choice to the plan. Measured: `docs/charts/methods.md`.
const MAX_EQUIANGULAR_DEPTH: f64 = 0.1;

/// Whether the settings allow channels to fly by delta tracking and to decouple: both walks by
/// tentative collisions of bounds that hold.
pub(super) fn channels_may_decouple(settings: &RenderSettings) -> bool {
    let flights = settings.distance.is_none_or(|sampler| !sampler.is_one_flight());
    let shadows = matches!(settings.transmittance, None | Some(Estimator::Ratio));
    flights && shadows && settings.majorant_scale >= 1.0
}

/// Whether equiangular points are sampled besides flights.
pub(super) fn choose_equiangular(
    scene: &Scene,
    settings: &RenderSettings,
    lights: &Lights,
    reasons: &mut Vec<String>,
) -> bool {
    let asked = settings.distance == Some(DistanceSampler::Equiangular);
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
    let chosen = asked || settings.distance.is_none() && depth < MAX_EQUIANGULAR_DEPTH;
    if chosen {
        reasons.push(format!(
            "points seen by point-like lights at equal angles, weighted against flights by a density that stands for theirs: the media have a mean \
             optical depth of {depth:.2}"
        ));
    } else if settings.distance.is_none() {
        reasons.push(format!(
            "no equiangular points: the media have a mean optical depth of {depth:.2}, and they pay below {MAX_EQUIANGULAR_DEPTH}"
        ));
    }
    chosen
}

/// Whether methods can serve the scene's transmittance functions, and how they do.
///
/// # Errors
/// If a method that assumes the exponential transmittance was asked for by name, and a volume
/// follows another.
pub(super) fn check_transmittance_functions(
    scene: &Scene,
    settings: &RenderSettings,
    methods: Methods,
    reasons: &mut Vec<String>,
) -> Result<(), Error> {
    for volume in &scene.volumes {
        let Some(function) = volume.medium.transmittance_function() else { continue };
        let (name, rates) = (&volume.name, function.is_mixture_of_exponentials());
        if !rates && volume.medium.phase().microflakes().is_some_and(|flakes| flakes.by_grid()) {
            return Err(Error::Scene {
                what: format!(
                    "volume `{name}` has microflakes by grid and a transmittance function ({function}) that would need exact depths through them"
                ),
                remedies: vec![Remedy::Scene(
                    "give the microflakes as numbers, or the volume a mixture of exponentials",
                )],
            });
        }
        let by_rates = rates && volume.medium.grid().is_some();
        let holds = |transmittances| match transmittances {
            Transmittances::All => true,
            Transmittances::Mixtures => rates,
            Transmittances::Exponential => false,
        };
        let refused = |parameter, method: &str, instead: &[&'static str]| Error::Parameter {
            parameter,
            value: method.to_owned(),
            why: format!(
                "it assumes the exponential transmittance, but volume `{name}` has another ({function})"
            ),
            remedies: instead
                .iter()
                .map(|method| Remedy::Set(parameter, method))
                .chain([Remedy::Default(match parameter {
                    Parameter::Distance => &[Parameter::Distance],
                    _ => &[Parameter::Transmittance],
                })])
                .collect(),
        };
        if let Some(sampler) = settings.distance.filter(|s| !holds(s.facts().transmittances)) {
            return Err(refused(Parameter::Distance, sampler.name(), &["regular"]));
        }
        if let Some(estimator) = settings.transmittance.filter(|e| !holds(e.facts().transmittances))
        {
            let instead = ["regular", "debiased_ray_marching"];
            return Err(refused(Parameter::Transmittance, estimator.name(), &instead));
        }
        let by_rate = by_rates && methods.distance != DistanceSampler::Regular;
        reasons.push(format!(
            "volume `{name}` has the transmittance function {function}: flights {}, transmittance {}",
            if by_rate {
                "on the extinction times a drawn rate, since it is a mixture of exponentials"
            } else {
                "by exact inversion of the depth"
            },
            match methods.transmittance {
                Estimator::DebiasedRayMarching => {
                    format!("by a debiasing series of exponent {}", settings.continuation_exponent)
                }
                Estimator::Regular => "exact".to_owned(),
                _ if by_rates => "likewise".to_owned(),
                _ => "exact".to_owned(),
            }
        ));
        if volume.emission.is_some() {
            reasons.push(format!(
                "the light that volume `{name}` emits is taken as uncorrelated with its particles"
            ));
        }
    }
    Ok(())
}

/// The methods for flights and shadow rays.
pub(super) fn choose(
    scene: &Scene,
    settings: &RenderSettings,
    (grey, dense): (bool, bool),
    reasons: &mut Vec<String>,
) -> Result<Methods, Error> {
    let regular = dense;
    let bounded = settings.majorant_scale >= 1.0;
    let distance = match settings.distance {
        Some(sampler) if sampler.is_one_flight() => sampler,
        _ if regular => DistanceSampler::Regular,
        _ if !bounded => DistanceSampler::WeightedDelta,
        _ if grey => DistanceSampler::Delta,
        _ => DistanceSampler::Spectral,
    };
    if distance == DistanceSampler::Analytic
        && let Some(grid) = scene.volumes.iter().find(|v| v.medium.grid().is_some())
    {
        return Err(Error::Parameter {
            parameter: Parameter::Distance,
            value: "analytic".into(),
            why: format!(
                "volume `{}` is a grid, and closed forms need constant extinction; `regular` inverts the depth of a grid exactly",
                grid.name
            ),
            remedies: vec![
                Remedy::Set(Parameter::Distance, "regular"),
                Remedy::Default(&[Parameter::Distance]),
            ],
        });
    }
    let unbounded = |parameter, method: &str, instead: &[&'static str]| Error::Parameter {
        parameter,
        value: method.to_owned(),
        why: format!(
            "it needs bounds that hold, but {} is {}",
            Parameter::MajorantScale,
            settings.majorant_scale
        ),
        remedies: instead
            .iter()
            .map(|method| Remedy::Set(parameter, method))
            .chain([Remedy::Default(&[Parameter::MajorantScale])])
            .collect(),
    };
    if !bounded && distance.facts().needs_bounds {
        let instead = ["weighted_delta", "regular"];
        return Err(unbounded(Parameter::Distance, distance.name(), &instead));
    }
    let transmittance = match settings.transmittance {
        None if regular => Estimator::Regular,
        None => {
            reasons.push(
                "transmittance by ratio tracking: of all estimators the least error x time in whole images, within the noise of timing"
                    .into(),
            );
            Estimator::Ratio
        }
        Some(estimator) => estimator,
    };
    if !bounded && transmittance.facts().needs_bounds {
        return Err(unbounded(Parameter::Transmittance, transmittance.name(), &["ratio"]));
    }
    if let Some((depth, name)) = densest(scene, settings).filter(|(depth, _)| *depth > DENSE) {
        reasons.push(format!(
            "volume `{name}` has an optical depth of up to {depth:.1e} per voxel, which tentative collisions would be looked up for one by one: methods that are \
             left to the plan are exact, voxel by voxel"
        ));
        let by_grid = microflakes_by_grid(scene).filter(|v| depth_of(v, settings) > TOO_DENSE);
        if let Some(volume) = by_grid.last() {
            return Err(Error::Scene {
                what: format!(
                    "volume `{}` has an optical depth of up to {:.1e} per voxel, where walks would not come to an end, and microflakes by grid have no exact depths",
                    volume.name,
                    depth_of(volume, settings)
                ),
                remedies: vec![Remedy::Scene(
                    "lower the volume's density, or give the microflakes as numbers",
                )],
            });
        }
        let endless = |work| depth > TOO_DENSE && work == Work::MajorantDepth;
        let method = if endless(distance.facts().work) {
            Some((Parameter::Distance, distance.name()))
        } else if endless(transmittance.facts().work) {
            Some((Parameter::Transmittance, transmittance.name()))
        } else {
            None
        };
        if let Some((parameter, method)) = method {
            return Err(Error::Parameter {
                parameter,
                value: method.to_owned(),
                why: format!(
                    "it would not come to an end in volume `{name}`, which has an optical depth of up to {depth:.1e} per voxel"
                ),
                remedies: vec![
                    Remedy::Set(parameter, "regular"),
                    Remedy::Default(match parameter {
                        Parameter::Distance => &[Parameter::Distance],
                        _ => &[Parameter::Transmittance],
                    }),
                    Remedy::Scene("lower the volume's density"),
                ],
            });
        }
    }
    let exact = matches!(distance, DistanceSampler::Regular | DistanceSampler::Analytic)
        || transmittance == Estimator::Regular;
    if exact && let Some(volume) = microflakes_by_grid(scene).next() {
        reasons.push(format!(
            "volume `{}` has microflakes by grid, whose projected area is the root of what is interpolated: it is walked by tentative collisions, exact methods \
             hold for the rest",
            volume.name
        ));
    }
    Ok(Methods { distance, transmittance })
}

/// Volumes whose microflakes differ from place to place.
fn microflakes_by_grid(scene: &Scene) -> impl Iterator<Item = &Volume> {
    let by_grid = |volume: &&Volume| {
        volume.medium.phase().microflakes().is_some_and(|flakes| flakes.by_grid())
    };
    scene.volumes.iter().filter(by_grid)
}

/// Whether flights end with the density of the media and carry no weight.
pub(super) fn are_analog(scene: &Scene, channels: Channels, methods: Methods) -> bool {
    match channels {
        Channels::Grey => matches!(
            methods.distance,
            DistanceSampler::Delta
                | DistanceSampler::Spectral
                | DistanceSampler::Regular
                | DistanceSampler::Analytic
                | DistanceSampler::Decomposition
        ),
        // Each channel by itself is delta tracking, but in media that fly by closed forms.
        Channels::Split => weighted_beside_split(scene).next().is_none(),
        Channels::Spectral => false,
    }
}

/// Volumes whose channels differ and whose flights are closed forms of their own, or may be: these
/// weight channels also where others decouple.
pub(super) fn weighted_beside_split(scene: &Scene) -> impl Iterator<Item = &Volume> {
    let weighted = |v: &&Volume| !v.medium.is_grey() && flies_by_depth(&v.medium);
    scene.volumes.iter().filter(weighted)
}
