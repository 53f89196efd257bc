//! Bounds hold everywhere, and the walk tiles every ray.

mod common;

use glam::{DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::majorant::MajorantStructure;
use pileus_media::random::uniform;
use pileus_media::{
    Albedo, Interpolation, MajorantSegment, Medium, Phase, RayField, VoxelGrid, VoxelGridOptions,
};
use pileus_vdb::{Tree, VdbFile};
use rand_core::Rng;
use rand_pcg::Pcg32;
use std::sync::Arc;

/// All float grids of zero background of the repository's assets and the conformance set.
fn all_trees() -> Vec<(String, Tree<f32>)> {
    let mut trees = Vec::new();
    for folder in ["scenes/assets", "tests/data/conformance"] {
        let mut paths: Vec<_> = std::fs::read_dir(common::root().join(folder))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|e| e == "vdb"))
            .collect();
        paths.sort();
        for path in paths {
            let file = VdbFile::open(&path).unwrap();
            for index in 0..file.grids().len() {
                let Ok(grid) = file.read(index) else { continue };
                let name = format!("{} {}", path.file_name().unwrap().display(), grid.info.name);
                let Ok(tree) = grid.to_float() else { continue };
                trees.push((name, tree));
            }
        }
    }
    assert!(trees.len() > 40, "only {} grids found", trees.len());
    trees
}

fn point_in(low: DVec3, high: DVec3, rng: &mut Pcg32) -> DVec3 {
    let u = DVec3::new(f64::from(uniform(rng)), f64::from(uniform(rng)), f64::from(uniform(rng)));
    low + (high - low) * u
}

#[test]
fn stored_values_are_the_trees() {
    for (name, tree) in all_trees() {
        let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).unwrap();
        let mut rng = Pcg32::new(5, 5);
        let clean = |v: f32| if v.is_finite() && v > 0.0 { v } else { 0.0 };
        for _ in 0..20_000 {
            let ijk = if tree.leaves().is_empty() || rng.next_u32().is_multiple_of(8) {
                let corner = tree.tiles().first().map_or([0; 3], |t| t.origin);
                corner.map(|c| c.wrapping_add((rng.next_u32() % 300) as i32 - 100))
            } else {
                let leaf = &tree.leaves()[rng.next_u32() as usize % tree.leaves().len()];
                leaf.origin.map(|c| c + (rng.next_u32() % 10) as i32 - 1)
            };
            assert_eq!(grid.value(ijk), clean(tree.value(ijk).0), "{name} at {ijk:?}");
            let p = DVec3::from_array(ijk.map(f64::from));
            assert_eq!(grid.interpolate(p) as f32, grid.value(ijk), "{name} at {ijk:?}");
        }
    }
}

/// Trilinear interpolation written out from the tree's values, as OpenVDB defines it.
#[test]
fn interpolation_is_openvdbs() {
    for (name, tree) in all_trees() {
        let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions::default()).unwrap();
        let Some(Bounds3 { low, high }) = grid.bounds_index() else { continue };
        let high = high.min(low + 5000.0);
        let mut rng = Pcg32::new(6, 5);
        for _ in 0..2000 {
            let p = point_in(low - 1.0, high + 1.0, &mut rng);
            let base = p.floor();
            let f = p - base;
            let mut expected = 0.0;
            for corner in 0..8 {
                let step = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let ijk = [0, 1, 2].map(|axis| base[axis] as i32 + step[axis]);
                let v = tree.value(ijk).0;
                let v = if v.is_finite() && v > 0.0 { f64::from(v) } else { 0.0 };
                let w = |axis: usize| if step[axis] == 1 { f[axis] } else { 1.0 - f[axis] };
                expected += v * w(0) * w(1) * w(2);
            }
            let value = grid.interpolate(p);
            let tolerance = 1e-12 * f64::from(grid.range().1).max(1e-30);
            assert!(
                (value - expected).abs() <= tolerance.max(1e-12 * expected),
                "{name} at {p}: {value} {expected}"
            );
        }
    }
}

