//! Denoising on pictures that are known.

use pileus_film::{DENOISED_CHANNELS, Film, Image, PixelSample};

const SIZE: [u32; 2] = [96, 80];

/// A number in [0, 1) from a hash.
fn uniform(x: u32, y: u32, sample: u64, salt: u32) -> f32 {
    let mut h = u64::from(x) << 40 ^ u64::from(y) << 20 ^ sample ^ u64::from(salt) << 52;
    for _ in 0..3 {
        h = (h ^ h >> 31).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    (h >> 40) as f32 / 16_777_216.0
}

/// A sky that brightens upwards, and a ball that is lit from the left, with a hard edge.
fn exact(x: u32, y: u32) -> ([f32; 3], f32) {
    let (u, v) = (x as f32 / 96.0, y as f32 / 80.0);
    let (dx, dy) = (x as f32 - 48.0, y as f32 - 40.0);
    let inside = dx * dx + dy * dy < 25.0 * 25.0;
    let sky = [0.02 + 0.02 * v, 0.03 + 0.02 * v, 0.06];
    if inside { ([1.2 - u, 1.1 - 0.9 * u, 1.0 - 0.8 * u], 1.0) } else { (sky, 0.0) }
}

/// A film of these samples; `seen` may change each.
fn film(spp: u64, seen: impl Fn(u32, u32, u64) -> Option<PixelSample>) -> Film {
    let mut film = Film::new(SIZE, None).unwrap();
    let mut tile = film.tile(0, 0, SIZE[0], SIZE[1]);
    tile.start(0..spp).unwrap();
    for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
        for sample in 0..spp {
            if let Some(seen) = seen(x, y, sample) {
                tile.add(x, y, sample, &seen);
            }
        }
    }
    film.add_tiles(&[tile]).unwrap();
    film.commit_pass(spp);
    film
}

/// Exponential noise in the ball, as light of many scatterings has: as large as its mean.
fn noisy(salt: u32) -> impl Fn(u32, u32, u64) -> Option<PixelSample> {
    move |x, y, sample| {
        let (rgb, alpha) = exact(x, y);
        let factor = -(1.0 - uniform(x, y, sample, salt)).ln();
        Some(PixelSample::new(if alpha > 0.0 { rgb.map(|v| v * factor) } else { rgb }, alpha))
    }
}

/// Mean squared error relative to the exact picture, and the mean over it, less one.
fn error(image: &Image, names: [&str; 3]) -> (f64, f64) {
    let (mut squares, mut sum, mut of_exact) = (0.0, 0.0, 0.0);
    for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
        for (c, name) in names.iter().enumerate() {
            let (found, exact) = (image.get(name, x, y).unwrap(), exact(x, y).0[c]);
            assert!(found.is_finite());
            squares += f64::from((found - exact).powi(2) / (exact * exact + 0.01));
            sum += f64::from(found);
            of_exact += f64::from(exact);
        }
    }
    (squares / f64::from(3 * SIZE[0] * SIZE[1]), sum / of_exact - 1.0)
}

#[test]
fn noise_goes_and_edges_and_brightness_stay() {
    for spp in [16, 64] {
        let film = film(spp, noisy(1));
        let (raw, mean_of_raw) = error(&film.image(), ["R", "G", "B"]);
        let denoised = film.denoised().unwrap();
        let (left, mean) = error(&denoised, DENOISED_CHANNELS);
        assert!(left < raw / 5.0, "{spp}: {left} of {raw}");
        assert!((mean - mean_of_raw).abs() < 5e-3, "{spp}: {mean} for {mean_of_raw}");
        // The edge has not moved: pixels on both sides of it are nearer to theirs.
        let edge = |x: u32| denoised.get("denoised.B", x, 40).unwrap();
        let (outside, inside) = (exact(22, 40).0[2], exact(24, 40).0[2]);
        assert!((edge(22) - outside).abs() < 0.1 * (inside - outside).abs() + 1e-3);
        assert!((edge(24) - inside).abs() < 0.5 * (inside - outside).abs());
    }
}

/// Pixels over many renders with other noise vary less than a third as much as the raw ones.
#[test]
fn it_does_not_flicker() {
    let renders: Vec<_> = (0..12).map(|salt| film(16, noisy(salt))).collect();
    let spread = |names: [&str; 3], of: &dyn Fn(&Film) -> Image| {
        let images: Vec<Image> = renders.iter().map(of).collect();
        let mut sum = 0.0;
        for (x, y) in (20..60).flat_map(|y| (28..68).map(move |x| (x, y))) {
            let values: Vec<f64> =
                images.iter().map(|i| f64::from(i.get(names[1], x, y).unwrap())).collect();
            let mean = values.iter().sum::<f64>() / 12.0;
            sum += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        }
        sum.sqrt()
    };
    let raw = spread(["R", "G", "B"], &|film| film.image());
    let left = spread(DENOISED_CHANNELS, &|film| film.denoised().unwrap());
    assert!(left < raw / 3.0, "{left} of {raw}");
}

