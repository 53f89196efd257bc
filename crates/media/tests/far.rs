//! Voxels are as exact wherever they lie: clouds far from each other, from their grid's corner and
//! from the ray's origin.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use pileus_media::distance::DistanceSampler;
use pileus_media::emission::{EmissionField, EmissionSource};
use pileus_media::majorant::MajorantStructure;
use pileus_media::microflakes::{
    MicroflakeGrid, MicroflakeScattering, MicroflakeShape, Microflakes, Roughness,
};
use pileus_media::phase::CosineGrid;
use pileus_media::random::uniform;
use pileus_media::transmittance::{Estimator, optical_depth};
use pileus_media::{
    Albedo, ChromaticRatio, ColorGrid, ExactField, Grey, Interpolation, Medium, Phase, RayField,
    Spectrum, Tally, VoxelGrid, VoxelGridOptions,
};
use pileus_vdb::{Tile, Tree};
use rand_pcg::Pcg32;
use std::sync::Arc;

/// A cloud of 12^3 random voxels, a third of them empty.
fn cloud() -> Vec<f32> {
    let mut rng = Pcg32::new(12, 5);
    (0..12 * 12 * 12).map(|_| (1.5 * uniform(&mut rng) - 0.5).max(0.0)).collect()
}

/// That cloud at each of `places`, and single voxels.
fn tree(places: &[[i32; 3]], voxels: &[[i32; 3]]) -> Tree<f32> {
    let mut leaves = std::collections::BTreeMap::<[i32; 3], ([f32; 512], [u64; 8])>::new();
    let mut set = |at: [i32; 3], value: f32| {
        let leaf = leaves.entry(at.map(|c| c & !7)).or_insert(([0.0; 512], [0; 8]));
        let [x, y, z] = at.map(|c| (c & 7) as usize);
        let offset = x << 6 | y << 3 | z;
        leaf.0[offset] = value;
        leaf.1[offset >> 6] |= 1 << (offset & 63);
    };
    for place in places {
        for (i, value) in cloud().into_iter().enumerate() {
            let step = [i / 144, i / 12 % 12, i % 12].map(|c| c as i32);
            set([0, 1, 2].map(|axis| place[axis] + step[axis]), value);
        }
    }
    for voxel in voxels {
        set(*voxel, 1.0);
    }
    Tree::from_leaves(
        0.0,
        leaves.into_iter().map(|(origin, (values, mask))| (origin, values, mask)),
    )
}

fn grid(tree: &Tree<f32>, interpolation: Interpolation) -> Arc<VoxelGrid> {
    Arc::new(VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation }).unwrap())
}

fn medium(tree: &Tree<f32>, to_world: DAffine3, interpolation: Interpolation) -> Medium {
    let albedo = Albedo::Constant([0.5; 3]);
    Medium::from_grid(grid(tree, interpolation), to_world, [0.3; 3], albedo, Phase::Isotropic)
        .unwrap()
}

/// The integral of extinction over what the walk's segments hand out, by the midpoint rule on its
/// lookups, and its largest excess over the bound.
fn walked_depth(medium: &Medium, origin: DVec3, direction: Vec3) -> f64 {
    let Some(span) = medium.span(origin, direction, f64::INFINITY) else { return 0.0 };
    let mut ray = medium.any_ray(&span, 1.0);
    let mut depth = 0.0;
    while let Some(segment) = ray.next_segment() {
        let length = segment.t1 - segment.t0;
        // Eight a voxel or more: voxels are a tenth of a unit or larger.
        let n = (length / 0.0125).ceil().max(64.0) as u32;
        for i in 0..n {
            let t = segment.t0 + length * ((i as f32 + 0.5) / n as f32);
            let sigma_t = ray.sigma_t(t);
            assert!(sigma_t <= segment.majorant, "{sigma_t} above {}", segment.majorant);
            assert!(sigma_t >= ray.minorant());
            depth += f64::from(sigma_t) * f64::from(length) / f64::from(n);
        }
    }
    depth
}

/// Rays through a cloud at `centre` (world) of radius `radius`, from near and far.
fn rays(centre: DVec3, radius: f64, far: f64, n: u32) -> Vec<(DVec3, Vec3)> {
    let mut rng = Pcg32::new(3, 4);
    let mut u = || 2.0 * f64::from(uniform(&mut rng)) - 1.0;
    (0..n)
        .map(|i| {
            let target = centre + 0.6 * radius * DVec3::new(u(), u(), u());
            let direction = match i % 8 {
                0 => Vec3::AXES[i as usize / 8 % 3],
                1 => -Vec3::AXES[i as usize / 8 % 3],
                _ => DVec3::new(u(), u(), u()).normalize().as_vec3(),
            };
            let back = if i % 2 == 0 { 3.0 * radius } else { far };
            (target - direction.as_dvec3() * back, direction)
        })
        .collect()
}

