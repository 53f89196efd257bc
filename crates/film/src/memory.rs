//! The memory of a film, known before it is taken.

use crate::channel_sum::SUM_BYTES;
use crate::crop::{Crop, checked_window};
use crate::error::Error;
use crate::layer::Layer;
use crate::layer_set::LayerSet;
use crate::moments::PixelMoments;

/// Samples of a pixel that a pass may have however large the film is.
const SMALLEST_PASS: u64 = 8;
/// Bytes that the samples of a pass may take however small the film is, 64 MiB.
const SMALL_PASS_BYTES: u64 = 1 << 26;

/// Bytes that a render keeps for its film.
///
/// The tiles' bookkeeping (some 100 bytes a tile), the allocator's, and the planes of the images
/// that are made at the end (4 bytes a pixel and channel, twice while they are written) come on
/// top.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilmMemory {
    /// The sums: [`Film`](crate::Film) itself. 552 bytes a pixel, and 16 for each channel of a
    /// layer with sums of its own.
    pub sums: u64,
    /// The samples of one pass in their tiles, until the pass is whole and they are added: 16 bytes
    /// a pixel and sample, and 4 for each channel of a layer with sums of its own.
    pub tiles: u64,
}

impl FilmMemory {
    /// The memory of a film with `further` layers beside the first ones, in a render of `samples`
    /// samples per pixel whose passes have as many as
    /// [`Film::samples_per_pass`](crate::Film::samples_per_pass) allows. Exact; allocates nothing.
    ///
    /// # Errors
    /// What [`Film::with_layers`](crate::Film::with_layers) refuses, but for the lack of memory.
    pub fn of(
        resolution: [u32; 2],
        crop: Option<Crop>,
        further: &[&'static Layer],
        samples: u64,
    ) -> Result<Self, Error> {
        let crop = checked_window(resolution, crop)?;
        let layers = LayerSet::new(further)?;
        let pixels = u64::from(crop.width) * u64::from(crop.height);
        let pass = samples_per_pass(pixels, &layers).min(samples);
        Ok(Self {
            sums: pixels * bytes_per_pixel(&layers),
            tiles: pixels * pass * bytes_per_sample(&layers),
        })
    }

    /// All of it, bytes.
    pub fn total(&self) -> u64 {
        self.sums.saturating_add(self.tiles)
    }
}

/// Bytes of the sums of one pixel.
pub(crate) fn bytes_per_pixel(layers: &LayerSet) -> u64 {
    (size_of::<PixelMoments>() + SUM_BYTES * layers.sums()) as u64
}

/// Bytes of one sample in a tile.
fn bytes_per_sample(layers: &LayerSet) -> u64 {
    (size_of::<f32>() * layers.values()) as u64
}

/// Most samples of a pixel in one pass: 8, or as many as 64 MiB hold if that is more.
///
/// A tile that holds samples is smaller than one that holds sums of 552 bytes up to 34 of them.
pub(crate) fn samples_per_pass(pixels: u64, layers: &LayerSet) -> u64 {
    (SMALL_PASS_BYTES / (pixels * bytes_per_sample(layers)).max(1)).max(SMALLEST_PASS)
}
