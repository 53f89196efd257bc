//! Any split of the samples, in any order, gives the same bits.

use pileus_film::{
    Crop, Error, Film, LAYERS, Layer, PixelMoments, PixelSample, Reconstruction, SAMPLES,
};
use proptest::prelude::*;

fn value() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => (any::<u32>(), -40i32..31).prop_map(|(bits, exponent)| {
            let significand = 1.0 + (bits >> 9) as f32 / (1 << 23) as f32;
            let sign = if bits & 1 == 0 { 1.0 } else { -1.0 };
            sign * significand * 2f32.powi(exponent)
        }),
        1 => any::<f32>(),
        1 => Just(f32::NAN),
        1 => Just(0.0),
    ]
}

fn sample() -> impl Strategy<Value = PixelSample> {
    ([value(), value(), value()], prop_oneof![0f32..=1.0, value()])
        .prop_map(|(rgb, alpha)| PixelSample::new(rgb, alpha))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn pixels(
        samples in prop::collection::vec((sample(), 0usize..5), 0..200),
        order in Just([0usize, 1, 2, 3, 4]).prop_shuffle(),
        nested in any::<bool>(),
    ) {
        let mut whole = PixelMoments::default();
        let mut parts = [PixelMoments::default(); 5];
        for (number, (sample, part)) in (0..).zip(&samples) {
            let added = whole.add(number, sample);
            prop_assert_eq!(parts[*part].add(number, sample), added);
            let finite = sample.rgb.iter().chain([&sample.alpha]).all(|v| v.is_finite());
            prop_assert_eq!(added, finite);
        }
        let mut reversed = PixelMoments::default();
        for (number, (sample, _)) in samples.iter().enumerate().rev() {
            reversed.add(number as u64, sample);
        }
        let mut merged = PixelMoments::default();
        if nested {
            // (a + b) + ((c + d) + e)
            let (mut left, mut right) = (parts[order[0]], parts[order[2]]);
            left.merge(&parts[order[1]]);
            right.merge(&parts[order[3]]);
            right.merge(&parts[order[4]]);
            merged.merge(&right);
            merged.merge(&left);
        } else {
            order.iter().for_each(|&i| { merged.merge(&parts[i]); });
        }
        prop_assert_eq!(merged, whole);
        prop_assert_eq!(reversed, whole);
        prop_assert_eq!(merged.mean().map(f64::to_bits), whole.mean().map(f64::to_bits));
        prop_assert_eq!(
            merged.variance_of_mean().map(f64::to_bits),
            whole.variance_of_mean().map(f64::to_bits)
        );
    }

    /// Means are off by the rounding of single samples alone: 2^-31 of the largest.
    #[test]
    fn moments_agree_with_floating_point(
        values in prop::collection::vec(-1000f32..1000.0, 2..300),
        exponent in -120i32..100,
    ) {
        let unit = 2f32.powi(exponent);
        let mut moments = PixelMoments::default();
        for (number, v) in (0..).zip(&values) {
            let sample = PixelSample::new([v * unit, 0.5 * v, 0.0], v / 1000.0);
            prop_assert!(moments.add(number, &sample));
        }
        for (c, scale) in [(0, unit), (1, 0.5), (3, 1e-3)] {
            let of = |v: f32| if c == 3 { f64::from(v / 1000.0) } else { f64::from(v * scale) };
            let x: Vec<f64> = values.iter().map(|v| of(*v)).collect();
            let n = x.len() as f64;
            let mean = x.iter().sum::<f64>() / n;
            let replicates: Vec<(f64, f64)> = (0..8)
                .map(|r| x.iter().skip(r).step_by(8).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0)))
                .filter(|(_, count)| *count > 0.0)
                .collect();
            let spread: f64 =
                replicates.iter().map(|(sum, count)| count * (sum / count - mean).powi(2)).sum();
            let variance = spread / (n * (replicates.len() - 1) as f64);
            let got = (moments.mean()[c], moments.variance_of_mean()[c]);
            let largest = x.iter().fold(0.0f64, |a, v| a.max(v.abs()));
            prop_assert!((got.0 - mean).abs() <= 5e-10 * largest, "{got:?} {mean}");
            let slack = 1e-9 * largest * variance.sqrt() + 1e-18 * largest * largest;
            prop_assert!((got.1 - variance).abs() <= slack, "{got:?} {variance}");
        }
    }

    #[test]
    fn films(
        size in (1u32..20, 1u32..20),
        seed in any::<u64>(),
        tile_sizes in [1u32..9, 1u32..9, 1u32..9],
        cuts in (0u64..8, 0u64..8),
        reverse in any::<bool>(),
        layers in any::<bool>(),
    ) {
        let (low, high) = (cuts.0.min(cuts.1), cuts.0.max(cuts.1));
        let resolution = [size.0 + 3, size.1 + 5];
        let crop = Some(Crop { x0: 2, y0: 4, width: size.0, height: size.1 });
        let further: &[&'static Layer] = if layers { &[&SAMPLES, &LUMINANCE, &PRODUCTS] } else { &[] };
        let render = |range: std::ops::Range<u64>, tile_size: u32| {
            let mut film = Film::with_layers(resolution, crop, further).unwrap();
            let mut tiles = Vec::new();
            for (x0, y0, width, height) in film.tiles(tile_size) {
                let mut tile = film.tile(x0, y0, width, height);
                tile.start(range.clone()).unwrap();
                for y in y0..y0 + height {
                    for x in x0..x0 + width {
                        for i in range.clone() {
                            tile.add(x, y, i, &noise(seed, x, y, i));
                        }
                    }
                }
                tiles.push(tile);
            }
            if reverse {
                tiles.reverse();
                tiles.iter().for_each(|tile| film.add_tiles(std::slice::from_ref(tile)).unwrap());
            } else {
                film.add_tiles(&tiles).unwrap();
            }
            film.commit_pass(range.end - range.start);
            film
        };
        let whole = render(0..8, tile_sizes[0]);
        let mut merged = render(low..high, tile_sizes[1]);
        merged.merge(&render(high..8, tile_sizes[2])).unwrap();
        merged.merge(&render(0..low, tile_sizes[2])).unwrap();
        prop_assert_eq!(&merged, &whole);
        prop_assert_eq!(merged.samples(), 8);
        let dropped: u64 = (4..4 + size.1)
            .flat_map(|y| (2..2 + size.0).map(move |x| (x, y)))
            .map(|(x, y)| whole.dropped_at(x, y).unwrap())
            .sum();
        prop_assert_eq!(dropped, whole.dropped());

        let mut bytes = Vec::new();
        merged.write_state(&mut bytes, b"job").unwrap();
        let known: Vec<_> = LAYERS.into_iter().chain([&LUMINANCE, &PRODUCTS]).collect();
        let (read, header) = Film::read_state(bytes.as_slice(), &known).unwrap();
        prop_assert_eq!(&read, &whole);
        prop_assert_eq!(header, b"job");
        let bits = |film: &Film| -> Vec<u32> {
            let image = film.image_of(film.layers()).unwrap();
            image.channels().iter().flat_map(|c| &c.samples).map(|v| v.to_bits()).collect()
        };
        prop_assert_eq!(bits(&read), bits(&whole));
    }
}

