//! Quantities per channel: one or three of them behind one interface, so that an estimator is
//! written once and grey media pay for one channel.

use crate::elementary::exp;
use crate::random::complement;
use glam::Vec3;
use rand_core::Rng;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul, MulAssign, Sub};

/// A quantity per channel: `f32` for grey media, [`Vec3`] for three channels.
pub trait Spectrum:
    Copy
    + Debug
    + PartialEq
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<f32, Output = Self>
    + AddAssign
    + MulAssign<f32>
{
    /// Zero in all channels.
    const ZERO: Self;
    /// One in all channels.
    const ONE: Self;
    /// `value` in all channels.
    fn splat(value: f32) -> Self;
    /// `e^x` per channel.
    fn exp(self) -> Self;
    /// Largest magnitude.
    fn max_abs(self) -> f32;
    /// The product, zero wherever a factor is zero: estimates that overflow stay infinite and never
    /// become NaN.
    fn times(self, factor: Self) -> Self;
    /// One less this per channel, without bias where ratios are lost to rounding: see
    /// [`complement`].
    fn complement<R: Rng + ?Sized>(self, rng: &mut R) -> Self;
    /// `f` per channel.
    fn map(self, f: impl Fn(f32) -> f32) -> Self;
    /// Number of channels.
    const COUNT: usize;
    /// The value of a channel below [`COUNT`](Spectrum::COUNT).
    fn channel(self, index: usize) -> f32;
    /// `value` in the channel `index` below [`COUNT`](Spectrum::COUNT), zero in the others.
    fn one_channel(index: usize, value: f32) -> Self;
    /// Mean over channels by the magnitudes of `weights`; by equal weights if all are zero.
    fn mean_by(self, weights: Self) -> f32;
}

#[inline(always)]
fn times(a: f32, b: f32) -> f32 {
    if a == 0.0 || b == 0.0 { 0.0 } else { a * b }
}

impl Spectrum for f32 {
    const ZERO: f32 = 0.0;
    const ONE: f32 = 1.0;
    #[inline(always)]
    fn splat(value: f32) -> f32 {
        value
    }
    #[inline(always)]
    fn exp(self) -> f32 {
        exp(self)
    }
    #[inline(always)]
    fn max_abs(self) -> f32 {
        self.abs()
    }
    #[inline(always)]
    fn times(self, factor: f32) -> f32 {
        times(self, factor)
    }
    #[inline(always)]
    fn complement<R: Rng + ?Sized>(self, rng: &mut R) -> f32 {
        complement(self, rng)
    }
    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> f32 {
        f(self)
    }
    const COUNT: usize = 1;
    #[inline(always)]
    fn channel(self, _: usize) -> f32 {
        self
    }
    #[inline(always)]
    fn one_channel(_: usize, value: f32) -> f32 {
        value
    }
    #[inline(always)]
    fn mean_by(self, _: f32) -> f32 {
        self
    }
}

impl Spectrum for Vec3 {
    const ZERO: Vec3 = Vec3::ZERO;
    const ONE: Vec3 = Vec3::ONE;
    #[inline(always)]
    fn splat(value: f32) -> Vec3 {
        Vec3::splat(value)
    }
    #[inline(always)]
    fn exp(self) -> Vec3 {
        Spectrum::map(self, exp)
    }
    #[inline(always)]
    fn max_abs(self) -> f32 {
        self.abs().max_element()
    }
    #[inline(always)]
    fn times(self, factor: Vec3) -> Vec3 {
        Vec3::new(times(self.x, factor.x), times(self.y, factor.y), times(self.z, factor.z))
    }
    #[inline(always)]
    fn complement<R: Rng + ?Sized>(self, rng: &mut R) -> Vec3 {
        Vec3::new(complement(self.x, rng), complement(self.y, rng), complement(self.z, rng))
    }
    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Vec3 {
        Vec3::new(f(self.x), f(self.y), f(self.z))
    }
    const COUNT: usize = 3;
    #[inline(always)]
    fn channel(self, index: usize) -> f32 {
        self[index]
    }
    #[inline(always)]
    fn one_channel(index: usize, value: f32) -> Vec3 {
        let mut channels = Vec3::ZERO;
        channels[index] = value;
        channels
    }
    #[inline(always)]
    fn mean_by(self, weights: Vec3) -> f32 {
        let weights = weights.abs();
        let total = weights.element_sum();
        if total > 0.0 { self.dot(weights) / total } else { self.element_sum() * (1.0 / 3.0) }
    }
}
