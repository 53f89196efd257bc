//! Emission placed in the world.

use super::bounds::EmissionBounds;
use super::cells::{Cells, EmissionReport};
use super::lattice::Lattice;
use super::source::EmissionSource;
use crate::Error;
use crate::field::RayField;
use crate::tally::Tally;
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use std::sync::Arc;
use std::time::Instant;

/// Points on a line through the emission, on average over lines that meet it.
const POINTS_PER_LINE: f64 = 8.0;

/// A field of emission in the world: radiance per scene unit, whatever the extinction. Immutable;
/// cheap to copy, since everything large is shared.
///
/// Along rays, points are spread by a *rate*: a factor times an upper bound of the emission in the
/// cells around. The factor is a constant of the field, such that eight points fall on a line that
/// meets it, averaged over lines parallel to the axes of its index space; through the brightest
/// parts there are more.
#[derive(Debug, Clone)]
pub struct EmissionField {
    source: Arc<EmissionSource>,
    /// The rate of points, 1/length.
    bounds: EmissionBounds,
    lattice: Arc<Lattice>,
    index_to_world: DAffine3,
    world_to_index: DAffine3,
    power: f64,
    report: EmissionReport,
}

/// A point on a ray at which the emission was looked up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmissionPoint {
    /// World distance from the ray's origin.
    pub t: f64,
    /// The point, in the world.
    pub p: DVec3,
    /// Emission over rate, radiance: its sum over all points estimates the line integral of the
    /// emission.
    pub contribution: Vec3,
    /// Points per length here, positive.
    pub rate: f32,
}

impl EmissionField {
    /// Places a source by `index_to_world`, from the index space of its first grid.
    ///
    /// # Errors
    /// If a number is negative, not finite or out of range, if the transform is singular, or if the
    /// emission does not end.
    pub fn new(source: EmissionSource, index_to_world: DAffine3) -> Result<EmissionField, Error> {
        let start = Instant::now();
        let source = source.checked()?;
        let world_to_index = index_to_world.inverse();
        let volume = index_to_world.matrix3.determinant().abs();
        if !(volume.is_normal() && index_to_world.is_finite() && world_to_index.is_finite()) {
            return Err(Error::invalid(
                "the transform of the emission is singular or not finite",
                "check the scale of the grid, the node and the job",
            ));
        }
        let cells = Cells::new(&source);
        let grid = Arc::new(cells.bounds()?);
        if !(grid.range().1 < 1e30) {
            return Err(Error::invalid(
                format!("the largest emission, {}, is out of range", grid.range().1),
                "lower its scale, intensity or temperature",
            ));
        }
        let factor = POINTS_PER_LINE / cells.mean_along_lines(&index_to_world.matrix3);
        // Any factor is unbiased; where nothing emits it is no number, and never used.
        let rate_factor = if factor > 0.0 { factor.clamp(1e-30, 1e30) as f32 } else { 1.0 };
        let bounds = EmissionBounds::new(Arc::clone(&grid), index_to_world, rate_factor)?;
        let lattice = Lattice::new(&cells);
        let of_grid = grid.report();
        let report = EmissionReport {
            seconds: start.elapsed().as_secs_f64(),
            bricks: cells.bricks.len() as u64,
            tiles: cells.blocks.len() as u64,
            bytes: of_grid.bytes_voxels
                + of_grid.bytes_bounds
                + of_grid.bytes_index
                + lattice.bytes(),
        };
        Ok(EmissionField {
            source: Arc::new(source),
            bounds,
            lattice: Arc::new(lattice),
            index_to_world,
            world_to_index,
            power: cells.power() * volume,
            report,
        })
    }

    /// Radiance added per length at a point in the world, per channel. A black body of microflakes
    /// emits by direction, as it absorbs: see [`emission_along`](EmissionField::emission_along);
    /// here it is that of flakes that show an area of 1.
    pub fn emission(&self, p_world: DVec3) -> Vec3 {
        self.source.at(self.world_to_index.transform_point3(p_world))
    }

    /// Radiance added per length at a point in the world to a ray of unit `direction`, per channel.
    pub fn emission_along(&self, p_world: DVec3, direction: Vec3) -> Vec3 {
        self.source.along(self.world_to_index.transform_point3(p_world), direction)
    }

