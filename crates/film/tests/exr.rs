//! EXR files: exact round trips, metadata, broken bytes.

use std::fs;

use exr::prelude as x;
use half::f16;
use pileus_film::{
    Error, ExrCompression, ExrReport, ExrSettings, Image, MetaValue, Window, read_exr, write_exr,
};

/// Values of every kind: noise, specials, bits of NaN.
fn picture(width: u32, height: u32) -> Image {
    let mut image = Image::new(width, height, &["R", "G", "B", "A"]).unwrap();
    let mut state = 7u32;
    for name in ["R", "G", "B", "A"] {
        for v in image.channel_mut(name).unwrap() {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            *v = f32::from_bits(state);
        }
    }
    let specials = [0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE, 1e-45, 65504.0];
    image.channel_mut("G").unwrap()[..specials.len()].copy_from_slice(&specials);
    image.channel_mut("G").unwrap()[9] = f32::from_bits(0x7fc1_2345);
    image
}

fn bits(image: &Image, name: &str) -> Vec<u32> {
    image.channel(name).unwrap().iter().map(|v| v.to_bits()).collect()
}

#[test]
fn floats_are_stored_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut image = picture(37, 21);
    image.add_layer("variance", &picture(37, 21)).unwrap();
    let display = Window { x: 0, y: 0, width: 100, height: 50 };
    image.place(11, 5, display);
    for compression in [ExrCompression::Zip, ExrCompression::Piz, ExrCompression::None] {
        let settings = ExrSettings { compression, ..ExrSettings::default() };
        assert_eq!(write_exr(&path, &image, &settings).unwrap(), ExrReport::default());
        let read = read_exr(&path).unwrap();
        assert_eq!(read.channels().len(), 8);
        for channel in image.channels() {
            assert_eq!(bits(&read, &channel.name), bits(&image, &channel.name), "{compression:?}");
        }
        assert_eq!(read.data_window(), Window { x: 11, y: 5, width: 37, height: 21 });
        assert_eq!(read.display_window(), display);
        assert_eq!(bits(&read.layer("variance").unwrap(), "R"), bits(&image, "variance.R"));
    }
}

#[test]
fn halves_are_exact_rounded_or_clamped_and_layers_stay_floats() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    // Every finite half survives.
    let all: Vec<f32> = (0..=u16::MAX).map(|b| f16::from_bits(b).to_f32()).collect();
    let mut image = Image::new(256, 256, &[]).unwrap();
    let finite: Vec<f32> = all.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
    image.add_channel("R", finite).unwrap();
    let half = ExrSettings { half: true, ..ExrSettings::default() };
    assert_eq!(write_exr(&path, &image, &half).unwrap().half_clamped, 0);
    assert_eq!(bits(&read_exr(&path).unwrap(), "R"), bits(&image, "R"));

    let values = [65504.0, 65519.9, 65520.0, 1e30, f32::INFINITY, -1e9, 0.1, f32::NAN];
    let mut image = Image::new(8, 1, &[]).unwrap();
    image.add_channel("R", values.to_vec()).unwrap();
    image.add_channel("variance.R", values.to_vec()).unwrap();
    assert_eq!(write_exr(&path, &image, &half).unwrap().half_clamped, 4);
    let read = read_exr(&path).unwrap();
    let red = read.channel("R").unwrap();
    assert_eq!(red[..6], [65504.0, 65504.0, 65504.0, 65504.0, 65504.0, -65504.0]);
    assert_eq!(red[6], f16::from_f32(0.1).to_f32());
    assert!(red[7].is_nan());
    assert_eq!(bits(&read, "variance.R"), bits(&image, "variance.R"));
    assert_eq!(read.meta("pileus:half_clamped"), Some(&MetaValue::I32(4)));
}

fn some_metadata() -> Vec<(String, MetaValue)> {
    let long = "a name that is much longer than the thirty-one bytes of old".replace(' ', "_");
    vec![
        ("comments".into(), MetaValue::Text("Wölkchen über 東京 ☁".into())),
        (long, MetaValue::Text("x".repeat(100_000))),
        ("pileus:exposure".into(), MetaValue::F32(0.1)),
        ("pileus:plan".into(), MetaValue::Text("{\"media\": 1}\nline two".into())),
        ("pileus:render_seconds".into(), MetaValue::F64(1.0 / 3.0)),
        ("pileus:seed".into(), MetaValue::I32(-5)),
        ("pileus:empty".into(), MetaValue::Text(String::new())),
        ("software".into(), MetaValue::Text("Pileus 0.1.0".into())),
    ]
}