/// Walks a ray; checks that segments tile it, that no lookup leaves its bounds and that what lies
/// between segments is empty.
fn check_ray(
    name: &str,
    medium: &Medium,
    origin: DVec3,
    direction: Vec3,
    t_max: f64,
    rng: &mut Pcg32,
) {
    let Some(span) = medium.span(origin, direction, t_max) else { return };
    let mut ray = medium.any_ray(&span, 1.0);
    let mut t = 0.0f32;
    let mut checked = 0;
    let empty = |from: f32, to: f32, rng: &mut Pcg32| {
        // Shorter gaps are what the rounding of positions to single precision leaves.
        if to - from > 1e-5 * span.length {
            let t = from + (to - from) * uniform(rng);
            let p = origin + direction.as_dvec3() * medium.world_distance(&span, t);
            let value = medium.sigma_t_at(p);
            // Single precision may be off by some 1e-3 voxels at the ends of what was skipped.
            let bound = medium.largest_sigma_t();
            assert!(
                value <= 2e-2 * bound,
                "{name}: {value} of {bound} at {t} of {from} to {to}, in a skipped part"
            );
        }
    };
    while let Some(segment) = ray.next_segment() {
        let MajorantSegment { t0, t1, majorant } = segment;
        assert!(t0 >= t && t1 >= t0 && t1 <= span.length, "{name}: {segment:?} after {t}");
        assert!(majorant > 0.0 && majorant.is_finite(), "{name}: {segment:?}");
        empty(t, t0, rng);
        let minorant = ray.minorant();
        assert!(minorant >= 0.0 && minorant <= majorant, "{name}: {minorant} {majorant}");
        for u in [0.0, uniform(rng), 1.0] {
            let sigma_t = ray.sigma_t(t0 + (t1 - t0) * u);
            assert!(sigma_t <= majorant, "{name}: {sigma_t} above {majorant}");
            assert!(sigma_t >= minorant, "{name}: {sigma_t} below {minorant}");
            checked += 1;
        }
        t = t1;
        assert!(checked < 3_000_000, "{name}: the walk does not end");
    }
    empty(t, span.length, rng);
}

#[test]
fn bounds_hold_and_segments_tile_on_all_assets() {
    for (name, tree) in all_trees() {
        for interpolation in [Interpolation::Nearest, Interpolation::Trilinear] {
            let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions { interpolation }).unwrap();
            let Some(Bounds3 { low, high }) = grid.bounds_index() else { continue };
            if grid.background() != 0.0 || grid.range().1 > 1e28 {
                continue;
            }
            let grid = Arc::new(grid);
            let size = (high - low).max_element();
            // Thin, medium and thick: the size of cells depends on it.
            for depth in [0.1, 10.0, 1e4] {
                let scale = (depth / (size * f64::from(grid.range().1).max(1e-20))) as f32;
                let medium = Medium::from_grid(
                    Arc::clone(&grid),
                    glam::DAffine3::IDENTITY,
                    [scale; 3],
                    Albedo::Constant([1.0; 3]),
                    Phase::Isotropic,
                )
                .unwrap();
                let mut rng = Pcg32::new(1, 2);
                let structures = [
                    MajorantStructure::Adaptive,
                    MajorantStructure::Hierarchy,
                    MajorantStructure::KdTree,
                    MajorantStructure::Uniform(5),
                    MajorantStructure::Uniform(16),
                    MajorantStructure::Global,
                ];
                // Super-grids of vast sparse grids would take too many cells: refused.
                let media: Vec<Medium> =
                    structures.iter().filter_map(|s| medium.with_majorants(*s, 1.0).ok()).collect();
                assert!(media.len() >= 4, "{name}: {} structures", media.len());
                for kind in 0..120 {
                    let medium = &media[(kind / 6) % media.len()];
                    let from = point_in(low, high, &mut rng);
                    let to = point_in(low, high, &mut rng);
                    let (origin, direction) = match kind % 6 {
                        0 => (from + (from - to) * 3.0, to - from),
                        1 => (from, to - from),
                        // Along an axis through the interior, on a lattice face, on a lattice edge.
                        2 => (from, DVec3::AXES[kind / 6 % 3]),
                        3 => (
                            from.with_x(from.x.round()),
                            DVec3::new(0.0, to.y - from.y, to.z - from.z),
                        ),
                        4 => (from.round() - DVec3::Z * 2.0 * size, DVec3::Z),
                        // Through corners, diagonally.
                        _ => (
                            from.round(),
                            DVec3::new(1.0, -1.0, if kind % 4 == 1 { 1.0 } else { -1.0 }),
                        ),
                    };
                    if direction.length() < 1e-9 {
                        continue;
                    }
                    let t_max = if kind % 7 == 0 { size * 0.3 } else { f64::INFINITY };
                    let direction = direction.normalize().as_vec3();
                    let name =
                        format!("{name} {}", medium.grid().unwrap().majorants().structure().name());
                    check_ray(&name, medium, origin, direction, t_max, &mut rng);
                }
            }
        }
    }
}

#[test]
fn spans_of_no_length_and_misses_are_none() {
    let medium = common::medium(&common::asset("syn_sphere.vdb"), "density", 1.0);
    let Bounds3 { low, high } = medium.bounds_world().unwrap();
    let middle = 0.5 * (low + high);
    assert!(medium.span(middle, Vec3::X, 0.0).is_none());
    assert!(medium.span(high + 1.0, Vec3::X, f64::INFINITY).is_none());
    assert!(medium.span(middle, Vec3::X, f64::INFINITY).is_some());
    assert!(medium.span(middle, Vec3::new(f32::NAN, 0.0, 0.0), f64::INFINITY).is_none());
}

