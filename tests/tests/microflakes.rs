//! Media of microflakes in whole pictures.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

use glam::{DAffine3, DMat3, DVec3, Vec3};
use pileus_film::read_exr;
use pileus_integrator::{LightSampling, Plan, RenderSettings};
use pileus_media::distance::DistanceSampler;
use pileus_media::emission::{BlackbodyRadiance, EmissionField, EmissionSource, blackbody};
use pileus_media::microflakes::{
    MicroflakeGrid, MicroflakeScattering, MicroflakeShape, Microflakes, Roughness, Sggx,
};
use pileus_media::transmittance::Estimator;
use pileus_media::{Albedo, Interpolation, Medium, Phase, VoxelGrid, VoxelGridOptions};
use pileus_scene::{Light, Point, Scene, Volume, VolumeSource};
use pileus_tests::*;
use pileus_vdb::Tree;
use std::sync::Arc;

const EYE: DVec3 = DVec3::new(3.0, 1.5, 4.0);

fn microflakes(shape: MicroflakeShape, scattering: MicroflakeScattering) -> Phase {
    Phase::Microflakes(Arc::new(Microflakes::new(shape, scattering, DMat3::IDENTITY)))
}

fn constant(s: Sggx, scattering: MicroflakeScattering) -> Phase {
    microflakes(MicroflakeShape::Constant(s), scattering)
}

/// The axis of the peer's fibres at a point.
fn swirl(p: DVec3) -> Vec3 {
    DVec3::new(0.3 - p.y, p.x + 0.2, 0.5 + 0.4 * p.z).normalize().as_vec3()
}

/// Fibres that swirl, on 9^3 points over a cube of edge 3, as seen from the index space of
/// [`cube_grid`] with half size 1.
fn swirling_fibres(roughness: f32) -> MicroflakeShape {
    let axes: Vec<[f32; 3]> = (0..9 * 9 * 9)
        .map(|i| {
            let p = DVec3::new(f64::from(i / 81), f64::from(i / 9 % 9), f64::from(i % 9));
            swirl((p - 4.0) / 4.0).to_array()
        })
        .collect();
    let tree = Tree::from_dense([0.0f32; 3], [0; 3], [9; 3], &axes);
    // Voxel i of the density lies at (i - 7.5) / 8; point i of the axes at (i - 4) / 4 * 1.5.
    let to_own = DAffine3::from_translation(DVec3::splat(4.0))
        * DAffine3::from_scale(DVec3::splat(4.0 / 1.5 / 8.0))
        * DAffine3::from_translation(DVec3::splat(-7.5));
    let grid = MicroflakeGrid::fibres(&tree, Roughness::Constant(roughness), to_own).unwrap();
    MicroflakeShape::Grid(Box::new(grid))
}

fn lit(medium: Medium) -> Scene {
    let mut scene = scene(vec![medium], EYE, DVec3::ZERO, 34.0);
    scene.environment.constant = Vec3::new(0.3, 0.4, 0.6);
    scene.lights.push(sun(Vec3::new(0.5, 0.8, -0.3), Vec3::new(3.0, 2.0, 1.0), 0.0));
    scene
}

/// Pictures by the phase function of another renderer (`sggx` of Mitsuba 3.9.1), made by
/// `tests/data/peers/sggx.py`: block z-test with both variances.
fn agrees_with_mitsuba(name: &str, medium: Medium, seed: u64) {
    let ours = rendered(&lit(medium), &settings(256, seed));
    let read = |suffix: &str| {
        read_exr(&root().join(format!("tests/data/peers/{name}{suffix}.exr"))).expect("a reference")
    };
    let (theirs, variance) = (read(""), read(".var"));
    let test = pileus_lab::block_z_test(&ours.image, &ours.variance, &theirs, &variance, 16)
        .expect("a test");
    println!("{name}: p {:.3}, max |z| {:.2}", test.p_value, test.max_abs_z);
    assert!(test.p_value > 1e-9, "{name}: p {:e}, {:.2}", test.p_value, test.max_abs_z);
}

#[test]
fn fibres_agree_with_mitsuba() {
    let s = Sggx::fibre(Vec3::new(0.48, 0.6, 0.64), 0.2);
    let phase = constant(s, MicroflakeScattering::Specular);
    agrees_with_mitsuba("sggx_constant", cube_grid(1.0, [3.0; 3], [0.9, 0.7, 0.5], phase), 1);
}

