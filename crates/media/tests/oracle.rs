//! Optical depths of random rays, known to 1e-10, against our trackers.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

mod common;

use glam::DVec3;
use pileus_media::transmittance::Estimator;
use pileus_media::{ExactField, Grey, RayField, Tally, optical_depth};
use rand_pcg::Pcg32;
use serde_json::Value;

const ASSETS: [&str; 4] = ["cumulus_small", "syn_plume", "syn_rotated", "syn_sphere"];

struct OracleRay {
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
    tau: f64,
}

fn rays(name: &str) -> (String, f64, Vec<OracleRay>) {
    let path = common::root().join("tests/data/oracle").join(format!("{name}.json"));
    let json: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let vec = |v: &Value| {
        DVec3::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap(), v[2].as_f64().unwrap())
    };
    let rays = json["rays"].as_array().unwrap();
    let rays = rays
        .iter()
        .map(|ray| OracleRay {
            origin: vec(&ray["origin"]),
            direction: vec(&ray["direction"]),
            t_min: ray["tmin"].as_f64().unwrap(),
            t_max: ray["tmax"].as_f64().unwrap(),
            tau: ray["optical_depth"].as_f64().unwrap(),
        })
        .collect();
    (json["grid"].as_str().unwrap().to_owned(), json["density_scale"].as_f64().unwrap(), rays)
}

#[test]
fn regular_tracking_agrees_to_1e5() {
    for name in ASSETS {
        let (grid, scale, rays) = rays(name);
        let medium = common::medium(&common::asset(&format!("{name}.vdb")), &grid, scale as f32);
        let mut worst = 0.0f64;
        for ray in &rays {
            let tau = optical_depth(
                &medium,
                ray.origin,
                ray.direction,
                ray.t_min,
                ray.t_max,
                &mut Tally::default(),
            );
            // The oracle itself is good to 1e-11.
            let error = ((tau - ray.tau).abs() - 1e-11).max(0.0) / ray.tau.max(1e-30);
            assert!(error < 1e-5, "{name}: tau {tau}, exact {}", ray.tau);
            worst = worst.max(error);
        }
        println!("{name}: {} rays, worst relative error {worst:.2e}", rays.len());
    }
}

