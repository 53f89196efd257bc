//! Suns, points and spots on a Lambertian floor.

use crate::{floor, floor_scene, on_floor};
use glam::{DVec3, Vec3};
use pileus_integrator::RenderSettings;
use pileus_media::Phase;
use pileus_media::distance::DistanceSampler;
use pileus_scene::{Light, Point, Scene, Spot};
use pileus_tests::*;
use std::f64::consts::PI;

/// Inverse square, cosine, glTF's falloff; each light alone, and all together, which tests the
/// choice among them.
#[test]
fn punctual_lights_are_the_closed_forms() {
    let at = DVec3::new(0.3, 0.6, -0.2);
    let axis = DVec3::new(-0.2, -1.0, 0.5).normalize();
    let (cos_inner, cos_outer) = (0.97f32, 0.8f32);
    let to_sun = Vec3::new(0.5, 0.8, -0.3);
    let intensity = Vec3::new(2.0, 1.0, 0.5);
    let lights = [
        sun(to_sun, intensity, 0.0),
        sun(to_sun, intensity, 0.3),
        Light::Point(Point { position: at, intensity }),
        Light::Spot(Spot {
            position: at,
            direction: axis.as_vec3(),
            intensity,
            cos_inner,
            cos_outer,
        }),
    ];
    let irradiance = |kind: usize, p: DVec3| {
        let to = at - p;
        let point = to.y / to.length().powi(3);
        let (inner, outer) = (f64::from(cos_inner), f64::from(cos_outer));
        let ramp = ((-to.normalize().dot(axis) - outer) / (inner - outer)).clamp(0.0, 1.0);
        match kind {
            0 | 1 => f64::from(to_sun.normalize().y),
            2 => point,
            _ => point * ramp * ramp,
        }
    };
    let mut scene = floor_scene(&[floor(3.0, 0.6)]);
    for kinds in [vec![0], vec![1], vec![2], vec![3], vec![0, 1, 2, 3]] {
        scene.lights = kinds.iter().map(|k| lights[*k].clone()).collect();
        let image = rendered(&scene, &point_filter(128, 7));
        // One delta light has no noise at all.
        let spread = image.variance.channel("R").unwrap().iter().fold(0.0f32, |a, b| a.max(*b));
        let exact = kinds.len() == 1 && kinds[0] != 1 && spread < 1e-10;
        let expected = |x, y| {
            let p = on_floor(pixel_ray(&scene, x, y));
            let e: f64 = kinds.iter().map(|k| irradiance(*k, p)).sum();
            intensity.to_array().map(|i| f64::from(i) * 0.6 / PI * e)
        };
        if exact {
            for y in 0..64 {
                for x in 0..64 {
                    for (c, e) in ["R", "G", "B"].into_iter().zip(expected(x, y)) {
                        let found = f64::from(image.image.get(c, x, y).unwrap());
                        // The filter is 1e-4 of a pixel wide: steps of a spot's falloff, and single
                        // precision.
                        assert!(
                            (found - e).abs() < 1e-4 * e + 1e-6,
                            "{kinds:?} {x} {y}: {found} {e}"
                        );
                    }
                }
            }
        } else {
            assert!(spread > 0.0);
            assert_expected(&format!("lights {kinds:?}"), &image, 4.3e-4, expected);
        }
    }
}

/// Many points and spots, chosen among under a tree: the sum of the closed forms.
#[test]
fn many_punctual_lights_are_the_closed_forms() {
    let (cos_inner, cos_outer) = (0.95f32, 0.75f32);
    let mut scene = floor_scene(&[floor(3.0, 0.6)]);
    for i in 0..60u32 {
        let turn = f64::from(i) * 2.4;
        let away = 0.2 + 0.04 * f64::from(i);
        let position =
            DVec3::new(away * turn.cos(), 0.3 + 0.02 * f64::from(i % 7), away * turn.sin());
        let intensity =
            Vec3::new(1.0, 0.2 + 0.01 * i as f32, 0.3) * if i % 9 == 0 { 2.0 } else { 0.1 };
        scene.lights.push(if i % 3 == 0 {
            let direction = DVec3::new(-turn.sin(), -1.0, 0.4 * turn.cos()).normalize().as_vec3();
            Light::Spot(Spot { position, direction, intensity, cos_inner, cos_outer })
        } else {
            Light::Point(Point { position, intensity })
        });
    }
    let expected = |x, y| {
        let p = on_floor(pixel_ray(&scene, x, y));
        let mut sum = DVec3::ZERO;
        for light in &scene.lights {
            let to = light.position().unwrap() - p;
            let intensity = light.intensity_toward(-to.normalize().as_vec3());
            sum += intensity.as_dvec3() * (to.y / to.length().powi(3));
        }
        (sum * 0.6 / PI).to_array()
    };
    assert_expected("many lights", &rendered(&scene, &point_filter(256, 11)), 4.2e-3, expected);
}

/// Points at equal angles beside flights, where surfaces end rays, cast shadows and light the
/// smoke, and where an area light has to be weighted, too: the picture of flights alone.
#[test]
fn equal_angles_among_surfaces() {
    let smoke = lumpy_grid(1.2, [0.4; 3], [0.9, 0.8, 0.7], Phase::henyey_greenstein(0.4));
    let area_light_up = quad([-1.0, 1.0, -0.5], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]);
    let meshes = [
        floor(1.2, 0.6),
        (sphere(DVec3::new(0.4, 0.3, 0.3), 0.25, 6), lambert([0.7; 3])),
        (sphere(DVec3::new(-0.5, 0.3, 0.5), 0.25, 6), glass(1.3)),
        (area_light_up, area_light([0.0; 3], [1.0, 2.0, 3.0])),
    ];
    let mut scene: Scene =
        scene(vec![smoke], DVec3::new(1.0, 1.2, 3.0), DVec3::new(0.0, 0.3, 0.0), 34.0);
    scene.surfaces = Some(surfaces(&meshes));
    let intensity = Vec3::splat(0.3);
    for position in [DVec3::new(0.1, 0.6, 0.1), DVec3::new(-0.4, 0.2, -0.5)] {
        scene.lights.push(Light::Point(Point { position, intensity }));
    }
    let by = |distance, seed| rendered(&scene, &RenderSettings { distance, ..settings(192, seed) });
    let flights = by(Some(DistanceSampler::Delta), 1);
    assert_same("equal angles", &flights, &by(Some(DistanceSampler::Equiangular), 2), 0.016);
}
