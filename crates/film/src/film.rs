//! The film: pixel sums of the whole image.

use crate::error::Error;
use crate::image::{Image, Window};
use crate::moments::PixelMoments;
use crate::tile::Tile;

/// Most pixels a film may have, 2^28 (16384 x 16384; 138 GiB of sums).
pub const MAX_PIXELS: u64 = 1 << 28;

/// The part of the full image that is rendered, in pixels from its top left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Left column.
    pub x0: u32,
    /// Top row.
    pub y0: u32,
    /// Columns, at least one.
    pub width: u32,
    /// Rows, at least one.
    pub height: u32,
}

/// Collects samples into pixels and keeps their statistics.
///
/// All sums are integers (see [`PixelMoments`]): tiles may be added in any order, and films of
/// disjoint sample ranges merge to the bits of the film that got all samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Film {
    resolution: [u32; 2],
    crop: Crop,
    pixels: Vec<PixelMoments>,
    samples: u64,
    dropped: u64,
}

impl Film {
    /// An empty film of `resolution` (columns, rows), of which `crop` is rendered (None: all).
    ///
    /// # Errors
    /// Zero sizes, a crop window outside the image, more than [`MAX_PIXELS`], or no memory.
    pub fn new(resolution: [u32; 2], crop: Option<Crop>) -> Result<Self, Error> {
        let mut film = Self::without_pixels(resolution, crop)?;
        let count = film.pixel_count();
        film.reserve(count)?;
        film.pixels.resize(count, PixelMoments::default());
        Ok(film)
    }

    /// Checks the sizes; the pixels are left to the caller.
    pub(crate) fn without_pixels(resolution: [u32; 2], crop: Option<Crop>) -> Result<Self, Error> {
        let [width, height] = resolution;
        let crop = crop.unwrap_or(Crop { x0: 0, y0: 0, width, height });
        let fits = |start: u32, size: u32, full: u32| {
            size > 0 && start.checked_add(size).is_some_and(|end| end <= full)
        };
        if width == 0 || height == 0 || width > i32::MAX as u32 || height > i32::MAX as u32 {
            return Err(Error::invalid(
                "film",
                format!("resolution {width} x {height}"),
                "both sides must be at least one pixel and below 2^31",
            ));
        }
        if !fits(crop.x0, crop.width, width) || !fits(crop.y0, crop.height, height) {
            return Err(Error::invalid(
                "film",
                format!(
                    "crop window {} x {} at ({}, {}) does not lie inside {width} x {height}",
                    crop.width, crop.height, crop.x0, crop.y0
                ),
                "give a window of at least one pixel within the resolution",
            ));
        }
        let pixels = u64::from(crop.width) * u64::from(crop.height);
        if pixels > MAX_PIXELS {
            return Err(Error::too_large(
                "film",
                format!("{} x {} pixels exceed the limit of 2^28", crop.width, crop.height),
                "render the image in crop windows",
            ));
        }
        Ok(Self { resolution, crop, pixels: Vec::new(), samples: 0, dropped: 0 })
    }

    pub(crate) fn reserve(&mut self, additional: usize) -> Result<(), Error> {
        self.pixels.try_reserve_exact(additional).map_err(|_| {
            Error::too_large(
                "film",
                format!("no memory for {additional} pixels of 552 bytes"),
                "lower the resolution or render the image in crop windows",
            )
        })
    }

    /// Pixels of the crop window.
    pub(crate) fn pixel_count(&self) -> usize {
        self.crop.width as usize * self.crop.height as usize
    }

    /// Columns and rows of the full image.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// The window that is rendered; the whole image if none was asked for.
    pub fn crop(&self) -> Crop {
        self.crop
    }

    /// Rectangles (x0, y0, width, height) that cover the crop window once, row by row.
    ///
    /// They are `size` pixels wide and high (0 counts as 1), less at the right and lower edge.
    pub fn tiles(&self, size: u32) -> Vec<(u32, u32, u32, u32)> {
        let size = size.max(1);
        let starts = |start: u32, length: u32| {
            (0..length.div_ceil(size)).map(move |i| (start + i * size, size.min(length - i * size)))
        };
        starts(self.crop.y0, self.crop.height)
            .flat_map(|(y, height)| {
                starts(self.crop.x0, self.crop.width).map(move |(x, width)| (x, y, width, height))
            })
            .collect()
    }

    /// Adds the sums of a tile; samples of pixels outside the crop window count as dropped.
    pub fn add_tile(&mut self, tile: &Tile) {
        self.dropped = self.dropped.saturating_add(tile.dropped());
        for (y, row) in tile.rows() {
            for (x, pixel) in (u64::from(tile.x0)..).zip(row) {
                let added = match self.index(x, y) {
                    Some(index) => self.pixels[index].merge(pixel),
                    None => false,
                };
                if !added {
                    self.dropped = self.dropped.saturating_add(u64::from(pixel.count()));
                }
            }
        }
    }

