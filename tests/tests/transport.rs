//! Light transport against closed forms, quadrature and itself.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_film::Film;
use pileus_integrator::{
    LightSampling, Parameter, Plan, RenderSettings, Renderer, ShadowRoulette, Unmonitored,
};
use pileus_media::Bounds3;
use pileus_media::distance::DistanceSampler;
use pileus_media::phase::ISOTROPIC;
use pileus_media::transmittance::Estimator;
use pileus_media::{Medium, Phase, random::uniform};
use pileus_scene::{Environment, EnvironmentImage, Light, Point, Spot};
use pileus_tests::*;
use rand_pcg::Pcg32;
use std::sync::Arc;

const EYE: DVec3 = DVec3::new(3.0, 2.0, 4.0);

fn hg(g: f32) -> Phase {
    Phase::henyey_greenstein(g)
}

/// Albedo one inside uniform light: radiance one everywhere, whatever the density and g. Constant
/// light is met by escaping paths alone, so that every single sample is one.
#[test]
fn white_furnace_is_exact_in_constant_light() {
    for g in [-0.9, 0.0, 0.9] {
        for sigma_t in [0.01f32, 1.0, 30.0] {
            for medium in [
                cube_grid(1.0, [sigma_t; 3], [1.0; 3], hg(g)),
                asset_medium("syn_plume.vdb", [sigma_t * 10.0; 3], [1.0; 3], hg(g)),
            ] {
                let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
                scene.environment.constant = Vec3::ONE;
                let result = rendered(&scene, &settings(8, 1));
                for c in ["R", "G", "B"] {
                    let plane = result.image.channel(c).unwrap();
                    assert!(
                        plane.iter().all(|v| (v - 1.0).abs() < 1e-6),
                        "g {g} sigma_t {sigma_t}"
                    );
                }
                assert!(result.counters.bounces > 0);
            }
        }
    }
}

/// An image that is one on half of the sphere and its complement: their sum is a furnace in which
/// every technique and every weight has a part. Chromatic extinction must not matter either.
#[test]
fn white_furnace_of_two_half_skies_with_all_techniques() {
    for (k, g) in [-0.9, 0.0, 0.9].into_iter().enumerate() {
        for extinction in [[4.0; 3], [0.0, 4.0, 1.0]] {
            let mut total: Vec<f64> = Vec::new();
            let mut variance: Vec<f64> = Vec::new();
            for half in [false, true] {
                let medium = lumpy_grid(1.0, extinction, [1.0; 3], hg(g));
                let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
                let texels: Vec<[f32; 3]> = (0..64 * 32)
                    .map(|i| if (i % 64 < 32) == half { [1.0; 3] } else { [0.0; 3] })
                    .collect();
                let image = EnvironmentImage::new(64, 32, texels, 1.0, 0.0).unwrap();
                scene.environment.image = Some(Arc::new(image));
                let result = rendered(&scene, &settings(256, 31 + k as u64));
                assert!(result.counters.shadow_rays > 0);
                assert!(result.counters.null_collisions > result.counters.collisions);
                for c in ["R", "G", "B"] {
                    let mean = result.image.channel(c).unwrap();
                    let var = result.variance.channel(c).unwrap();
                    total.resize(3 * mean.len(), 0.0);
                    variance.resize(3 * mean.len(), 0.0);
                    let offset = ["R", "G", "B"].iter().position(|n| *n == c).unwrap() * mean.len();
                    for i in 0..mean.len() {
                        total[offset + i] += f64::from(mean[i]);
                        variance[offset + i] += f64::from(var[i]);
                    }
                }
            }
            let n = total.len() as f64;
            let mean = total.iter().sum::<f64>() / n;
            let error = variance.iter().sum::<f64>().sqrt() / n;
            // Null hypothesis: mean one. False alarm 6e-9 per case.
            let z = (mean - 1.0) / error;
            println!("g {g} extinction {extinction:?}: mean {mean:.6}, z {z:.2}");
            assert!(z.abs() < 5.8, "g {g} extinction {extinction:?}: mean {mean}, z {z}");
            assert!(error < 2e-3, "the test is too weak: standard error {error}");
        }
    }
}

