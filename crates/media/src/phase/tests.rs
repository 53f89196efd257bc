use super::draine::MAX_ALPHA;
use super::*;
use glam::DAffine3;
use pileus_math::random::uniform;
use pileus_vdb::Tree;
use rand_pcg::Pcg32;

const GS: [f32; 9] = [-0.999, -0.9, -0.5, -1e-4, 1e-4, 0.3, 0.8, 0.95, 0.999];

/// Every law over its whole range of parameters.
fn lobes() -> Vec<(String, Mixture)> {
    let mut lobes = vec![Mixture::of(Lobe::Isotropic), Mixture::of(Lobe::Rayleigh)];
    lobes.extend(GS.map(|g| Mixture::of(Lobe::henyey_greenstein(g))));
    for g in [-0.999, -0.6, 0.0, 1e-6, 0.4, 0.95, 0.999] {
        for alpha in [0.0, 1.0, 30.0, 250.0, MAX_ALPHA] {
            lobes.push(Mixture::of(Lobe::Draine(Draine::new(g, alpha).unwrap())));
        }
    }
    for diameter in [0.01, 0.05, 0.1, 0.3, 1.0, 1.49, 1.5, 3.0, 4.81, 4.99, 5.0, 10.0, 20.0, 50.0] {
        lobes.push(MieFit::new(diameter).unwrap().mixture().unwrap());
    }
    lobes.push(two_lobes(0.999, -0.999, 0.5));
    lobes.push(two_lobes(0.8, -0.3, 0.9));
    let rough = [(0.0, 9.0), (1.0, 3.0), (20.0, 0.0), (90.0, 0.0), (138.0, 0.5), (180.0, 4.0)];
    lobes.push(Mixture::of(Lobe::Tabulated(Tabulated::new(&rough).unwrap())));
    lobes.push(Mixture::of(Lobe::Tabulated(table_of_henyey_greenstein(0.95))));
    lobes.into_iter().map(|lobe| (lobe.to_string(), lobe)).collect()
}

fn two_lobes(forward: f32, backward: f32, weight: f64) -> Mixture {
    let lobe = |g| Mixture::of(Lobe::henyey_greenstein(g));
    Mixture::new([(weight, lobe(forward)), (1.0 - weight, lobe(backward))]).unwrap()
}

fn table_of_henyey_greenstein(g: f64) -> Tabulated {
    let rows: Vec<(f64, f64)> = (0..=3600)
        .map(|i| {
            let angle = f64::from(i) * 0.05;
            let c = angle.to_radians().cos();
            (angle, (1.0 - g * g) / (1.0 + g * g - 2.0 * g * c).powf(1.5))
        })
        .collect();
    Tabulated::new(&rows).unwrap()
}

/// Rule in `1 - cos` that resolves both peaks: cubic towards each end, (angle, width).
fn rule(n: i32) -> impl Iterator<Item = (Cosine, f64)> {
    (0..2 * n).map(move |i| {
        let y = (f64::from(i % n) + 0.5) / f64::from(n);
        let (x, width) = (y.powi(3), 3.0 * y * y / f64::from(n));
        let forward = Cosine { one_minus: x as f32, one_plus: (2.0 - x) as f32 };
        (if i < n { forward } else { forward.mirrored() }, width)
    })
}

#[test]
fn every_law_is_normalised_with_the_stated_mean_cosine() {
    for (name, lobe) in lobes() {
        let (mut total, mut mean) = (0.0f64, 0.0f64);
        for (cosine, width) in rule(40_000) {
            let value = f64::from(lobe.eval(cosine)) * width * std::f64::consts::TAU;
            total += value;
            mean += value * f64::from(cosine.value());
        }
        assert!((total - 1.0).abs() < 2e-4, "{name}: total {total}");
        let stated = f64::from(lobe.mean_cosine());
        assert!((mean - stated).abs() < 2e-4, "{name}: mean cosine {mean}, stated {stated}");
    }
}

