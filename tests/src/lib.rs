//! Scenes and statistics that the cross-crate tests share.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DAffine3, DVec3, Vec3};
use pileus_film::{Film, Filter, Image};
use pileus_integrator::{Counters, RenderSettings, Renderer, Unmonitored};
use pileus_media::emission::{EmissionField, EmissionSource};
use pileus_media::{
    Albedo, Bounds3, ExactField, Interpolation, Medium, Phase, Tally, VoxelGrid, VoxelGridOptions,
    transmittance_function,
};
use pileus_scene::volume::DefaultScale;
use pileus_scene::{
    Camera, CameraRequest, Environment, GlassRule, Light, Place, Scene, SceneRequest, Sun, Volume,
    VolumeSource,
};
use pileus_vdb::{Tree, VdbFile};
use serde_json::{Value, json};
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
    let medium = Medium::from_grid(Arc::new(grid), index_to_world, sigma_t, albedo, phase);
    medium.expect("a medium")
}

/// A cube of edge `2 half` around the origin with the same extinction everywhere, as a grid of 16^3
/// voxels.
pub fn cube_grid(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &[1.0; 16 * 16 * 16]);
    // Under nearest interpolation voxel i fills [i - 1/2, i + 1/2).
    let scale = DAffine3::from_scale(DVec3::splat(half / 8.0));
    let index_to_world = scale * DAffine3::from_translation(DVec3::splat(-7.5));
    grid_medium(&tree, Interpolation::Nearest, index_to_world, sigma_t, albedo, phase)
}

/// A cube of edge `2 half` around the origin whose voxels differ wildly from their neighbours: most
/// tentative collisions are null.
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

/// The cube of [`cube_grid`] that emits `color` per length.
pub fn glowing_cube(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], color: [f32; 3]) -> Volume {
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &[1.0; 16 * 16 * 16]);
    let scale = DAffine3::from_scale(DVec3::splat(half / 8.0));
    let index_to_world = scale * DAffine3::from_translation(DVec3::splat(-7.5));
    let options = VoxelGridOptions { interpolation: Interpolation::Nearest };
    let grid = Arc::new(VoxelGrid::from_tree(&tree, &options).expect("a grid"));
    let source = EmissionSource::Grid { grid, color };
    let emission = EmissionField::new(source, index_to_world).expect("an emission");
    Volume {
        name: "glowing cube".into(),
        medium: Arc::new(cube_grid(half, sigma_t, albedo, Phase::Isotropic)),
        emission: Some(Arc::new(emission)),
        source: VolumeSource::Homogeneous,
    }
}

/// The same cube as a homogeneous medium.
pub fn cube_homogeneous(half: f64, sigma_t: [f32; 3], albedo: [f32; 3], phase: Phase) -> Medium {
    let bounds = Some(Bounds3::new(DVec3::splat(-half), DVec3::splat(half)));
    Medium::homogeneous(sigma_t, bounds, albedo, phase).expect("a medium")
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

/// Transmittance of all media of a scene along a segment from where nothing is correlated with
/// them, per channel; exact, by their optical depths and their transmittance functions.
pub fn transmittance(scene: &Scene, p: DVec3, d: DVec3, t_max: f64) -> DVec3 {
    let mut product = DVec3::ONE;
    for volume in &scene.volumes {
        let medium = &*volume.medium;
        let depth = medium
            .span(p, d.as_vec3(), t_max)
            .map_or(0.0, |span| medium.any_ray(&span, 1.0).optical_depth(&mut Tally::default()));
        let depths = volume.medium.chromatic_ratio().as_dvec3() * depth;
        product *= DVec3::from_array(depths.to_array().map(|depth| {
            match volume.medium.transmittance_function() {
                Some(function) => {
                    function.survival(transmittance_function::StartCorrelation::Uncorrelated, depth)
                }
                None => (-depth).exp(),
            }
        }));
    }
    product
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
    let mut film = Film::new(scene.camera.resolution(), None).expect("a film");
    let counters = Renderer::new(scene, settings)
        .expect("a plan")
        .render(&mut film, &Unmonitored)
        .expect("a render");
    assert_eq!((counters.violations, counters.dropped), (0, 0), "{counters:?}");
    Rendered { image: film.image(), variance: film.variance(), film, counters }
}

/// Settings with this many samples and this seed.
pub fn settings(spp: u64, seed: u64) -> RenderSettings {
    RenderSettings { samples: 0..spp, seed, ..RenderSettings::default() }
}

/// Settings with a filter that is as good as a point: pixels show what [`pixel_ray`] meets.
pub fn point_filter(spp: u64, seed: u64) -> RenderSettings {
    RenderSettings { filter: Filter::Box { radius: 1e-4 }, ..settings(spp, seed) }
}

/// The camera's ray through the middle of a pixel; tests that use it shrink the filter to a point.
pub fn pixel_ray(scene: &Scene, x: u32, y: u32) -> (DVec3, DVec3) {
    let (o, d) = scene.camera.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]);
    (o, d.as_dvec3())
}