/// Pure absorption: background times `exp(-tau)`, for a cube in closed form and for an asset by its
/// exact optical depth.
#[test]
fn absorption_is_beer_lambert() {
    // Grey, and with channels that part.
    for (sigma_t, spp) in [([1.3f32; 3], 256), ([1.3, 0.5, 0.2], 1024)] {
        let cube = cube_grid(1.0, sigma_t, [0.0; 3], hg(0.3));
        let mut closed = scene(vec![cube], EYE, DVec3::ZERO, 40.0);
        let light = [1.0f32, 2.0, 0.5];
        closed.environment.constant = Vec3::from_array(light);
        let result = rendered(&closed, &point_filter(spp, 3));
        assert_expected(&format!("cube {sigma_t:?}"), &result, 1.6e-4, |x, y| {
            let (o, d) = pixel_ray(&closed, x, y);
            let length = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b - a);
            [0, 1, 2].map(|k| f64::from(light[k]) * (-f64::from(sigma_t[k]) * length).exp())
        });
    }

    let medium = asset_medium("syn_plume.vdb", [60.0, 20.0, 5.0], [0.0; 3], hg(0.0));
    let Bounds3 { low, high } = medium.bounds_world().unwrap();
    let middle = 0.5 * (low + high);
    let mut plume = scene(vec![medium], middle + DVec3::new(2.0, 1.0, 3.0), middle, 14.0);
    plume.environment.constant = Vec3::ONE;
    // At the plume's rim few paths are absorbed: so many samples that the variance, which rests on
    // those, is known in every block. With weights over channels: where channels part, the thinnest
    // loses no path at all in some block, and its variance is not known.
    let distance = Some(DistanceSampler::Spectral);
    let result = rendered(&plume, &RenderSettings { distance, ..point_filter(4096, 4) });
    let medium = &plume.volumes[0].medium;
    assert_expected("plume, per channel", &result, 1.7e-4, |x, y| {
        let (o, d) = pixel_ray(&plume, x, y);
        let tau = pileus_media::optical_depth(medium, o, d, 0.0, 100.0, &mut Default::default());
        [1.0, 1.0 / 3.0, 1.0 / 12.0].map(|relative| (-tau * relative).exp())
    });
    // Alpha is one minus the transmittance of the strongest channel's walk; here it is per path, so
    // compare with the mean colour.
    let alpha = result.image.channel("A").unwrap().iter().sum::<f32>();
    let red = result.image.channel("R").unwrap().iter().sum::<f32>();
    let blue = result.image.channel("B").unwrap().iter().sum::<f32>();
    let pixels = (64 * 64) as f32;
    assert!(alpha > pixels - blue - 40.0 && alpha < pixels - red + 40.0, "{alpha} {red} {blue}");
}

#[test]
fn constant_grid_equals_homogeneous() {
    for extinction in [[3.0; 3], [3.0, 1.0, 0.2]] {
        let mut results = Vec::new();
        for (k, medium) in [
            cube_grid(1.0, extinction, [0.95, 0.8, 0.5], hg(0.6)),
            cube_homogeneous(1.0, extinction, [0.95, 0.8, 0.5], hg(0.6)),
        ]
        .into_iter()
        .enumerate()
        {
            let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 40.0);
            scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(3.0, 2.0, 1.0), 0.0));
            scene.environment.constant = Vec3::new(0.1, 0.2, 0.3);
            results.push(rendered(&scene, &settings(256, 10 + k as u64)));
        }
        assert_same(&format!("extinction {extinction:?}"), &results[0], &results[1], 2.2e-3);
    }
}