/// All structures give the exact transmittance by ratio tracking, and never more lookups than the
/// global bound. Null hypothesis: the mean is exact; |z| < 6 on 240 means, false alarm 5e-7 under
/// the normal law.
#[test]
fn structures_agree_on_transmittance() {
    use pileus_media::transmittance::ratio_tracking;
    use pileus_media::{Tally, TentativeCollisions, optical_depth};
    for (name, depth) in
        [("cumulus_small.vdb", 2.0), ("syn_plume.vdb", 2.0), ("smoke_plume.vdb", 2.0)]
    {
        let unit = common::medium(&common::asset(name), "density", 1.0);
        let Bounds3 { low, high } = unit.bounds_world().unwrap();
        let mut rng = Pcg32::new(8, 8);
        let mut tested = 0;
        while tested < 8 {
            let (from, to) = (point_in(low, high, &mut rng), point_in(low, high, &mut rng));
            let direction = (to - from).normalize();
            let tau = optical_depth(&unit, from, direction, 0.0, 1e9, &mut Tally::default());
            if tau < 1e-3 {
                continue;
            }
            let scale = (depth / tau) as f32;
            let (_, to_world) = common::read(&common::asset(name), "density");
            let (grid, phase) = (unit.grid().unwrap().voxels().clone(), Phase::Isotropic);
            let albedo = Albedo::Constant([1.0; 3]);
            let medium = Medium::from_grid(grid, to_world, [scale; 3], albedo, phase).unwrap();
            let mut lookups = Vec::new();
            for structure in [
                MajorantStructure::Adaptive,
                MajorantStructure::Hierarchy,
                MajorantStructure::KdTree,
                MajorantStructure::Uniform(3),
                MajorantStructure::Uniform(32),
                MajorantStructure::Global,
            ] {
                let medium = medium.with_majorants(structure, 1.0).unwrap();
                let span = medium.span(from, direction.as_vec3(), f64::INFINITY).unwrap();
                let mut tally = Tally::default();
                let n = 4000;
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..n {
                    let walk = TentativeCollisions::new(medium.any_ray(&span, 1.0));
                    let x = f64::from(ratio_tracking(walk, &mut rng, &mut tally));
                    sum += x;
                    squares += x * x;
                }
                assert_eq!(tally.violations, 0);
                let mean = sum / f64::from(n);
                let variance = squares / f64::from(n) - mean * mean;
                let exact = (-depth).exp();
                let z = (mean - exact) / (variance / f64::from(n)).sqrt().max(1e-5 * exact);
                assert!(z.abs() < 6.0, "{name} {structure:?}: {mean} {exact}, z {z:.2}");
                lookups.push(tally.lookups as f64);
            }
            let global = lookups[lookups.len() - 1];
            assert!(lookups.iter().all(|n| *n < 1.02 * global), "{name}: {lookups:?}");
            tested += 1;
        }
    }
}

/// The cell around a voxel does not depend on where a walk came from: the densities of multiple
/// importance sampling rely on it. Two rays through the same points in opposite directions see the
/// same majorants.
#[test]
fn majorants_are_a_function_of_the_point() {
    for name in ["cumulus_small.vdb", "syn_plume.vdb", "arnold_smoke.vdb"] {
        for scale in [1e-3, 0.1, 30.0] {
            let medium = common::medium(&common::asset(name), "density", scale);
            for structure in [MajorantStructure::Adaptive, MajorantStructure::Hierarchy] {
                let medium = medium.with_majorants(structure, 1.0).unwrap();
                let Bounds3 { low, high } = medium.bounds_world().unwrap();
                let mut rng = Pcg32::new(9, 9);
                let mut compared = 0;
                for _ in 0..200 {
                    let (from, to) = (point_in(low, high, &mut rng), point_in(low, high, &mut rng));
                    let length = (to - from).length();
                    let d = ((to - from) / length).as_vec3();
                    let (Some(there), Some(back)) =
                        (medium.span(from, d, length), medium.span(to, -d, length))
                    else {
                        continue;
                    };
                    let segments = |span| {
                        let mut ray = medium.any_ray(span, 1.0);
                        std::iter::from_fn(move || ray.next_segment()).collect::<Vec<_>>()
                    };
                    let (there, back) = (segments(&there), segments(&back));
                    let total = length as f32;
                    for s in &there {
                        let middle = total - 0.5 * (s.t0 + s.t1);
                        // Slivers between nearly equal faces may round away.
                        if s.t1 - s.t0 < 1e-3 * total {
                            continue;
                        }
                        let met = back.iter().find(|b| b.t0 <= middle && middle <= b.t1);
                        let met = met.unwrap_or_else(|| {
                            panic!("{name}: nothing at {middle} on the way back")
                        });
                        assert_eq!(met.majorant, s.majorant, "{name} {structure:?} at {middle}");
                        compared += 1;
                    }
                }
                assert!(compared >= 100, "{name}: {compared}");
            }
        }
    }
}