/// Where a ray enters and leaves the cube of half edge `half`.
pub fn cube_span(o: DVec3, d: DVec3, half: f64) -> Option<(f64, f64)> {
    let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
    for k in 0..3 {
        let (a, b) = ((-half - o[k]) / d[k], (half - o[k]) / d[k]);
        t0 = t0.max(a.min(b));
        t1 = t1.min(a.max(b));
    }
    (t0 < t1).then_some((t0, t1))
}

/// Tests that two renders have the same expectation.
///
/// Null hypothesis: they do. Blocks of 16 x 16 pixels make a normal mean; Bonferroni over blocks,
/// channels and statistics: fails by chance with probability below 1e-9 if the normal law holds.
/// The differences of whole channels are tested beside them, with 1e-9 in all.
///
/// `power` is the standard error that the difference of the whole images may have, relative to
/// their mean: root of the sum of all pixels' variances of both, over half the sum of both, in the
/// channel where this is largest; zero where neither has noise. Beyond it the test says too little
/// and fails. Channels below a thousandth of the brightest count as black here. A channel whose
/// mean is off by 9 `power` is seen with a probability of 99 % (6.3 standard errors are the limit,
/// 2.4 more make it sure); a fault in few blocks alone is, where it is 9.3 standard errors of one.
#[track_caller]
pub fn assert_same(what: &str, a: &Rendered, b: &Rendered, power: f64) {
    let (a, b) = ([&a.image, &a.variance], [&b.image, &b.variance]);
    assert_equal_means(what, a, b, &[a[1], b[1]], 0.0, power);
}

/// Tests that a render has a known expectation per pixel, in the manner of [`assert_same`]: `power`
/// is the standard error of the render's mean, relative to the expectation's.
#[track_caller]
pub fn assert_expected(
    what: &str,
    a: &Rendered,
    power: f64,
    expected: impl Fn(u32, u32) -> [f64; 3],
) {
    // Where nothing is random single precision is what differs, by as much in each pixel.
    const ROUNDING: f64 = 4e-7;
    let [width, height] = [a.image.width(), a.image.height()];
    let mut image = Image::new(width, height, &["R", "G", "B"]).expect("an image");
    let mut rounding = Image::new(width, height, &["R", "G", "B"]).expect("an image");
    for y in 0..height {
        for x in 0..width {
            for (name, value) in ["R", "G", "B"].into_iter().zip(expected(x, y)) {
                assert!(image.set(name, x, y, value as f32));
                assert!(rounding.set(name, x, y, (ROUNDING * value).powi(2) as f32));
            }
        }
    }
    let (a, b) = ([&a.image, &a.variance], [&image, &rounding]);
    assert_equal_means(what, a, b, &a[1..], ROUNDING, power);
}