/// Single scattering of a sun, a point and a spot light in a cube: midpoint quadrature along the
/// camera ray.
#[test]
fn single_scattering_is_the_integral() {
    const SIGMA_T: f64 = 1.7;
    const ALBEDO: f64 = 0.9;
    let to_sun = Vec3::new(0.5, 0.8, -0.3).normalize();
    let at = DVec3::new(-1.5, 1.8, 0.7);
    let lights = [
        sun(to_sun, Vec3::ONE, 0.0),
        Light::Point(Point { position: at, intensity: Vec3::splat(5.0) }),
        Light::Spot(Spot {
            position: at,
            direction: (-at).normalize().as_vec3(),
            intensity: Vec3::splat(20.0),
            // Wide enough for the whole cube, for the same reason.
            cos_inner: 0.95,
            cos_outer: -0.5,
        }),
    ];
    for light in lights {
        let g = 0.5f64;
        let medium = cube_grid(1.0, [SIGMA_T as f32; 3], [ALBEDO as f32; 3], hg(g as f32));
        // The cube fills the picture: a block that hardly any sample scatters in has no variance to
        // test with.
        let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 20.0);
        scene.lights.push(light.clone());
        let settings = RenderSettings { max_bounces: Some(1), ..point_filter(512, 5) };
        let result = rendered(&scene, &settings);
        let quadrature = |x: u32, y: u32| {
            let (o, d) = pixel_ray(&scene, x, y);
            let Some((t0, t1)) = cube_span(o, d, 1.0) else { return [0.0; 3] };
            let n = 2000;
            let dt = (t1 - t0) / f64::from(n);
            let mut sum = 0.0;
            for i in 0..n {
                let t = t0 + (f64::from(i) + 0.5) * dt;
                let p = o + d * t;
                let (wi, distance, irradiance) = match &light {
                    Light::Sun(sun) => (sun.to_light.as_dvec3().normalize(), f64::INFINITY, 1.0),
                    near => {
                        let to = near.position().unwrap() - p;
                        let i = near.intensity_toward((-to).normalize().as_vec3()).x;
                        (to.normalize(), to.length(), f64::from(i) / to.length_squared())
                    }
                };
                let exit = cube_span(p, wi, 1.0).map_or(0.0, |(_, b)| b).min(distance);
                let phase = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * d.dot(wi)).powf(1.5);
                let phase = phase / (4.0 * std::f64::consts::PI);
                sum +=
                    SIGMA_T * (-SIGMA_T * (t - t0 + exit)).exp() * ALBEDO * phase * irradiance * dt;
            }
            [sum; 3]
        };
        assert_expected("single scattering", &result, 1.6e-3, quadrature);
    }
}

/// An analog walk through a homogeneous cube, written independently in double precision: fly, die
/// with probability 1 - albedo, scatter, collect the environment. Roulette and shadow rays play no
/// part in it.
fn analog_radiance(
    o: DVec3,
    d: DVec3,
    sigma_t: f64,
    albedo: f64,
    light: impl Fn(DVec3) -> f64,
    rng: &mut Pcg32,
) -> f64 {
    let Some((t0, _)) = cube_span(o, d, 1.0) else { return light(d) };
    let (mut p, mut d) = (o + d * t0, d);
    loop {
        let exit = cube_span(p, d, 1.0).map_or(0.0, |(_, b)| b);
        let u = (f64::from(uniform(rng)) + 0.5 / 16_777_216.0).min(1.0);
        let t = -u.ln() / sigma_t;
        if t >= exit {
            return light(d);
        }
        if f64::from(uniform(rng)) >= albedo {
            return 0.0;
        }
        p += d * t;
        let z = 1.0 - 2.0 * f64::from(uniform(rng));
        let phi = std::f64::consts::TAU * f64::from(uniform(rng));
        let r = (1.0 - z * z).sqrt();
        d = DVec3::new(r * phi.cos(), r * phi.sin(), z);
    }
}

/// Multiple scattering with roulette and weighted shadow rays against the analog walk, over the
/// whole image.
#[test]
fn multiple_scattering_equals_an_analog_walk() {
    let (sigma_t, albedo) = (4.0, 0.6);
    // Bright in one quarter of the sky, dim elsewhere; constant per texel row and column pair, read
    // at texel precision.
    let texels: Vec<[f32; 3]> =
        (0..64 * 32).map(|i| if i % 64 < 16 { [4.0; 3] } else { [0.5; 3] }).collect();
    let image = Arc::new(EnvironmentImage::new(64, 32, texels, 1.0, 0.0).unwrap());
    let medium = cube_grid(1.0, [sigma_t as f32; 3], [albedo as f32; 3], Phase::Isotropic);
    let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 26.0);
    scene.environment = Environment { constant: Vec3::splat(0.1), image: Some(Arc::clone(&image)) };
    let result = rendered(&scene, &point_filter(256, 6));
    let mut rng = Pcg32::new(17, 4);
    let light = |d: DVec3| f64::from(image.radiance(d.as_vec3()).x) + 0.1;
    let (mut ours, mut ours_variance, mut theirs, mut theirs_variance) = (0.0, 0.0, 0.0, 0.0);
    let draws = 400;
    for y in 0..64 {
        for x in 0..64 {
            let (o, d) = pixel_ray(&scene, x, y);
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..draws {
                let v = analog_radiance(o, d, sigma_t, albedo, light, &mut rng);
                sum += v;
                squares += v * v;
            }
            let n = f64::from(draws);
            theirs += sum / n;
            theirs_variance += (squares / n - (sum / n).powi(2)) / (n - 1.0);
            ours += f64::from(result.image.get("R", x, y).unwrap());
            ours_variance += f64::from(result.variance.get("R", x, y).unwrap());
        }
    }
    // Null hypothesis: equal sums over 4096 pixels. False alarm 6e-9.
    let z = (ours - theirs) / (ours_variance + theirs_variance).sqrt();
    println!("ours {ours:.3}, analog {theirs:.3}, z {z:.2}");
    assert!(z.abs() < 5.8, "ours {ours}, analog {theirs}, z {z}");
    assert!((ours_variance + theirs_variance).sqrt() / theirs < 2.5e-3, "the test is too weak");
}

