//! The film as a file: slices of a split render and checkpoints of a long one.
//!
//! Layout, little endian:
//!
//! | bytes | content |
//! | --- | --- |
//! | 8 | `PILEUSFM` |
//! | 4 | version, 3 |
//! | 4 | length of the header, at most [`MAX_STATE_HEADER`] |
//! | n | header: the caller's bytes, which tell what job and which samples these are |
//! | 24 | resolution and crop window (x0, y0, width, height) |
//! | 24 | samples per pixel, dropped samples, values of layers that were left out |
//! | 2 | number of layers beside the first ones, which every film has |
//! | 3 + n each | sums in each pixel (2 bytes), length of the name (1), name |
//! | 548 a pixel, and 16 for each sum of a layer | sums of the crop window, row by row |
//! | 8 | CRC-64/XZ of all of the above |

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

use crate::atomic::write_atomically;
use crate::channel_sum::{ChannelSum, SUM_BYTES};
use crate::checksum::Summed;
use crate::crop::Crop;
use crate::error::Error;
use crate::film::Film;
use crate::layer::{FIRST_LAYERS, Layer};
use crate::layer_set::LayerSet;
use crate::moments::{PIXEL_BYTES, PixelMoments};

/// Version that [`Film::write_state`] writes and [`Film::read_state`] reads.
pub const STATE_VERSION: u32 = 3;
/// Most bytes of the caller's header, 1 MiB.
pub const MAX_STATE_HEADER: usize = 1 << 20;

const MAGIC: [u8; 8] = *b"PILEUSFM";
/// Pixels allocated ahead of the bytes that prove them: 1 MiB.
const PIXELS_AHEAD: usize = (1 << 20) / PIXEL_BYTES;
const STREAM: &str = "film state";

impl Film {
    /// Writes the exact sums, preceded by the caller's `header` (what job this is part of).
    ///
    /// 548 bytes a pixel, and 16 for each channel of a layer with sums of its own; the writer
    /// should be buffered.
    ///
    /// # Errors
    /// A header above [`MAX_STATE_HEADER`], or what the writer answers.
    pub fn write_state(&self, writer: impl Write, header: &[u8]) -> Result<(), Error> {
        check_header_length(header.len())?;
        self.put_state(writer, header).map_err(|source| Error::Io {
            place: STREAM.into(),
            action: "write it",
            source,
        })
    }

    fn put_state(&self, writer: impl Write, header: &[u8]) -> io::Result<()> {
        let mut out = Summed::new(writer);
        out.put(&MAGIC)?;
        out.put(&STATE_VERSION.to_le_bytes())?;
        out.put(&(header.len() as u32).to_le_bytes())?;
        out.put(header)?;
        let Crop { x0, y0, width, height } = self.crop();
        let [full_width, full_height] = self.resolution();
        for v in [full_width, full_height, x0, y0, width, height] {
            out.put(&v.to_le_bytes())?;
        }
        out.put(&self.samples().to_le_bytes())?;
        out.put(&self.dropped().to_le_bytes())?;
        out.put(&self.values_left_out().to_le_bytes())?;
        let further = &self.layers()[FIRST_LAYERS..];
        // There are at most 1024 channels, and names of at most 255 bytes.
        out.put(&(further.len() as u16).to_le_bytes())?;
        for layer in further {
            out.put(&(layer.sums() as u16).to_le_bytes())?;
            out.put(&[layer.name.len() as u8])?;
            out.put(layer.name.as_bytes())?;
        }
        for (pixel, sums) in self.pixels() {
            out.put(&pixel.to_bytes())?;
            for sum in sums {
                out.put(&sum.to_bytes())?;
            }
        }
        let (mut stream, checksum) = out.finish();
        stream.write_all(&checksum.to_le_bytes())?;
        stream.flush()
    }