/// Null hypothesis: angles of samples are distributed as the values say. Chi-square over 48 bins
/// whose edges split the range finely towards both peaks, bins of less than 20 expected joined; the
/// critical value of each test is that of the normal approximation by Wilson and Hilferty at z =
/// 5.6: false alarm 1e-8 per law, below 1e-6 for the 60 of them. Densities that come with samples
/// are the values.
#[test]
fn samples_of_every_law_follow_its_values() {
    for (k, (name, lobe)) in lobes().into_iter().enumerate() {
        // Probability by quadrature of the values per fine cell; every 20th edge bounds a bin.
        let (edges, fine) = (24, 2_000);
        let n = edges * fine;
        let mut expected = vec![0.0f64; 2 * edges as usize];
        for (i, (cosine, width)) in rule(n).enumerate() {
            expected[i / fine as usize] +=
                f64::from(lobe.eval(cosine)) * width * std::f64::consts::TAU;
        }
        let total: f64 = expected.iter().sum();
        let mut counts = vec![0.0f64; 2 * edges as usize];
        let mut rng = Pcg32::new(k as u64, 7);
        let samples = 200_000;
        for _ in 0..samples {
            let cosine = lobe.sample(uniform(&mut rng));
            let (x, offset) = if cosine.one_minus < 1.0 {
                (cosine.one_minus, 0)
            } else {
                (cosine.one_plus, edges as usize)
            };
            let bin = (f64::from(x).cbrt() * f64::from(edges)) as usize;
            counts[bin.min(edges as usize - 1) + offset] += 1.0;
        }
        let (mut chi2, mut freedom, mut joined) = (0.0, -1.0, (0.0, 0.0));
        for (bin, (probability, count)) in expected.iter().zip(&counts).enumerate() {
            joined.0 += probability / total * f64::from(samples);
            joined.1 += count;
            if joined.0 >= 20.0 || bin + 1 == counts.len() {
                if joined.0 > 0.0 {
                    chi2 += (joined.1 - joined.0) * (joined.1 - joined.0) / joined.0;
                } else {
                    assert_eq!(joined.1, 0.0, "{name}: samples where there is no probability");
                }
                freedom += 1.0;
                joined = (0.0, 0.0);
            }
        }
        let a = 2.0 / (9.0 * f64::max(freedom, 1.0));
        let z = ((chi2 / f64::max(freedom, 1.0)).cbrt() - (1.0 - a)) / a.sqrt();
        assert!(z < 5.6, "{name}: chi2 {chi2} of {freedom}, z {z}");
    }
}

/// Directions as paths draw them, with and without the path's own code. Null hypothesis: their mean
/// is the incoming direction times the mean cosine; |z| below 6 in each of three axes of 80 laws,
/// false alarm 5e-7.
#[test]
fn directions_have_the_mean_cosine_and_their_density_is_the_value() {
    let incoming = Vec3::new(0.36, -0.48, 0.8);
    let mut laws: Vec<(String, Phase)> =
        lobes().into_iter().map(|(name, lobe)| (name, Phase::Mixture(Arc::new(lobe)))).collect();
    laws.push(("isotropic of paths".into(), Phase::Isotropic));
    laws.extend(GS.map(|g| (format!("g {g} of paths"), Phase::henyey_greenstein(g))));
    for (k, (name, phase)) in laws.into_iter().enumerate() {
        let phase = phase.at(|| DVec3::ZERO, Vec3::Z, &mut Pcg32::new(0, 0));
        let mut rng = Pcg32::new(k as u64, 11);
        let n = 20_000;
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        for _ in 0..n {
            let (wi, pdf) = phase.sample(incoming, [uniform(&mut rng), uniform(&mut rng)]);
            assert!((wi.length() - 1.0).abs() < 1e-5, "{name}: length {}", wi.length());
            // Directions are rounded: that moves a point of the steepest peak, 1e-3 wide, by 1e-4
            // of its width.
            let value = phase.eval(incoming, wi);
            assert!(pdf > 0.0 && (value - pdf).abs() <= 2e-3 * pdf, "{name}: {value} {pdf}");
            sum += wi.as_dvec3();
            squares += (wi * wi).as_dvec3();
        }
        let mean = sum / f64::from(n);
        let variance = (squares / f64::from(n) - mean * mean).max(DVec3::ZERO) / f64::from(n);
        let z = (mean - incoming.as_dvec3() * f64::from(phase.mean_cosine())).abs()
            / (variance.map(f64::sqrt) + 1e-6);
        assert!(z.max_element() < 6.0, "{name}: mean {mean}, z {z}");
    }
}

#[test]
fn every_law_is_reciprocal() {
    let mut rng = Pcg32::new(9, 9);
    let mut direction =
        || PhaseAt::Isotropic.sample(Vec3::Z, [uniform(&mut rng), uniform(&mut rng)]).0;
    for (name, lobe) in lobes() {
        let phase = PhaseAt::Mixture(&lobe);
        for _ in 0..200 {
            let (a, b) = (direction(), direction());
            // Backwards, light comes in along -b and leaves along -a.
            assert_eq!(phase.eval(a, b), phase.eval(-b, -a), "{name}: {a} {b}");
        }
    }
    for g in GS {
        let phase = PhaseAt::HenyeyGreenstein { g };
        let (a, b) = (direction(), direction());
        assert_eq!(phase.eval(a, b), phase.eval(-b, -a));
    }
}

