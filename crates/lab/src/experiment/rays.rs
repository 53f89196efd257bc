//! Rays of an asset, by what makes them hard.

use glam::{DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_media::random::uniform;
use pileus_media::{Medium, PhaseAt, RayField, Tally, optical_depth};
use rand_pcg::Pcg32;

/// What a ray is like for estimators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RayClass {
    /// Optical depth below 0.5.
    Thin,
    /// Optical depth from 0.5 to 3.
    Medium,
    /// Optical depth from 3 to 15; beyond, nothing is seen.
    Thick,
    /// The largest extinction on the way is more than 10 times the mean.
    Spiky,
    /// The majorants' optical depth is more than 4 times the field's.
    FarMajorant,
}

impl RayClass {
    /// All of them.
    pub const ALL: [RayClass; 5] =
        [RayClass::Thin, RayClass::Medium, RayClass::Thick, RayClass::Spiky, RayClass::FarMajorant];

    /// Name of the class, as tables have it.
    pub const fn name(self) -> &'static str {
        match self {
            RayClass::Thin => "thin",
            RayClass::Medium => "medium",
            RayClass::Thick => "thick",
            RayClass::Spiky => "spiky",
            RayClass::FarMajorant => "far-majorant",
        }
    }
}

/// A ray with its exact optical depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabRay {
    /// Origin, world.
    pub origin: DVec3,
    /// Direction, a unit vector.
    pub direction: Vec3,
    /// Optical depth to infinity.
    pub optical_depth: f64,
    /// Class of the ray: the first of spiky, far-majorant and the depth's that fits.
    pub class: RayClass,
}

/// Candidates that are looked at before a class is left with what was found.
const CANDIDATES: u32 = 40_000;

/// Shadow rays of a medium: from points where it is dense, in random directions, up to `per_class`
/// of each class. Some assets have no ray of a class, or few.
pub fn classed_rays(medium: &Medium, per_class: usize, seed: u64) -> Vec<LabRay> {
    let Some(Bounds3 { low, high }) = medium.bounds_world() else {
        return Vec::new();
    };
    let mut rng = Pcg32::new(seed, 77);
    let mut rays: Vec<LabRay> = Vec::new();
    for _ in 0..CANDIDATES {
        let mut u = || f64::from(uniform(&mut rng));
        let origin = low + (high - low) * DVec3::new(u(), u(), u());
        let direction =
            PhaseAt::Isotropic.sample(Vec3::Z, [uniform(&mut rng), uniform(&mut rng)]).0;
        if medium.sigma_t_at(origin) <= 0.0 {
            continue;
        }
        let Some(class) = classify(medium, origin, direction) else {
            continue;
        };
        let (ray, found) = class;
        if rays.iter().filter(|r| r.class == found).count() < per_class {
            rays.push(ray);
        }
        if rays.len() == per_class * RayClass::ALL.len() {
            break;
        }
    }
    rays.sort_by_key(|ray| RayClass::ALL.iter().position(|class| *class == ray.class));
    rays
}

fn classify(medium: &Medium, origin: DVec3, direction: Vec3) -> Option<(LabRay, RayClass)> {
    let span = medium.span(origin, direction, f64::INFINITY)?;
    let mut tally = Tally::default();
    let tau = optical_depth(medium, origin, direction.as_dvec3(), 0.0, 1e30, &mut tally);
    if !(tau > 1e-6 && tau < 15.0) {
        return None;
    }
    let mut field = medium.any_ray(&span, 1.0);
    let (mut bound, mut length, mut peak) = (0.0f64, 0.0f64, 0.0f64);
    while let Some(segment) = field.next_segment() {
        let part = f64::from(segment.t1 - segment.t0);
        bound += part * f64::from(segment.majorant);
        length += part;
        for k in 0..4 {
            let t = segment.t0 + (segment.t1 - segment.t0) * (k as f32 + 0.5) / 4.0;
            peak = peak.max(f64::from(field.sigma_t(t)));
        }
    }
    let class = if peak * length > 10.0 * tau {
        RayClass::Spiky
    } else if bound > 4.0 * tau {
        RayClass::FarMajorant
    } else if tau < 0.5 {
        RayClass::Thin
    } else if tau < 3.0 {
        RayClass::Medium
    } else {
        RayClass::Thick
    };
    Some((LabRay { origin, direction, optical_depth: tau, class }, class))
}
