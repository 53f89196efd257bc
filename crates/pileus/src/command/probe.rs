//! `pileus probe`: single questions to a volume.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DVec3};
use pileus_media::transmittance::Estimator;
use pileus_media::{
    Albedo, ExactField, FieldKernel, Grey, Interpolation, Medium, Phase, Tally, VoxelGrid,
    VoxelGridOptions, optical_depth,
};
use pileus_scene::json::Document;
use pileus_scene::volume::affine;
use pileus_scene::{Error, Place};
use pileus_vdb::{Accessor, Tree, Values, VdbFile};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::cli::{ProbeOptions, Question, TransmittanceOptions, ValuesOptions};
use crate::command::info::ToJson;
use crate::failure::Failure;
use crate::input::read_text;
use crate::report::Report;

/// Largest file of points or rays.
const MAX_QUESTIONS: u64 = 1 << 30;

pub(crate) fn run(options: &ProbeOptions, report: &Report) -> Result<(), Failure> {
    match &options.question {
        Question::Values(options) => report.json(&values(options)?),
        Question::Transmittance(options) => report.json(&transmittance(options)?),
    }
    Ok(())
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<(Document, T), Failure> {
    let document = Document::new(path, read_text(path, MAX_QUESTIONS)?);
    let value = document.parse()?;
    Ok((document, value))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Points {
    space: Space,
    points: Vec<[f64; 3]>,
}

#[derive(Deserialize, PartialEq, Clone, Copy)]
#[serde(rename_all = "snake_case")]
enum Space {
    Index,
    World,
}

/// A grid that the command line names and the file does not have.
fn no_grid(error: pileus_vdb::Error) -> Failure {
    match error {
        pileus_vdb::Error::Missing { .. } => {
            Failure::usage(error.to_string(), "name a grid of the file with --grid NAME")
        }
        other => other.into(),
    }
}

fn values(options: &ValuesOptions) -> Result<Value, Failure> {
    let (_, Points { space, points }) = read(&options.points)?;
    let file = VdbFile::open(&options.file)?;
    let index = file.find(&options.grid).map_err(no_grid)?;
    let grid = file.read(index)?;
    let world_to_index = match space {
        Space::Index => DAffine3::IDENTITY,
        Space::World => affine(grid.info.transform.world_to_index()?),
    };
    let points: Vec<DVec3> = points
        .into_iter()
        .map(|point| world_to_index.transform_point3(DVec3::from_array(point)))
        .collect();
    let nearest = options.interpolation == Interpolation::Nearest;
    let (values, active): (Vec<Value>, Vec<bool>) = match &grid.values {
        Values::Float(tree) => look_up(tree, &points, nearest),
        Values::Double(tree) => look_up(tree, &points, nearest),
        Values::Int32(tree) => look_up(tree, &points, nearest),
        Values::Int64(tree) => look_up(tree, &points, nearest),
        // Between true and false there is nothing.
        Values::Bool(tree) | Values::Mask(tree) => look_up(tree, &points, true),
        Values::Vec3f(tree) => look_up(tree, &points, nearest),
        Values::Vec3d(tree) => look_up(tree, &points, nearest),
        Values::Vec3i(tree) => look_up(tree, &points, nearest),
    }
    .into_iter()
    .unzip();
    Ok(json!({ "values": values, "active": active }))
}

/// Values that can be mixed linearly, in double precision.
trait Mix: ToJson {
    fn mix(corners: [Self; 8], weights: [f64; 8]) -> Value;
}

macro_rules! mix_numbers {
    ($($number:ty),*) => {$(
        impl Mix for $number {
            fn mix(corners: [Self; 8], weights: [f64; 8]) -> Value {
                weighted(corners.map(|c| c as f64), weights).to_json()
            }
        }
        impl Mix for [$number; 3] {
            fn mix(corners: [Self; 8], weights: [f64; 8]) -> Value {
                [0, 1, 2].map(|axis| weighted(corners.map(|c| c[axis] as f64), weights)).to_json()
            }
        }
    )*};
}
mix_numbers!(f32, f64, i32, i64);

impl Mix for bool {
    fn mix(corners: [Self; 8], _: [f64; 8]) -> Value {
        corners[0].to_json()
    }
}

/// Corners of weight zero do not count, even if they are not finite.
fn weighted(corners: [f64; 8], weights: [f64; 8]) -> f64 {
    corners.into_iter().zip(weights).filter(|(_, w)| *w != 0.0).map(|(c, w)| c * w).sum()
}

fn look_up<T: Mix>(tree: &Tree<T>, points: &[DVec3], nearest: bool) -> Vec<(Value, bool)> {
    let mut accessor = tree.accessor();
    points.iter().map(|&point| look_up_one(&mut accessor, tree, point, nearest)).collect()
}

/// The value at a point in index space, and whether the voxel nearest to it is active.
fn look_up_one<T: Mix>(
    accessor: &mut Accessor<'_, T>,
    tree: &Tree<T>,
    point: DVec3,
    nearest: bool,
) -> (Value, bool) {
    // Far outside of what coordinates can express there is the background.
    let limit = f64::from(i32::MAX - 1);
    if !point.to_array().iter().all(|c| c.abs() < limit) {
        return (tree.background().to_json(), false);
    }
    let coord = |p: DVec3| p.to_array().map(|c| c as i32);
    let (value, active) = accessor.value(coord((point + 0.5).floor()));
    let floor = point.floor();
    if nearest {
        return (value.to_json(), active);
    }
    if floor == point {
        let (value, active) = accessor.value(coord(floor));
        return (value.to_json(), active);
    }
    let fraction = (point - floor).to_array();
    let [x, y, z] = coord(floor);
    let corners: [[i32; 3]; 8] = std::array::from_fn(|i| {
        let i = i as i32;
        [x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)]
    });
    let weights = std::array::from_fn(|i| {
        let weight = |axis: usize| {
            let f = fraction[axis];
            if i >> axis & 1 == 1 { f } else { 1.0 - f }
        };
        weight(0) * weight(1) * weight(2)
    });
    (T::mix(corners.map(|c| accessor.value(c).0), weights), active)
}

/// Rays as in the oracle files, which carry more than a question needs: other keys are ignored.
#[derive(Deserialize)]
struct Rays {
    rays: Vec<RayQuestion>,
}

#[derive(Deserialize)]
struct RayQuestion {
    origin: [f64; 3],
    direction: [f64; 3],
    tmin: f64,
    tmax: f64,
}

#[derive(Serialize)]
struct RayAnswer {
    mean: f64,
    variance: f64,
    samples: u64,
    lookups: u64,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    optical_depth: Option<f64>,
    #[serde(skip)]
    dropped: u64,
}

fn transmittance(options: &TransmittanceOptions) -> Result<Value, Failure> {
    let estimator = options.estimator;
    if options.samples == 0 {
        return Err(Failure::usage("no samples", "take at least one"));
    }
    let (document, Rays { rays }) = read(&options.rays)?;
    let file = VdbFile::open(&options.file)?;
    let index = file.find(&options.grid).map_err(no_grid)?;
    let grid = file.read(index)?;
    let index_to_world = affine(grid.info.transform.index_to_world()?);
    let interpolation = options.interpolation;
    let grid = VoxelGrid::from_tree(&grid.to_float()?, &VoxelGridOptions { interpolation })?;
    let medium = Medium::from_grid(
        Arc::new(grid),
        index_to_world,
        [options.density_scale as f32; 3],
        Albedo::Constant([0.0; 3]),
        Phase::Isotropic,
    )?;
    let mut segments = Vec::with_capacity(rays.len());
    for (i, ray) in rays.iter().enumerate() {
        segments.push(Segment::new(ray).map_err(|(key, what)| -> Failure {
            let place: Place = document.place(&format!("/rays/{i}/{key}"));
            Error::invalid(place, what, "give finite numbers, tmin <= tmax").into()
        })?);
    }
    let answers: Vec<RayAnswer> = segments
        .par_iter()
        .enumerate()
        .map(|(i, segment)| answer(&medium, segment, estimator, options, i as u64))
        .collect();
    let dropped: u64 = answers.iter().map(|answer| answer.dropped).sum();
    Ok(json!({ "estimator": estimator.name(), "rays": answers, "dropped": dropped }))
}

/// A ray's interval with a unit direction, starting at its origin.
struct Segment {
    origin: DVec3,
    direction: DVec3,
    length: f64,
}

impl Segment {
    fn new(ray: &RayQuestion) -> Result<Self, (&'static str, &'static str)> {
        let (origin, direction) = (DVec3::from_array(ray.origin), DVec3::from_array(ray.direction));
        let Some(unit) = direction.try_normalize() else {
            return Err(("direction", "the direction is zero or not finite"));
        };
        if !origin.is_finite() {
            return Err(("origin", "the origin is not finite"));
        }
        if !(ray.tmin.is_finite() && ray.tmax >= ray.tmin) {
            return Err(("tmax", "tmin and tmax do not bound a segment"));
        }
        // t counts in lengths of the direction as it was given.
        let length = (ray.tmax - ray.tmin) * direction.length();
        Ok(Self { origin: origin + direction * ray.tmin, direction: unit, length })
    }
}

fn answer(
    medium: &Medium,
    segment: &Segment,
    estimator: Estimator,
    options: &TransmittanceOptions,
    stream: u64,
) -> RayAnswer {
    let start = Instant::now();
    let mut tally = Tally::default();
    if estimator == Estimator::Regular {
        let depth = optical_depth(
            medium,
            segment.origin,
            segment.direction,
            0.0,
            segment.length,
            &mut tally,
        );
        return RayAnswer {
            mean: (-depth).exp(),
            variance: 0.0,
            samples: 1,
            lookups: tally.lookups,
            seconds: start.elapsed().as_secs_f64(),
            optical_depth: Some(depth),
            dropped: 0,
        };
    }
    let span = medium.span(segment.origin, segment.direction.as_vec3(), segment.length);
    let mut moments = Moments::default();
    match span {
        // Outside of the volume every sample is one.
        None => moments = Moments { count: options.samples, mean: 1.0, ..moments },
        Some(span) => {
            // One stream per ray: the result does not depend on threads.
            let rng = &mut generator(options.seed, stream);
            for _ in 0..options.samples {
                let estimate = Estimate { estimator, rng, tally: &mut tally };
                moments.add(f64::from(medium.with_ray(&span, 1.0, estimate)));
            }
        }
    }
    RayAnswer {
        mean: moments.mean,
        variance: moments.variance(),
        samples: moments.count,
        lookups: tally.lookups,
        seconds: start.elapsed().as_secs_f64(),
        optical_depth: None,
        dropped: moments.dropped,
    }
}

fn generator(seed: u64, stream: u64) -> Pcg64Mcg {
    // Two odd multipliers (the golden ratio and that of splitmix64) keep close seeds and rays
    // apart.
    let high = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let low = stream.wrapping_add(1).wrapping_mul(0xbf58_476d_1ce4_e5b9) ^ high.rotate_left(32);
    Pcg64Mcg::new(u128::from(high) << 64 | u128::from(low))
}

/// Mean and spread of samples (Welford 1962).
#[derive(Default, Clone, Copy)]
struct Moments {
    count: u64,
    mean: f64,
    squares: f64,
    dropped: u64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        if !value.is_finite() {
            self.dropped += 1;
            return;
        }
        self.count += 1;
        let delta = value - self.mean;
        self.mean += delta / self.count as f64;
        self.squares += delta * (value - self.mean);
    }

    /// Unbiased variance of one sample; 0 below two samples.
    fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.squares / (self.count - 1) as f64 }
    }
}

/// One estimate along a ray, compiled for each kind of field.
struct Estimate<'a> {
    estimator: Estimator,
    rng: &'a mut Pcg64Mcg,
    tally: &'a mut Tally,
}

impl FieldKernel for Estimate<'_> {
    type Output = f32;

    fn run<F: ExactField>(self, field: F) -> f32 {
        self.estimator.estimate(field, Grey, 0.0, self.rng, self.tally)
    }
}
