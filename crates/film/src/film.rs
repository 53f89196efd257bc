//! The film: sums of the whole image, in layers.

use std::sync::Arc;

use rayon::prelude::*;

use crate::channel_sum::{ChannelSum, MAX_SUMMED};
use crate::crop::{Crop, checked_window};
use crate::error::Error;
use crate::image::{Image, Window};
use crate::layer::{ALPHA, BEAUTY, Layer, VARIANCE};
use crate::layer_set::{FIRST_VALUES, LayerSet, Placed};
use crate::memory::{bytes_per_pixel, samples_per_pass};
use crate::moments::{PixelMoments, PixelSample};
use crate::tile::Tile;

/// Rows that one thread adds tiles to at a time.
const ROWS_OF_A_BAND: usize = 16;

/// Collects samples into pixels and keeps their statistics, in layers.
///
/// Every film has the layers [`BEAUTY`], [`ALPHA`] and [`VARIANCE`]; others are there if they were
/// asked for and cost nothing if not. All sums are integers (see [`PixelMoments`]): tiles may be
/// added in any order, and films of disjoint sample ranges merge to the bits of the film that got
/// all samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Film {
    resolution: [u32; 2],
    crop: Crop,
    layers: Arc<LayerSet>,
    pixels: Vec<PixelMoments>,
    /// Of layers with sums of their own, pixel by pixel.
    sums: Vec<ChannelSum>,
    samples: u64,
    dropped: u64,
    left_out: u64,
}

impl Film {
    /// An empty film of `resolution` (columns, rows), of which `crop` is rendered (None: all), with
    /// the first layers alone.
    ///
    /// # Errors
    /// Zero sizes, a crop window outside the image, more than [`MAX_PIXELS`](crate::MAX_PIXELS), or
    /// no memory.
    pub fn new(resolution: [u32; 2], crop: Option<Crop>) -> Result<Self, Error> {
        Self::with_layers(resolution, crop, &[])
    }

