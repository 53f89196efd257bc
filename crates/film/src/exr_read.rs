//! OpenEXR input.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use exr::prelude as x;
use exr::prelude::{ReadChannels, ReadLayers};

use crate::error::Error;
use crate::image::{Image, MAX_CHANNELS, MAX_SAMPLES, MetaValue, Window};

/// Decoded bytes that are accepted for each byte of the file; long constant blocks of PIZ come to
/// tens of thousands.
const MAX_EXPANSION: u64 = 1 << 16;

/// Reads all flat channels of an EXR file as 32-bit floats.
///
/// Half and float values are exact, 32-bit integers are rounded. Channels of the first part keep
/// their names, those of further parts get the part's name as layer. Of tiles with several
/// resolutions the largest is read. Metadata are the text, number and integer attributes of the
/// first part, sorted by name.
///
/// The header is checked against [`MAX_SAMPLES`] and the size of the file before pixels are
/// allocated.
///
/// # Errors
/// No such file; not EXR, broken or too large; deep data, subsampled channels, DWA compression, or
/// parts that differ in their data window.
pub fn read_exr(path: &Path) -> Result<Image, Error> {
    let place = || path.display().to_string();
    let file = File::open(path).map_err(|e| Error::open(path, e))?;
    let length = file.metadata().map_err(|e| Error::io(path, "read its size", e))?.len();
    let mut reader = BufReader::with_capacity(1 << 18, file);
    let meta = guarded(path, || x::MetaData::read_from_buffered(&mut reader, false))?;
    check_headers(&meta, length).map_err(|e| e.in_file(path))?;
    reader.rewind().map_err(|e| Error::io(path, "read it", e))?;

    let picture = guarded(path, move || {
        x::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .non_parallel()
            .from_buffered(reader)
    })?;

    let mut parts = picture.layer_data.into_iter().enumerate();
    let Some((_, first)) = parts.next() else {
        return Err(Error::invalid(place(), "it has no layers", "write it anew"));
    };
    let window = window_of(&first);
    let mut image = Image::without_channels(window).map_err(|e| e.in_file(path))?;
    let display = picture.attributes.display_window;
    let side = |v: usize| u32::try_from(v).unwrap_or(u32::MAX);
    image.place(
        window.x,
        window.y,
        Window {
            x: display.position.0,
            y: display.position.1,
            width: side(display.size.0),
            height: side(display.size.1),
        },
    );
    image.metadata = metadata(&first.attributes);
    add_channels(&mut image, first, None).map_err(|e| e.in_file(path))?;
    for (number, part) in parts {
        if window_of(&part) != window {
            return Err(Error::Unsupported {
                place: place(),
                problem: "a file whose parts have different data windows".into(),
                remedy: "save the parts as files of their own",
            });
        }
        let name = part.attributes.layer_name.as_ref().map(to_string);
        let name = name.unwrap_or_else(|| format!("part{number}"));
        add_channels(&mut image, part, Some(&name)).map_err(|e| e.in_file(path))?;
    }
    Ok(image)
}

/// Runs a step of the decoder and turns its panics into errors.
///
/// Damaged blocks make some decompressors overflow (B44 in exr 1.74 does). What the step borrows
/// is not looked at again after a panic.
fn guarded<T>(
    path: &Path,
    step: impl FnOnce() -> Result<T, exr::error::Error>,
) -> Result<T, Error> {
    match catch_unwind(AssertUnwindSafe(step)) {
        Ok(result) => result.map_err(|e| convert(path, e)),
        Err(_) => Err(Error::invalid(
            path.display().to_string(),
            "its blocks cannot be unpacked",
            "the file is damaged: copy or write it anew",
        )),
    }
}

type Part = x::Layer<x::AnyChannels<x::FlatSamples>>;

fn window_of(part: &Part) -> Window {
    let x::Vec2(x, y) = part.attributes.layer_position;
    // Sizes were checked in the header.
    Window { x, y, width: part.size.0 as u32, height: part.size.1 as u32 }
}

