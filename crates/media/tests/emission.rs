//! Light from volumes: line integrals, directions and power against quadrature and closed forms.

mod common;

use glam::{DAffine3, DVec3, Vec3};
use pileus_media::Bounds3;
use pileus_media::emission::{
    BlackbodyRadiance, ColorRamp, EmissionDirections, EmissionField, EmissionPoint, EmissionSource,
    blackbody,
};
use pileus_media::random::uniform;
use pileus_media::{Albedo, Interpolation, Phase, Tally, VoxelGrid, VoxelGridOptions};
use pileus_vdb::Tree;
use rand_pcg::Pcg32;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::sync::Arc;

const LUMINANCE: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);

fn grid(tree: &Tree<f32>) -> Arc<VoxelGrid> {
    Arc::new(VoxelGrid::from_tree(tree, &VoxelGridOptions::default()).unwrap())
}

fn fire(name: &str) -> (Arc<VoxelGrid>, DAffine3) {
    let (tree, to_world) = common::read(&common::asset("fire_0003.vdb"), name);
    (grid(&tree), to_world)
}

fn flames() -> EmissionField {
    let (grid, to_world) = fire("flame");
    let source = EmissionSource::Grid { grid, color: [20.0, 7.0, 1.6] };
    EmissionField::new(source, to_world).unwrap()
}

/// The fire as glowing soot: temperatures of 0 to 3 units at 1000 K each.
fn soot(radiance: BlackbodyRadiance) -> EmissionField {
    let (density, to_world) = fire("density");
    let (temperature, temperature_to_world) = fire("temperature");
    let source = EmissionSource::Blackbody {
        density,
        sigma_t: [4.0; 3],
        albedo: Albedo::Constant([0.5; 3]),
        temperature,
        to_temperature: temperature_to_world.inverse() * to_world,
        kelvin_per_unit: 1000.0,
        kelvin_offset: 0.0,
        radiance,
        intensity: 1.0,
        phase: Phase::Isotropic,
    };
    EmissionField::new(source, to_world).unwrap()
}

fn heat() -> EmissionField {
    let (grid, to_world) = fire("temperature");
    let ramp = [(0.5, [0.0; 3]), (1.0, [1.0, 0.1, 0.0]), (2.0, [5.0, 3.0, 0.5]), (2.5, [9.0; 3])];
    let source = EmissionSource::Ramp { grid, ramp: ColorRamp::new(ramp).unwrap() };
    EmissionField::new(source, to_world).unwrap()
}