const PLACES: [[i32; 3]; 9] = [
    [300_000, 300_000, 300_000],
    [16_777_216, 16_777_216, 16_777_216],
    [100_000_000, 100_000_000, 100_000_000],
    [1 << 29, 5, 1 << 29],
    [(1 << 30) - 40, (1 << 30) - 40, (1 << 30) - 40],
    [-300_000, 40, 9000],
    [-100_000_000, -100_000_000, 100_000_000],
    [-(1 << 30) + 40, 7, -(1 << 29)],
    [4000, 4093, 8187],
];

/// The walk's own lookups along its own segments add up to the exact depth, which is that of the
/// cloud alone: to 4e-3 of it (what the rule errs by), wherever it lies. At 300000 voxels from the
/// corner single precision was off by up to 2.5e-2, at 16777216 by half.
#[test]
fn clouds_far_from_their_corner_are_exact() {
    let index = |place: [i32; 3]| DVec3::from_array(place.map(f64::from));
    let transforms = [
        DAffine3::from_scale(DVec3::splat(0.2)),
        DAffine3::from_scale_rotation_translation(
            DVec3::new(0.2, 0.3, 0.1),
            DQuat::from_rotation_y(0.7) * DQuat::from_rotation_x(2.0),
            DVec3::new(1e5, -3e6, 20.0),
        ),
    ];
    for interpolation in [Interpolation::Trilinear, Interpolation::Nearest] {
        for (k, place) in PLACES.into_iter().enumerate() {
            let to_world = transforms[k % 2];
            let alone = medium(&tree(&[[0; 3]], &[]), to_world, interpolation);
            let far = medium(&tree(&[place], &[[0; 3]]), to_world, interpolation);
            let shift = to_world.transform_vector3(index(place));
            let centre = to_world.transform_point3(DVec3::splat(5.5));
            let (mut worst, mut worst_walked) = (0.0f64, 0.0f64);
            for (origin, direction) in rays(centre, 1.2, 1e5, 24) {
                let tally = &mut Tally::default();
                let d = direction.as_dvec3();
                let exact = optical_depth(&alone, origin, d, 0.0, f64::INFINITY, tally);
                let at = origin + shift;
                let moved = optical_depth(&far, at, d, 0.0, f64::INFINITY, tally);
                // The shift itself rounds to 1e-7 voxels or so, and jumps of nearest voxels see it.
                let slack = 2e-5 + 1e-4 * exact;
                worst = worst.max((moved - exact).abs() / slack);
                let walked = walked_depth(&far, at, direction);
                let exact_walk = walked_depth(&alone, origin, direction);
                // The rule sees jumps of nearest voxels a step late.
                let rule = if interpolation == Interpolation::Nearest { 10.0 } else { 1.0 };
                let allowed = rule * (1e-3 + 4e-3 * exact);
                worst_walked = worst_walked.max((walked - exact_walk).abs() / allowed);
                let span = far.span(at, direction, f64::INFINITY);
                let depth = span.map_or(0.0, |span| far.any_ray(&span, 1.0).optical_depth(tally));
                assert!((depth - moved).abs() <= 1e-5 + 1e-4 * exact, "{place:?} {depth} {moved}");
            }
            assert!(worst < 1.0 && worst_walked < 1.0, "{place:?} {worst} {worst_walked}");
        }
    }
}