#[test]
fn special_cases_agree() {
    let at = |x: f64| Cosine::from_one_minus(x);
    let draine = |g, alpha| Lobe::Draine(Draine::new(g, alpha).unwrap());
    for i in 0..=200 {
        let x = f64::from(i) * 0.01;
        let close = |a: f32, b: f32| assert!((a - b).abs() <= 2e-6 * b, "{x}: {a} {b}");
        close(draine(0.0, 1.0).eval(at(x)), Lobe::Rayleigh.eval(at(x)));
        close(draine(0.7, 0.0).eval(at(x)), Lobe::henyey_greenstein(0.7).eval(at(x)));
        let u = i as f32 / 201.0;
        let near = |a: Cosine, b: Cosine| assert!((a.one_minus - b.one_minus).abs() < 1e-5);
        near(draine(0.0, 1.0).sample(u), Lobe::Rayleigh.sample(u).mirrored());
        near(draine(-0.7, 0.0).sample(u), Lobe::henyey_greenstein(-0.7).sample(u));
    }
    // Paths' own code and the lobe are one function.
    let (a, b) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, 0.6, 0.8));
    for g in GS {
        let lobe = Mixture::of(Lobe::henyey_greenstein(g));
        let (own, general) = (PhaseAt::HenyeyGreenstein { g }, PhaseAt::Mixture(&lobe));
        assert!((own.eval(a, b) / general.eval(a, b) - 1.0).abs() < 1e-4);
    }
    // Mixtures of mixtures are flat, and single lobes take the path's own code.
    let nested = Mixture::new([(2.0, two_lobes(0.5, -0.5, 0.25)), (2.0, two_lobes(0.1, 0.2, 1.0))]);
    let nested = nested.unwrap();
    assert!((nested.mean_cosine() - (0.5 * (0.125 - 0.375) + 0.05)).abs() < 1e-6);
    assert!(matches!(Phase::mixture(Mixture::of(Lobe::Isotropic)), Phase::Isotropic));
    let single = Phase::mixture(two_lobes(0.3, 0.0, 1.0));
    assert!(matches!(single, Phase::HenyeyGreenstein { g: 0.3 }));
}

#[test]
fn draine_is_inverted_to_single_precision() {
    for g in [-0.999f32, -0.5, 0.0, 1e-7, 0.2, 0.9, 0.999] {
        for alpha in [0.0, 0.5, 30.0, 250.0, MAX_ALPHA] {
            let draine = Draine::new(g, alpha).unwrap();
            let mut last = None;
            for i in 0..=1000 {
                let u = (i as f32 / 1000.0).min(1.0 - f32::EPSILON / 2.0);
                let cosine = draine.sample(u);
                let x = f64::from(if g < 0.0 { cosine.one_plus } else { cosine.one_minus });
                // A numerical cumulative distribution between neighbouring samples: trapezoidal
                // steps, equal in the logarithm of the distance from the peak.
                if let Some((before, u_before)) = last {
                    let (g, alpha): (f64, f64) = (g.abs().into(), alpha.into());
                    let peak = (1.0 - g) * (1.0 - g);
                    let steps = 400;
                    let (from, to) = (f64::ln(x + peak), f64::ln(before + peak));
                    let h = (to - from) / f64::from(steps);
                    let probability: f64 = (0..=steps)
                        .map(|j| {
                            let distance = f64::exp(from + h * f64::from(j));
                            let x = distance - peak;
                            let end = if j == 0 || j == steps { 0.5 } else { 1.0 };
                            let d2: f64 = peak + 2.0 * g * x;
                            let hg = (1.0 - g * g) / (2.0 * d2.powf(1.5));
                            end * h * distance * hg * (1.0 + alpha * (1.0 - x) * (1.0 - x))
                                / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
                        })
                        .sum();
                    let step: f64 = f64::from(u) - u_before;
                    let error = (probability - step).abs();
                    assert!(error < 2e-4 * step + 2e-7, "{g} {alpha} {u}: {probability} {step}");
                }
                last = Some((x, f64::from(u)));
            }
        }
    }
}

#[test]
fn bad_parameters_are_refused() {
    assert!(Draine::new(1.0, 1.0).is_err() && Draine::new(f32::NAN, 1.0).is_err());
    assert!(Draine::new(0.0, -1.0).is_err() && Draine::new(0.0, f32::INFINITY).is_err());
    for diameter in [0.0, -1.0, 50.1, f64::NAN] {
        assert!(MieFit::new(diameter).is_err());
    }
    assert!(Mixture::new([]).is_err());
    assert!(Mixture::new([(0.0, Mixture::of(Lobe::Rayleigh))]).is_err());
    assert!(Mixture::new([(f64::NAN, Mixture::of(Lobe::Rayleigh))]).is_err());
    let many = (0..65).map(|_| (1.0, Mixture::of(Lobe::Rayleigh)));
    assert!(Mixture::new(many).is_err());
    let row = |rows: &[(f64, f64)]| Tabulated::new(rows).unwrap_err().0;
    assert_eq!(row(&[]), None);
    assert_eq!(row(&[(0.0, 0.0), (180.0, 0.0)]), None);
    assert_eq!(row(&[(0.0, 1.0), (90.0, 1.0)]), Some(1));
    assert_eq!(row(&[(5.0, 1.0), (180.0, 1.0)]), Some(0));
    assert_eq!(row(&[(0.0, 1.0), (90.0, 1.0), (90.0, 1.0), (180.0, 1.0)]), Some(2));
    assert_eq!(row(&[(0.0, 1.0), (90.0, -1.0), (180.0, 1.0)]), Some(1));
    assert_eq!(row(&[(0.0, 1.0), (f64::NAN, 1.0), (180.0, 1.0)]), Some(1));
    assert_eq!(row(&[(0.0, f64::INFINITY), (180.0, 1.0)]), Some(0));
}

