//! The block Z-test: honest under the null hypothesis, awake under the alternative.
//!
//! Seeds are fixed; each statistical check has a false-alarm rate below 1e-7.

use pileus_film::Image;
use pileus_lab::{BlockZ, Error, block_z_test};

/// Standard normal values: SplitMix64 and Box-Muller.
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

/// Expectation 0.5 plus a gradient, standard deviation of a pixel's mean.
const DEVIATION: f64 = 0.05;

fn expectation(i: usize) -> f64 {
    0.5 + 1e-4 * (i % 100) as f64
}

fn noisy(normal: &mut Normal, side: u32, factor: f64) -> Image {
    let mut image = Image::new(side, side, &["R", "G", "B"]).unwrap();
    for name in ["R", "G", "B"] {
        for (i, v) in image.channel_mut(name).unwrap().iter_mut().enumerate() {
            *v = (factor * expectation(i) + DEVIATION * normal.next()) as f32;
        }
    }
    image
}

fn variance(side: u32) -> Image {
    let mut image = Image::new(side, side, &["Y"]).unwrap();
    image.channel_mut("Y").unwrap().fill((DEVIATION * DEVIATION) as f32);
    image
}

fn test(normal: &mut Normal, side: u32, factor: f64, block: usize) -> BlockZ {
    let (a, b) = (noisy(normal, side, factor), noisy(normal, side, 1.0));
    block_z_test(&a, &variance(side), &b, &variance(side), block).unwrap()
}

/// Kolmogorov-Smirnov statistic against the uniform distribution, times the root of the count.
fn kolmogorov(mut p: Vec<f64>) -> f64 {
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    let distance = p.iter().enumerate().map(|(i, p)| {
        let i = i as f64;
        (p - i / n).max((i + 1.0) / n - p)
    });
    distance.fold(0.0, f64::max) * n.sqrt()
}

#[test]
fn p_values_are_uniform_under_the_null_hypothesis() {
    let mut normal = Normal(1);
    let (mut chi2, mut z, mut small) = (Vec::new(), Vec::new(), 0);
    for _ in 0..600 {
        // 40 is no multiple of 16: the blocks at the edge are smaller.
        let result = test(&mut normal, 40, 1.0, 16);
        assert_eq!((result.blocks, result.dof), ([3, 3], [9; 3]));
        chi2.extend(result.p_chi2);
        z.extend(result.z.iter().map(|z| normal_cdf(*z)));
        small += u32::from(result.p_value < 0.05);
    }
    // P(K > 3) = 2 exp(-18) = 3e-8 (Kolmogorov's limit).
    assert!(kolmogorov(chi2) < 3.0);
    assert!(kolmogorov(z) < 3.0);
    // Bonferroni: at most 5 % of 600 in the mean; P(more than 65) is below 1e-8.
    assert!(small <= 65, "{small}");
}

fn normal_cdf(z: f64) -> f64 {
    0.5 * statrs::function::erf::erfc(-z / std::f64::consts::SQRT_2)
}

#[test]
fn one_percent_is_found() {
    let mut normal = Normal(2);
    for factor in [1.01, 0.99] {
        let result = test(&mut normal, 256, factor, 16);
        assert!(result.p_value < 1e-9, "{factor}: {}", result.p_value);
        assert!(result.p_chi2.iter().all(|p| *p < 1e-6));
    }
    // The same images agree without the factor.
    assert!(test(&mut normal, 256, 1.0, 16).p_value > 1e-6);
}

#[test]
fn one_bad_block_is_found() {
    let mut normal = Normal(3);
    let (mut a, b) = (noisy(&mut normal, 256, 1.0), noisy(&mut normal, 256, 1.0));
    for y in 32..48 {
        for x in 64..80 {
            let v = a.get("G", x, y).unwrap();
            a.set("G", x, y, v + 0.05);
        }
    }
    let result = block_z_test(&a, &variance(256), &b, &variance(256), 16).unwrap();
    assert!(result.p_max < 1e-9 && result.p_value < 1e-9);
    let worst = result.z.iter().position(|z| z.abs() == result.max_abs_z).unwrap();
    // Channel 1, block row 2, block column 4 of 16 x 16 blocks.
    assert_eq!(worst, 256 + 2 * 16 + 4);
}

#[test]
fn underestimated_variances_are_found() {
    let mut normal = Normal(4);
    let (a, b) = (noisy(&mut normal, 256, 1.0), noisy(&mut normal, 256, 1.0));
    let mut half = variance(256);
    half.channel_mut("Y").unwrap().iter_mut().for_each(|v| *v *= 0.5);
    assert!(block_z_test(&a, &half, &b, &half, 4).unwrap().p_value < 1e-9);
}

#[test]
fn closed_form_and_gaps() {
    let grey = |v: f32| {
        let mut image = Image::new(8, 4, &["Y"]).unwrap();
        image.channel_mut("Y").unwrap().fill(v);
        image
    };
    // Blocks of 16 pixels: difference 0.25, standard error sqrt(2 x 0.5 / 16) = 0.25.
    let (a, b, mut v) = (grey(0.75), grey(0.5), grey(0.5));
    let result = block_z_test(&a, &v, &b, &v, 4).unwrap();
    assert_eq!(result.blocks, [2, 1]);
    assert_eq!(result.z, [1.0; 6]);
    assert_eq!((result.chi2, result.dof, result.max_abs_z), ([2.0; 3], [2; 3], 1.0));
    assert!((result.p_chi2[0] - (-1f64).exp()).abs() < 1e-12);
    assert_eq!(result.p_max, 1.0);

    // Unknown variances are left out, whole blocks of them too.
    v.channel_mut("Y").unwrap()[0] = f32::INFINITY;
    let mut other = grey(0.5);
    for y in 0..4 {
        for x in 4..8 {
            other.set("Y", x, y, f32::NAN);
        }
    }
    let result = block_z_test(&a, &v, &b, &other, 4).unwrap();
    assert_eq!((result.skipped_pixels, result.dof), (17, [1; 3]));
    assert!(result.z[1].is_nan() && (result.z[0] - (15f64 / 16.0).sqrt()).abs() < 1e-12);

    // No noise at all: equal is equal, different is different.
    let zero = grey(0.0);
    assert_eq!(block_z_test(&a, &zero, &a, &zero, 4).unwrap().p_value, 1.0);
    assert_eq!(block_z_test(&a, &zero, &b, &zero, 4).unwrap().p_value, 0.0);

    let unknown = grey(f32::NAN);
    assert!(matches!(block_z_test(&a, &unknown, &b, &zero, 4), Err(Error::NoVariance)));
    assert!(matches!(block_z_test(&a, &zero, &b, &zero, 0), Err(Error::Argument { .. })));
    let large = Image::new(9, 4, &["Y"]).unwrap();
    assert!(matches!(block_z_test(&a, &zero, &b, &large, 4), Err(Error::Size { .. })));
}
