//! What PNG and JPEG images must stand before and while a decoder of another crate runs on them.

use image::{ImageFormat, ImageResult};
use pileus_film::guarded;

/// Runs a step of a decoder; its errors and its panics become the same kind of text.
pub(crate) fn run<T>(step: impl FnOnce() -> ImageResult<T>) -> Result<T, String> {
    match guarded(step) {
        Ok(result) => result.map_err(|error| error.to_string()),
        Err(panic) => Err(panic.to_string()),
    }
}

/// Refuses images that cannot be whole: a JPEG without its end, whose decoder would leave the rest
/// grey, and sizes that the bytes at hand cannot fill.
pub(crate) fn check(
    bytes: &[u8],
    format: ImageFormat,
    width: u32,
    height: u32,
) -> Result<(), String> {
    let pixels = u64::from(width) * u64::from(height);
    // Most pixels that a byte can stand for.
    let most = match format {
        // A block of 64 takes at least a bit.
        ImageFormat::Jpeg => 512.0,
        // Deflate makes at most 1032 bytes of one.
        ImageFormat::Png => 1032.0 * 8.0 / png_bits(bytes),
        _ => f64::INFINITY,
    };
    let length = bytes.len();
    if pixels as f64 > most * length as f64 {
        return Err(format!("{length} bytes cannot hold {width} x {height} pixels"));
    }
    if format == ImageFormat::Jpeg && !jpeg_is_whole(bytes) {
        return Err("it is cut off: the JPEG has no end".into());
    }
    Ok(())
}

/// Bits of a pixel by the header of a PNG; 1, the least, if it is damaged.
fn png_bits(bytes: &[u8]) -> f64 {
    let (Some(&depth), Some(&kind)) = (bytes.get(24), bytes.get(25)) else { return 1.0 };
    let channels = match kind {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    f64::from((u32::from(depth) * channels).clamp(1, 64))
}

/// Whether the segments of a JPEG lead to its end (ITU-T T.81, annex B).
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    // Behind the start of the image.
    let mut at = 2;
    loop {
        // The next marker: what is not 0 behind a byte of 255, of which there may be several.
        let Some(found) = bytes.get(at..).and_then(|rest| {
            rest.windows(2).position(|pair| pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff))
        }) else {
            return false;
        };
        at += found;
        match bytes[at + 1] {
            0xd9 => return true,
            // Markers that stand alone: restarts inside of a scan, and what is reserved.
            0x01 | 0xd0..=0xd8 => at += 2,
            _ => match bytes.get(at + 2..at + 4) {
                // A segment with its length, at least that of the length itself; after the one
                // that starts a scan its data follow, in which 255 is followed by 0.
                Some(&[high, low]) => {
                    at += 2 + usize::from(u16::from_be_bytes([high, low])).max(2);
                }
                _ => return false,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let picture = image::RgbImage::from_fn(40, 24, |x, y| {
            image::Rgb([(x * 6) as u8, (y * 9) as u8, (x * y) as u8])
        });
        let mut bytes = Vec::new();
        picture.write_to(&mut Cursor::new(&mut bytes), format).unwrap();
        bytes
    }

    #[test]
    fn jpegs_that_are_cut_off_anywhere_are_refused() {
        let whole = encoded(ImageFormat::Jpeg);
        assert_eq!(check(&whole, ImageFormat::Jpeg, 40, 24), Ok(()));
        for length in 2..whole.len() {
            assert!(check(&whole[..length], ImageFormat::Jpeg, 40, 24).is_err(), "{length}");
        }
        // Junk behind the end, and a whole small picture in a comment before it.
        let junk = [&whole[..], b"junk"].concat();
        assert_eq!(check(&junk, ImageFormat::Jpeg, 40, 24), Ok(()));
        let length = (whole.len() as u16 + 2).to_be_bytes();
        let comment = [&whole[..2], &[0xff, 0xfe], &length, &whole, &whole[2..]].concat();
        assert_eq!(check(&comment, ImageFormat::Jpeg, 40, 24), Ok(()));
        let cut = &comment[..comment.len() - 20];
        assert!(check(cut, ImageFormat::Jpeg, 40, 24).is_err());
    }

    #[test]
    fn sizes_beyond_what_the_bytes_can_hold_are_refused() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            let bytes = encoded(format);
            assert_eq!(check(&bytes, format, 40, 24), Ok(()));
            let error = check(&bytes, format, 32768, 32768).unwrap_err();
            assert!(error.contains("cannot hold 32768 x 32768 pixels"), "{error}");
        }
        // What deflate packs best: black.
        let black = image::GrayImage::new(2048, 2048);
        let mut bytes = Vec::new();
        black.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Png).unwrap();
        assert_eq!(check(&bytes, ImageFormat::Png, 2048, 2048), Ok(()));
        let mut bytes = Vec::new();
        black.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Jpeg).unwrap();
        assert_eq!(check(&bytes, ImageFormat::Jpeg, 2048, 2048), Ok(()));
    }

    #[test]
    fn panics_of_decoders_are_errors() {
        let error = run::<()>(|| panic!("as a decoder would")).unwrap_err();
        assert!(error.contains("damaged"), "{error}");
    }
}