/// The fit against Mie theory, `tests/data/mie/mie_water.csv`, as the book states it: difference of
/// the mean cosines, and the median and the largest of |ln(fit / Mie)| over whole degrees.
#[test]
fn the_fit_is_as_far_from_mie_theory_as_the_book_says() {
    const STATED: [(f64, f64, f64, f64); 8] = [
        (0.1, 0.051, 0.093, 0.132),
        (0.5, 0.044, 0.208, 1.141),
        (1.0, -0.016, 0.183, 0.781),
        (2.0, 0.032, 0.154, 0.666),
        (5.0, 0.013, 0.178, 1.179),
        (10.0, 0.012, 0.135, 1.393),
        (20.0, 0.013, 0.174, 1.614),
        (50.0, 0.015, 0.168, 1.952),
    ];
    let text = include_str!("../../../../tests/data/mie/mie_water.csv");
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut row = || -> Option<(String, Vec<f64>)> {
        let (name, rest) = lines.next()?.split_once(',')?;
        Some((name.to_owned(), rest.split(',').map(|v| v.parse().unwrap()).collect()))
    };
    let (_, diameters) = row().unwrap();
    let (_, mean_cosines) = row().unwrap();
    let rows: Vec<(f64, Vec<f64>)> =
        std::iter::from_fn(row).map(|(angle, values)| (angle.parse().unwrap(), values)).collect();
    assert!(rows.len() > 180);
    for (i, diameter) in diameters.iter().enumerate() {
        let fit = MieFit::new(*diameter).unwrap().mixture().unwrap();
        let difference = f64::from(fit.mean_cosine()) - mean_cosines[i];
        let log = |(angle, values): &(f64, Vec<f64>)| {
            let x = 2.0 * (0.5 * angle).to_radians().sin().powi(2);
            (f64::from(fit.eval(Cosine::from_one_minus(x))) / values[i]).ln().abs()
        };
        let whole = rows.iter().filter(|row| row.0 == row.0.round());
        let mut errors: Vec<f64> = whole.map(log).collect();
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        let largest = errors[errors.len() - 1];
        let (expected_diameter, by, typical, most) = STATED[i];
        assert_eq!(*diameter, expected_diameter);
        for (found, stated) in [(difference, by), (median, typical), (largest, most)] {
            assert!((found - stated).abs() < 0.002, "{diameter}: {found}, stated {stated}");
        }
    }
}

#[test]
fn the_mean_cosine_comes_from_the_grid() {
    let tree = Tree::from_dense(0.0f32, [0; 3], [4, 1, 1], &[0.0, 1.0, 2.0, 3.0]);
    let to_index = DAffine3::from_scale(DVec3::splat(0.5));
    let grid = CosineGrid::new(&tree, 0.5, -0.5, to_index).unwrap();
    let g = |x: f64| grid.at_index(DVec3::new(x, 0.0, 0.0));
    for (x, expected) in [(0.0, -0.5), (2.0, 0.0), (3.0, 0.25), (4.0, 0.5), (6.0, MAX_G)] {
        assert!((g(x) - expected).abs() < 1e-6, "{x}: {}", g(x));
    }
    assert_eq!(g(100.0), -0.5);
    let phase = Phase::ByGrid(Arc::new(grid));
    assert!(
        (phase.at(|| DVec3::new(4.0, 0.0, 0.0), Vec3::Z, &mut Pcg32::new(0, 0)).mean_cosine()
            - 0.5)
            .abs()
            < 1e-6
    );
    assert!(CosineGrid::new(&tree, f32::NAN, 0.0, to_index).is_err());
    let broken = tree.map(|v| if v == 1.0 { f32::NAN } else { v });
    let grid = CosineGrid::new(&broken, 1.0, 0.25, DAffine3::IDENTITY).unwrap();
    assert!((grid.at_index(DVec3::X) - 0.25).abs() < 1e-6);
}
