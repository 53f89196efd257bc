//! Samples against densities and values.

use glam::DVec3;
use pileus_math::random::uniform;
use pileus_scene::SurfaceParameters;
use rand_pcg::Pcg32;
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF};

use crate::materials::{NORMAL, all, bsdf, direction};
use crate::quadrature::{lobes, over_sphere};

const ROUGHNESS: [f32; 5] = [0.02, 0.04, 0.15, 0.45, 1.0];
const COSINES: [f32; 3] = [0.1, 0.5, 0.97];

/// Calls `f` for every kind of surface, roughness, angle and, for bodies, side: 195 cases.
fn cases(f: impl Fn(&str, &SurfaceParameters, f32, bool, u64) + Sync) {
    let mut list = Vec::new();
    for roughness in ROUGHNESS {
        for (name, p) in all(roughness) {
            for cos in COSINES {
                for entering in [true, false] {
                    if entering || !p.thin_walled {
                        let name = format!("{name}, roughness {roughness}, cos {cos}, {entering}");
                        list.push((name, p, cos, entering));
                    }
                }
            }
        }
    }
    assert_eq!(list.len(), 195);
    list.par_iter().enumerate().for_each(|(seed, (name, p, cos, entering))| {
        f(name, p, *cos, *entering, seed as u64);
    });
}

/// Null hypothesis: samples fall into cells of solid angle as `pdf` says; what is left is delta
/// lobes and ended paths, none of which has a density. Chi-square, false alarm 1e-10 per case, 2e-8
/// in all. Cells that expect fewer than 10 are joined.
#[test]
fn samples_follow_the_density() {
    const N: u32 = 60_000;
    const CELLS: [usize; 2] = [16, 12];
    cases(|name, p, cos, entering, seed| {
        let bsdf = bsdf(p, entering);
        let wo = direction(cos, 0.15);
        let lobes = lobes(p, wo, entering);
        let cell = |x: f64, turn: f64, side: usize| {
            let a = ((x * CELLS[0] as f64) as usize).min(CELLS[0] - 1);
            let b = ((turn * CELLS[1] as f64) as usize).min(CELLS[1] - 1);
            (side * CELLS[0] + a) * CELLS[1] + b
        };
        let mut counts = vec![0u32; 2 * CELLS[0] * CELLS[1] + 1];
        let rest = counts.len() - 1;
        let mut rng = Pcg32::new(seed, 77);
        for _ in 0..N {
            let u = [uniform(&mut rng), uniform(&mut rng), uniform(&mut rng)];
            match bsdf.sample(wo, u) {
                Some(s) if !s.delta => {
                    let side = usize::from(s.transmitted);
                    let (x, turn) = lobes[side].coordinates(s.wi);
                    counts[cell(x, turn, side)] += 1;
                }
                _ => counts[rest] += 1,
            }
        }
        let mut expected = Vec::with_capacity(counts.len());
        for (side, polar) in lobes.iter().enumerate() {
            let sign = if side == 0 { 1.0 } else { -1.0 };
            for a in 0..CELLS[0] {
                for b in 0..CELLS[1] {
                    let range =
                        |k: usize, n: usize| [k as f64 / n as f64, (k + 1) as f64 / n as f64];
                    let (x, turn) = (range(a, CELLS[0]), range(b, CELLS[1]));
                    // Densities end at the horizon: cells across it need more points.
                    let above = |a: usize, b: usize| {
                        NORMAL.dot(polar.direction(x[a], turn[b]).0) * sign > 0.0
                    };
                    let corners = [above(0, 0), above(0, 1), above(1, 0), above(1, 1)];
                    let across = corners.iter().any(|&c| c != corners[0]);
                    let points = if across { [48, 40] } else { [12, 10] };
                    let mass = polar.cell(x, turn, points, |w| {
                        if NORMAL.dot(w) * sign > 0.0 {
                            DVec3::splat(f64::from(bsdf.pdf(wo, w)))
                        } else {
                            DVec3::ZERO
                        }
                    });
                    expected.push(mass.x * f64::from(N));
                }
            }
        }
        let total: f64 = expected.iter().sum();
        assert!(total <= f64::from(N) * 1.002, "{name}: the density integrates to {total} of {N}");
        expected.push((f64::from(N) - total).max(0.0));

        let (mut chi2, mut freedom, mut joined) = (0.0, -1.0, [0.0, 0.0]);
        let mut add = |count: f64, expected: f64| {
            chi2 += (count - expected).powi(2) / expected;
            freedom += 1.0;
        };
        for (&count, &expected) in counts.iter().zip(&expected) {
            if expected >= 10.0 {
                add(f64::from(count), expected);
            } else {
                joined = [joined[0] + f64::from(count), joined[1] + expected];
            }
        }
        // Quadrature leaves up to some ten of the samples over where nothing is expected.
        add(joined[0], joined[1].max(10.0));
        if freedom < 1.0 {
            return;
        }
        let p_value = 1.0 - ChiSquared::new(freedom).expect("freedom").cdf(chi2);
        assert!(p_value > 1e-10, "{name}: chi2 {chi2:.1} for {freedom} degrees of freedom");
    });
}

/// Null hypothesis: the mean weight of samples that are not from delta lobes is the integral of the
/// value. z-test per channel, the quadrature's error (against half its resolution) added to the
/// variance; |z| < 7, false alarm 3e-12 per channel.
#[test]
fn mean_weight_is_the_integral() {
    const N: u32 = 40_000;
    cases(|name, p, cos, entering, seed| {
        let bsdf = bsdf(p, entering);
        let wo = direction(cos, 0.85);
        let lobes = lobes(p, wo, entering);
        let integral = |n: [u32; 2]| {
            let [r, t] = over_sphere(&lobes, n, |w| bsdf.eval(wo, w).as_dvec3());
            r + t
        };
        let (fine, coarse) = (integral([256, 128]), integral([128, 64]));
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        let mut rng = Pcg32::new(seed, 99);
        for _ in 0..N {
            let u = [uniform(&mut rng), uniform(&mut rng), uniform(&mut rng)];
            if let Some(s) = bsdf.sample(wo, u).filter(|s| !s.delta) {
                sum += s.weight.as_dvec3();
                squares += s.weight.as_dvec3() * s.weight.as_dvec3();
            }
        }
        let n = f64::from(N);
        let mean = sum / n;
        let variance = (squares / n - mean * mean).max(DVec3::ZERO) / n;
        for k in 0..3 {
            let error = (fine[k] - coarse[k]).powi(2) + 1e-10;
            let z = (mean[k] - fine[k]) / (variance[k] + error).sqrt();
            assert!(z.abs() < 7.0, "{name}: {mean} for {fine}, z {z:.1}");
            // The error of quadrature must not hide a fault.
            assert!(error.sqrt() < 4e-3 + 6e-3 * fine[k], "{name}: {fine} {coarse}");
        }
    });
}
