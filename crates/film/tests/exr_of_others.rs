//! EXR files as other programs write them: compressions, channels, colour spaces, damaged blocks.

use std::fs;
use std::path::{Path, PathBuf};

use exr::prelude as x;
use half::f16;
use pileus_film::{
    Chromaticities, Error, ExrSettings, Image, MetaValue, read_exr, read_exr_color,
    read_exr_header, write_exr,
};

const WIDTH: usize = 37;
const HEIGHT: usize = 53;

/// A smooth picture between 0.1 and 1.9.
fn value(channel: usize, i: usize) -> f32 {
    let (column, row) = ((i % WIDTH) as f32, (i / WIDTH) as f32);
    1.0 + 0.9 * (0.11 * column + 0.07 * row + channel as f32).sin()
}

fn write(path: &Path, channels: &[&str], compression: x::Compression, blocks: x::Blocks) {
    let list = channels.iter().enumerate().map(|(channel, &name)| {
        let values = (0..WIDTH * HEIGHT).map(|i| value(channel, i));
        let samples = match name {
            "Z" => x::FlatSamples::F32(values.collect()),
            _ => x::FlatSamples::F16(values.map(f16::from_f32).collect()),
        };
        x::AnyChannel::new(name, samples)
    });
    let encoding = x::Encoding { compression, blocks, line_order: x::LineOrder::Increasing };
    let channels = x::AnyChannels::sort(list.collect());
    let attributes = x::LayerAttributes::named("main");
    let layer = x::Layer::new((WIDTH, HEIGHT), attributes, encoding, channels);
    x::WritableImage::write(&x::Image::from_layer(layer)).non_parallel().to_file(path).unwrap();
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    (folder, path)
}

/// Where the header of a file of one part ends: behind its last NUL.
fn header_end(bytes: &[u8]) -> usize {
    let mut at = 8;
    while bytes[at] != 0 {
        for _ in 0..2 {
            at += bytes[at..].iter().position(|&b| b == 0).unwrap() + 1;
        }
        at += 4 + u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    }
    at + 1
}

/// Where the value of an attribute begins.
fn attribute(bytes: &[u8], name: &str, kind: &str) -> usize {
    let key = format!("{name}\0{kind}\0");
    let found = bytes.windows(key.len()).position(|w| w == key.as_bytes()).unwrap();
    found + key.len() + 4
}

#[test]
fn dwa_is_read() {
    let (_folder, path) = folder();
    for (compression, blocks) in [
        (x::Compression::DWAA(None), x::Blocks::ScanLines),
        (x::Compression::DWAB(Some(10.0)), x::Blocks::ScanLines),
        (x::Compression::DWAA(None), x::Blocks::Tiles(x::Vec2(16, 8))),
    ] {
        write(&path, &["B", "G", "R", "A", "Z"], compression, blocks);
        let image = read_exr(&path).unwrap();
        for (channel, name) in ["B", "G", "R", "A", "Z"].into_iter().enumerate() {
            // Colours are lossy, alpha and depth exact.
            let tolerance = match name {
                "A" => 1e-3,
                "Z" => 0.0,
                _ => 0.05,
            };
            for (i, v) in image.channel(name).unwrap().iter().enumerate() {
                let expected = value(channel, i);
                assert!((v - expected).abs() <= tolerance, "{name} {i}: {v} {expected}");
            }
        }
    }
}

/// The first block's counters are set to what no block of its size can hold.
#[test]
fn dwa_blocks_that_claim_too_much_are_refused() {
    let (_folder, path) = folder();
    write(&path, &["B", "G", "R", "A", "Z"], x::Compression::DWAA(None), x::Blocks::ScanLines);
    let good = fs::read(&path).unwrap();
    let table = header_end(&good);
    let block = u64::from_le_bytes(good[table..table + 8].try_into().unwrap()) as usize;
    for counter in [1, 6, 7, 8, 9] {
        for claim in [1u64 << 24, 1 << 40, i64::MAX as u64, u64::MAX] {
            let mut broken = good.clone();
            let at = block + 8 + 8 * counter;
            broken[at..at + 8].copy_from_slice(&claim.to_le_bytes());
            fs::write(&path, &broken).unwrap();
            let error = read_exr(&path).unwrap_err();
            assert!(matches!(error, Error::Invalid { .. }), "{error}");
            assert!(error.to_string().contains("claims too much"), "{error}");
        }
    }
    // Any other damage: errors or other pixels, never a panic or more memory than pixels need.
    let mut state = 5u32;
    let mut next = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as usize
    };
    for i in 0..120 {
        let mut broken = good.clone();
        for _ in 0..1 + i % 5 {
            let range = if i % 2 == 0 { block..good.len() } else { block..block + 100 };
            let at = range.start + next() % range.len();
            broken[at] = if i % 3 == 0 { 0xff } else { next() as u8 };
        }
        fs::write(&path, &broken).unwrap();
        if let Err(error) = read_exr(&path) {
            assert_eq!(error.place(), path);
        }
    }
}

