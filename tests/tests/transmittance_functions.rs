//! Non-exponential media: rays against the transmittance function, pictures against closed forms,
//! quadrature and the exponential kernel.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_integrator::{Events, Parameter, Plan, RenderSettings};
use pileus_lab::experiment::classed_rays;
use pileus_lab::{Profile, ProfileCase};
use pileus_media::Bounds3;
use pileus_media::distance::{DistanceSampler, Flight, regular_flight_non_exponential};
use pileus_media::method::name_or_auto;
use pileus_media::phase::ISOTROPIC;
use pileus_media::random::{exponential, uniform};
use pileus_media::transmittance::{
    DebiasingSeries, Estimator, debiased_non_exponential, exact_non_exponential, optical_depth,
};
use pileus_media::transmittance_function::{
    Component, DavisWeinstein, Erlang, Linear, Mixture, Passage, Power, StartCorrelation, Table,
    TransmittanceFunction,
};
use pileus_media::{ChromaticRatio, ExactField, Grey, Medium, Phase, Scaled, Tally};
use pileus_scene::EnvironmentImage;
use pileus_tests::*;
use rand_pcg::Pcg32;
use std::sync::Arc;

const EYE: DVec3 = DVec3::new(3.0, 2.0, 4.0);

fn power(k: f64) -> TransmittanceFunction {
    TransmittanceFunction::Power(Power::new(k).unwrap())
}

fn erlang(n: u32) -> TransmittanceFunction {
    TransmittanceFunction::Erlang(Erlang::new(n).unwrap())
}

/// The exponential transmittance as a mixture of one.
fn exponential_function() -> TransmittanceFunction {
    let component = Component { weight: 1.0, rate: 1.0, function: None };
    TransmittanceFunction::Mixture(Mixture::new(vec![component]).unwrap())
}

fn functions() -> Vec<TransmittanceFunction> {
    let component = |weight, rate, function| Component { weight, rate, function };
    let points = [[0.0, 1.0], [0.4, 0.62], [1.0, 0.3], [2.0, 0.09], [3.0, 0.02]];
    vec![
        power(2.0),
        TransmittanceFunction::DavisWeinstein(DavisWeinstein::new(0.75, 1.0).unwrap()),
        erlang(3),
        TransmittanceFunction::Linear(Linear),
        TransmittanceFunction::Table(Table::new(&points).unwrap()),
        TransmittanceFunction::Mixture(
            Mixture::new(vec![component(0.5, 0.5, None), component(0.5, 2.0, Some(power(3.0)))])
                .unwrap(),
        ),
    ]
}

fn under(medium: Medium, function: &TransmittanceFunction) -> Medium {
    medium.with_transmittance_function(Some(Arc::new(function.clone())))
}

fn profile(profile: Profile, majorant: f64, minorant: f64) -> ProfileCase {
    ProfileCase {
        name: String::new(),
        profile,
        length: 1.0,
        majorant,
        minorant,
        use_majorant: Some(1.3 * majorant),
    }
}

/// Where a flight by `fly` ends, against the transmittance function: eight parts of equal
/// probability before the end, and the escape. The chi-square statistic and its degrees of freedom.
fn histogram<F: ExactField>(
    passage: Passage<'_>,
    field: impl Fn() -> F,
    mut fly: impl FnMut(F) -> Flight,
) -> (f64, usize) {
    const PARTS: usize = 8;
    let n = 20_000;
    let escape = passage.survival(field().optical_depth(&mut Tally::default()));
    let edges: Vec<f32> = (1..PARTS)
        .map(|k| {
            let depth = passage.depth(-(1.0 - k as f64 / PARTS as f64 * (1.0 - escape)).ln());
            field().t_at_depth(depth, &mut Tally::default()).unwrap_or(f32::INFINITY)
        })
        .collect();
    let mut counts = [0.0f64; PARTS + 1];
    for _ in 0..n {
        match fly(field()) {
            Flight::Collision(t) => counts[edges.iter().filter(|edge| t > **edge).count()] += 1.0,
            Flight::Escape => counts[PARTS] += 1.0,
        }
    }
    if passage.has_atom() {
        // All collisions in one place: the number alone.
        let collided: f64 = counts[..PARTS].iter().sum();
        counts = [0.0; PARTS + 1];
        (counts[0], counts[PARTS]) = (collided, f64::from(n) - collided);
    }
    let (mut chi2, mut dof) = (0.0, 0);
    for (part, count) in counts.iter().enumerate() {
        let share = match (part == PARTS, passage.has_atom()) {
            (true, _) => escape,
            (false, false) => (1.0 - escape) / PARTS as f64,
            (false, true) => (1.0 - escape) * f64::from(u8::from(part == 0)),
        };
        let expected = f64::from(n) * share;
        if expected > 5.0 {
            chi2 += (count - expected).powi(2) / expected;
            dof += 1;
        } else {
            assert!(*count < 25.0, "{count} where {expected} are expected");
        }
    }
    (chi2, dof)
}

