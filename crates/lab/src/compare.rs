//! Error measures between a render and a reference.

use std::fmt;

use pileus_film::Image;
use serde::Serialize;

use crate::error::Error;
use crate::flip::flip;
use crate::pair::{Planes, check_size, finite, planes};

/// Added to the squared reference in [`Comparison::rel_mse`].
pub const REL_MSE_EPSILON: f64 = 0.01;
/// Side in pixels of the blocks that stand in for unknown variances.
pub const ERROR_BLOCK: u32 = 16;

/// What to measure, and with which noise.
#[derive(Clone, Copy, Debug)]
pub struct CompareSettings<'v> {
    /// Exposure of both images before FLIP, in stops.
    pub exposure_stops: f32,
    /// Whether to compute FLIP, by far the slowest of the measures.
    pub flip: bool,
    /// Variance of each mean in the first image; None takes its layer `variance`, if any.
    pub variance_a: Option<&'v Image>,
    /// Variance of each mean in the second image; None takes its layer `variance`, if any.
    pub variance_b: Option<&'v Image>,
}

impl Default for CompareSettings<'_> {
    /// FLIP at exposure 0, variances of the images' own layers.
    fn default() -> Self {
        Self { exposure_stops: 0.0, flip: true, variance_a: None, variance_b: None }
    }
}

/// How a render `a` differs from a reference `b`.
///
/// All figures but FLIP are of linear radiance, over R, G and B of all pixels that are finite in
/// both images.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Comparison {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixels left out because a value is infinite or NaN in one of the images.
    pub skipped_pixels: u64,
    /// Mean of (a - b)^2.
    pub mse: f64,
    /// Mean of (a - b)^2 / (b^2 + 0.01).
    pub rel_mse: f64,
    /// What the noise of `a` adds to `mse` in the mean: the average of its variances, if known.
    pub mse_noise_a: Option<f64>,
    /// What the noise of `b` adds to `mse` in the mean: the average of its variances, if known.
    pub mse_noise_b: Option<f64>,
    /// What the noise of `a` adds to `rel_mse` in the mean (to first order), if known.
    pub rel_mse_noise_a: Option<f64>,
    /// What the noise of `b` adds to `rel_mse` in the mean (to first order), if known;
    /// `rel_mse - rel_mse_noise_b` is the error against a noise-free reference.
    pub rel_mse_noise_b: Option<f64>,
    /// Mean of `a` per channel.
    pub mean_a: [f64; 3],
    /// Mean of `b` per channel.
    pub mean_b: [f64; 3],
    /// Standard error of `mean_a` from its variances, if known.
    pub stderr_a: Option<[f64; 3]>,
    /// Standard error of `mean_b` from its variances, if known.
    pub stderr_b: Option<[f64; 3]>,
    /// Mean of a - b per channel.
    pub mean_difference: [f64; 3],
    /// Standard error of `mean_difference`; infinite if nothing tells.
    pub stderr_difference: [f64; 3],
    /// Where `stderr_difference` comes from.
    pub stderr_source: ErrorSource,
    /// Largest |a - b|.
    pub max_difference: f64,
    /// Mean FLIP error in `[0, 1]`, if asked for.
    pub flip: Option<f64>,
    /// How both images were brought to display values for FLIP.
    pub flip_tone: Option<String>,
}

/// Origin of the standard error of a mean difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum ErrorSource {
    /// Variances of the pixels of both images.
    Variance,
    /// Spread of the mean differences of blocks of 16 x 16 pixels. Systematic differences that
    /// vary over the image count as noise here.
    Blocks,
}

/// Measures the difference of a render `a` from a reference `b` with default settings, see
/// [`compare_with`].
///
/// # Errors
/// Different sizes, no colour channels, no pixel that is finite in both.
pub fn compare(a: &Image, b: &Image) -> Result<Comparison, Error> {
    compare_with(a, b, &CompareSettings::default())
}

