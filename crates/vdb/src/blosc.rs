//! Decoder of the Blosc 1 container: a 16-byte header, block offsets, and per block one or several
//! compressed streams.
//!
//! Format: `README_CHUNK_FORMAT.rst` of c-blosc 1.x. OpenVDB writes LZ4 with byte shuffle of 4-byte
//! elements in one block; the other codecs and layouts are read because other writers of the format
//! may use them.

use crate::blosclz;
use crate::compression::CodecError;
use crate::shuffle::{bit_unshuffle, unshuffle};

const HEADER: usize = 16;
const FORMAT_VERSION: u8 = 2;
const SHUFFLE: u8 = 1;
const STORED: u8 = 2;
const BIT_SHUFFLE: u8 = 4;
const RESERVED: u8 = 8;
const NO_SPLIT: u8 = 16;
/// A block is split into one stream per byte of its elements if they have at most this size...
const MAX_SPLITS: usize = 16;
/// ...and each stream has at least this many bytes.
const MIN_SPLIT: usize = 128;
/// Largest window of a Zstandard frame that is accepted, in bytes; blocks here are far smaller.
const MAX_ZSTD_WINDOW: u64 = 8 << 20;

fn damaged(what: impl Into<String>) -> CodecError {
    CodecError::damaged(format!("Blosc data: {}", what.into()))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    let field = bytes.get(at..)?.first_chunk::<4>()?;
    usize::try_from(u32::from_le_bytes(*field)).ok()
}

/// Decodes one Blosc chunk that must fill `dst` exactly. `scratch` is free to use and keeps its
/// capacity.
pub(crate) fn decompress(
    src: &[u8],
    dst: &mut [u8],
    scratch: &mut Vec<u8>,
) -> Result<(), CodecError> {
    let Some((header, _)) = src.split_first_chunk::<HEADER>() else {
        return Err(damaged(format!("the header needs 16 bytes, there are {}", src.len())));
    };
    let (version, flags, type_size) = (header[0], header[2], usize::from(header[3]));
    let field = |at| u32_at(header, at).unwrap_or(usize::MAX);
    let (total, block_size, packed) = (field(4), field(8), field(12));
    if version != FORMAT_VERSION {
        return Err(CodecError::unsupported(format!("Blosc data of format version {version}")));
    }
    if total != dst.len() {
        return Err(damaged(format!("holds {total} bytes, {} are expected", dst.len())));
    }
    if total == 0 {
        return Ok(());
    }
    let Some(src) = src.get(..packed) else {
        return Err(damaged(format!("claims {packed} bytes, there are {}", src.len())));
    };
    if flags & RESERVED != 0 || type_size == 0 || block_size == 0 || block_size > total {
        return Err(damaged("the header contradicts itself"));
    }
    if flags & STORED != 0 {
        let Some(body) = src.get(HEADER..).filter(|body| body.len() == total) else {
            return Err(damaged("the stored bytes have the wrong length"));
        };
        dst.copy_from_slice(body);
        return Ok(());
    }
    let codec = Codec::of(flags >> 5)?;
    let shuffled = (flags & SHUFFLE != 0 && type_size > 1) || flags & BIT_SHUFFLE != 0;
    for (index, block) in dst.chunks_mut(block_size).enumerate() {
        let Some(start) = u32_at(src, HEADER + 4 * index) else {
            return Err(damaged("the table of block offsets is cut off"));
        };
        let whole = block.len() == block_size;
        let split = flags & NO_SPLIT == 0
            && whole
            && type_size <= MAX_SPLITS
            && block_size / type_size >= MIN_SPLIT;
        let streams = if split { type_size } else { 1 };
        if !shuffled {
            decode_block(codec, src, start, streams, block)?;
            continue;
        }
        scratch.resize(block.len(), 0);
        decode_block(codec, src, start, streams, scratch)?;
        if flags & SHUFFLE != 0 && type_size > 1 {
            unshuffle(type_size, scratch, block);
        } else if block.len() >= type_size {
            bit_unshuffle(type_size, scratch, block);
        } else {
            block.copy_from_slice(scratch);
        }
    }
    Ok(())
}