fn all() -> [(&'static str, EmissionField); 4] {
    [
        ("flames", flames()),
        ("soot", soot(BlackbodyRadiance::Absolute)),
        ("coloured soot", soot(BlackbodyRadiance::Normalised)),
        ("heat", heat()),
    ]
}

fn point_in(bounds: Bounds3, rng: &mut Pcg32) -> DVec3 {
    bounds.at(DVec3::from_array([(); 3].map(|()| f64::from(uniform(rng)))))
}

fn points(field: &EmissionField, origin: DVec3, d: Vec3, t_max: f64, u: f32) -> Vec<EmissionPoint> {
    let mut points = Vec::new();
    let mut tally = Tally::default();
    field.points(origin, d, t_max, u, &mut tally, |point| points.push(point));
    assert_eq!(tally.violations, 0);
    assert_eq!(tally.lookups, points.len() as u64);
    points
}

/// The sum over points estimates the line integral with any weight. Null hypothesis: its mean is
/// that of dense quadrature; |z| < 6.5 on 480 means (4 fields, 40 rays, 3 channels), false alarm
/// 4e-8 under the normal law. The quadrature's own error is allowed for with 3e-5 of the integral.
#[test]
fn points_estimate_line_integrals() {
    let mut rng = Pcg32::new(1, 1);
    for (name, field) in all() {
        let bounds = field.bounds_world().unwrap();
        let (mut tested, mut total, mut met) = (0, 0u64, 0u64);
        while tested < 40 {
            let (from, to) = (point_in(bounds, &mut rng), point_in(bounds, &mut rng));
            let d = (to - from).normalize().as_vec3();
            let t_max = if tested % 2 == 0 { (to - from).length() } else { 6.0 };
            let from = if tested % 4 == 3 { from - 2.0 * d.as_dvec3() } else { from };
            let weight = |t: f64| (1.3 + (3.0 * t).sin()) * (-0.7 * t).exp();
            let steps = 20_000;
            let dt = t_max / f64::from(steps);
            let mut exact = DVec3::ZERO;
            for i in 0..steps {
                let t = dt * (f64::from(i) + 0.5);
                exact += field.emission(from + t * d.as_dvec3()).as_dvec3() * weight(t) * dt;
            }
            if exact.x < 1e-3 * field.power() {
                continue;
            }
            let n = 3000;
            let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
            for _ in 0..n {
                let points = points(&field, from, d, t_max, uniform(&mut rng));
                total += points.len() as u64;
                let x: DVec3 = points.iter().map(|p| p.contribution.as_dvec3() * weight(p.t)).sum();
                sum += x;
                squares += x * x;
            }
            met += n as u64;
            let mean = sum / f64::from(n);
            let variance = (squares / f64::from(n) - mean * mean) / f64::from(n);
            for channel in 0..3 {
                let slack = 3e-5 * exact.max_element();
                let error = (variance[channel] + slack * slack).sqrt();
                let z = (mean[channel] - exact[channel]) / error;
                assert!(z.abs() < 6.5, "{name}: {mean} {exact} z {z:.2}");
            }
            tested += 1;
        }
        let mean = total as f64 / met as f64;
        assert!((4.0..60.0).contains(&mean), "{name}: {mean} points per bright ray");
    }
}

/// Points lie where they say, as densely as the rate says, and within their ray.
#[test]
fn points_keep_their_promises() {
    let mut rng = Pcg32::new(2, 2);
    for (name, field) in all() {
        let bounds = field.bounds_world().unwrap();
        let mut compared = 0;
        for _ in 0..300 {
            let (from, to) = (point_in(bounds, &mut rng), point_in(bounds, &mut rng));
            let length = (to - from).length();
            let d = ((to - from) / length).as_vec3();
            let mut last = 0.0;
            for point in points(&field, from, d, length, uniform(&mut rng)) {
                assert!(point.t >= last && point.t <= length * (1.0 + 1e-6), "{name}");
                last = point.t;
                assert!((point.p - (from + point.t * d.as_dvec3())).length() < 1e-9);
                // At a cell's face the other cell may answer.
                if field.rate(point.p) == point.rate {
                    let emission = field.emission(point.p).as_dvec3();
                    let found = (point.contribution * point.rate).as_dvec3();
                    let slack = 1e-3 * emission.max_element() + 1e-5 * found.max_element();
                    let worst = (emission - found).abs().max_element();
                    assert!(worst <= slack.max(1e-3), "{name}: {emission} {found}");
                    compared += 1;
                }
            }
        }
        assert!(compared > 500, "{name}: {compared}");
    }
}

/// Eight points on average over lines along the axes that meet the field; a few more over those
/// that have any. Measured 11 to 13.
#[test]
fn lines_that_meet_the_field_have_about_eight_points() {
    let mut rng = Pcg32::new(7, 7);
    for (name, field) in all() {
        let Bounds3 { low, high } = field.bounds_world().unwrap();
        let (mut total, mut lines) = (0, 0);
        for i in 0..30_000 {
            let axis = i % 3;
            let mut p = point_in(Bounds3::new(low, high), &mut rng);
            p[axis] = low[axis] - 1.0;
            let found = points(&field, p, DVec3::AXES[axis].as_vec3(), 1e9, uniform(&mut rng));
            total += found.len();
            lines += usize::from(!found.is_empty());
        }
        let mean = total as f64 / lines as f64;
        assert!((6.0..16.0).contains(&mean), "{name}: {mean}");
    }
}

/// Uniform boxes have closed forms: along a row of voxels the integral is their sum, in all space
/// that of all voxels.
#[test]
fn a_uniform_box_in_closed_form() {
    let voxel = 0.25;
    for kind in [Interpolation::Trilinear, Interpolation::Nearest] {
        let tree = Tree::from_dense(0.0, [3, 3, 3], [10, 12, 14], &[2.0; 10 * 12 * 14]);
        let grid = VoxelGrid::from_tree(&tree, &VoxelGridOptions { interpolation: kind }).unwrap();
        let to_world = DAffine3::from_scale(DVec3::splat(voxel));
        let color = [3.0, 1.0, 0.5];
        let source = EmissionSource::Grid { grid: Arc::new(grid), color };
        let field = EmissionField::new(source, to_world).unwrap();
        let exact = 2.0 * 10.0 * voxel * DVec3::new(3.0, 1.0, 0.5);
        let n = 2000;
        let mut sum = DVec3::ZERO;
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let origin = DVec3::new(-1.0, 8.0 * voxel, 9.0 * voxel);
            let found = points(&field, origin, Vec3::X, 1e9, u);
            sum += found.iter().map(|p| p.contribution.as_dvec3()).sum::<DVec3>();
        }
        let mean = sum / f64::from(n);
        assert!((mean / exact - 1.0).abs().max_element() < 2e-3, "{kind:?}: {mean} {exact}");
        let power =
            2.0 * 10.0 * 12.0 * 14.0 * voxel.powi(3) * LUMINANCE.dot(DVec3::new(3.0, 1.0, 0.5));
        assert!((field.power() / power - 1.0).abs() < 1e-6);
        assert_eq!(field.emission(DVec3::splat(5.0 * voxel)), Vec3::new(6.0, 2.0, 1.0));
    }
}

