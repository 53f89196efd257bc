//! Denoising by non-local means, from what the film knows.
//!
//! After Rousselle, Knaus and Zwicker, "Adaptive Rendering with Non-Local Means Filtering" (2012):
//! a pixel becomes the mean of the pixels in a window whose patches look like its own, as judged by
//! how noisy they are known to be. The samples are in two halves, by their replicates: each is
//! averaged with weights that the other gave, so that a sample does not choose its own company.
//! Alpha is compared beside colour: it tells the edges of clouds where noise hides them.

use rayon::prelude::*;

use crate::film::Film;
use crate::image::Image;

/// What jobs call the denoised picture.
pub const DENOISED: &str = "denoised";
/// What it holds.
pub const DENOISED_MEANING: &str =
    "radiance without most of its noise, biased; not the picture itself";
/// Its channels in EXR files.
pub const DENOISED_CHANNELS: [&str; 3] = ["denoised.R", "denoised.G", "denoised.B"];

/// Pixels to each side in which similar ones are looked for.
const WINDOW: usize = 6;
/// Pixels to each side that are compared.
const PATCH: usize = 2;
/// Differences between pixels are compared with this share of their standard error: smaller keeps
/// more detail and more noise. Measured on six scenes: `docs/charts/denoising.md`.
const STRENGTH: f32 = 0.45;
/// Fewest samples of a pixel with which its noise is known well enough.
const MIN_SAMPLES: u64 = 4;
/// Rows that one thread filters at a time.
const ROWS_OF_A_BAND: usize = 32;
/// R, G, B and alpha.
const CHANNELS: usize = 4;

/// A plane of an image with pixels repeated beyond its left and right edges, so that rows may be
/// read [`WINDOW`] pixels to either side.
struct Plane {
    values: Vec<f32>,
    stride: usize,
}

impl Plane {
    fn new(values: &[f32], width: usize) -> Plane {
        let stride = width + 2 * WINDOW;
        let mut padded = Vec::with_capacity(values.len() / width * stride);
        for row in values.chunks_exact(width) {
            padded.extend(std::iter::repeat_n(row[0], WINDOW));
            padded.extend_from_slice(row);
            padded.extend(std::iter::repeat_n(row[width - 1], WINDOW));
        }
        Plane { values: padded, stride }
    }

    /// `width` values of a row, from `shift` pixels right of its first.
    fn row(&self, y: usize, shift: isize, width: usize) -> &[f32] {
        let start = y * self.stride + (WINDOW as isize + shift) as usize;
        &self.values[start..start + width]
    }
}

/// What is filtered.
struct Halves {
    width: usize,
    height: usize,
    /// Means of each half.
    means: [[Plane; CHANNELS]; 2],
    /// Variance of the mean of one half, smoothed.
    variance: [Plane; CHANNELS],
    /// One where a pixel is known, zero where it is not.
    known: Plane,
}

impl Film {
    /// The picture without most of its noise, channels [`DENOISED_CHANNELS`]: biased, it blurs what
    /// noise hides. `None` below four samples a pixel, where that noise is not known.
    ///
    /// Deterministic: a function of the film's sums. Pixels whose mean or variance is not known,
    /// those beyond 1e18, and those with a sample out of all proportion to their neighbours keep
    /// their value and are no part of others. It takes some 145 bytes a pixel while it runs.
    pub fn denoised(&self) -> Option<Image> {
        if self.samples() < MIN_SAMPLES {
            return None;
        }
        let halves = Halves::new(self);
        let Halves { width, height, .. } = halves;
        let mut planes = [(); 3].map(|()| vec![0.0f32; width * height]);
        let [r, g, b] = &mut planes;
        let of_a_band = width * ROWS_OF_A_BAND;
        let rows = (r.par_chunks_mut(of_a_band), g.par_chunks_mut(of_a_band));
        (rows.0, rows.1, b.par_chunks_mut(of_a_band))
            .into_par_iter()
            .enumerate()
            .for_each(|(band, (r, g, b))| halves.filter(band * ROWS_OF_A_BAND, [r, g, b]));
        let image = self.image();
        for (plane, raw) in planes.iter_mut().zip(["R", "G", "B"]) {
            for (i, value) in plane.iter_mut().enumerate() {
                if !value.is_finite() {
                    *value = image.channel(raw).map_or(0.0, |raw| raw[i]);
                }
            }
        }
        let (data, display) = (image.data_window(), image.display_window());
        Some(Image::of_film(data, display, DENOISED_CHANNELS.into_iter().zip(planes)))
    }
}

