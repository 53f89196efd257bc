//! Error measures on images with known answers.

use pileus_film::Image;
use pileus_lab::{
    CompareSettings, Error, ErrorSource, compare, compare_with, difference_image, difference_view,
    flip,
};

fn constant(width: u32, height: u32, rgb: [f32; 3]) -> Image {
    let mut image = Image::new(width, height, &[]).unwrap();
    for (name, v) in ["R", "G", "B"].into_iter().zip(rgb) {
        image.add_channel(name, vec![v; image.pixel_count()]).unwrap();
    }
    image
}

/// Standard normal values of a fixed seed: SplitMix64 and Box-Muller.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * b.abs().max(1e-9)
}

#[test]
fn closed_forms() {
    // Differences 1/4, 1/2, 0 against 1/2, 1, 2: all exact in binary.
    let a = constant(20, 10, [0.75, 0.5, 2.0]);
    let b = constant(20, 10, [0.5, 1.0, 2.0]);
    let c = compare(&a, &b).unwrap();
    assert!(close(c.mse, (0.0625 + 0.25) / 3.0));
    assert!(close(c.rel_mse, (0.0625 / 0.26 + 0.25 / 1.01) / 3.0));
    assert_eq!((c.width, c.height, c.skipped_pixels), (20, 10, 0));
    assert_eq!(c.mean_a, [0.75, 0.5, 2.0]);
    assert_eq!(c.mean_b, [0.5, 1.0, 2.0]);
    assert_eq!(c.mean_difference, [0.25, -0.5, 0.0]);
    assert_eq!(c.max_difference, 0.5);
    assert_eq!((c.stderr_a, c.mse_noise_b), (None, None));
    assert_eq!(c.stderr_source, ErrorSource::Blocks);
    // A constant difference has no spread.
    assert_eq!(c.stderr_difference, [0.0; 3]);

    let same = compare(&b, &b).unwrap();
    assert_eq!((same.mse, same.rel_mse, same.flip), (0.0, 0.0, Some(0.0)));

    // Half of the pixels differ.
    let mut half = b.clone();
    half.channel_mut("R").unwrap()[..100].fill(1.5);
    let c = compare(&half, &b).unwrap();
    assert!(close(c.mse, 0.5 / 3.0) && close(c.rel_mse, 0.5 / 0.26 / 3.0));
    assert_eq!(c.mean_difference, [0.5, 0.0, 0.0]);
}

#[test]
fn variances_give_standard_errors_and_noise() {
    let mut a = constant(20, 10, [0.5, 0.5, 0.5]);
    let b = constant(20, 10, [0.5, 1.0, 2.0]);
    a.add_layer("variance", &constant(20, 10, [0.02, 0.08, 0.0])).unwrap();
    let c = compare(&a, &b).unwrap();
    // Only one of the two is known.
    assert_eq!(c.stderr_source, ErrorSource::Blocks);
    let stderr = c.stderr_a.unwrap();
    assert!(close(stderr[0], 0.01) && close(stderr[1], 0.02) && stderr[2] == 0.0);
    assert!(close(c.mse_noise_a.unwrap(), 0.1 / 3.0));
    assert!(close(c.rel_mse_noise_a.unwrap(), (0.02 / 0.26 + 0.08 / 1.01) / 3.0));

    let variance_b = constant(20, 10, [0.06, 0.0, 0.08]);
    let settings =
        CompareSettings { variance_b: Some(&variance_b), flip: false, ..Default::default() };
    let c = compare_with(&a, &b, &settings).unwrap();
    assert_eq!((c.stderr_source, c.flip), (ErrorSource::Variance, None));
    for (got, expected) in c.stderr_difference.into_iter().zip([0.02, 0.02, 0.02]) {
        assert!(close(got, expected), "{got}");
    }

    // One unknown variance makes the sum unknown.
    a.channel_mut("variance.R").unwrap()[7] = f32::INFINITY;
    assert_eq!(compare(&a, &b).unwrap().stderr_a, None);
}

#[test]
fn pixels_that_are_not_finite_are_skipped_and_counted() {
    let mut a = constant(4, 4, [1.0; 3]);
    let mut b = constant(4, 4, [0.5; 3]);
    a.channel_mut("G").unwrap()[3] = f32::NAN;
    b.channel_mut("B").unwrap()[9] = f32::INFINITY;
    let c = compare(&a, &b).unwrap();
    assert_eq!((c.skipped_pixels, c.mse, c.mean_a), (2, 0.25, [1.0; 3]));
    a.channel_mut("R").unwrap().fill(f32::NAN);
    assert!(matches!(compare(&a, &b), Err(Error::NoPixels)));
}