/// All that is said of one ray under one transmittance function.
fn check_ray<F: ExactField>(
    what: &str,
    function: &TransmittanceFunction,
    field: impl Fn() -> F,
    worst: &mut [f64; 2],
) {
    let mut rng = Pcg32::new(20_261_125, 7);
    let mut tally = Tally::default();
    for start in StartCorrelation::ALL {
        let passage = Passage { function, start };
        let depth = field().optical_depth(&mut tally);
        let exact = passage.survival(depth);
        assert_eq!(exact_non_exponential(&field(), passage, Grey, &mut tally), exact as f32);
        // Null hypothesis: flights follow the transmittance function. Chi-square on at most 8
        // degrees of freedom below 58: false alarm 1e-9 each, some 1e-7 in all.
        let by_depth = histogram(passage, &field, |field| {
            let drawn = exponential(&mut rng);
            let mut own = Pcg32::new(1, 1);
            regular_flight_non_exponential(&field, passage, Grey, 1.0, drawn, &mut own, &mut tally)
                .flight
        });
        assert!(by_depth.0 < 58.0, "{what} {function} {start:?}: chi2 {by_depth:?}");
        worst[0] = worst[0].max(by_depth.0);
        if function.is_mixture_of_exponentials() {
            for sampler in [DistanceSampler::Delta, DistanceSampler::Decomposition] {
                let by_rate = histogram(passage, &field, |field| {
                    let rate = passage.rate(&mut rng).unwrap();
                    let field = Scaled::new(field, rate);
                    sampler.fly(field, Grey, 1.0, None, &mut rng, &mut tally).flight
                });
                assert!(
                    by_rate.0 < 58.0,
                    "{what} {function} {start:?} {sampler:?}: chi2 {by_rate:?}"
                );
                worst[0] = worst[0].max(by_rate.0);
            }
        }
        // Null hypothesis: the mean is the transmittance function's survival. |z| < 6.5, some
        // hundred means: false alarm 1e-8 under the normal law.
        let mut check = |name: &str, n: u32, estimate: &mut dyn FnMut(&mut Pcg32) -> f32| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..n {
                let x = f64::from(estimate(&mut rng));
                sum += x;
                squares += x * x;
            }
            let mean = sum / f64::from(n);
            let error = ((squares / f64::from(n) - mean * mean).max(0.0) / f64::from(n)).sqrt();
            let z = ((mean - exact).abs() - 1e-6).max(0.0) / error.max(1e-12);
            assert!(z < 6.5, "{what} {function} {start:?} {name}: {mean} is not {exact}, z {z:.2}");
            worst[1] = worst[1].max(z);
        };
        let mut events = Tally::default();
        // Where the transmittance function has a kink or a jump the differences fall too slowly for
        // a normal mean.
        if !function.has_atom(StartCorrelation::Correlated) {
            check("debiased", 20_000, &mut |rng| {
                let series = DebiasingSeries::default();
                debiased_non_exponential(field(), passage, Grey, series, rng, &mut events)
            });
        }
        if function.is_mixture_of_exponentials() {
            for estimator in [Estimator::Ratio, Estimator::ResidualRatio, Estimator::Regular] {
                check(estimator.name(), 20_000, &mut |rng| {
                    let field = Scaled::new(field(), passage.rate(rng).unwrap());
                    estimator.estimate(field, Grey, 0.0, rng, &mut events)
                });
            }
        }
        assert_eq!(events.violations + tally.violations, 0);
    }
}