/// Weighted shadow rays and paths find the same light as paths alone: image and sun's disc, one
/// medium and several, grey and per channel.
#[test]
fn shadow_rays_and_paths_agree_with_paths_alone() {
    let image = |rotation: f32| {
        let texels: Vec<[f32; 3]> = (0..64 * 32)
            .map(|i| {
                let (x, y) = (i % 64, i / 64);
                if (20..28).contains(&x) && (4..10).contains(&y) {
                    [30.0, 20.0, 5.0]
                } else {
                    [0.2, 0.3, 0.4]
                }
            })
            .collect();
        Some(Arc::new(EnvironmentImage::new(64, 32, texels, 1.0, rotation.into()).unwrap()))
    };
    let single = |extinction| vec![lumpy_grid(1.0, extinction, [0.9, 0.8, 0.7], hg(0.7))];
    let several = |extinction: [f32; 3]| {
        vec![
            lumpy_grid(1.0, extinction, [0.9, 0.8, 0.7], hg(0.7)),
            lumpy_grid(0.6, [1.0, 2.0, 0.0], [0.5, 0.99, 0.7], hg(-0.3)),
            cube_homogeneous(1.5, [0.3; 3], [0.99; 3], Phase::Isotropic),
        ]
    };
    let cases: Vec<(&str, Vec<Medium>)> = vec![
        ("one grey", single([3.0; 3])),
        ("one per channel", single([3.0, 1.0, 0.1])),
        ("several grey", {
            let mut media = several([2.0; 3]);
            media.remove(1);
            media
        }),
        ("several per channel", several([2.0, 1.0, 0.5])),
    ];
    for (name, media) in cases {
        for disc in [false, true] {
            let mut scene = scene(media.clone(), EYE, DVec3::ZERO, 40.0);
            scene.environment.constant = Vec3::splat(0.05);
            if disc {
                scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(3.0, 2.0, 1.0), 1.5));
                scene.lights.push(Light::Point(Point {
                    position: DVec3::new(0.0, 3.0, 0.0),
                    intensity: Vec3::ONE,
                }));
            } else {
                scene.environment.image = image(25.0);
            }
            let both = rendered(&scene, &settings(256, 7));
            assert!(both.counters.null_collisions > both.counters.collisions / 2);
            for transmittance in [Some(Estimator::Ratio), Some(Estimator::Delta)] {
                let paths =
                    RenderSettings { light_sampling: LightSampling::Paths, ..settings(512, 8) };
                let other = match transmittance {
                    Some(Estimator::Delta) => RenderSettings { transmittance, ..settings(256, 9) },
                    _ => paths,
                };
                let what = format!("{name}, disc {disc}, against {transmittance:?}");
                assert_same(&what, &both, &rendered(&scene, &other), 4.4e-3);
            }
        }
    }
}

/// A volume in parts of one place is the whole: grey parts are walked one after the other, parts
/// with channels collision by collision.
#[test]
fn parts_make_a_whole() {
    let build = |sigma_t: [f32; 3], shares: &[f32]| {
        let part = |share: &f32| {
            let sigma_t = sigma_t.map(|channel| share * channel);
            asset_medium("syn_plume.vdb", sigma_t, [0.9, 0.8, 0.7], hg(0.4))
        };
        let media: Vec<Medium> = shares.iter().map(part).collect();
        let Bounds3 { low, high } = media[0].bounds_world().unwrap();
        let middle = 0.5 * (low + high);
        let mut scene = scene(media, middle + DVec3::new(2.0, 1.0, 3.0), middle, 14.0);
        scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::splat(3.0), 0.0));
        scene.environment.constant = Vec3::splat(0.3);
        scene
    };
    let parts: [(_, &[&[f32]], _, _); 2] = [
        ([120.0; 3], &[&[0.3, 0.7], &[1.0 / 3.0; 3]], 128, 7.3e-4),
        ([120.0, 60.0, 20.0], &[&[0.3, 0.7]], 32, 1.3e-3),
    ];
    for (sigma_t, shares, spp, power) in parts {
        let whole = rendered(&build(sigma_t, &[1.0]), &settings(spp, 1));
        for shares in shares {
            let parts = rendered(&build(sigma_t, shares), &settings(spp, 2));
            assert_same(&format!("{sigma_t:?} by {shares:?}"), &whole, &parts, power);
        }
    }
}

