//! State files: exact, and safe with broken bytes.

use pileus_film::{
    Error, Film, LAYERS, Layer, MAX_STATE_HEADER, PixelSample, Reconstruction, SAMPLES,
};

/// A layer with two sums in each pixel.
static PAIR: Layer = Layer {
    name: "pair",
    meaning: "two means",
    channels: &["pair.X", "pair.Y"],
    reconstruction: Reconstruction::Mean(|sample, _, values| {
        values.copy_from_slice(&[sample.rgb[0], 1e-3 * sample.rgb[2]]);
    }),
};

/// A layer of the same name that has another number of sums.
static OTHER_PAIR: Layer = Layer { channels: &["pair.X"], ..PAIR };

const PIXEL: usize = 548 + 2 * 16;

fn known() -> Vec<&'static Layer> {
    LAYERS.into_iter().chain([&PAIR]).collect()
}

fn read(bytes: &[u8]) -> Result<(Film, Vec<u8>), Error> {
    Film::read_state(bytes, &known())
}

fn state() -> (Film, Vec<u8>) {
    let mut film = Film::with_layers([3, 2], None, &[&SAMPLES, &PAIR]).unwrap();
    let mut tile = film.tile(0, 0, 3, 2);
    tile.start(0..10).unwrap();
    for i in 0..60 {
        let v = 0.1 + i as f32;
        tile.add(i % 3, i / 3 % 2, u64::from(i / 6), &PixelSample::new([v, -v, v * v], 0.3));
    }
    film.add_tiles(&[tile]).unwrap();
    film.commit_pass(10);
    let mut bytes = Vec::new();
    film.write_state(&mut bytes, b"job 1, samples 0..10").unwrap();
    (film, bytes)
}

#[test]
fn round_trip_through_a_file() {
    let (film, bytes) = state();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slice.pileus");
    film.save_state(&path, b"job 1, samples 0..10").unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    let (loaded, header) = Film::load_state(&path, &known()).unwrap();
    assert_eq!(loaded, film);
    assert_eq!(loaded.layers(), film.layers());
    assert_eq!(header, b"job 1, samples 0..10");
    // What follows is the caller's.
    let mut reader: &[u8] = &[bytes.as_slice(), b"more"].concat();
    Film::read_state(&mut reader, &known()).unwrap();
    assert_eq!(reader, b"more");
}

#[test]
fn layers_without_sums_take_no_bytes_and_others_sixteen_a_channel() {
    let length = |further: &[&'static Layer]| {
        let film = Film::with_layers([3, 2], None, further).unwrap();
        let mut bytes = Vec::new();
        film.write_state(&mut bytes, b"").unwrap();
        bytes.len()
    };
    let first = length(&[]);
    // Length and number of sums, and the name, once.
    assert_eq!(length(&[&SAMPLES]), first + 3 + "samples".len());
    assert_eq!(length(&[&PAIR]), first + 3 + "pair".len() + 6 * 2 * 16);
}

#[test]
fn layers_that_are_not_known_are_refused_by_name() {
    let (_, bytes) = state();
    let others = [&PAIR as &Layer, &OTHER_PAIR].map(|other| LAYERS.into_iter().chain([other]));
    for (list, found) in [(LAYERS.to_vec(), false)]
        .into_iter()
        .chain(others.into_iter().zip([true, false]).map(|(list, found)| (list.collect(), found)))
    {
        match Film::read_state(bytes.as_slice(), &list) {
            Ok(_) => assert!(found),
            Err(error) => {
                assert!(matches!(error, Error::Unsupported { .. }) && !found, "{error}");
                let text = error.to_string();
                assert!(text.contains("\"pair\" with 2 sums"), "{text}");
            }
        }
    }
}