#[test]
fn rays_follow_the_transmittance_function() {
    let constant = profile(Profile::Constant { value: 1.4 }, 1.4, 1.4);
    let ramp = profile(Profile::Linear { a: 0.2, b: 3.0 }, 3.2, 0.2);
    let plume = asset_medium("syn_plume.vdb", [30.0; 3], [1.0; 3], Phase::Isotropic);
    let rays = classed_rays(&plume, 1, 5);
    assert!(rays.len() >= 3, "{rays:?}");
    let mut worst = [0.0; 2];
    for function in functions() {
        check_ray("constant", &function, || constant.ray(), &mut worst);
        check_ray("ramp", &function, || ramp.ray(), &mut worst);
        for ray in &rays {
            let span = plume.span(ray.origin, ray.direction, f64::INFINITY).unwrap();
            let name = ray.class.name();
            check_ray(
                &format!("plume {name}"),
                &function,
                || plume.any_ray(&span, 1.0),
                &mut worst,
            );
        }
    }
    println!("largest chi2 {:.1}, |z| {:.2}", worst[0], worst[1]);
}

/// The probability that a flight from a place ends in an interval is the mean over the interval of
/// extinction times transmittance back, from a particle to that place, over the mean free path.
/// Null hypothesis: both are equal. |z| < 6: false alarm 2e-9 each.
#[test]
fn surface_and_scatterer_are_reciprocal() {
    let plume = asset_medium("syn_plume.vdb", [30.0; 3], [1.0; 3], Phase::Isotropic);
    let rays = classed_rays(&plume, 1, 5);
    let ray = rays.into_iter().max_by(|a, b| a.optical_depth.total_cmp(&b.optical_depth)).unwrap();
    let (origin, direction) = (ray.origin, ray.direction);
    let span = plume.span(origin, direction, f64::INFINITY).unwrap();
    let mut tally = Tally::default();
    let mut rng = Pcg32::new(20_261_125, 8);
    let depth = plume.any_ray(&span, 1.0).optical_depth(&mut tally);
    let at = |tau: f64| plume.any_ray(&span, 1.0).t_at_depth(tau, &mut Tally::default());
    let (a, b) = (at(0.2).unwrap(), at(0.8).unwrap());
    println!("depth {depth:.3}, interval {a} to {b} of {}", span.length);
    let table = Table::new(&[[0.0, 1.0], [0.2, 0.55], [0.5, 0.3], [1.0, 0.1], [2.0, 0.01]]);
    for function in functions().into_iter().chain([TransmittanceFunction::Table(table.unwrap())]) {
        let n = 40_000;
        let l = function.mean_free_path();
        let from_place = Passage { function: &function, start: StartCorrelation::Uncorrelated };
        let (mut forth, mut back, mut back_squares) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let field = plume.any_ray(&span, 1.0);
            let flight = if let Some(rate) = from_place.rate(&mut rng) {
                let field = Scaled::new(field, rate);
                DistanceSampler::Delta.fly(field, Grey, 1.0, None, &mut rng, &mut tally).flight
            } else {
                let drawn = exponential(&mut rng);
                regular_flight_non_exponential(
                    &field, from_place, Grey, 1.0, drawn, &mut rng, &mut tally,
                )
                .flight
            };
            if matches!(flight, Flight::Collision(t) if t > a && t < b) {
                forth += 1.0;
            }
            let t = span.t_enter + f64::from(a + (b - a) * uniform(&mut rng));
            let p = origin + direction.as_dvec3() * t;
            let home = plume.span(p, -direction, t).unwrap();
            let from_particle =
                Passage { function: &function, start: StartCorrelation::Correlated };
            let series = DebiasingSeries::default();
            let through = if function.has_atom(StartCorrelation::Correlated) {
                exact_non_exponential(&plume.any_ray(&home, 1.0), from_particle, Grey, &mut tally)
            } else {
                let field = plume.any_ray(&home, 1.0);
                debiased_non_exponential(field, from_particle, Grey, series, &mut rng, &mut tally)
            };
            let x = plume.sigma_t_at(p) * f64::from(through) * f64::from(b - a) / l;
            back += x;
            back_squares += x * x;
        }
        let n = f64::from(n);
        let (forth, back) = (forth / n, back / n);
        let error = (forth * (1.0 - forth) / n + (back_squares / n - back * back) / n).sqrt();
        let z = (forth - back) / error;
        println!("{function}: {forth:.5} there, {back:.5} back, z {z:.2}");
        assert!(z.abs() < 6.0, "{function}: {forth} there, {back} back, z {z}");
        assert!(error < 5e-3 && forth > 0.02, "the test is too weak: {error}");
    }
}