#[test]
fn fibres_by_grid_agree_with_mitsuba() {
    // The peer interpolates matrices, too, but holds axes at its own points: the same ones.
    let phase = microflakes(swirling_fibres(0.15), MicroflakeScattering::Specular);
    agrees_with_mitsuba("sggx_grid", cube_grid(1.0, [3.0; 3], [0.9, 0.7, 0.5], phase), 2);
}

/// Mirrors that look everywhere alike are the isotropic medium; so are their homogeneous and
/// gridded forms, and microflakes by a grid without axes.
#[test]
fn isotropic_flakes_are_the_isotropic_medium() {
    let (sigma_t, albedo) = ([2.0, 1.0, 0.5], [0.9, 0.8, 0.6]);
    let plain =
        rendered(&lit(lumpy_grid(1.0, sigma_t, albedo, Phase::Isotropic)), &settings(96, 1));
    let phase = constant(Sggx::ISOTROPIC, MicroflakeScattering::Specular);
    let mirrors = rendered(&lit(lumpy_grid(1.0, sigma_t, albedo, phase)), &settings(96, 2));
    assert_same("isotropic microflakes", &plain, &mirrors, 9e-4);
    let empty = Tree::from_dense([0.0f32; 3], [0; 3], [1; 3], &[[0.0; 3]]);
    let grid =
        MicroflakeGrid::surfaces(&empty, Roughness::Constant(0.1), DAffine3::IDENTITY).unwrap();
    let phase = microflakes(MicroflakeShape::Grid(Box::new(grid)), MicroflakeScattering::Specular);
    let by_grid = rendered(&lit(lumpy_grid(1.0, sigma_t, albedo, phase)), &settings(96, 3));
    assert_same("microflakes without axes", &plain, &by_grid, 9e-4);
}

/// Furnaces, grey and per channel, of mirrors and of matte microflakes, thin fibres and sheets,
/// constant and by grid: what does not absorb does not show.
#[test]
fn furnaces_of_flakes() {
    let fibre = Sggx::fibre(Vec3::new(0.6, 0.0, 0.8), 0.05);
    let sheet = Sggx::surface(Vec3::new(0.0, 0.6, 0.8), 0.05);
    let thin = Sggx::fibre(Vec3::Y, 0.001);
    let specular = MicroflakeScattering::Specular;
    let cases = [
        ("fibres", constant(fibre, specular), [2.0; 3]),
        ("sheets", constant(sheet, specular), [2.0, 1.0, 0.3]),
        ("matte fibres", constant(fibre, MicroflakeScattering::Diffuse), [2.0; 3]),
        ("matte sheets", constant(sheet, MicroflakeScattering::Diffuse), [2.0; 3]),
        ("thin fibres", constant(thin, specular), [2.0; 3]),
        ("fibres by grid", microflakes(swirling_fibres(0.05), specular), [2.0, 0.7, 0.2]),
        (
            "matte by grid",
            microflakes(swirling_fibres(0.3), MicroflakeScattering::Diffuse),
            [2.0; 3],
        ),
    ];
    for (i, (what, phase, sigma_t)) in cases.into_iter().enumerate() {
        let mut scene =
            scene(vec![lumpy_grid(1.0, sigma_t, [1.0; 3], phase)], EYE, DVec3::ZERO, 24.0);
        // Half of the light by shadow rays, half by paths that escape.
        let texels = (0..32 * 16).map(|i| if i / 32 < 8 { [1.0; 3] } else { [0.2; 3] }).collect();
        let half = pileus_scene::EnvironmentImage::new(32, 16, texels, 1.0, 0.0).unwrap();
        let other = (0..32 * 16).map(|i| if i / 32 < 8 { [0.0; 3] } else { [0.8; 3] }).collect();
        let other = pileus_scene::EnvironmentImage::new(32, 16, other, 1.0, 0.0).unwrap();
        let mut sum: Option<Rendered> = None;
        for (k, image) in [half, other].into_iter().enumerate() {
            scene.environment.image = Some(Arc::new(image));
            let part = rendered(&scene, &settings(96, 10 + 2 * i as u64 + k as u64));
            sum = Some(match sum {
                None => part,
                Some(mut sum) => {
                    for c in ["R", "G", "B"] {
                        for (a, b) in
                            [(&mut sum.image, &part.image), (&mut sum.variance, &part.variance)]
                        {
                            let b = b.channel(c).unwrap().to_vec();
                            a.channel_mut(c).unwrap().iter_mut().zip(b).for_each(|(a, b)| *a += b);
                        }
                    }
                    sum
                }
            });
        }
        assert_one(what, &sum.unwrap(), 1e-3, 4e-3);
    }
}

