//! Surfaces and light from volumes in whole pictures: closed forms, furnaces, techniques against each other.

use glam::{DAffine3, DVec3, Vec3};
use pileus_integrator::{LightSampling, RenderSettings};
use pileus_media::{
    Albedo, EmissionField, EmissionSource, GridMedium, Interpolation, Medium, Phase, VoxelGrid,
    VoxelGridOptions,
};
use pileus_scene::volume::DefaultScale;
use pileus_scene::{
    CameraRequest, Environment, GlassRule, Place, Scene, SceneRequest, Volume, VolumeSource,
};
use pileus_tests::{
    Rendered, assert_expected, assert_same, quad, rendered, root, scene, settings, sphere, surfaces,
};
use pileus_vdb::Tree;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

/// A Blender export of `tests/data/gltf` with its volume.
fn blender(scene: &str, volume: &str, resolution: [u32; 2]) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let gltf = folder.path().join("gltf");
    std::fs::create_dir(&gltf).unwrap();
    std::fs::copy(root().join("tests/data/gltf").join(scene), gltf.join(scene)).unwrap();
    std::fs::copy(root().join("scenes/assets").join(volume), folder.path().join(volume)).unwrap();
    let path: PathBuf = gltf.join(scene);
    let request = SceneRequest {
        gltf: Some((path, 683.0)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera: CameraRequest::Auto { fov_y_degrees: 35.0 },
        lights: Vec::new(),
        environment: None,
        resolution: Some(resolution),
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    };
    Scene::load(request).unwrap().scene
}

/// Fire that lights a floor and smoke: shadow rays and paths together give what paths alone do.
#[test]
fn fire_by_both_techniques_is_fire_by_paths() {
    let scene = blender("fire.glb", "fire_0003.vdb", [64, 64]);
    let by = |light_sampling, spp, seed| {
        rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, seed) })
    };
    let both = by(LightSampling::Both, 64, 1);
    let paths = by(LightSampling::Paths, 1024, 2);
    assert_same("fire", &both, &paths);
}

/// A ball of 32^3 voxels around `centre` of radius `radius`, with extinction `sigma_t` and emission `color` per length.
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
    let medium = GridMedium::new(
        Arc::clone(&grid),
        index_to_world,
        [sigma_t; 3],
        Albedo::Constant([albedo; 3]),
        Phase::Isotropic,
    );
    let source = EmissionSource::Grid { grid, color };
    Volume {
        name: "ball".into(),
        medium: Arc::new(Medium::Grid(medium.unwrap())),
        emission: Some(Arc::new(EmissionField::new(source, index_to_world).unwrap())),
        source: VolumeSource::Homogeneous,
    }
}

/// A diffuse floor of albedo `albedo` in the plane y = 0, `2 half` wide.
fn floor(half: f32, albedo: f32) -> (Vec<[[f32; 3]; 3]>, serde_json::Value) {
    let plane = quad([-half, 0.0, -half], [0.0, 0.0, 2.0 * half], [2.0 * half, 0.0, 0.0]);
    let material = json!({"pbrMetallicRoughness": {"baseColorFactor": [albedo, albedo, albedo, 1.0], "metallicFactor": 0.0},
        "extensions": {"KHR_materials_ior": {"ior": 1.0}}});
    (plane, material)
}

/// Where a pixel's ray meets the plane y = 0.
fn on_floor(scene: &Scene, x: u32, y: u32, sub: [f64; 2]) -> DVec3 {
    let (o, d) = scene.camera.ray([f64::from(x) + sub[0], f64::from(y) + sub[1]]);
    let d = d.as_dvec3();
    o - d * (o.y / d.y)
}

/// A glowing ball over a diffuse floor. Light falls off as from its centre, as gravity does: irradiance is `j V cos / r^2` for emission `j` of volume `V`. By shadow rays
/// and paths together, and by paths alone.
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
    let mut scene = scene(Vec::new(), DVec3::new(0.0, 3.0, 0.1), DVec3::ZERO, 30.0);
    // All rays descend from below the ball: they see the floor alone.
    let eye = DVec3::new(0.0, 0.45, 1.5);
    let target = DVec3::new(0.0, 0.0, 0.2);
    scene.camera = pileus_scene::Camera::look_at(eye, target, DVec3::Y, 15.0, [64, 64]).unwrap();
    scene.volumes.push(volume);
    scene.surfaces = Some(surfaces(&[floor(1.0, 0.6)]));
    scene.environment = Environment::default();
    let scene = scene;
    for (light_sampling, spp) in [(LightSampling::Both, 64), (LightSampling::Paths, 512)] {
        let image = rendered(&scene, &RenderSettings { light_sampling, ..settings(spp, 4) });
        check_floor(&scene, &image, centre, v);
    }
}

fn check_floor(scene: &Scene, image: &Rendered, centre: DVec3, v: f64) {
    assert_expected("ball over floor", image, |x, y| {
        let mut sum = 0.0;
        for i in 0..16 {
            let p = on_floor(
                scene,
                x,
                y,
                [f64::from(i % 4) / 4.0 + 0.125, f64::from(i / 4) / 4.0 + 0.125],
            );
            let to = centre - p;
            let lit = p.x.abs() < 1.0 && p.z.abs() < 1.0;
            sum += if lit { to.y / to.length().powi(3) } else { 0.0 };
        }
        let e = 0.6 / std::f64::consts::PI * v * sum / 16.0;
        [2.0 * e, e, 0.5 * e]
    });
}
/// Rays that leave a floor at height zero, which no coordinate of its own keeps them off, do not hit it.
#[test]
fn rays_leave_planes_through_the_origin() {
    use pileus_media::random::uniform;
    use rand_pcg::Pcg32;
    let mut rng = Pcg32::new(1, 1);
    for axis in 0..3 {
        let turn = |p: [f32; 3]| [0, 1, 2].map(|k| p[(k + axis) % 3]);
        let (plane, material) = floor(5.0, 0.5);
        let plane: Vec<_> = plane.into_iter().map(|t| t.map(turn)).collect();
        let surfaces = surfaces(&[(plane, material)]);
        let up = Vec3::from_array(turn([0.0, 1.0, 0.0]));
        for _ in 0..5000 {
            let mut u = || 9.0 * (uniform(&mut rng) - 0.5);
            let from = Vec3::from_array(turn([u(), 2.0, u()]));
            let Some(hit) = surfaces.intersect(from.as_dvec3(), -up, 1e9, &mut rng) else {
                panic!("{from} misses")
            };
            let interaction = surfaces.interaction(&hit, -up);
            let mut u = || uniform(&mut rng) - 0.5;
            let wi = Vec3::from_array(turn([u(), 0.5 * u().abs() + 1e-4, u()])).normalize();
            let origin = interaction.spawn(wi);
            assert!(surfaces.intersect(origin, wi, 1e9, &mut rng).is_none(), "{origin} {wi}");
        }
    }
}
