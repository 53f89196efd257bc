//! Environment images from files.

use std::path::Path;

use pileus_film::{ColorSpace, ExrPart, Window, read_exr_color};

use super::environment::{EnvironmentImage, MAX_TEXELS};
use super::radiance_hdr;
use crate::error::{Error, Place};

/// Largest environment image file in bytes.
const MAX_FILE: u64 = 4 << 30;
/// Texels of a picture that may be black for want of pixels in the file, whatever its size.
const MAX_BLACK: u64 = 1 << 25;

impl EnvironmentImage {
    /// Reads a latitude-longitude image: OpenEXR or Radiance .hdr.
    ///
    /// Of an OpenEXR file the colour is found by the names of its channels
    /// ([`pileus_film::color_channels`]), grey images included. Colours are converted to linear
    /// Rec. 709 from the space that `colorInteropID`, `chromaticities` or Radiance's PRIMARIES
    /// name, white adapted to D65 by Bradford's transform. The display window is the whole sphere:
    /// what lies outside of the data window is black. Radiance's EXPOSURE and COLORCORR are
    /// divided out. Each of these is said in the log.
    ///
    /// Values that are negative or not finite count as 0; how many is said in the log. For
    /// `intensity` and `rotation_y_degrees` see [`EnvironmentImage::new`].
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Invalid`] for damaged files; [`Error::Unsupported`] for other
    /// formats, compressions that are not read, faces of a cube, deep pixels, luminance with
    /// chroma, channels that are no colour, more than 2^27 texels.
    pub fn open(
        path: impl AsRef<Path>,
        intensity: f32,
        rotation_y_degrees: f64,
    ) -> Result<Self, Error> {
        let path = path.as_ref();
        let place = Place::file(path);
        let io = |source| Error::io(place.clone(), source);
        let meta = std::fs::metadata(path).map_err(io)?;
        if !meta.is_file() {
            return Err(Error::invalid(place, "it is no plain file", "give an image file"));
        }
        if meta.len() > MAX_FILE {
            return Err(Error::unsupported(
                place,
                format!("{} bytes", meta.len()),
                "use a smaller image",
            ));
        }
        let start = crate::file::read(path, 64).map_err(io)?;
        let read = if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            read_exr(path, &place)?
        } else if radiance_hdr::is_radiance(&start) {
            read_hdr(&crate::file::read(path, MAX_FILE).map_err(io)?, &place)?
        } else {
            return Err(Error::unsupported(
                place,
                format!("this is neither OpenEXR nor Radiance .hdr{}", what_it_is(&start)),
                "convert the image to .exr or .hdr",
            ));
        };
        let SphereImage { width, height, mut texels, remarks } = read;
        for remark in remarks {
            tracing::warn!("{}: {remark}", path.display());
        }
        let mut replaced = 0u64;
        for value in texels.iter_mut().flatten() {
            if !(*value >= 0.0 && value.is_finite()) {
                *value = 0.0;
                replaced += 1;
            }
        }
        if replaced > 0 {
            tracing::warn!(
                "{}: {replaced} values are negative or not finite in linear Rec. 709 and count as 0",
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

/// An image of the whole sphere in linear Rec. 709, and what to say about it.
struct SphereImage {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
    remarks: Vec<String>,
}

/// Names what a file is, for those that are taken for images of the environment.
fn what_it_is(start: &[u8]) -> &'static str {
    let known: [(&[u8], &str); 9] = [
        (b"\x89PNG", ": it is a PNG, whose values are no radiance"),
        (b"\xff\xd8\xff", ": it is a JPEG, whose values are no radiance"),
        (b"II*\0", ": it is a TIFF"),
        (b"MM\0*", ": it is a TIFF"),
        (b"PF", ": it is a portable float map"),
        (b"\x1f\x8b", ": it is packed by gzip"),
        (b"version https://git-lfs", ": it is a pointer of git-lfs (run `git lfs pull`)"),
        (b"<", ": it is a text, perhaps a web page saved in place of the image"),
        (b"PK\x03\x04", ": it is a zip archive"),
    ];
    if start.is_empty() {
        return ": it is empty";
    }
    known.iter().find(|(magic, _)| start.starts_with(magic)).map_or("", |(_, name)| name)
}

fn check_size(width: u64, height: u64, place: &Place) -> Result<(), Error> {
    if width.checked_mul(height).is_some_and(|n| n <= MAX_TEXELS as u64) {
        return Ok(());
    }
    Err(Error::unsupported(
        place.clone(),
        format!("the image has {width} x {height} texels"),
        "scale it down: up to 2^27 texels are read",
    ))
}

fn read_exr(path: &Path, place: &Place) -> Result<SphereImage, Error> {
    let failed = |error: pileus_film::Error| {
        use pileus_film::Error as Film;
        let place = place.clone();
        match error {
            Film::Io { source, .. } => Error::io(place, source),
            Film::Missing { .. } => Error::io(place, std::io::ErrorKind::NotFound.into()),
            Film::Unsupported { problem, remedy, .. } => {
                Error::unsupported(place, format!("{problem} is not supported"), remedy)
            }
            Film::TooLarge { problem, remedy, .. } => Error::unsupported(place, problem, remedy),
            Film::Invalid { problem, remedy, .. } => Error::invalid(
                place,
                format!("the OpenEXR image cannot be read: {problem}"),
                remedy,
            ),
            other => Error::invalid(place, other.to_string(), "copy or write it anew"),
        }
    };
    // What the header says goes before pixels, which may take gigabytes.
    let header = pileus_film::read_exr_header(path).map_err(failed)?;
    if let Some(part) = header.color().and_then(|(part, _)| header.parts.get(part)) {
        if part.cube_map {
            return Err(Error::unsupported(
                place.clone(),
                "the image holds the six faces of a cube (envmap: cube)",
                "convert it to latitude and longitude, for instance by `exrenvmap -li`",
            ));
        }
        for window in [part.data_window, part.display_window] {
            check_size(u64::from(window.width), u64::from(window.height), place)?;
        }
    }
    let (header, part, mut texels) = read_exr_color(path).map_err(failed)?;
    let mut remarks = Vec::new();
    // Beside channels without a layer others, such as variances, are not taken for the picture.
    if let Some((_, found)) = header.color()
        && let Some(layer) = found.layer
        && !found.others.is_empty()
    {
        let others = found.others.iter().take(8).map(|name| name.escape_debug().to_string());
        remarks.push(format!(
            "its colours are those of the layer {}; there are also {}",
            layer.escape_debug(),
            others.collect::<Vec<_>>().join(", ")
        ));
    }
    let file_length = header.file_length;
    let part = &header.parts[part];
    let (space, of_space) =
        ColorSpace::of_exr(part.color_interop_id.as_deref(), part.chromaticities);
    remarks.extend(of_space);
    if !space.is_linear_rec_709() {
        tracing::info!("{}: converted from {space} to linear Rec. 709", path.display());
        space.convert_to_rec_709(&mut texels);
    }
    let texels = in_display_window(part, texels, file_length, place, &mut remarks)?;
    let Window { width, height, .. } = part.display_window;
    Ok(SphereImage { width: width as usize, height: height as usize, texels, remarks })
}

/// The picture as it is to be seen: black where there are no pixels, without what lies outside.
///
/// Tools that trim to what is not black leave a data window that is smaller than the picture.
fn in_display_window(
    part: &ExrPart,
    texels: Vec<[f32; 3]>,
    file_length: u64,
    place: &Place,
    remarks: &mut Vec<String>,
) -> Result<Vec<[f32; 3]>, Error> {
    let (data, display) = (part.data_window, part.display_window);
    if data == display {
        return Ok(texels);
    }
    // Where a side of the data begins in the picture, and how many of its pixels are seen.
    let overlap = |data: (i32, u32), display: (i32, u32)| {
        let low = i64::from(data.0.max(display.0));
        let high = (i64::from(data.0) + i64::from(data.1))
            .min(i64::from(display.0) + i64::from(display.1));
        let from = |start: i32| (low - i64::from(start)) as usize;
        (high > low).then(|| (from(data.0), from(display.0), (high - low) as usize))
    };
    let shown = |w: Window| format!("{} x {} at ({}, {})", w.width, w.height, w.x, w.y);
    let x = overlap((data.x, data.width), (display.x, display.width));
    let y = overlap((data.y, data.height), (display.y, display.height));
    let (Some((data_x, x, columns)), Some((data_y, y, rows))) = (x, y) else {
        return Err(Error::invalid(
            place.clone(),
            format!("its pixels ({}) lie outside of the picture ({})", shown(data), shown(display)),
            "save the image with a display window that holds its pixels",
        ));
    };
    // A few bytes must not ask for gigabytes of black.
    let area = u64::from(display.width) * u64::from(display.height);
    if area > MAX_BLACK.max(file_length.saturating_mul(1 << 16)) {
        return Err(Error::invalid(
            place.clone(),
            format!(
                "a file of {file_length} bytes with few pixels ({}) claims a picture of {}",
                shown(data),
                shown(display)
            ),
            "save the image with a display window of the size of its pixels",
        ));
    }
    remarks.push(format!(
        "its pixels ({}) are placed in its display window ({}), which counts as the whole sphere",
        shown(data),
        shown(display)
    ));
    let (width, data_width) = (display.width as usize, data.width as usize);
    let mut picture = vec![[0.0; 3]; width * display.height as usize];
    for row in 0..rows {
        let from = (data_y + row) * data_width + data_x;
        let to = (y + row) * width + x;
        picture[to..to + columns].copy_from_slice(&texels[from..from + columns]);
    }
    Ok(picture)
}

fn read_hdr(bytes: &[u8], place: &Place) -> Result<SphereImage, Error> {
    use radiance_hdr::{Fault, RadianceImage};
    match radiance_hdr::decode(bytes, MAX_TEXELS) {
        Ok(RadianceImage { width, height, texels, remarks }) => {
            Ok(SphereImage { width, height, texels, remarks })
        }
        Err(Fault::Damaged(what)) => Err(Error::invalid(
            place.clone(),
            format!("the Radiance image cannot be read: {what}"),
            "write it again, or convert it to .exr",
        )),
        Err(Fault::Unsupported(what, remedy)) => {
            Err(Error::unsupported(place.clone(), what, remedy))
        }
    }
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
