//! The first layers keep their bits from release to release: a state's sums, means and variances of
//! samples that are made up here, as checksums that the releases before layers gave.

use pileus_film::{Film, Image, PixelSample};

/// Bits from all over the floats, most of them near one; a few are not finite.
fn sample(state: &mut u64) -> PixelSample {
    let mut next = || {
        *state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let bits = (*state >> 32) as u32;
        match bits & 7 {
            0 => f32::from_bits(bits ^ 0x5bd1_e995),
            1 => (bits >> 8) as f32 * 1e-12,
            _ => (bits >> 8) as f32 / (1 << 24) as f32,
        }
    };
    PixelSample::new([next(), next(), next()], next())
}

/// CRC-64/XZ, bit by bit.
fn crc(bytes: impl IntoIterator<Item = u8>) -> u64 {
    !bytes.into_iter().fold(u64::MAX, |crc, byte| {
        (0..8).fold(crc ^ u64::from(byte), |crc, _| {
            (crc >> 1) ^ (0xC96C_5795_D787_0F42 & (crc & 1).wrapping_neg())
        })
    })
}

fn bits(image: &Image) -> u64 {
    crc(image.channels().iter().flat_map(|c| &c.samples).flat_map(|v| v.to_le_bytes()))
}

#[test]
fn sums_means_and_variances_keep_their_bits() {
    let mut film = Film::new([13, 7], None).unwrap();
    let mut tile = film.tile(0, 0, 13, 7);
    tile.start(0..41).unwrap();
    let mut state = 1;
    for (y, x) in (0..7).flat_map(|y| (0..13).map(move |x| (y, x))) {
        for number in 0..41 {
            tile.add(x, y, number, &sample(&mut state));
        }
    }
    film.add_tiles(&[tile]).unwrap();
    film.commit_pass(41);
    let mut bytes = Vec::new();
    film.write_state(&mut bytes, b"").unwrap();
    let content = bytes.len() - 8;
    let sums = crc(bytes[content - 13 * 7 * 548..content].iter().copied());
    let found = [sums, bits(&film.image()), bits(&film.variance()), film.dropped()];
    let expected = [0x7d3e_e2fb_267d_cd60, 0x6c12_27d1_0b9d_fa37, 0xb9a1_8a13_20a4_6c50, 4];
    assert_eq!(found, expected, "{found:x?}");
}
