//! One grid of extinction per channel: channels that fly together and part, against grey renders of
//! each and against weights over channels.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DVec3, Vec3};
use pileus_integrator::{Channels, Events, Plan, RenderSettings};
use pileus_media::distance::DistanceSampler;
use pileus_media::transmittance::Estimator;
use pileus_media::transmittance_function::{Power, TransmittanceFunction};
use pileus_media::{Bounds3, Medium, Phase};
use pileus_scene::{EnvironmentImage, Light, Point, Scene};
use pileus_tests::*;
use std::sync::Arc;

const EYE: DVec3 = DVec3::new(3.0, 2.0, 4.0);
const NAMES: [&str; 3] = ["R", "G", "B"];

fn lit(medium: Medium, eye: DVec3) -> Scene {
    let mut scene = scene(vec![medium], eye, DVec3::ZERO, 36.0);
    scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.6), Vec3::splat(3.0), 0.0));
    scene.environment.constant = Vec3::new(0.2, 0.3, 0.4);
    scene
}

fn lumpy(sigma_t: [f32; 3], albedo: [f32; 3]) -> Medium {
    lumpy_grid(1.0, sigma_t, albedo, Phase::henyey_greenstein(0.3))
}

fn by(distance: DistanceSampler, spp: u64, seed: u64) -> RenderSettings {
    RenderSettings { distance: Some(distance), ..settings(spp, seed) }
}

fn axes(plan: &Plan) -> (Events, Channels) {
    (plan.kernel.events, plan.kernel.channels)
}

fn kernel(scene: &Scene, settings: &RenderSettings) -> (Events, Channels) {
    axes(&Plan::new(scene, settings).expect("a plan"))
}

fn mean_variance(rendered: &Rendered, channel: &str) -> f64 {
    let plane = rendered.variance.channel(channel).expect("a channel");
    plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64
}

/// Every channel is what a grey render of its extinction and albedo shows, and so is the coverage:
/// weights of one, clear channels, extreme ratios, channels that absorb everything, any order of
/// strength, equal channels, the camera inside.
#[test]
fn channels_that_part_equal_grey_renders_of_each() {
    let cases: [(&str, [f32; 3], [f32; 3], DVec3); 7] = [
        ("falling", [10.0, 4.0, 1.0], [0.6, 0.5, 0.4], EYE),
        ("extreme and clear", [8.0, 8e-3, 0.0], [0.9, 0.95, 0.5], EYE),
        ("vanishing", [1e-9, 1e-20, 5.0], [0.9, 0.95, 0.5], EYE),
        ("two equal", [1.0, 6.0, 6.0], [0.9, 0.8, 0.99], EYE),
        ("strongest absorbs", [8.0, 3.0, 1.0], [0.0, 0.9, 0.95], EYE),
        ("all absorb", [8.0, 3.0, 1.0], [0.0; 3], EYE),
        ("inside", [1.0, 4.0, 2.0], [0.99, 0.95, 0.9], DVec3::new(0.3, 0.2, 0.5)),
    ];
    for (i, (what, extinction, albedo, eye)) in cases.into_iter().enumerate() {
        let chromatic = lit(lumpy(extinction, albedo), eye);
        let settings = settings(48, 1 + i as u64);
        assert_eq!(kernel(&chromatic, &settings), (Events::OneGrid, Channels::Split));
        let all = rendered(&chromatic, &settings);
        assert_eq!((all.counters.violations, all.counters.dropped), (0, 0), "{what}");
        let mut coverage = 0.0;
        for (k, name) in NAMES.into_iter().enumerate() {
            let medium = lumpy([extinction[k]; 3], [albedo[k]; 3]);
            let mut grey = rendered(&lit(medium, eye), &by(DistanceSampler::Delta, 48, 91));
            let alpha = |r: &Rendered| {
                let plane = r.film.image();
                let plane = plane.channel("A").expect("alpha").to_vec();
                plane.iter().map(|a| f64::from(*a)).sum::<f64>() / plane.len() as f64
            };
            coverage += alpha(&grey) / 3.0;
            if k == 2 {
                // Hits and misses: the standard error of each mean is below 1 / (2 sqrt n); seven
                // of the difference's.
                let n = (all.image.pixel_count() * 48) as f64;
                let (a, bound) = (alpha(&all), 7.0 * (0.25 * (1.0 + 1.0 / 3.0) / n).sqrt());
                assert!((a - coverage).abs() < bound, "{what}: alpha {a}, {coverage}");
            }
            // Only channel k is comparable: take the others from the chromatic image.
            for other in NAMES.into_iter().filter(|n| *n != name) {
                let pairs = [(&mut grey.image, &all.image), (&mut grey.variance, &all.variance)];
                for (to, from) in pairs {
                    let from = from.channel(other).expect("a channel");
                    to.channel_mut(other).expect("a channel").copy_from_slice(from);
                }
            }
            assert_same(&format!("{what}, {name}"), &all, &grey, 2.5e-3);
        }
    }
}

