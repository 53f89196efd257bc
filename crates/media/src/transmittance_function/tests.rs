//! Identities of all transmittance functions by quadrature, and their samplers against them.

use super::*;
use crate::Error;
use pileus_math::random::exponential;
use rand_pcg::Pcg32;

/// One of every kind, and some of the edges.
fn functions() -> Vec<TransmittanceFunction> {
    let power = |k| TransmittanceFunction::Power(Power::new(k).unwrap());
    let davis = |h, c| TransmittanceFunction::DavisWeinstein(DavisWeinstein::new(h, c).unwrap());
    let erlang = |n| TransmittanceFunction::Erlang(Erlang::new(n).unwrap());
    let component = |weight, rate, function| Component { weight, rate, function };
    let mixture = |components| TransmittanceFunction::Mixture(Mixture::new(components).unwrap());
    let table = |points: &[[f64; 2]]| TransmittanceFunction::Table(Table::new(points).unwrap());
    let sampled: Vec<[f64; 2]> =
        (0..40).map(|i| f64::from(i) * 0.1).map(|x| [x, (-x).exp()]).collect();
    vec![
        power(1.5),
        power(2.0),
        power(1e6),
        davis(0.75, 1.0),
        davis(1.0, 0.5),
        erlang(2),
        erlang(7),
        TransmittanceFunction::Linear(Linear),
        table(&sampled),
        table(&[[0.0, 1.0], [0.5, 0.6], [1.0, 0.3], [2.0, 0.0]]),
        table(&[[0.0, 1.0], [1.0, 0.0]]),
        mixture(vec![component(1.0, 1.0, None)]),
        mixture(vec![component(0.3, 0.2, None), component(0.7, 3.0, None)]),
        mixture(vec![component(0.5, 1.0, None), component(0.5, 2.0, Some(power(2.5)))]),
        mixture(vec![component(2.0, 1.0, None), component(1.0, 1.0, Some(erlang(3)))]),
        mixture(vec![
            component(0.5, 1.0, None),
            component(0.5, 1.0, Some(TransmittanceFunction::Linear(Linear))),
        ]),
    ]
}

/// Integral over [a, b] by Simpson's rule on many equal parts.
fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    let n = 4000;
    let h = (b - a) / f64::from(n);
    let term = |i: i32| {
        let weight = if i == 0 || i == n {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        };
        weight * f((a + h * f64::from(i)).max(1e-300))
    };
    (0..=n).map(term).sum::<f64>() * h / 3.0
}

/// `X_u(a) - X_u(b)` is the integral of `p_u`, the same of `X_c` and `p_c`; `p_u = X_c / l`;
/// survivals begin at one, fall, and end at zero; all to 1e-6.
#[test]
fn densities_are_the_slopes_of_survivals() {
    for function in functions() {
        let l = function.mean_free_path();
        for start in StartCorrelation::ALL {
            assert!((function.survival(start, 0.0) - 1.0).abs() < 1e-12, "{function} {start:?}");
            assert_eq!(function.survival(start, f64::INFINITY), 0.0, "{function} {start:?}");
            let mut before = 1.0;
            // Between these no table has a knot in the middle of an interval, and no transmittance
            // function an atom.
            let edges =
                [0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.999, 1.001, 1.5, 2.0, 3.0, 6.0];
            for pair in edges.windows(2) {
                let (a, b) = (pair[0], pair[1]);
                let fall = function.survival(start, a) - function.survival(start, b);
                let mean = integral(|tau| function.density(start, tau), a, b);
                let atom = function.has_atom(start) && (a < 1.0 && b > 1.0 || b >= 2.0 && a < 2.0);
                // Kinks inside an interval cost Simpson's rule its order.
                assert!(
                    atom || (fall - mean).abs() < 5e-4 * (b - a),
                    "{function} {start:?} {a}..{b}: {fall} {mean}"
                );
                let here = function.survival(start, a);
                assert!(here <= before + 1e-12, "{function} {start:?} rises at {a}");
                before = here;
            }
        }
        for tau in [1e-3, 0.03, 0.31, 0.77, 1.9, 4.2] {
            let (p_u, x_c) = (
                function.density(StartCorrelation::Uncorrelated, tau),
                function.survival(StartCorrelation::Correlated, tau),
            );
            assert!((p_u * l - x_c).abs() < 1e-9, "{function}: p_u {p_u}, X_c {x_c} at {tau}");
        }
    }
}