/// A ball of radius 40 voxels: chords and volume of a ball, up to the steps of its surface (1 %).
#[test]
fn a_uniform_ball_in_closed_form() {
    let (side, radius) = (88usize, 40.0f64);
    let middle = DVec3::splat(43.5);
    let values: Vec<f32> = (0..side.pow(3))
        .map(|i| {
            let p = [i / side / side, i / side % side, i % side].map(|c| c as f64);
            f32::from(DVec3::from_array(p).distance(middle) < radius)
        })
        .collect();
    let tree = Tree::from_dense(0.0, [0; 3], [side; 3], &values);
    let source = EmissionSource::Grid { grid: grid(&tree), color: [1.0; 3] };
    let field = EmissionField::new(source, DAffine3::from_scale(DVec3::splat(0.1))).unwrap();
    let volume = 4.0 / 3.0 * std::f64::consts::PI * 4.0f64.powi(3);
    assert!((field.power() / volume - 1.0).abs() < 5e-3, "{} {volume}", field.power());
    let mut rng = Pcg32::new(3, 3);
    for distance in [0.0f64, 1.0, 2.0, 3.0] {
        let chord = 2.0 * (16.0 - distance * distance).sqrt();
        let mut sum = 0.0;
        for _ in 0..2000 {
            // A random line at the distance from the middle.
            let axis = point_in(Bounds3::new(DVec3::NEG_ONE, DVec3::ONE), &mut rng).normalize();
            let across = axis.any_orthonormal_vector();
            let p = 0.1 * middle + distance * across - 20.0 * axis;
            let found = points(&field, p, axis.as_vec3(), 1e9, uniform(&mut rng));
            sum += found.iter().map(|p| f64::from(p.contribution.x)).sum::<f64>();
        }
        let mean = sum / 2000.0;
        // About eight points per chord: noise of systematic points is far below a percent of 2000
        // chords.
        assert!((mean / chord - 1.0).abs() < 0.01, "{distance}: {mean} {chord}");
    }
}

/// Sums `value` over the middles of cells of `parts^3` per voxel, times their volume; the fire's
/// voxels are cubes of 0.0375.
fn integrate(
    field: &EmissionField,
    to_world: DAffine3,
    parts: i32,
    mut value: impl FnMut(DVec3) -> f64,
) -> f64 {
    let to_index = to_world.inverse();
    let Bounds3 { low, high } = field.bounds_world().unwrap();
    let (low, high) = (to_index.transform_point3(low), to_index.transform_point3(high));
    let cells =
        |axis: usize| (low[axis].round() as i32 * parts)..(high[axis].round() as i32 * parts);
    let mut sum = 0.0;
    for x in cells(0) {
        for y in cells(1) {
            for z in cells(2) {
                let p = (DVec3::new(x.into(), y.into(), z.into()) + 0.5) / f64::from(parts);
                sum += value(to_world.transform_point3(p));
            }
        }
    }
    sum * to_world.matrix3.determinant().abs() / f64::from(parts).powi(3)
}

