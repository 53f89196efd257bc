//! Every finite sample counts, whatever its size.

use pileus_film::{Film, PixelMoments, PixelSample};

/// Magnitudes over all of the range, a factor of sixteen apart.
fn magnitudes() -> impl Iterator<Item = f32> {
    (0..70).map(|i| 2f32.powi(-140 + 4 * i).min(f32::MAX) * 1.3)
}

#[test]
fn a_constant_is_its_own_mean_whatever_its_size() {
    for v in magnitudes().chain([f32::MAX, f32::from_bits(1), 1.49e9, 1e12, 0.0]) {
        let v = v.min(f32::MAX);
        for alpha in [0.0, 1.0, -16.5, 1e4, v] {
            let mut film = Film::new([1, 1], None).unwrap();
            let mut tile = film.tile(0, 0, 1, 1);
            tile.start(0..24).unwrap();
            for number in 0..24 {
                assert!(tile.add(0, 0, number, &PixelSample::new([v, -v, 0.0], alpha)));
            }
            film.add_tiles(&[tile]).unwrap();
            film.commit_pass(24);
            let (image, variance) = (film.image(), film.variance());
            for (name, expected) in [("R", v), ("G", -v), ("B", 0.0), ("A", alpha)] {
                assert_eq!(image.get(name, 0, 0), Some(expected));
                assert_eq!(variance.get(name, 0, 0), Some(0.0));
            }
            assert_eq!((film.dropped(), film.dropped_at(0, 0)), (0, Some(0)));
        }
    }
}

/// A few samples far beyond all others, met first, last or in between, in slices or whole.
#[test]
fn a_sun_in_a_dark_pixel_adds_what_it_has() {
    for sun in [1.49e9f32, -3e12, 1e30] {
        let sample = |number: u64| {
            let v = if number.is_multiple_of(20) { sun } else { 0.25 };
            PixelSample::new([v, 0.25, v * 1e-3], v.abs())
        };
        let mut whole = PixelMoments::default();
        (0..160).for_each(|number| assert!(whole.add(number, &sample(number))));
        let n = 160.0;
        let expected = (8.0 * f64::from(sun) + 152.0 * 0.25) / n;
        assert!((whole.mean()[0] / expected - 1.0).abs() < 1e-9);
        assert_eq!(whole.mean()[1], 0.25);
        assert!(whole.variance_of_mean().iter().all(|v| v.is_finite()));
        for cut in [0, 1, 19, 21, 100, 159] {
            let mut parts = [PixelMoments::default(); 2];
            for number in (0..160).rev() {
                parts[usize::from(number < cut)].add(number, &sample(number));
            }
            let [mut merged, first] = parts;
            assert!(merged.merge(&first));
            assert_eq!(merged, whole);
        }
    }
}

#[test]
fn variances_beyond_a_float_stay_known() {
    let mut film = Film::new([2, 1], None).unwrap();
    let mut tile = film.tile(0, 0, 2, 1);
    tile.start(0..16).unwrap();
    for number in 0..16 {
        let sign = if number % 2 == 0 { 1.0 } else { -1.0 };
        let sample = |v: f32| PixelSample::new([sign * v; 3], 0.0);
        tile.add(0, 0, number, &sample(1e25));
        tile.add(1, 0, number, &sample(1e-30));
    }
    film.add_tiles(&[tile]).unwrap();
    let variance = film.variance();
    assert_eq!(variance.channel("R").unwrap(), [f32::MAX, f32::from_bits(1)]);
    assert_eq!(variance.channel("A").unwrap(), [0.0; 2]);
}