/// The integral of `X_c` is the mean free path, that of `p_u` is one: for transmittance functions
/// whose tails end soon enough to be summed.
#[test]
fn densities_are_normalised() {
    for function in functions() {
        // Geometric panels to the end.
        let (mut mean, mut all, mut a) = (0.0, 0.0, 0.0);
        for i in 0..90 {
            let b = 0.02 * 1.3f64.powi(i);
            mean += integral(|tau| function.survival(StartCorrelation::Correlated, tau), a, b);
            all += integral(|tau| function.density(StartCorrelation::Uncorrelated, tau), a, b);
            a = b;
        }
        let rest = function.survival(StartCorrelation::Uncorrelated, a);
        assert!((all + rest - 1.0).abs() < 1e-3, "{function}: {all} and {rest}");
        let l = function.mean_free_path();
        assert!((mean + rest * l - l).abs() < 1e-3 * l, "{function}: {mean} is not {l}");
    }
}

/// `depth` is the inverse of the survival.
#[test]
fn depths_are_inverses() {
    for function in functions() {
        for start in StartCorrelation::ALL {
            if function.has_atom(start) {
                continue;
            }
            for drawn in [1e-6, 1e-3, 0.05, 0.5, 0.9, 2.0, 7.0, 20.0] {
                let tau = function.depth(start, drawn);
                let back = function.survival(start, tau);
                let error = (back.ln() + drawn).abs();
                // A table to zero ends where rounding begins.
                assert!(
                    error < 1e-6 * (1.0 + drawn) || back < 1e-8,
                    "{function} {start:?}: {drawn} gives {tau}, back {back}"
                );
            }
        }
    }
}

/// Histograms of drawn depths, and of depths that mixtures reach by a drawn rate, against the
/// survival. Null hypothesis: they are equal; chi-square on 19 degrees of freedom below 82, false
/// alarm 1e-9 each, 6e-8 in all. Atoms are in the bins.
#[test]
fn flights_follow_the_transmittance_function() {
    let mut rng = Pcg32::new(20_261_125, 9);
    let n = 40_000;
    for function in functions() {
        for start in StartCorrelation::ALL {
            // Edges of equal probability where there is no atom.
            let edges: Vec<f64> = (1..20)
                .map(|i| function.depth(start, -(1.0 - f64::from(i) / 20.0).ln()))
                .map(|edge| edge * (1.0 + 1e-9))
                .collect();
            let survivals: Vec<f64> = std::iter::once(1.0)
                .chain(edges.iter().map(|edge| function.survival(start, *edge)))
                .chain([0.0])
                .collect();
            let mut check = |what: &str, mut draw: Box<dyn FnMut(&mut Pcg32) -> f64 + '_>| {
                let mut counts = [0.0; 20];
                for _ in 0..n {
                    let tau = draw(&mut rng);
                    counts[edges.partition_point(|edge| *edge < tau)] += 1.0;
                }
                let mut chi2 = 0.0;
                for (count, pair) in counts.iter().zip(survivals.windows(2)) {
                    let expected = f64::from(n) * (pair[0] - pair[1]);
                    if expected > 0.5 {
                        chi2 += (count - expected).powi(2) / expected;
                    } else {
                        assert!(
                            *count < 12.0,
                            "{function} {start:?} {what}: {count} for {expected}"
                        );
                    }
                }
                assert!(chi2 < 82.0, "{function} {start:?} {what}: chi2 {chi2}");
            };
            check("by depth", Box::new(|rng| function.depth(start, f64::from(exponential(rng)))));
            if function.is_mixture_of_exponentials() {
                check(
                    "by rate",
                    Box::new(|rng| {
                        let rate = function.rate(start, rng).unwrap();
                        f64::from(exponential(rng)) / f64::from(rate)
                    }),
                );
            }
        }
    }
}