/// Decodes the streams of one block, each with a 32-bit length in front; one as long as its output
/// is stored.
fn decode_block(
    codec: Codec,
    src: &[u8],
    mut start: usize,
    streams: usize,
    out: &mut [u8],
) -> Result<(), CodecError> {
    let length = out.len() / streams;
    if length * streams != out.len() {
        return Err(damaged("a block cannot be split evenly"));
    }
    for part in out.chunks_exact_mut(length) {
        let packed = u32_at(src, start).unwrap_or(usize::MAX);
        let body = start.saturating_add(4);
        let Some(stream) = src.get(body..).and_then(|rest| rest.get(..packed)) else {
            return Err(damaged("a block lies outside its chunk"));
        };
        start = body + packed;
        if packed == length {
            part.copy_from_slice(stream);
        } else if codec.decode(stream, part) != Some(length) {
            return Err(damaged(format!("a {} stream is damaged", codec.name())));
        }
    }
    Ok(())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Codec {
    BloscLz,
    Lz4,
    Zlib,
    Zstd,
}

impl Codec {
    fn of(code: u8) -> Result<Codec, CodecError> {
        match code {
            0 => Ok(Codec::BloscLz),
            1 => Ok(Codec::Lz4),
            2 => Err(CodecError::unsupported("Blosc data compressed with Snappy".into())),
            3 => Ok(Codec::Zlib),
            4 => Ok(Codec::Zstd),
            _ => Err(damaged(format!("the codec number {code} is unknown"))),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Codec::BloscLz => "BloscLZ",
            Codec::Lz4 => "LZ4",
            Codec::Zlib => "zlib",
            Codec::Zstd => "Zstandard",
        }
    }

    /// Number of bytes written, or nothing when the stream is damaged.
    fn decode(self, src: &[u8], dst: &mut [u8]) -> Option<usize> {
        match self {
            Codec::BloscLz => blosclz::decompress(src, dst),
            Codec::Lz4 => lz4_flex::block::decompress_into(src, dst).ok(),
            Codec::Zlib => {
                let mut inflate = flate2::Decompress::new(true);
                let done = inflate.decompress(src, dst, flate2::FlushDecompress::Finish);
                (done.ok()? == flate2::Status::StreamEnd)
                    .then(|| usize::try_from(inflate.total_out()).ok())?
            }
            Codec::Zstd => {
                if zstd_window(src)? > MAX_ZSTD_WINDOW {
                    return None;
                }
                ruzstd::decoding::FrameDecoder::new().decode_all(src, dst).ok()
            }
        }
    }
}

/// Bytes that a Zstandard decoder has to keep for this frame (RFC 8878, section 3.1.1.1).
fn zstd_window(frame: &[u8]) -> Option<u64> {
    let descriptor = *frame.get(4)?;
    if descriptor & 0x20 == 0 {
        let byte = *frame.get(5)?;
        let base = 1u64 << (10 + u32::from(byte >> 3));
        return Some(base + base / 8 * u64::from(byte & 7));
    }
    let at = 5 + [0, 1, 2, 4][usize::from(descriptor & 3)];
    let field = frame.get(at..)?;
    Some(match descriptor >> 6 {
        0 => u64::from(*field.first()?),
        1 => u64::from(u16::from_le_bytes(*field.first_chunk()?)) + 256,
        2 => u64::from(u32::from_le_bytes(*field.first_chunk()?)),
        _ => u64::from_le_bytes(*field.first_chunk()?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes that all frames of `tests/blosc` hold: slow ramps, a stretch without structure,
    /// and a repeat after 20,000 bytes.
    fn pattern(count: usize) -> Vec<u8> {
        let mut out: Vec<u8> = Vec::with_capacity(count);
        for i in 0..count {
            let k = i / 4;
            out.push(match i {
                20_000.. => out[i - 20_000],
                5_000..9_000 => (i * i / 64) as u8,
                _ => [(k / 9) as u8, (k / 300) as u8, 63, 0][i % 4],
            });
        }
        out
    }

    /// Name, unpacked length and bytes of each frame. They were made by c-blosc 1.21.3,
    /// `CODEC_SHUFFLE_TYPESIZE_LENGTH`.
    fn frames() -> Vec<(String, usize, Vec<u8>)> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/blosc");
        let entries = std::fs::read_dir(folder).unwrap();
        let mut frames: Vec<_> = entries
            .map(|entry| {
                let path = entry.unwrap().path();
                let name = path.file_stem().unwrap().to_string_lossy().into_owned();
                let length = name.split('_').nth(3).unwrap().parse().unwrap();
                (name, length, std::fs::read(path).unwrap())
            })
            .collect();
        frames.sort();
        frames
    }

    #[test]
    fn frames_of_every_codec_and_layout() {
        let mut count = 0;
        for (name, length, frame) in frames() {
            let mut out = vec![0; length];
            let result = decompress(&frame, &mut out, &mut Vec::new());
            if name.starts_with("snappy") {
                let fault = result.unwrap_err().at(9).into_error("f", None);
                assert!(matches!(fault, crate::Error::Unsupported { .. }), "{fault}");
                continue;
            }
            result.unwrap_or_else(|error| panic!("{name}: {error:?}"));
            assert!(out == pattern(length), "{name}");
            count += 1;
        }
        assert_eq!(count, 114);
    }

    #[test]
    fn damaged_frames_are_errors_or_bytes() {
        let mut scratch = Vec::new();
        for (name, length, frame) in frames() {
            let mut out = vec![0; length];
            assert!(decompress(&frame, &mut out[1..], &mut scratch).is_err(), "{name}: too small");
            for cut in (0..frame.len()).step_by(97) {
                assert!(
                    decompress(&frame[..cut], &mut out, &mut scratch).is_err(),
                    "{name}: {cut}"
                );
            }
            let body = if length < 1100 { frame.len() } else { 0 };
            for at in (0..body).step_by(3).chain(0..40) {
                for value in [0, 1, 0x7F, 0x80, 0xFF] {
                    let mut bad = frame.clone();
                    if let Some(byte) = bad.get_mut(at) {
                        *byte = value;
                    }
                    // Any end but a panic.
                    drop(decompress(&bad, &mut out, &mut scratch));
                }
            }
        }
    }

    #[test]
    fn huge_zstandard_windows_are_refused() {
        let frame = [0x28, 0xB5, 0x2F, 0xFD, 0, 0xF8, 0, 0, 0];
        assert!(zstd_window(&frame).is_some_and(|window| window > MAX_ZSTD_WINDOW));
        assert_eq!(Codec::Zstd.decode(&frame, &mut [0; 8]), None);
        assert_eq!(zstd_window(&[0x28, 0xB5, 0x2F, 0xFD, 0x20, 77]), Some(77));
        assert_eq!(zstd_window(&[0x28, 0xB5, 0x2F, 0xFD, 0x60, 1, 1]), Some(513));
        assert_eq!(zstd_window(&[0x28]), None);
    }
}