    /// Visits points of the ray `origin + t direction`, t in [0, t_max], for line integrals: the
    /// sum of `contribution * w(t)` over them is an unbiased estimate of the integral of
    /// `emission * w` along the ray, for any `w`, if `u` is uniform in [0, 1). `direction` is a
    /// unit vector.
    ///
    /// The points are systematic: where the integral of the rate from the origin is `u`, `u + 1`,
    /// `u + 2`, ... Empty cells are skipped, and the number of points goes with the emission that
    /// the ray may meet: no contribution exceeds the reciprocal of the field's constant. Counts
    /// cells, lookups and lookups above their bound in `tally`.
    pub fn points(
        &self,
        origin: DVec3,
        direction: Vec3,
        t_max: f64,
        u: f32,
        tally: &mut Tally,
        visit: impl FnMut(EmissionPoint),
    ) {
        self.sparse_points(origin, direction, t_max, (u, 1.0), tally, visit);
    }

    /// Visits points of the ray `origin + t direction`, t in [0, t_max], `spacing` (positive) times
    /// as far apart as those of [`points`](EmissionField::points).
    ///
    /// The sum of `contribution * w(t)` over them is an unbiased estimate of the integral of
    /// `emission * w` along the ray, for any `w`, if `u` is uniform in [0, 1). `direction` is a
    /// unit vector. Counts cells, lookups and lookups above their bound in `tally`.
    pub fn sparse_points(
        &self,
        origin: DVec3,
        direction: Vec3,
        t_max: f64,
        (u, spacing): (f32, f32),
        tally: &mut Tally,
        mut visit: impl FnMut(EmissionPoint),
    ) {
        if self.lattice.is_empty() {
            return;
        }
        let Some(span) = self.bounds.span(origin, direction, t_max) else { return };
        let along = direction.as_dvec3();
        let local_to_index = self.bounds.local_to_index();
        let mut ray = self.bounds.ray(&span);
        let spacing = f64::from(spacing);
        let mut next = f64::from(u) * spacing;
        let mut passed = 0.0f64;
        while let Some(segment) = ray.next_segment() {
            let (t0, t1) = (f64::from(segment.t0), f64::from(segment.t1));
            let rate = f64::from(segment.majorant);
            let end = passed + rate * (t1 - t0);
            while next < end {
                let t = t0 + (next - passed) / rate;
                next += spacing;
                // Inside the cell whatever rounding says, so that its bound holds.
                let p_index = ray.local_in_cell(t as f32) + local_to_index;
                let emission = self.source.along(p_index, direction);
                // Bounds and values are scaled apart from each other, and rounded.
                let bound = segment.majorant * (1.0 + 1e-6);
                tally.looked_up(self.bounds.rate_factor() * emission.max_element(), bound);
                let t = ray.distance(t) + span.t_enter;
                visit(EmissionPoint {
                    t,
                    p: origin + along * t,
                    contribution: emission * spacing as f32 / segment.majorant,
                    rate: segment.majorant / spacing as f32,
                });
            }
            passed = end;
        }
        tally.majorant_steps += ray.steps();
    }

    /// Expected number of points of [`points`](EmissionField::points) per length at a point in the
    /// world, on any ray through it.
    pub fn rate(&self, p_world: DVec3) -> f32 {
        self.bounds.rate_at(p_world)
    }

    pub(super) fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    pub(super) fn index_to_world(&self) -> DAffine3 {
        self.index_to_world
    }

    /// Luminance of the emission integrated over the world; times `4 pi` the total power. By two
    /// Gauss points per axis and voxel: exact for grids and products of grids; measured on a fire,
    /// within 0.3 % for ramps and black bodies; of microflakes as if they showed an area of 1 to
    /// all directions.
    pub fn power(&self) -> f64 {
        self.power
    }

    /// The box in the world that holds all emission; `None` if nothing emits.
    pub fn bounds_world(&self) -> Option<Bounds3> {
        if self.lattice.is_empty() { None } else { self.bounds.bounds_world() }
    }

    /// The source that the emission is looked up in.
    pub fn source(&self) -> &EmissionSource {
        &self.source
    }

    /// What building the field took.
    pub fn report(&self) -> &EmissionReport {
        &self.report
    }
}