#[test]
fn known_values() {
    let erlang = TransmittanceFunction::Erlang(Erlang::new(2).unwrap());
    let tau = 0.7f64;
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    close(erlang.survival(StartCorrelation::Uncorrelated, tau), (-2.0 * tau).exp() * (1.0 + tau));
    close(erlang.density(StartCorrelation::Correlated, tau), 4.0 * tau * (-2.0 * tau).exp());
    let davis = TransmittanceFunction::DavisWeinstein(DavisWeinstein::new(1.0, 0.5).unwrap());
    let power = TransmittanceFunction::Power(Power::new(4.0).unwrap());
    for start in StartCorrelation::ALL {
        close(davis.survival(start, tau), power.survival(start, tau));
        close(davis.density(start, tau), power.density(start, tau));
    }
    // A table of two rows is the linear transmittance.
    let table = TransmittanceFunction::Table(Table::parse("# tau, T\n0 1\n\n1,0 # end\n").unwrap());
    for start in StartCorrelation::ALL {
        close(
            table.survival(start, tau),
            TransmittanceFunction::Linear(Linear).survival(start, tau),
        );
        close(table.depth(start, 0.3), TransmittanceFunction::Linear(Linear).depth(start, 0.3));
        assert_eq!(table.has_atom(start), TransmittanceFunction::Linear(Linear).has_atom(start));
    }
    // Points of the table are met.
    let points = [[0.0, 1.0], [0.5, 0.6], [1.0, 0.3], [2.0, 0.05]];
    let table = TransmittanceFunction::Table(Table::new(&points).unwrap());
    for [tau, transmittance] in points {
        close(table.survival(StartCorrelation::Uncorrelated, tau), transmittance);
    }
}

#[test]
fn what_is_no_transmittance_function_is_refused() {
    let what = |error: Error| error.to_string();
    for k in [1.0, 0.5, -2.0, f64::NAN, f64::INFINITY] {
        assert!(what(Power::new(k).unwrap_err()).contains("above 1"));
    }
    for (h, c) in [(0.5, 1.0), (1.1, 1.0), (f64::NAN, 1.0), (0.8, 0.0), (0.8, -1.0), (1.0, 1.0)] {
        assert!(what(DavisWeinstein::new(h, c).unwrap_err()).contains("above 0"));
    }
    assert!(Erlang::new(1).is_err() && Erlang::new(65).is_err());
    let component = Component { weight: 1.0, rate: 1.0, function: None };
    assert!(Mixture::new(vec![]).is_err());
    assert!(Mixture::new(vec![Component { weight: 0.0, ..component.clone() }]).is_err());
    assert!(Mixture::new(vec![Component { rate: f64::NAN, ..component.clone() }]).is_err());
    let inner = TransmittanceFunction::Mixture(Mixture::new(vec![component.clone()]).unwrap());
    assert!(Mixture::new(vec![Component { function: Some(inner), ..component }]).is_err());
    for (text, said) in [
        ("", "0 rows"),
        ("0 1", "1 rows"),
        ("0 0.9\n1 0.1", "row 1"),
        ("0 1\n1 0.5\n1 0.2", "optical depth 1 after 1"),
        ("0 1\n1 0.5\n2 0.6", "transmittance 0.6 after 0.5"),
        ("0 1\n1 0\n2 -0.1", "transmittance -0.1 after 0"),
        ("0 1\n1 0\n2 0", "transmittance 0 after 0"),
        ("0 1\n1 0.9\n2 0.2", "bends down at optical depth 1"),
        ("0 1\n1 half", "line 2"),
        ("0 1\n1 0.5 3", "line 2"),
        ("0 1\nnan 0.5", "optical depth NaN"),
        ("0 1\n1 inf", "transmittance inf"),
        ("0 1\n1e-300 0.5\n2e-300 0.1\n3e-300 1e-300", "row"),
    ] {
        let error = what(Table::parse(text).unwrap_err());
        assert!(error.contains(said), "{text:?}: {error}");
    }
}