    /// Reads what [`Self::write_state`] wrote: the film, equal bit for bit, and the header.
    ///
    /// Its layers are looked up by name in `known`: [`LAYERS`](crate::LAYERS), and what the program
    /// has beside them. Memory grows with the bytes that were really read, so that a broken length
    /// cannot exhaust it. The reader should be buffered; bytes after the state are left unread.
    ///
    /// # Errors
    /// Not a film state, another version (older ones included), a layer that is not known or has
    /// other channels, sizes out of range, a stream that ends early, sums that no samples have, a
    /// wrong checksum.
    pub fn read_state(
        reader: impl Read,
        known: &[&'static Layer],
    ) -> Result<(Self, Vec<u8>), Error> {
        let mut input = Summed::new(reader);
        let magic: [u8; 8] = input.get().map_err(broken)?;
        if magic != MAGIC {
            return Err(Error::invalid(
                STREAM,
                "this is not a film state",
                "give a slice or checkpoint that this program wrote",
            ));
        }
        let version = get_u32(&mut input)?;
        if version != STATE_VERSION {
            return Err(Error::Unsupported {
                place: STREAM.into(),
                problem: format!("film state version {version}"),
                remedy: "use the release of the program that wrote it, or render anew",
            });
        }
        let length = get_u32(&mut input)? as usize;
        check_header_length(length)?;
        let mut header = vec![0; length];
        input.fill(&mut header).map_err(broken)?;

        let resolution = [get_u32(&mut input)?, get_u32(&mut input)?];
        let crop = Crop {
            x0: get_u32(&mut input)?,
            y0: get_u32(&mut input)?,
            width: get_u32(&mut input)?,
            height: get_u32(&mut input)?,
        };
        let samples = u64::from_le_bytes(input.get().map_err(broken)?);
        let dropped = u64::from_le_bytes(input.get().map_err(broken)?);
        let left_out = u64::from_le_bytes(input.get().map_err(broken)?);
        let layers = LayerSet::new(&read_layers(&mut input, known)?)?;
        let mut film = Self::without_pixels(resolution, Some(crop), layers)?;
        film.set_counters(samples, dropped, left_out);
        let count = film.pixel_count();
        let mut sums = Vec::with_capacity(film.layer_set().sums());
        for i in 0..count {
            if i % PIXELS_AHEAD == 0 {
                // Doubling at least, so that copies stay linear.
                film.reserve(PIXELS_AHEAD.max(i).min(count - i))?;
            }
            let impossible = || {
                Error::invalid(
                    STREAM,
                    format!("pixel {i} has sums that no samples add up to"),
                    "the file is damaged: copy or render it anew",
                )
            };
            let bytes: [u8; PIXEL_BYTES] = input.get().map_err(broken)?;
            let pixel = PixelMoments::from_bytes(&bytes).ok_or_else(impossible)?;
            sums.clear();
            for _ in 0..film.layer_set().sums() {
                let bytes: [u8; SUM_BYTES] = input.get().map_err(broken)?;
                let sum = ChannelSum::from_bytes(&bytes, pixel.count());
                sums.push(sum.ok_or_else(impossible)?);
            }
            film.push_pixel(pixel, sums.iter().copied());
        }
        let (mut stream, expected) = input.finish();
        let mut stored = [0; 8];
        stream.read_exact(&mut stored).map_err(broken)?;
        if u64::from_le_bytes(stored) != expected {
            return Err(Error::invalid(
                STREAM,
                "the checksum does not fit the content",
                "the file is damaged: copy or render it anew",
            ));
        }
        Ok((film, header))
    }

    /// Writes the exact sums and the caller's `header` to a file, beside it and renamed.
    ///
    /// # Errors
    /// A header above [`MAX_STATE_HEADER`], a file that cannot be written, or a path that is a
    /// folder or a device or ends in no file name. The file is named.
    pub fn save_state(&self, path: &Path, header: &[u8]) -> Result<(), Error> {
        check_header_length(header.len()).map_err(|e| e.in_file(path))?;
        write_atomically(path, |writer| self.put_state(writer, header))
    }

    /// Reads a film and its header from a file that [`Self::save_state`] wrote.
    ///
    /// # Errors
    /// A file that cannot be read, or that holds none of what [`Self::read_state`] takes. The file
    /// is named.
    pub fn load_state(path: &Path, known: &[&'static Layer]) -> Result<(Self, Vec<u8>), Error> {
        let file = File::open(path).map_err(|e| Error::open(path, e))?;
        let reader = BufReader::with_capacity(1 << 18, file);
        Self::read_state(reader, known).map_err(|e| e.in_file(path))
    }
}

/// Reads the list of layers beside the first ones.
fn read_layers(
    input: &mut Summed<impl Read>,
    known: &[&'static Layer],
) -> Result<Vec<&'static Layer>, Error> {
    let count = u16::from_le_bytes(input.get().map_err(broken)?);
    let mut layers = Vec::new();
    for _ in 0..count {
        let sums = u16::from_le_bytes(input.get().map_err(broken)?);
        let [length] = input.get().map_err(broken)?;
        let mut name = [0; 255];
        let name = &mut name[..usize::from(length)];
        input.fill(name).map_err(broken)?;
        let name = String::from_utf8_lossy(name);
        let layer = known.iter().find(|layer| layer.name == name);
        match layer {
            Some(layer) if layer.sums() == usize::from(sums) => layers.push(*layer),
            _ => {
                return Err(Error::Unsupported {
                    place: STREAM.into(),
                    problem: format!("a layer {name:?} with {sums} sums in each pixel"),
                    remedy: "use the release of the program that wrote it, or render anew",
                });
            }
        }
    }
    Ok(layers)
}

fn get_u32(input: &mut Summed<impl Read>) -> Result<u32, Error> {
    Ok(u32::from_le_bytes(input.get().map_err(broken)?))
}

fn check_header_length(length: usize) -> Result<(), Error> {
    if length > MAX_STATE_HEADER {
        return Err(Error::too_large(
            STREAM,
            format!("a header of {length} bytes exceeds the limit of 1 MiB"),
            "shorten what describes the job; in a file that was read: it is damaged",
        ));
    }
    Ok(())
}

fn broken(source: io::Error) -> Error {
    if source.kind() == io::ErrorKind::UnexpectedEof {
        Error::invalid(STREAM, "it ends early", "the file is cut off: copy or render it anew")
    } else {
        Error::Io { place: STREAM.into(), action: "read it", source }
    }
}