/// Power against quadrature of 4^3 points per voxel.
#[test]
fn power_is_the_integral() {
    let (_, to_world) = fire("flame");
    for (name, field) in all() {
        let power = integrate(&field, to_world, 4, |p| field.emission(p).as_dvec3().dot(LUMINANCE));
        let error = field.power() / power - 1.0;
        assert!(error.abs() < 4e-3, "{name}: {} {power}, {error:.2e}", field.power());
    }
}

/// Points to look from: far, beside, above, and within the fire.
fn eyes(field: &EmissionField) -> [DVec3; 4] {
    let Bounds3 { low, high } = field.bounds_world().unwrap();
    let at = |x, y, z| low + (high - low) * DVec3::new(x, y, z);
    [at(30.0, -9.0, 4.0), at(-0.3, 0.1, 0.4), at(0.4, 0.6, 1.7), at(0.5, 0.4, 0.6)]
}

/// Directions by two numbers in [0, 1), uniform in a cone that holds all of a field, or over the
/// sphere from within it; and the solid angle.
fn cone(field: &EmissionField, eye: DVec3) -> (impl Fn(f64, f64) -> Vec3, f64) {
    let Bounds3 { low, high } = field.bounds_world().unwrap();
    let (to, radius) = (0.5 * (low + high) - eye, 0.6 * (high - low).length());
    let least =
        if to.length() > radius { (1.0 - (radius / to.length()).powi(2)).sqrt() } else { -1.0 };
    let z = to.normalize();
    let x = z.any_orthonormal_vector();
    let y = z.cross(x);
    let direction = move |u: f64, v: f64| {
        let cos = 1.0 - u * (1.0 - least);
        let (sin_phi, cos_phi) = (std::f64::consts::TAU * v).sin_cos();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        (z * cos + (x * cos_phi + y * sin_phi) * sin).normalize().as_vec3()
    };
    (direction, std::f64::consts::TAU * (1.0 - least))
}

/// Extinction of smoke that hides much of a fire.
fn smoke(field: &EmissionField) -> impl Fn(DVec3) -> f64 + Sync {
    let Bounds3 { low, high } = field.bounds_world().unwrap();
    let size = (high - low).length();
    move |p| (10.0 / size) * (1.0 + (9.0 * (p - low).x / size).sin())
}

/// Null hypothesis: densities of directions integrate to one over the sphere. Means over 100000
/// random directions; |z| < 6.4 on 16 of them, false alarm 2.5e-9.
#[test]
fn densities_of_directions_integrate_to_one() {
    for (name, field) in all() {
        let directions = EmissionDirections::new(&field, smoke(&field)).unwrap();
        let mut rng = Pcg32::new(5, 5);
        for eye in eyes(&field) {
            let view = directions.view(eye);
            let (direction, angle) = cone(&field, eye);
            let n = 100_000.0f64;
            let (mut sum, mut squares) = (0.0, 0.0);
            for _ in 0..n as u32 {
                let wi = direction(f64::from(uniform(&mut rng)), f64::from(uniform(&mut rng)));
                let x = angle * f64::from(directions.pdf(&view, wi));
                sum += x;
                squares += x * x;
            }
            let mean = sum / n;
            let error = ((squares / n - mean * mean) / n).sqrt();
            let z = (mean - 1.0) / error;
            assert!(z.abs() < 6.4 && error < 0.05, "{name} from {eye}: {mean} +- {error}, z {z}");
        }
    }
}