/// Light that paths and shadow rays both meet, with weights per channel, and points at equal
/// angles: the picture of spectral tracking.
#[test]
fn parted_channels_are_weighted_against_shadow_rays() {
    let texels: Vec<[f32; 3]> = (0..64 * 32)
        .map(|i| {
            let bright = (20..28).contains(&(i % 64)) && (4..10).contains(&(i / 64));
            if bright { [30.0, 20.0, 5.0] } else { [0.2, 0.3, 0.4] }
        })
        .collect();
    let image = Arc::new(EnvironmentImage::new(64, 32, texels, 1.0, 0.4).expect("an image"));
    let build = |light: &str| {
        let mut scene = lit(lumpy([4.0, 0.1, 1.5], [0.9, 0.95, 0.7]), EYE);
        scene.lights.clear();
        match light {
            "disc" => scene.lights.push(sun(Vec3::new(0.5, 0.8, 0.6), Vec3::splat(3.0), 0.9)),
            "image" => scene.environment.image = Some(Arc::clone(&image)),
            _ => scene.lights.push(Light::Point(Point {
                position: DVec3::new(0.4, 1.2, 0.3),
                intensity: Vec3::splat(2.0),
            })),
        }
        scene
    };
    for (seed, light) in ["disc", "image", "point"].into_iter().enumerate() {
        let scene = build(light);
        let distance = if light == "point" {
            Some(DistanceSampler::Equiangular)
        } else {
            Some(DistanceSampler::Split)
        };
        let settings = RenderSettings { distance, ..settings(64, 20 + seed as u64) };
        let plan = Plan::new(&scene, &settings).expect("a plan");
        assert_eq!((axes(&plan), plan.mis), ((Events::OneGrid, Channels::Split), light != "point"));
        let split = rendered(&scene, &settings);
        let spectral = rendered(&scene, &by(DistanceSampler::Spectral, 64, 40));
        assert_same(light, &split, &spectral, 4.4e-3);
        for name in NAMES {
            let gain = mean_variance(&spectral, name) / mean_variance(&split, name);
            println!("{light}, {name}: variance of spectral over that of split {gain:.2}");
        }
    }
}

/// Where flights carry weights one of all points of emission on them is drawn: a glowing box that
/// scatters nothing has the radiance `e (1 - exp(-s L)) / s` per channel, by flights that part and
/// by weights over channels.
#[test]
fn glowing_boxes_shine_as_the_integral_says() {
    let (sigma_t, color) = ([1.5f32, 0.5, 0.1], [2.0f32, 3.0, 1.0]);
    for distance in [DistanceSampler::Split, DistanceSampler::Spectral] {
        let mut scene = scene(vec![], EYE, DVec3::ZERO, 40.0);
        scene.volumes.push(glowing_cube(1.0, sigma_t, [0.0; 3], color));
        let settings = RenderSettings { distance: Some(distance), ..point_filter(128, 4) };
        let result = rendered(&scene, &settings);
        assert_expected(&format!("{distance:?}"), &result, 5e-3, |x, y| {
            let (o, d) = pixel_ray(&scene, x, y);
            let length = cube_span(o, d, 1.0).map_or(0.0, |(a, b)| b - a);
            [0, 1, 2].map(|c| {
                let (s, e) = (f64::from(sigma_t[c]), f64::from(color[c]));
                e * (1.0 - (-s * length).exp()) / s
            })
        });
    }
}

