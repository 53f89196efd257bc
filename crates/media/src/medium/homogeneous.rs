//! Constant extinction in a box, or in all space.

use super::Span;
use crate::Error;
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::majorant::Line;
use crate::tally::Tally;
use glam::{DVec3, Vec3};
use pileus_math::Bounds3;

/// Constant extinction in an axis-aligned box of the world, or in all space.
#[derive(Debug, Clone)]
pub struct BoxShape {
    sigma_t: f32,
    bounds: Option<Bounds3>,
}

impl BoxShape {
    /// # Errors
    /// If the extinction is out of range, or the box is empty or not finite.
    pub(super) fn new(sigma_t: f32, bounds: Option<Bounds3>) -> Result<BoxShape, Error> {
        if !(0.0..1e30).contains(&sigma_t) {
            return Err(Error::invalid(
                format!("the extinction {sigma_t} is out of range"),
                "give numbers from 0 to 1e30",
            ));
        }
        if let Some(Bounds3 { low, high }) = bounds
            && !(low.is_finite() && high.is_finite() && low.cmplt(high).all())
        {
            return Err(Error::invalid(
                format!("the box {low} to {high} is empty or not finite"),
                "give the smaller corner first, or null to fill space",
            ));
        }
        Ok(BoxShape { sigma_t, bounds })
    }

    /// Extinction of the strongest channel inside, 1/length.
    #[inline(always)]
    pub fn sigma_t(&self) -> f32 {
        self.sigma_t
    }

    /// The box, `None` if the medium fills all space.
    #[inline(always)]
    pub fn bounds_world(&self) -> Option<Bounds3> {
        self.bounds
    }

    pub(super) fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        if self.bounds.is_none_or(|bounds| bounds.contains(p_world)) {
            f64::from(self.sigma_t)
        } else {
            0.0
        }
    }

    /// Where the ray `origin + t direction`, t in [t_min, t_max], is inside.
    pub(crate) fn clip(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, f64)> {
        match self.bounds {
            Some(bounds) => bounds.clip(origin, direction, t_min, t_max),
            None => (t_min < t_max).then_some((t_min, t_max)),
        }
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], that is inside; it may end at
    /// infinity in all space. `direction` is a unit vector.
    pub fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        let d = direction.as_dvec3();
        let (t0, t1) = self.clip(origin, d, 0.0, t_max)?;
        let length = (t1 - t0) as f32;
        // As long as the field that is walked, which is rounded.
        let line = Line { p: origin + d * t0, d, length: f64::from(length) };
        Some(Span { t_enter: t0, length, direction, line })
    }

    /// The extinction along a span, times `factor`, which is positive and may exceed one.
    #[inline(always)]
    pub(super) fn ray(&self, span: &Span, factor: f32) -> HomogeneousRay {
        let sigma_t = factor * self.sigma_t;
        HomogeneousRay { sigma_t, length: span.length, done: !(sigma_t > 0.0) }
    }
}

/// One segment of constant extinction.
#[derive(Debug, Clone)]
pub(crate) struct HomogeneousRay {
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