/// Directions are drawn with the density that is told. Null hypothesis: counts in 8 x 16 bins of a
/// cone are those of its integral, by 24 x 24 points a bin; chi-square at 1e-9 each, 16 tests.
#[test]
fn directions_follow_their_density() {
    for (name, field) in all() {
        let directions = EmissionDirections::new(&field, smoke(&field)).unwrap();
        let mut rng = Pcg32::new(6, 6);
        for eye in eyes(&field) {
            let view = directions.view(eye);
            let (direction, angle) = cone(&field, eye);
            let n = 20_000u32;
            let axis = direction(0.0, 0.0).as_dvec3();
            let (zero, quarter) = (direction(0.5, 0.0).as_dvec3(), direction(0.5, 0.25).as_dvec3());
            let mut found = [[0.0f64; 16]; 8];
            for _ in 0..n {
                let u = [(); 4].map(|()| uniform(&mut rng));
                let wi = directions.sample(&view, u).unwrap();
                assert!(directions.pdf(&view, wi) > 0.0);
                let wi = wi.as_dvec3();
                let cos = |v: DVec3| wi.dot(v - axis * axis.dot(v));
                let phi = (cos(quarter).atan2(cos(zero)) / std::f64::consts::TAU).rem_euclid(1.0);
                let u = (1.0 - wi.dot(axis)) * std::f64::consts::TAU / angle;
                assert!(u < 1.0, "{name}: a direction beside the fire");
                found[(8.0 * u) as usize][((16.0 * phi) as usize).min(15)] += 1.0;
            }
            let (mut chi, mut bins, mut rest) = (0.0, 0, [0.0; 2]);
            for (i, row) in found.iter().enumerate() {
                for (j, found) in row.iter().enumerate() {
                    let mut sum = 0.0;
                    for k in 0..576 {
                        let (a, b) = (f64::from(k / 24) + 0.5, f64::from(k % 24) + 0.5);
                        let u = (i as f64 + a / 24.0) / 8.0;
                        let v = (j as f64 + b / 24.0) / 16.0;
                        sum += f64::from(directions.pdf(&view, direction(u, v)));
                    }
                    let expected = sum * angle / (576.0 * 128.0) * f64::from(n);
                    if expected < 20.0 {
                        rest = [rest[0] + expected, rest[1] + found];
                    } else {
                        chi += (found - expected).powi(2) / expected;
                        bins += 1;
                    }
                }
            }
            chi += (rest[1] - rest[0]).powi(2) / rest[0].max(20.0);
            let p_value = 1.0 - ChiSquared::new(f64::from(bins)).unwrap().cdf(chi);
            assert!(bins > 4 && p_value > 1e-9, "{name} from {eye}: chi2 {chi} of {bins} bins");
        }
    }
}

/// Emission is per scene unit: a field twice as large emits eight times the power and shines
/// twice as bright along a line.
#[test]
fn emission_is_per_scene_unit() {
    let (grid, to_world) = fire("flame");
    let place = |scale: f64| {
        let to_world = DAffine3::from_scale(DVec3::splat(scale)) * to_world;
        let source = EmissionSource::Grid { grid: Arc::clone(&grid), color: [1.0; 3] };
        EmissionField::new(source, to_world).unwrap()
    };
    let (small, large) = (place(1.0), place(2.0));
    assert!((large.power() / small.power() - 8.0).abs() < 1e-9);
    let mut rng = Pcg32::new(5, 5);
    let (mut sums, mut counts) = ([0.0f64; 2], [0usize; 2]);
    for _ in 0..500 {
        let p = point_in(small.bounds_world().unwrap(), &mut rng);
        assert!((small.emission(p) - large.emission(2.0 * p)).abs().max_element() < 1e-5);
        let d = (point_in(small.bounds_world().unwrap(), &mut rng) - p).normalize();
        let u = uniform(&mut rng);
        for (i, (field, scale)) in [(&small, 1.0), (&large, 2.0)].into_iter().enumerate() {
            let found = points(field, scale * (p - 5.0 * d), d.as_vec3(), 1e9, u);
            counts[i] += found.len();
            sums[i] += found.iter().map(|p| f64::from(p.contribution.x)).sum::<f64>();
        }
    }
    // The same points, but for rounding: as many, and twice as bright.
    assert!(counts[0].abs_diff(counts[1]) < 10, "{counts:?}");
    assert!((sums[1] / sums[0] - 2.0).abs() < 1e-2, "{sums:?}");
}