/// Grey media of which each overlaps a part of the others: a flight walks one after the other and
/// no further than the nearest collision so far. Null hypothesis: the picture by exact depths, of
/// which all media's are asked for every flight. The sun is met by shadow rays and by paths, so
/// that what flights know of the way counts.
#[test]
fn flights_end_at_the_nearest_collision_of_media_that_overlap() {
    let media = || {
        vec![
            lumpy_grid(1.0, [0.8; 3], [0.95, 0.8, 0.6], hg(0.2)),
            lumpy_grid(0.5, [6.0; 3], [0.6, 0.8, 0.95], hg(0.7)),
            cube_homogeneous(0.8, [0.3; 3], [0.9; 3], hg(-0.3)),
        ]
    };
    let mut scene = scene(media(), EYE, DVec3::ZERO, 26.0);
    scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.3), Vec3::splat(3.0), 40.0));
    scene.environment.constant = Vec3::splat(0.2);
    let exact = RenderSettings {
        distance: Some(DistanceSampler::Regular),
        transmittance: Some(Estimator::Regular),
        ..settings(64, 32)
    };
    let (race, exact) = (rendered(&scene, &settings(96, 31)), rendered(&scene, &exact));
    assert_same("three media", &race, &exact, 1.6e-3);
}

/// Per-channel extinction renders what three grey renders do, one per channel.
#[test]
fn channels_equal_grey_renders_each() {
    let extinction = [12.0f32, 4.0, 0.0];
    let build = |sigma_t: [f32; 3]| {
        let mut scene =
            scene(vec![cube_grid(1.0, sigma_t, [0.9, 0.95, 0.5], hg(0.3))], EYE, DVec3::ZERO, 40.0);
        scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.6), Vec3::splat(3.0), 0.0));
        scene.environment.constant = Vec3::splat(0.2);
        scene
    };
    let all = rendered(&build(extinction), &settings(512, 1));
    for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
        let mut grey = rendered(&build([extinction[k]; 3]), &settings(256, 2));
        // Only channel k is comparable: take the others from the chromatic image.
        for other in ["R", "G", "B"].into_iter().filter(|n| *n != name) {
            for (to, from) in [(&mut grey.image, &all.image), (&mut grey.variance, &all.variance)] {
                to.channel_mut(other).unwrap().copy_from_slice(from.channel(other).unwrap());
            }
        }
        assert_same(name, &all, &grey, 9.4e-4);
    }
}

/// The camera inside a medium, and a medium that fills all space: radiance of a fog lit by uniform
/// light.
#[test]
fn camera_inside_and_endless_fog() {
    // In endless conservative fog nothing comes from infinity; in a box of it the furnace holds.
    let mut inside = scene(
        vec![cube_grid(1.0, [5.0; 3], [1.0; 3], hg(0.5))],
        DVec3::splat(0.1),
        DVec3::ONE,
        60.0,
    );
    inside.environment.constant = Vec3::ONE;
    let result = rendered(&inside, &settings(4, 1));
    assert!(result.image.channel("G").unwrap().iter().all(|v| (v - 1.0).abs() < 1e-6));

    // Absorbing fog in all space with a point light: single scattering by quadrature.
    let fog = Medium::homogeneous([0.2; 3], None, [0.5; 3], Phase::Isotropic).unwrap();
    let mut endless = scene(vec![fog], EYE, DVec3::ZERO, 40.0);
    let at = DVec3::new(0.5, 1.0, -1.0);
    endless.lights.push(Light::Point(Point { position: at, intensity: Vec3::splat(10.0) }));
    let single = RenderSettings { max_bounces: Some(1), ..point_filter(2048, 2) };
    let result = rendered(&endless, &single);
    assert_expected("fog", &result, 2.7e-3, |x, y| {
        let (o, d) = pixel_ray(&endless, x, y);
        let n = 20_000;
        let mut sum = 0.0;
        // Substitution around the point nearest to the light, where the integrand peaks: t = foot +
        // D tan(theta).
        let foot = (at - o).dot(d);
        let distance = (at - (o + d * foot)).length();
        let (a, b) = ((-foot / distance).atan(), std::f64::consts::FRAC_PI_2);
        for i in 0..n {
            let theta = a + (b - a) * (f64::from(i) + 0.5) / f64::from(n);
            let t = foot + distance * theta.tan();
            let to = (at - (o + d * t)).length();
            let jacobian = distance / theta.cos().powi(2) * (b - a) / f64::from(n);
            sum += 0.2 * 0.5 * f64::from(ISOTROPIC) * 10.0 / (to * to)
                * (-0.2 * (t + to)).exp()
                * jacobian;
        }
        [sum; 3]
    });
}

