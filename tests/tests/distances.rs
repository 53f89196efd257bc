//! Every sampler of free flights against closed forms: where flights end, per channel, with and
//! without bounds that hold.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_lab::{Profile, ProfileCase};
use pileus_media::distance::{
    DistanceSampler, Equiangular, Flight, ProgressiveBounds, WeightedFlight, delta_tracking,
    ray_marching_flight,
};
use pileus_media::random::{exponential, uniform};
use pileus_media::{
    Channels, ChromaticRatio, ExactField, Grey, Spectrum, Tally, TentativeCollisions,
};
use pileus_tests::root;
use proptest::prelude::*;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use serde::Deserialize;

const BINS: usize = 16;

#[derive(Deserialize)]
struct ClosedForms {
    cases: Vec<ProfileCase>,
}

fn cases() -> Vec<ProfileCase> {
    let text = std::fs::read(root().join("tests/data/oracle/closed_forms.json")).unwrap();
    serde_json::from_slice::<ClosedForms>(&text).unwrap().cases
}

fn case(name: &str) -> ProfileCase {
    cases().into_iter().find(|case| case.name == name).unwrap()
}

fn constant(value: f64, bound: f64) -> ProfileCase {
    ProfileCase {
        name: format!("constant {value} under {bound}"),
        profile: Profile::Constant { value },
        length: 1.0,
        majorant: value,
        minorant: value,
        use_majorant: Some(bound),
    }
}

/// Weighted flights by where they ended: sums and sums of squares per bin (the last one is the
/// escape) and channel.
struct Histogram {
    sum: Vec<[f64; 3]>,
    square: Vec<[f64; 3]>,
    tally: Tally,
    samples: u32,
}

fn histogram<S: Spectrum>(
    length: f64,
    samples: u32,
    mut fly: impl FnMut(&mut Pcg32, &mut Tally) -> WeightedFlight<S>,
) -> Histogram {
    let mut rng = Pcg32::new(20_261_123, 5);
    let mut result = Histogram {
        sum: vec![[0.0; 3]; BINS + 1],
        square: vec![[0.0; 3]; BINS + 1],
        tally: Tally::default(),
        samples,
    };
    for _ in 0..samples {
        let flown = fly(&mut rng, &mut result.tally);
        let bin = match flown.flight {
            Flight::Collision(t) => {
                assert!(t >= 0.0 && f64::from(t) <= length * 1.000_001, "{t}");
                ((f64::from(t) / length * BINS as f64) as usize).min(BINS - 1)
            }
            Flight::Escape => BINS,
        };
        for c in 0..S::COUNT {
            let w = f64::from(flown.weight.channel(c));
            assert!(w.is_finite());
            result.sum[bin][c] += w;
            result.square[bin][c] += w * w;
        }
    }
    result
}

impl Histogram {
    /// Largest |z| over bins and channels against the law of the case; bins that may have met too
    /// few flights to be normal are left out.
    fn worst_z(&self, case: &ProfileCase, relative: &[f64]) -> f64 {
        let n = f64::from(self.samples);
        let mut worst = 0.0f64;
        for (c, relative) in relative.iter().enumerate() {
            let transmittance = |i: usize| {
                (-relative * case.profile.optical_depth(case.length * i as f64 / BINS as f64)).exp()
            };
            for bin in 0..=BINS {
                let expected = if bin == BINS {
                    transmittance(BINS)
                } else {
                    transmittance(bin) - transmittance(bin + 1)
                };
                let mean = self.sum[bin][c] / n;
                let variance = self.square[bin][c] / n - mean * mean;
                if expected * n < 100.0 {
                    continue;
                }
                let error = (variance.max(0.0) / n).sqrt() + 3e-6 * expected;
                worst = worst.max(((mean - expected) / error).abs());
            }
        }
        worst
    }
}

fn fly_named<C: Channels>(
    case: &ProfileCase,
    sampler: DistanceSampler,
    channels: C,
    beta: C::Value,
    samples: u32,
) -> Histogram {
    histogram(case.length, samples, |rng, tally| {
        sampler.fly(case.ray(), channels, beta, None, rng, tally)
    })
}