/// Channels share one flight: per channel, what collides and what escapes follows the transmittance
/// function of its own depth. |z| < 6 on 6 means a transmittance function: false alarm 1e-7.
#[test]
fn channels_follow_their_own_depths() {
    let ramp = profile(Profile::Linear { a: 0.2, b: 3.0 }, 3.2, 0.2);
    let relative = Vec3::new(1.0, 0.4, 0.0);
    let mut rng = Pcg32::new(20_261_125, 10);
    let mut tally = Tally::default();
    for function in functions() {
        for start in StartCorrelation::ALL {
            let passage = Passage { function: &function, start };
            let n = 40_000;
            let beta = Vec3::new(0.7, 1.0, 0.4);
            let mut sums = [[DVec3::ZERO; 2]; 3];
            for _ in 0..n {
                let drawn = exponential(&mut rng);
                let channels = ChromaticRatio(relative);
                let flown = regular_flight_non_exponential(
                    &ramp.ray(),
                    passage,
                    channels,
                    beta,
                    drawn,
                    &mut rng,
                    &mut tally,
                );
                let part = match flown.flight {
                    Flight::Escape => 2,
                    Flight::Collision(t) => usize::from(t > 0.6),
                };
                let x = flown.weight.as_dvec3();
                assert!((flown.weight * beta).element_sum() < 3.01 * beta.element_sum());
                sums[part][0] += x;
                sums[part][1] += x * x;
            }
            for c in 0..3 {
                let r = f64::from(relative[c]);
                let to = |t: f64| {
                    if r > 0.0 { passage.survival(r * ramp.profile.optical_depth(t)) } else { 1.0 }
                };
                let exact = [1.0 - to(0.6), to(0.6) - to(1.0), to(1.0)];
                for (part, exact) in exact.into_iter().enumerate() {
                    let n = f64::from(n);
                    let (mean, square) = (sums[part][0][c] / n, sums[part][1][c] / n);
                    let error = ((square - mean * mean).max(0.0) / n).sqrt();
                    let z = ((mean - exact).abs() - 1e-5).max(0.0) / error.max(1e-7);
                    assert!(z < 6.0, "{function} {start:?} {c} {part}: {mean} {exact} z {z:.2}");
                }
            }
        }
    }
}

fn by_name(
    distance: Option<DistanceSampler>,
    transmittance: Option<Estimator>,
    base: RenderSettings,
) -> RenderSettings {
    RenderSettings { distance, transmittance, ..base }
}

/// Two half skies add up to a furnace: flights between collisions, shadow rays from collisions and
/// their weights must conserve energy together. Null hypothesis: mean one;
/// |z| < 5.8, false alarm 7e-9 each.
#[test]
fn white_furnace_under_every_transmittance_function() {
    for (k, function) in functions().into_iter().enumerate() {
        let extinctions: &[[f32; 3]] =
            if k % 2 == 0 { &[[4.0; 3], [4.0, 1.0, 0.5]] } else { &[[4.0; 3]] };
        for extinction in extinctions {
            let (mut total, mut variance, mut n) = (0.0, 0.0, 0.0);
            for half in [false, true] {
                let medium =
                    under(lumpy_grid(1.0, *extinction, [1.0; 3], Phase::Isotropic), &function);
                let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
                let texels: Vec<[f32; 3]> = (0..64 * 32)
                    .map(|i| if (i % 64 < 32) == half { [1.0; 3] } else { [0.0; 3] })
                    .collect();
                let image = EnvironmentImage::new(64, 32, texels, 1.0, 0.0).unwrap();
                scene.environment.image = Some(Arc::new(image));
                let result = rendered(&scene, &settings(24, 41 + k as u64));
                assert!(result.counters.shadow_rays > 0);
                n = 0.0;
                for c in ["R", "G", "B"] {
                    let plane = result.image.channel(c).unwrap();
                    total += plane.iter().map(|v| f64::from(*v)).sum::<f64>();
                    let var = result.variance.channel(c).unwrap();
                    variance += var.iter().map(|v| f64::from(*v)).sum::<f64>();
                    n += plane.len() as f64;
                }
            }
            // Channels of one path are correlated: the sum of variances is at most tripled.
            let (mean, error) = (total / n, (3.0 * variance).sqrt() / n);
            let z = (mean - 1.0) / error;
            println!("{function} {extinction:?}: mean {mean:.5}, z {z:.2}, error {error:.1e}");
            assert!(z.abs() < 5.8, "{function} {extinction:?}: mean {mean}, z {z}");
            assert!(error < 4e-3, "the test is too weak: standard error {error}");
        }
    }
}