#[test]
fn every_cut_and_every_changed_bit_is_found() {
    let (_, bytes) = state();
    for length in 0..bytes.len() {
        let error = read(&bytes[..length]).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{length}: {error}");
    }
    for i in 0..bytes.len() {
        for bit in 0..8 {
            let mut broken = bytes.clone();
            broken[i] ^= 1 << bit;
            let error = read(&broken).err().unwrap_or_else(|| panic!("byte {i} bit {bit}"));
            // What names a version or a layer can become another name.
            let found = match error {
                Error::Invalid { .. } | Error::TooLarge { .. } => true,
                Error::Unsupported { .. } => i < bytes.len() - 8 - 6 * PIXEL,
                _ => false,
            };
            assert!(found, "byte {i} bit {bit}: {error}");
        }
    }
}

#[test]
fn errors_name_file_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slice.pileus");
    let missing = Film::load_state(&path, &known()).unwrap_err();
    assert!(matches!(missing, Error::Missing { .. }) && missing.place() == path);

    let (film, mut bytes) = state();
    // A later version, and that of the release before.
    for number in [9, 2] {
        bytes[8] = number;
        std::fs::write(&path, &bytes).unwrap();
        let version = Film::load_state(&path, &known()).unwrap_err();
        assert!(matches!(version, Error::Unsupported { .. }) && version.place() == path);
        let text = version.to_string();
        assert!(text.contains(&format!("version {number}")) && text.contains("anew"), "{text}");
    }

    std::fs::write(&path, b"P6 something else").unwrap();
    let other = Film::load_state(&path, &known()).unwrap_err();
    assert!(other.to_string().contains("slice or checkpoint"), "{other}");

    let long = vec![0; MAX_STATE_HEADER + 1];
    assert!(matches!(film.save_state(&path, &long), Err(Error::TooLarge { .. })));
}

#[test]
fn sizes_in_the_header_do_not_allocate() {
    let (_, bytes) = state();
    let sizes = 16 + 20;
    let mut huge = bytes.clone();
    // 16384 x 16384 pixels would be 137 GiB; there are bytes for six.
    for at in [0, 4, 16, 20] {
        huge[sizes + at..][..4].copy_from_slice(&16384u32.to_le_bytes());
    }
    let error = read(&huge).unwrap_err();
    assert!(error.to_string().contains("ends early"), "{error}");
    for at in [0, 4, 16, 20] {
        huge[sizes + at..][..4].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    }
    assert!(matches!(read(&huge), Err(Error::TooLarge { .. })));
}

/// CRC-64/XZ, bit by bit.
fn crc(bytes: &[u8]) -> u64 {
    !bytes.iter().fold(u64::MAX, |crc, byte| {
        (0..8).fold(crc ^ u64::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xC96C_5795_D787_0F42 & (crc & 1).wrapping_neg())
        })
    })
}

/// A state whose checksum was made to fit: whatever is read does not panic, in use either.
#[test]
fn doctored_sums_do_no_harm() {
    let (film, bytes) = state();
    let (content, pixels) = (bytes.len() - 8, 6 * PIXEL);
    assert_eq!(crc(&bytes[..content]).to_le_bytes(), bytes[content..]);
    let (mut refused, mut accepted) = (0, 0);
    for at in content - pixels..content {
        for byte in [0x00, 0x01, 0x7f, 0x80, 0xff] {
            let mut doctored = bytes.clone();
            doctored[at] = byte;
            let sum = crc(&doctored[..content]);
            doctored[content..].copy_from_slice(&sum.to_le_bytes());
            match read(&doctored) {
                Err(error) => {
                    assert!(error.to_string().contains("no samples add up to"), "{error}");
                    refused += 1;
                }
                Ok((mut doctored, _)) => {
                    doctored.merge(&film).unwrap();
                    let _ = (doctored.image(), doctored.variance());
                    accepted += 1;
                }
            }
        }
    }
    // Most sums are far below the largest that their samples could have.
    assert!(refused > 1000 && accepted > 1000, "{refused} {accepted}");
}
