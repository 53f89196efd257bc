//! Scattering angles that lose no digits at either peak.

use glam::Vec3;

/// A scattering angle as `1 - cos` and `1 + cos`, both in [0, 2]: what forward and backward peaks
/// are functions of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cosine {
    /// `1 - cos`: 0 is forward.
    pub(crate) one_minus: f32,
    /// `1 + cos`: 0 is backward.
    pub(crate) one_plus: f32,
}

impl Cosine {
    /// Between the propagation directions before and after (unit vectors): half the squared length
    /// of their difference and of their sum.
    #[inline(always)]
    pub(crate) fn between(incoming: Vec3, wi: Vec3) -> Cosine {
        Cosine {
            one_minus: (0.5 * (wi - incoming).length_squared()).min(2.0),
            one_plus: (0.5 * (wi + incoming).length_squared()).min(2.0),
        }
    }

    /// From `1 - cos`, clamped to [0, 2].
    pub(crate) fn from_one_minus(x: f64) -> Cosine {
        let x = x.clamp(0.0, 2.0);
        Cosine { one_minus: x as f32, one_plus: (2.0 - x) as f32 }
    }

    /// The cosine.
    #[inline(always)]
    pub(crate) fn value(self) -> f32 {
        0.5 * (self.one_plus - self.one_minus)
    }

    /// The sine, at least 0.
    #[inline(always)]
    pub(crate) fn sine(self) -> f32 {
        (self.one_minus * self.one_plus).sqrt()
    }

    /// Seen from the other side: forward and backward change places.
    #[inline(always)]
    pub(crate) fn mirrored(self) -> Cosine {
        Cosine { one_minus: self.one_plus, one_plus: self.one_minus }
    }
}
