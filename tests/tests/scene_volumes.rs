//! Volumes from files: which grid, how dense, where.

use glam::{DAffine3, DVec3};
use pileus_media::Medium;
use pileus_scene::volume::{
    CLOUD_OPTICAL_DEPTH, DefaultScale, UnrenderedEmission, VolumeLoader, VolumeRequest,
};
use pileus_scene::volume_spec::{DensitySpec, TransformSpec, VolumeSpec};
use pileus_scene::{Error, Place, Volume, VolumeSource};
use pileus_tests::root;
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
        emission: UnrenderedEmission::Refuse,
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
    let medium = |scale: f64| match &*load(&spec(scale), DefaultScale::One).unwrap().medium {
        Medium::Grid(medium) => medium.clone(),
        Medium::Homogeneous(_) => panic!("a grid is expected"),
    };
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
    let (Medium::Grid(a), Medium::Grid(b)) = (&*a.medium, &*b.medium) else { panic!() };
    assert!(Arc::ptr_eq(a.grid(), b.grid()));
    assert!(loader.seconds_build > 0.0);
}

#[test]
fn frustums_and_empty_grids_do_not_panic() {
    assert!(load(&conformance("frustum.vdb"), DefaultScale::One).is_err());
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
