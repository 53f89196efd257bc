//! Scenes and statistics that the cross-crate tests share.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DAffine3, DVec3, Vec3};
use pileus_film::{Film, Image};
use pileus_integrator::{Counters, Plan, RenderSettings, Unmonitored, render};
use pileus_media::{
    Albedo, GridMedium, HomogeneousMedium, Interpolation, Medium, Phase, VoxelGrid,
    VoxelGridOptions,
};
use pileus_scene::{Camera, Environment, Light, Scene, Sun, Volume, VolumeSource};
use pileus_vdb::{Tree, VdbFile};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A volume of the repository's `scenes/assets`, trilinear.
pub fn asset_medium(name: &str, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    let file = VdbFile::open(root().join("scenes/assets").join(name)).expect("an asset");
    let grid = file.read(file.find("density").expect("a density grid")).expect("a sound grid");
    let matrix = grid.info.transform.index_to_world().expect("a linear transform");
    let index_to_world = pileus_scene::volume::affine(matrix);
    let tree = grid.to_float().expect("a scalar grid");
    grid_medium(&tree, Interpolation::Trilinear, index_to_world, sigma_t, albedo, phase)
}

/// A medium from a tree.
pub fn grid_medium(
    tree: &Tree<f32>,
    interpolation: Interpolation,
    index_to_world: DAffine3,
    sigma_t: [f32; 3],
    albedo: [f32; 3],
    phase: Phase,
) -> Medium {
    let grid = VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation }).expect("a grid");
    let albedo = Albedo::Constant(albedo);
    let medium = GridMedium::new(Arc::new(grid), index_to_world, sigma_t, albedo, phase);
    Medium::Grid(medium.expect("a medium"))
}

/// A cube of edge `2 half` around the origin with the same extinction everywhere, as a grid of 16^3 voxels.
pub fn cube_grid(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &[1.0; 16 * 16 * 16]);
    // Under nearest interpolation voxel i fills [i - 1/2, i + 1/2).
    let scale = DAffine3::from_scale(DVec3::splat(half / 8.0));
    let index_to_world = scale * DAffine3::from_translation(DVec3::splat(-7.5));
    grid_medium(&tree, Interpolation::Nearest, index_to_world, sigma_t, albedo, phase)
}

/// A cube of edge `2 half` around the origin whose voxels differ wildly from their neighbours: most tentative collisions are null.
pub fn lumpy_grid(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    // Values 0.1 to 3, skewed, from a hash of the voxel's number; mean about 0.8.
    let values: Vec<f32> = (0..16u32.pow(3))
        .map(|i| {
            let hash = i.wrapping_mul(2_654_435_761).rotate_left(13).wrapping_mul(2_246_822_519);
            let u = (hash >> 8) as f32 / 16_777_216.0;
            0.1 + 2.9 * u * u * u
        })
        .collect();
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &values);
    let scale = DAffine3::from_scale(DVec3::splat(half / 8.0));
    let index_to_world = scale * DAffine3::from_translation(DVec3::splat(-7.5));
    grid_medium(&tree, Interpolation::Trilinear, index_to_world, sigma_t, albedo, phase)
}

/// The same cube as a homogeneous medium.
pub fn cube_homogeneous(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    let bounds = Some((DVec3::splat(-half), DVec3::splat(half)));
    Medium::Homogeneous(HomogeneousMedium::new(sigma_t, bounds, albedo, phase).expect("a medium"))
}

/// A scene of these media seen from `position` towards `target`, in 64 x 64 pixels.
pub fn scene(media: Vec<Medium>, position: DVec3, target: DVec3, fov_y: f64) -> Scene {
    let camera = Camera::look_at(position, target, DVec3::Y, fov_y, [64, 64]).expect("a camera");
    let volumes = media
        .into_iter()
        .enumerate()
        .map(|(i, medium)| Volume {
            name: format!("volume {i}"),
            medium: Arc::new(medium),
            emission: None,
            source: VolumeSource::Homogeneous,
        })
        .collect();
    Scene {
        camera,
        volumes,
        lights: Vec::new(),
        environment: Environment::default(),
        surfaces: None,
        not_modelled: Vec::new(),
    }
}

/// A sun.
pub fn sun(to_light: Vec3, irradiance: Vec3, angular_diameter: f32) -> Light {
    Light::Sun(Sun { to_light: to_light.normalize(), irradiance, angular_diameter })
}

/// A rendered image with the variance of each pixel's mean.
#[derive(Debug)]
pub struct Rendered {
    /// Mean.
    pub image: Image,
    /// Variance of the mean.
    pub variance: Image,
    /// The film it came from.
    pub film: Film,
    /// Events.
    pub counters: Counters,
}

/// Renders a scene; no lookup may have exceeded its bound and no sample been dropped.
pub fn rendered(scene: &Scene, settings: &RenderSettings) -> Rendered {
    let plan = Plan::new(scene, settings).expect("a plan");
    let mut film = Film::new(scene.camera.resolution(), None).expect("a film");
    let counters = render(scene, &plan, settings, &mut film, &Unmonitored).expect("a render");
    assert_eq!((counters.violations, counters.dropped), (0, 0), "{counters:?}");
    Rendered { image: film.image(), variance: film.variance(), film, counters }
}

/// Settings with this many samples and this seed.
pub fn settings(spp: u64, seed: u64) -> RenderSettings {
    RenderSettings { samples: 0..spp, seed, ..RenderSettings::default() }
}

