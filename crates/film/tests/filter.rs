//! Samples of a filter follow its density.
//!
//! Chi-square tests with fixed seeds. Null hypothesis: offsets have the density `pdf`. False-alarm
//! rate 1e-8 each; the power is shown by a test against a density that is 2 % wider.

use pileus_film::Filter;
use statrs::function::gamma::gamma_ur;

const SAMPLES: usize = 400_000;
const BINS: usize = 24;
const FALSE_ALARM: f64 = 1e-8;

struct Generator(u64);

impl Generator {
    /// SplitMix64 (Steele, Lea, Flood 2014), upper 24 bits.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    }
}

/// P-value of the offsets of `sampled` under the density of `expected`, on a grid over the latter.
fn p_value(sampled: Filter, expected: Filter, seed: u64) -> f64 {
    let radius = f64::from(expected.radius());
    let width = 2.0 * radius / BINS as f64;
    let mut counts = vec![0u32; BINS * BINS + 1];
    let mut generator = Generator(seed);
    for _ in 0..SAMPLES {
        let offset = sampled.sample([generator.next(), generator.next()]);
        let [x, y] = offset.map(|v| {
            let bin = ((f64::from(v) + radius) / width).floor();
            (bin >= 0.0 && bin < BINS as f64 + 1e-9).then_some((bin as usize).min(BINS - 1))
        });
        match (x, y) {
            (Some(x), Some(y)) => counts[y * BINS + x] += 1,
            _ => counts[BINS * BINS] += 1,
        }
    }
    // Probability of each bin by the midpoint rule; cells below five expected counts are pooled,
    // together with what fell outside.
    let fine = 16;
    let (mut chi2, mut cells, mut pooled, mut pooled_expected) = (0.0, 0, 0.0, 0.0);
    let mut term = |count: f64, mean: f64| {
        chi2 += (count - mean).powi(2) / mean;
        cells += 1;
    };
    for (bin, &count) in counts[..BINS * BINS].iter().enumerate() {
        let corner = [bin % BINS, bin / BINS].map(|v| v as f64 * width - radius);
        let mut probability = 0.0;
        for i in 0..fine * fine {
            let step = [i % fine, i / fine].map(|v| (v as f64 + 0.5) / fine as f64 * width);
            let at = [corner[0] + step[0], corner[1] + step[1]].map(|v| v as f32);
            probability += expected.pdf(at) * (width / fine as f64).powi(2);
        }
        let mean = probability * SAMPLES as f64;
        if mean < 5.0 {
            pooled += f64::from(count);
            pooled_expected += mean;
        } else {
            term(f64::from(count), mean);
        }
    }
    pooled += f64::from(counts[BINS * BINS]);
    if pooled_expected > 0.0 {
        term(pooled, pooled_expected);
    } else {
        assert_eq!(pooled, 0.0, "offsets outside the support");
    }
    gamma_ur(0.5 * (f64::from(cells) - 1.0), 0.5 * chi2)
}

#[test]
fn offsets_follow_the_density() {
    for (seed, filter) in [
        (1, Filter::Box { radius: 0.5 }),
        (2, Filter::Box { radius: 1.25 }),
        (3, Filter::BlackmanHarris { radius: 0.75 }),
        (4, Filter::BlackmanHarris { radius: 1.5 }),
    ] {
        let p = p_value(filter, filter, seed);
        assert!(p > FALSE_ALARM, "{filter:?}: {p}");
    }
}

#[test]
fn a_wider_filter_is_found_out() {
    let (narrow, wide) =
        (Filter::BlackmanHarris { radius: 1.5 }, Filter::BlackmanHarris { radius: 1.53 });
    assert!(p_value(narrow, wide, 5) < FALSE_ALARM);
}

#[test]
fn offsets_stay_inside_and_keep_their_order() {
    for filter in [Filter::Box { radius: 0.5 }, Filter::BlackmanHarris { radius: 1.5 }] {
        let mut last = f32::NEG_INFINITY;
        for i in 0..=1 << 16 {
            let u = (i as f32 / (1 << 16) as f32).min(1f32.next_down());
            let [x, y] = filter.sample([u, 0.5]);
            assert!(x.abs() <= filter.radius() && y.abs() < 1e-6 && x >= last);
            last = x;
        }
    }
}