/// Black bodies of microflakes give off light by the area that they show, as they absorb by it
/// (Kirchhoff): at one temperature with what surrounds them light is the same everywhere. Without
/// the area fibres would be up to 1 / roughness too bright. By shadow rays, paths that are drawn to
/// the volume, and paths alone; grey and per channel; the same everywhere and by grid.
#[test]
fn black_bodies_of_microflakes_are_in_equilibrium() {
    let kelvin = 2500.0;
    let light = blackbody(kelvin, BlackbodyRadiance::Normalised);
    let fibre = Sggx::fibre(Vec3::new(0.6, 0.0, 0.8), 0.05);
    let large = Sggx::new([4.0, 0.3, 0.5], [0.1, 0.0, 0.2]).unwrap();
    let cases = [
        ("fibres", constant(fibre, MicroflakeScattering::Specular), [2.0; 3]),
        ("matte fibres", constant(fibre, MicroflakeScattering::Diffuse), [2.0, 1.0, 0.3]),
        ("areas above one", constant(large, MicroflakeScattering::Specular), [1.0; 3]),
        (
            "by grid",
            microflakes(swirling_fibres(0.05), MicroflakeScattering::Specular),
            [1.0, 2.0, 0.5],
        ),
    ];
    let tree = Tree::from_dense(0.0f32, [0; 3], [16; 3], &[1.0; 16 * 16 * 16]);
    let options = VoxelGridOptions { interpolation: Interpolation::Nearest };
    let density = Arc::new(VoxelGrid::from_tree(&tree, &options).unwrap());
    let index_to_world =
        DAffine3::from_scale(DVec3::splat(0.125)) * DAffine3::from_translation(DVec3::splat(-7.5));
    for (i, (what, phase, sigma_t)) in cases.into_iter().enumerate() {
        let albedo = [0.5, 0.7, 0.2];
        let source = EmissionSource::Blackbody {
            density: Arc::clone(&density),
            sigma_t,
            albedo: Albedo::Constant(albedo),
            temperature: Arc::clone(&density),
            to_temperature: DAffine3::IDENTITY,
            kelvin_per_unit: 0.0,
            kelvin_offset: kelvin,
            radiance: BlackbodyRadiance::Normalised,
            intensity: 1.0,
            phase: phase.clone(),
        };
        let mut scene = scene(vec![], EYE, DVec3::ZERO, 34.0);
        scene.environment.constant = light;
        scene.volumes.push(Volume {
            name: what.into(),
            medium: Arc::new(cube_grid(1.0, sigma_t, albedo, phase)),
            emission: Some(Arc::new(EmissionField::new(source, index_to_world).unwrap())),
            source: VolumeSource::Homogeneous,
        });
        for (k, light_sampling) in
            [LightSampling::Both, LightSampling::Paths].into_iter().enumerate()
        {
            let seed = 70 + 2 * i as u64 + k as u64;
            let mut image =
                rendered(&scene, &RenderSettings { light_sampling, ..settings(96, seed) });
            // Each channel over what it should be.
            for (c, light) in ["R", "G", "B"].into_iter().zip(light.to_array()) {
                image.image.channel_mut(c).unwrap().iter_mut().for_each(|v| *v /= light);
                let variance = image.variance.channel_mut(c).unwrap();
                variance.iter_mut().for_each(|v| *v /= light * light);
            }
            assert_one(&format!("{what}, {light_sampling:?}"), &image, 1e-3, 4e-3);
        }
    }
}

