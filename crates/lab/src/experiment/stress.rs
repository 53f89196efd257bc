//! What methods are asked by the table of stability: closed forms, rays of grids and small
//! pictures.

use crate::Error;
use crate::profile::{Profile, ProfileCase};
use glam::{DAffine3, DQuat, DVec3, Vec3};
use pileus_media::distance::Equiangular;
use pileus_media::phase::ISOTROPIC;
use pileus_media::{
    Albedo, Interpolation, Medium, Phase, Tally, VoxelGrid, VoxelGridOptions, optical_depth,
};
use pileus_scene::{
    Camera, Environment, EnvironmentImage, Light, Point, Scene, Volume, VolumeSource,
};
use pileus_vdb::Tree;
use std::sync::Arc;

/// What is asked of a method.
pub(super) enum Subject {
    /// A closed form.
    Profile(ProfileCase),
    /// A closed form, with the extinction of channels relative to it.
    Chromatic(ProfileCase, Vec3),
    /// A ray of a grid.
    Grid(Arc<Medium>, DVec3, Vec3),
    /// A ray of a homogeneous medium, perhaps without end.
    Homogeneous(Medium, f32),
    /// A small picture, the expectations of its pixels, row by row, and the most scattering events.
    Picture(Box<Scene>, Vec<f64>, Option<u32>),
}

/// Something that methods are asked, which some of them do not bear.
pub(super) struct Stress {
    pub(super) name: String,
    pub(super) what: String,
    pub(super) subject: Subject,
    /// Whether bounds do not hold.
    pub(super) broken: bool,
    pub(super) homogeneous: bool,
}

fn constant(depth: f64, bound: f64) -> ProfileCase {
    ProfileCase {
        name: String::new(),
        profile: Profile::Constant { value: depth },
        length: 1.0,
        majorant: depth,
        minorant: depth,
        use_majorant: Some(bound),
    }
}

/// Waves about an extinction of `depth` on unit length, between a fifth and nine fifths of it; not
/// a whole number of them, so that equidistant samples do not cancel their error.
fn waves(depth: f64, looseness: f64) -> ProfileCase {
    ProfileCase {
        name: String::new(),
        profile: Profile::Sine { mean: depth, amplitude: 0.8 * depth, cycles: 2.3 },
        length: 1.0,
        majorant: 1.8 * depth,
        minorant: 0.2 * depth,
        use_majorant: Some(1.8 * depth * looseness),
    }
}

fn steps(edges: &[f64], values: &[f64]) -> ProfileCase {
    ProfileCase {
        name: String::new(),
        profile: Profile::Steps { edges: edges.to_vec(), values: values.to_vec() },
        length: 1.0,
        majorant: values.iter().copied().fold(0.0, f64::max),
        minorant: values.iter().copied().fold(f64::INFINITY, f64::min),
        use_majorant: None,
    }
}

/// Values 0.1 to 3 without order.
fn lumps(n: u32) -> Vec<f32> {
    (0..n.pow(3))
        .map(|i| {
            let hash = i.wrapping_mul(2_654_435_761).rotate_left(13).wrapping_mul(2_246_822_519);
            let u = (hash >> 8) as f32 / 16_777_216.0;
            0.1 + 2.9 * u * u * u
        })
        .collect()
}

fn grid(
    corner: [i32; 3],
    size: [usize; 3],
    values: &[f32],
    to_world: DAffine3,
    sigma_t: f32,
) -> Result<Arc<Medium>, Error> {
    let tree = Tree::from_dense(0.0f32, corner, size, values);
    let options = VoxelGridOptions { interpolation: Interpolation::Trilinear };
    let grid = VoxelGrid::from_tree(&tree, &options).map_err(Error::Media)?;
    let albedo = Albedo::Constant([1.0; 3]);
    let medium =
        Medium::from_grid(Arc::new(grid), to_world, [sigma_t; 3], albedo, Phase::Isotropic);
    Ok(Arc::new(medium.map_err(Error::Media)?))
}

/// The picture of a lumpy cube under an image of constant light, under constant light, or by a
/// point light alone.
#[derive(Clone, Copy, PartialEq)]
enum Lit {
    ByImage,
    Constant,
    ByPoint(DVec3),
}

