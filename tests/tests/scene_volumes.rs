//! Volumes from files: which grid, how dense, where.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use pileus_media::emission::{BlackbodyRadiance, EmissionSource, blackbody};
use pileus_scene::volume::{CLOUD_OPTICAL_DEPTH, DefaultScale, VolumeLoader, VolumeRequest};
use pileus_scene::volume_spec::{
    AlbedoSpec, DensitySpec, EmissionSpec, HomogeneousSpec, Rgb, TransformSpec, VolumeSpec,
};
use pileus_scene::{
    CameraRequest, Error, GlassRule, Place, Scene, SceneRequest, Volume, VolumeSource,
};
use pileus_tests::{rendered, root, settings};
use std::sync::Arc;

fn load(spec: &VolumeSpec, default_scale: DefaultScale) -> Result<Volume, Error> {
    VolumeLoader::default().load(&request(spec, default_scale))
}

fn request(spec: &VolumeSpec, default_scale: DefaultScale) -> VolumeRequest<'_> {
    VolumeRequest {
        spec,
        to_world: DAffine3::IDENTITY,
        fallback_name: "",
        place: &|_| Place { file: None, line: None, column: None, part: None },
        default_scale,
    }
}

fn asset(name: &str) -> VolumeSpec {
    let path = root().join("scenes/assets").join(name);
    VolumeSpec { vdb: Some(path.to_string_lossy().into_owned()), ..VolumeSpec::default() }
}

fn conformance(name: &str) -> VolumeSpec {
    let path = root().join("tests/data/conformance").join(name);
    VolumeSpec { vdb: Some(path.to_string_lossy().into_owned()), ..VolumeSpec::default() }
}

#[test]
fn the_density_is_chosen_by_rule() {
    let grid = |spec: &VolumeSpec| match load(spec, DefaultScale::One).unwrap().source {
        VolumeSource::Vdb { grid, .. } => grid,
        VolumeSource::Homogeneous => panic!("a grid is expected"),
    };
    assert_eq!(grid(&asset("smoke_plume.vdb")), "density");
    assert_eq!(grid(&conformance("names_same.vdb")).split('[').count(), 2);
    let named = VolumeSpec {
        density: Some(DensitySpec { grid: Some("temperature".into()), scale: None }),
        ..asset("smoke_plume.vdb")
    };
    assert_eq!(grid(&named), "temperature");
    let missing = VolumeSpec {
        density: Some(DensitySpec { grid: Some("temprature".into()), scale: None }),
        ..asset("smoke_plume.vdb")
    };
    let error = load(&missing, DefaultScale::One).unwrap_err();
    let cause = std::error::Error::source(&error).unwrap().to_string();
    assert!(cause.contains("temperature"), "{cause}");
}

#[test]
fn a_cloud_is_as_dense_as_a_cloud_whatever_its_size() {
    let scale_of = |spec: &VolumeSpec| match load(spec, DefaultScale::Cloud).unwrap().source {
        VolumeSource::Vdb { density_scale, .. } => density_scale,
        VolumeSource::Homogeneous => panic!("a grid is expected"),
    };
    let one = scale_of(&asset("cumulus_small.vdb"));
    assert!((0.1..2.0).contains(&one), "{one}");
    let larger = VolumeSpec {
        transform: Some(TransformSpec { scale: Some([10.0; 3]), ..TransformSpec::default() }),
        ..asset("cumulus_small.vdb")
    };
    assert!((scale_of(&larger) * 10.0 / one - 1.0).abs() < 1e-6);
    const { assert!(CLOUD_OPTICAL_DEPTH > 10.0) };
}