impl Halves {
    fn new(film: &Film) -> Halves {
        let crop = film.crop();
        let (width, height) = (crop.width as usize, crop.height as usize);
        let pixels: Vec<_> = film.pixels().map(|(pixel, _)| pixel).collect();
        let all: Vec<Known> = pixels
            .par_iter()
            .with_min_len(1024)
            // Half of the samples have twice the variance.
            .map(|pixel| (pixel.halves(), pixel.variance_of_mean().map(|v| 2.0 * v)))
            .collect();
        let is_known = |(halves, variance): &Known| {
            // Beyond, squares of differences are no 32-bit floats.
            halves.iter().flatten().all(|v| v.abs() < 1e18) && variance.iter().all(|v| *v < 1e36)
        };
        let finite: Vec<bool> = all.iter().map(is_known).collect();
        let known: Vec<bool> = (0..all.len())
            .into_par_iter()
            .map(|i| {
                let around = Around::new(i, width, height);
                finite[i] && !(0..3).any(|c| is_outlier(&all, &finite, &around, c))
            })
            .collect();
        let plane = |of: &(dyn Fn(usize) -> f64 + Sync)| -> Vec<f32> {
            (0..all.len()).map(|i| if known[i] { of(i) as f32 } else { 0.0 }).collect()
        };
        let means = [0, 1]
            .map(|half| std::array::from_fn(|c| Plane::new(&plane(&|i| all[i].0[half][c]), width)));
        let variance = std::array::from_fn(|c| {
            let raw = plane(&|i| all[i].1[c]);
            Plane::new(&smoothed(&raw, &known, width, height), width)
        });
        let known = Plane::new(&plane(&|_| 1.0), width);
        Halves { width, height, means, variance, known }
    }

    /// Filters the rows from `y0` on into three planes; NaN where a pixel is not known.
    fn filter(&self, y0: usize, planes: [&mut [f32]; 3]) {
        let Halves { width, height, .. } = *self;
        let rows = planes[0].len() / width;
        // Distances of single pixels, for the rows of the band and those that patches reach.
        let (first, end) = (y0.saturating_sub(PATCH), (y0 + rows + PATCH).min(height));
        let mut distances = vec![0.0f32; (end - first) * width];
        let mut column = vec![0.0f32; width + 2 * PATCH];
        let mut weight = vec![0.0f32; width];
        let mut sums = [(); 3].map(|()| vec![0.0f32; 2 * rows * width]);
        let mut total = vec![0.0f32; 2 * rows * width];
        let reach = WINDOW as isize;
        for (half, dy, dx) in (0..2).flat_map(|half| {
            (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (half, dy, dx)))
        }) {
            for (y, distances) in (first..end).zip(distances.chunks_exact_mut(width)) {
                let other = (y as isize + dy).clamp(0, height as isize - 1) as usize;
                self.distances(1 - half, (y, other, dx), distances);
            }
            for y in y0..y0 + rows {
                let other = y as isize + dy;
                if !(0..height as isize).contains(&other) {
                    continue;
                }
                let other = other as usize;
                self.patches((y, first, end), &distances, &mut column);
                // Beyond the edges nothing is known.
                let from = (-dx).max(0) as usize;
                let to = (width as isize - dx.max(0)).max(0) as usize;
                for (w, patch) in weight.iter_mut().zip(column.windows(2 * PATCH + 1)) {
                    let distance: f32 = patch.iter().sum();
                    *w = similarity(distance);
                }
                let known = self.known.row(other, dx, width);
                let at = (half * rows + y - y0) * width;
                for x in from..to {
                    let w = weight[x] * known[x];
                    weight[x] = w;
                    total[at + x] += w;
                }
                for (sums, mean) in sums.iter_mut().zip(&self.means[half]) {
                    let values = mean.row(other, dx, width);
                    for x in from..to {
                        sums[at + x] += weight[x] * values[x];
                    }
                }
            }
        }
        for (plane, sums) in planes.into_iter().zip(&sums) {
            for (i, value) in plane.iter_mut().enumerate() {
                let known = self.known.row(y0 + i / width, 0, width)[i % width] > 0.0;
                let j = rows * width + i;
                let mean = 0.5 * (sums[i] / total[i] + sums[j] / total[j]);
                *value = if known { mean } else { f32::NAN };
            }
        }
    }

    /// Squared differences between a row of pixels and another one `dx` to the right, over the
    /// variance that they have, less what noise alone makes of them. Guided by one half.
    fn distances(&self, guide: usize, (y, other, dx): (usize, usize, isize), out: &mut [f32]) {
        let width = self.width;
        out.fill(0.0);
        for (mean, variance) in self.means[guide].iter().zip(&self.variance) {
            let (own, its) = (mean.row(y, 0, width), mean.row(other, dx, width));
            let (own_var, its_var) = (variance.row(y, 0, width), variance.row(other, dx, width));
            for x in 0..width {
                let (p, q, vp, vq) = (own[x], its[x], own_var[x], its_var[x]);
                let difference = (p - q) * (p - q) - (vp + vp.min(vq));
                // Values that have no noise are told apart at their last digits.
                let least = 1e-10 * (p * p + q * q) + 1e-30;
                out[x] += difference / (least + STRENGTH * STRENGTH * (vp + vq));
            }
        }
        // What is not known differs from nothing.
        let (own, its) = (self.known.row(y, 0, width), self.known.row(other, dx, width));
        for (x, out) in out.iter_mut().enumerate() {
            *out *= own[x] * its[x];
        }
    }

    /// Sums of the distances of single pixels over the columns of patches around row `y`, with the
    /// outer ones repeated; the mean over patch and channels is their sum over a row of it.
    fn patches(
        &self,
        (y, first, end): (usize, usize, usize),
        distances: &[f32],
        column: &mut [f32],
    ) {
        const SCALE: f32 = 1.0 / (CHANNELS * (2 * PATCH + 1) * (2 * PATCH + 1)) as f32;
        let width = self.width;
        let (edge, inner) = (PATCH, PATCH..PATCH + width);
        column[inner.clone()].fill(0.0);
        for dy in 0..=2 * PATCH {
            let row = (y + dy).saturating_sub(PATCH).clamp(first, end - 1) - first;
            let row = &distances[row * width..(row + 1) * width];
            for (sum, distance) in column[inner.clone()].iter_mut().zip(row) {
                *sum += SCALE * distance;
            }
        }
        let (left, right) = (column[edge], column[edge + width - 1]);
        column[..edge].fill(left);
        column[edge + width..].fill(right);
    }
}

