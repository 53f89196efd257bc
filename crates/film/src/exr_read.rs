//! OpenEXR input.

use std::fs::File;
use std::io::{BufReader, Seek};
use std::path::Path;

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::reader::ChunksReader;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use half::f16;

use crate::error::Error;
use crate::exr_header::{self, ExrHeader, ExrPart, in_layer};
use crate::guard::guarded;
use crate::image::{Image, MAX_CHANNELS, MAX_SAMPLES};

/// Decoded bytes that are accepted for each byte of the file; long constant blocks of PIZ come to
/// tens of thousands.
const MAX_EXPANSION: u64 = 1 << 16;
/// Largest tile that a small image may have, in bytes.
const MAX_SMALL_TILE: u64 = 1 << 26;

/// Reads all flat channels of an EXR file as 32-bit floats.
///
/// Half and float values are exact, 32-bit integers are rounded. Channels of the first part keep
/// their names, those of further parts get the part's name as layer. Of tiles with several
/// resolutions the largest is read. Metadata are the text, number and integer attributes of the
/// first part, sorted by name. Values are those of the file, whatever colour space it names: see
/// [`ExrPart::color_interop_id`] and [`ExrPart::chromaticities`].
///
/// Everything the decoder would allocate is checked against [`MAX_SAMPLES`], the size of the file
/// and the size of the blocks first, and its panics become errors.
///
/// # Errors
/// No such file; not EXR, broken or too large; deep data, subsampled channels, compressions newer
/// than DWAB, or parts that differ in their data window.
pub fn read_exr(path: &Path) -> Result<Image, Error> {
    let (header, reader) = exr_header::open(path)?;
    let wanted: Vec<Wanted> = header
        .parts
        .iter()
        .enumerate()
        .flat_map(|(part, p)| (0..p.channels.len()).map(move |channel| Wanted { part, channel }))
        .collect();
    let planes = decode(&header, &wanted, reader, path).map_err(|e| e.in_file(path))?;

    let first = &header.parts[0];
    let mut image = Image::without_channels(first.data_window).map_err(|e| e.in_file(path))?;
    image.place(first.data_window.x, first.data_window.y, first.display_window);
    image.metadata = first.metadata.clone();
    for (Wanted { part: number, channel }, samples) in wanted.into_iter().zip(planes) {
        let part = &header.parts[number];
        if part.data_window != first.data_window {
            return Err(Error::Unsupported {
                place: path.display().to_string(),
                problem: "a file whose parts have different data windows".into(),
                remedy: "save the parts as files of their own",
            });
        }
        let plain = &part.channels[channel].name;
        let name = match (&part.name, number) {
            (_, 0) => plain.clone(),
            (Some(layer), _) => in_layer(layer, plain),
            (None, _) => in_layer(&format!("part{number}"), plain),
        };
        image.add_channel(&name, samples).map_err(|e| e.in_file(path))?;
    }
    Ok(image)
}

/// The colour of an EXR file, row by row from the top of its data window, and its header; the
/// number is that of the part they are from.
///
/// Which channels these are see [`ExrHeader::color`]. Values are those of the file, in the colour
/// space that its part names. Memory and panics are bounded as in [`read_exr`].
///
/// # Errors
/// No such file; not EXR, broken or too large; a part of colour that is deep, has subsampled
/// channels or a compression newer than DWAB; [`Error::Unsupported`] with a list of the channels
/// there are if none are known to be colour.
pub fn read_exr_color(path: &Path) -> Result<(ExrHeader, usize, Vec<[f32; 3]>), Error> {
    let (header, reader) = exr_header::open(path)?;
    let refuse = |problem: &str, remedy| {
        let place = path.display().to_string();
        let problem = format!("{problem} (the file has: {})", header.describe().join("; "));
        Error::Unsupported { place, problem, remedy }
    };
    let Some((part, found)) = header.color() else {
        if header.parts.iter().all(|p| p.deep) {
            return Err(refuse("deep data", "flatten the image first"));
        }
        if header.parts.iter().any(is_luminance_chroma) {
            return Err(refuse(LUMINANCE_CHROMA, TO_RGB));
        }
        return Err(refuse(
            "an image without channels that are known to be its colour",
            "save it with channels R, G and B, or Y, or a single one",
        ));
    };
    let [r, g, b] = found.rgb.map(|channel| Wanted { part, channel });
    let wanted = if found.is_grey() { vec![r] } else { vec![r, g, b] };
    let mut planes = decode(&header, &wanted, reader, path)
        .map_err(|error| match error {
            Error::Unsupported { problem, remedy, .. } => refuse(&problem, remedy),
            other => other.in_file(path),
        })?
        .into_iter();
    let (r, g, b) = (planes.next().unwrap_or_default(), planes.next(), planes.next());
    let pixels = match (g, b) {
        (Some(g), Some(b)) => r.iter().zip(g).zip(b).map(|((&r, g), b)| [r, g, b]).collect(),
        _ => r.iter().map(|&v| [v; 3]).collect(),
    };
    Ok((header, part, pixels))
}

