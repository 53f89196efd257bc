//! A rectangle of the image that one thread renders on its own.

use std::ops::Range;
use std::sync::Arc;

use crate::error::Error;
use crate::layer_set::{FIRST_VALUES, LayerSet};
use crate::moments::PixelSample;
use crate::path_record::PathRecord;

/// The samples of one pass in a rectangle, to be added to the [`Film`](crate::Film) that made it
/// ([`Film::tile`](crate::Film::tile)) when the pass is whole: what was cancelled before counts
/// nowhere.
///
/// It takes 16 bytes a sample, and 4 more for each channel of a layer with sums of its own. Its
/// memory is kept from pass to pass.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Left column in the full image.
    pub x0: u32,
    /// Top row in the full image.
    pub y0: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    layers: Arc<LayerSet>,
    numbers: Range<u64>,
    /// Pixel by pixel, sample by sample: R, G, B, alpha, and one value for each sum of further
    /// layers. NaN stands where there is no sample.
    values: Vec<f32>,
    samples: u64,
    dropped: u64,
    left_out: u64,
}

impl Tile {
    pub(crate) fn new(layers: Arc<LayerSet>, [x0, y0, width, height]: [u32; 4]) -> Self {
        Self {
            x0,
            y0,
            width,
            height,
            layers,
            numbers: 0..0,
            values: Vec::new(),
            samples: 0,
            dropped: 0,
            left_out: 0,
        }
    }

    /// Empties the tile and makes room for the samples of these numbers in each pixel.
    ///
    /// # Errors
    /// [`Error::TooLarge`] if there is no memory for them.
    pub fn start(&mut self, numbers: Range<u64>) -> Result<(), Error> {
        let per_pixel = numbers.end.saturating_sub(numbers.start);
        let count = u64::from(self.width)
            .checked_mul(u64::from(self.height))
            .and_then(|pixels| pixels.checked_mul(per_pixel))
            .and_then(|samples| samples.checked_mul(self.layers.values() as u64))
            .and_then(|values| usize::try_from(values).ok());
        self.values.clear();
        let taken = count.filter(|count| self.values.try_reserve_exact(*count).is_ok());
        let Some(count) = taken else {
            let Self { width, height, .. } = self;
            return Err(Error::too_large(
                "tile",
                format!("no memory for {per_pixel} samples of {width} x {height} pixels"),
                "take smaller tiles or shorter passes",
            ));
        };
        self.values.resize(count, f32::NAN);
        (self.numbers, self.samples, self.dropped, self.left_out) = (numbers, 0, 0, 0);
        Ok(())
    }

    /// Adds the sample of a number to the pixel (`x`, `y`), in coordinates of the full image.
    ///
    /// False if the sample is dropped and counted: radiance or alpha that is not finite, a pixel
    /// outside the tile, a number that [`Self::start`] did not name or that the pixel has already.
    #[inline]
    pub fn add(&mut self, x: u32, y: u32, number: u64, sample: &PixelSample) -> bool {
        self.add_recorded(x, y, number, sample, &PathRecord::EMPTY)
    }

    /// [`Self::add`], with what the sample's path told for the layers that ask for it.
    #[inline]
    pub fn add_recorded(
        &mut self,
        x: u32,
        y: u32,
        number: u64,
        sample: &PixelSample,
        path: &PathRecord,
    ) -> bool {
        let added = self.put([x, y], number, sample, path);
        if added {
            self.samples += 1;
        } else {
            self.dropped += 1;
        }
        added
    }

    #[inline]
    fn put(
        &mut self,
        [x, y]: [u32; 2],
        number: u64,
        sample: &PixelSample,
        path: &PathRecord,
    ) -> bool {
        let [r, g, b] = sample.rgb;
        let first = [r, g, b, sample.alpha];
        let Some(at) = self.index(x, y, number) else { return false };
        let Some(values) = self.values.get_mut(at..at + self.layers.values()) else {
            return false;
        };
        let Some((own, further)) = values.split_first_chunk_mut::<FIRST_VALUES>() else {
            return false;
        };
        if !own[0].is_nan() || !first.iter().all(|v| v.is_finite()) {
            return false;
        }
        *own = first;
        if !further.is_empty() {
            self.left_out += self.layers.take(sample, path, further);
        }
        true
    }

    /// Samples that were left out since [`Self::start`].
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Samples in it.
    pub(crate) fn samples(&self) -> u64 {
        self.samples
    }

    /// Values of layers that were not finite.
    pub(crate) fn left_out(&self) -> u64 {
        self.left_out
    }

    pub(crate) fn layers(&self) -> &LayerSet {
        &self.layers
    }

    /// The samples of a pixel: their numbers and values.
    pub(crate) fn samples_of(&self, x: u32, y: u32) -> impl Iterator<Item = (u64, &[f32])> {
        let size = self.layers.values();
        let count = (self.numbers.end.saturating_sub(self.numbers.start)) as usize;
        let start = self.index(x, y, self.numbers.start).unwrap_or(self.values.len());
        let values = self.values.get(start..start + count * size).unwrap_or(&[]);
        let there = |(_, values): &(u64, &[f32])| !values[0].is_nan();
        (self.numbers.start..).zip(values.chunks_exact(size)).filter(there)
    }

    fn index(&self, x: u32, y: u32, number: u64) -> Option<usize> {
        let (column, row) = (x.checked_sub(self.x0)?, y.checked_sub(self.y0)?);
        let inside = column < self.width && row < self.height && self.numbers.contains(&number);
        inside.then(|| {
            let pixel = row as usize * self.width as usize + column as usize;
            let per_pixel = (self.numbers.end - self.numbers.start) as usize;
            (pixel * per_pixel + (number - self.numbers.start) as usize) * self.layers.values()
        })
    }
}