/// What parting is for: without weights the noise at equal samples is well below that of weights
/// over channels. A fixed seed; the factor asked for is half of what was measured.
#[test]
fn parting_lowers_the_noise_of_weights_over_channels() {
    let scene = lit(lumpy([10.0, 4.0, 1.0], [0.6, 0.5, 0.4]), EYE);
    let split = rendered(&scene, &settings(64, 1));
    let spectral = rendered(&scene, &by(DistanceSampler::Spectral, 64, 2));
    let sum = |r: &Rendered| NAMES.iter().map(|name| mean_variance(r, name)).sum::<f64>();
    let gain = sum(&spectral) / sum(&split);
    println!("variance: spectral / split = {gain:.2}");
    assert!(gain > 1.9, "{gain}");
}

/// Channels decouple over lists and beside surfaces as they do in one grid; where they cannot the
/// plan says so, and renders by what it would have taken.
#[test]
fn the_plan_says_where_channels_do_not_decouple() {
    let grid = lumpy([4.0, 1.0, 0.5], [0.9; 3]);
    let one = lit(grid.clone(), EYE);
    let fog = cube_homogeneous(1.5, [0.3, 0.2, 0.1], [0.9; 3], Phase::Isotropic);
    let two = scene(vec![grid, fog], EYE, DVec3::ZERO, 36.0);
    let grey = lit(lumpy([4.0; 3], [0.9; 3]), EYE);
    let split = RenderSettings { distance: Some(DistanceSampler::Split), ..settings(1, 1) };
    let regular = Some(Estimator::Regular);
    let list = Events::MergedList;
    let cases = [
        (&two, split.clone(), (list, Channels::Split), "split"),
        (&one, split.clone(), (Events::OneGrid, Channels::Split), "split"),
        (&grey, split.clone(), (Events::OneGrid, Channels::Grey), "delta"),
        (
            &one,
            RenderSettings { transmittance: regular, ..split.clone() },
            (list, Channels::Spectral),
            "spectral",
        ),
        (
            &one,
            RenderSettings { majorant_scale: 0.5, ..split.clone() },
            (list, Channels::Spectral),
            "weighted_delta",
        ),
        (&one, by(DistanceSampler::Delta, 1, 1), (list, Channels::Spectral), "delta"),
    ];
    for (scene, settings, kernel, distance) in cases {
        let plan = Plan::new(scene, &settings).expect("a plan");
        assert_eq!((axes(&plan), plan.distance.name()), (kernel, distance));
        let said = plan.reasons.iter().any(|reason| reason.contains("no channels decouple"));
        let asked = settings.distance == Some(DistanceSampler::Split);
        assert_eq!(said, asked && distance != "split");
    }
}

/// Where flights are closed forms of their own, channels are weighted beside split tracking, and
/// the plan does not claim otherwise.
#[test]
fn the_plan_says_which_volumes_are_weighted_beside_split() {
    let fog = || cube_homogeneous(1.5, [0.3, 0.2, 0.1], [0.9; 3], Phase::Isotropic);
    let power = Some(Arc::new(TransmittanceFunction::Power(Power::new(2.0).unwrap())));
    let of_function = fog().with_transmittance_function(power);
    let uneven = cube_homogeneous(1.5, [400.0, 0.4, 1.2], [0.9; 3], Phase::Isotropic);
    for (second, analog) in [(fog(), true), (of_function, false), (uneven, false)] {
        let scene = scene(vec![fog(), second], EYE, DVec3::ZERO, 36.0);
        let plan = Plan::new(&scene, &settings(1, 1)).expect("a plan");
        assert_eq!(axes(&plan).1, Channels::Split);
        let says = |what: &str| plan.reasons.iter().any(|reason| reason.contains(what));
        assert_eq!(says("none is weighted"), analog);
        assert_eq!(says("weighted: in volume `volume 1`"), !analog);
    }
}

