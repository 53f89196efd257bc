//! OpenEXR output.

use std::collections::HashSet;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use exr::prelude as x;
use exr::prelude::WritableImage;
use half::f16;

use crate::atomic::write_atomically;
use crate::color_space::{COLOR_INTEROP_ID, LIN_REC_709};
use crate::error::Error;
use crate::image::{Channel, Image, MetaValue, Window};

/// How the pixels are packed; all are lossless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExrCompression {
    /// Deflate over blocks of 16 rows: small, read by everything.
    #[default]
    Zip,
    /// Wavelets: faster to write than zip, smaller on noisy images, larger on smooth ones.
    Piz,
    /// None: fastest.
    None,
}

/// What an EXR file should contain beside the pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrSettings {
    /// Channels without a layer (`R`, `A`, `Y`) as 16-bit floats. Channels of layers
    /// (`variance.R`) are always 32 bits.
    pub half: bool,
    /// Packing of the pixels.
    pub compression: ExrCompression,
    /// Compress on all cores, with threads of the writer's own. Off: on the calling thread.
    /// The file is the same.
    pub parallel: bool,
    /// Custom attributes; names of 1 to 255 printable ASCII characters, each once. Of the names
    /// that EXR reserves only the texts `software`, `comments`, `owner` and `capDate` are allowed.
    pub metadata: Vec<(String, MetaValue)>,
}

/// What happened on the way into the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExrReport {
    /// Values beyond the range of a 16-bit float (65504) that were clamped to it; infinite ones
    /// too. They are also told in the file, as attribute `pileus:half_clamped`.
    pub half_clamped: u64,
}

const HALF_CLAMPED: &str = "pileus:half_clamped";
/// Longest text value, 16 MiB.
const MAX_TEXT: usize = 1 << 24;

/// Writes all channels to one part of an EXR file, beside the target and renamed.
///
/// Data and display window are those of the image, chromaticities those of Rec. 709 with white D65,
/// `colorInteropID` is `lin_rec709_scene`. 32-bit values, NaN and infinity included, are stored bit
/// for bit; 16-bit values are rounded to nearest and clamped to 65504 in magnitude, since an
/// infinite pixel spoils every filter that touches it later. Equal input gives equal bytes.
///
/// # Errors
/// No channels, metadata that cannot be stored, or what [`write_atomically`] answers.
pub fn write_exr(path: &Path, image: &Image, settings: &ExrSettings) -> Result<ExrReport, Error> {
    check_metadata(&settings.metadata).map_err(|e| e.in_file(path))?;
    if image.channels().is_empty() {
        return Err(Error::invalid(
            path.display().to_string(),
            "the image has no channels",
            "add at least one",
        ));
    }
    let mut report = ExrReport::default();
    let channels: Vec<_> =
        image.channels().iter().map(|c| encode(c, settings.half, &mut report)).collect();
    let mut metadata = settings.metadata.clone();
    if report.half_clamped > 0 && !metadata.iter().any(|(key, _)| key == HALF_CLAMPED) {
        let count = i32::try_from(report.half_clamped).unwrap_or(i32::MAX);
        metadata.push((HALF_CLAMPED.into(), MetaValue::I32(count)));
    }

    let data = image.data_window();
    let mut attributes = x::LayerAttributes {
        layer_position: x::Vec2(data.x, data.y),
        ..x::LayerAttributes::default()
    };
    for (key, value) in &metadata {
        match (named_text(&mut attributes, key), value) {
            (Some(field), MetaValue::Text(value)) => *field = Some(text(value)),
            _ => {
                attributes.other.insert(text(key), attribute(value));
            }
        }
    }
    attributes
        .other
        .insert(text(COLOR_INTEROP_ID), x::attribute::AttributeValue::Text(text(LIN_REC_709)));
    let encoding = x::Encoding {
        compression: match settings.compression {
            ExrCompression::Zip => x::Compression::ZIP16,
            ExrCompression::Piz => x::Compression::PIZ,
            ExrCompression::None => x::Compression::Uncompressed,
        },
        blocks: x::Blocks::ScanLines,
        line_order: x::LineOrder::Increasing,
    };
    let layer = x::Layer::new(
        (data.width as usize, data.height as usize),
        attributes,
        encoding,
        x::AnyChannels::sort(channels.into_iter().collect()),
    );
    let mut picture = x::Image::from_layer(layer);
    picture.attributes = x::ImageAttributes::new(bounds(image.display_window()));
    picture.attributes.chromaticities = Some(REC_709);

    write_atomically(path, |file| {
        let writer = picture.write();
        if settings.parallel {
            writer.to_buffered(&mut *file).map_err(exr_to_io)?;
        } else {
            writer.non_parallel().to_buffered(&mut *file).map_err(exr_to_io)?;
        }
        sort_attributes(file)
    })?;
    Ok(report)
}

/// Primaries and white point of ITU-R BT.709.
const REC_709: x::attribute::Chromaticities = x::attribute::Chromaticities {
    red: x::Vec2(0.64, 0.33),
    green: x::Vec2(0.30, 0.60),
    blue: x::Vec2(0.15, 0.06),
    white: x::Vec2(0.3127, 0.3290),
};

