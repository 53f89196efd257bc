//! FLIP, a perceptual difference of two displayed images.

use std::f64::consts::{PI, SQRT_2};

use pileus_film::{Curve, Image, ToneMap, preview_rgb8};
use rayon::prelude::*;

use crate::error::Error;
use crate::pair::{check_size, planes};

/// Pixels per degree of the visual field where nothing is said: a screen 0.7 m wide of 3840 pixels,
/// seen from 0.7 m.
const PIXELS_PER_DEGREE: f64 = 67.0;

/// The result of [`flip`].
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Mean error in `[0, 1]`; 0 for equal images.
    pub mean: f64,
    /// Error of each pixel in `[0, 1]`, as channel Y.
    pub map: Image,
    /// How the images were brought to display values, in words.
    pub tone: String,
}

/// Mean error and error map of LDR-FLIP of a render `a` against a reference `b`.
///
/// The metric is defined on display values. Both images get the same exposure, are clipped to
/// `[0, 1]` and encoded as sRGB with 8 bits: differences above the clipping point do not count.
/// Viewing distance is the authors' default, 67 pixels per degree. Source: Andersson et al., "FLIP:
/// A Difference Evaluator for Alternating Images", 2020.
///
/// # Errors
/// Different sizes, no colour channels, or more than 2^28 pixels.
pub fn flip(a: &Image, b: &Image, exposure_stops: f32) -> Result<Flip, Error> {
    check_size(a, b)?;
    planes(a, "first image")?;
    planes(b, "second image")?;
    if a.pixel_count() > 1 << 28 {
        return Err(Error::Argument {
            what: format!("{} pixels are more than FLIP takes, 2^28", a.pixel_count()),
            remedy: "compare crop windows",
        });
    }
    let tone = ToneMap { exposure_stops, curve: Curve::Srgb };
    let map = flip_rgb8(&preview_rgb8(a, &tone)?, &preview_rgb8(b, &tone)?, a.width() as usize);
    let mean = map.iter().map(|&v| f64::from(v)).sum::<f64>() / map.len().max(1) as f64;
    let mut image = Image::without_channels(a.data_window())?;
    image.add_channel("Y", map)?;
    let tone = format!(
        "both images: exposure {exposure_stops:+} stops, clipped at 1, sRGB, 8 bits; \
         {PIXELS_PER_DEGREE:.0} pixels per degree"
    );
    Ok(Flip { mean, map: image, tone })
}

/// The error of each pixel in `[0, 1]` of two sRGB images of equal size, 3 bytes a pixel.
/// Symmetric.
pub fn flip_rgb8(a: &[u8], b: &[u8], width: usize) -> Vec<f32> {
    let [a, b] = [a, b].map(|bytes| Seen::new(bytes, width));
    let largest = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(COLOR_EXPONENT);
    let pixels = a.color.par_iter().zip(&b.color).zip(a.features.par_iter().zip(&b.features));
    pixels
        .map(|((color_a, color_b), (features_a, features_b))| {
            let color = spread(hyab(*color_a, *color_b).powf(COLOR_EXPONENT), largest);
            let edge = (features_a[0] - features_b[0]).abs();
            let point = (features_a[1] - features_b[1]).abs();
            let feature = (edge.max(point) / SQRT_2).powf(FEATURE_EXPONENT);
            color.powf(1.0 - feature) as f32
        })
        .collect()
}

/// Exponent of colour differences.
const COLOR_EXPONENT: f64 = 0.7;
/// Exponent of differences of features.
const FEATURE_EXPONENT: f64 = 0.5;
/// Share of the largest colour difference up to which differences are spread over
/// [`LOWER_RANGE`] of the scale.
const LOWER_SHARE: f64 = 0.4;
/// Part of the scale that colour differences up to [`LOWER_SHARE`] of the largest are spread over.
const LOWER_RANGE: f64 = 0.95;
/// Width of the filters of features, degrees.
const FEATURE_WIDTH: f64 = 0.082;

/// Colour differences on a scale from 0 to 1, most of which goes to what is common.
fn spread(difference: f64, largest: f64) -> f64 {
    let border = LOWER_SHARE * largest;
    if difference < border {
        difference * LOWER_RANGE / border
    } else {
        LOWER_RANGE + (difference - border) / (largest - border) * (1.0 - LOWER_RANGE)
    }
}

/// What an eye makes of an image.
struct Seen {
    /// Colours after the eye's blur, CIELAB with Hunt's effect.
    color: Vec<[f64; 3]>,
    /// Strength of edges and of points in brightness.
    features: Vec<[f64; 2]>,
}