    /// Notes that every pixel of the crop window got `samples` more samples (dropped ones included).
    pub fn commit_pass(&mut self, samples: u64) {
        self.samples = self.samples.saturating_add(samples);
    }

    /// Samples per pixel committed so far.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Samples left out of the means so far: not finite, or outside the window.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// The sums of the pixel (`x`, `y`) of the full image, if it is in the crop window.
    pub fn pixel(&self, x: u32, y: u32) -> Option<&PixelMoments> {
        self.index(u64::from(x), u64::from(y)).map(|index| &self.pixels[index])
    }

    /// Samples left out of the mean of one pixel, once all passes are committed.
    pub fn dropped_at(&self, x: u32, y: u32) -> Option<u64> {
        self.pixel(x, y).map(|pixel| self.samples.saturating_sub(u64::from(pixel.count())))
    }

    /// Adds the samples of another film of the same image.
    ///
    /// That the two hold different samples is for the caller to know.
    ///
    /// # Errors
    /// Another resolution or crop window, or more than 2^29 - 1 samples in a replicate of a pixel;
    /// the film is then unchanged.
    pub fn merge(&mut self, other: &Self) -> Result<(), Error> {
        if self.resolution != other.resolution || self.crop != other.crop {
            return Err(Error::invalid(
                "film",
                format!(
                    "{:?} with window {:?} cannot take in {:?} with window {:?}",
                    self.resolution, self.crop, other.resolution, other.crop
                ),
                "merge slices of one job only",
            ));
        }
        if !self.pixels.iter().zip(&other.pixels).all(|(a, b)| a.has_room_for(b)) {
            return Err(Error::too_large(
                "film",
                "a pixel would exceed 2^32 - 8 samples",
                "merge fewer slices",
            ));
        }
        for (own, its) in self.pixels.iter_mut().zip(&other.pixels) {
            own.merge(its);
        }
        self.samples = self.samples.saturating_add(other.samples);
        self.dropped = self.dropped.saturating_add(other.dropped);
        Ok(())
    }

    /// The mean of every pixel as channels R, G, B, A (radiance, alpha); black without samples.
    ///
    /// The image has the size of the crop window and is placed in the full image.
    pub fn image(&self) -> Image {
        self.planes(|pixel| pixel.mean().map(|v| v as f32))
    }

    /// The estimated variance of every mean as channels R, G, B, A.
    ///
    /// Infinite means unknown (fewer than two samples). What is known but leaves the range of
    /// 32-bit floats stays known: variances above 3.4e38 (noise above 1.8e19) are written as the
    /// largest finite float, those below 1.4e-45 that are not zero as the smallest. See
    /// [`PixelMoments::variance_of_mean`].
    pub fn variance(&self) -> Image {
        self.planes(|pixel| pixel.variance_of_mean().map(variance_as_f32))
    }

    fn planes(&self, value: impl Fn(&PixelMoments) -> [f32; 4]) -> Image {
        let mut planes: [Vec<f32>; 4] =
            std::array::from_fn(|_| Vec::with_capacity(self.pixels.len()));
        for pixel in &self.pixels {
            for (plane, v) in planes.iter_mut().zip(value(pixel)) {
                plane.push(v);
            }
        }
        let Crop { x0, y0, width, height } = self.crop;
        let [full_width, full_height] = self.resolution;
        Image::of_film(
            Window { x: x0 as i32, y: y0 as i32, width, height },
            Window { x: 0, y: 0, width: full_width, height: full_height },
            ["R", "G", "B", "A"].into_iter().zip(planes),
        )
    }

    pub(crate) fn pixels(&self) -> &[PixelMoments] {
        &self.pixels
    }

    pub(crate) fn push_pixel(&mut self, pixel: PixelMoments) {
        self.pixels.push(pixel);
    }

    pub(crate) fn set_counters(&mut self, samples: u64, dropped: u64) {
        (self.samples, self.dropped) = (samples, dropped);
    }

    fn index(&self, x: u64, y: u64) -> Option<usize> {
        let column = x.checked_sub(u64::from(self.crop.x0))?;
        let row = y.checked_sub(u64::from(self.crop.y0))?;
        (column < u64::from(self.crop.width) && row < u64::from(self.crop.height))
            .then(|| row as usize * self.crop.width as usize + column as usize)
    }
}

/// The nearest of the floats that say the same: infinite, positive and finite, or zero.
fn variance_as_f32(v: f64) -> f32 {
    if v > 0.0 && v.is_finite() { (v as f32).clamp(f32::from_bits(1), f32::MAX) } else { v as f32 }
}