fn encode(channel: &Channel, half: bool, report: &mut ExrReport) -> x::AnyChannel<x::FlatSamples> {
    let samples = if half && !channel.name.contains('.') {
        let limit = f16::MAX.to_f32();
        let convert = |&v: &f32| {
            // From 65520 on, rounding to nearest would give infinity; NaN stays.
            report.half_clamped += u64::from(v.abs() >= 65520.0);
            f16::from_f32(v.clamp(-limit, limit))
        };
        x::FlatSamples::F16(channel.samples.iter().map(convert).collect())
    } else {
        x::FlatSamples::F32(channel.samples.clone())
    };
    x::AnyChannel::new(text(&channel.name), samples)
}

/// UTF-8 bytes as they are.
fn text(v: &str) -> x::Text {
    x::Text::from_slice_unchecked(v.as_bytes())
}

fn attribute(value: &MetaValue) -> x::attribute::AttributeValue {
    use x::attribute::AttributeValue;
    match value {
        MetaValue::Text(v) => AttributeValue::Text(text(v)),
        MetaValue::F32(v) => AttributeValue::F32(*v),
        MetaValue::F64(v) => AttributeValue::F64(*v),
        MetaValue::I32(v) => AttributeValue::I32(*v),
    }
}

/// The texts among the attributes that EXR reserves.
fn named_text<'a>(
    attributes: &'a mut x::LayerAttributes,
    key: &str,
) -> Option<&'a mut Option<x::Text>> {
    match key {
        "software" => Some(&mut attributes.software_name),
        "comments" => Some(&mut attributes.comments),
        "owner" => Some(&mut attributes.owner),
        "capDate" => Some(&mut attributes.capture_date),
        _ => None,
    }
}

fn bounds(window: Window) -> x::IntegerBounds {
    x::IntegerBounds::new(
        x::Vec2(window.x, window.y),
        x::Vec2(window.width as usize, window.height as usize),
    )
}

fn check_metadata(metadata: &[(String, MetaValue)]) -> Result<(), Error> {
    let mut seen = HashSet::new();
    for (key, value) in metadata {
        let refuse = |problem: &str, remedy| {
            Err(Error::invalid("image", format!("metadata {key:?}: {problem}"), remedy))
        };
        if key.is_empty() || key.len() > 255 || !key.bytes().all(|b| b.is_ascii_graphic()) {
            return refuse(
                "such a name cannot be stored",
                "use 1 to 255 printable ASCII characters",
            );
        }
        let reserved = exr::meta::header::standard_names::ALL.contains(&key.as_bytes())
            || key == COLOR_INTEROP_ID;
        let allowed = matches!(value, MetaValue::Text(_))
            && named_text(&mut x::LayerAttributes::default(), key).is_some();
        if reserved && !allowed {
            return refuse("EXR reserves this name", "put a prefix before it");
        }
        if let MetaValue::Text(text) = value
            && text.len() > MAX_TEXT
        {
            return refuse("the text exceeds 16 MiB", "shorten it");
        }
        if !seen.insert(key) {
            return refuse("the name is given twice", "remove one");
        }
    }
    Ok(())
}

/// Sorts the attributes of a finished one-part file by name.
///
/// The writer keeps custom attributes in a hash map and writes them in an order that changes from
/// run to run; equal renders should be equal files. Only the order changes, so that all offsets
/// in the file stay valid.
fn sort_attributes(file: &mut BufWriter<File>) -> io::Result<()> {
    const START: u64 = 8;
    file.flush()?;
    let file = file.get_mut();
    file.seek(SeekFrom::Start(START))?;
    let mut header = BufReader::new(&mut *file);
    let mut attributes = Vec::new();
    loop {
        let name = read_name(&mut header)?;
        if name.is_empty() {
            break;
        }
        let mut bytes = name.clone();
        bytes.push(0);
        bytes.extend(read_name(&mut header)?);
        bytes.push(0);
        let mut size = [0; 4];
        header.read_exact(&mut size)?;
        bytes.extend(size);
        let expected = u64::from(u32::from_le_bytes(size));
        if header.by_ref().take(expected).read_to_end(&mut bytes)? as u64 != expected {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        attributes.push((name, bytes));
    }
    drop(header);
    attributes.sort();
    file.seek(SeekFrom::Start(START))?;
    let sorted: Vec<u8> = attributes.into_iter().flat_map(|(_, bytes)| bytes).collect();
    file.write_all(&sorted)?;
    file.seek(SeekFrom::End(0))?;
    Ok(())
}

/// Reads up to a NUL, which is taken off.
fn read_name(reader: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut name = Vec::new();
    reader.take(256).read_until(0, &mut name)?;
    match name.pop() {
        Some(0) => Ok(name),
        _ => Err(io::ErrorKind::InvalidData.into()),
    }
}

fn exr_to_io(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(error) => error,
        other => io::Error::other(other.to_string()),
    }
}