#[test]
fn compressions_that_are_not_read_are_named() {
    let (_folder, path) = folder();
    write(&path, &["B", "G", "R"], x::Compression::ZIP16, x::Blocks::ScanLines);
    let mut bytes = fs::read(&path).unwrap();
    let at = attribute(&bytes, "compression", "compression");
    for (number, name) in
        [(10, "HTJ2K256"), (11, "HTJ2K32"), (12, "LJ2K"), (13, "ZSTD"), (14, "number 14")]
    {
        bytes[at] = number;
        fs::write(&path, &bytes).unwrap();
        for error in [read_exr(&path).unwrap_err(), read_exr_color(&path).unwrap_err()] {
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            let text = error.to_string();
            assert!(text.contains(name) && text.contains("ZIP or PIZ"), "{text}");
        }
        let header = read_exr_header(&path).unwrap();
        assert_eq!(header.parts[0].compression, number);
        assert_eq!(header.parts[0].channels.len(), 3);
        assert!(read_exr_color(&path).unwrap_err().to_string().contains("channels B, G, R"));
    }
}

#[test]
fn colours_are_found_under_other_names() {
    let (_folder, path) = folder();
    let zip = x::Compression::ZIP16;
    for (names, rgb) in [
        (&["B", "G", "R", "variance.B", "variance.G", "variance.R"][..], [2, 1, 0]),
        (&["V.Combined.A", "V.Combined.B", "V.Combined.G", "V.Combined.R", "V.Depth.Z"], [3, 2, 1]),
        (&["V"], [0; 3]),
        (&["A", "Y"], [1; 3]),
        (&["Depth.V"], [0; 3]),
    ] {
        write(&path, names, zip, x::Blocks::ScanLines);
        let image = read_exr(&path).unwrap();
        let planes = image.rgb_planes().unwrap();
        let (_, part, pixels) = read_exr_color(&path).unwrap();
        assert_eq!(part, 0);
        for (i, pixel) in pixels.iter().enumerate() {
            let expected = rgb.map(|channel| f16::from_f32(value(channel, i)).to_f32());
            assert_eq!(*pixel, expected, "{names:?}");
            assert_eq!(planes.map(|plane| plane[i]), expected, "{names:?}");
        }
    }
    write(&path, &["Normal.X", "Normal.Y2", "Depth.Z"], zip, x::Blocks::ScanLines);
    assert!(read_exr(&path).unwrap().rgb_planes().is_none());
    let text = read_exr_color(&path).unwrap_err().to_string();
    assert!(text.contains("Depth.Z, Normal.X, Normal.Y2") && text.contains("37 x 53"), "{text}");
    assert!(text.contains("ZIP compression") && text.contains("R, G and B"), "{text}");
}

#[test]
fn parts_are_layers() {
    let (_folder, path) = folder();
    let part = |name: &str, channels: &[&str], level: f32| {
        let list = channels.iter().enumerate().map(|(i, &name)| {
            let value = f16::from_f32(level + i as f32);
            x::AnyChannel::new(name, x::FlatSamples::F16(vec![value; 6]))
        });
        let channels = x::AnyChannels::sort(list.collect());
        let attributes = x::LayerAttributes::named(name);
        x::Layer::new((3, 2), attributes, x::Encoding::FAST_LOSSLESS, channels)
    };
    let layers = vec![
        part("V.AO", &["B", "G", "R"], 10.0),
        part("V.Combined", &["V.Combined.B", "V.Combined.G", "V.Combined.R"], 20.0),
        part("V.Depth", &["Z"], 30.0),
    ];
    let attributes = x::ImageAttributes::with_size((3, 2));
    let image = x::Image::from_layers(attributes, layers);
    x::WritableImage::write(&image).to_file(&path).unwrap();
    let (header, part, pixels) = read_exr_color(&path).unwrap();
    assert_eq!((header.parts.len(), part), (3, 1));
    assert_eq!(pixels, vec![[22.0, 21.0, 20.0]; 6]);
    let (_, found) = header.color().unwrap();
    assert_eq!(found.layer.as_deref(), Some("V.Combined"));
    assert_eq!(found.others, ["V.AO"]);
    let lines = header.describe();
    assert!(lines[2].starts_with("part \"V.Depth\": 3 x 2, RLE compression"), "{lines:?}");
}