/// A grid of one axis is the constant medium; a homogeneous medium is its grid; several microflake
/// media overlap; equiangular points and exact shadow rays see the same.
#[test]
fn all_ways_to_say_the_same_flakes() {
    let s = Sggx::fibre(Vec3::new(0.0, 0.6, 0.8), 0.1);
    let (sigma_t, albedo) = ([1.5, 1.5, 0.5], [0.9, 0.8, 0.6]);
    let mut scene =
        lit(cube_grid(1.0, sigma_t, albedo, constant(s, MicroflakeScattering::Specular)));
    scene.lights.push(Light::Point(Point {
        position: DVec3::new(0.2, 0.1, 0.4),
        intensity: Vec3::new(0.5, 0.3, 0.2),
    }));
    // The point light inside makes few samples very bright: biases below 10 to 25 % go unseen.
    let reference = rendered(&scene, &settings(128, 1));
    let with = |media: Vec<Medium>, settings: RenderSettings| {
        let mut other = pileus_tests::scene(media, EYE, DVec3::ZERO, 34.0);
        other.lights = scene.lights.clone();
        other.environment = scene.environment.clone();
        rendered(&other, &settings)
    };
    let specular = || constant(s, MicroflakeScattering::Specular);
    let homogeneous = cube_homogeneous(1.0, sigma_t, albedo, specular());
    assert_same("homogeneous", &reference, &with(vec![homogeneous], settings(128, 2)), 0.016);
    let part = |share: f32| cube_grid(1.0, sigma_t.map(|s| s * share), albedo, specular());
    assert_same("parts", &reference, &with(vec![part(0.25), part(0.75)], settings(128, 3)), 0.028);
    let axes = vec![[0.0f32, 0.6, 0.8]; 20 * 20 * 20];
    let tree = Tree::from_dense([0.0f32; 3], [-2; 3], [20; 3], &axes);
    let grid = MicroflakeGrid::fibres(&tree, Roughness::Constant(0.1), DAffine3::IDENTITY).unwrap();
    let by_grid =
        microflakes(MicroflakeShape::Grid(Box::new(grid)), MicroflakeScattering::Specular);
    let by_grid = cube_grid(1.0, sigma_t, albedo, by_grid);
    assert_same("by grid", &reference, &with(vec![by_grid.clone()], settings(128, 4)), 0.012);
    let equiangular =
        RenderSettings { distance: Some(DistanceSampler::Equiangular), ..settings(128, 5) };
    assert_same("equiangular", &reference, &with(vec![by_grid.clone()], equiangular), 0.012);
    let exact = Some(Estimator::Regular);
    let exact = RenderSettings { transmittance: exact, ..settings(128, 6) };
    assert_same("exact", &reference, &with(vec![part(1.0)], exact.clone()), 0.021);
    // Along grids of microflakes nothing is integrated exactly: they are walked, the rest is not.
    let walked = with(vec![by_grid.clone()], exact.clone());
    assert_same("by grid among exact methods", &reference, &walked, 0.013);
    let scene = pileus_tests::scene(vec![by_grid], EYE, DVec3::ZERO, 34.0);
    let plan = Plan::new(&scene, &exact).unwrap();
    assert!(plan.reasons.iter().any(|reason| reason.contains("walked by tentative collisions")));
}

/// The highlight of a fibre: single scattering of a sun by upright mirrors lies on the cone around
/// the axis whose slope is the sun's. Seen along it the medium is bright, off it dark, whatever the
/// sun's azimuth; matte and isotropic media show nothing of the kind.
#[test]
fn fibres_shine_on_a_cone() {
    let thin = |phase, to_sun: Vec3, eye: Vec3| {
        let medium = cube_grid(1.0, [0.05; 3], [1.0; 3], phase);
        let mut scene = scene(vec![medium], eye.as_dvec3() * 8.0, DVec3::ZERO, 10.0);
        scene.lights.push(sun(to_sun, Vec3::ONE, 0.0));
        let single = RenderSettings { max_bounces: Some(1), ..settings(16, 7) };
        let image = rendered(&scene, &single).image;
        let all = image.channel("G").unwrap();
        all.iter().map(|v| f64::from(*v)).sum::<f64>() / all.len() as f64
    };
    let at = |elevation: f32, azimuth: f32| {
        let (e, a) = (elevation.to_radians(), azimuth.to_radians());
        Vec3::new(e.cos() * a.sin(), e.sin(), e.cos() * a.cos())
    };
    // A mirror whose normal is across the axis turns the sun's elevation over: eye and sun see it
    // from opposite slopes.
    let fibre = || constant(Sggx::fibre(Vec3::Y, 0.02), MicroflakeScattering::Specular);
    for azimuth in [40.0, 110.0, 200.0] {
        let to_sun = at(30.0, azimuth);
        let on = thin(fibre(), to_sun, at(-30.0, 0.0));
        let off = thin(fibre(), to_sun, at(-15.0, 0.0));
        println!("azimuth {azimuth}: on the cone {on:.5}, off {off:.5}");
        assert!(on > 20.0 * off, "{azimuth}: {on} {off}");
    }
    let plain =
        |eye| thin(constant(Sggx::ISOTROPIC, MicroflakeScattering::Specular), at(30.0, 40.0), eye);
    let ratio = plain(at(-30.0, 0.0)) / plain(at(-15.0, 0.0));
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
}
