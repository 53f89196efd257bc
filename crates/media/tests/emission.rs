//! Light from volumes: line integrals, sampling and power against quadrature and closed forms.

mod common;

use glam::{DAffine3, DVec3, Vec3};
use pileus_media::random::uniform;
use pileus_media::{
    Albedo, BlackbodyRadiance, ColorRamp, EmissionField, EmissionPoint, EmissionSource,
    Interpolation, Tally, VoxelGrid, VoxelGridOptions, blackbody,
};
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

fn point_in((low, high): (DVec3, DVec3), rng: &mut Pcg32) -> DVec3 {
    low + (high - low) * DVec3::from_array([(); 3].map(|()| f64::from(uniform(rng))))
}

fn points(field: &EmissionField, origin: DVec3, d: Vec3, t_max: f64, u: f32) -> Vec<EmissionPoint> {
    let mut points = Vec::new();
    let mut tally = Tally::default();
    field.points(origin, d, t_max, u, &mut tally, |point| points.push(point));
    assert_eq!(tally.violations, 0);
    assert_eq!(tally.lookups, points.len() as u64);
    points
}

/// The sum over points estimates the line integral with any weight. Null hypothesis: its mean is that of dense quadrature; |z| < 6.5 on 480 means (4 fields, 40 rays, 3
/// channels), false alarm 4e-8 under the normal law. The quadrature's own error is allowed for with 3e-5 of the integral.
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

/// Eight points on average over lines along the axes that meet the field; a few more over those that have any. Measured 11 to 13.
#[test]
fn lines_that_meet_the_field_have_about_eight_points() {
    let mut rng = Pcg32::new(7, 7);
    for (name, field) in all() {
        let (low, high) = field.bounds_world().unwrap();
        let (mut total, mut lines) = (0, 0);
        for i in 0..30_000 {
            let axis = i % 3;
            let mut p = point_in((low, high), &mut rng);
            p[axis] = low[axis] - 1.0;
            let found = points(&field, p, DVec3::AXES[axis].as_vec3(), 1e9, uniform(&mut rng));
            total += found.len();
            lines += usize::from(!found.is_empty());
        }
        let mean = total as f64 / lines as f64;
        assert!((6.0..16.0).contains(&mean), "{name}: {mean}");
    }
}

/// Uniform boxes have closed forms: along a row of voxels the integral is their sum, in all space that of all voxels.
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
            let axis = point_in((DVec3::NEG_ONE, DVec3::ONE), &mut rng).normalize();
            let across = axis.any_orthonormal_vector();
            let p = 0.1 * middle + distance * across - 20.0 * axis;
            let found = points(&field, p, axis.as_vec3(), 1e9, uniform(&mut rng));
            sum += found.iter().map(|p| f64::from(p.contribution.x)).sum::<f64>();
        }
        let mean = sum / 2000.0;
        // About eight points per chord: noise of systematic points is far below a percent of 2000 chords.
        assert!((mean / chord - 1.0).abs() < 0.01, "{distance}: {mean} {chord}");
    }
}

