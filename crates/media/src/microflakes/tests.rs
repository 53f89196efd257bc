//! Microflakes against quadrature, and their samples against their densities.

use super::*;
use crate::phase::PhaseAt;
use glam::{DAffine3, Quat};
use pileus_vdb::Tree;
use rand_pcg::Pcg32;
use std::f64::consts::{PI, TAU};

/// A unit direction, uniform over the sphere.
fn direction(rng: &mut Pcg32) -> Vec3 {
    PhaseAt::Isotropic.sample(Vec3::Z, [uniform(rng), uniform(rng)]).0
}

/// S = A A': the linear map A of the ellipsoid of a fibre or a surface, and S itself.
fn ellipsoid(fibre: bool, roughness: f32, rotation: Quat) -> (DMat3, Sggx) {
    let r = Mat3::from_quat(rotation);
    let axes =
        if fibre { Vec3::new(1.0, 1.0, roughness) } else { Vec3::new(roughness, roughness, 1.0) };
    let a = (r * Mat3::from_diagonal(axes)).as_dmat3();
    let s =
        if fibre { Sggx::fibre(r.z_axis, roughness) } else { Sggx::surface(r.z_axis, roughness) };
    (a, s)
}

const ROUGHNESS: [f32; 6] = [1.0, 0.5, 0.1, 0.03, 0.01, 0.001];

fn turned(rng: &mut Pcg32) -> Quat {
    Quat::from_rotation_arc(Vec3::Z, direction(rng))
}