/// The weight of a pixel at a distance: nearly `exp(-distance)`, by multiplications, and zero from 8
/// on.
#[inline]
fn similarity(distance: f32) -> f32 {
    let w = (1.0 - distance.max(0.0) * (1.0 / 8.0)).max(0.0);
    let w = w * w;
    let w = w * w;
    w * w
}

/// What is known of a pixel: the means of each half, and the variance of one.
type Known = ([[f64; CHANNELS]; 2], [f64; CHANNELS]);

/// The 3 x 3 pixels around one, less at the edges.
struct Around {
    pixel: usize,
    all: [usize; 9],
    count: usize,
}

impl Around {
    fn new(pixel: usize, width: usize, height: usize) -> Around {
        let (x, y) = (pixel % width, pixel / width);
        let (mut all, mut count) = ([0; 9], 0);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for x in x.saturating_sub(1)..(x + 2).min(width) {
                all[count] = y * width + x;
                count += 1;
            }
        }
        Around { pixel, all, count }
    }

    fn pixels(&self) -> &[usize] {
        &self.all[..self.count]
    }

    /// The median of a value of these pixels.
    fn median(&self, value: impl Fn(usize) -> f64) -> f64 {
        let mut values = self.all.map(value);
        let values = &mut values[..self.count];
        values.sort_unstable_by(f64::total_cmp);
        values[self.count / 2]
    }
}

/// Whether a pixel has a sample so much brighter than all around that its light, shared among its
/// neighbours, would be a blot: a standard error 100 times theirs, and ten times their brightness.
fn is_outlier(all: &[Known], finite: &[bool], around: &Around, channel: usize) -> bool {
    let variance = |i: usize| if finite[i] { all[i].1[channel] } else { 0.0 };
    let own = variance(around.pixel);
    // Most pixels are told at once.
    let least = around.pixels().iter().map(|&i| variance(i)).fold(f64::INFINITY, f64::min);
    if own <= 1e4 * least {
        return false;
    }
    let mean = |i: usize| {
        if finite[i] { 0.5 * (all[i].0[0][channel] + all[i].0[1][channel]) } else { 0.0 }
    };
    own > 1e4 * around.median(variance) + 100.0 * around.median(mean).powi(2)
}

/// Means over the known ones of 3 x 3 pixels.
fn smoothed(values: &[f32], known: &[bool], width: usize, height: usize) -> Vec<f32> {
    (0..values.len())
        .into_par_iter()
        .map(|i| {
            let around = Around::new(i, width, height);
            let known = around.pixels().iter().filter(|i| known[**i]);
            let (sum, count) = known.fold((0.0, 0), |(sum, n), i| (sum + values[*i], n + 1));
            sum / count.max(1) as f32
        })
        .collect()
}