fn add_channels(image: &mut Image, part: Part, layer: Option<&str>) -> Result<(), Error> {
    for channel in part.channel_data.list {
        let name = to_string(&channel.name);
        let name = match layer {
            Some(layer) if !name.starts_with(&format!("{layer}.")) => format!("{layer}.{name}"),
            _ => name,
        };
        let samples = match channel.sample_data {
            x::FlatSamples::F16(values) => values.into_iter().map(half::f16::to_f32).collect(),
            x::FlatSamples::F32(values) => values,
            x::FlatSamples::U32(values) => values.into_iter().map(|v| v as f32).collect(),
        };
        image.add_channel(&name, samples)?;
    }
    Ok(())
}

fn check_headers(meta: &x::MetaData, file_length: u64) -> Result<(), Error> {
    let (mut values, mut bytes, mut channels) = (0u64, 0u64, 0usize);
    for header in &meta.headers {
        if header.deep {
            return Err(Error::Unsupported {
                place: "image".into(),
                problem: "deep data".into(),
                remedy: "flatten the image first",
            });
        }
        // Its decoder allocates what the blocks claim, unchecked (exr 1.74).
        if matches!(header.compression, x::Compression::DWAA(_) | x::Compression::DWAB(_)) {
            return Err(Error::Unsupported {
                place: "image".into(),
                problem: "the lossy compression DWA".into(),
                remedy: "save the image with ZIP or PIZ",
            });
        }
        if header.channels.list.iter().any(|c| c.sampling != x::Vec2(1, 1)) {
            return Err(Error::Unsupported {
                place: "image".into(),
                problem: "channels of lower resolution than others (luminance and chroma)".into(),
                remedy: "convert the image to R, G, B",
            });
        }
        let pixels = (header.layer_size.0 as u64).saturating_mul(header.layer_size.1 as u64);
        for channel in &header.channels.list {
            values = values.saturating_add(pixels);
            let size = channel.sample_type.bytes_per_sample() as u64;
            bytes = bytes.saturating_add(pixels.saturating_mul(size));
        }
        channels += header.channels.list.len();
    }
    if values > MAX_SAMPLES || channels > MAX_CHANNELS {
        return Err(Error::too_large(
            "image",
            format!("{channels} channels with {values} values in all, above 1024 or 2^30"),
            "split the image",
        ));
    }
    if bytes / MAX_EXPANSION > file_length {
        return Err(Error::invalid(
            "image",
            format!("a file of {file_length} bytes cannot hold {bytes} bytes of pixels"),
            "the file is cut off or damaged: copy or write it anew",
        ));
    }
    Ok(())
}

fn metadata(attributes: &x::LayerAttributes) -> Vec<(String, MetaValue)> {
    use x::attribute::AttributeValue;
    let named = [
        ("software", &attributes.software_name),
        ("comments", &attributes.comments),
        ("owner", &attributes.owner),
        ("capDate", &attributes.capture_date),
    ];
    let texts = named
        .into_iter()
        .filter_map(|(key, value)| Some((key.into(), MetaValue::Text(to_string(value.as_ref()?)))));
    let others = attributes.other.iter().filter_map(|(key, value)| {
        let value = match value {
            AttributeValue::Text(v) => MetaValue::Text(to_string(v)),
            AttributeValue::F32(v) => MetaValue::F32(*v),
            AttributeValue::F64(v) => MetaValue::F64(*v),
            AttributeValue::I32(v) => MetaValue::I32(*v),
            _ => return None,
        };
        Some((to_string(key), value))
    });
    let mut all: Vec<(String, MetaValue)> = texts.chain(others).collect();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

fn to_string(text: &x::Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

fn convert(path: &Path, error: exr::error::Error) -> Error {
    use exr::error::Error as E;
    match error {
        E::Io(source) => Error::io(path, "read it", source),
        E::NotSupported(what) => Error::Unsupported {
            place: path.display().to_string(),
            problem: what.into_owned(),
            remedy: "convert the file to flat scan lines first",
        },
        E::Invalid(what) => Error::invalid(
            path.display().to_string(),
            format!("this is not a sound EXR file ({what})"),
            "copy or write it anew",
        ),
        E::Aborted => {
            Error::invalid(path.display().to_string(), "reading was aborted", "read it again")
        }
    }
}