#[test]
fn luminance_and_chroma_are_refused_by_name() {
    let (_folder, path) = folder();
    write(&path, &["BY", "RY", "Y"], x::Compression::ZIP16, x::Blocks::ScanLines);
    let mut bytes = fs::read(&path).unwrap();
    let text = read_exr_color(&path).unwrap_err().to_string();
    assert!(text.contains("(Y, RY, BY)") && text.contains("channels BY, RY, Y"), "{text}");
    // With half the resolution for chroma, as the reference images have it.
    let at = attribute(&bytes, "channels", "chlist");
    for start in [at + 3 + 8, at + 19 + 3 + 8] {
        bytes[start..start + 8].copy_from_slice(&[2, 0, 0, 0, 2, 0, 0, 0]);
    }
    fs::write(&path, &bytes).unwrap();
    for error in [read_exr(&path).unwrap_err(), read_exr_color(&path).unwrap_err()] {
        assert!(matches!(error, Error::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains("(Y, RY, BY)"), "{error}");
    }
    assert_eq!(read_exr_header(&path).unwrap().parts[0].channels[0].sampling, [2, 2]);
}

#[test]
fn blocks_that_are_missing_are_errors() {
    let (_folder, path) = folder();
    write(&path, &["B", "G", "R"], x::Compression::ZIP16, x::Blocks::ScanLines);
    let mut bytes = fs::read(&path).unwrap();
    // The table leads to the first block twice; what the second would hold is not there.
    let table = header_end(&bytes);
    bytes.copy_within(table..table + 8, table + 8);
    fs::write(&path, &bytes).unwrap();
    let error = read_exr(&path).unwrap_err();
    assert!(error.to_string().contains("blocks are missing"), "{error}");
}

#[test]
fn own_files_name_their_colour_space() {
    let (_folder, path) = folder();
    let image = Image::new(2, 2, &["R", "G", "B"]).unwrap();
    let metadata = vec![("pileus:seed".to_owned(), MetaValue::I32(7))];
    write_exr(&path, &image, &ExrSettings { metadata, ..Default::default() }).unwrap();
    let part = read_exr_header(&path).unwrap().parts.remove(0);
    assert_eq!(part.color_interop_id.as_deref(), Some("lin_rec709_scene"));
    let named = pileus_film::ColorSpace::of_chromaticities(part.chromaticities.unwrap());
    let own = pileus_film::ColorSpace::of_chromaticities(Chromaticities::REC_709);
    assert!(named.as_ref().is_some_and(|space| space.is_linear_rec_709()) && named == own);
    assert_eq!(part.metadata, [("pileus:seed".to_owned(), MetaValue::I32(7))]);
    let metadata = vec![("colorInteropID".to_owned(), MetaValue::Text("lin_ap1_scene".into()))];
    let taken = ExrSettings { metadata, ..Default::default() };
    assert!(matches!(write_exr(&path, &image, &taken), Err(Error::Invalid { .. })));
}

#[test]
fn damaged_headers_are_errors() {
    let (folder, path) = folder();
    write(&path, &["A", "layer.B"], x::Compression::PIZ, x::Blocks::Tiles(x::Vec2(16, 16)));
    let good = fs::read(&path).unwrap();
    let end = header_end(&good);
    for length in 0..end {
        fs::write(&path, &good[..length]).unwrap();
        let error = read_exr_header(&path).unwrap_err();
        let cut = matches!(error, Error::Invalid { .. } | Error::Io { .. });
        assert!(cut && error.place() == path, "{length}: {error}");
    }
    fs::write(&path, &good[..end]).unwrap();
    assert_eq!(read_exr_header(&path).unwrap().parts[0].tiles, Some([16, 16]));
    for at in 0..end {
        for value in [0, 0x7f, 0xff] {
            let mut broken = good.clone();
            broken[at] = value;
            fs::write(&path, &broken).unwrap();
            if let Err(error) = read_exr_header(&path) {
                assert_eq!(error.place(), path);
            }
        }
    }
    assert!(matches!(read_exr_header(folder.path()), Err(Error::Invalid { .. })));
    let none = folder.path().join("none.exr");
    assert!(matches!(read_exr_header(&none), Err(Error::Missing { .. })));
}

/// Tiles whose size in the header asks for more than the image is worth.
#[test]
fn giant_tiles_are_refused() {
    let (_folder, path) = folder();
    write(&path, &["B", "G", "R"], x::Compression::ZIP16, x::Blocks::Tiles(x::Vec2(16, 16)));
    let mut bytes = fs::read(&path).unwrap();
    let at = attribute(&bytes, "tiles", "tiledesc");
    bytes[at..at + 4].copy_from_slice(&(1u32 << 30).to_le_bytes());
    bytes[at + 4..at + 8].copy_from_slice(&(1u32 << 30).to_le_bytes());
    fs::write(&path, &bytes).unwrap();
    let error = read_exr(&path).unwrap_err();
    assert!(error.to_string().contains("tiles of 1073741824"), "{error}");
}