fn picture(sigma_t: f32, albedo: f32, g: f32, lit: Lit) -> Result<Box<Scene>, Error> {
    let to_world =
        DAffine3::from_scale(DVec3::splat(0.125)) * DAffine3::from_translation(DVec3::splat(-7.5));
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &lumps(16));
    let options = VoxelGridOptions { interpolation: Interpolation::Trilinear };
    let grid = VoxelGrid::from_tree(&tree, &options).map_err(Error::Media)?;
    let medium = Medium::from_grid(
        Arc::new(grid),
        to_world,
        [sigma_t; 3],
        Albedo::Constant([albedo; 3]),
        Phase::henyey_greenstein(g),
    )
    .map_err(Error::Media)?;
    let mut environment = Environment::default();
    let mut lights = Vec::new();
    match lit {
        Lit::Constant => environment.constant = Vec3::ONE,
        Lit::ByImage => {
            let image = EnvironmentImage::new(16, 8, vec![[1.0; 3]; 128], 1.0, 0.0);
            environment.image = Some(Arc::new(image.map_err(Error::Scene)?));
        }
        Lit::ByPoint(position) => {
            lights.push(Light::Point(Point { position, intensity: Vec3::ONE }));
        }
    }
    let eye = DVec3::new(3.0, 2.0, 4.0);
    Ok(Box::new(Scene {
        camera: Camera::look_at(eye, DVec3::ZERO, DVec3::Y, 12.0, [8, 8]).map_err(Error::Scene)?,
        volumes: vec![Volume {
            name: "lumps".into(),
            medium: Arc::new(medium),
            emission: None,
            source: VolumeSource::Homogeneous,
        }],
        lights,
        environment,
        surfaces: None,
        not_modelled: Vec::new(),
    }))
}

/// Expectations of all pixels of a picture, row by row.
fn pixels(scene: &Scene, expected: impl Fn(&Medium, DVec3, Vec3) -> f64) -> Vec<f64> {
    let [width, height] = scene.camera.resolution();
    let Some(medium) = scene.volumes.first().map(|v| &*v.medium) else {
        return Vec::new();
    };
    let middle = |i: u32| [f64::from(i % width) + 0.5, f64::from(i / width) + 0.5];
    (0..width * height)
        .map(|i| {
            let (origin, direction) = scene.camera.ray(middle(i));
            expected(medium, origin, direction)
        })
        .collect()
}

fn depth(grid: &Medium, origin: DVec3, direction: DVec3, t_max: f64) -> f64 {
    optical_depth(grid, origin, direction, 0.0, t_max, &mut Tally::default())
}

/// Radiance scattered once from a point light of unit intensity by isotropic, white lumps:
/// midpoints in the angle seen from the light, on each side of the point nearest to it.
fn single_scattering(grid: &Medium, origin: DVec3, direction: Vec3, light: DVec3) -> f64 {
    const POINTS: u32 = 400;
    let Some(span) = grid.span(origin, direction, f64::INFINITY) else {
        return 0.0;
    };
    let part = (span.t_enter, span.t_exit());
    let Some(points) = Equiangular::new(origin, direction, light, part) else {
        return 0.0;
    };
    let d = direction.as_dvec3();
    (0..POINTS)
        .map(|i| {
            let t = points.sample((i as f32 + 0.5) / POINTS as f32);
            let p = origin + d * t;
            let to = light - p;
            let through = depth(grid, origin, d, t) + depth(grid, p, to.normalize(), to.length());
            let scattered = grid.sigma_t_at(p) * f64::from(ISOTROPIC) * (-through).exp();
            scattered / (to.length_squared() * points.pdf(t) * f64::from(POINTS))
        })
        .sum()
}

