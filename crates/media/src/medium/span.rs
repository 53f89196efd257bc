//! Where a ray meets a medium.

use crate::majorant::Line;
use glam::Vec3;

/// The part of a ray that may meet a medium's extinction.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// World distance from the ray's origin to the start of the span.
    pub t_enter: f64,
    /// Length of the span in world units; infinite only in media that fill all space.
    pub length: f32,
    /// The ray's direction in the world.
    pub(crate) direction: Vec3,
    /// The span in the local coordinates of a grid, without rounding; in the world for homogeneous
    /// media.
    pub(crate) line: Line,
}

impl Span {
    /// The part before a world distance from the ray's origin; `None` if it begins behind.
    #[inline]
    pub fn before(self, t_max: f64) -> Option<Span> {
        let length = (t_max - self.t_enter).min(self.line.length);
        let line = Line { length, ..self.line };
        (length > 0.0).then_some(Span { length: length as f32, line, ..self })
    }

    /// World distance from the ray's origin to the end of the span.
    #[inline(always)]
    pub fn t_exit(&self) -> f64 {
        self.t_enter + self.line.length
    }

    /// The span in world distances from the ray's origin.
    #[inline(always)]
    pub fn extent(&self) -> (f64, f64) {
        (self.t_enter, self.t_exit())
    }
}