/// Several clouds on one line, 10^8 voxels apart, with a tile of 4096^3 between them: depths add
/// up, flights by any method end where the depth says, and what lies between costs a few steps.
#[test]
fn clusters_far_apart_on_one_ray() {
    let places = [[0, 0, 0], [100_000_000, 0, 0], [100_000_100, 0, 0], [(1 << 30) - 64, 0, 0]];
    let tile = Tile { origin: [50_003_968, 0, 0], log2_size: 12, value: 1e-4, active: true };
    let several = tree(&places, &[]).with_tiles([tile]);
    let place = DAffine3::from_scale(DVec3::splat(0.5));
    for structure in
        [MajorantStructure::Adaptive, MajorantStructure::Hierarchy, MajorantStructure::Global]
    {
        let far = medium(&several, place, Interpolation::Trilinear);
        let far = far.with_majorants(structure, 1.0).unwrap();
        let one = medium(&tree(&[[0; 3]], &[]), place, Interpolation::Trilinear);
        for d in [Vec3::X, Vec3::NEG_X] {
            let start = if d.x > 0.0 { -5.0 } else { 6e8 };
            let (y, z) = (2.3, 2.6);
            let tally = &mut Tally::default();
            let cloud = optical_depth(&one, DVec3::new(-5.0, y, z), DVec3::X, 0.0, 20.0, tally);
            let exact = 4.0 * cloud + 0.3 * 1e-4 * 2048.0;
            let span = far.span(DVec3::new(start, y, z), d, f64::INFINITY).unwrap();
            let field = || far.any_ray(&span, 1.0);
            let depth = field().optical_depth(tally);
            assert!((depth - exact).abs() < 1e-5 * exact, "{depth} {exact}");
            assert!((walked_depth(&far, DVec3::new(start, y, z), d) - exact).abs() < 2e-3 * exact);
            // The depth up to where a flight ends, by parameter and by distance.
            for share in [0.1, 0.24, 0.26, 0.4, 0.6, 0.9, 0.999] {
                let t = field().t_at_depth(share * depth, tally).unwrap();
                let end = far.world_distance(&span, t);
                let o = DVec3::new(start, y, z);
                let up_to = optical_depth(&far, o, d.as_dvec3(), 0.0, end, tally);
                assert!((up_to - share * depth).abs() < 2e-3 * depth, "{share} {up_to} {depth}");
            }
            // H0: estimators have this mean. 4000 estimates, |z| < 5: false alarm 6e-7 each, 5e-5
            // in all ten thousand such suites. A bias of 2 % is seen.
            let transmittance = (-exact).exp();
            for estimator in
                [Estimator::Ratio, Estimator::ResidualRatio, Estimator::UnbiasedRayMarching]
            {
                if structure == MajorantStructure::Global {
                    continue;
                }
                let mut rng = Pcg32::new(8, 8);
                let n = 4000;
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..n {
                    let x = f64::from(estimator.estimate(field(), Grey, 0.0, &mut rng, tally));
                    (sum, squares) = (sum + x, squares + x * x);
                }
                let n = f64::from(n);
                let error = ((squares / n - (sum / n).powi(2)) / n).sqrt();
                let z = (sum / n - transmittance) / error.max(1e-6 * transmittance);
                assert!(z.abs() < 5.0, "{estimator:?} {} {transmittance} z {z}", sum / n);
            }
            let mut ray = field();
            while ray.next_segment().is_some() {}
            assert!(ray.steps() < 4000, "{structure:?}: {} steps", ray.steps());
            assert_eq!(tally.violations, 0);
        }
    }
}