static LUMINANCE: Layer = Layer {
    name: "luminance",
    meaning: "a mean of one channel",
    channels: &["luminance.Y"],
    reconstruction: Reconstruction::Mean(|sample, _, value| {
        value[0] = 0.25 * sample.rgb[0] + 0.5 * sample.rgb[1] + 0.25 * sample.rgb[2];
    }),
};

/// Not finite where green is large.
static PRODUCTS: Layer = Layer {
    name: "products",
    meaning: "a mean of two channels over all floats",
    channels: &["products.X", "products.Y"],
    reconstruction: Reconstruction::Mean(|sample, _, values| {
        values[0] = sample.rgb[1] * sample.rgb[1];
        values[1] = -sample.alpha;
    }),
};

/// A sample as a function of its place; one in 64 is not finite, and green spans all floats.
fn noise(seed: u64, x: u32, y: u32, i: u64) -> PixelSample {
    let mut state = seed ^ (u64::from(x) << 40) ^ (u64::from(y) << 20) ^ i;
    let mut next = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    };
    let alpha = next();
    let wide = (200.0 * next() - 100.0).exp2() * next();
    let rgb = [next(), wide, if next() < 1.0 / 64.0 { f32::NAN } else { next() * 1e-6 }];
    PixelSample::new(rgb, alpha)
}

#[test]
fn tiles_cover_the_window_once() {
    let crop = Crop { x0: 7, y0: 3, width: 50, height: 41 };
    let film = Film::new([64, 64], Some(crop)).unwrap();
    for size in [0, 1, 7, 16, 64, u32::MAX] {
        let mut hits = vec![0; 64 * 64];
        for (x0, y0, width, height) in film.tiles(size) {
            for y in y0..y0 + height {
                for x in x0..x0 + width {
                    hits[(y * 64 + x) as usize] += 1;
                }
            }
        }
        for (i, hit) in hits.into_iter().enumerate() {
            let (x, y) = (i % 64, i / 64);
            let inside = (7..57).contains(&x) && (3..44).contains(&y);
            assert_eq!(hit, i32::from(inside), "tile size {size}, pixel {x} {y}");
        }
    }
}