/// Null hypothesis: flights end where the law says. Some 2000 bins per channel count, |z| < 6:
/// false alarm 4e-6 under the normal law.
#[test]
fn flights_end_where_the_law_says() {
    let pairs: Vec<(ProfileCase, DistanceSampler)> = cases()
        .into_iter()
        .flat_map(|case| DistanceSampler::ALL.map(|sampler| (case.clone(), sampler)))
        .filter(|(case, sampler)| {
            let constant = matches!(case.profile, Profile::Constant { .. });
            sampler.is_unbiased()
                && sampler.is_one_flight()
                && (case.is_bounded() || sampler.is_unbiased_without_bounds())
                && (*sampler != DistanceSampler::Analytic || constant)
                // Signed weights with an exponential variance: a test of its own.
                && (case.is_bounded() || *sampler != DistanceSampler::WeightedDelta)
        })
        .collect();
    assert!(pairs.len() > 150, "{}", pairs.len());
    let worst: Vec<(f64, String)> = pairs
        .par_iter()
        .map(|(case, sampler)| {
            let grey = fly_named(case, *sampler, Grey, 1.0, 40_000).worst_z(case, &[1.0]);
            let (relative, beta) = (Vec3::new(1.0, 0.4, 0.0), Vec3::new(0.5, 2.0, 1.0));
            // Delta tracking's weights have no bound where channels differ: thick cases are too
            // heavy-tailed for a normal mean.
            let wild = *sampler == DistanceSampler::Delta && case.optical_depth() > 3.0;
            let histogram = fly_named(case, *sampler, ChromaticRatio(relative), beta, 40_000);
            let color = if wild {
                0.0
            } else {
                histogram.worst_z(case, &[1.0, f64::from(relative.y), 0.0])
            };
            (
                grey.max(color),
                format!("{} {}: grey {grey:.2}, color {color:.2}", case.name, sampler.name()),
            )
        })
        .collect();
    let (z, name) = worst.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    println!("{} pairs, worst {name}", worst.len());
    assert!(*z < 6.0, "{name}");
}

/// The mean of throughput times weight over channels never changes: what bounds the weights of
/// spectral, regular and decomposition flights.
#[test]
fn weights_keep_the_mean_throughput() {
    let case = case("sine");
    let (relative, beta) = (Vec3::new(1.0, 0.1, 0.0), Vec3::new(0.2, 1.0, 3.0));
    for sampler in
        [DistanceSampler::Spectral, DistanceSampler::Regular, DistanceSampler::Decomposition]
    {
        let mut rng = Pcg32::new(3, 3);
        for _ in 0..10_000 {
            let mut tally = Tally::default();
            let flown =
                sampler.fly(case.ray(), ChromaticRatio(relative), beta, None, &mut rng, &mut tally);
            let mean = (beta * flown.weight).element_sum() / beta.element_sum();
            assert!((mean - 1.0).abs() < 1e-3, "{sampler:?}: {mean}");
        }
    }
}

/// Collisions with the minorant cost no lookup; the law of flights is the same.
#[test]
fn decomposition_saves_the_minorants_lookups() {
    let looked_up = |case: &ProfileCase, sampler| {
        let h = fly_named(case, sampler, Grey, 1.0, 20_000);
        h.tally.lookups as f64 / 20_000.0
    };
    assert_eq!(looked_up(&constant(3.0, 3.0), DistanceSampler::Decomposition), 0.0);
    // A ramp from 1 to 3: a third of the collisions belongs to the minorant.
    let ramp = ProfileCase {
        name: "ramp".into(),
        profile: Profile::Linear { a: 1.0, b: 2.0 },
        length: 1.0,
        majorant: 3.0,
        minorant: 1.0,
        use_majorant: None,
    };
    let (delta, decomposition) = (
        looked_up(&ramp, DistanceSampler::Delta),
        looked_up(&ramp, DistanceSampler::Decomposition),
    );
    println!("ramp: delta {delta:.3}, decomposition {decomposition:.3} lookups");
    assert!((decomposition / delta - 2.0 / 3.0).abs() < 0.02, "{decomposition} of {delta}");
}

/// Where the rate does not bound: the mean of escapes stays, and their second moment grows
/// exponentially, as its closed form says. For constant extinction `s` under rate `m`,
/// `r = s / m > 1`: nulls happen with `(r - 1) / (2 r - 1)` and weight `-(2 r - 1)`, so that a
/// tentative collision multiplies the second moment by `(r - 1) (2 r - 1)`.
#[test]
fn weighted_tracking_pays_exponentially_for_broken_bounds() {
    let mut last = 0.0;
    for (excess, samples) in [(1.01, 100_000), (1.3, 100_000), (1.6, 400_000)] {
        let case = constant(2.0 * excess, 2.0);
        let h = fly_named(&case, DistanceSampler::WeightedDelta, Grey, 1.0, samples);
        assert!(h.tally.violations > 0);
        let n = f64::from(samples);
        let (mean, square) = (h.sum[BINS][0] / n, h.square[BINS][0] / n);
        let t = (-2.0 * excess).exp();
        let z = (mean - t) / ((square - mean * mean) / n).sqrt();
        let theory = (2.0 * ((excess - 1.0) * (2.0 * excess - 1.0) - 1.0)).exp();
        println!(
            "bound exceeded {excess}: z {z:.2}, second moment {square:.5}, theory {theory:.5}"
        );
        // Null hypothesis: unbiased; |z| < 5, false alarm 2e-6 in all.
        assert!(z.abs() < 5.0);
        assert!((square / theory - 1.0).abs() < 0.1, "{square} {theory}");
        let relative = square / (t * t) - 1.0;
        assert!(relative > last);
        last = relative;
    }
}