/// The exponential transmittance, forced through the kernel of transmittance functions by every way
/// it has, is the plain kernel.
#[test]
fn the_exponential_function_is_the_kernel_without_functions() {
    for extinction in [[3.0; 3], [3.0, 1.0, 0.2]] {
        let make = |function: Option<TransmittanceFunction>| {
            let medium =
                lumpy_grid(1.0, extinction, [0.95, 0.8, 0.5], Phase::henyey_greenstein(0.5));
            let medium = medium.with_transmittance_function(function.map(Arc::new));
            let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
            scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(3.0, 2.0, 1.0), 8.0));
            scene.environment.constant = Vec3::new(0.1, 0.2, 0.3);
            scene
        };
        let plain = rendered(&make(None), &settings(64, 1));
        for (k, (distance, transmittance)) in [
            (None, None),
            (Some(DistanceSampler::Regular), Some(Estimator::Regular)),
            (None, Some(Estimator::DebiasedRayMarching)),
        ]
        .into_iter()
        .enumerate()
        {
            let base = settings(64, 2 + k as u64);
            let other = by_name(distance, transmittance, base);
            // The choice of levels moves no mean.
            let other = RenderSettings { continuation_exponent: 1.5 + 0.25 * k as f64, ..other };
            let result = rendered(&make(Some(exponential_function())), &other);
            let what = format!(
                "{extinction:?} {} {}",
                name_or_auto(distance),
                name_or_auto(transmittance)
            );
            assert_same(&what, &plain, &result, 1.9e-3);
        }
    }
}

/// Pure absorption: the background times the transmittance function of the depth, for a slab of the
/// linear transmittance, for overlapping media of several transmittance functions and of none, and
/// per channel.
#[test]
fn absorption_is_the_transmittance_function() {
    for function in functions() {
        let medium = under(cube_grid(1.0, [0.5, 0.3, 0.0], [0.0; 3], Phase::Isotropic), &function);
        let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 16.0);
        scene.environment.constant = Vec3::ONE;
        let result = rendered(&scene, &point_filter(64, 3));
        assert_expected(&function.to_string(), &result, 4.2e-3, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let length = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b - a);
            [0.5, 0.3, 0.0]
                .map(|sigma_t| function.survival(StartCorrelation::Uncorrelated, sigma_t * length))
        });
    }
    let (a, b) = (power(2.0), erlang(3));
    let black = [0.0; 3];
    let media = vec![
        under(cube_grid(1.0, [0.4; 3], black, Phase::Isotropic), &a),
        under(cube_homogeneous(0.7, [0.5; 3], black, Phase::Isotropic), &b),
        cube_homogeneous(0.5, [0.3; 3], black, Phase::Isotropic),
        cube_grid(0.8, [0.2, 0.1, 0.2], black, Phase::Isotropic),
    ];
    let mut overlapping = scene(media, EYE, DVec3::ZERO, 16.0);
    overlapping.environment.constant = Vec3::ONE;
    let result = rendered(&overlapping, &point_filter(64, 4));
    assert_expected("overlapping", &result, 4.7e-3, |x, y| {
        let (o, d) = pixel_ray(&overlapping, x, y);
        let length = |half: f64| cube_span(o, d, half).map_or(0.0, |(a, b)| b - a);
        let functions = a.survival(StartCorrelation::Uncorrelated, 0.4 * length(1.0))
            * b.survival(StartCorrelation::Uncorrelated, 0.5 * length(0.7));
        [0.2, 0.1, 0.2].map(|own| functions * (-0.3 * length(0.5) - own * length(0.8)).exp())
    });
}

