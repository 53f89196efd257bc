//! State files: exact, and safe with broken bytes.

use pileus_film::{Error, Film, MAX_STATE_HEADER, PixelSample, Tile};

fn state() -> (Film, Vec<u8>) {
    let mut film = Film::new([3, 2], None).unwrap();
    let mut tile = Tile::new(0, 0, 3, 2);
    for i in 0..60 {
        let v = 0.1 + i as f32;
        tile.add(
            i % 3,
            i / 3 % 2,
            u64::from(i / 6),
            &PixelSample { rgb: [v, -v, v * v], alpha: 0.3 },
        );
    }
    film.add_tile(&tile);
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
    let (read, header) = Film::load_state(&path).unwrap();
    assert_eq!(read, film);
    assert_eq!(header, b"job 1, samples 0..10");
    // What follows is the caller's.
    let mut reader: &[u8] = &[bytes.as_slice(), b"more"].concat();
    Film::read_state(&mut reader).unwrap();
    assert_eq!(reader, b"more");
}

#[test]
fn every_cut_and_every_changed_bit_is_found() {
    let (_, bytes) = state();
    for length in 0..bytes.len() {
        let error = Film::read_state(&bytes[..length]).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{length}: {error}");
    }
    for i in 0..bytes.len() {
        for bit in 0..8 {
            let mut broken = bytes.clone();
            broken[i] ^= 1 << bit;
            assert!(Film::read_state(broken.as_slice()).is_err(), "byte {i} bit {bit}");
        }
    }
}

#[test]
fn errors_name_file_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slice.pileus");
    let missing = Film::load_state(&path).unwrap_err();
    assert!(matches!(missing, Error::Missing { .. }) && missing.place() == path);

    let (film, mut bytes) = state();
    bytes[8] = 9;
    std::fs::write(&path, &bytes).unwrap();
    let version = Film::load_state(&path).unwrap_err();
    assert!(matches!(version, Error::Unsupported { .. }) && version.place() == path);
    assert!(version.to_string().contains("version 9"), "{version}");

    std::fs::write(&path, b"P6 something else").unwrap();
    let other = Film::load_state(&path).unwrap_err();
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
    let error = Film::read_state(huge.as_slice()).unwrap_err();
    assert!(error.to_string().contains("ends early"), "{error}");
    for at in [0, 4, 16, 20] {
        huge[sizes + at..][..4].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    }
    assert!(matches!(Film::read_state(huge.as_slice()), Err(Error::TooLarge { .. })));
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
    let (content, pixels) = (bytes.len() - 8, 6 * 548);
    assert_eq!(crc(&bytes[..content]).to_le_bytes(), bytes[content..]);
    let (mut refused, mut read) = (0, 0);
    for at in content - pixels..content {
        for byte in [0x00, 0x01, 0x7f, 0x80, 0xff] {
            let mut doctored = bytes.clone();
            doctored[at] = byte;
            let sum = crc(&doctored[..content]);
            doctored[content..].copy_from_slice(&sum.to_le_bytes());
            match Film::read_state(doctored.as_slice()) {
                Err(error) => {
                    assert!(error.to_string().contains("no samples add up to"), "{error}");
                    refused += 1;
                }
                Ok((mut doctored, _)) => {
                    doctored.merge(&film).unwrap();
                    let _ = (doctored.image(), doctored.variance());
                    read += 1;
                }
            }
        }
    }
    // Most sums are far below the largest that their samples could have.
    assert!(refused > 1000 && read > 1000, "{refused} {read}");
}
