//! Light: suns, points and spots, and light from all around.

pub mod environment;
mod environment_file;
pub mod punctual;
mod radiance_hdr;
pub(crate) mod sky;