#[test]
fn metadata_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut metadata = some_metadata();
    let settings = ExrSettings { metadata: metadata.clone(), ..ExrSettings::default() };
    write_exr(&path, &picture(4, 4), &settings).unwrap();
    metadata.sort_by(|a, b| a.0.cmp(&b.0));
    assert_eq!(read_exr(&path).unwrap().metadata, metadata);

    let meta = x::MetaData::read_from_file(&path, true).unwrap();
    let chromaticities = meta.headers[0].shared_attributes.chromaticities.unwrap();
    assert_eq!(chromaticities.red, x::Vec2(0.64, 0.33));
    assert_eq!(chromaticities.white, x::Vec2(0.3127, 0.329));
}

#[test]
fn metadata_that_cannot_be_stored_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let n = MetaValue::I32(1);
    for pairs in [
        vec![("channels", n.clone())],
        vec![("dataWindow", MetaValue::Text("x".into()))],
        vec![("software", n.clone())],
        vec![("", n.clone())],
        vec![("two words", n.clone())],
        vec![("a\0b", n.clone())],
        vec![("twice", n.clone()), ("twice", n.clone())],
    ] {
        let metadata = pairs.into_iter().map(|(k, v)| (k.to_string(), v)).collect();
        let settings = ExrSettings { metadata, ..ExrSettings::default() };
        let error = write_exr(&path, &picture(4, 4), &settings).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }) && error.place() == path, "{error}");
    }
    // Windows beyond the numbers of the format.
    let far = Window { x: i32::MAX, y: i32::MIN, width: u32::MAX, height: u32::MAX };
    let mut image = picture(4, 4);
    for x in [i32::MAX - 1, 0] {
        image.place(x, 0, far);
        let error = write_exr(&path, &image, &ExrSettings::default()).unwrap_err();
        assert!(matches!(error, Error::Io { .. }) && error.place() == path, "{error}");
    }
    let empty = Image::new(4, 4, &[]).unwrap();
    let error = write_exr(&path, &empty, &ExrSettings::default()).unwrap_err();
    assert!(matches!(error, Error::Invalid { .. }) && error.place() == path, "{error}");
    assert!(error.to_string().contains("no channels"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn equal_images_are_equal_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let image = picture(64, 200);
    let write = |parallel| {
        let settings =
            ExrSettings { parallel, metadata: some_metadata(), half: true, ..Default::default() };
        write_exr(&path, &image, &settings).unwrap();
        fs::read(&path).unwrap()
    };
    let first = write(false);
    for i in 0..6 {
        assert!(write(i % 2 == 0) == first, "run {i}");
    }
}

#[test]
fn writing_and_reading_inside_a_thread_pool_ends() {
    let folder = tempfile::tempdir().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        for parallel in [false, true] {
            let path = folder.path().join("a.exr");
            let settings = ExrSettings { parallel, ..ExrSettings::default() };
            write_exr(&path, &picture(64, 200), &settings).unwrap();
            assert_eq!(read_exr(&path).unwrap().channels().len(), 4);
        }
    });
}

#[test]
fn several_parts_become_layers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let part = |name: &str, channel: &str, samples| {
        let attributes = x::LayerAttributes::named(name);
        let channel = x::AnyChannel::new(channel, samples);
        let channels = x::AnyChannels::sort([channel].into_iter().collect());
        x::Layer::new((2, 2), attributes, x::Encoding::UNCOMPRESSED, channels)
    };
    let layers = vec![
        part("beauty", "Y", x::FlatSamples::F16(vec![f16::ONE; 4])),
        part("depth", "Z", x::FlatSamples::F32(vec![0.1, 0.2, 0.3, 0.4])),
        part("id", "id.X", x::FlatSamples::U32(vec![1, 2, 3, 1 << 24])),
    ];
    let attributes = x::ImageAttributes::with_size((2, 2));
    let image = x::Image::from_layers(attributes, layers);
    x::WritableImage::write(&image).to_file(&path).unwrap();
    let read = read_exr(&path).unwrap();
    assert_eq!(read.channel("Y").unwrap(), [1.0; 4]);
    assert_eq!(read.channel("depth.Z").unwrap(), [0.1, 0.2, 0.3, 0.4]);
    assert_eq!(read.channel("id.X").unwrap(), [1.0, 2.0, 3.0, 16_777_216.0]);
}