/// Distances by marching: the error of the transmittance at the end falls with the square of the
/// step for a smooth field.
#[test]
fn marched_flights_lose_their_bias_at_second_order() {
    let case = case("ramp_up_4");
    // A flight that is drawn to infinity escapes with the marched transmittance for its
    // probability.
    let marched = |steps: u32| {
        let (mut rng, mut tally) = (Pcg32::new(6, 6), Tally::default());
        let n = 100_000;
        let mut one = || {
            let drawn = f32::INFINITY;
            ray_marching_flight(case.ray(), Grey, 1.0, steps, drawn, &mut rng, &mut tally)
        };
        (0..n).map(|_| f64::from(one().null_probability)).sum::<f64>() / f64::from(n)
    };
    let exact = (-case.optical_depth()).exp();
    let bias = [8, 16, 32].map(|steps| marched(steps) - exact);
    println!("exact {exact:.5}, bias {bias:.7?}");
    for pair in bias.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!(pair[1] > 0.0 && (1.8..2.2).contains(&order), "{bias:?}, order {order}");
    }
    // Collisions of flights that were not drawn to infinity: the law at 64 steps within what its
    // bias allows.
    let h = histogram(case.length, 100_000, |rng, tally| {
        let drawn = exponential(rng);
        ray_marching_flight(case.ray(), Grey, 1.0, 64, drawn, rng, tally)
    });
    assert!(h.worst_z(&case, &[1.0]) < 5.0);
}

/// What weights are made of: under a bound of four times the extinction a null collision is one with
/// probability 3/4, and each is told.
#[test]
fn delta_tracking_tells_the_probability_of_each_null_collision() {
    let bounds = ProgressiveBounds::new(3.0, 8, 4.0);
    let (mut rng, mut tally, mut told) = (Pcg32::new(7, 7), Tally::default(), 0);
    for _ in 0..1000 {
        let walk = TentativeCollisions::new(bounds.ray(|_| 1.0));
        delta_tracking(walk, &mut rng, &mut tally, |probability| {
            assert_eq!(probability, 0.75);
            told += 1;
        });
    }
    assert!(told > 1000 && told == tally.null_collisions, "{told} {tally:?}");
}

/// Guessed bounds that learn: the first samples are biased bright, the mean over all converges,
/// nothing is negative.
#[test]
fn progressive_bounds_become_bounds() {
    let case = case("hidden_peak");
    let exact = (-case.optical_depth()).exp();
    let mut bounds = ProgressiveBounds::new(case.length as f32, 64, case.bound() as f32);
    let sigma_t = |t: f32| case.profile.sigma_t(f64::from(t)) as f32;
    let mut rng = Pcg32::new(9, 9);
    let mut escapes = |bounds: &ProgressiveBounds, samples: u32| {
        let mut tally = Tally::default();
        let mut escaped = 0u32;
        for _ in 0..samples {
            let walk = TentativeCollisions::new(bounds.ray(sigma_t));
            let flight = delta_tracking(walk, &mut rng, &mut tally, |_| {});
            escaped += u32::from(flight == Flight::Escape);
        }
        assert_eq!(tally.violations, 0, "the medium is clamped to its bounds");
        f64::from(escaped) / f64::from(samples)
    };
    let n = 20_000;
    let first = escapes(&bounds, n);
    let error = (exact * (1.0 - exact) / f64::from(n)).sqrt();
    assert!((first - exact) / error > 20.0, "{first} {exact}");
    let mut raised = 0;
    for _ in 0..60 {
        raised += bounds.raise(1.05);
        escapes(&bounds, 500);
    }
    bounds.raise(1.05);
    let last = escapes(&bounds, n);
    println!("exact {exact:.5}: guessed {first:.5}, learnt {last:.5} after {raised} raises");
    // Null hypothesis: all excess was seen, the mean is exact; |z| < 5.
    assert!(((last - exact) / error).abs() < 5.0, "{last} {exact}");
    assert!(bounds.bounds().iter().any(|b| f64::from(*b) > 30.0));
}

