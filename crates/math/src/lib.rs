#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod bounds;
pub mod elementary;
mod frame;
mod luminance;
pub mod random;
mod spectrum;

pub use bounds::Bounds3;
pub use frame::{around, basis};
pub use luminance::{LUMINANCE, luminance};
pub use spectrum::Spectrum;