/// Sums `value` over the middles of cells of `parts^3` per voxel, times their volume; the fire's voxels are cubes of 0.0375.
fn integrate(
    field: &EmissionField,
    to_world: DAffine3,
    parts: i32,
    mut value: impl FnMut(DVec3) -> f64,
) -> f64 {
    let to_index = to_world.inverse();
    let (low, high) = field.bounds_world().unwrap();
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

/// The density of samples is constant in each voxel: its sum over their middles is its integral. Power against quadrature of 4^3 points per voxel.
#[test]
fn densities_integrate_to_one_and_power_is_the_integral() {
    let (_, to_world) = fire("flame");
    for (name, field) in all() {
        let one = integrate(&field, to_world, 1, |p| f64::from(field.pdf(p)));
        assert!((one - 1.0).abs() < 1e-6, "{name}: {one}");
        let power = integrate(&field, to_world, 4, |p| field.emission(p).as_dvec3().dot(LUMINANCE));
        let error = field.power() / power - 1.0;
        assert!(error.abs() < 4e-3, "{name}: {} {power}, {error:.2e}", field.power());
    }
}

/// Samples are drawn with the density that is told. Null hypothesis: counts in bins of 4^3 voxels and octants of voxels are those of the density; chi-square at 1e-8 each,
/// eight tests.
#[test]
fn samples_follow_their_density() {
    let (_, to_world) = fire("flame");
    let to_index = to_world.inverse();
    for (name, field) in all() {
        let n = 400_000u32;
        let mut rng = Pcg32::new(4, 4);
        let mut counts = std::collections::BTreeMap::<[i32; 3], f64>::new();
        let mut octants = [0.0f64; 8];
        let bin =
            |p: DVec3| to_index.transform_point3(p).to_array().map(|c| (c.floor() as i32) >> 2);
        for _ in 0..n {
            let sample = field.sample([(); 4].map(|()| uniform(&mut rng))).unwrap();
            assert!(sample.pdf > 0.0);
            let pdf = field.pdf(sample.p);
            // A point on a face may fall into the neighbour by rounding in the transform.
            let p = to_index.transform_point3(sample.p);
            let off = (p - p.round()).abs().min_element();
            assert!((pdf / sample.pdf - 1.0).abs() < 1e-5 || off < 1e-9, "{name}");
            let emission = field.emission(sample.p);
            let slack = 1e-4 * emission.max_element().max(sample.emission.max_element()).max(1e-3);
            assert!(
                (emission - sample.emission).abs().max_element() <= slack || off < 1e-9,
                "{name}"
            );
            *counts.entry(bin(sample.p)).or_default() += 1.0;
            let octant = (p - p.floor()).cmpge(DVec3::splat(0.5)).bitmask();
            octants[octant as usize] += 1.0;
        }
        let mut expected = std::collections::BTreeMap::<[i32; 3], f64>::new();
        let cell = to_world.matrix3.determinant().abs();
        integrate(&field, to_world, 1, |p| {
            *expected.entry(bin(p)).or_default() += f64::from(field.pdf(p)) * cell * f64::from(n);
            0.0
        });
        let (mut chi, mut bins, mut rest) = (0.0, 0, [0.0; 2]);
        for (key, expected) in &expected {
            let found = counts.remove(key).unwrap_or_default();
            if *expected < 10.0 {
                rest = [rest[0] + expected, rest[1] + found];
            } else {
                chi += (found - expected).powi(2) / expected;
                bins += 1;
            }
        }
        chi += (rest[1] - rest[0]).powi(2) / rest[0].max(10.0);
        assert!(counts.is_empty(), "{name}: samples where the density is zero");
        let p_value = 1.0 - ChiSquared::new(f64::from(bins)).unwrap().cdf(chi);
        assert!(bins > 50 && p_value > 1e-8, "{name}: chi2 {chi} of {bins} bins");
        let each = f64::from(n) / 8.0;
        let chi: f64 = octants.iter().map(|found| (found - each).powi(2) / each).sum();
        let p_value = 1.0 - ChiSquared::new(7.0).unwrap().cdf(chi);
        assert!(p_value > 1e-8, "{name}: octants {octants:?}");
    }
}

/// Emission is per scene unit: a field twice as large gives off eight times the power and shines twice as bright along a line.
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
        assert!((small.pdf(p) - 8.0 * large.pdf(2.0 * p)).abs() <= 1e-4 * small.pdf(p));
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

/// Soot gives off what it absorbs: `sigma_a` times Planck's radiance at 1000 K per unit.
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
    // Density over [0, 8]^3; temperature on a lattice of half the step, moved: 2000 K for x > 4, else nothing.
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
    };
    let field = EmissionField::new(source, DAffine3::IDENTITY).unwrap();
    let le = 2.0 * blackbody(2000.0, BlackbodyRadiance::Absolute);
    assert!((field.emission(DVec3::new(6.0, 3.0, 3.0)) / le - 1.0).abs().max_element() < 1e-5);
    assert_eq!(field.emission(DVec3::new(3.4, 3.0, 3.0)), Vec3::ZERO);
    let (low, high) = field.bounds_world().unwrap();
    assert!(low.x >= 3.0 - 1e-9 && high.x <= 13.0, "{low} {high}");
    let mut rng = Pcg32::new(6, 6);
    for _ in 0..10_000 {
        let sample = field.sample([(); 4].map(|()| uniform(&mut rng))).unwrap();
        assert!(sample.p.x >= 3.0 && sample.p.x <= 12.0);
    }
}