#[test]
fn what_has_no_noise_is_kept() {
    let film = film(8, |x, y, _| {
        let (rgb, alpha) = exact(x, y);
        Some(PixelSample::new(rgb, alpha))
    });
    let denoised = film.denoised().unwrap();
    let (left, _) = error(&denoised, DENOISED_CHANNELS);
    assert!(left < 1e-9, "{left}");
}

#[test]
fn broken_pixels_spoil_none_of_their_neighbours() {
    let sound = film(16, noisy(1)).denoised().unwrap();
    let broken = film(16, |x, y, sample| {
        let seen = noisy(1)(x, y, sample);
        match (x, y) {
            // No sample counts: black, and its noise is not known.
            (40, 40) => Some(PixelSample::new([f32::NAN; 3], 1.0)),
            // A single one does.
            (50, 45) => seen.filter(|_| sample == 3),
            // A firefly, and one whose variance leaves the range of floats.
            (55, 30) if sample == 5 => Some(PixelSample::new([1e4; 3], 1.0)),
            (30, 40) if sample == 5 => Some(PixelSample::new([1e25; 3], 1.0)),
            _ => seen,
        }
    });
    let broken = broken.denoised().unwrap();
    assert_eq!(broken.get("denoised.R", 40, 40), Some(0.0));
    let mut far_off = 0;
    for (x, y) in (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| (x, y))) {
        for name in DENOISED_CHANNELS {
            let (a, b) = (sound.get(name, x, y).unwrap(), broken.get(name, x, y).unwrap());
            assert!(b.is_finite());
            let own = [(40, 40), (50, 45), (55, 30), (30, 40)].contains(&(x, y));
            far_off += u32::from(!own && (a - b).abs() > 0.25 * a.max(0.1));
        }
    }
    assert_eq!(far_off, 0);
}

/// Squares of values from some 1e19 on are no 32-bit floats: such pixels are left as they are, and
/// the others keep out of them.
#[test]
fn values_of_any_size_are_kept_where_they_have_no_noise() {
    for bright in [1e18f32, 1e20, 1e30] {
        let film = film(8, |x, y, _| {
            let value = if exact(x, y).1 > 0.0 { 0.0 } else { bright };
            Some(PixelSample::new([value; 3], 1.0))
        });
        let denoised = film.denoised().unwrap();
        let raw = film.image();
        for (name, raw_name) in DENOISED_CHANNELS.into_iter().zip(["R", "G", "B"]) {
            let pairs = denoised.channel(name).unwrap().iter().zip(raw.channel(raw_name).unwrap());
            for (found, own) in pairs {
                assert!((found - own).abs() <= 1e-5 * own, "{bright}: {found} for {own}");
            }
        }
    }
}

/// A pixel of which one half lost all its samples is not half black.
#[test]
fn halves_without_samples_are_not_black() {
    let lost = film(4, |x, y, sample| {
        noisy(1)(x, y, sample).filter(|_| (x, y) != (48, 40) || sample % 2 == 0)
    });
    let whole = film(4, noisy(1)).denoised().unwrap();
    let lost = lost.denoised().unwrap();
    for (x, y) in [(47, 40), (49, 40), (48, 39), (48, 41)] {
        let [a, b] = [&whole, &lost].map(|image| image.get("denoised.G", x, y).unwrap());
        assert!((a - b).abs() < 0.1 * a, "{x} {y}: {b} for {a}");
    }
}

#[test]
fn threads_change_no_bit() {
    let film = film(16, noisy(2));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| film.denoised().unwrap())
    };
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(7));
}

#[test]
fn noise_that_is_not_known_is_left() {
    assert!(film(3, noisy(1)).denoised().is_none());
    // Sizes below the window's.
    for size in [[1, 1], [3, 2], [200, 1]] {
        let mut film = Film::new(size, None).unwrap();
        let mut tile = film.tile(0, 0, size[0], size[1]);
        tile.start(0..8).unwrap();
        for (x, y) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y))) {
            for sample in 0..8 {
                let v = 0.5 + uniform(x, y, sample, 9);
                tile.add(x, y, sample, &PixelSample::new([v; 3], 1.0));
            }
        }
        film.add_tiles(&[tile]).unwrap();
        film.commit_pass(8);
        let denoised = film.denoised().unwrap();
        assert_eq!([denoised.width(), denoised.height()], size);
        assert!(denoised.channel("denoised.G").unwrap().iter().all(|v| (0.5..1.5).contains(v)));
    }
}