#[test]
fn extinction_is_per_scene_unit_after_all_transforms() {
    let spec = |scale: f64| VolumeSpec {
        transform: Some(TransformSpec {
            scale: Some([scale; 3]),
            translation: Some([5.0, 6.0, 7.0]),
            ..TransformSpec::default()
        }),
        ..asset("syn_sphere.vdb")
    };
    let medium = |scale: f64| load(&spec(scale), DefaultScale::One).unwrap().medium;
    let (small, large) = (medium(1.0), medium(3.0));
    let move_to = DVec3::new(5.0, 6.0, 7.0);
    for p in [DVec3::ZERO, DVec3::new(0.3, -0.2, 0.1), DVec3::new(-0.5, 0.4, 0.6)] {
        let (a, b) = (small.sigma_t_at(p + move_to), large.sigma_t_at(p * 3.0 + move_to));
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

#[test]
fn volumes_of_one_grid_share_it() {
    let mut loader = VolumeLoader::default();
    let spec = asset("syn_sphere.vdb");
    let twin = VolumeSpec {
        density: Some(DensitySpec { grid: None, scale: Some(7.0) }),
        transform: Some(TransformSpec {
            translation: Some([9.0, 0.0, 0.0]),
            ..TransformSpec::default()
        }),
        ..spec.clone()
    };
    let a = loader.load(&request(&spec, DefaultScale::One)).unwrap();
    let b = loader.load(&request(&twin, DefaultScale::One)).unwrap();
    let (a, b) = (a.medium.grid().unwrap(), b.medium.grid().unwrap());
    assert!(Arc::ptr_eq(a.voxels(), b.voxels()));
    assert!(loader.seconds_build > 0.0);
}

/// Two hundred nodes that name one file: voxels are stored once, each cloud stands where its node
/// does, and all of them render.
#[test]
fn a_field_of_instanced_clouds_holds_one_grid() {
    let path = root().join("scenes/cloud_field.gltf");
    let scene = Scene::load(SceneRequest {
        gltf: Some((path.clone(), 683.0)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera: CameraRequest::Auto { fov_y_degrees: 35.0, orbit: None },
        lens: None,
        lights: Vec::new(),
        environment: None,
        resolution: Some([48, 27]),
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    })
    .unwrap()
    .scene;
    let media: Vec<_> = scene.volumes.iter().map(|volume| volume.medium.grid().unwrap()).collect();
    assert_eq!(media.len(), 200);
    assert!(media.iter().all(|medium| Arc::ptr_eq(medium.voxels(), media[0].voxels())));

    let document: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let nodes = document["nodes"].as_array().unwrap();
    let placed: Vec<DAffine3> = nodes
        .iter()
        .filter(|node| node["extensions"].is_object())
        .map(|node| {
            let rotation = DQuat::from_slice(&numbers(&node["rotation"])).normalize();
            let [translation, scale] =
                ["translation", "scale"].map(|key| DVec3::from_slice(&numbers(&node[key])));
            DAffine3::from_scale_rotation_translation(scale, rotation, translation)
        })
        .collect();
    for p in [DVec3::new(0.0, 150.0, 0.0), DVec3::new(-40.0, 120.0, 30.0)] {
        let first = media[0].sigma_t_at(placed[0].transform_point3(p));
        assert!(first > 0.01, "{first}");
        for (medium, to_world) in media.iter().zip(&placed) {
            // Extinction is per scene unit, whatever the node's scale; positions are rounded to
            // single precision in voxels.
            let found = medium.sigma_t_at(to_world.transform_point3(p));
            assert!((found / first - 1.0).abs() < 1e-3, "{found} {first}");
        }
    }

    let counters = rendered(&scene, &settings(1, 0)).counters;
    assert!(counters.collisions > counters.paths, "{counters:?}");
}

#[test]
fn frustums_and_empty_grids_do_not_panic() {
    let error = load(&conformance("frustum.vdb"), DefaultScale::One).unwrap_err();
    let cause = std::error::Error::source(&error).unwrap().to_string();
    assert!(matches!(error, Error::Vdb { .. }), "{error}");
    assert!(cause.contains("frustum.vdb") && cause.contains("NonlinearFrustumMap"), "{cause}");
    for name in [
        "empty_grid.vdb",
        "single_voxel.vdb",
        "nan_inf_negative.vdb",
        "root_tile.vdb",
        "scale_negative.vdb",
    ] {
        for scale in [DefaultScale::One, DefaultScale::Cloud] {
            // Some are refused; none may panic.
            let _ = load(&conformance(name), scale);
        }
    }
    for entry in std::fs::read_dir(root().join("tests/data/conformance/broken")).unwrap() {
        let path = entry.unwrap().path();
        let spec =
            VolumeSpec { vdb: Some(path.to_string_lossy().into_owned()), ..VolumeSpec::default() };
        let _ = load(&spec, DefaultScale::Cloud);
    }
}

fn emitting(emission: &str) -> VolumeSpec {
    let emission: EmissionSpec = serde_json::from_str(emission).unwrap();
    VolumeSpec {
        emission: Some(emission),
        albedo: Some(AlbedoSpec::Constant(Rgb::Grey(0.25))),
        density: Some(DensitySpec { grid: None, scale: Some(4.0) }),
        ..asset("fire_0003.vdb")
    }
}

/// Emission is what the job says, at voxels, in the world; the density neither adds nor dims.
#[test]
fn emission_is_what_the_job_says() {
    let ramp = r#"[{"value": 0, "color": 0}, {"value": 0.5, "color": [1, 0.5, 0]}]"#;
    let jobs = [
        r#"{"type": "grid", "grid": "flame", "color": [1, 0.35, 0.08], "scale": 20}"#.to_owned(),
        format!(r#"{{"type": "grid", "grid": "flame", "scale": 3, "ramp": {ramp}}}"#),
        r#"{"type": "blackbody", "intensity": 2, "temperature": {"grid": "temperature", "scale": 1000}}"#
            .to_owned(),
        r#"{"type": "blackbody", "normalised": true,
            "temperature": {"grid": "temperature", "scale": 900, "offset": 100}}"#
            .to_owned(),
        r#"{"type": "grid", "grid": "velocity", "color": [1, 2, 3]}"#.to_owned(),
    ];
    let file = pileus_vdb::VdbFile::open(root().join("scenes/assets/fire_0003.vdb")).unwrap();
    let tree = |name: &str| file.read(file.find(name).unwrap()).unwrap();
    let number = |name: &str| tree(name).to_float().unwrap();
    let (flame, heat, density) = (number("flame"), number("temperature"), number("density"));
    let pileus_vdb::Values::Vec3f(velocity) = tree("velocity").values else { panic!() };
    for (kind, job) in jobs.iter().enumerate() {
        let spec = VolumeSpec {
            transform: Some(TransformSpec {
                scale: Some([2.0; 3]),
                translation: Some([5.0, 0.0, 0.0]),
                ..TransformSpec::default()
            }),
            ..emitting(job)
        };
        let volume = load(&spec, DefaultScale::One).unwrap();
        let field = volume.emission.unwrap();
        let (mut lit, mut largest, mut worst) = (0, 0.0f32, 0.0f32);
        for i in 0..9000 {
            let at = [14 + i % 30, 13 + i / 30 % 26, 2 + i / 780];
            let p = DVec3::new(5.0, 0.0, 0.0) + 0.075 * DVec3::from_array(at.map(f64::from));
            let value = |tree: &pileus_vdb::Tree<f32>| tree.value(at).0;
            let kelvin = |scale: f64| scale * f64::from(value(&heat));
            let expected = match kind {
                0 => Vec3::new(20.0, 7.0, 1.6) * value(&flame),
                1 => Vec3::new(3.0, 1.5, 0.0) * (2.0 * value(&flame)).min(1.0),
                2 => 6.0 * value(&density) * blackbody(kelvin(1000.0), BlackbodyRadiance::Absolute),
                3 => {
                    let le = blackbody(kelvin(900.0) + 100.0, BlackbodyRadiance::Normalised);
                    3.0 * value(&density) * le
                }
                _ => {
                    Vec3::from_array(velocity.value(at).0).max(Vec3::ZERO)
                        * Vec3::new(1.0, 2.0, 3.0)
                }
            };
            let found = field.emission(p);
            largest = largest.max(expected.max_element());
            worst =
                worst.max((found - expected).abs().max_element() - 1e-4 * expected.max_element());
            lit += usize::from(expected.max_element() > 0.0);
        }
        assert!(lit > 1000, "{kind}: {lit}");
        // The file's voxel size is 0.0375 in single precision: points lie beside voxels by 1e-6 of
        // one.
        assert!(worst <= 2e-5 * largest, "{kind}: {worst} of {largest}");
    }
}

/// The grids of light and of density come from one cache, and a volume may be clear and still
/// shine.
#[test]
fn emission_shares_grids_and_needs_no_density() {
    let flames = r#"{"type": "grid", "grid": "density"}"#;
    let clear = VolumeSpec {
        density: Some(DensitySpec { grid: None, scale: Some(0.0) }),
        ..emitting(flames)
    };
    let mut loader = VolumeLoader::default();
    let volume = loader.load(&request(&clear, DefaultScale::One)).unwrap();
    let medium = volume.medium.grid().unwrap();
    assert_eq!(medium.sigma_t_scale(), 0.0);
    let field = volume.emission.unwrap();
    assert!(field.power() > 0.0);
    let EmissionSource::Grid { grid, .. } = field.source() else { panic!() };
    assert!(Arc::ptr_eq(grid, medium.voxels()));
    let again = loader.load(&request(&emitting(flames), DefaultScale::One)).unwrap();
    let EmissionSource::Grid { grid: other, .. } = again.emission.as_ref().unwrap().source() else {
        panic!()
    };
    assert!(Arc::ptr_eq(grid, other));
}

#[test]
fn faults_of_emission_are_placed() {
    let fault = |spec: &VolumeSpec| {
        let request = VolumeRequest {
            place: &|key| Place { part: Some(key.to_owned()), ..Place::default() },
            ..request(spec, DefaultScale::One)
        };
        let error = VolumeLoader::default().load(&request).unwrap_err();
        (error.place().part.clone().unwrap(), format!("{error}; {}", error.remedy()))
    };
    for (job, pointer) in [
        (r#"{"type": "grid", "grid": "flames"}"#, "/emission/grid"),
        (r#"{"type": "grid", "grid": "flame", "scale": -1}"#, "/emission/scale"),
        (r#"{"type": "grid", "grid": "flame", "color": -1}"#, "/emission/color"),
        (
            r#"{"type": "grid", "grid": "flame", "color": 1, "ramp": [{"value": 0, "color": 0}]}"#,
            "/emission/color",
        ),
        (r#"{"type": "grid", "grid": "flame", "ramp": []}"#, "/emission/ramp"),
        (
            r#"{"type": "grid", "grid": "flame", "ramp": [{"value": 0, "color": [0, -1, 0]}]}"#,
            "/emission/ramp/0/color",
        ),
        (
            r#"{"type": "grid", "grid": "flame", "ramp": [{"value": 1, "color": 0}, {"value": 0, "color": 1}]}"#,
            "/emission/ramp",
        ),
        // White where there is nothing: light without end.
        (r#"{"type": "grid", "grid": "flame", "ramp": [{"value": 1, "color": 1}]}"#, "/emission"),
        (
            r#"{"type": "grid", "grid": "velocity", "ramp": [{"value": 0, "color": 0}]}"#,
            "/emission/ramp",
        ),
        (
            r#"{"type": "blackbody", "temperature": {"grid": "velocity"}}"#,
            "/emission/temperature/grid",
        ),
        (r#"{"type": "blackbody", "temperature": {"grid": "heat"}}"#, "/emission/temperature/grid"),
        (
            r#"{"type": "blackbody", "temperature": {"grid": "temperature", "scale": -1}}"#,
            "/emission/temperature/scale",
        ),
        (
            r#"{"type": "blackbody", "intensity": -1, "temperature": {"grid": "temperature"}}"#,
            "/emission/intensity",
        ),
    ] {
        let (place, said) = fault(&emitting(job));
        assert_eq!(place, pointer, "{job}: {said}");
    }
    let fog = VolumeSpec {
        homogeneous: Some(HomogeneousSpec { sigma_t: 1.0, bounds: None }),
        emission: emitting(r#"{"type": "grid", "grid": "flame"}"#).emission,
        ..VolumeSpec::default()
    };
    let (place, said) = fault(&fog);
    assert_eq!(place, "/emission");
    assert!(said.contains("two volumes that overlap"), "{said}");
}