/// Both tests of [`assert_same`] on means and their variances. Whole channels may differ by
/// `tolerance` relative to their mean beside what is `noise`, the variances of what is random.
#[track_caller]
fn assert_equal_means(
    what: &str,
    a: [&Image; 2],
    b: [&Image; 2],
    noise: &[&Image],
    tolerance: f64,
    power: f64,
) {
    let test = pileus_lab::block_z_test(a[0], a[1], b[0], b[1], 16).expect("images of one size");
    let sum = |image: &Image, name: &str| -> f64 {
        image.channel(name).expect("a channel").iter().map(|v| f64::from(*v)).sum()
    };
    let channels = ["R", "G", "B"].map(|name| {
        let [a, b] = [sum(a[0], name), sum(b[0], name)];
        let deviation = noise.iter().map(|&image| sum(image, name)).sum::<f64>().sqrt();
        (a - b, 0.5 * (a + b).abs(), deviation)
    });
    let brightest = channels.iter().fold(0.0f64, |most, (_, mean, _)| most.max(*mean));
    let (mut error, mut whole) = (0.0f64, 0.0f64);
    for (difference, mean, deviation) in channels {
        // What has no noise may not differ at all.
        let beyond = (difference.abs() - tolerance * mean).max(0.0);
        if beyond > 0.0 {
            whole = whole.max(beyond / deviation);
        }
        if mean > 1e-3 * brightest {
            error = error.max(deviation / mean);
        }
    }
    println!(
        "{what}: p {:.3}, max |z| {:.2}, chi2 {:?} of {:?}; whole: |z| {whole:.2}, standard error {error:.1e}",
        test.p_value, test.max_abs_z, test.chi2, test.dof
    );
    for (i, z) in test.z.iter().enumerate().filter(|(_, z)| !(z.abs() < 4.5)) {
        println!("  block {i} of {:?}: z {z:.2}", test.blocks);
    }
    assert_eq!(test.skipped_pixels, 0, "{what}: pixels that are not finite");
    assert!(
        test.p_value > 1e-9,
        "{what}: p {:e}, max |z| {:.2}, chi2 {:?} of {:?}",
        test.p_value,
        test.max_abs_z,
        test.chi2,
        test.dof
    );
    // Two sides, three channels: 9e-10.
    assert!(whole < 6.3, "{what}: a whole channel is {whole:.2} standard errors off");
    assert!(error <= power, "{what}: standard error {error:e}, the test is too weak");
}

/// Tests that a render is one everywhere but for a systematic error of at most `tolerance`.
///
/// Null hypothesis: the mean of each block of 16 x 16 pixels is within `tolerance` of one. |z| <
/// 6.5 on 48 blocks: false alarm 4e-9. The standard error of the whole must be below `power`, else
/// the test says too little.
pub fn assert_one(what: &str, a: &Rendered, tolerance: f64, power: f64) {
    let (width, height) = (a.image.width() as usize, a.image.height() as usize);
    let (mut worst, mut furthest, mut whole) = (0.0f64, 0.0f64, 0.0f64);
    for name in ["R", "G", "B"] {
        let mean = a.image.channel(name).expect("a channel");
        let variance = a.variance.channel(name).expect("a channel");
        let all = variance.iter().map(|v| f64::from(*v)).sum::<f64>().sqrt() / mean.len() as f64;
        whole = whole.max(all);
        assert!(all < power, "{what}: standard error {all:e}, the test is too weak");
        for block in 0..width.div_ceil(16) * height.div_ceil(16) {
            let (left, top) = (block % width.div_ceil(16) * 16, block / width.div_ceil(16) * 16);
            let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
            for y in top..(top + 16).min(height) {
                for x in left..(left + 16).min(width) {
                    sum += f64::from(mean[y * width + x]);
                    squares += f64::from(variance[y * width + x]);
                    n += 1.0;
                }
            }
            let off = sum / n - 1.0;
            let error = f64::sqrt(squares) / n;
            let z = (off.abs() - tolerance).max(0.0) / error.max(1e-12);
            if off.abs() > furthest.abs() {
                furthest = off;
            }
            worst = worst.max(z);
            assert!(z < 6.5, "{what}: {name} of block {block} is 1 {off:+e}, error {error:e}");
        }
    }
    println!(
        "{what}: block furthest from one {furthest:+.2e}, max |z| beyond tolerance {worst:.2}, standard error of all {whole:.1e}"
    );
}

