//! Equiangular sampling [Kulla and Fajardo 2012]: points on a ray in proportion to the inverse
//! square of the distance to a light.

use glam::{DVec3, Vec3};

/// Smallest distance of a light from the ray's line, relative to its distance along it: keeps the
/// angle away from a step.
const CLOSEST: f64 = 1e-7;

/// Points on a part of a ray, uniform in the angle at which a light sees them.
#[derive(Debug, Clone, Copy)]
pub struct Equiangular {
    /// Ray parameter nearest to the light.
    foot: f64,
    /// Distance there.
    distance: f64,
    low: f64,
    high: f64,
    range: (f64, f64),
}

impl Equiangular {
    /// For the part `t0..t1` of the ray `origin + t direction` (`direction` a unit vector, `t1` may
    /// be infinite) and a light at `light`.
    ///
    /// `None` if the part is empty.
    pub fn new(
        origin: DVec3,
        direction: Vec3,
        light: DVec3,
        (t0, t1): (f64, f64),
    ) -> Option<Equiangular> {
        let d = direction.as_dvec3();
        let to = light - origin;
        let foot = to.dot(d);
        let distance = (to - d * foot).length().max(CLOSEST * to.length()).max(f64::MIN_POSITIVE);
        let (low, high) = (libm::atan((t0 - foot) / distance), libm::atan((t1 - foot) / distance));
        (high > low).then_some(Equiangular { foot, distance, low, high, range: (t0, t1) })
    }

    /// The ray parameter of the point that `u` in [0, 1) draws.
    pub fn sample(&self, u: f32) -> f64 {
        let angle = self.low + f64::from(u) * (self.high - self.low);
        (self.foot + self.distance * libm::tan(angle)).clamp(self.range.0, self.range.1)
    }

    /// Density of [`sample`](Equiangular::sample), 1/length; zero outside the part.
    pub fn pdf(&self, t: f64) -> f64 {
        if !(t >= self.range.0 && t <= self.range.1) {
            return 0.0;
        }
        let from_foot = t - self.foot;
        let squared = self.distance * self.distance + from_foot * from_foot;
        self.distance / ((self.high - self.low) * squared)
    }

    /// Integral of the inverse squared distance to the light over the part, 1/length: what the
    /// light can send there.
    pub fn received(&self) -> f64 {
        (self.high - self.low) / self.distance
    }
}