/// Tests that two renders have the same expectation.
///
/// Null hypothesis: they do. Blocks of 16 x 16 pixels make a normal mean; Bonferroni over blocks, channels and statistics. Fails by
/// chance with probability below 1e-9 if the normal law holds.
pub fn assert_same(what: &str, a: &Rendered, b: &Rendered) {
    let test = pileus_lab::block_z_test(&a.image, &a.variance, &b.image, &b.variance, 16);
    let test = test.expect("images of one size");
    println!(
        "{what}: p {:.3}, max |z| {:.2}, chi2 {:?} of {:?}",
        test.p_value, test.max_abs_z, test.chi2, test.dof
    );
    assert!(
        test.p_value > 1e-9,
        "{what}: p {:e}, max |z| {:.2}, chi2 {:?} of {:?}",
        test.p_value,
        test.max_abs_z,
        test.chi2,
        test.dof
    );
}

/// Tests that a render has a known expectation per pixel, in the manner of [`assert_same`].
pub fn assert_expected(what: &str, a: &Rendered, expected: impl Fn(u32, u32) -> [f64; 3]) {
    let [width, height] = [a.image.width(), a.image.height()];
    let mut image = Image::new(width, height, &["R", "G", "B"]).expect("an image");
    let zero = Image::new(width, height, &["R", "G", "B"]).expect("an image");
    for y in 0..height {
        for x in 0..width {
            for (name, value) in ["R", "G", "B"].into_iter().zip(expected(x, y)) {
                assert!(image.set(name, x, y, value as f32));
            }
        }
    }
    let test = pileus_lab::block_z_test(&a.image, &a.variance, &image, &zero, 16);
    let test = test.expect("images of one size");
    println!("{what}: p {:.3}, max |z| {:.2}", test.p_value, test.max_abs_z);
    for (i, z) in test.z.iter().enumerate().filter(|(_, z)| !(z.abs() < 4.5)) {
        println!("  block {i} of {:?}: z {z:.2}", test.blocks);
    }
    assert!(
        test.p_value > 1e-9,
        "{what}: p {:e}, max |z| {:.2}, chi2 {:?}",
        test.p_value,
        test.max_abs_z,
        test.chi2
    );
}

/// A glTF scene of triangles in memory: each mesh is a list of triangles and its material, as glTF writes it.
pub fn surfaces(meshes: &[(Vec<[[f32; 3]; 3]>, serde_json::Value)]) -> Arc<pileus_scene::Surfaces> {
    use serde_json::{Value, json};
    let (mut bytes, mut views, mut accessors, mut parts) = (Vec::new(), vec![], vec![], vec![]);
    for (i, (triangles, _)) in meshes.iter().enumerate() {
        let corners: Vec<[f32; 3]> = triangles.iter().flatten().copied().collect();
        let reduce = |f: fn(f32, f32) -> f32| {
            corners.iter().copied().reduce(|a, b| [0, 1, 2].map(|k| f(a[k], b[k]))).unwrap()
        };
        let (low, high) = (reduce(f32::min), reduce(f32::max));
        views.push(
            json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 12 * corners.len()}),
        );
        accessors.push(
            json!({"bufferView": i, "componentType": 5126, "count": corners.len(), "type": "VEC3",
            "min": low, "max": high}),
        );
        bytes.extend(corners.iter().flatten().flat_map(|c| c.to_le_bytes()));
        parts.push(json!({"primitives": [{"attributes": {"POSITION": i}, "material": i}]}));
    }
    let nodes: Vec<Value> = (0..meshes.len()).map(|i| json!({"mesh": i})).collect();
    let materials: Vec<&Value> = meshes.iter().map(|(_, material)| material).collect();
    let document = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": (0..meshes.len()).collect::<Vec<_>>()}],
        "nodes": nodes, "meshes": parts, "materials": materials,
        "buffers": [{"uri": "geometry.bin", "byteLength": bytes.len()}],
        "bufferViews": views, "accessors": accessors,
    });
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("geometry.bin"), bytes).expect("a file");
    let rule = pileus_scene::GlassRule::default();
    let path = folder.path().join("scene.gltf");
    let loaded =
        pileus_scene::gltf::parse_with_surfaces(path, document.to_string().as_bytes(), 683.0, rule);
    Arc::new(loaded.expect("a scene").1.surfaces.expect("surfaces"))
}

/// Two triangles: the parallelogram at `corner` with edges `a` and `b`, its front towards `a x b`.
pub fn quad(corner: [f32; 3], a: [f32; 3], b: [f32; 3]) -> Vec<[[f32; 3]; 3]> {
    let [p, a, b] = [corner, a, b].map(Vec3::from_array);
    [[p, p + a, p + a + b], [p, p + a + b, p + b]].map(|t| t.map(|v| v.to_array())).to_vec()
}

/// A sphere of `16 n^2` triangles, front outwards.
pub fn sphere(centre: DVec3, radius: f64, n: u32) -> Vec<[[f32; 3]; 3]> {
    let point = |i: u32, j: u32| {
        let theta = std::f64::consts::PI * f64::from(i) / f64::from(2 * n);
        let phi = std::f64::consts::TAU * f64::from(j % (4 * n)) / f64::from(4 * n);
        let on = DVec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        let on = if i == 0 {
            DVec3::Y
        } else if i == 2 * n {
            DVec3::NEG_Y
        } else {
            on
        };
        (centre + on * radius).as_vec3().to_array()
    };
    let mut triangles = Vec::new();
    for i in 0..2 * n {
        for j in 0..4 * n {
            let (a, b) = (point(i, j), point(i, j + 1));
            let (c, d) = (point(i + 1, j), point(i + 1, j + 1));
            triangles.extend(
                [[a, c, d], [a, d, b]].into_iter().filter(|t| t[0] != t[2] && t[1] != t[2]),
            );
        }
    }
    triangles
}
