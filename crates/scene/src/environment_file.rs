//! Environment images from files.

use std::io::{BufReader, Cursor};
use std::path::Path;

use crate::environment::{EnvironmentImage, MAX_TEXELS};
use crate::error::{Error, Place};

/// Largest environment image file in bytes.
const MAX_FILE: u64 = 4 << 30;

impl EnvironmentImage {
    /// Reads a latitude-longitude image: OpenEXR with channels R, G, B, or Radiance .hdr.
    ///
    /// Values that are negative or not finite count as 0; how many is said in the log. For
    /// `intensity` and `rotation_y_degrees` see [`EnvironmentImage::new`].
    pub fn open(
        path: impl AsRef<Path>,
        intensity: f32,
        rotation_y_degrees: f64,
    ) -> Result<Self, Error> {
        let path = path.as_ref();
        let place = Place::file(path);
        let io = |source| Error::io(place.clone(), source);
        let length = std::fs::metadata(path).map_err(io)?.len();
        if length > MAX_FILE {
            return Err(Error::unsupported(
                place,
                format!("{length} bytes"),
                "use a smaller image",
            ));
        }
        let bytes = crate::file::read(path, MAX_FILE).map_err(io)?;
        let (width, height, mut texels) = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            read_exr(&bytes, &place)?
        } else if bytes.starts_with(b"#?") {
            read_hdr(&bytes, &place)?
        } else {
            return Err(Error::unsupported(
                place,
                "this is neither OpenEXR nor Radiance .hdr",
                "convert the image to .exr or .hdr",
            ));
        };
        let mut replaced = 0u64;
        for value in texels.iter_mut().flatten() {
            if !(*value >= 0.0 && value.is_finite()) {
                *value = 0.0;
                replaced += 1;
            }
        }
        if replaced > 0 {
            tracing::warn!(
                "{}: {replaced} values are negative or not finite and count as 0",
                path.display()
            );
        }
        Self::new(width, height, texels, intensity, rotation_y_degrees).map_err(|error| match error
        {
            Error::Invalid { what, remedy, .. } => Error::invalid(place, what, remedy),
            other => other,
        })
    }
}

type Texels = (usize, usize, Vec<[f32; 3]>);

fn check_size(width: usize, height: usize, place: &Place) -> Result<(), Error> {
    if width.checked_mul(height).is_some_and(|n| n <= MAX_TEXELS) {
        return Ok(());
    }
    Err(Error::unsupported(
        place.clone(),
        format!("the image has {width} x {height} texels"),
        "scale it down: up to 2^27 texels are read",
    ))
}

fn read_exr(bytes: &[u8], place: &Place) -> Result<Texels, Error> {
    use exr::prelude::*;
    let failed = |error: exr::error::Error| {
        crate::Error::invalid(
            place.clone(),
            format!("the OpenEXR image cannot be read: {error}"),
            "it must be flat and have channels R, G and B",
        )
    };
    // Sizes first, so that a damaged header cannot ask for any amount of memory.
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(failed)?;
    for header in &meta.headers {
        check_size(header.layer_size.width(), header.layer_size.height(), place)?;
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size: Vec2<usize>, _: &RgbaChannels| (size.width(), vec![[0f32; 3]; size.area()]),
            |(width, texels): &mut (usize, Vec<[f32; 3]>),
             at: Vec2<usize>,
             (r, g, b, _): (f32, f32, f32, f32)| {
                if let Some(texel) = texels.get_mut(at.y() * *width + at.x()) {
                    *texel = [r, g, b];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(failed)?;
    let size = image.layer_data.size;
    Ok((size.width(), size.height(), image.layer_data.channel_data.pixels.1))
}

fn read_hdr(bytes: &[u8], place: &Place) -> Result<Texels, Error> {
    use image::ImageDecoder;
    let failed = |error: image::ImageError| {
        Error::invalid(
            place.clone(),
            format!("the Radiance image cannot be read: {error}"),
            "write it again, or convert it to .exr",
        )
    };
    let decoder =
        image::codecs::hdr::HdrDecoder::new(BufReader::new(Cursor::new(bytes))).map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    check_size(width, height, place)?;
    let image = image::DynamicImage::from_decoder(decoder).map_err(failed)?.into_rgb32f();
    Ok((width, height, image.pixels().map(|pixel| pixel.0).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn folder() -> tempfile::TempDir {
        tempfile::tempdir().unwrap()
    }

    /// A picture whose middle column is red and whose top row is blue.
    fn texel(x: usize, y: usize) -> [f32; 3] {
        [if x / 2 == 2 { 2.0 } else { 0.0 }, 0.25, if y == 0 { 4.0 } else { 0.0 }]
    }

    #[test]
    fn exr_and_hdr_give_the_same_picture() {
        let folder = folder();
        let exr = folder.path().join("a.exr");
        exr::prelude::write_rgb_file(&exr, 10, 5, |x, y| texel(x, y).into()).unwrap();
        let hdr = folder.path().join("a.hdr");
        let pixels: Vec<_> = (0..50).map(|i| image::Rgb(texel(i % 10, i / 10))).collect();
        let file = std::fs::File::create(&hdr).unwrap();
        image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 10, 5).unwrap();
        let [exr, hdr] = [exr, hdr].map(|p| EnvironmentImage::open(p, 3.0, 0.0).unwrap());
        for d in [Vec3::NEG_Z, Vec3::X, Vec3::Y, Vec3::new(-0.3, 0.2, -0.6).normalize()] {
            assert!((exr.radiance(d) - hdr.radiance(d)).length() < 0.02);
        }
        assert_eq!(exr.radiance(Vec3::Y).z, 12.0);
        assert_eq!(exr.radiance(Vec3::NEG_Z).x, 6.0);
    }

    #[test]
    fn damaged_files_are_errors() {
        let folder = folder();
        let path = folder.path().join("a.exr");
        exr::prelude::write_rgb_file(&path, 16, 8, |x, y| texel(x, y).into()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(EnvironmentImage::open(&path, 1.0, 0.0).is_err(), "{length}");
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x55;
            std::fs::write(&path, &bytes).unwrap();
            // Any result will do, but no panic and no endless allocation.
            let _ = EnvironmentImage::open(&path, 1.0, 0.0);
        }
        std::fs::write(&path, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999999 +X 99999999\n")
            .unwrap();
        assert!(EnvironmentImage::open(&path, 1.0, 0.0).is_err());
        std::fs::write(&path, b"\x89PNG").unwrap();
        assert!(matches!(EnvironmentImage::open(&path, 1.0, 0.0), Err(Error::Unsupported { .. })));
        assert!(matches!(
            EnvironmentImage::open(folder.path().join("b"), 1.0, 0.0),
            Err(Error::Io { .. })
        ));
    }
}
