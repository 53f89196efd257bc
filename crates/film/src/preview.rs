//! PNG previews.

use std::io;
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

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
/// [`Error::Invalid`] if no channels are known to be the image's colour.
pub fn preview_rgb8(image: &Image, tone: &ToneMap) -> Result<Vec<u8>, Error> {
    let Some([r, g, b]) = image.rgb_planes() else {
        let names: Vec<_> = image.channels().iter().map(|c| c.name.as_str()).collect();
        return Err(Error::invalid(
            "image",
            format!(
                "it has no colour that is known by name; its channels are {}",
                names.join(", ")
            ),
            "rename the channels to show to R, G and B, or Y",
        ));
    };
    let mut bytes = vec![0; 3 * image.pixel_count()];
    let colors = (r.par_iter(), g.par_iter(), b.par_iter()).into_par_iter();
    bytes.par_chunks_exact_mut(3).zip(colors).with_min_len(1024).for_each(
        |(bytes, (&r, &g, &b))| {
            bytes.copy_from_slice(&tone.apply_rgb8([r, g, b]));
        },
    );
    Ok(bytes)
}

/// Writes an 8-bit sRGB preview, beside the target and renamed.
///
/// # Errors
/// [`Error::Invalid`] if no channels are known to be the image's colour, or `path` does not end in
/// a file name; [`Error::Io`] if the file cannot be written.
pub fn write_png(path: &Path, image: &Image, tone: &ToneMap) -> Result<(), Error> {
    let bytes = preview_rgb8(image, tone).map_err(|e| e.in_file(path))?;
    write_atomically(path, |writer| encode(writer, &bytes, image.width(), image.height()))
}

/// The bytes of a PNG file of `rgb8`, 3 bytes a pixel, row by row from the top.
///
/// # Errors
/// [`Error::Invalid`] if there are not `3 x width x height` bytes.
pub fn png_bytes(rgb8: &[u8], width: u32, height: u32) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let wrong = || {
        let what = format!("{} bytes for {width} x {height} pixels of 3", rgb8.len());
        Error::invalid("image", what, "give one byte per channel and pixel")
    };
    if rgb8.len() as u64 != 3 * u64::from(width) * u64::from(height) {
        return Err(wrong());
    }
    encode(&mut bytes, rgb8, width, height).map_err(|_| wrong())?;
    Ok(bytes)
}

fn encode(writer: impl io::Write, rgb8: &[u8], width: u32, height: u32) -> io::Result<()> {
    PngEncoder::new_with_quality(writer, CompressionType::Default, FilterType::Adaptive)
        .write_image(rgb8, width, height, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)
}