/// A surface that reflects `albedo` diffusely and nothing else.
pub fn lambert(albedo: [f32; 3]) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [albedo[0], albedo[1], albedo[2], 1.0], "metallicFactor": 0.0},
        "extensions": {"KHR_materials_specular": {"specularFactor": 0.0}}})
}

/// The same, giving off `radiance` on its front.
pub fn area_light(albedo: [f32; 3], radiance: [f32; 3]) -> Value {
    let strength = radiance.iter().fold(0.0f32, |a, b| a.max(*b)).max(1.0);
    let mut material = lambert(albedo);
    material["emissiveFactor"] = json!(radiance.map(|c| c / strength));
    material["extensions"]["KHR_materials_emissive_strength"] =
        json!({"emissiveStrength": strength});
    material
}

/// Smooth clear glass of an index.
pub fn glass(ior: f32) -> Value {
    json!({"pbrMetallicRoughness": {"roughnessFactor": 0.0, "metallicFactor": 0.0},
        "extensions": {"KHR_materials_ior": {"ior": ior}, "KHR_materials_transmission": {"transmissionFactor": 1.0},
            "KHR_materials_volume": {"thicknessFactor": 1.0}}})
}

/// The closed surface of the cube of half edge `half`, front outwards.
pub fn cube(half: f32) -> Triangles {
    (0..3)
        .flat_map(|axis| {
            let turn = |v: [f32; 3]| [0, 1, 2].map(|k| half * v[(k + 3 - axis) % 3]);
            let side = |s: f32| {
                let (a, b) = ([0.0, 2.0, 0.0], [0.0, 0.0, 2.0]);
                let (a, b) = if s > 0.0 { (a, b) } else { (b, a) };
                quad(turn([s, -1.0, -1.0]), turn(a), turn(b))
            };
            [side(1.0), side(-1.0)].concat()
        })
        .collect()
}

/// A glTF scene of `tests/data/gltf` that wants a volume of `scenes/assets` in the folder above its
/// own.
pub fn blender(name: &str, volume: &str, resolution: [u32; 2]) -> Scene {
    let folder = tempfile::tempdir().expect("a folder");
    let gltf = folder.path().join("gltf");
    std::fs::create_dir(&gltf).expect("a folder");
    std::fs::copy(root().join("tests/data/gltf").join(name), gltf.join(name)).expect("a scene");
    let asset = root().join("scenes/assets").join(volume);
    std::fs::copy(asset, folder.path().join(volume)).expect("an asset");
    let request = SceneRequest {
        gltf: Some((gltf.join(name), 683.0)),
        volumes: Vec::new(),
        volume_place: &|_, _| Place::default(),
        camera: CameraRequest::Auto { fov_y_degrees: 35.0, orbit: None },
        lens: None,
        lights: Vec::new(),
        environment: None,
        resolution: Some(resolution),
        default_scale: DefaultScale::One,
        glass_rule: GlassRule::default(),
    };
    Scene::load(request).expect("a sound scene").scene
}

/// Corners of triangles, counter-clockwise seen from the front.
pub type Triangles = Vec<[[f32; 3]; 3]>;

/// A glTF scene of triangles in memory: each mesh is a list of triangles and its material, as glTF
/// writes it.
pub fn surfaces(meshes: &[(Triangles, Value)]) -> Arc<pileus_scene::Surfaces> {
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
pub fn quad(corner: [f32; 3], a: [f32; 3], b: [f32; 3]) -> Triangles {
    let [p, a, b] = [corner, a, b].map(Vec3::from_array);
    [[p, p + a, p + a + b], [p, p + a + b, p + b]].map(|t| t.map(|v| v.to_array())).to_vec()
}

/// A sphere of `16 n^2` triangles, front outwards.
pub fn sphere(centre: DVec3, radius: f64, n: u32) -> Triangles {
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