/// Split tracking beside what it was not made for at first: overlapping media, of which one has a
/// transmittance function that is not exponential, over a floor, under a sun with an extent that
/// shadow rays and paths both meet. Null hypothesis: the picture of spectral MIS.
#[test]
fn channels_decouple_over_lists_under_transmittance_functions_and_beside_surfaces() {
    let function = Arc::new(TransmittanceFunction::Power(Power::new(2.0).unwrap()));
    let media = || {
        let cloud = lumpy([3.0, 1.0, 0.3], [0.9, 0.8, 0.7]);
        vec![
            cloud.with_transmittance_function(Some(Arc::clone(&function))),
            cube_grid(0.7, [0.4, 1.5, 0.8], [0.8; 3], Phase::henyey_greenstein(0.4)),
            cube_homogeneous(1.2, [0.3, 0.2, 0.1], [0.9; 3], Phase::Isotropic),
        ]
    };
    let mut scene = scene(media(), EYE, DVec3::ZERO, 36.0);
    let floor = quad([-3.0, -1.1, 3.0], [6.0, 0.0, 0.0], [0.0, 0.0, -6.0]);
    scene.surfaces = Some(surfaces(&[(floor, lambert([0.7, 0.5, 0.3]))]));
    scene.lights.push(sun(Vec3::new(0.4, 0.9, 0.3), Vec3::splat(2.0), 0.1));
    scene.environment.constant = Vec3::splat(0.3);
    let plan = Plan::new(&scene, &settings(1, 1)).expect("a plan");
    assert_eq!((axes(&plan), plan.mis), ((Events::MergedList, Channels::Split), true));
    let split = rendered(&scene, &settings(96, 31));
    let spectral = rendered(&scene, &by(DistanceSampler::Spectral, 96, 32));
    assert_same("transmittance functions and a floor", &split, &spectral, 1.7e-3);
}

/// A medium between two heights, of one extinction per channel.
fn slab(sigma_t: [f32; 3], y: [f64; 2]) -> Medium {
    let bounds = Bounds3::new(DVec3::new(-9.0, y[0], -9.0), DVec3::new(9.0, y[1], 9.0));
    Medium::homogeneous(sigma_t, Some(bounds), [0.0; 3], Phase::Isotropic).expect("a medium")
}

/// Shadow rays walk what is behind a medium as if no channel had ended in it, and so do the flights
/// that they are weighted against. Flights that went on with the majorants of the channels left
/// gave green and blue 12 % too much: 40 standard errors here.
#[test]
fn weights_hold_behind_a_medium_in_which_a_channel_ended() {
    let ball = cube_homogeneous(1.0, [0.5; 3], [1.0; 3], Phase::Isotropic);
    let behind = [slab([10.0, 0.0, 0.0], [1.1, 1.5]), slab([10.0, 1.0, 1.0], [1.6, 2.5])];
    let [first, second] = behind;
    let mut scene = scene(vec![ball, first, second], DVec3::Z * 4.0, DVec3::ZERO, 20.0);
    scene.lights.push(sun(Vec3::Y, Vec3::splat(3.0), 150.0));
    let once = |settings: RenderSettings| RenderSettings { max_bounces: Some(1), ..settings };
    let split = rendered(&scene, &once(settings(64, 41)));
    let spectral = rendered(&scene, &once(by(DistanceSampler::Spectral, 64, 42)));
    assert_same("three in a row", &split, &spectral, 8e-3);
}

/// A fog without end that is clear for green and blue, around a box in which red ends: the walk
/// through the fog concerns nobody any more and has no end of its own.
#[test]
fn flights_end_in_fogs_that_are_clear_for_the_channels_left() {
    let fog = Medium::homogeneous([0.1, 0.0, 0.0], None, [0.8; 3], Phase::Isotropic);
    let cube = cube_homogeneous(1.0, [1.0, 0.5, 0.1], [0.9; 3], Phase::Isotropic);
    let mut scene = scene(vec![fog.expect("a fog"), cube], DVec3::Z * 5.0, DVec3::ZERO, 20.0);
    scene.environment.constant = Vec3::ONE;
    let split = rendered(&scene, &settings(16, 43));
    let spectral = rendered(&scene, &by(DistanceSampler::Spectral, 16, 44));
    assert_same("a fog of one channel", &split, &spectral, 5e-3);
}