#[test]
fn broken_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    assert!(matches!(read_exr(&path), Err(Error::Missing { .. })));
    // Whatever the damage, the file is named.
    let damaged = || {
        let error = read_exr(&path).unwrap_err();
        let sound = matches!(
            error,
            Error::Io { .. }
                | Error::Invalid { .. }
                | Error::Unsupported { .. }
                | Error::TooLarge { .. }
        );
        assert!(sound && error.place() == path, "{error}");
        error
    };
    fs::write(&path, b"").unwrap();
    assert!(matches!(damaged(), Error::Invalid { .. } | Error::Io { .. }));
    fs::write(&path, b"this is not an image at all").unwrap();
    assert!(matches!(damaged(), Error::Invalid { .. }));
    let no_file = read_exr(folder.path()).unwrap_err();
    assert!(matches!(no_file, Error::Invalid { .. }), "{no_file}");
    assert!(no_file.to_string().contains("no plain file"), "{no_file}");

    for compression in [ExrCompression::Zip, ExrCompression::Piz, ExrCompression::None] {
        let settings = ExrSettings {
            half: true,
            compression,
            metadata: vec![("pileus:seed".into(), MetaValue::I32(1))],
            ..ExrSettings::default()
        };
        write_exr(&path, &picture(19, 40), &settings).unwrap();
        let good = fs::read(&path).unwrap();
        for length in (0..good.len()).step_by(if good.len() > 4000 { 41 } else { 7 }) {
            fs::write(&path, &good[..length]).unwrap();
            let error = damaged();
            let cut = matches!(error, Error::Invalid { .. } | Error::Io { .. });
            assert!(cut, "{length} of {} bytes: {error}", good.len());
        }
        let rounds: usize = 600;
        // Changed bytes may pass as other pixels; they must not panic.
        let mut state = 1u32;
        for i in 0..rounds {
            let mut broken = good.clone();
            for _ in 0..1 + i % 4 {
                state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                let range = if i % 2 == 0 { good.len().min(700) } else { good.len() };
                let at = (state >> 8) as usize % range;
                broken[at] = if i % 3 == 0 { 0xff } else { (state >> 3) as u8 };
            }
            fs::write(&path, &broken).unwrap();
            if let Err(error) = read_exr(&path) {
                assert_eq!(error.place(), path);
            }
        }
    }
}

#[test]
fn broken_files_of_other_makes_are_errors() {
    use x::{Blocks, Compression, LineOrder, Vec2};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut state = 3u32;
    let mut next = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 8) as usize
    };
    for (compression, blocks) in [
        (Compression::RLE, Blocks::ScanLines),
        (Compression::ZIP1, Blocks::Tiles(Vec2(16, 8))),
        (Compression::PXR24, Blocks::ScanLines),
        (Compression::B44, Blocks::Tiles(Vec2(32, 32))),
        (Compression::B44A, Blocks::ScanLines),
        (Compression::PIZ, Blocks::Tiles(Vec2(16, 16))),
        (Compression::DWAA(None), Blocks::ScanLines),
    ] {
        let values = || (0..37 * 53).map(|i| (i as f32 * 0.01).sin().abs());
        let half = x::FlatSamples::F16(values().map(f16::from_f32).collect());
        let channels = ["R", "G", "B", "Z"].into_iter().map(|name| {
            let float = x::FlatSamples::F32(values().collect());
            x::AnyChannel::new(name, if name == "Z" { float } else { half.clone() })
        });
        let encoding = x::Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let channels = x::AnyChannels::sort(channels.collect());
        let layer = x::Layer::new((37, 53), x::LayerAttributes::named("main"), encoding, channels);
        let image = x::Image::from_layer(layer);
        x::WritableImage::write(&image).non_parallel().to_file(&path).unwrap();
        assert_eq!(read_exr(&path).unwrap().channels().len(), 4);
        let good = fs::read(&path).unwrap();
        let rounds: usize = 300;
        for i in 0..rounds {
            let mut broken = good.clone();
            for _ in 0..1 + i % 4 {
                let range = if i % 2 == 0 { good.len().min(900) } else { good.len() };
                broken[next() % range] = if i % 3 == 0 { 0xff } else { next() as u8 };
            }
            if i % 5 == 0 {
                broken.truncate(next() % good.len());
            }
            fs::write(&path, &broken).unwrap();
            if let Err(error) = read_exr(&path) {
                assert_eq!(error.place(), path);
            }
        }
    }
}

#[test]
fn sizes_in_the_header_do_not_allocate() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write_exr(&path, &picture(16, 16), &ExrSettings::default()).unwrap();
    let good = fs::read(&path).unwrap();
    let at = good.windows(17).position(|w| w == b"dataWindow\0box2i\0").unwrap() + 17 + 4 + 8;
    for (side, expected) in [(40_000, "above 1024 or 2^30"), (16384, "cannot hold")] {
        let mut broken = good.clone();
        for corner in [at, at + 4] {
            broken[corner..corner + 4].copy_from_slice(&(side - 1i32).to_le_bytes());
        }
        fs::write(&path, &broken).unwrap();
        let error = read_exr(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