/// Directions of a lattice over the sphere and what each stands for, solid angle.
fn lattice(n: u32, m: u32) -> impl Iterator<Item = (DVec3, f64)> {
    (0..n * m).map(move |i| {
        let z = 1.0 - 2.0 * (f64::from(i / m) + 0.5) / f64::from(n);
        let (sin, cos) = (TAU * (f64::from(i % m) + 0.5) / f64::from(m)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        (DVec3::new(r * cos, r * sin, z), 4.0 * PI / f64::from(n * m))
    })
}

/// The projected area is the integral of density times cosine, over normals that a lattice on the
/// sphere is stretched to; so is the visible normals' density normalised.
#[test]
fn projected_area_is_the_integral_of_the_distribution() {
    let mut rng = Pcg32::new(1, 1);
    for roughness in ROUGHNESS {
        for fibre in [true, false] {
            let (a, s) = ellipsoid(fibre, roughness, turned(&mut rng));
            for _ in 0..4 {
                let w = direction(&mut rng);
                let sum: f64 = lattice(400, 400)
                    .map(|(n, solid)| {
                        let stretched = a * n;
                        let m = stretched.normalize();
                        let jacobian = a.determinant() / stretched.length().powi(3);
                        m.dot(w.as_dvec3()).max(0.0) * s.density(m.as_vec3()) * jacobian * solid
                    })
                    .sum();
                let area = f64::from(s.projected_area(w));
                // At 0.001 the matrix itself is rounded: single entries hold 1e-6 to some per cent.
                let tolerance = if roughness < 0.01 { 0.05 } else { 2e-3 };
                assert!((sum - area).abs() < tolerance * area, "{fibre} {roughness}: {sum} {area}");
            }
        }
    }
}

#[test]
fn isotropic_flakes_scatter_isotropically() {
    let mut rng = Pcg32::new(2, 2);
    for _ in 0..1000 {
        let (a, b) = (direction(&mut rng), direction(&mut rng));
        let s = Sggx::ISOTROPIC;
        assert!((s.density(a) - 1.0 / PI).abs() < 1e-6);
        assert!((s.projected_area(a) - 1.0).abs() < 1e-6);
        assert!((f64::from(s.specular(a, b)) - 0.25 / PI).abs() < 1e-6);
    }
}

/// Null hypothesis: visible normals, seen in the space where the ellipsoid is a sphere, fall into 8
/// x 16 cells as the density says. Chi-square, at most 127 degrees of freedom, critical value 225:
/// false alarm 1.3e-7 per case, 36 cases, 5e-6 in all before seeds were fixed; they are.
#[test]
fn visible_normals_follow_their_density() {
    let mut rng = Pcg32::new(3, 3);
    for roughness in ROUGHNESS {
        for fibre in [true, false] {
            for kind in 0..3 {
                let (a, s) = ellipsoid(fibre, roughness, turned(&mut rng));
                let axis = a.z_axis.normalize().as_vec3();
                // Any direction, along the axis, nearly across it.
                let w = match kind {
                    0 => direction(&mut rng),
                    1 => (axis + 1e-3 * direction(&mut rng)).normalize(),
                    _ => axis.cross(direction(&mut rng)).normalize(),
                };
                let inverse = a.inverse();
                let area = f64::from(s.projected_area(w));
                let cell = |n: DVec3| {
                    let row = ((1.0 - n.z) * 4.0).clamp(0.0, 7.999) as usize;
                    let turn = n.y.atan2(n.x) / TAU + 0.5;
                    row * 16 + (turn * 16.0).clamp(0.0, 15.999) as usize
                };
                let mut expected = vec![0.0f64; 128];
                for (n, solid) in lattice(256, 512) {
                    let stretched = a * n;
                    let m = stretched.normalize();
                    let jacobian = a.determinant() / stretched.length().powi(3);
                    let visible = m.dot(w.as_dvec3()).max(0.0) * s.density(m.as_vec3()) / area;
                    expected[cell(n)] += visible * jacobian * solid;
                }
                let total: f64 = expected.iter().sum();
                let count = 40_000;
                let mut found = vec![0u32; 128];
                for _ in 0..count {
                    let m = s.sample_visible(w, [uniform(&mut rng), uniform(&mut rng)]);
                    assert!((m.length() - 1.0).abs() < 1e-5);
                    found[cell((inverse * m.as_dvec3()).normalize())] += 1;
                }
                // Cells of small expectation, where rounding decides, are taken together.
                let (mut chi2, mut rest) = (0.0, [0.0f64; 2]);
                for (e, f) in expected.iter().zip(&found) {
                    let (e, f) = (e / total * f64::from(count), f64::from(*f));
                    if e < 20.0 {
                        rest = [rest[0] + e, rest[1] + f];
                    } else {
                        chi2 += (e - f).powi(2) / e;
                    }
                }
                chi2 += (rest[0] - rest[1]).powi(2) / rest[0].max(20.0);
                assert!(chi2 < 225.0, "{fibre} {roughness} {kind}: {chi2}");
            }
        }
    }
}

/// Mirrored directions carry the density of their microflake, also after rounding to single
/// precision; exchange of the directions is symmetric but for the areas.
#[test]
fn mirrors_are_normalised_and_reciprocal() {
    let mut rng = Pcg32::new(4, 4);
    for roughness in ROUGHNESS {
        for fibre in [true, false] {
            let (_, s) = ellipsoid(fibre, roughness, turned(&mut rng));
            for _ in 0..2000 {
                let incoming = direction(&mut rng);
                let u = [uniform(&mut rng), uniform(&mut rng)];
                let m = s.sample_visible(-incoming, u);
                let (wi, pdf) = s.sample_specular(incoming, u);
                let by_flake = 0.25 * s.density(m) / f64::from(s.projected_area(incoming));
                assert!(pdf.is_finite() && pdf > 0.0);
                // What is seen at grazing angles turns by more than rounding when it is mirrored.
                if m.dot(-incoming) > 0.01 {
                    let ratio = f64::from(pdf) / by_flake;
                    assert!((ratio - 1.0).abs() < 0.02, "{fibre} {roughness}: {ratio}");
                }
                let there = s.projected_area(incoming) * s.specular(incoming, wi);
                let back = s.projected_area(wi) * s.specular(-wi, -incoming);
                assert!((there - back).abs() <= 1e-3 * there, "{there} {back}");
            }
            // Where a lattice can follow the lobe, it integrates to one.
            if roughness >= 0.1 {
                let incoming = direction(&mut rng);
                let sum: f64 = lattice(500, 800)
                    .map(|(wi, solid)| f64::from(s.specular(incoming, wi.as_vec3())) * solid)
                    .sum();
                assert!((sum - 1.0).abs() < 5e-3, "{fibre} {roughness}: {sum}");
            }
        }
    }
}

/// Diffuse microflakes: the mean over drawn microflakes is the integral over the distribution, z
/// below 5.5 on 48 means (false alarm 2e-6); every microflake's own function is sampled by its
/// density.
#[test]
fn diffuse_flakes_average_to_their_integral() {
    let mut rng = Pcg32::new(5, 5);
    for roughness in [1.0, 0.3, 0.1, 0.02] {
        for fibre in [true, false] {
            let (a, s) = ellipsoid(fibre, roughness, turned(&mut rng));
            let microflakes = Microflakes::new(
                MicroflakeShape::Constant(s),
                MicroflakeScattering::Diffuse,
                DMat3::IDENTITY,
            );
            for _ in 0..6 {
                let (incoming, wi) = (direction(&mut rng), direction(&mut rng));
                let area = f64::from(s.projected_area(incoming));
                let exact: f64 = lattice(400, 400)
                    .map(|(n, solid)| {
                        let stretched = a * n;
                        let m = stretched.normalize();
                        let jacobian = a.determinant() / stretched.length().powi(3);
                        let seen = m.dot(-incoming.as_dvec3()).max(0.0);
                        let sent = m.dot(wi.as_dvec3()).max(0.0);
                        seen * sent * s.density(m.as_vec3()) * jacobian * solid / (area * PI)
                    })
                    .sum();
                let count = 20_000;
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..count {
                    let phase = microflakes.at(|| DVec3::ZERO, incoming, &mut rng);
                    let value = f64::from(phase.eval(incoming, wi));
                    sum += value;
                    squares += value * value;
                    let (wi, pdf) = phase.sample(incoming, [uniform(&mut rng), uniform(&mut rng)]);
                    assert!((pdf - phase.eval(incoming, wi)).abs() <= 1e-4 * (1.0 + pdf));
                }
                let mean = sum / f64::from(count);
                let error = ((squares / f64::from(count) - mean * mean) / f64::from(count)).sqrt();
                let z = (mean - exact) / error.max(1e-6 + 2e-3 * exact);
                assert!(z.abs() < 5.5, "{fibre} {roughness}: {mean} {exact} {z}");
            }
        }
    }
}

/// Between voxels whatever their axes, matrices stay positive and below the bound; a grid of one
/// axis is that axis everywhere.
#[test]
fn grids_interpolate_positive_matrices() {
    let mut rng = Pcg32::new(6, 6);
    let size = [5usize; 3];
    let axes: Vec<[f32; 3]> = (0..125).map(|_| (direction(&mut rng) * 3.0).to_array()).collect();
    let tree = Tree::from_dense([0.0; 3], [0; 3], size, &axes);
    let (mut diagonal, mut off) = (Vec::new(), Vec::new());
    for axis in &axes {
        let s = Sggx::fibre(Vec3::from_array(*axis).normalize(), 0.05).matrix() * 2.5;
        diagonal.push([s.x_axis.x, s.y_axis.y, s.z_axis.z].map(|v| v as f32));
        off.push([s.y_axis.x, s.z_axis.x, s.z_axis.y].map(|v| v as f32));
    }
    let dense = |values: &[[f32; 3]]| Tree::from_dense([0.0; 3], [0; 3], size, values);
    let grids = [
        MicroflakeGrid::fibres(&tree, Roughness::Constant(0.05), DAffine3::IDENTITY).unwrap(),
        MicroflakeGrid::surfaces(&tree, Roughness::Constant(0.05), DAffine3::IDENTITY).unwrap(),
        MicroflakeGrid::from_entries(&dense(&diagonal), &dense(&off), DAffine3::IDENTITY).unwrap(),
    ];
    for (i, grid) in grids.iter().enumerate() {
        for _ in 0..4000 {
            let p = DVec3::new(
                f64::from(uniform(&mut rng)),
                f64::from(uniform(&mut rng)),
                f64::from(uniform(&mut rng)),
            ) * 7.0
                - 1.5;
            let s = grid.at_index(p);
            let [low, _, high] = s.eigenvalues().unwrap();
            assert!(
                low > 0.0 && high.sqrt() <= f64::from(grid.largest_area()),
                "{i} {p}: {low} {high}"
            );
            let w = direction(&mut rng);
            assert!(s.projected_area(w) <= grid.largest_area());
        }
        // At a voxel it is the voxel's own.
        let axis = Vec3::from_array(axes[2 * 25 + 2 * 5 + 3]).normalize();
        let expected = match i {
            0 => Sggx::fibre(axis, 0.05),
            1 => Sggx::surface(axis, 0.05),
            _ => Sggx::of_matrix(Sggx::fibre(axis, 0.05).matrix() * 2.5),
        };
        let found = grid.at_index(DVec3::new(2.0, 2.0, 3.0));
        let w = direction(&mut rng);
        assert!((found.projected_area(w) - expected.projected_area(w)).abs() < 1e-5);
        // Far away microflakes are isotropic.
        assert!((grid.at_index(DVec3::splat(90.0)).projected_area(w) - 1.0).abs() < 1e-6);
    }
    off[31] = [9.0, 0.0, 0.0];
    let error = MicroflakeGrid::from_entries(&dense(&diagonal), &dense(&off), DAffine3::IDENTITY);
    assert!(error.unwrap_err().to_string().contains("not positive"));
}

#[test]
fn matrices_are_checked_and_lifted() {
    assert!(Sggx::new([1.0, 1.0, -1.0], [0.0; 3]).is_none());
    assert!(Sggx::new([f32::NAN, 1.0, 1.0], [0.0; 3]).is_none());
    assert!(Sggx::new([0.0; 3], [0.0; 3]).is_none());
    let flat = Sggx::new([4.0, 0.0, 0.0], [0.0; 3]).unwrap();
    assert!(flat.eigenvalues().unwrap()[0] >= 3.9e-6);
    assert!((flat.largest_area() - 2.0).abs() < 1e-4);
}

/// The placement's rotation turns microflakes, its scale does not.
#[test]
fn placements_turn_flakes() {
    let rotation = DMat3::from_quat(glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1));
    let placement = rotation * DMat3::from_diagonal(DVec3::splat(7.0));
    let fibre = MicroflakeShape::Constant(Sggx::fibre(Vec3::X, 0.1));
    let microflakes = Microflakes::new(fibre, MicroflakeScattering::Specular, placement);
    let along = (rotation * DVec3::X).as_vec3();
    assert!((microflakes.projected_area(|| DVec3::ZERO, along) - 0.1).abs() < 1e-5);
    let PhaseAt::Microflakes(s) = microflakes.at(|| DVec3::ZERO, Vec3::Z, &mut Pcg32::new(1, 1))
    else {
        panic!("specular microflakes")
    };
    assert!((s.projected_area(along) - 0.1).abs() < 1e-4);
    assert_eq!(rotation_of(DMat3::ZERO), DMat3::IDENTITY);
}