/// Every unbiased estimator of transmittance gives the picture that ratio tracking gives: one grid
/// and a list of media, grey and per channel (one of them clear), delta light and a disc that paths
/// meet as well.
#[test]
fn every_estimator_gives_the_same_picture() {
    for (name, sigma_t) in [("grey", [3.0f32; 3]), ("channels", [4.0, 1.5, 0.0])] {
        for (light, diameter) in [("delta sun", 0.0f32), ("disc", 0.9)] {
            let medium = lumpy_grid(1.0, sigma_t, [0.9, 0.8, 0.7], hg(0.3));
            let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 24.0);
            scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.6), Vec3::splat(3.0), diameter));
            scene.environment.constant = Vec3::splat(0.1);
            let by = |estimator, spp, seed| {
                let transmittance = Some(estimator);
                rendered(&scene, &RenderSettings { transmittance, ..settings(spp, seed) })
            };
            let ratio = by(Estimator::Ratio, 256, 1);
            for (i, estimator) in Estimator::ALL.into_iter().enumerate() {
                if estimator.is_unbiased() && estimator != Estimator::Ratio {
                    let other = by(estimator, 64, 2 + i as u64);
                    assert_same(
                        &format!("{name}, {light}, {}", estimator.name()),
                        &ratio,
                        &other,
                        4.3e-3,
                    );
                }
            }
        }
    }
}

/// Every sampler of flights gives delta tracking's picture, also with weights against shadow rays,
/// with channels, in a list of media, with majorants that are looser than need be or do not hold,
/// and beside regular tracking's shadow rays, whose density is known.
#[test]
fn every_sampler_gives_the_same_picture() {
    let at = DVec3::new(-0.2, 1.3, 0.4);
    for (name, sigma_t) in [("grey", [3.0f32; 3]), ("channels", [4.0, 1.5, 0.0])] {
        for list in [false, true] {
            let mut media = vec![lumpy_grid(1.0, sigma_t, [0.9, 0.8, 0.7], hg(0.3))];
            if list {
                media.push(cube_homogeneous(0.6, [0.5, 0.5, 0.5], [0.5; 3], hg(0.0)));
                media.push(cube_homogeneous(0.7, [0.2, 0.5, 0.0], [0.8; 3], hg(0.0)));
            }
            let mut scene = scene(media, EYE, DVec3::ZERO, 24.0);
            scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.6), Vec3::splat(3.0), 0.9));
            scene.lights.push(Light::Point(Point { position: at, intensity: Vec3::splat(2.0) }));
            scene.environment.constant = Vec3::splat(0.1);
            let by = |distance, majorant_scale, estimator, seed| {
                let transmittance = Some(estimator);
                let base = settings(48, seed);
                RenderSettings { distance, majorant_scale, transmittance, ..base }
            };
            let reference = rendered(&scene, &by(None, 1.0, Estimator::Ratio, 1));
            let mut seed = 2;
            let check = |what: String, power: f64, settings: RenderSettings| {
                let mut film = Film::new(scene.camera.resolution(), None).unwrap();
                let counters = Renderer::new(&scene, &settings)
                    .expect("a plan")
                    .render(&mut film, &Unmonitored)
                    .unwrap();
                assert_eq!(counters.dropped, 0);
                assert_eq!(counters.violations > 0, settings.majorant_scale < 1.0, "{what}");
                let (image, variance) = (film.image(), film.variance());
                assert_same(
                    &what,
                    &reference,
                    &Rendered { image, variance, film, counters },
                    power,
                );
            };
            for sampler in DistanceSampler::ALL {
                // Analytic flights are refused for grids.
                if !sampler.is_unbiased()
                    || !sampler.is_one_flight()
                    || sampler == DistanceSampler::Analytic
                {
                    continue;
                }
                for estimator in [Estimator::Ratio, Estimator::Regular, Estimator::ResidualRatio] {
                    seed += 1;
                    let what = format!("{name} {list}: {} {}", sampler.name(), estimator.name());
                    // The majorant of the strongest channel, and weights of the others.
                    let weighted = name == "channels" && sampler == DistanceSampler::Delta;
                    let power = if weighted { 0.03 } else { 6e-3 };
                    check(what, power, by(Some(sampler), 1.0, estimator, seed));
                }
            }
            check(
                format!("{name} {list}: equiangular"),
                6e-3,
                by(Some(DistanceSampler::Equiangular), 1.0, Estimator::Ratio, 50),
            );
            check(format!("{name} {list}: loose"), 6e-3, by(None, 4.0, Estimator::Ratio, 51));
            check(format!("{name} {list}: broken"), 6e-3, by(None, 0.8, Estimator::Ratio, 52));
        }
    }
}