#[cfg(test)]
mod tests {
    use super::super::blackbody::BlackbodyRadiance;
    use super::super::directions::EmissionDirections;
    use super::super::ramp::ColorRamp;
    use super::*;
    use crate::Albedo;
    use crate::color::ColorGrid;
    use crate::grid::{Interpolation, VoxelGrid, VoxelGridOptions};
    use crate::microflakes::{
        MicroflakeGrid, MicroflakeScattering, MicroflakeShape, Microflakes, Sggx,
    };
    use crate::phase::Phase;
    use glam::{DMat3, DQuat};
    use pileus_math::random::uniform;
    use pileus_vdb::{Tile, Tree};
    use proptest::prelude::*;
    use rand_pcg::Pcg32;

    fn grid(tree: &Tree<f32>, interpolation: Interpolation) -> Arc<VoxelGrid> {
        Arc::new(VoxelGrid::from_tree(tree, &VoxelGridOptions { interpolation }).unwrap())
    }

    /// Random values in a box, a third of them zero.
    fn noise(seed: u64, min: [i32; 3], size: [usize; 3]) -> Tree<f32> {
        let mut rng = Pcg32::new(seed, 1);
        let mut value = || (uniform(&mut rng) * 1.5 - 0.5).max(0.0);
        let values: Vec<f32> = (0..size.iter().product()).map(|_| value()).collect();
        Tree::from_dense(0.0, min, size, &values)
    }