/// Measures the difference of a render `a` from a reference `b`.
///
/// A variance that is unknown in any compared pixel (infinite, NaN or negative) makes the noise
/// figures of that image unknown.
///
/// # Errors
/// Different sizes, no colour channels, no pixel that is finite in both.
pub fn compare_with(
    a: &Image,
    b: &Image,
    settings: &CompareSettings<'_>,
) -> Result<Comparison, Error> {
    check_size(a, b)?;
    let (pa, pb) = (planes(a, "first image")?, planes(b, "second image")?);
    let used: Vec<usize> =
        (0..a.pixel_count()).filter(|&i| finite(&pa, i) && finite(&pb, i)).collect();
    if used.is_empty() {
        return Err(Error::NoPixels);
    }
    let n = used.len() as f64;

    let (mut mse, mut rel_mse, mut max_difference) = (0.0, 0.0, 0.0f64);
    let [mut mean_a, mut mean_b, mut mean_difference] = [[0.0; 3]; 3];
    for &i in &used {
        for c in 0..3 {
            let (va, vb) = (f64::from(pa[c][i]), f64::from(pb[c][i]));
            let d = va - vb;
            mse += d * d;
            rel_mse += d * d / (vb * vb + REL_MSE_EPSILON);
            max_difference = max_difference.max(d.abs());
            mean_a[c] += va;
            mean_b[c] += vb;
            mean_difference[c] += d;
        }
    }
    for mean in [&mut mean_a, &mut mean_b, &mut mean_difference] {
        mean.iter_mut().for_each(|v| *v /= n);
    }

    let noise_a = noise(a, settings.variance_a, &pb, &used)?;
    let noise_b = noise(b, settings.variance_b, &pb, &used)?;
    let (stderr_difference, stderr_source) = match (&noise_a, &noise_b) {
        (Some(na), Some(nb)) => {
            let of_channel = |c: usize| na.stderr[c].hypot(nb.stderr[c]);
            (std::array::from_fn(of_channel), ErrorSource::Variance)
        }
        _ => (block_stderr(&pa, &pb, a.width(), a.height()), ErrorSource::Blocks),
    };
    let flip = settings.flip.then(|| flip(a, b, settings.exposure_stops)).transpose()?;
    let (flip, flip_tone) = flip.map(|f| (f.mean, f.tone)).unzip();

    Ok(Comparison {
        width: a.width(),
        height: a.height(),
        skipped_pixels: (a.pixel_count() - used.len()) as u64,
        mse: mse / (3.0 * n),
        rel_mse: rel_mse / (3.0 * n),
        mse_noise_a: noise_a.as_ref().map(|v| v.mse),
        mse_noise_b: noise_b.as_ref().map(|v| v.mse),
        rel_mse_noise_a: noise_a.as_ref().map(|v| v.rel_mse),
        rel_mse_noise_b: noise_b.as_ref().map(|v| v.rel_mse),
        mean_a,
        mean_b,
        stderr_a: noise_a.map(|v| v.stderr),
        stderr_b: noise_b.map(|v| v.stderr),
        mean_difference,
        stderr_difference,
        stderr_source,
        max_difference,
        flip,
        flip_tone,
    })
}

/// What the variances of one image amount to.
struct Noise {
    mse: f64,
    rel_mse: f64,
    stderr: [f64; 3],
}

fn noise(
    image: &Image,
    given: Option<&Image>,
    reference: &Planes<'_>,
    used: &[usize],
) -> Result<Option<Noise>, Error> {
    let layer;
    let variance = match given {
        Some(given) => {
            check_size(image, given)?;
            given
        }
        None => match image.layer("variance") {
            Some(own) => {
                layer = own;
                &layer
            }
            None => return Ok(None),
        },
    };
    let variance = planes(variance, "variance image")?;
    let (mut sum, mut rel_mse) = ([0.0; 3], 0.0);
    for &i in used {
        for c in 0..3 {
            let v = f64::from(variance[c][i]);
            if !(v.is_finite() && v >= 0.0) {
                return Ok(None);
            }
            let r = f64::from(reference[c][i]);
            sum[c] += v;
            rel_mse += v / (r * r + REL_MSE_EPSILON);
        }
    }
    let n = used.len() as f64;
    Ok(Some(Noise {
        mse: sum.iter().sum::<f64>() / (3.0 * n),
        rel_mse: rel_mse / (3.0 * n),
        stderr: sum.map(|v| v.sqrt() / n),
    }))
}