/// A small light in thin smoke: equiangular points lower the noise by a large factor at equal
/// samples. And what a scene does not have, or what cannot be done, is said.
#[test]
fn equiangular_points_serve_lights_in_thin_media() {
    let medium = lumpy_grid(1.0, [0.05; 3], [0.9; 3], hg(0.0));
    let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 24.0);
    let light = Point { position: DVec3::new(0.1, 0.05, 0.02), intensity: Vec3::ONE };
    scene.lights.push(Light::Point(light));
    let by = |distance, spp| rendered(&scene, &RenderSettings { distance, ..settings(spp, 7) });
    // Flights seldom scatter near the light.
    let flights = by(Some(DistanceSampler::Delta), 1024);
    let points = by(Some(DistanceSampler::Equiangular), 64);
    assert_same("thin", &flights, &points, 0.0145);
    let mean_variance = |r: &Rendered| {
        let plane = r.variance.channel("G").unwrap();
        plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64
    };
    let gain = 1024.0 / 64.0 * mean_variance(&flights) / mean_variance(&points);
    println!("variance: flights / equiangular = {gain:.1}");
    assert!(gain > 10.0, "{gain}");
    // Asked for, and by the plan's own choice.
    for distance in [Some(DistanceSampler::Equiangular), None] {
        let plan = Plan::new(&scene, &RenderSettings { distance, ..settings(1, 1) }).unwrap();
        assert_eq!(plan.distance, DistanceSampler::Equiangular);
    }
    scene.lights.clear();
    let plan = Plan::new(
        &scene,
        &RenderSettings { distance: Some(DistanceSampler::Equiangular), ..settings(1, 1) },
    )
    .unwrap();
    assert_eq!(plan.distance, DistanceSampler::Delta);
    for (distance, majorant_scale, estimator, parameter, says) in [
        (
            Some(DistanceSampler::Analytic),
            1.0,
            Estimator::Ratio,
            Parameter::Distance,
            "distance is analytic: volume `volume 0` is a grid",
        ),
        (
            Some(DistanceSampler::Delta),
            0.5,
            Estimator::Ratio,
            Parameter::Distance,
            "distance is delta: it needs bounds that hold, but majorant_scale is 0.5",
        ),
        (
            None,
            0.5,
            Estimator::Delta,
            Parameter::Transmittance,
            "transmittance is delta: it needs bounds that hold, but majorant_scale is 0.5",
        ),
        (
            None,
            0.0,
            Estimator::Ratio,
            Parameter::MajorantScale,
            "majorant_scale is 0: volume `volume 0`",
        ),
        (
            None,
            f32::NAN,
            Estimator::Ratio,
            Parameter::MajorantScale,
            "majorant_scale is NaN: volume `volume 0`",
        ),
    ] {
        let transmittance = Some(estimator);
        let settings = RenderSettings { distance, majorant_scale, transmittance, ..settings(1, 1) };
        let error = Plan::new(&scene, &settings).unwrap_err();
        assert_eq!(error.parameter(), Some(parameter), "{error}");
        assert!(error.to_string().starts_with(says) && !error.remedies().is_empty(), "{error}");
    }
}