/// Null hypothesis per ray: the estimator's mean is `exp(-tau)`. Rays are scaled to a depth of at
/// most 3, so that 20,000 samples tell the mean well and the normal law holds. |z| < 6.5 fails by
/// chance with probability 8e-11 per ray and estimator: below 1e-6 for the suite.
#[test]
fn trackers_are_unbiased_on_every_ray() {
    let mut failed = Vec::new();
    const SAMPLES: u32 = 20_000;
    for name in ASSETS {
        let (grid, _, rays) = rays(name);
        let path = common::asset(&format!("{name}.vdb"));
        let unit = common::medium(&path, &grid, 1.0);
        let mut tested = 0;
        for (index, ray) in rays.iter().enumerate() {
            if ray.tau < 1e-6 || ray.t_min >= ray.t_max {
                continue;
            }
            let scale = (3.0 / ray.tau).min(20.0) as f32;
            let exact = (-ray.tau * f64::from(scale)).exp();
            let medium = pileus_media::Medium::from_grid(
                unit.grid().unwrap().voxels().clone(),
                common::read(&path, &grid).1,
                [scale; 3],
                unit.optics().albedo().clone(),
                unit.phase().clone(),
            )
            .unwrap();
            let origin = ray.origin + ray.direction * ray.t_min;
            let Some(span) = medium.span(origin, ray.direction.as_vec3(), ray.t_max - ray.t_min)
            else {
                panic!("{name} ray {index}: depth {} but no span", ray.tau);
            };
            let mut methods: Vec<(&str, Estimator, f32)> = Estimator::ALL
                .into_iter()
                .filter(|e| e.is_unbiased() && *e != Estimator::Regular)
                .map(|e| (e.name(), e, 0.0))
                .collect();
            methods.push(("ratio with roulette", Estimator::Ratio, 0.5));
            let mut walk = medium.any_ray(&span, 1.0);
            let mut majorant_depth = 0.0;
            while let Some(segment) = walk.next_segment() {
                majorant_depth += (segment.t1 - segment.t0) * segment.majorant;
            }
            for (name_of, estimator, threshold) in methods {
                // Loose intervals multiply their noise: beyond some intervals the mean of few
                // samples tells nothing.
                if estimator == Estimator::Bidirectional && majorant_depth > 32.0 {
                    continue;
                }
                let mut rng = Pcg32::new(index as u64, 11);
                let mut tally = Tally::default();
                let (mut sum, mut squares) = (0.0f64, 0.0f64);
                let samples = if name_of.starts_with("ratio") { SAMPLES } else { SAMPLES / 4 };
                for _ in 0..samples {
                    let field = medium.any_ray(&span, 1.0);
                    let x = estimator.estimate(field, Grey, threshold, &mut rng, &mut tally);
                    let x = f64::from(x);
                    sum += x;
                    squares += x * x;
                }
                assert_eq!(tally.violations, 0);
                let n = f64::from(samples);
                let mean = sum / n;
                // The rounding of single precision counts as much as noise where there is hardly
                // any.
                let variance = (squares / n - mean * mean).max(0.0) / n + 1e-11 * exact * exact;
                // A delta tracker that never saw an event has no variance of its own: take the
                // exact one.
                let bernoulli = exact * (1.0 - exact) / n;
                let variance = if estimator == Estimator::Delta {
                    bernoulli + 1e-14
                } else {
                    variance.max(1e-3 * bernoulli)
                };
                let z = (mean - exact) / variance.sqrt();
                if !(z.abs() < 6.5) {
                    failed.push(format!(
                        "{name} ray {index} {name_of}: z {z:.2}, mean {mean}, exact {exact}"
                    ));
                }
            }
            tested += 1;
        }
        assert!(tested > 20, "{name}: only {tested} rays tested");
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

/// The inversion of optical depth: the depth up to the point found is the one asked for.
#[test]
fn exact_inversion_finds_the_depth() {
    for name in ASSETS {
        let (grid, scale, rays) = rays(name);
        let medium = common::medium(&common::asset(&format!("{name}.vdb")), &grid, scale as f32);
        let mut tested = 0;
        for (index, ray) in rays.iter().enumerate() {
            let origin = ray.origin + ray.direction * ray.t_min;
            let length = ray.t_max - ray.t_min;
            let Some(span) = medium.span(origin, ray.direction.as_vec3(), length) else {
                continue;
            };
            let tally = &mut Tally::default();
            let whole = medium.any_ray(&span, 1.0).optical_depth(tally);
            if whole < 1e-4 {
                continue;
            }
            assert!(
                (whole / ray.tau - 1.0).abs() < 1e-3,
                "{name} ray {index}: {whole} {}",
                ray.tau
            );
            assert_eq!(medium.any_ray(&span, 1.0).t_at_depth(2.0 * whole, tally), Err(whole));
            for share in [0.0, 0.01, 0.5, 0.99, 1.0] {
                let t = medium.any_ray(&span, 1.0).t_at_depth(share * whole, tally).unwrap();
                let end = span.t_enter + f64::from(t);
                let depth = optical_depth(&medium, origin, ray.direction, 0.0, end, tally);
                // Single precision in t and in the span.
                let error = (depth - share * whole).abs() / whole;
                assert!(error < 2e-3, "{name} ray {index} at {share}: {depth} of {whole}");
            }
            tested += 1;
        }
        assert!(tested > 20, "{name}: only {tested} rays tested");
    }
}

/// Null hypothesis per ray: flights end in four parts of equal probability, and escape, as the
/// exact depth says. |z| < 6.5 on some 30,000 figures: false alarm 3e-6 under the normal law.
#[test]
fn flights_are_exact_on_every_ray() {
    use pileus_media::distance::{DistanceSampler, Flight};
    const SAMPLES: u32 = 4_000;
    let mut failed = Vec::new();
    for name in ASSETS {
        let (grid, _, rays) = rays(name);
        let path = common::asset(&format!("{name}.vdb"));
        let unit = common::medium(&path, &grid, 1.0);
        let mut tested = 0;
        for (index, ray) in rays.iter().enumerate() {
            if ray.tau < 1e-3 || ray.t_min >= ray.t_max {
                continue;
            }
            let scale = (2.0 / ray.tau).min(20.0) as f32;
            let medium = pileus_media::Medium::from_grid(
                unit.grid().unwrap().voxels().clone(),
                common::read(&path, &grid).1,
                [scale; 3],
                unit.optics().albedo().clone(),
                unit.phase().clone(),
            )
            .unwrap();
            let origin = ray.origin + ray.direction * ray.t_min;
            let length = ray.t_max - ray.t_min;
            let Some(span) = medium.span(origin, ray.direction.as_vec3(), length) else {
                panic!("{name} ray {index}: depth {} but no span", ray.tau);
            };
            let escape = (-ray.tau * f64::from(scale)).exp();
            let part = 0.25 * (1.0 - escape);
            if part * f64::from(SAMPLES) < 30.0 {
                continue;
            }
            let ends: Vec<f32> = (1..4)
                .map(|k| {
                    let depth = -(1.0 - f64::from(k) * part).ln();
                    medium
                        .any_ray(&span, 1.0)
                        .t_at_depth(depth, &mut Tally::default())
                        .unwrap_or(f32::MAX)
                })
                .collect();
            for sampler in [
                DistanceSampler::Delta,
                DistanceSampler::WeightedDelta,
                DistanceSampler::Decomposition,
                DistanceSampler::Regular,
                DistanceSampler::Spectral,
            ] {
                let mut rng = Pcg32::new(index as u64, 13);
                let mut tally = Tally::default();
                let mut counts = [0.0f64; 5];
                for _ in 0..SAMPLES {
                    let field = medium.any_ray(&span, 1.0);
                    let flown = sampler.fly(field, Grey, 1.0, None, &mut rng, &mut tally);
                    assert!((flown.weight - 1.0).abs() < 1e-4, "{sampler:?} {flown:?}");
                    let bin = match flown.flight {
                        Flight::Collision(t) => ends.iter().filter(|end| t > **end).count(),
                        Flight::Escape => 4,
                    };
                    counts[bin] += 1.0;
                }
                assert_eq!(tally.violations, 0);
                for (bin, count) in counts.into_iter().enumerate() {
                    let p = if bin == 4 { escape } else { part };
                    let n = f64::from(SAMPLES);
                    // Ends are known in single precision: some 1e-4 of the probability may change
                    // sides.
                    let error = (n * p * (1.0 - p)).sqrt() + 3e-4 * n * p;
                    let z = (count - n * p) / error;
                    if !(z.abs() < 6.5) {
                        failed.push(format!(
                            "{name} ray {index} {}: part {bin}, z {z:.2}",
                            sampler.name()
                        ));
                    }
                }
            }
            tested += 1;
        }
        println!("{name}: {tested} rays");
        assert!(tested > 20, "{name}: only {tested} rays tested");
    }
    assert!(failed.is_empty(), "{failed:#?}");
}
