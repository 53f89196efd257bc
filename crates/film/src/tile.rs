//! A rectangle of the image that one thread renders on its own.

use crate::moments::{PixelMoments, PixelSample};

/// Pixel sums of a rectangle, to be added to a [`Film`](crate::Film) when it is done.
///
/// It takes 552 bytes a pixel; 16 x 16 pixels are 138 KiB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Left column in the full image.
    pub x0: u32,
    /// Top row in the full image.
    pub y0: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    pixels: Vec<PixelMoments>,
    dropped: u64,
}

impl Tile {
    /// An empty tile whose top left pixel is (`x0`, `y0`) of the full image.
    pub fn new(x0: u32, y0: u32, width: u32, height: u32) -> Self {
        let pixels = vec![PixelMoments::default(); width as usize * height as usize];
        Self { x0, y0, width, height, pixels, dropped: 0 }
    }

    /// Adds the sample of a number to the pixel (`x`, `y`), in coordinates of the full image.
    ///
    /// False if the sample is dropped and counted: not finite, or outside the tile. The number
    /// tells the replicate ([`REPLICATES`](crate::REPLICATES)).
    #[inline]
    pub fn add(&mut self, x: u32, y: u32, number: u64, sample: &PixelSample) -> bool {
        let added = match self.index(x, y) {
            Some(index) => self.pixels[index].add(number, sample),
            None => false,
        };
        self.dropped += u64::from(!added);
        added
    }

    /// Samples that were left out so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// The sums of the pixel (`x`, `y`) of the full image, if it is in the tile.
    pub fn pixel(&self, x: u32, y: u32) -> Option<&PixelMoments> {
        self.index(x, y).map(|index| &self.pixels[index])
    }

    /// Empties the tile and moves it, keeping its memory.
    pub fn reset(&mut self, x0: u32, y0: u32, width: u32, height: u32) {
        self.pixels.clear();
        self.pixels.resize(width as usize * height as usize, PixelMoments::default());
        (self.x0, self.y0, self.width, self.height, self.dropped) = (x0, y0, width, height, 0);
    }

    /// Rows of the tile: row number in the full image and its pixels from `x0` on.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (u64, &[PixelMoments])> {
        self.pixels
            .chunks(self.width.max(1) as usize)
            .enumerate()
            .map(|(row, pixels)| (u64::from(self.y0) + row as u64, pixels))
    }

    fn index(&self, x: u32, y: u32) -> Option<usize> {
        let (column, row) = (x.checked_sub(self.x0)?, y.checked_sub(self.y0)?);
        (column < self.width && row < self.height)
            .then(|| row as usize * self.width as usize + column as usize)
    }
}