/// Single scattering of a sun in a cube: `p_u` to the collision, `X_c` from there to the sun, by
/// quadrature along each pixel's ray.
#[test]
fn single_scattering_is_quadrature() {
    let to_sun = Vec3::new(0.5, 0.8, -0.3).normalize();
    let sigma_t = 1.1f64;
    for function in functions() {
        for (distance, transmittance) in
            [(None, None), (Some(DistanceSampler::Regular), Some(Estimator::Regular))]
        {
            let cube = cube_grid(1.0, [sigma_t as f32; 3], [1.0; 3], Phase::Isotropic);
            let mut scene = scene(vec![under(cube, &function)], EYE, DVec3::ZERO, 16.0);
            scene.lights.push(sun(to_sun, Vec3::splat(4.0), 0.0));
            let base = RenderSettings { max_bounces: Some(1), ..point_filter(32, 5) };
            let result = rendered(&scene, &by_name(distance, transmittance, base));
            let what = format!("{function} {}", name_or_auto(distance));
            let power = if distance.is_some() { 1e-3 } else { 4.8e-3 };
            let expected = |x, y| {
                let (o, d) = pixel_ray(&scene, x, y);
                let Some((a, b)) = cube_span(o, d, 1.0) else { return [0.0; 3] };
                let n = 250;
                let h = (b - a) / f64::from(n);
                let sum: f64 = (0..n)
                    .map(|i| {
                        let s = (f64::from(i) + 0.5) * h;
                        let p = o + d * (a + s);
                        let (_, out) = cube_span(p, to_sun.as_dvec3(), 1.0).unwrap_or((0.0, 0.0));
                        function.density(StartCorrelation::Uncorrelated, sigma_t * s)
                            * function.survival(StartCorrelation::Correlated, sigma_t * out)
                    })
                    .sum();
                [sum * h * sigma_t * 4.0 * f64::from(ISOTROPIC); 3]
            };
            if !function.has_atom(StartCorrelation::Correlated) {
                assert_expected(&what, &result, power, expected);
                continue;
            }
            // Where all of a ray is lit, or none, such a transmittance function leaves no noise,
            // and the quadrature's own error shows: the whole picture within 6 standard errors and
            // a thousandth.
            let (mut truth, mut mean, mut variance) = (0.0, 0.0, 0.0);
            for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
                truth += expected(x, y)[0];
                mean += f64::from(result.image.get("R", x, y).unwrap());
                variance += f64::from(result.variance.get("R", x, y).unwrap());
            }
            println!("{what}: {mean:.3} for {truth:.3}, error {:.3}", variance.sqrt());
            let error = 6.0 * variance.sqrt() + 1e-3 * truth;
            assert!((mean - truth).abs() < error, "{what}: {mean} is not {truth}, {error}");
            assert!(error < 0.02 * truth, "the test is too weak");
        }
    }
}

/// A glowing cube: light from each point passes with `X_u` to the camera; points are counted up to
/// where flights end, or picked and estimated.
#[test]
fn fire_shines_through_the_transmittance_function() {
    for (function, extinction) in
        [(power(2.0), [1.2; 3]), (erlang(3), [1.2; 3]), (power(2.0), [1.2, 0.6, 0.1])]
    {
        let mut glowing = glowing_cube(1.0, extinction, [0.0; 3], [0.7, 0.5, 0.3]);
        glowing.medium = Arc::new(
            (*glowing.medium).clone().with_transmittance_function(Some(Arc::new(function.clone()))),
        );
        let mut scene = scene(vec![], EYE, DVec3::ZERO, 40.0);
        scene.volumes.push(glowing);
        let result = rendered(&scene, &point_filter(48, 6));
        assert_expected(&format!("{function} {extinction:?}"), &result, 3.5e-3, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let length = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b - a);
            let n = 400;
            let mut sums = [0.7, 0.5, 0.3];
            for (sum, sigma_t) in sums.iter_mut().zip(extinction) {
                let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * length * f64::from(sigma_t);
                let mean: f64 =
                    (0..n).map(|i| function.survival(StartCorrelation::Uncorrelated, at(i))).sum();
                *sum *= mean / f64::from(n) * length;
            }
            sums
        });
    }
}

