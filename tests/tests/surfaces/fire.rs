//! Light from volumes.

use crate::{floor, floor_scene};
use glam::{DAffine3, DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::emission::{EmissionField, EmissionSource};
use pileus_media::{Albedo, Interpolation, Medium, Phase, VoxelGrid, VoxelGridOptions};
use pileus_scene::{Scene, Volume, VolumeSource};
use pileus_tests::*;
use pileus_vdb::Tree;
use serde_json::json;
use std::sync::Arc;

/// Fire that lights a floor and smoke: paths that are drawn to it give what paths alone do.
#[test]
fn fire_that_draws_paths_is_fire_by_paths() {
    let scene = blender("fire.glb", "fire_0003.vdb", [64, 64]);
    let by = |light_sampling, spp, seed| {
        rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
    };
    let both = by(LightSampling::Both, 64, 1);
    let paths = by(LightSampling::Paths, 512, 2);
    assert_same("fire", &both, &paths, 6.6e-3);
}

/// Two fires in smoke that scatters, grey and per channel, beside an area light, a sun, constant
/// light and rough glass: paths that are drawn to fires, weighted against shadow rays to the other
/// lights, give what paths alone do.
#[test]
fn fires_draw_paths_beside_all_other_light() {
    let mut rough = glass(1.4);
    rough["pbrMetallicRoughness"]["roughnessFactor"] = json!(0.6);
    rough["extensions"]["KHR_materials_volume"] = json!({"thicknessFactor": 1.0,
        "attenuationDistance": 0.3, "attenuationColor": [0.6, 0.5, 0.2]});
    for (k, sigma_t) in [[3.0f32; 3], [3.0, 0.7, 1.5]].into_iter().enumerate() {
        let mut scene = scene(Vec::new(), DVec3::new(1.5, 1.2, 3.0), DVec3::ZERO, 34.0);
        scene.volumes.push(glowing_cube(0.35, sigma_t, [0.6; 3], [2.0, 1.0, 0.5]));
        let centre = DVec3::new(-0.8, 0.0, 0.4);
        scene.volumes.push(ball(centre, 0.3, 2.0, 0.3, [0.5, 1.0, 2.0]));
        scene.surfaces = Some(surfaces(&[
            (quad([-2.0, -0.75, -2.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0]), lambert([0.5; 3])),
            (
                quad([-0.8, 1.2, -0.8], [0.8, 0.0, 0.0], [0.0, 0.0, 1.6]),
                area_light([0.3; 3], [1.0; 3]),
            ),
            (sphere(DVec3::new(0.6, -0.3, 0.5), 0.35, 8), rough.clone()),
        ]));
        scene.lights.push(sun(Vec3::new(0.8, 0.5, -0.3), Vec3::splat(0.3), 0.4));
        scene.environment.constant = Vec3::splat(0.05);
        let by = |light_sampling, spp, seed| {
            rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
        };
        let both = by(LightSampling::Both, 96, 50 + k as u64);
        let paths = by(LightSampling::Paths, 256, 60 + k as u64);
        assert_same(&format!("fires beside other light, {sigma_t:?}"), &both, &paths, 1.7e-3);
    }
}

/// A ball of 32^3 voxels around `centre` of radius `radius`, with extinction `sigma_t` and emission
/// `color` per length.
fn ball(centre: DVec3, radius: f64, sigma_t: f32, albedo: f32, color: [f32; 3]) -> Volume {
    let values: Vec<f32> = (0..32 * 32 * 32)
        .map(|i| {
            let at = DVec3::new((i / 1024) as f64, (i / 32 % 32) as f64, (i % 32) as f64);
            if (at - 15.5).length() <= 15.0 { 1.0 } else { 0.0 }
        })
        .collect();
    let tree = Tree::from_dense(0.0f32, [0; 3], [32; 3], &values);
    let options = VoxelGridOptions { interpolation: Interpolation::Nearest };
    let grid = Arc::new(VoxelGrid::from_tree(&tree, &options).unwrap());
    let index_to_world = DAffine3::from_translation(centre)
        * DAffine3::from_scale(DVec3::splat(radius / 15.0))
        * DAffine3::from_translation(DVec3::splat(-15.5));
    let medium = Medium::from_grid(
        Arc::clone(&grid),
        index_to_world,
        [sigma_t; 3],
        Albedo::Constant([albedo; 3]),
        Phase::Isotropic,
    );
    let source = EmissionSource::Grid { grid, color };
    Volume {
        name: "ball".into(),
        medium: Arc::new(medium.unwrap()),
        emission: Some(Arc::new(EmissionField::new(source, index_to_world).unwrap())),
        source: VolumeSource::Homogeneous,
    }
}

/// A glowing ball over a diffuse floor. Light falls off as from its centre, as gravity does:
/// irradiance is `j V cos / r^2` for emission `j` of volume `V`. By paths that are drawn to it, and
/// by paths alone.
#[test]
fn a_glowing_ball_lights_a_floor_by_newtons_law() {
    let centre = DVec3::new(0.2, 0.8, -0.1);
    let volume = ball(centre, 0.3, 0.0, 0.0, [2.0, 1.0, 0.5]);
    let voxels = (0..32 * 32 * 32)
        .filter(|i| {
            let at = DVec3::new((i / 1024) as f64, (i / 32 % 32) as f64, (i % 32) as f64);
            (at - 15.5).length() <= 15.0
        })
        .count();
    let v = voxels as f64 * (0.3f64 / 15.0).powi(3);
    // All rays descend from below the ball: they see the floor alone.
    let mut scene = floor_scene(&[floor(1.0, 0.6)]);
    scene.volumes.push(volume);
    for (light_sampling, spp) in [(LightSampling::Both, 64), (LightSampling::Paths, 256)] {
        let image = rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, 4) });
        check_floor(&scene, &image, centre, v);
    }
}