#[test]
fn images_that_cannot_be_compared_are_errors() {
    let a = constant(4, 4, [1.0; 3]);
    let size = compare(&a, &constant(4, 5, [1.0; 3])).unwrap_err();
    assert!(size.to_string().contains("4 x 4 and 4 x 5"), "{size}");
    let depth = Image::new(4, 4, &["X", "Z"]).unwrap();
    let channels = compare(&a, &depth).unwrap_err();
    assert!(channels.to_string().contains("second image") && channels.to_string().contains("Z"));
    let small = constant(2, 2, [1.0; 3]);
    let settings = CompareSettings { variance_a: Some(&small), ..Default::default() };
    let noise = compare_with(&a, &a, &settings).unwrap_err();
    assert!(noise.to_string().contains("4 x 4 and 2 x 2"), "{noise}");
}

#[test]
fn blocks_estimate_the_error_of_the_mean_difference() {
    // 200 pairs of white noise around a common gradient. Null hypothesis: the squared ratio of mean
    // difference and its estimated error averages (m - 1) / (m - 3) with m = 16 blocks (Student);
    // its standard deviation over 200 x 3 values is 0.07. Six of them: false alarms below 1e-7.
    let mut normal = Normal(11);
    let mut sum = 0.0;
    for _ in 0..200 {
        let mut pair = [constant(64, 64, [0.0; 3]), constant(64, 64, [0.0; 3])];
        for image in &mut pair {
            for name in ["R", "G", "B"] {
                for (i, v) in image.channel_mut(name).unwrap().iter_mut().enumerate() {
                    *v = (i as f64 / 4096.0 + 0.1 * normal.next()) as f32;
                }
            }
        }
        let settings = CompareSettings { flip: false, ..Default::default() };
        let c = compare_with(&pair[0], &pair[1], &settings).unwrap();
        for channel in 0..3 {
            sum += (c.mean_difference[channel] / c.stderr_difference[channel]).powi(2);
        }
    }
    let mean = sum / 600.0;
    assert!((mean - 15.0 / 13.0).abs() < 0.42, "{mean}");
}

#[test]
fn flip_grows_with_the_difference_and_names_its_tone() {
    let grey = |v: f32| constant(48, 32, [v; 3]);
    let [near, far] = [0.55, 0.9].map(|v| flip(&grey(v), &grey(0.5), 0.0).unwrap());
    assert!(0.0 < near.mean && near.mean < far.mean && far.mean < 1.0);
    let map = near.map.channel("Y").unwrap();
    let average = map.iter().map(|v| f64::from(*v)).sum::<f64>() / map.len() as f64;
    assert!((average - near.mean).abs() < 1e-4);
    let extreme = flip(&grey(0.0), &grey(1.0), 0.0).unwrap();
    assert!(extreme.mean > 0.9, "{}", extreme.mean);

    // Above the clipping point nothing differs, until exposure brings it down.
    assert_eq!(flip(&grey(2.0), &grey(4.0), 0.0).unwrap().mean, 0.0);
    let exposed = flip(&grey(2.0), &grey(4.0), -3.0).unwrap();
    assert!(exposed.mean > 0.05 && exposed.tone.contains("exposure -3 stops"), "{exposed:?}");
    // One pixel is an image too.
    assert!(flip(&constant(1, 1, [1.0; 3]), &constant(1, 1, [0.0; 3]), 0.0).unwrap().mean > 0.0);
}

#[test]
fn differences_are_signed() {
    let a = constant(3, 2, [0.75, 0.5, 2.0]);
    let b = constant(3, 2, [0.5, 1.0, 2.0]);
    let difference = difference_image(&a, &b).unwrap();
    assert_eq!(difference.channel("R").unwrap(), [0.25; 6]);
    assert_eq!(difference.channel("G").unwrap(), [-0.5; 6]);
    assert_eq!(difference.channel("B").unwrap(), [0.0; 6]);

    let tone = pileus_film::ToneMap { exposure_stops: 0.0, curve: pileus_film::Curve::Srgb };
    let view = difference_view(&difference, 1.0).unwrap();
    let bytes = pileus_film::preview_rgb8(&view, &tone).unwrap();
    assert_eq!(bytes[..3], [191, 0, 128]);
}

#[test]
fn the_report_names_everything() {
    let mut a = constant(20, 10, [0.5; 3]);
    a.add_layer("variance", &constant(20, 10, [0.01; 3])).unwrap();
    let text = compare(&a, &a).unwrap().to_string();
    for word in ["MSE", "relMSE", "mean A", "mean B", "mean A-B", "+-", "FLIP", "sRGB", "stops"] {
        assert!(text.contains(word), "{word} is missing in:\n{text}");
    }
}
