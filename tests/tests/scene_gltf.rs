//! Scenes that Blender exported: the right camera, lights and volumes in the right place.

use glam::{DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::{Albedo, Phase};
use pileus_scene::volume::DefaultScale;
use pileus_scene::{CameraRequest, Error, GlassRule, Light, Loaded, Place, Scene, SceneRequest};
use pileus_tests::root;
use pileus_vdb::VdbFile;
use std::path::{Path, PathBuf};

/// A folder with a scene of `tests/data/gltf` and the volume it names one folder up.
fn arrange(scene: &str, volume: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let gltf = folder.path().join("gltf");
    std::fs::create_dir(&gltf).unwrap();
    for file in [scene, "studio.bin"] {
        std::fs::copy(root().join("tests/data/gltf").join(file), gltf.join(file)).unwrap();
    }
    let asset = root().join("scenes/assets").join(volume);
    std::fs::copy(asset, folder.path().join(volume)).unwrap();
    (folder, gltf.join(scene))
}

fn load(path: &Path, resolution: Option<[u32; 2]>, lumens_per_watt: f64) -> Result<Loaded, Error> {
    Scene::load(SceneRequest {
        gltf: Some((path.to_owned(), lumens_per_watt)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera: CameraRequest::Auto { fov_y_degrees: 35.0, orbit: None },
        lens: None,
        lights: Vec::new(),
        environment: None,
        resolution,
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    })
}

#[test]
fn studio_has_its_camera_and_lights() {
    let (_folder, path) = arrange("studio.gltf", "smoke_plume.vdb");
    let loaded = load(&path, None, 683.0).unwrap();
    let scene = loaded.scene;
    let camera = &scene.camera;
    assert_eq!(camera.resolution(), [640, 360]);
    assert!((camera.position() - DVec3::new(0.2, 2.4, 8.5)).length() < 1e-6);
    // Turned about X by 2 asin(-0.06104852...): seven degrees down.
    let seven = 7f64.to_radians();
    assert!((camera.forward() - DVec3::new(0.0, -seven.sin(), -seven.cos())).length() < 1e-6);
    assert!((camera.fov_y_degrees().unwrap() - 38.0).abs() < 1e-3);

    let [Light::Sun(sun), Light::Point(bulb), Light::Spot(spot)] = scene.lights.as_slice() else {
        panic!("{:?}", scene.lights);
    };
    // Blender: a sun of 2 W/m2, a bulb of 60 W and a spot of 300 W, over 4 pi.
    assert!((sun.irradiance - Vec3::splat(2.0)).length() < 1e-5);
    let tau = std::f32::consts::TAU;
    let per_steradian = 60.0 / (2.0 * tau);
    let colour = Vec3::new(0.6, 0.8, 1.0);
    assert!((bulb.intensity - colour * per_steradian).length() < 1e-4, "{}", bulb.intensity);
    assert!((bulb.position - DVec3::new(2.2, 2.2, -1.0)).length() < 1e-6);
    assert!((spot.intensity - Vec3::splat(300.0 / (2.0 * tau))).length() < 1e-3);
    assert!((spot.cos_outer - 20f32.to_radians().cos()).abs() < 1e-6);
    // Each shines down, and its rotation maps -Z to where it shines.
    let q = glam::Quat::from_xyzw(-0.350_306_07, 0.271_078_17, 0.009_075_528, 0.896_504_3);
    assert!((sun.to_light - q * Vec3::Z).length() < 1e-6);
    assert!(sun.to_light.y > 0.5 && spot.direction.y < -0.3);
    assert!(scene.environment.is_black());
    // Surfaces, their materials and the area light are modelled.
    assert!(scene.not_modelled.is_empty(), "{:?}", scene.not_modelled);
    let surfaces = scene.surfaces.as_ref().unwrap();
    assert_eq!((surfaces.counts().triangles, surfaces.emitters().len()), (3182, 2));
    assert!(loaded.notes.iter().any(|note| note.contains("`glass` fills closed meshes")));

    let watts = load(&path, None, 1.0).unwrap().scene;
    let [Light::Sun(sun), ..] = watts.lights.as_slice() else { panic!() };
    assert_eq!(sun.irradiance, Vec3::splat(1366.0));
}

#[test]
fn studio_smoke_is_turned_scaled_and_placed() {
    let (folder, path) = arrange("studio.gltf", "smoke_plume.vdb");
    let scene = load(&path, None, 683.0).unwrap().scene;
    let [volume] = scene.volumes.as_slice() else { panic!() };
    assert_eq!(volume.name, "smoke");
    let medium = &volume.medium;
    assert!(matches!(medium.phase(), Phase::HenyeyGreenstein { g } if *g == 0.3));
    let Albedo::Constant(albedo) = medium.optics().albedo() else { panic!() };
    assert_eq!(*albedo, [0.8, 0.8, 0.85]);

    // By hand: voxel 1/32, Z up to Y up, scale 1.2, 25 degrees about Y, translation.
    let q = [0.0, 0.216_439_604_759_216_3, 0.0, 0.976_296_007_633_209_2];
    let (sin, cos) = (2.0 * q[1] * q[3], 1.0 - 2.0 * q[1] * q[1]);
    let to_world = |i: f64, j: f64, k: f64| {
        let [x, y, z] = [i / 32.0, k / 32.0, -j / 32.0].map(|c: f64| c * 1.2);
        DVec3::new(cos * x + sin * z + 0.3, y, -sin * x + cos * z - 0.6)
    };
    let file = VdbFile::open(folder.path().join("smoke_plume.vdb")).unwrap();
    let tree = file.read(file.find("density").unwrap()).unwrap().to_float().unwrap();
    let mut checked = 0;
    for active in tree.active_values().step_by(997) {
        let [i, j, k] = active.origin.map(f64::from);
        let expected = 8.0 * f64::from(active.value);
        let found = medium.sigma_t_at(to_world(i, j, k));
        // The node's numbers are single precision, and values change over a voxel.
        assert!((found - expected).abs() < 1e-4 * (1.0 + expected), "{found} {expected}");
        checked += 1;
    }
    assert!(checked > 100);
    let Bounds3 { low, high } = volume.medium.bounds_world().unwrap();
    assert!(low.y >= -0.1 && high.y > 2.0, "the plume rises: {low} {high}");
}

#[test]
fn fire_loads_with_its_flames() {
    let (_folder, path) = arrange("fire.glb", "fire_0003.vdb");
    let loaded = load(&path, None, 683.0).unwrap();
    let scene = loaded.scene;
    assert_eq!(scene.camera.resolution(), [640, 640]);
    assert!((scene.camera.fov_y_degrees().unwrap() - 40.0).abs() < 1e-3);
    assert!((scene.camera.position() - DVec3::new(0.0, 1.7, 5.2)).length() < 1e-6);
    // No light in the file but the fire's own: no sky is added.
    assert!(!loaded.notes.iter().any(|note| note.contains("default sky")));
    assert!(scene.environment.is_black() && scene.emissive_volumes().count() == 1);
    assert!(!scene.not_modelled.iter().any(|item| item.contains("emission")));
    let Bounds3 { low, high } = scene.volumes[0].medium.bounds_world().unwrap();
    // Voxels of 0.0375 in a box of 53 x 53 x 96, Z up, moved by (-1, 0, 1): z runs from 1 down to
    // -1.
    assert!(low.x > -1.0 && high.x < 1.0 && low.z > -1.0 && high.z < 1.0, "{low} {high}");
    assert!(low.y > -0.05 && high.y < 2.0);
    // The camera sees it.
    let film = scene.camera.project((low + high) * 0.5).unwrap();
    assert!(film.iter().all(|c| (100.0..540.0).contains(c)), "{film:?}");
    // Flames are Cycles' emission coefficients: 20 x (1, 0.35, 0.08) x flame per metre, where the
    // volume lies in the world.
    let emission = scene.volumes[0].emission.as_ref().unwrap();
    let file = VdbFile::open(root().join("scenes/assets/fire_0003.vdb")).unwrap();
    let flame = file.read(file.find("flame").unwrap()).unwrap().to_float().unwrap();
    let (mut lit, mut sum) = (0, 0.0);
    for active in flame.active_values() {
        let [x, y, z] = active.origin.map(|c| 0.0375 * f64::from(c));
        let p = DVec3::new(x - 1.0, z, 1.0 - y);
        let expected = Vec3::new(20.0, 7.0, 1.6) * active.value;
        let found = emission.emission(p);
        assert!((found - expected).abs().max_element() < 1e-3, "{found} {expected}");
        lit += 1;
        sum += f64::from(active.value);
    }
    assert!(lit > 9000);
    let luminance = 20.0 * 0.2126 + 7.0 * 0.7152 + 1.6 * 0.0722;
    let power = luminance * sum * 0.0375f64.powi(3);
    assert!((emission.power() / power - 1.0).abs() < 1e-3, "{} {power}", emission.power());
}

#[test]
fn cameras_are_found_by_node() {
    let (_folder, path) = arrange("fire.glb", "fire_0003.vdb");
    let request = |name: &str| {
        Scene::load(SceneRequest {
            gltf: Some((path.clone(), 683.0)),
            volumes: Vec::new(),
            volume_place: &|_, _| Place::default(),
            camera: CameraRequest::Node { name: name.into(), place: Place::default() },
            lens: None,
            lights: Vec::new(),
            environment: None,
            resolution: Some([100, 50]),
            default_scale: DefaultScale::One,
            glass_rule: GlassRule::default(),
        })
    };
    assert_eq!(request("Camera").unwrap().scene.camera.resolution(), [100, 50]);
    let error = request("Camera.001").unwrap_err();
    assert!(matches!(error, Error::Missing { .. }));
    assert!(error.remedy().contains("`Camera`"), "{}", error.remedy());
}

#[test]
fn a_missing_volume_is_named_with_its_node() {
    let (folder, path) = arrange("fire.glb", "fire_0003.vdb");
    std::fs::remove_file(folder.path().join("fire_0003.vdb")).unwrap();
    let error = load(&path, None, 683.0).unwrap_err();
    assert!(matches!(error, Error::Vdb { .. }), "{error}");
    assert!(
        error.to_string().contains("fire.glb") && error.to_string().contains("/nodes/2/extras")
    );
}

/// Every byte of a scene changed and every length cut: an error or a scene, never a panic.
#[test]
fn damaged_scenes_never_panic() {
    for name in ["studio.gltf", "fire.glb"] {
        let bytes = std::fs::read(root().join("tests/data/gltf").join(name)).unwrap();
        for at in 0..bytes.len() {
            for change in [0x01, 0x20, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] ^= change;
                let _ = pileus_scene::gltf::parse(name, &damaged, 683.0);
            }
        }
        for length in (0..bytes.len()).step_by(13) {
            let _ = pileus_scene::gltf::parse(name, &bytes[..length], 683.0);
        }
    }
}