/// Chi-square of equiangular points against their density, also for lights on the ray and parts
/// without end.
#[test]
fn equiangular_points_have_their_density() {
    for (light, part) in [
        (DVec3::new(0.3, 0.5, 0.0), (0.0, 2.0)),
        (DVec3::new(5.0, 1e-3, 0.0), (1.0, 20.0)),
        (DVec3::new(-1.0, 2.0, 1.0), (0.0, f64::INFINITY)),
        (DVec3::new(1.0, 0.0, 0.0), (0.0, 0.9)),
    ] {
        let points = Equiangular::new(DVec3::ZERO, Vec3::X, light, part).unwrap();
        let mut rng = Pcg32::new(1, 2);
        let (n, bins) = (100_000u32, 50usize);
        // Equal probabilities by construction of the sampler: edges at known quantiles, their mass
        // by quadrature of the density.
        let edges: Vec<f64> = (0..=bins).map(|i| points.sample(i as f32 / bins as f32)).collect();
        for i in 0..bins - 1 {
            let (a, b) = (edges[i], edges[i + 1]);
            let m = 2000;
            let h = (b - a) / f64::from(m);
            let mass: f64 = (0..m).map(|k| points.pdf(a + (f64::from(k) + 0.5) * h) * h).sum();
            assert!((mass * bins as f64 - 1.0).abs() < 1e-2, "{light} {part:?} bin {i}: {mass}");
        }
        let mut counts = vec![0.0; bins];
        for _ in 0..n {
            let t = points.sample(uniform(&mut rng));
            assert!(t >= part.0 && t <= part.1 && points.pdf(t) > 0.0);
            let bin = edges.partition_point(|edge| *edge <= t).clamp(1, bins) - 1;
            counts[bin] += 1.0;
        }
        let expected = f64::from(n) / bins as f64;
        let chi2: f64 = counts.iter().map(|c| (c - expected).powi(2) / expected).sum();
        // 49 degrees of freedom: above 120 with probability 1e-7.
        assert!(chi2 < 120.0, "{light} {part:?}: {chi2}");
    }
    assert!(Equiangular::new(DVec3::ZERO, Vec3::X, DVec3::Y, (1.0, 1.0)).is_none());
}

/// Fog without end and a channel without extinction: every sampler comes to an end.
#[test]
fn endless_fields_end() {
    use pileus_media::{Medium, Phase};
    for sigma_t in [[1.0, 0.5, 0.0], [0.0; 3]] {
        let fog = Medium::homogeneous(sigma_t, None, [1.0; 3], Phase::Isotropic).unwrap();
        let relative = ChromaticRatio(fog.chromatic_ratio());
        let span = fog.span(DVec3::ZERO, Vec3::X, f64::INFINITY).unwrap();
        for sampler in DistanceSampler::ALL {
            let mut rng = Pcg32::new(4, 4);
            for _ in 0..1000 {
                let ray = fog.any_ray(&span, 1.0);
                assert!(ray.optical_depth(&mut Tally::default()) >= 0.0);
                let beta = Vec3::new(0.0, 0.0, 1.0);
                let mut tally = Tally::default();
                let flown = sampler.fly(ray, relative, beta, None, &mut rng, &mut tally);
                assert!(flown.weight.is_finite(), "{sampler:?} {flown:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    /// No flight has a weight that is not a number, whatever the field, the bound and the
    /// throughput.
    #[test]
    fn no_weight_is_nan(
        values in prop::collection::vec(prop_oneof![Just(0.0), 1e-6..1.0f64, 1.0..300.0f64], 1..8),
        length in prop_oneof![Just(0.0), 1e-6..1e-3f64, 0.01..4.0f64],
        bound in prop_oneof![Just(1.0), 0.01..1.0f64, 1.0..10.0f64],
        relative in [0.0..=1.0f32, 0.0..=1.0f32, 0.0..=0.0f32],
        beta in [0.0..=10.0f32, 0.0..=0.0f32, 0.0..=1e-6f32],
        seed in any::<u64>(),
    ) {
        let n = values.len();
        let case = ProfileCase {
            name: String::new(),
            majorant: values.iter().copied().fold(0.0, f64::max),
            minorant: values.iter().copied().fold(f64::INFINITY, f64::min),
            use_majorant: Some(bound * values.iter().copied().fold(0.0, f64::max)),
            profile: Profile::Steps { edges: (0..=n).map(|i| length * i as f64 / n as f64).collect(), values },
            length,
        };
        let (mut rng, mut tally) = (Pcg32::new(seed, 5), Tally::default());
        for sampler in DistanceSampler::ALL {
            for _ in 0..8 {
                let grey = sampler.fly(case.ray(), Grey, 1.0, None, &mut rng, &mut tally);
                prop_assert!(!grey.weight.is_nan() && !grey.null_probability.is_nan(), "{sampler:?} {grey:?}");
                let (relative, beta) = (ChromaticRatio(Vec3::from_array(relative)), Vec3::from_array(beta));
                let color = sampler.fly(case.ray(), relative, beta, None, &mut rng, &mut tally);
                prop_assert!(!color.weight.is_nan(), "{sampler:?} {color:?}");
                if let Flight::Collision(t) = color.flight {
                    prop_assert!(t >= 0.0 && f64::from(t) <= length * 1.000_001, "{sampler:?} {t} {length}");
                }
            }
        }
    }
}