/// In a medium that many scatterings cross, the power law lets more light through than the
/// exponential one and the Erlang transmittance less, in a ray and in a picture: the transmittance
/// functions are not mixed up.
#[test]
fn transmittance_functions_order_the_light_that_gets_through() {
    let depth = 3.0;
    let through =
        |function: &TransmittanceFunction| function.survival(StartCorrelation::Uncorrelated, depth);
    let (clustered, regular) = (power(1.5), erlang(8));
    assert!(through(&clustered) > 2.0 * (-depth).exp());
    assert!(through(&regular) < 0.5 * (-depth).exp());
    let mean = |function: Option<&TransmittanceFunction>| {
        let cube = cube_grid(1.0, [3.0; 3], [0.0; 3], Phase::Isotropic);
        let mut scene = scene(
            vec![cube.with_transmittance_function(function.cloned().map(Arc::new))],
            EYE,
            DVec3::ZERO,
            20.0,
        );
        scene.environment.constant = Vec3::ONE;
        let result = rendered(&scene, &settings(16, 8));
        result.image.channel("R").unwrap().iter().sum::<f32>() / 4096.0
    };
    let (more, plain, less) = (mean(Some(&clustered)), mean(None), mean(Some(&regular)));
    println!("power {more:.4}, exponential {plain:.4}, erlang {less:.4}");
    assert!(more > 1.3 * plain && less < 0.8 * plain);
}

#[test]
fn the_plan_says_what_it_does_and_refuses_what_assumes_the_exponential() {
    let scene_of = |function: Option<&TransmittanceFunction>| {
        let cube = cube_grid(1.0, [1.0; 3], [0.5; 3], Phase::Isotropic);
        scene(
            vec![cube.with_transmittance_function(function.cloned().map(Arc::new))],
            EYE,
            DVec3::ZERO,
            40.0,
        )
    };
    let plan = |settings| Plan::new(&scene_of(Some(&power(2.0))), &settings).unwrap().to_string();
    let debiased = Some(Estimator::DebiasedRayMarching);
    let asked = by_name(None, debiased, settings(1, 1));
    let chosen = RenderSettings { continuation_exponent: 2.5, ..asked.clone() };
    assert!(plan(asked).contains("series of exponent 1.5"));
    assert!(plan(chosen).contains("series of exponent 2.5"));
    let plain = Plan::new(&scene_of(None), &settings(1, 1)).unwrap();
    assert_eq!(plain.kernel.events, Events::OneGrid);
    for function in functions() {
        let scene = scene_of(Some(&function));
        let plan = Plan::new(&scene, &settings(1, 1)).unwrap();
        assert_eq!(plan.kernel.events, Events::MergedList);
        let text = plan.to_string();
        assert!(text.contains(&format!("has the transmittance function {function}")), "{text}");
        assert_eq!(text.contains("a drawn rate"), function.is_mixture_of_exponentials(), "{text}");
        for sampler in DistanceSampler::ALL {
            let asked = by_name(Some(sampler), None, settings(1, 1));
            let holds = sampler == DistanceSampler::Regular
                || function.is_mixture_of_exponentials()
                    && sampler.is_unbiased()
                    && sampler.is_one_flight()
                    && sampler != DistanceSampler::Analytic
                || sampler == DistanceSampler::Split;
            let plan = Plan::new(&scene, &asked);
            assert_eq!(plan.is_ok(), holds, "{function} {sampler:?}");
            if let Err(error) = plan
                && sampler != DistanceSampler::Analytic
            {
                assert_eq!(error.parameter(), Some(Parameter::Distance), "{error}");
                assert!(error.to_string().contains("exponential"), "{error}");
            }
        }
        for estimator in Estimator::ALL {
            let asked = by_name(None, Some(estimator), settings(1, 1));
            let holds = matches!(estimator, Estimator::Regular | Estimator::DebiasedRayMarching)
                || function.is_mixture_of_exponentials() && estimator.is_unbiased();
            let plan = Plan::new(&scene, &asked);
            assert_eq!(plan.is_ok(), holds, "{function} {estimator:?}");
            if let Err(error) = plan {
                assert_eq!(error.parameter(), Some(Parameter::Transmittance), "{error}");
                assert!(error.to_string().contains("exponential"), "{error}");
            }
        }
        let points = by_name(Some(DistanceSampler::Equiangular), None, settings(1, 1));
        let error = Plan::new(&scene, &points).unwrap_err();
        assert_eq!(error.parameter(), Some(Parameter::Distance), "{error}");
        let says = format!("volume `volume 0` has another ({function})");
        assert!(error.to_string().contains(&says), "{error}");
    }
}

