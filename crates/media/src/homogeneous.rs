//! The same extinction everywhere in a box, or in all space.

use crate::Error;
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::flakes::Flakes;
use crate::law::Law;
use crate::medium::{check_albedo, strongest_and_relative};
use crate::phase::Phase;
use crate::tally::Tally;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// A homogeneous medium.
#[derive(Debug, Clone)]
pub struct HomogeneousMedium {
    scale: f32,
    relative: Vec3,
    bounds: Option<(DVec3, DVec3)>,
    albedo: Vec3,
    phase: Phase,
    law: Option<Arc<Law>>,
}

impl HomogeneousMedium {
    /// Extinction `sigma_t` per channel, 1/length, inside the axis-aligned world box `bounds` (`None`: everywhere).
    ///
    /// # Errors
    /// If an extinction is negative or not finite, the box is empty or not finite, or the phase function comes from a grid.
    pub fn new(
        sigma_t: [f32; 3],
        bounds: Option<(DVec3, DVec3)>,
        albedo: [f32; 3],
        phase: Phase,
    ) -> Result<HomogeneousMedium, Error> {
        if !sigma_t.iter().all(|s| (0.0..1e30).contains(s)) {
            return Err(Error::invalid(
                format!("extinction {sigma_t:?} is negative or out of range"),
                "give numbers of at least 0",
            ));
        }
        check_albedo(&albedo)?;
        if matches!(phase, Phase::ByGrid(_)) || phase.flakes().is_some_and(Flakes::by_grid) {
            return Err(Error::invalid(
                "a homogeneous medium has no grid for its phase function",
                "give numbers instead of grids",
            ));
        }
        if let Some((low, high)) = bounds
            && !(low.is_finite() && high.is_finite() && low.cmplt(high).all())
        {
            return Err(Error::invalid(
                format!("the box {low} to {high} is empty or not finite"),
                "give the smaller corner first, or null to fill space",
            ));
        }
        let (scale, relative) = strongest_and_relative(sigma_t);
        Ok(HomogeneousMedium {
            scale,
            relative,
            bounds,
            albedo: Vec3::from_array(albedo),
            phase,
            law: None,
        })
    }

    /// The same medium under a transmittance law; `None` is the exponential one.
    pub fn with_law(self, law: Option<Arc<Law>>) -> HomogeneousMedium {
        HomogeneousMedium { law, ..self }
    }

    /// The transmittance law; `None` is the exponential one.
    pub fn law(&self) -> Option<&Law> {
        self.law.as_deref()
    }

    /// Extinction of the strongest channel, 1/length.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Extinction per channel relative to the strongest.
    pub fn relative_extinction(&self) -> Vec3 {
        self.relative
    }

    /// Whether all channels have the same extinction.
    pub fn is_grey(&self) -> bool {
        self.relative == Vec3::ONE
    }

    /// The albedo per channel.
    pub fn albedo(&self) -> Vec3 {
        self.albedo
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// The box, `None` if the medium fills all space.
    pub fn bounds_world(&self) -> Option<(DVec3, DVec3)> {
        self.bounds
    }

    /// Extinction of the strongest channel at a point in the world, 1/length.
    pub fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        let inside =
            |(low, high): (DVec3, DVec3)| low.cmple(p_world).all() && high.cmpge(p_world).all();
        if self.bounds.is_none_or(inside) { f64::from(self.scale) } else { 0.0 }
    }

    /// Where the ray `origin + t direction`, t in [0, t_max], is inside: start and length (infinite in all space).
    pub fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<(f64, f32)> {
        let (mut t0, mut t1) = (0.0f64, t_max);
        if let Some((low, high)) = self.bounds {
            for axis in 0..3 {
                let d = f64::from(direction[axis]);
                if d == 0.0 {
                    if origin[axis] < low[axis] || origin[axis] > high[axis] {
                        return None;
                    }
                    continue;
                }
                let (a, b) = ((low[axis] - origin[axis]) / d, (high[axis] - origin[axis]) / d);
                t0 = t0.max(a.min(b));
                t1 = t1.min(a.max(b));
            }
        }
        (t0 < t1).then_some((t0, (t1 - t0) as f32))
    }

    /// The ray field of a span of this length.
    #[inline(always)]
    pub fn ray(&self, length: f32) -> HomogeneousRay {
        HomogeneousRay { sigma_t: self.scale, length, done: !(self.scale > 0.0) }
    }
}

/// One segment of constant extinction.
#[derive(Debug, Clone)]
pub struct HomogeneousRay {
    sigma_t: f32,
    length: f32,
    done: bool,
}

impl RayField for HomogeneousRay {
    #[inline(always)]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        if self.done {
            return None;
        }
        self.done = true;
        Some(MajorantSegment { t0: 0.0, t1: self.length, majorant: self.sigma_t })
    }

    fn minorant(&self) -> f32 {
        self.sigma_t
    }

    #[inline(always)]
    fn sigma_t(&self, _t: f32) -> f32 {
        self.sigma_t
    }

    #[inline(always)]
    fn sigma_t_anywhere(&self, _t: f32) -> f32 {
        self.sigma_t
    }

    fn steps(&self) -> u64 {
        u64::from(self.done)
    }
}

impl ExactField for HomogeneousRay {
    fn optical_depth(&self, _: &mut Tally) -> f64 {
        // No extinction in all space: zero, not zero times infinity.
        if self.sigma_t > 0.0 { f64::from(self.sigma_t) * f64::from(self.length) } else { 0.0 }
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let whole = self.optical_depth(tally);
        if depth <= whole && self.sigma_t > 0.0 {
            Ok((depth / f64::from(self.sigma_t)) as f32)
        } else {
            Err(whole)
        }
    }
}
