//! Every compiled path kernel: which scene runs it, the same bits on any number of threads and in
//! any split, and white furnaces.

use glam::{DVec3, Vec3};
use pileus_film::Film;
use pileus_integrator::{
    Channels, Events, KernelAxes, PhaseFunctions, RenderSettings, Renderer, Unmonitored, World,
};
use pileus_media::distance::DistanceSampler;
use pileus_media::phase::{Lobe, Mixture};
use pileus_media::{Medium, Phase};
use pileus_scene::{Camera, Scene};
use pileus_tests::*;

const EYE: DVec3 = DVec3::new(1.2, 0.9, 3.0);

/// A scene that runs a kernel, and the stored precision of its voxels.
struct Case {
    axes: KernelAxes,
    voxels: Option<&'static str>,
    media: Vec<Medium>,
    distance: Option<DistanceSampler>,
}

/// All kernels, with media of this albedo.
fn cases(albedo: f32) -> Vec<Case> {
    let albedo = [albedo; 3];
    let plain = || Phase::henyey_greenstein(0.5);
    let other = || {
        let lobes = [(0.6, Lobe::henyey_greenstein(0.7)), (0.4, Lobe::Rayleigh)];
        Phase::mixture(Mixture::new(lobes.map(|(w, lobe)| (w, Mixture::of(lobe)))).unwrap())
    };
    let colour = |channels| match channels {
        Channels::Grey => [2.0; 3],
        _ => [2.5, 1.0, 0.25],
    };
    let mut cases = Vec::new();
    for world in [World::Volumes, World::VolumesAndSurfaces] {
        let any = PhaseFunctions::Any;
        let axes = |events, channels, phase| KernelAxes { events, channels, world, phase };
        cases.push(Case {
            axes: axes(Events::None, Channels::Grey, any),
            voxels: None,
            media: vec![],
            distance: None,
        });
        for channels in [Channels::Grey, Channels::Split] {
            for phase in [PhaseFunctions::IsotropicOrHenyeyGreenstein, any] {
                let function = || if phase == any { other() } else { plain() };
                let sigma_t = colour(channels);
                for (voxels, medium) in [
                    ("binary16", cube_grid(0.8, sigma_t, albedo, function())),
                    ("binary32", lumpy_grid(0.8, sigma_t, albedo, function())),
                ] {
                    let (voxels, media) = (Some(voxels), vec![medium]);
                    let axes = axes(Events::OneGrid, channels, phase);
                    cases.push(Case { axes, voxels, media, distance: None });
                }
            }
        }
        for channels in [Channels::Grey, Channels::Split, Channels::Spectral] {
            let sigma_t = colour(channels);
            let media = vec![
                lumpy_grid(0.8, sigma_t, albedo, other()),
                cube_homogeneous(0.6, sigma_t.map(|s| 0.5 * s), albedo, plain()),
                cube_grid(0.4, [1.0; 3], albedo, plain()),
            ];
            let spectral = channels == Channels::Spectral;
            let distance = spectral.then_some(DistanceSampler::Spectral);
            let axes = axes(Events::MergedList, channels, any);
            cases.push(Case { axes, voxels: Some("binary32"), media, distance });
        }
    }
    cases
}

impl Case {
    fn scene(&self, meshes: &[(Triangles, serde_json::Value)]) -> Scene {
        let mut scene = scene(self.media.clone(), EYE, DVec3::ZERO, 40.0);
        scene.camera = Camera::look_at(EYE, DVec3::ZERO, DVec3::Y, 40.0, [32, 32]).unwrap();
        scene.environment.constant = Vec3::ONE;
        if self.axes.world == World::VolumesAndSurfaces {
            scene.surfaces = Some(surfaces(meshes));
        }
        scene
    }

    fn settings(&self, spp: u64, seed: u64) -> RenderSettings {
        RenderSettings { distance: self.distance, ..settings(spp, seed) }
    }