const LUMINANCE_CHROMA: &str = "luminance with chroma of lower resolution (Y, RY, BY)";
const TO_RGB: &str = "save the image with channels R, G and B";

fn is_luminance_chroma(part: &ExrPart) -> bool {
    part.is_subsampled() || part.channels.iter().any(|c| matches!(&*c.name, "RY" | "BY"))
}

/// A channel that is to be decoded.
#[derive(Clone, Copy)]
struct Wanted {
    part: usize,
    channel: usize,
}

/// The samples of channels, row by row from the top of their part's data window.
fn decode(
    header: &ExrHeader,
    wanted: &[Wanted],
    mut reader: BufReader<File>,
    path: &Path,
) -> Result<Vec<Vec<f32>>, Error> {
    check(header, wanted)?;
    reader.rewind().map_err(|e| Error::io(path, "read it", e))?;
    let mut planes = Vec::new();
    for Wanted { part, .. } in wanted {
        let count = header.parts[*part].pixels() as usize;
        let mut plane = Vec::new();
        plane.try_reserve_exact(count).map_err(|_| {
            let what = format!("no memory for a channel of {count} values");
            Error::too_large("image", what, "split the image or lower its resolution")
        })?;
        plane.resize(count, 0.0f32);
        planes.push(plane);
    }
    match guarded(|| unpack(header, wanted, reader, &mut planes)) {
        Ok(Ok(())) => Ok(planes),
        Ok(Err(error)) => Err(convert(path, error)),
        Err(_) => Err(Error::invalid(
            path.display().to_string(),
            "its blocks cannot be unpacked",
            "the file is damaged: copy or write it anew",
        )),
    }
}

/// Refuses what the decoder cannot read, or would need too much memory for.
fn check(header: &ExrHeader, wanted: &[Wanted]) -> Result<(), Error> {
    let unsupported = |problem: String, remedy| {
        let place = "image".into();
        Err(Error::Unsupported { place, problem, remedy })
    };
    let (mut values, mut bytes) = (0u64, 0u64);
    for (number, part) in header.parts.iter().enumerate() {
        // The decoder refuses a file for the compression of any part.
        if part.rows_per_block().is_none() {
            let problem = match part.compression_name() {
                Some(name) => format!("the compression {name}"),
                None => format!("the compression with number {}", part.compression),
            };
            return unsupported(problem, "save the image with ZIP or PIZ compression");
        }
        let channels = wanted.iter().filter(|w| w.part == number).count() as u64;
        if channels == 0 {
            continue;
        }
        if part.deep {
            return unsupported("deep data".into(), "flatten the image first");
        }
        if part.is_subsampled() {
            return unsupported(LUMINANCE_CHROMA.into(), TO_RGB);
        }
        let unpacked = part.unpacked_bytes();
        values = values.saturating_add(part.pixels().saturating_mul(channels));
        bytes = bytes.saturating_add(unpacked);
        if let Some([x, y]) = part.tiles {
            let samples: u64 = part.channels.iter().map(|c| u64::from(c.sample_bytes)).sum();
            let tile = (u64::from(x) * u64::from(y)).saturating_mul(samples);
            if tile == 0 || tile > unpacked.saturating_mul(4).max(MAX_SMALL_TILE) {
                return Err(Error::invalid(
                    "image",
                    format!("tiles of {x} x {y} pixels do not fit it"),
                    "the file is damaged: copy or write it anew",
                ));
            }
        }
    }
    if values > MAX_SAMPLES || wanted.len() > MAX_CHANNELS {
        let channels = wanted.len();
        return Err(Error::too_large(
            "image",
            format!("{channels} channels with {values} values in all, above 1024 or 2^30"),
            "split the image",
        ));
    }
    let length = header.file_length;
    if bytes / MAX_EXPANSION > length {
        return Err(Error::invalid(
            "image",
            format!("a file of {length} bytes cannot hold {bytes} bytes of pixels"),
            "the file is cut off or damaged: copy or write it anew",
        ));
    }
    Ok(())
}