/// Emission, albedos, mean cosines and microflakes by grids lie where the density does: at 10^8
/// voxels as at the origin.
#[test]
fn grids_of_other_properties_are_as_exact() {
    let place = [100_000_000; 3];
    let shift = 20_000_000.0;
    let to_world = DAffine3::from_scale(DVec3::splat(0.2));
    let (near, far) = (tree(&[[0; 3]], &[]), tree(&[place], &[[0; 3]]));
    // Emission: points at equal steps of the rate; the mean over offsets is the line integral of
    // the emission.
    let field = |tree: &Tree<f32>| {
        let grid = grid(tree, Interpolation::Trilinear);
        EmissionField::new(EmissionSource::Grid { grid, color: [1.0, 0.5, 0.2] }, to_world).unwrap()
    };
    let glow = field(&far);
    let density = medium(&near, to_world, Interpolation::Trilinear);
    let mut seen = 0;
    for (origin, direction) in rays(DVec3::splat(1.1), 1.2, 1e5, 24) {
        let tally = &mut Tally::default();
        let exact =
            optical_depth(&density, origin, direction.as_dvec3(), 0.0, f64::INFINITY, tally) / 0.3;
        let offsets = 400;
        let (mut sum, mut by_place) = (0.0, 0.0);
        for i in 0..offsets {
            let u = (i as f32 + 0.5) / offsets as f32;
            glow.points(origin + shift, direction, f64::INFINITY, u, tally, |point| {
                sum += f64::from(point.contribution.x) / f64::from(offsets);
                by_place += f64::from(glow.emission(point.p).x / point.rate) / f64::from(offsets);
                seen += 1;
            });
        }
        assert!((sum - exact).abs() < 4e-3 * exact + 1e-4, "{sum} {exact}");
        // What was looked up on the way is what is at the point in the world.
        assert!((by_place - exact).abs() < 4e-3 * exact + 1e-4, "{by_place} {exact}");
        assert_eq!(tally.violations, 0);
    }
    assert!(seen > 1000, "{seen}");
    // Where paths scatter: by points, in double precision.
    let color = |tree: &Tree<f32>| ColorGrid::from_float_tree(tree, DAffine3::IDENTITY).unwrap();
    let cosine = |t: &Tree<f32>| CosineGrid::new(t, 0.9, 0.0, DAffine3::IDENTITY).unwrap();
    let (colors, cosines) = ([color(&near), color(&far)], [cosine(&near), cosine(&far)]);
    let mut rng = Pcg32::new(5, 6);
    for _ in 0..500 {
        let u = DVec3::from_array([(); 3].map(|()| f64::from(uniform(&mut rng)))) * 11.0;
        let p = u + DVec3::from_array(place.map(f64::from));
        let (a, b) = (colors[0].at_index(u), colors[1].at_index(p));
        assert!((a - b).abs().max_element() < 1e-5, "{a} {b}");
        assert!((cosines[0].at_index(u) - cosines[1].at_index(p)).abs() < 1e-5);
    }
    // Microflakes by grid: the walk's extinction is that of the point, with the area that the
    // microflakes there show.
    let axes = |tree: &Tree<f32>| tree.clone().map(|v| [v, 0.4 - v, 0.1]);
    let microflakes = |tree: &Tree<f32>| {
        let grid =
            MicroflakeGrid::fibres(&axes(tree), Roughness::Constant(0.1), DAffine3::IDENTITY)
                .unwrap();
        Microflakes::new(
            MicroflakeShape::Grid(Box::new(grid)),
            MicroflakeScattering::Specular,
            to_world.matrix3,
        )
    };
    let of_flakes = |tree: &Tree<f32>| {
        let (grid, phase) =
            (grid(tree, Interpolation::Trilinear), Phase::Microflakes(Arc::new(microflakes(tree))));
        Medium::from_grid(grid, to_world, [0.3; 3], Albedo::Constant([1.0; 3]), phase).unwrap()
    };
    let (near, far) = (of_flakes(&near), of_flakes(&far));
    for (origin, direction) in rays(DVec3::splat(1.1), 1.2, 1e5, 24) {
        let depth = |medium: &Medium, origin: DVec3| {
            let Some(span) = medium.span(origin, direction, f64::INFINITY) else { return 0.0 };
            let mut ray = medium.any_ray(&span, 1.0);
            let mut sum = 0.0;
            while let Some(s) = ray.next_segment() {
                for i in 0..64 {
                    let t = s.t0 + (s.t1 - s.t0) * (i as f32 + 0.5) / 64.0;
                    sum += f64::from(ray.sigma_t(t) * (s.t1 - s.t0) / 64.0);
                }
            }
            sum
        };
        let (a, b) = (depth(&near, origin), depth(&far, origin + shift));
        assert!((a - b).abs() < 5e-3 * a + 1e-3, "{a} {b}");
    }
}

/// A grid that spans 2^31 voxels is refused with its size and a way out; one below that is not.
#[test]
fn what_cannot_be_addressed_is_refused() {
    let corner = 1 << 30;
    let wide = tree(&[], &[[-corner, 0, 0], [corner - 1, 0, 0]]);
    let error = VoxelGrid::from_tree(&wide, &VoxelGridOptions::default()).unwrap_err().to_string();
    assert!(error.contains("more voxels than can be addressed"), "{error}");
    let most = tree(&[], &[[-(corner - (1 << 28)), 0, 0], [corner - 2, 0, 0]]);
    let grid = grid(&most, Interpolation::Trilinear);
    assert!(grid.range().0 == 0.0 && (grid.range().1 - 1.0).abs() < 1e-6);
}

/// A ray whose origin is 10^6 voxels off, in every direction, through an ordinary grid: its depth
/// by the walk is the exact one to 1e-3. Rounded directions missed by 0.1 voxels.
#[test]
fn origins_far_from_the_grid() {
    let near = medium(
        &tree(&[[0; 3]], &[]),
        DAffine3::from_scale(DVec3::splat(0.2)),
        Interpolation::Trilinear,
    );
    for far in [2e5, 2e6, 2e7] {
        for (origin, direction) in rays(DVec3::splat(1.1), 1.0, far, 40) {
            let tally = &mut Tally::default();
            let d = direction.as_dvec3();
            let exact = optical_depth(&near, origin, d, 0.0, f64::INFINITY, tally);
            let walked = walked_depth(&near, origin, direction);
            assert!((walked - exact).abs() < 2e-3 * exact + 4e-4, "{far}: {walked} {exact}");
        }
    }
}