#[test]
fn the_image_is_the_mean_of_what_was_not_dropped() {
    let mut film = Film::with_layers([3, 1], None, &[&SAMPLES]).unwrap();
    let mut tile = film.tile(0, 0, 3, 1);
    tile.start(0..3).unwrap();
    for (number, v) in [(0, 1.0), (1, 2.0), (2, f32::NAN)] {
        tile.add(1, 0, number, &PixelSample::new([v, 0.0, 0.0], 1.0));
    }
    tile.add(2, 0, 0, &PixelSample::new([f32::NAN; 3], 1.0));
    assert!(!tile.add(3, 0, 1, &PixelSample::default()));
    // A number that the pass does not have, and one that is there already.
    assert!(!tile.add(1, 0, 3, &PixelSample::default()));
    assert!(!tile.add(1, 0, 0, &PixelSample::default()));
    assert_eq!(tile.dropped(), 5);
    film.add_tiles(&[tile]).unwrap();
    film.commit_pass(3);
    assert_eq!(film.dropped(), 5);
    assert_eq!(film.dropped_at(1, 0), Some(1));
    let image = film.image();
    assert_eq!(image.channel("R").unwrap(), [0.0, 1.5, 0.0]);
    assert_eq!(image.channel("A").unwrap(), [0.0, 1.0, 0.0]);
    let variance = film.variance();
    assert_eq!(variance.channel("R").unwrap(), [f32::INFINITY, 0.25, f32::INFINITY]);
    assert_eq!(variance.channel("A").unwrap()[1], 0.0);
    let samples = film.image_of(&[&SAMPLES]).unwrap();
    assert_eq!(samples.channel("samples.Y").unwrap(), [0.0, 2.0, 0.0]);
    assert!(film.image_of(&[&LUMINANCE]).unwrap_err().to_string().contains("luminance"));
}

#[test]
fn what_does_not_fit_is_refused_or_counted() {
    let window = |x0, y0, width, height| Some(Crop { x0, y0, width, height });
    for (resolution, crop, says) in [
        ([0, 4], None, "resolution 0 x 4"),
        ([u32::MAX, 1], None, "resolution 4294967295 x 1"),
        ([4, 4], window(0, 0, 0, 1), "crop window 0 x 1 at (0, 0)"),
        ([4, 4], window(3, 0, 2, 1), "crop window 2 x 1 at (3, 0)"),
        ([4, 4], window(u32::MAX, 0, 2, 1), "crop window 2 x 1 at (4294967295, 0)"),
    ] {
        let error = Film::new(resolution, crop).unwrap_err();
        assert!(matches!(error, Error::Invalid { .. }), "{error}");
        assert!(error.to_string().contains(says), "{error}");
    }
    let error = Film::new([1 << 20, 1 << 20], None).unwrap_err();
    assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    let mut film = Film::new([4, 4], None).unwrap();
    let other = Film::new([4, 4], window(0, 0, 4, 3)).unwrap();
    assert!(film.merge(&other).unwrap_err().to_string().contains("slices of one job"));

    let layers = Film::with_layers([4, 4], None, &[&LUMINANCE]).unwrap();
    let error = film.merge(&layers).unwrap_err().to_string();
    assert!(error.contains("variance, luminance") && error.contains("one job"), "{error}");
    let error = film.add_tiles(&[layers.tile(0, 0, 1, 1)]).unwrap_err().to_string();
    assert!(error.contains("a tile was made for other layers"), "{error}");

    // A tile that hangs over the edge, and ones that are far off or empty.
    let mut tile = film.tile(3, 3, 2, 2);
    tile.start(0..1).unwrap();
    for (x, y) in [(3, 3), (4, 3), (3, 4), (4, 4)] {
        assert!(tile.add(x, y, 0, &PixelSample::default()));
    }
    film.add_tiles(&[tile]).unwrap();
    assert_eq!(film.dropped(), 3);
    let mut far = film.tile(u32::MAX, u32::MAX, 2, 1);
    far.start(7..8).unwrap();
    assert!(far.add(u32::MAX, u32::MAX, 7, &PixelSample::default()));
    film.add_tiles(&[far, film.tile(0, 0, 0, 9), film.tile(0, 0, 4, 4)]).unwrap();
    assert_eq!(film.dropped(), 4);
    let mut huge = film.tile(0, 0, u32::MAX, u32::MAX);
    for numbers in [0..1, 0..u64::MAX] {
        let error = huge.start(numbers).unwrap_err();
        assert!(matches!(error, Error::TooLarge { .. }), "{error}");
    }
    assert!(!huge.add(0, 0, 0, &PixelSample::default()));
}