/// Channels and ramps are what they say, voxel by voxel.
#[test]
fn channels_and_ramps_at_voxels() {
    let (flame, to_world) = fire("flame");
    let (heat, _) = fire("temperature");
    let channels = [Arc::clone(&heat), Arc::clone(&flame), Arc::clone(&flame)];
    let colors = EmissionSource::Channels { channels, color: [1.0, 2.0, 0.25] };
    let colors = EmissionField::new(colors, to_world).unwrap();
    let ramp = ColorRamp::new([(0.0, [0.0; 3]), (2.0, [4.0, 2.0, 0.0]), (3.0, [4.0, 4.0, 4.0])]);
    let ramp = EmissionSource::Ramp { grid: Arc::clone(&heat), ramp: ramp.unwrap() };
    let ramp = EmissionField::new(ramp, to_world).unwrap();
    let mut lit = 0;
    for x in (5..51).step_by(3) {
        for y in (3..45).step_by(2) {
            for z in (1..38).step_by(2) {
                let p = to_world.transform_point3(DVec3::new(x.into(), y.into(), z.into()));
                let (hot, fire) = (heat.value([x, y, z]), flame.value([x, y, z]));
                let expected = Vec3::new(hot, 2.0 * fire, 0.25 * fire);
                assert!((colors.emission(p) - expected).abs().max_element() < 1e-4);
                let over = (hot - 2.0).max(0.0);
                let below = hot.min(2.0);
                let expected = Vec3::new(2.0 * below, below + 2.0 * over, 4.0 * over);
                assert!((ramp.emission(p) - expected).abs().max_element() < 1e-3);
                lit += usize::from(hot > 0.0);
            }
        }
    }
    assert!(lit > 500, "{lit}");
}

/// Soot emits what it absorbs: `sigma_a` times Planck's radiance at 1000 K per unit.
#[test]
fn temperatures_are_in_real_units() {
    let (density, to_world) = fire("density");
    let (temperature, _) = fire("temperature");
    let field = soot(BlackbodyRadiance::Absolute);
    let (mut hottest, mut seen) = (0.0f32, 0);
    for x in 5..51 {
        for y in 3..45 {
            let (rho, t) = (density.value([x, y, 12]), temperature.value([x, y, 12]));
            let p = to_world.transform_point3(DVec3::new(x.into(), y.into(), 12.0));
            let le = blackbody(1000.0 * f64::from(t), BlackbodyRadiance::Absolute);
            let expected = 4.0 * 0.5 * rho * le;
            let found = field.emission(p);
            let slack = 1e-4 * expected.max_element() + 1e-12;
            assert!((found - expected).abs().max_element() <= slack, "{found} {expected}");
            hottest = hottest.max(t);
            seen += usize::from(expected.x > 0.0);
        }
    }
    assert!(hottest > 2.5 && seen > 200, "{hottest} {seen}");
}

/// Grids with other transforms than the density's are met where they lie in the world.
#[test]
fn grids_with_other_transforms_meet_in_the_world() {
    // Density over [0, 8]^3; temperature on a lattice of half the step, moved: 2000 K for x > 4,
    // else nothing.
    let density = Tree::from_dense(0.0, [-2; 3], [14; 3], &[1.0; 14 * 14 * 14]);
    let mut values = vec![0.0f32; 40 * 40 * 40];
    for (i, value) in values.iter_mut().enumerate() {
        let x = (i / 1600) as f64 * 0.5 - 4.0;
        *value = if x >= 4.0 { 2.0 } else { 0.0 };
    }
    let temperature = Tree::from_dense(0.0, [0; 3], [40; 3], &values);
    let temperature_to_world = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.5),
        glam::DQuat::IDENTITY,
        DVec3::splat(-4.0),
    );
    let source = EmissionSource::Blackbody {
        density: grid(&density),
        sigma_t: [1.0; 3],
        albedo: Albedo::Constant([0.0; 3]),
        temperature: grid(&temperature),
        to_temperature: temperature_to_world.inverse(),
        kelvin_per_unit: 1000.0,
        kelvin_offset: 0.0,
        radiance: BlackbodyRadiance::Absolute,
        intensity: 2.0,
        phase: Phase::Isotropic,
    };
    let field = EmissionField::new(source, DAffine3::IDENTITY).unwrap();
    let le = 2.0 * blackbody(2000.0, BlackbodyRadiance::Absolute);
    assert!((field.emission(DVec3::new(6.0, 3.0, 3.0)) / le - 1.0).abs().max_element() < 1e-5);
    assert_eq!(field.emission(DVec3::new(3.4, 3.0, 3.0)), Vec3::ZERO);
    let Bounds3 { low, high } = field.bounds_world().unwrap();
    assert!(low.x >= 3.0 - 1e-9 && high.x <= 13.0, "{low} {high}");
}
