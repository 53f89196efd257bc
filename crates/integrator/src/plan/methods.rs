//! Which methods a plan takes for flights and shadow rays, and whether they can serve a scene.

use super::axes::Channels;
use super::media::{DENSE, TOO_DENSE, densest, depth_of};
use super::thickness::typical_depth;
use crate::Error;
use crate::lights::Lights;
use crate::media::{Methods, flies_by_depth};
use crate::settings::{Distance, RenderSettings, Transmittance};
use pileus_media::Medium;
use pileus_media::distance::DistanceSampler;
use pileus_media::law::Law;
use pileus_media::transmittance::Estimator;
use pileus_scene::{Scene, Volume};

/// Mean optical depth of the media below which points seen by point-like lights at equal angles pay for themselves, where the job leaves the
/// choice to the plan. Measured: `docs/charts/methods.md`.
const MAX_EQUIANGULAR_DEPTH: f64 = 0.1;

/// Whether the settings allow channels to fly by delta tracking and to decouple: both walks by tentative collisions of bounds that hold.
pub(super) fn channels_may_decouple(settings: &RenderSettings) -> bool {
    let flights =
        matches!(settings.distance, Distance::Auto | Distance::Split | Distance::Equiangular);
    let shadows =
        matches!(settings.transmittance, Transmittance::Auto | Transmittance::By(Estimator::Ratio));
    flights && shadows && settings.majorant_scale >= 1.0
}

/// Whether equiangular points are sampled besides flights.
pub(super) fn choose_equiangular(
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
    let chosen = asked || settings.distance == Distance::Auto && depth < MAX_EQUIANGULAR_DEPTH;
    if chosen {
        reasons.push(format!(
            "points seen by point-like lights at equal angles, weighted against flights by a density that stands for theirs: the media have a mean \
             optical depth of {depth:.2}"
        ));
    } else if settings.distance == Distance::Auto {
        reasons.push(format!(
            "no equiangular points: the media have a mean optical depth of {depth:.2}, and they pay below {MAX_EQUIANGULAR_DEPTH}"
        ));
    }
    chosen
}

/// Whether methods can serve the scene's laws, and how they do.
///
/// # Errors
/// If a method that assumes the exponential law was asked for by name, and a volume follows another.
pub(super) fn check_laws(
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
        let Some(law) = volume.medium.law() else { continue };
        let (name, rates) = (&volume.name, law.is_mixture_of_exponentials());
        if !rates && volume.medium.phase().flakes().is_some_and(|flakes| flakes.by_grid()) {
            return Err(Error::Invalid {
                what: format!(
                    "volume `{name}` has microflakes by grid and a transmittance function ({law}) that would need exact depths through them"
                ),
                remedy: "give the microflakes as numbers, or a mixture of exponentials".into(),
            });
        }
        let by_rates = rates && matches!(*volume.medium, Medium::Grid(_));
        let distance_holds = match settings.distance {
            Distance::Auto => true,
            Distance::Split => true,
            Distance::Equiangular => false,
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
        Distance::By(sampler) => sampler,
        _ if regular => DistanceSampler::Regular,
        _ if !bounded => DistanceSampler::WeightedDelta,
        _ if grey => DistanceSampler::Delta,
        _ => DistanceSampler::Spectral,
    };
    if distance == DistanceSampler::Analytic
        && let Some(grid) = scene.volumes.iter().find(|v| matches!(*v.medium, Medium::Grid(_)))
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
        let by_grid = microflakes_by_grid(scene).filter(|v| depth_of(v, settings) > TOO_DENSE);
        if let Some(volume) = by_grid.last() {
            return Err(Error::Invalid {
                what: format!(
                    "volume `{}` has an optical depth of up to {:.1e} per voxel, where walks would not come to an end, and microflakes by grid have no exact depths",
                    volume.name,
                    depth_of(volume, settings)
                ),
                remedy: "lower the density scale, or give the microflakes as numbers".into(),
            });
        }
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
                remedy: "use `regular` or `auto`, or lower the density scale".into(),
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
    let by_grid =
        |volume: &&Volume| volume.medium.phase().flakes().is_some_and(|flakes| flakes.by_grid());
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
        Channels::Split => scene
            .volumes
            .iter()
            .all(|volume| volume.medium.is_grey() || !flies_by_depth(&volume.medium)),
        Channels::Spectral => false,
    }
}