fn unpack(
    header: &ExrHeader,
    wanted: &[Wanted],
    reader: BufReader<File>,
    planes: &mut [Vec<f32>],
) -> Result<(), exr::error::Error> {
    let damaged = |what: &'static str| exr::error::Error::Invalid(what.into());
    let reader = exr::block::read(reader, false)?;
    let meta = reader.meta_data().clone();
    if meta.headers.len() != header.parts.len() {
        return Err(damaged("number of parts"));
    }
    // For each part and each channel as the decoder has it: the plane it goes to.
    let mut targets: Vec<Vec<Option<usize>>> =
        meta.headers.iter().map(|h| vec![None; h.channels.list.len()]).collect();
    for (plane, Wanted { part, channel }) in wanted.iter().enumerate() {
        let (theirs, ours) = (&meta.headers[*part], &header.parts[*part]);
        let size = (ours.data_window.width as usize, ours.data_window.height as usize);
        if (theirs.layer_size.0, theirs.layer_size.1) != size {
            return Err(damaged("data window"));
        }
        let name = &ours.channels[*channel].name;
        let same = |name: &str, text: &[u8]| String::from_utf8_lossy(text) == name;
        let list = &theirs.channels.list;
        match list.iter().position(|c| same(name, c.name.as_slice())) {
            Some(index) if targets[*part][index].is_none() => targets[*part][index] = Some(plane),
            _ => return Err(damaged("channel list")),
        }
    }
    let is_wanted = |part: usize| targets[part].iter().any(Option::is_some);
    let chunks = reader.filter_chunks(false, |_, tile, block| {
        is_wanted(block.layer) && tile.is_largest_resolution_level()
    })?;
    let mut covered = vec![0u64; header.parts.len()];
    let mut seen = std::collections::HashSet::new();
    let mut chunks = chunks;
    while let Some(chunk) = chunks.read_next_chunk() {
        let chunk = chunk?;
        let Some(layer) = meta.headers.get(chunk.layer_index) else {
            return Err(damaged("part of a block"));
        };
        check_dwa(&chunk, layer)?;
        let block = UncompressedBlock::decompress_chunk(chunk, &meta, false)?;
        let index = block.index;
        if index.level.0 != 0 || index.level.1 != 0 || !is_wanted(index.layer) {
            return Err(damaged("block at another place than announced"));
        }
        if seen.insert((index.layer, index.pixel_position.0, index.pixel_position.1)) {
            covered[index.layer] += (index.pixel_size.0 * index.pixel_size.1) as u64;
        }
        let width = layer.layer_size.0;
        for line in block.lines(&layer.channels) {
            let at = line.location;
            let Some(plane) = targets[index.layer][at.channel] else { continue };
            let start = at.position.1 * width + at.position.0;
            let Some(row) = planes[plane].get_mut(start..start + at.sample_count) else {
                return Err(damaged("block outside of the image"));
            };
            convert_row(line.value, layer.channels.list[at.channel].sample_type, row);
        }
    }
    for (number, part) in header.parts.iter().enumerate() {
        if is_wanted(number) && covered[number] != part.pixels() {
            return Err(damaged("blocks are missing"));
        }
    }
    Ok(())
}

/// Samples as the decoder has them, in the machine's order of bytes.
fn convert_row(bytes: &[u8], kind: SampleType, row: &mut [f32]) {
    match kind {
        SampleType::F16 => {
            for (bytes, value) in bytes.as_chunks::<2>().0.iter().zip(row) {
                *value = f16::from_ne_bytes(*bytes).to_f32();
            }
        }
        SampleType::F32 => {
            for (bytes, value) in bytes.as_chunks::<4>().0.iter().zip(row) {
                *value = f32::from_ne_bytes(*bytes);
            }
        }
        SampleType::U32 => {
            for (bytes, value) in bytes.as_chunks::<4>().0.iter().zip(row) {
                *value = u32::from_ne_bytes(*bytes) as f32;
            }
        }
    }
}

/// Refuses blocks of DWAA and DWAB that claim more than their pixels can need: the decoder (`exr`
/// 1.74) allocates what they claim.
///
/// A block begins with eleven 64-bit numbers, of which six are sizes of what is to be unpacked.
fn check_dwa(chunk: &Chunk, layer: &Header) -> Result<(), exr::error::Error> {
    use exr::prelude::Compression;
    if !matches!(layer.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()),
    };
    let tile = layer.get_block_data_indices(&chunk.compressed_block)?;
    let size = layer.get_absolute_block_pixel_coordinates(tile)?.size;
    let raw = (size.0 * size.1 * layer.channels.bytes_per_pixel) as u64;
    // A block that packing would not shrink is stored as it is.
    if bytes.len() as u64 == raw {
        return Ok(());
    }
    // Cosine transforms work on whole squares of 8 x 8 samples.
    let padded = (size.0.next_multiple_of(8) * size.1.next_multiple_of(8)) as u64
        * layer.channels.list.len() as u64;
    let count = |index: usize| {
        let bytes = bytes.get(8 * index..8 * index + 8);
        bytes.and_then(|b| b.try_into().ok()).map(u64::from_le_bytes)
    };
    // Of what is left as it is; of runs, packed and unpacked; of coefficients, other and first.
    for (index, most) in [(1, raw), (6, 2 * raw + 64), (7, raw), (8, padded), (9, padded)] {
        if count(index).is_none_or(|claimed| claimed > most) {
            return Err(exr::error::Error::Invalid("a DWA block claims too much".into()));
        }
    }
    Ok(())
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