pub(super) fn all_stresses() -> Result<Vec<Stress>, Error> {
    let mut stresses = Vec::new();
    let mut add = |name: &str, what: &str, subject: Subject| {
        stresses.push(Stress {
            name: name.into(),
            what: what.into(),
            subject,
            broken: false,
            homogeneous: false,
        });
    };
    for depth in [1e-6, 1e-3, 1.0, 10.0, 50.0, 1e2, 1e4] {
        let what = format!("waves, optical depth about {depth}, tight bound");
        add(&format!("depth {depth:e}"), &what, Subject::Profile(waves(depth, 1.0)));
    }
    for factor in [10.0, 100.0, 1e4] {
        let what = format!("waves, optical depth about 1, bound {factor} times too loose");
        add(&format!("loose {factor:e}"), &what, Subject::Profile(waves(1.0, factor)));
    }
    let tents = |centres: Vec<f64>, half_width: f64, peaks: Vec<f64>, floor: f64| {
        let majorant = floor + peaks.iter().copied().fold(0.0, f64::max);
        let profile = Profile::Tents { centres, half_width, peaks, floor };
        ProfileCase {
            name: String::new(),
            profile,
            length: 1.0,
            majorant,
            minorant: floor,
            use_majorant: None,
        }
    };
    let spike = tents(vec![0.37], 0.001, vec![1000.0], 0.0);
    add(
        "spike",
        "all extinction (optical depth 1) in a thousandth of the ray",
        Subject::Profile(spike),
    );
    let hole = steps(&[0.0, 0.45, 0.55, 1.0], &[4.0, 0.0, 4.0]);
    add("hole", "optical depth 3.6, nothing in the middle tenth", Subject::Profile(hole));
    let stairs = steps(&[0.0, 0.2, 0.5, 0.7, 1.0], &[0.5, 3.0, 0.2, 1.5]);
    add("steps", "four levels between 0.2 and 3", Subject::Profile(stairs));
    let edges: Vec<f64> = (0..=32).map(|i| f64::from(i) / 32.0).collect();
    let bars: Vec<f64> = (0..32).map(|i| f64::from(i % 2) * 6.0).collect();
    add("comb", "16 bars of extinction 6, optical depth 3", Subject::Profile(steps(&edges, &bars)));
    let relative = |green, blue| Vec3::new(1.0, green, blue);
    add(
        "channels 1:100",
        "extinction 1 : 0.1 : 0.01, optical depth about 5 in the first channel",
        Subject::Chromatic(waves(5.0, 1.0), relative(0.1, 0.01)),
    );
    add(
        "clear channel",
        "extinction 1 : 0.5 : 0, optical depth about 5 in the first channel",
        Subject::Chromatic(waves(5.0, 1.0), relative(0.5, 0.0)),
    );
    for (name, what, albedo, g) in [
        ("albedo 1", "white furnace of an image, albedo 1", 1.0, 0.0),
        ("g 0.999", "white furnace of an image, g 0.999", 1.0, 0.999),
        ("g -0.999", "white furnace of an image, g -0.999", 1.0, -0.999),
    ] {
        let scene = picture(1.5, albedo, g, Lit::ByImage)?;
        let expected = pixels(&scene, |_, _, _| 1.0);
        add(name, what, Subject::Picture(scene, expected, None));
    }
    let scene = picture(1.0, 0.0, 0.0, Lit::Constant)?;
    let expected = pixels(&scene, |grid, o, d| (-depth(grid, o, d.as_dvec3(), 1e9)).exp());
    add(
        "albedo 0",
        "absorption before a constant background",
        Subject::Picture(scene, expected, None),
    );
    let light = DVec3::new(0.02, 0.01, -0.01);
    let scene = picture(0.1, 1.0, 0.0, Lit::ByPoint(light))?;
    let expected = pixels(&scene, |grid, o, d| single_scattering(grid, o, d, light));
    let what = "a point light within thin smoke, single scattering";
    add("light in smoke", what, Subject::Picture(scene, expected, Some(1)));

    let diagonal = Vec3::new(0.6, 0.48, 0.64);
    let lumpy = lumps(16);
    let cube = [16; 3];
    let plain = grid([0; 3], cube, &lumpy, DAffine3::IDENTITY, 0.15)?;
    let single = grid([0; 3], [1; 3], &[1.0], DAffine3::IDENTITY, 2.0)?;
    add(
        "one voxel",
        "a grid of a single voxel",
        Subject::Grid(single, DVec3::new(-1.0, -0.7, -1.1), diagonal),
    );
    let flat = DAffine3::from_scale(DVec3::new(1.0, 1000.0, 1.0));
    let flat = grid([0; 3], cube, &lumpy, flat, 5e-4)?;
    let (target, origin) = (DVec3::new(8.0, 8000.0, 8.0), DVec3::new(-3.0, 2000.0, -2.0));
    add(
        "aspect 1:1000",
        "voxels a thousand times as long as wide",
        Subject::Grid(flat, origin, (target - origin).normalize().as_vec3()),
    );
    let far = grid([0; 3], cube, &lumpy, DAffine3::from_translation(DVec3::splat(1e6)), 0.15)?;
    add(
        "world 1e6",
        "a million units from the world's origin",
        Subject::Grid(far, DVec3::splat(1e6) + DVec3::new(1.0, 2.0, 0.5), diagonal),
    );
    let far = grid([1_000_000; 3], cube, &lumpy, DAffine3::IDENTITY, 0.15)?;
    add(
        "index 1e6",
        "index coordinates of a million",
        Subject::Grid(far, DVec3::splat(1e6) + DVec3::new(1.0, 2.0, 0.5), diagonal),
    );
    for scale in [1e-6, 1e6] {
        let scaled = grid(
            [0; 3],
            cube,
            &lumpy,
            DAffine3::from_scale(DVec3::splat(scale)),
            0.15 / scale as f32,
        )?;
        add(
            &format!("scale {scale:e}"),
            "the same cloud at another scale",
            Subject::Grid(scaled, DVec3::new(1.0, 2.0, 0.5) * scale, diagonal),
        );
    }
    add(
        "face",
        "a ray within a face of the majorant cells",
        Subject::Grid(plain.clone(), DVec3::new(-2.0, 4.0, 5.3), Vec3::X),
    );
    add(
        "edge",
        "a ray along an edge of the majorant cells",
        Subject::Grid(plain.clone(), DVec3::new(-2.0, 4.0, 8.0), Vec3::X),
    );
    let corner = Vec3::ONE.normalize();
    add(
        "corners",
        "a ray through corners of the majorant cells",
        Subject::Grid(plain.clone(), DVec3::splat(-2.0), corner),
    );
    let turned = DAffine3::from_quat(DQuat::from_axis_angle(DVec3::Z, 1e-9));
    let turned = grid([0; 3], cube, &lumpy, turned, 0.15)?;
    add(
        "nearly parallel",
        "a ray at 1e-9 radian to a face",
        Subject::Grid(turned, DVec3::new(-2.0, 4.0, 5.3), Vec3::X),
    );
    add(
        "zero length",
        "a segment of no length",
        Subject::Profile(ProfileCase { length: 0.0, ..waves(3.0, 1.0) }),
    );
    let fog =
        Medium::homogeneous([0.5; 3], None, [1.0; 3], Phase::Isotropic).map_err(Error::Media)?;
    add("infinite", "fog without end", Subject::Homogeneous(fog, f32::INFINITY));
    let mut bad = lumpy.clone();
    for (i, value) in bad.iter_mut().enumerate() {
        match i % 7 {
            0 => *value = f32::NAN,
            2 => *value = f32::INFINITY,
            4 => *value = -3.0,
            5 => *value = f32::NEG_INFINITY,
            _ => {}
        }
    }
    let bad = grid([0; 3], cube, &bad, DAffine3::IDENTITY, 0.3)?;
    add(
        "NaN, inf, negative",
        "four of seven voxels are no densities: they count as zero",
        Subject::Grid(bad, DVec3::new(-1.0, 2.0, 0.5), diagonal),
    );
    for excess in [1.01, 2.0, 100.0] {
        let what =
            format!("waves, optical depth about 2, extinction up to {excess} times the bound");
        stresses.push(Stress {
            name: format!("broken bound {excess}"),
            what,
            subject: Subject::Profile(waves(2.0, 1.0 / excess)),
            broken: true,
            homogeneous: false,
        });
    }
    stresses.push(Stress {
        name: "constant 50".into(),
        what: "constant extinction, optical depth 50, tight bound".into(),
        subject: Subject::Profile(constant(50.0, 50.0)),
        broken: false,
        homogeneous: true,
    });
    if let Some(infinite) = stresses.iter_mut().find(|s| s.name == "infinite") {
        infinite.homogeneous = true;
    }
    Ok(stresses)
}