/// One segment of constant extinction under a loose bound.
#[derive(Clone)]
struct Loose {
    sigma_t: f32,
    majorant: f32,
    length: f32,
    begun: bool,
}

impl RayField for Loose {
    fn next_segment(&mut self) -> Option<pileus_media::MajorantSegment> {
        (!std::mem::replace(&mut self.begun, true)).then_some(pileus_media::MajorantSegment {
            t0: 0.0,
            t1: self.length,
            majorant: self.majorant,
        })
    }
    fn minorant(&self) -> f32 {
        0.0
    }
    fn sigma_t(&self, _: f32) -> f32 {
        self.sigma_t
    }
    fn sigma_t_anywhere(&self, _: f32) -> f32 {
        self.sigma_t
    }
    fn steps(&self) -> u64 {
        1
    }
}

impl ExactField for Loose {
    fn optical_depth(&self, _: &mut Tally) -> f64 {
        f64::from(self.sigma_t) * f64::from(self.length)
    }
    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        let whole = self.optical_depth(tally);
        if depth <= whole { Ok((depth / f64::from(self.sigma_t)) as f32) } else { Err(whole) }
    }
}

/// Thin fog beside something very dense: twelve million tentative collisions of which each is real
/// with probability 1e-15 have none that is (1 - 5e-8 for all flights of all methods). At 2^-24
/// each, as canonical numbers have it, every flight had one with probability 0.5.
#[test]
fn flights_through_thin_fog_under_a_dense_bound_pass() {
    let field = Loose { sigma_t: 1e-15, majorant: 1.0, length: 1.2e7, begun: false };
    let mut rng = Pcg32::new(4, 4);
    for sampler in
        [DistanceSampler::Delta, DistanceSampler::Spectral, DistanceSampler::Decomposition]
    {
        for _ in 0..2 {
            let tally = &mut Tally::default();
            let flight = sampler.fly(field.clone(), Grey, 1.0, None, &mut rng, tally);
            assert_eq!(tally.collisions, 0, "{sampler:?}: {flight:?}");
            assert!(tally.lookups > 11_000_000);
            assert!(flight.weight == 1.0);
        }
    }
}

/// The opposite error of shadow rays: factors of 1 - 2e-8 are not representable, yet twelve million
/// of them leave 0.787. One walk has a standard deviation of 1.5e-3;
/// |z| < 6, false alarm 2e-9 each. Before, transmittances were 1.
#[test]
fn shadow_rays_through_thin_fog_under_a_dense_bound_are_dimmed() {
    let field = Loose { sigma_t: 2e-8, majorant: 1.0, length: 1.2e7, begun: false };
    let expected = (-0.24f64).exp();
    let mut rng = Pcg32::new(5, 4);
    let tally = &mut Tally::default();
    for estimator in [Estimator::Ratio, Estimator::ResidualRatio] {
        let grey = estimator.estimate(field.clone(), Grey, 0.1, &mut rng, tally);
        assert!((f64::from(grey) - expected).abs() < 9e-3, "{estimator:?} {grey} {expected}");
    }
    // Channels as well: a weak one beside a strong one is what the strong one's majorant hides.
    let weak = Loose { sigma_t: 1.0, majorant: 1.0, length: 1e5, begun: false };
    let relative = ChromaticRatio(Vec3::new(0.0, 2e-6, 4e-6));
    let colors = Estimator::Ratio.estimate(weak, relative, 0.1, &mut rng, tally);
    assert_eq!(colors.x, 1.0);
    for (channel, depth) in [(1, 0.2f64), (2, 0.4)] {
        let found = f64::from(colors.channel(channel));
        assert!((found - (-depth).exp()).abs() < 1.5e-2, "{channel} {found}");
    }
}

/// What is out of range is counted by grid, so that it can be said.
#[test]
fn values_out_of_range_are_counted() {
    let values: Vec<[f32; 3]> = (0..8).map(|i| [i as f32 * 36.0, 0.5, f32::NAN]).collect();
    let colors = Tree::from_dense([0.0; 3], [0; 3], [2; 3], &values);
    let found = ColorGrid::from_vec3_tree(&colors, DAffine3::IDENTITY).unwrap().clamped();
    assert_eq!((found.non_finite, found.below, found.above, found.largest), (8, 0, 7, 252.0));
    let cosines = Tree::from_dense(0.0, [0; 3], [2, 1, 1], &[-1.5, 0.5]);
    let found = CosineGrid::new(&cosines, 1.0, 0.0, DAffine3::IDENTITY).unwrap().clamped();
    assert_eq!((found.non_finite, found.below, found.above), (0, 1, 0));
}