    fn turned(angle: f64, scale: f64) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(
            DVec3::new(scale, 1.1 * scale, 0.7 * scale),
            DQuat::from_rotation_y(angle) * DQuat::from_rotation_x(0.3),
            DVec3::new(0.4, -1.0, 2.0),
        )
    }

    fn thermal(
        density: &Tree<f32>,
        temperature: &Tree<f32>,
        to: DAffine3,
        albedo: Albedo,
    ) -> EmissionSource {
        EmissionSource::Blackbody {
            density: grid(density, Interpolation::Trilinear),
            sigma_t: [1.0, 2.0, 0.5],
            albedo,
            temperature: grid(temperature, Interpolation::Trilinear),
            to_temperature: to,
            kelvin_per_unit: 2500.0,
            kelvin_offset: 300.0,
            radiance: BlackbodyRadiance::Absolute,
            intensity: 1.0,
            phase: Phase::Isotropic,
        }
    }

    /// One source of each kind, on grids of random values.
    fn source(kind: usize, seed: u64, to: DAffine3) -> EmissionSource {
        let (min, size) = ([-5, 3, -9], [9, 12, 10]);
        let tree = |i| noise(seed + i, min, size);
        let mode =
            if seed.is_multiple_of(2) { Interpolation::Trilinear } else { Interpolation::Nearest };
        match kind {
            0 => EmissionSource::Grid { grid: grid(&tree(0), mode), color: [1.0, 0.3, 0.1] },
            1 => EmissionSource::Channels {
                channels: [0, 1, 2].map(|i| grid(&tree(i), mode)),
                color: [1.0, 3.0, 0.0],
            },
            2 => EmissionSource::Ramp {
                grid: grid(&tree(0), mode),
                // Bright in a narrow band: its corners are dark where a cell passes through it.
                ramp: ColorRamp::new([(0.4, [0.0; 3]), (0.45, [9.0, 1.0, 0.0]), (0.5, [0.1; 3])])
                    .unwrap(),
            },
            3 => {
                let albedo = ColorGrid::from_float_tree(&tree(7), to).unwrap();
                thermal(&tree(0), &tree(1), to, Albedo::Grid(Arc::new(albedo)))
            }
            4 => thermal(&tree(0), &tree(1), to, Albedo::Constant([0.9, 0.5, 0.0])),
            _ => {
                let mut source = thermal(&tree(0), &tree(1), to, Albedo::Constant([0.9, 0.5, 0.0]));
                if let EmissionSource::Blackbody { phase, .. } = &mut source {
                    *phase = if kind == 5 { entries(2.0) } else { constant(3.0) };
                }
                source
            }
        }
    }

    /// Microflakes that show areas of 1 to `largest`, the same everywhere.
    fn constant(largest: f32) -> Phase {
        let s = Sggx::new([1.0, largest * largest, 1.0], [0.0; 3]).unwrap();
        microflakes(MicroflakeShape::Constant(s))
    }

    /// Microflakes by a grid of matrices that show areas up to `largest`.
    fn entries(largest: f32) -> Phase {
        let l2 = largest * largest;
        let tree = Tree::from_dense([0.0f32; 3], [-5, 3, -9], [1, 2, 1], &[[l2, 1.0, 0.5]; 2]);
        let none = Tree::from_dense([0.0f32; 3], [-5, 3, -9], [1, 2, 1], &[[0.0f32; 3]; 2]);
        let grid = MicroflakeGrid::from_entries(&tree, &none, DAffine3::IDENTITY).unwrap();
        microflakes(MicroflakeShape::Grid(Box::new(grid)))
    }

    fn microflakes(shape: MicroflakeShape) -> Phase {
        Phase::Microflakes(Arc::new(Microflakes::new(
            shape,
            MicroflakeScattering::Specular,
            DMat3::IDENTITY,
        )))
    }

    proptest! {
        /// Nowhere exceeds the emission the bound of its cell, and what emits can be met by points
        /// and drawn as a light.
        #[test]
        fn bounds_hold_and_nothing_is_lost(
            kind in 0..7usize,
            seed in 0..1000u64,
            angle in 0.0..6.0f64,
            scale in prop::sample::select(vec![1.0, 0.23, 4.0]),
            aligned: bool,
        ) {
            let to = if aligned { DAffine3::IDENTITY } else { turned(angle, 1.0 / scale) };
            let field = EmissionField::new(source(kind, seed, to), turned(angle, scale)).unwrap();
            let mut rng = Pcg32::new(seed, 2);
            let directions = EmissionDirections::new(&field, |_| 1.0);
            if let (Some(Bounds3 { low, high }), Some(directions)) = (field.bounds_world(), directions) {
                let eye = high + (high - low) * DVec3::new(0.3, 2.0, -0.4);
                let view = directions.view(eye);
                for _ in 0..2000 {
                    let u = DVec3::from_array([(); 3].map(|()| f64::from(uniform(&mut rng))));
                    let p = low + (high - low) * u;
                    let to = (p - eye).normalize().as_vec3();
                    let most = field.emission_along(p, to).max_element();
                    prop_assert!(most * field.bounds.rate_factor() <= field.rate(p) * (1.0 + 1e-5));
                    prop_assert!((most > 0.0) <= (directions.pdf(&view, to) > 0.0));
                }
                let mut tally = Tally::default();
                for _ in 0..50 {
                    let point = |rng: &mut Pcg32| {
                        let u = DVec3::from_array([(); 3].map(|()| f64::from(uniform(rng))));
                        low + (high - low) * u
                    };
                    let (from, to) = (point(&mut rng), point(&mut rng));
                    let d = (to - from).normalize();
                    let u = uniform(&mut rng);
                    field.points(from - 50.0 * d, d.as_vec3(), 1e9, u, &mut tally, |_| ());
                }
                prop_assert_eq!(tally.violations, 0);
            }
        }
    }

    /// A cube of constant emission is a few blocks, whatever its size, and its sampling and power
    /// are those of a box.
    #[test]
    fn constant_regions_stay_whole() {
        let tile = Tile { origin: [0, 4096, 0], log2_size: 12, value: 2.0, active: true };
        let tree = Tree::from_leaves(0.0, []).with_tiles([tile]);
        let source =
            EmissionSource::Grid { grid: grid(&tree, Interpolation::Nearest), color: [1.0; 3] };
        let field = EmissionField::new(source, DAffine3::from_scale(DVec3::splat(0.5))).unwrap();
        let report = field.report();
        // Cubes of 128 cells: its faces alone would take 10^6 bricks.
        assert!(report.bricks == 0 && report.tiles < 50_000, "{report:?}");
        assert!(report.bytes < 1 << 27, "{report:?}");
        let exact = 2.0 * 2048f64.powi(3);
        assert!((field.power() / exact - 1.0).abs() < 1e-3, "{} {exact}", field.power());
        let directions = EmissionDirections::new(&field, |_| 0.0).unwrap();
        let view = directions.view(DVec3::new(-9000.0, 3000.0, 1000.0));
        let mut rng = Pcg32::new(3, 3);
        for _ in 0..1000 {
            let wi = directions.sample(&view, [(); 4].map(|()| uniform(&mut rng))).unwrap();
            assert!(wi.x > 0.9 && directions.pdf(&view, wi) > 0.0);
        }
    }

    /// A temperature that varies from voxel to voxel over large tiles of density would ask for
    /// 260000 bricks: coarser bounds are taken, and still hold.
    #[test]
    fn grids_of_very_different_resolution_stay_small() {
        let tiles = (0..64).map(|i| Tile {
            origin: [128 * (i >> 4), 128 * (i >> 2 & 3), 128 * (i & 3)],
            log2_size: 7,
            value: 1.0,
            active: true,
        });
        let density = Tree::from_leaves(0.0, []).with_tiles(tiles);
        let temperature = noise(5, [-2, -2, -2], [20, 20, 20]);
        let to = DAffine3::from_scale(DVec3::splat(1.0 / 32.0));
        let source = thermal(&density, &temperature, to, Albedo::Constant([0.0; 3]));
        let field = EmissionField::new(source, DAffine3::IDENTITY).unwrap();
        let report = field.report();
        assert!(report.bricks == 0 && report.tiles < 1000, "{report:?}");
        let mut rng = Pcg32::new(4, 4);
        let directions = EmissionDirections::new(&field, |_| 0.0).unwrap();
        let view = directions.view(DVec3::splat(-600.0));
        let mut found = 0;
        for _ in 0..20_000 {
            let p = 512.0 * DVec3::from_array([(); 3].map(|()| f64::from(uniform(&mut rng))));
            let emission = field.emission(p);
            let most = emission.max_element();
            assert!(most * field.bounds.rate_factor() <= field.rate(p) * (1.0 + 1e-5));
            let to = (p + 600.0).normalize().as_vec3();
            assert!(most == 0.0 || directions.pdf(&view, to) > 0.0);
            found += usize::from(most > 0.0);
        }
        assert!(found > 10_000, "{found}");
    }

    #[test]
    fn what_is_black_has_no_points_and_no_samples() {
        let tree = noise(1, [0; 3], [8; 3]);
        let none = EmissionField::new(
            EmissionSource::Grid { grid: grid(&tree, Interpolation::Trilinear), color: [0.0; 3] },
            DAffine3::IDENTITY,
        )
        .unwrap();
        let white = thermal(&tree, &tree, DAffine3::IDENTITY, Albedo::Constant([1.0; 3]));
        for field in [none, EmissionField::new(white, DAffine3::IDENTITY).unwrap()] {
            assert!(EmissionDirections::new(&field, |_| 1.0).is_none());
            assert!(field.bounds_world().is_none());
            assert_eq!((field.power(), field.rate(DVec3::ONE)), (0.0, 0.0));
            let mut tally = Tally::default();
            field.points(DVec3::splat(-9.0), Vec3::ONE.normalize(), 1e9, 0.0, &mut tally, |_| {
                panic!("a point in the dark")
            });
        }
    }

    #[test]
    fn faults_are_refused() {
        let place = DAffine3::IDENTITY;
        let values = || grid(&noise(1, [0; 3], [8; 3]), Interpolation::Trilinear);
        let flames = |color| EmissionSource::Grid { grid: values(), color };
        let glows = ColorRamp::new([(0.0, [1.0; 3])]).unwrap();
        let faults = [
            EmissionField::new(flames([-1.0, 0.0, 0.0]), place),
            EmissionField::new(flames([f32::NAN, 0.0, 0.0]), place),
            EmissionField::new(flames([3e38, 0.0, 0.0]), place),
            EmissionField::new(flames([1.0; 3]), DAffine3::from_scale(DVec3::ZERO)),
            EmissionField::new(flames([1.0; 3]), DAffine3::from_scale(DVec3::NAN)),
            EmissionField::new(EmissionSource::Ramp { grid: values(), ramp: glows }, place),
            EmissionField::new(
                thermal(
                    &noise(1, [0; 3], [8; 3]),
                    &noise(1, [0; 3], [8; 3]),
                    DAffine3::from_scale(DVec3::INFINITY),
                    Albedo::Constant([0.0; 3]),
                ),
                place,
            ),
        ];
        for (i, fault) in faults.iter().enumerate() {
            assert!(fault.is_err(), "{i}");
        }
    }
}