    /// An empty film as [`Self::new`] makes it, with further layers beside the first ones.
    ///
    /// What it takes tells [`FilmMemory::of`](crate::FilmMemory::of) beforehand.
    ///
    /// # Errors
    /// Zero sizes, a crop window outside the image, more than [`MAX_PIXELS`](crate::MAX_PIXELS), or
    /// no memory; layers whose names cannot be stored or are taken, or that have more than 1024
    /// channels in all.
    pub fn with_layers(
        resolution: [u32; 2],
        crop: Option<Crop>,
        further: &[&'static Layer],
    ) -> Result<Self, Error> {
        let mut film = Self::without_pixels(resolution, crop, LayerSet::new(further)?)?;
        let count = film.pixel_count();
        film.reserve(count)?;
        film.pixels.resize(count, PixelMoments::default());
        film.sums.resize(count * film.layers.sums(), ChannelSum::default());
        Ok(film)
    }

    /// Checks the sizes; the pixels are left to the caller.
    pub(crate) fn without_pixels(
        resolution: [u32; 2],
        crop: Option<Crop>,
        layers: LayerSet,
    ) -> Result<Self, Error> {
        Ok(Self {
            resolution,
            crop: checked_window(resolution, crop)?,
            layers: Arc::new(layers),
            pixels: Vec::new(),
            sums: Vec::new(),
            samples: 0,
            dropped: 0,
            left_out: 0,
        })
    }

    /// Makes room for as many more pixels.
    pub(crate) fn reserve(&mut self, additional: usize) -> Result<(), Error> {
        let sums = additional * self.layers.sums();
        self.pixels
            .try_reserve_exact(additional)
            .and_then(|()| self.sums.try_reserve_exact(sums))
            .map_err(|_| {
                let bytes = bytes_per_pixel(&self.layers);
                Error::too_large(
                    "film",
                    format!("no memory for {additional} pixels of {bytes} bytes"),
                    "lower the resolution, ask for fewer layers or render the image in crop windows",
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

    /// Layers of the film: the first ones, then those that were asked for.
    pub fn layers(&self) -> &[&'static Layer] {
        self.layers.layers()
    }

    /// Whether some layer takes values from samples and from what paths told: if not, paths need not
    /// be asked.
    pub fn takes_records(&self) -> bool {
        self.layers.sums() > 0
    }

    /// Bytes that its sums have been given: [`FilmMemory::sums`](crate::FilmMemory::sums),
    /// measured.
    pub fn allocated_bytes(&self) -> u64 {
        let pixels = self.pixels.capacity() * size_of::<PixelMoments>();
        (pixels + self.sums.capacity() * size_of::<ChannelSum>()) as u64
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

    /// A tile for samples of this film's layers, whose top left pixel is (`x0`, `y0`) of the full
    /// image; it has room for samples once it was told their numbers ([`Tile::start`]).
    pub fn tile(&self, x0: u32, y0: u32, width: u32, height: u32) -> Tile {
        Tile::new(self.layers.clone(), [x0, y0, width, height])
    }

    /// Most samples of a pixel that tiles should hold at a time: 8, or as many as 64 MiB have room
    /// for over all pixels of the window if that is more.
    pub fn samples_per_pass(&self) -> u64 {
        samples_per_pass(self.pixel_count() as u64, &self.layers)
    }

    /// Adds the samples of tiles, on the current rayon pool; those of pixels outside the crop
    /// window and those that are one too many for their pixel (2^29 - 1 in a replicate; 2^31 - 1 in
    /// all where a layer has sums of its own) count as dropped.
    ///
    /// # Errors
    /// Tiles of a film with other layers; nothing is then added.
    pub fn add_tiles(&mut self, tiles: &[Tile]) -> Result<(), Error> {
        if tiles.iter().any(|tile| *tile.layers() != *self.layers) {
            return Err(Error::invalid(
                "film",
                "a tile was made for other layers",
                "add tiles to the film that made them",
            ));
        }
        let (crop, per_pixel) = (self.crop, self.layers.sums());
        let mut sums = self.sums.as_mut_slice();
        let mut bands = Vec::new();
        let rows = (u64::from(crop.y0)..).step_by(ROWS_OF_A_BAND);
        let pixels_of_a_band = crop.width as usize * ROWS_OF_A_BAND;
        for (y0, pixels) in rows.zip(self.pixels.chunks_mut(pixels_of_a_band)) {
            let (own, rest) = std::mem::take(&mut sums).split_at_mut(pixels.len() * per_pixel);
            bands.push(Band { crop, y0, pixels, sums: own, per_pixel });
            sums = rest;
        }
        let added: u64 = bands
            .into_par_iter()
            .map(|mut band| tiles.iter().map(|tile| band.add(tile)).sum::<u64>())
            .sum();
        for tile in tiles {
            let all = tile.samples().saturating_add(tile.dropped());
            self.dropped = self.dropped.saturating_add(all);
            self.left_out = self.left_out.saturating_add(tile.left_out());
        }
        self.dropped = self.dropped.saturating_sub(added);
        Ok(())
    }

    /// Notes that every pixel of the crop window got `samples` more samples (dropped ones
    /// included).
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

    /// Values of layers with sums of their own that were not finite and count as zero, so far.
    pub fn values_left_out(&self) -> u64 {
        self.left_out
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
    /// Another resolution, crop window or list of layers, or more samples in a pixel than fit (see
    /// [`Self::add_tiles`]); the film is then unchanged.
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
        if self.layers != other.layers {
            let names = |film: &Self| {
                let names: Vec<&str> = film.layers().iter().map(|layer| layer.name).collect();
                names.join(", ")
            };
            return Err(Error::invalid(
                "film",
                format!("layers {} cannot take in layers {}", names(self), names(other)),
                "merge slices of one job only",
            ));
        }
        let has_sums = self.layers.sums() > 0;
        let fits = |(a, b): (&PixelMoments, &PixelMoments)| {
            let count = u64::from(a.count()) + u64::from(b.count());
            a.has_room_for(b) && (!has_sums || count <= u64::from(MAX_SUMMED))
        };
        if !self.pixels.iter().zip(&other.pixels).all(fits) {
            return Err(Error::too_large(
                "film",
                format!("a pixel would exceed 2^{} samples", if has_sums { 31 } else { 32 }),
                "merge fewer slices",
            ));
        }
        for (own, its) in self.pixels.iter_mut().zip(&other.pixels) {
            own.merge(its);
        }
        for (own, its) in self.sums.iter_mut().zip(&other.sums) {
            own.merge(*its);
        }
        self.samples = self.samples.saturating_add(other.samples);
        self.dropped = self.dropped.saturating_add(other.dropped);
        self.left_out = self.left_out.saturating_add(other.left_out);
        Ok(())
    }

    /// The picture: layers [`BEAUTY`] and [`ALPHA`], channels R, G, B, A.
    ///
    /// The image has the size of the crop window and is placed in the full image.
    pub fn image(&self) -> Image {
        self.planes([&BEAUTY, &ALPHA].map(|layer| (layer, layer.channels)))
    }

    /// The layer [`VARIANCE`] with its channels called R, G, B, A, as those of the picture whose
    /// means they are about.
    pub fn variance(&self) -> Image {
        let names = ["R", "G", "B", "A"];
        self.planes([(&VARIANCE, names.as_slice())])
    }

    /// The channels of layers of this film, as an image of the size of the crop window that is
    /// placed in the full image.
    ///
    /// # Errors
    /// [`Error::Invalid`] for a layer that the film does not have.
    pub fn image_of(&self, layers: &[&Layer]) -> Result<Image, Error> {
        for layer in layers {
            if self.layers.first_sum(layer).is_none() {
                return Err(Error::invalid(
                    "film",
                    format!("it has no layer {:?}", layer.name),
                    "ask for it when the film is made",
                ));
            }
        }
        Ok(self.planes(layers.iter().map(|layer| (*layer, layer.channels))))
    }

    /// Planes of layers of this film, with names for the channels of each.
    fn planes<'l>(
        &self,
        layers: impl IntoIterator<Item = (&'l Layer, &'l [&'static str])>,
    ) -> Image {
        let per_pixel = self.layers.sums();
        let mut planes: Vec<(&str, Vec<f32>)> = Vec::new();
        let mut parts = Vec::new();
        for (layer, names) in layers {
            let Some(placed) = Placed::new(&self.layers, layer) else { continue };
            parts.push((placed, planes.len()..planes.len() + layer.channels.len()));
            planes.extend(names.iter().map(|name| (*name, vec![0.0; self.pixels.len()])));
        }
        let pixels_of_a_band = self.crop.width as usize * ROWS_OF_A_BAND;
        let mut rest: Vec<&mut [f32]> =
            planes.iter_mut().map(|(_, plane)| plane.as_mut_slice()).collect();
        let mut bands = Vec::new();
        for (band, pixels) in self.pixels.chunks(pixels_of_a_band).enumerate() {
            let own: Vec<&mut [f32]> =
                rest.iter_mut().map(|plane| first_part(plane, pixels.len())).collect();
            bands.push((band * pixels_of_a_band, pixels, own));
        }
        // Pixels are large: each is taken into the cache once for all layers.
        bands.into_par_iter().for_each(|(start, pixels, mut own)| {
            let mut values = vec![0.0; own.len()];
            for (i, pixel) in pixels.iter().enumerate() {
                let sums = (start + i) * per_pixel;
                let sums = self.sums.get(sums..sums + per_pixel).unwrap_or(&[]);
                for (layer, channels) in &parts {
                    layer.reconstruct(pixel, sums, &mut values[channels.clone()]);
                }
                for (plane, value) in own.iter_mut().zip(&values) {
                    plane[i] = *value;
                }
            }
        });
        let Crop { x0, y0, width, height } = self.crop;
        let [full_width, full_height] = self.resolution;
        Image::of_film(
            Window { x: x0 as i32, y: y0 as i32, width, height },
            Window { x: 0, y: 0, width: full_width, height: full_height },
            planes.into_iter(),
        )
    }

    /// The sums of each pixel: the first layers', and those of layers with sums of their own.
    pub(crate) fn pixels(&self) -> impl Iterator<Item = (&PixelMoments, &[ChannelSum])> {
        let per_pixel = self.layers.sums();
        self.pixels.iter().enumerate().map(move |(i, pixel)| {
            (pixel, self.sums.get(i * per_pixel..(i + 1) * per_pixel).unwrap_or(&[]))
        })
    }

    /// Appends a pixel to a film that is being read.
    pub(crate) fn push_pixel(
        &mut self,
        pixel: PixelMoments,
        sums: impl IntoIterator<Item = ChannelSum>,
    ) {
        self.pixels.push(pixel);
        self.sums.extend(sums);
    }

    pub(crate) fn layer_set(&self) -> &LayerSet {
        &self.layers
    }

    pub(crate) fn set_counters(&mut self, samples: u64, dropped: u64, left_out: u64) {
        (self.samples, self.dropped, self.left_out) = (samples, dropped, left_out);
    }

    fn index(&self, x: u64, y: u64) -> Option<usize> {
        let column = x.checked_sub(u64::from(self.crop.x0))?;
        let row = y.checked_sub(u64::from(self.crop.y0))?;
        (column < u64::from(self.crop.width) && row < u64::from(self.crop.height))
            .then(|| row as usize * self.crop.width as usize + column as usize)
    }
}

/// Takes the first part of a slice off.
fn first_part<'a>(slice: &mut &'a mut [f32], length: usize) -> &'a mut [f32] {
    let (own, rest) = std::mem::take(slice).split_at_mut(length);
    *slice = rest;
    own
}

/// Rows of the film that one thread adds to.
struct Band<'f> {
    crop: Crop,
    y0: u64,
    pixels: &'f mut [PixelMoments],
    sums: &'f mut [ChannelSum],
    per_pixel: usize,
}

impl Band<'_> {
    /// Adds what a tile has for these rows; tells how many samples that were.
    fn add(&mut self, tile: &Tile) -> u64 {
        let overlap = |start: u64, length: u64, own: u32, size: u32| {
            let (own, size) = (u64::from(own), u64::from(size));
            start.max(own)..(start + length).min(own + size)
        };
        let width = u64::from(self.crop.width);
        let rows = self.pixels.len() as u64 / width;
        let columns = overlap(u64::from(self.crop.x0), width, tile.x0, tile.width);
        let mut added = 0;
        for y in overlap(self.y0, rows, tile.y0, tile.height) {
            for x in columns.clone() {
                let index = ((y - self.y0) * width + x - u64::from(self.crop.x0)) as usize;
                let pixel = &mut self.pixels[index];
                let sums = &mut self.sums[index * self.per_pixel..(index + 1) * self.per_pixel];
                for (number, values) in tile.samples_of(x as u32, y as u32) {
                    added += u64::from(add_sample(pixel, sums, number, values));
                }
            }
        }
        added
    }
}

/// Adds the values of a sample; false if there is no room.
#[inline]
fn add_sample(
    pixel: &mut PixelMoments,
    sums: &mut [ChannelSum],
    number: u64,
    values: &[f32],
) -> bool {
    let Some((&[r, g, b, alpha], further)) = values.split_first_chunk::<FIRST_VALUES>() else {
        return false;
    };
    if !sums.is_empty() && pixel.count() >= MAX_SUMMED
        || !pixel.add(number, &PixelSample::new([r, g, b], alpha))
    {
        return false;
    }
    for (sum, value) in sums.iter_mut().zip(further) {
        sum.add(*value);
    }
    true
}