/// Standard error of the mean difference from the spread of block means.
///
/// Blocks count by their finite pixels, so that those at the edge and with gaps weigh less.
fn block_stderr(a: &Planes<'_>, b: &Planes<'_>, width: u32, height: u32) -> [f64; 3] {
    let columns = width.div_ceil(ERROR_BLOCK) as usize;
    let rows = height.div_ceil(ERROR_BLOCK) as usize;
    let mut blocks = vec![([0.0f64; 3], 0.0f64); columns * rows];
    for i in 0..a[0].len() {
        if !(finite(a, i) && finite(b, i)) {
            continue;
        }
        let (x, y) = (i % width as usize, i / width as usize);
        let block = y / ERROR_BLOCK as usize * columns + x / ERROR_BLOCK as usize;
        let (sum, count) = &mut blocks[block];
        for c in 0..3 {
            sum[c] += f64::from(a[c][i]) - f64::from(b[c][i]);
        }
        *count += 1.0;
    }
    let filled = blocks.iter().filter(|(_, count)| *count > 0.0).count() as f64;
    let total: f64 = blocks.iter().map(|(_, count)| count).sum();
    if filled < 2.0 {
        return [f64::INFINITY; 3];
    }
    std::array::from_fn(|c| {
        let mean = blocks.iter().map(|(sum, _)| sum[c]).sum::<f64>() / total;
        // Ratio estimator: residuals of the block sums.
        let spread: f64 = blocks.iter().map(|(sum, n)| (sum[c] - n * mean).powi(2)).sum();
        (spread * filled / (filled - 1.0)).sqrt() / total
    })
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let triple = |v: &[f64; 3]| format!("{:.6e} {:.6e} {:.6e}", v[0], v[1], v[2]);
        let with_error = |mean: &[f64; 3], stderr: &Option<[f64; 3]>| match stderr {
            Some(e) => format!("{}  +- {}", triple(mean), triple(e)),
            None => triple(mean),
        };
        let noise = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{v:.6e}"));
        writeln!(f, "size        {} x {}", self.width, self.height)?;
        if self.skipped_pixels > 0 {
            writeln!(f, "skipped     {} pixels that are not finite", self.skipped_pixels)?;
        }
        writeln!(
            f,
            "MSE         {:.6e}  (noise of A {}, of B {})",
            self.mse,
            noise(self.mse_noise_a),
            noise(self.mse_noise_b)
        )?;
        writeln!(
            f,
            "relMSE      {:.6e}  (noise of A {}, of B {})",
            self.rel_mse,
            noise(self.rel_mse_noise_a),
            noise(self.rel_mse_noise_b)
        )?;
        writeln!(f, "max |A-B|   {:.6e}", self.max_difference)?;
        writeln!(f, "mean A      {}", with_error(&self.mean_a, &self.stderr_a))?;
        writeln!(f, "mean B      {}", with_error(&self.mean_b, &self.stderr_b))?;
        let source = match self.stderr_source {
            ErrorSource::Variance => "pixel variances",
            ErrorSource::Blocks => "16 x 16 blocks",
        };
        write!(
            f,
            "mean A-B    {}  (errors from {source})",
            with_error(&self.mean_difference, &Some(self.stderr_difference))
        )?;
        if let (Some(flip), Some(tone)) = (self.flip, &self.flip_tone) {
            write!(f, "\nFLIP        {flip:.6}  ({tone})")?;
        }
        Ok(())
    }
}