impl Seen {
    fn new(rgb8: &[u8], width: usize) -> Self {
        let opponents: Vec<[f64; 3]> = rgb8
            .par_chunks_exact(3)
            .map(|pixel| {
                let channel = |i: usize| linear(f64::from(pixel.get(i).copied().unwrap_or(0)));
                opponent(to_xyz([channel(0), channel(1), channel(2)]))
            })
            .collect();
        let plane = |i: usize| -> Vec<f64> { opponents.iter().map(|p| p[i]).collect() };
        let [brightness, red_green, blue_yellow] = [0, 1, 2].map(plane);

        // Contrast sensitivity: Gaussians of (weight, squared width), of blue and yellow two.
        let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
        let bell = |b: f64| -> Vec<f64> {
            let at = |i: i32| (-(PI * f64::from(i) / PIXELS_PER_DEGREE).powi(2) / b).exp();
            (-radius..=radius).map(at).collect()
        };
        let blurred = |plane: &[f64], b: f64| {
            let kernel = normalised(&bell(b));
            convolve(plane, width, &kernel, &kernel)
        };
        let (narrow, wide) = ((34.1, 0.04), (13.5, 0.025));
        let volume = |(a, b): (f64, f64)| a * (PI / b).sqrt() * bell(b).iter().sum::<f64>().powi(2);
        let share = volume(narrow) / (volume(narrow) + volume(wide));
        let seen_y = blurred(&brightness, 0.0047);
        let seen_x = blurred(&red_green, 0.0053);
        let [seen_z, far_z] = [narrow, wide].map(|(_, b)| blurred(&blue_yellow, b));
        let color = (0..opponents.len())
            .into_par_iter()
            .map(|i| {
                let z = share * seen_z[i] + (1.0 - share) * far_z[i];
                let rgb = to_rgb(from_opponent([seen_y[i], seen_x[i], z]));
                hunt_lab(rgb.map(|v| v.clamp(0.0, 1.0)))
            })
            .collect();

        // Edges and points: first and second derivatives of a Gaussian.
        let sigma = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * sigma).ceil() as i32;
        let kernel = |weight: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let gauss = |x: f64| (-x * x / (2.0 * sigma * sigma)).exp();
            (-radius..=radius).map(|i| weight(f64::from(i)) * gauss(f64::from(i))).collect()
        };
        let across = normalised(&kernel(&|_| 1.0));
        let edge = normalised(&kernel(&|x| -x));
        let point = normalised(&kernel(&|x| x * x / (sigma * sigma) - 1.0));
        let brightness: Vec<f64> = brightness.iter().map(|y| (y + 16.0) / 116.0).collect();
        let strength = |along: &[f64]| -> Vec<f64> {
            let by_x = convolve(&brightness, width, along, &across);
            let by_y = convolve(&brightness, width, &across, along);
            by_x.iter().zip(&by_y).map(|(x, y)| x.hypot(*y)).collect()
        };
        let (edges, points) = (strength(&edge), strength(&point));
        let features = edges.iter().zip(&points).map(|(e, p)| [*e, *p]).collect();
        Self { color, features }
    }
}

/// Positive weights add up to 1, and negative ones to -1.
fn normalised(kernel: &[f64]) -> Vec<f64> {
    let sum = |sign: f64| -> f64 { kernel.iter().map(|w| (w * sign).max(0.0)).sum() };
    let (positive, negative) = (sum(1.0), sum(-1.0));
    kernel
        .iter()
        .map(|&w| {
            if w > 0.0 {
                w / positive
            } else if w < 0.0 {
                w / negative
            } else {
                0.0
            }
        })
        .collect()
}

/// Convolution with the product of two kernels of odd length; the border's pixels go on beyond it.
fn convolve(plane: &[f64], width: usize, along_x: &[f64], along_y: &[f64]) -> Vec<f64> {
    if plane.is_empty() || width == 0 {
        return Vec::new();
    }
    let height = plane.len() / width;
    let near = |at: usize, offset: usize, kernel: &[f64], count: usize| {
        (at + offset).saturating_sub(kernel.len() / 2).min(count - 1)
    };
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            let weighted = along_x.iter().enumerate();
            *out = weighted.map(|(i, weight)| weight * row[near(x, i, along_x, width)]).sum();
        }
    });
    let mut both = vec![0.0; plane.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (i, weight) in along_y.iter().enumerate() {
            let start = near(y, i, along_y, height) * width;
            for (out, value) in out.iter_mut().zip(&rows[start..start + width]) {
                *out += weight * value;
            }
        }
    });
    both
}

/// Linear value of an sRGB byte.
fn linear(byte: f64) -> f64 {
    let value = byte / 255.0;
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// White of D65, to which colours are relative.
const WHITE: [f64; 3] = [0.950_428_545, 1.0, 1.088_900_371];

/// Rec. 709 to CIE XYZ relative to white.
fn to_xyz([r, g, b]: [f64; 3]) -> [f64; 3] {
    let x = (10_135_552.0 * r + 8_788_810.0 * g + 4_435_075.0 * b) / 24_577_794.0;
    let y = (2_613_072.0 * r + 8_788_810.0 * g + 887_015.0 * b) / 12_288_897.0;
    let z = (1_425_312.0 * r + 8_788_810.0 * g + 70_074_185.0 * b) / 73_733_382.0;
    [x / WHITE[0], y / WHITE[1], z / WHITE[2]]
}

/// The inverse of [`to_xyz`].
fn to_rgb(relative: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = [0, 1, 2].map(|i| relative[i] * WHITE[i]);
    [
        3.241_003_275 * x - 1.537_398_934 * y - 0.498_615_861 * z,
        -0.969_224_334 * x + 1.875_930_071 * y + 0.041_554_224 * z,
        0.055_639_423 * x - 0.204_011_202 * y + 1.057_148_933 * z,
    ]
}

/// The linear relative of CIELAB in which the eye's blur is described: brightness, red against
/// green, yellow against blue.
fn opponent([x, y, z]: [f64; 3]) -> [f64; 3] {
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn from_opponent([brightness, red_green, blue_yellow]: [f64; 3]) -> [f64; 3] {
    let y = (brightness + 16.0) / 116.0;
    [y + red_green / 500.0, y, y - blue_yellow / 200.0]
}

/// CIELAB of a linear colour, with Hunt's effect: what is dark looks less colourful.
fn hunt_lab(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let curve = |t: f64| {
        if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [l, a, b] = opponent(to_xyz(rgb).map(curve));
    [l, 0.01 * l * a, 0.01 * l * b]
}

/// Distance of two colours that are far apart (Abasi et al. 2020).
fn hyab(p: [f64; 3], q: [f64; 3]) -> f64 {
    (p[0] - q[0]).abs() + (p[1] - q[1]).hypot(p[2] - q[2])
}