fn check_floor(scene: &Scene, image: &Rendered, centre: DVec3, v: f64) {
    assert_expected("ball over floor", image, 3.5e-3, |x, y| {
        let mut sum = 0.0;
        for i in 0..16 {
            let sub = [f64::from(i % 4) / 4.0 + 0.125, f64::from(i / 4) / 4.0 + 0.125];
            let (o, d) = scene.camera.ray([f64::from(x) + sub[0], f64::from(y) + sub[1]]);
            let p = crate::on_floor((o, d.as_dvec3()));
            let to = centre - p;
            let lit = p.x.abs() < 1.0 && p.z.abs() < 1.0;
            sum += if lit { to.y / to.length().powi(3) } else { 0.0 };
        }
        let e = 0.6 / std::f64::consts::PI * v * sum / 16.0;
        [2.0 * e, e, 0.5 * e]
    });
}
/// A cube that glows and absorbs: `e / sigma_t (1 - exp(-sigma_t d))` along every ray, and what is
/// behind it. In front of a wall half way through, too.
#[test]
fn a_glowing_cube_is_the_closed_form() {
    for (k, sigma_t) in [[2.0f32; 3], [3.0, 0.7, 0.0], [0.0; 3]].into_iter().enumerate() {
        let color = [1.0f32, 0.5, 2.0];
        let mut scene = scene(Vec::new(), DVec3::new(1.5, 1.0, 3.0), DVec3::ZERO, 22.0);
        scene.volumes.push(glowing_cube(1.0, sigma_t, [0.0; 3], color));
        scene.environment.constant = Vec3::splat(0.4);
        for wall in [false, true] {
            if wall {
                // Black, and larger than what is seen.
                let plane = quad([-4.0, -4.0, 0.1], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0]);
                scene.surfaces = Some(surfaces(&[(plane, lambert([0.0; 3]))]));
            }
            let image = rendered(&scene, &point_filter(64, 20 + k as u64));
            assert_expected(
                &format!("sigma_t {sigma_t:?}, wall {wall}"),
                &image,
                1.7e-3,
                |x, y| {
                    let (o, d) = pixel_ray(&scene, x, y);
                    let (t0, t1) = cube_span(o, d, 1.0).unwrap_or((0.0, 0.0));
                    let t1 = if wall { t1.min((0.1 - o.z) / d.z) } else { t1 };
                    let (length, behind) = ((t1 - t0).max(0.0), if wall { 0.0 } else { 0.4 });
                    [0, 1, 2].map(|c| {
                        let (s, e) = (f64::from(sigma_t[c]), f64::from(color[c]));
                        let glow = if s > 0.0 { -(-s * length).exp_m1() / s } else { length };
                        e * glow + behind * (-s * length).exp()
                    })
                },
            );
        }
    }
}