/// The depth of the ray that a picture's pixel sees, for the record that assets go through the same
/// code: an asset under a transmittance function absorbs as the transmittance function says.
#[test]
fn an_asset_absorbs_by_its_transmittance_function() {
    let function = power(2.0);
    let medium = asset_medium("syn_plume.vdb", [60.0; 3], [0.0; 3], Phase::Isotropic);
    let Bounds3 { low, high } = medium.bounds_world().unwrap();
    let middle = 0.5 * (low + high);
    let mut plume =
        scene(vec![under(medium, &function)], middle + DVec3::new(2.0, 1.0, 3.0), middle, 14.0);
    plume.environment.constant = Vec3::ONE;
    let result = rendered(&plume, &point_filter(1024, 4));
    let medium = &plume.volumes[0].medium;
    assert_expected("plume", &result, 1.9e-4, |x, y| {
        let (o, d) = pixel_ray(&plume, x, y);
        let tau = optical_depth(medium, o, d, 0.0, 100.0, &mut Tally::default());
        [function.survival(StartCorrelation::Uncorrelated, tau); 3]
    });
}

/// A white medium in a closed box of area lights that emit what they absorb: radiance is one
/// everywhere. Shadow rays from surfaces and from particles, flights from both and their weights
/// must agree.
#[test]
fn a_box_of_lamps_is_in_equilibrium() {
    let mut walls = cube(1.5);
    // Fronts inwards.
    for triangle in &mut walls {
        triangle.swap(1, 2);
    }
    let reflected = [0.6f32, 0.5, 0.4];
    let meshes = [(walls, area_light(reflected, reflected.map(|r| 1.0 - r)))];
    for (k, function) in functions().into_iter().enumerate() {
        let extinction = if k % 2 == 0 { [1.5; 3] } else { [2.0, 1.0, 0.4] };
        let medium = under(lumpy_grid(1.0, extinction, [1.0; 3], Phase::Isotropic), &function);
        let mut scene = scene(vec![medium], DVec3::new(1.2, 0.9, 1.3), DVec3::ZERO, 60.0);
        scene.surfaces = Some(surfaces(&meshes));
        let image = rendered(&scene, &settings(16, 60 + k as u64));
        assert_one(&format!("{function} {extinction:?}"), &image, 1e-4, 5e-3);
    }
}

/// A white floor below a cube of smoke, the sun above: light reaches the floor by `X_u`, and the
/// camera sees the floor past the smoke.
#[test]
fn a_floor_is_shaded_by_the_transmittance_function() {
    let to_sun = Vec3::new(0.3, 1.0, 0.2).normalize();
    let floor = quad([-4.0, -1.5, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0]);
    for function in functions() {
        let smoke = under(cube_grid(1.0, [0.6, 0.3, 0.1], [0.0; 3], Phase::Isotropic), &function);
        let mut scene =
            scene(vec![smoke], DVec3::new(0.0, 1.0, 4.5), DVec3::new(0.0, -1.5, 0.0), 50.0);
        scene.surfaces = Some(surfaces(&[(floor.clone(), lambert([0.8; 3]))]));
        scene.lights.push(sun(to_sun, Vec3::splat(2.0), 0.0));
        // Samples enough for blocks in which one pixel alone sees an edge of the smoke.
        // Channels that are coupled: one that flies by itself may lose no sample at all at an edge,
        // and its variance is not known then.
        let distance = function.is_mixture_of_exponentials().then_some(DistanceSampler::Spectral);
        let base = RenderSettings { max_bounces: Some(1), distance, ..point_filter(256, 7) };
        let image = rendered(&scene, &base);
        assert_expected(&function.to_string(), &image, 4.6e-4, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let t = (-1.5 - o.y) / d.y;
            let p = o + d * t;
            if !(t > 0.0 && p.x.abs() < 4.0 && p.z.abs() < 4.0) {
                return [0.0; 3];
            }
            let seen = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b.min(t) - a.min(t));
            let lit = cube_span(p, to_sun.as_dvec3(), 1.0).map_or(0.0, |(a, b)| b - a);
            let reflected = 0.8 / std::f64::consts::PI * 2.0 * f64::from(to_sun.y);
            [0.6, 0.3, 0.1].map(|sigma_t| {
                let through =
                    |length| function.survival(StartCorrelation::Uncorrelated, sigma_t * length);
                reflected * through(seen) * through(lit)
            })
        });
    }
}
