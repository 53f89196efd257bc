//! FLIP, a perceptual difference of two displayed images.

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool};
use pileus_film::{Curve, Image, ToneMap, preview_rgb8};

use crate::error::Error;
use crate::pair::{check_size, planes};

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
/// A Difference Evaluator for Alternating Images", 2020; computed by their C++ code.
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
    let displayed = |image: &Image| -> Result<FlipImageRgb8, Error> {
        let bytes = preview_rgb8(image, &tone)?;
        Ok(FlipImageRgb8::with_data(image.width(), image.height(), &bytes))
    };
    let map = nv_flip::flip(displayed(b)?, displayed(a)?, DEFAULT_PIXELS_PER_DEGREE);
    let mean = f64::from(FlipPool::from_image(&map).mean());
    let mut image = Image::without_channels(a.data_window())?;
    image.add_channel("Y", map.to_vec())?;
    let tone = format!(
        "both images: exposure {exposure_stops:+} stops, clipped at 1, sRGB, 8 bits; \
         {DEFAULT_PIXELS_PER_DEGREE:.0} pixels per degree"
    );
    Ok(Flip { mean, map: image, tone })
}