/// Fog that fills all space and is clear in one channel: walks end, and the clear channel sees the
/// environment unchanged.
#[test]
fn endless_fog_that_is_clear_in_one_channel() {
    let fog = pileus_media::Medium::homogeneous([1.0, 0.3, 0.0], None, [0.5; 3], hg(0.0)).unwrap();
    let mut scene = scene(vec![fog], EYE, DVec3::ZERO, 24.0);
    scene.environment.constant = Vec3::new(0.0, 0.0, 0.7);
    scene.lights.push(sun(Vec3::Y, Vec3::splat(3.0), 0.0));
    let image = rendered(&scene, &settings(256, 5));
    assert_expected("endless fog", &image, 0.0, |_, _| [0.0, 0.0, 0.7]);
}

/// `clamp` bounds every sample's luminance, keeps its colour, is counted and named as a bias, and
/// leaves all darker samples as they are.
#[test]
fn clamped_samples_are_bounded_and_confessed() {
    let medium = lumpy_grid(1.0, [3.0; 3], [1.0, 0.9, 0.7], hg(0.9));
    let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 24.0);
    scene.environment.constant = Vec3::splat(0.05);
    scene.lights.push(sun(Vec3::new(0.3, 0.2, -1.0), Vec3::splat(5.0), 0.0));
    let luminance = |image: &pileus_film::Image, x, y| {
        let [r, g, b] = ["R", "G", "B"].map(|c| image.get(c, x, y).unwrap());
        (0.2126 * r + 0.7152 * g + 0.0722 * b, r / g)
    };
    let most = 0.8;
    let free = rendered(&scene, &settings(1, 3));
    let limited = RenderSettings { clamp: Some(most), ..settings(1, 3) };
    let clamped = rendered(&scene, &limited);
    let mut met = 0;
    for (x, y) in (0..64).flat_map(|y| (0..64).map(move |x| (x, y))) {
        let ((before, hue), (after, same_hue)) =
            (luminance(&free.image, x, y), luminance(&clamped.image, x, y));
        if before > most {
            met += 1;
            assert!((after - most).abs() < 1e-5 && (hue - same_hue).abs() < 1e-4 * hue);
        } else {
            assert_eq!(before, after);
        }
    }
    assert!(met > 20, "{met}");
    assert_eq!((clamped.counters.clamped, free.counters.clamped), (met, 0));
    assert!(Plan::new(&scene, &limited).unwrap().biased[0].contains("clamp"));
}

/// Shadow rays by what a prepass expects: the picture of importance alone, grey, per channel and of
/// several media, under a sun, a disc and a bright sky; the same bits on any number of threads. Few
/// scatterings make it the plan's choice.
#[test]
fn expected_shadows_change_no_mean() {
    let expected = |seed| RenderSettings {
        shadow_roulette: Some(ShadowRoulette::AdjointDriven),
        ..settings(128, seed)
    };
    let importance = |seed| RenderSettings {
        shadow_roulette: Some(ShadowRoulette::Importance),
        ..settings(128, seed)
    };
    let texels = (0..32 * 16).map(|i| if i == 40 { [200.0; 3] } else { [0.2; 3] }).collect();
    let sky = Arc::new(EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap());
    for (i, sigma_t) in [[0.4f32; 3], [6.0; 3], [2.0, 0.5, 0.0]].into_iter().enumerate() {
        for two in [false, true] {
            let mut media = vec![lumpy_grid(1.0, sigma_t, [0.95, 0.9, 0.6], hg(0.6))];
            if two {
                media.push(cube_homogeneous(1.3, [0.2; 3], [0.9; 3], hg(0.0)));
            }
            let mut scene = scene(media, EYE, DVec3::ZERO, 30.0);
            scene.lights.push(sun(
                Vec3::new(0.5, 0.8, -0.3),
                Vec3::splat(2.0),
                if two { 5.0 } else { 0.0 },
            ));
            scene.environment.image = Some(Arc::clone(&sky));
            let renderer = Renderer::new(&scene, &settings(1, 1)).unwrap();
            let reasons = &renderer.prepass().reasons;
            let thin = i == 0 && !two;
            let chosen = reasons.iter().any(|reason| reason.contains("by what a radiance cache"));
            assert!(!thin || chosen, "{reasons:?}");
            let seed = 20 + 4 * i as u64 + 2 * u64::from(two);
            let by_expectation = rendered(&scene, &expected(seed));
            assert_same(
                "expected",
                &by_expectation,
                &rendered(&scene, &importance(seed + 1)),
                2.9e-3,
            );
            let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
            let again = pool.install(|| rendered(&scene, &expected(seed)));
            for c in ["R", "G", "B"] {
                assert!(by_expectation.image.channel(c) == again.image.channel(c));
            }
        }
    }
}