    fn name(&self) -> String {
        format!("{}, {}", self.axes, self.voxels.unwrap_or("no voxels"))
    }
}

/// A white sphere that reaches into the media, and a quad beside them.
fn white() -> Vec<(Triangles, serde_json::Value)> {
    let ball = sphere(DVec3::new(0.5, -0.3, 0.5), 0.45, 6);
    vec![
        (ball, lambert([1.0; 3])),
        (quad([-1.5, -1.0, -1.5], [0.0, 0.0, 3.0], [3.0, 0.0, 0.0]), lambert([1.0; 3])),
    ]
}

#[test]
fn each_scene_runs_the_kernel_it_is_for() {
    let all = cases(0.9);
    assert_eq!(all.len(), 2 * (1 + 8 + 3));
    for case in &all {
        let scene = case.scene(&white());
        let renderer = Renderer::new(&scene, &case.settings(1, 1)).unwrap();
        let plan = renderer.plan();
        assert_eq!(plan.kernel, case.axes);
        if case.axes.events == Events::OneGrid {
            assert_eq!(plan.volumes[0].voxels, case.voxels, "{}", case.name());
        }
    }
}

fn state(film: &Film) -> Vec<u8> {
    let mut bytes = Vec::new();
    film.write_state(&mut bytes, b"").unwrap();
    bytes
}

#[test]
fn threads_and_splits_change_no_bit_of_any_kernel() {
    for case in cases(0.9) {
        let mut scene = case.scene(&white());
        scene.lights.push(sun(Vec3::new(0.4, 0.8, 0.3), Vec3::new(2.0, 1.5, 1.0), 0.05));
        let film = |samples: std::ops::Range<u64>, threads: usize| {
            let settings = RenderSettings { samples, ..case.settings(1, 5) };
            let mut film = Film::new(scene.camera.resolution(), None).unwrap();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                Renderer::new(&scene, &settings).unwrap().render(&mut film, &Unmonitored).unwrap()
            });
            film
        };
        let whole = state(&film(0..9, 1));
        for threads in [2, 7] {
            assert!(state(&film(0..9, threads)) == whole, "{}: {threads} threads", case.name());
        }
        let mut merged = film(4..9, 2);
        merged.merge(&film(0..4, 7)).unwrap();
        assert!(state(&merged) == whole, "{}: splits", case.name());
    }
}

/// Light of radiance one from all around, nothing absorbs: whatever scatters it, every pixel is
/// one. Null hypothesis as in [`assert_one`]; false alarm below 1e-7 for all kernels. Most have no
/// noise at all; where there is some (spectral MIS) a bias of 7 % of a block would be seen with
/// probability .99.
#[test]
fn white_furnaces_stay_white_in_every_kernel() {
    for (seed, case) in (0u64..).zip(cases(1.0)) {
        let scene = case.scene(&white());
        let found = rendered(&scene, &case.settings(64, seed));
        assert_one(&case.name(), &found, 1e-4, 6e-3);
    }
}

/// A closed room whose black walls shine with radiance one, which shadow rays and paths both meet:
/// their weights add up to one in every kernel.
#[test]
fn a_shining_room_is_a_furnace_for_shadow_rays_and_paths() {
    // Turned inside out, so that it shines inwards.
    let room: Triangles = cube(5.0).into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let mut meshes = white();
    meshes.push((room, area_light([0.0; 3], [1.0; 3])));
    for (seed, case) in (100u64..).zip(cases(1.0)) {
        if case.axes.world == World::Volumes {
            continue;
        }
        let mut scene = case.scene(&meshes);
        scene.environment.constant = Vec3::ZERO;
        let settings = case.settings(256, seed);
        assert!(Renderer::new(&scene, &settings).unwrap().plan().mis);
        assert_one(&case.name(), &rendered(&scene, &settings), 1e-4, 8e-3);
    }
}
