//! Is the difference of two images noise? A Z-test on blocks of pixels.

use pileus_film::Image;
use serde::Serialize;
use statrs::function::erf::erfc;
use statrs::function::gamma::gamma_ur;

use crate::error::Error;
use crate::pair::{check_size, finite, planes};

/// The result of [`block_z_test`].
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BlockZ {
    /// Columns and rows of blocks.
    pub blocks: [u32; 2],
    /// Difference of the block means over its standard error: all blocks of R row by row, then of
    /// G, then of B. NaN for a block without usable pixels.
    pub z: Vec<f64>,
    /// Largest |z|.
    pub max_abs_z: f64,
    /// Sum of z^2 per channel; under the null hypothesis chi-square with `dof` degrees of freedom.
    pub chi2: [f64; 3],
    /// Usable blocks per channel.
    pub dof: [u64; 3],
    /// Probability of a `max_abs_z` at least as large by noise alone, times the number of blocks
    /// and channels (Bonferroni), at most 1.
    pub p_max: f64,
    /// Probability of each `chi2` at least as large by noise alone.
    pub p_chi2: [f64; 3],
    /// The smallest of `p_max` and the three `p_chi2`, times four (Bonferroni), at most 1: a bound
    /// on the probability of such a result by noise alone. It holds for channels that share their
    /// paths and are correlated, too.
    pub p_value: f64,
    /// Pixels left out: not finite, or of unknown variance in one of the images.
    pub skipped_pixels: u64,
}

/// Tests whether `a` and `b` have the same expectation, given the variance of each pixel's mean.
///
/// Null hypothesis: all pixels have equal expectations, are independent, and `block` x `block` of
/// them (less at the right and lower edge) make a normal mean. The alternative is a difference
/// anywhere; `max_abs_z` sees a strong one in a block, `chi2` a weak one in many.
///
/// Variances count as known. Where they are estimated from few samples, or from samples with heavy
/// tails, the statistic is wider than the normal and p-values are too small: use at least 64
/// samples a pixel and blocks of 16 or more. Blocks in which every variance is zero are
/// usable if the means agree exactly (z = 0); else z is infinite.
///
/// # Errors
/// Different sizes, no colour channels, a zero block, or no usable block.
pub fn block_z_test(
    a: &Image,
    variance_a: &Image,
    b: &Image,
    variance_b: &Image,
    block: usize,
) -> Result<BlockZ, Error> {
    for other in [variance_a, b, variance_b] {
        check_size(a, other)?;
    }
    if block == 0 {
        return Err(Error::Argument {
            what: "blocks of 0 pixels".into(),
            remedy: "give at least 1, better 16",
        });
    }
    let (pa, pb) = (planes(a, "first image")?, planes(b, "second image")?);
    let (va, vb) = (planes(variance_a, "first variance")?, planes(variance_b, "second variance")?);

    let (width, height) = (a.width() as usize, a.height() as usize);
    let (columns, rows) = (width.div_ceil(block), height.div_ceil(block));
    let count = columns * rows;
    // Per channel and block: difference of sums, variance of it, pixels.
    let mut sums = vec![(0.0f64, 0.0f64, 0u64); 3 * count];
    let mut skipped_pixels = 0;
    for i in 0..a.pixel_count() {
        let known = |v: &[&[f32]; 3]| finite(v, i) && v.iter().all(|plane| plane[i] >= 0.0);
        if !(finite(&pa, i) && finite(&pb, i) && known(&va) && known(&vb)) {
            skipped_pixels += 1;
            continue;
        }
        let place = i / width / block * columns + i % width / block;
        for c in 0..3 {
            let (difference, variance, pixels) = &mut sums[c * count + place];
            *difference += f64::from(pa[c][i]) - f64::from(pb[c][i]);
            *variance += f64::from(va[c][i]) + f64::from(vb[c][i]);
            *pixels += 1;
        }
    }
    let z: Vec<f64> = sums
        .into_iter()
        .map(|(difference, variance, pixels)| match pixels {
            0 => f64::NAN,
            _ if difference == 0.0 => 0.0,
            _ => difference / variance.sqrt(),
        })
        .collect();

    let mut result = BlockZ {
        blocks: [columns as u32, rows as u32],
        max_abs_z: 0.0,
        chi2: [0.0; 3],
        dof: [0; 3],
        p_max: 1.0,
        p_chi2: [1.0; 3],
        p_value: 1.0,
        skipped_pixels,
        z,
    };
    for (c, of_channel) in result.z.chunks(count).enumerate() {
        for z in of_channel.iter().filter(|z| !z.is_nan()) {
            result.max_abs_z = result.max_abs_z.max(z.abs());
            result.chi2[c] += z * z;
            result.dof[c] += 1;
        }
    }
    let tests: u64 = result.dof.iter().sum();
    if tests == 0 {
        return Err(Error::NoVariance);
    }
    result.p_max = (tests as f64 * two_sided(result.max_abs_z)).min(1.0);
    result.p_chi2 = std::array::from_fn(|c| chi2_tail(result.chi2[c], result.dof[c]));
    let smallest = result.p_chi2.iter().fold(result.p_max, |p, q| p.min(*q));
    result.p_value = (4.0 * smallest).min(1.0);
    Ok(result)
}

/// Probability of a standard normal variable beyond plus or minus `z`.
fn two_sided(z: f64) -> f64 {
    if z.is_infinite() { 0.0 } else { erfc(z / std::f64::consts::SQRT_2) }
}

/// Probability of a chi-square variable above `chi2`.
fn chi2_tail(chi2: f64, dof: u64) -> f64 {
    if dof == 0 || chi2 <= 0.0 {
        1.0
    } else if chi2.is_infinite() {
        0.0
    } else {
        gamma_ur(0.5 * dof as f64, 0.5 * chi2)
    }
}
