//! PNG previews.

use std::io;
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};

use crate::atomic::write_atomically;
use crate::error::Error;
use crate::image::Image;
use crate::tone::ToneMap;

/// The image on an sRGB display: 3 bytes a pixel, row by row from the top.
///
/// Alpha is ignored, since colour is multiplied by it already: what shows is the render over black,
/// or over its own background.
///
/// # Errors
/// [`Error::Invalid`] if the image has neither R, G, B nor Y.
pub fn preview_rgb8(image: &Image, tone: &ToneMap) -> Result<Vec<u8>, Error> {
    let Some([r, g, b]) = image.rgb_planes() else {
        let names: Vec<_> = image.channels().iter().map(|c| c.name.as_str()).collect();
        return Err(Error::invalid(
            "image",
            format!("it has neither R, G, B nor Y; its channels are {}", names.join(", ")),
            "rename the channels to show",
        ));
    };
    let mut bytes = Vec::with_capacity(3 * image.pixel_count());
    for ((&r, &g), &b) in r.iter().zip(g).zip(b) {
        bytes.extend_from_slice(&tone.apply_rgb8([r, g, b]));
    }
    Ok(bytes)
}

/// Writes an 8-bit sRGB preview, beside the target and renamed.
///
/// # Errors
/// As [`preview_rgb8`] and [`write_atomically`].
pub fn write_png(path: &Path, image: &Image, tone: &ToneMap) -> Result<(), Error> {
    let bytes = preview_rgb8(image, tone).map_err(|e| e.in_file(path))?;
    write_atomically(path, |writer| {
        PngEncoder::new_with_quality(writer, CompressionType::Default, FilterType::Adaptive)
            .write_image(&bytes, image.width(), image.height(), ExtendedColorType::Rgb8)
            .map_err(io::Error::other)
    })
}
