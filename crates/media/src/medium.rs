//! Participating media: a field placed in the world, with its optical properties.

use crate::Error;
use crate::color::ColorGrid;
use crate::field::{ExactField, MajorantSegment, RayField};
use crate::flakes::{FlakeRay, Flakes};
use crate::grid::{Half, Voxel, VoxelGrid, Voxels};
use crate::homogeneous::HomogeneousMedium;
use crate::law::Law;
use crate::majorant::{
    Adaptive, AnyPartition, GridRay, Line, Lowest, MajorantStructure, Majorants, Partition,
    WideRay, distance,
};
use crate::phase::{Phase, PhaseAt};
use crate::scaled::Scaled;
use crate::tally::Tally;
use glam::{DAffine3, DVec3, Vec3};
use rand_core::Rng;
use std::sync::Arc;

/// Single-scattering albedo, `sigma_s / sigma_t` per channel, in [0, 1].
#[derive(Debug, Clone)]
pub enum Albedo {
    /// The same everywhere.
    Constant([f32; 3]),
    /// Looked up where a path scatters; values outside [0, 1] are clamped.
    Grid(Arc<ColorGrid>),
}

/// A grid of extinction placed in the world. Cheap to copy for instances: the voxels are shared.
#[derive(Debug, Clone)]
pub struct GridMedium {
    grid: Arc<VoxelGrid>,
    /// Whether rays are walked in parts.
    wide: bool,
    /// Largest channel of raw value to extinction, 1/length.
    scale: f32,
    /// Raw bound to majorant, 1/length.
    bound_scale: f32,
    majorants: Arc<Majorants>,
    /// Extinction per channel relative to the largest.
    relative: Vec3,
    albedo: Albedo,
    phase: Phase,
    law: Option<Arc<Law>>,
    world_to_local: DAffine3,
    local_to_world: DAffine3,
}

/// Where a ray meets a grid medium, in its local coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// World distance from the ray's origin to the start of the span.
    pub t_enter: f64,
    /// Length of the span in world units.
    pub length: f32,
    /// The same in local coordinates, without rounding.
    line: Line,
}

impl Span {
    /// World distance from the ray's origin to the end of the span.
    pub fn t_exit(&self) -> f64 {
        self.t_enter + self.line.length
    }
}

impl GridMedium {
    /// Places `grid` by `index_to_world`, with extinction `sigma_t[channel] * value` per world unit.
    ///
    /// # Errors
    /// If the transform is singular or not finite, if an extinction is negative or not finite, or if the grid's background is not
    /// zero: such a medium would fill all space.
    pub fn new(
        grid: Arc<VoxelGrid>,
        index_to_world: DAffine3,
        sigma_t: [f32; 3],
        albedo: Albedo,
        phase: Phase,
    ) -> Result<GridMedium, Error> {
        if grid.background() != 0.0 {
            return Err(Error::unsupported(
                format!(
                    "the grid's background is {}, so that it fills all space",
                    grid.background()
                ),
                "set the background to 0 and add a homogeneous volume for what lies around",
            ));
        }
        if !sigma_t.iter().all(|s| s.is_finite() && *s >= 0.0) {
            return Err(Error::invalid(
                format!("extinction scale {sigma_t:?} is negative or not finite"),
                "give numbers of at least 0",
            ));
        }
        if let Albedo::Constant(albedo) = &albedo {
            check_albedo(albedo)?;
        }
        let (scale, relative) = strongest_and_relative(sigma_t);
        // Flights divide by the majorant and multiply it with cell sizes: keep both far from overflow.
        if !(f64::from(scale) * f64::from(grid.range().1) < 1e30) {
            return Err(Error::invalid(
                format!("the largest extinction, {scale} x {}, is out of range", grid.range().1),
                "lower the density scale, or clean the grid",
            ));
        }
        let determinant = index_to_world.matrix3.determinant();
        let finite = index_to_world.is_finite() && determinant.is_normal();
        let local_to_world = index_to_world * DAffine3::from_translation(grid.local_to_index());
        let world_to_local = local_to_world.inverse();
        if !finite || !world_to_local.is_finite() {
            return Err(Error::invalid(
                "the volume's transform is singular or not finite",
                "check the scale of the grid, the node and the job",
            ));
        }
        Ok(GridMedium {
            wide: grid.is_wide(),
            grid,
            scale,
            bound_scale: scale,
            majorants: Arc::new(Majorants::ADAPTIVE),
            relative,
            albedo,
            phase,
            law: None,
            world_to_local,
            local_to_world,
        })
    }

    /// The same medium under a transmittance law; `None` is the exponential one.
    pub fn with_law(self, law: Option<Arc<Law>>) -> GridMedium {
        GridMedium { law, ..self }
    }

    /// The transmittance law; `None` is the exponential one.
    pub fn law(&self) -> Option<&Law> {
        self.law.as_deref()
    }

    /// The same medium with another majorant structure, and all majorants multiplied by `factor`: 1, but for experiments; above one they are looser than need
    /// be, below one they do not bound.
    ///
    /// # Errors
    /// If the factor is not a positive number, or so large that majorants leave the range of single precision; if the structure takes too many cells.
    pub fn with_majorants(
        &self,
        structure: MajorantStructure,
        factor: f32,
    ) -> Result<GridMedium, Error> {
        let bound_scale = self.scale * factor;
        let largest = f64::from(bound_scale) * f64::from(self.grid.range().1);
        if !(factor > 0.0 && largest < 1e30) {
            return Err(Error::invalid(
                format!("majorants scaled by {factor}"),
                "give a positive number that keeps them in range",
            ));
        }
        let per_voxel = bound_scale * self.voxel_length();
        let majorants = Majorants::new(&self.grid, structure, per_voxel)?;
        Ok(GridMedium { bound_scale, majorants: Arc::new(majorants), ..self.clone() })
    }

    /// The majorant structure.
    pub fn majorants(&self) -> &Majorants {
        &self.majorants
    }

    /// Edge of a voxel in the world; the geometric mean where edges differ.
    fn voxel_length(&self) -> f32 {
        self.local_to_world.matrix3.determinant().abs().cbrt() as f32
    }

    /// Optical depth of the largest majorant along the longest edge of a voxel: what methods of tentative collisions may have to look up in one.
    pub fn majorant_depth_per_voxel(&self) -> f64 {
        let m = self.local_to_world.matrix3;
        let longest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        f64::from(self.bound_scale) * f64::from(self.grid.range().1) * longest
    }

    /// From index space to the world.
    pub fn index_to_world(&self) -> DAffine3 {
        self.local_to_world * DAffine3::from_translation(-self.grid.local_to_index())
    }

    /// The field.
    pub fn grid(&self) -> &Arc<VoxelGrid> {
        &self.grid
    }

    /// Raw value to extinction of the strongest channel, 1/length.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// Extinction per channel relative to the strongest.
    pub fn relative_extinction(&self) -> Vec3 {
        self.relative
    }

    /// Whether all channels have the same extinction.
    pub fn is_grey(&self) -> bool {
        self.relative == Vec3::ONE
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// The phase function at a point in the world, for light that arrives along `incoming`; see [`Phase::at`].
    #[inline(always)]
    pub fn phase_at<R: Rng + ?Sized>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'_> {
        self.phase.at(|| self.to_index(p_world), incoming, rng)
    }

    fn to_index(&self, p_world: DVec3) -> DVec3 {
        self.world_to_local.transform_point3(p_world) + self.grid.local_to_index()
    }

    /// The ray field of a span for a medium of flakes: `ray` is that of its density.
    pub fn flake_ray<'a, F: RayField>(
        &'a self,
        ray: F,
        flakes: &'a Flakes,
        direction: Vec3,
        span: &Span,
    ) -> FlakeRay<'a, F> {
        let start = span.line.p + self.grid.local_to_index();
        FlakeRay::new(ray, flakes, direction, [start, span.line.d])
    }

    /// The albedo.
    pub fn albedo(&self) -> &Albedo {
        &self.albedo
    }

    /// Albedo at a point in the world.
    #[inline(always)]
    pub fn albedo_at(&self, p_world: DVec3) -> Vec3 {
        match &self.albedo {
            Albedo::Constant(albedo) => Vec3::from_array(*albedo),
            Albedo::Grid(grid) => {
                let p_local = self.world_to_local.transform_point3(p_world);
                grid.at_index(p_local + self.grid.local_to_index())
            }
        }
    }

    /// Extinction of the strongest channel at a point in the world, 1/length.
    pub fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        self.grid.interpolate(self.to_index(p_world)) * f64::from(self.scale)
    }

    /// The box in the world that holds all extinction; `None` if there is none.
    pub fn bounds_world(&self) -> Option<(DVec3, DVec3)> {
        if self.grid.is_empty() {
            return None;
        }
        let [low, high] = self.support();
        let corners = (0..8).map(|corner| {
            let pick = |axis: usize| if corner >> axis & 1 == 1 { high[axis] } else { low[axis] };
            self.local_to_world.transform_point3(DVec3::new(pick(0), pick(1), pick(2)))
        });
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in corners {
            min = min.min(corner);
            max = max.max(corner);
        }
        Some((min, max))
    }

    pub(crate) fn world_to_local(&self) -> &DAffine3 {
        &self.world_to_local
    }

    fn support(&self) -> [DVec3; 2] {
        self.grid.support.map(|corner| DVec3::from_array(corner.map(f64::from)))
    }

    /// Clips local ray `o + t d` to the support.
    #[inline(always)]
    pub(crate) fn clip_local(
        &self,
        o: DVec3,
        d: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, f64)> {
        let [low, high] = self.support();
        let (mut t0, mut t1) = (t_min, t_max);
        for axis in 0..3 {
            if d[axis] == 0.0 {
                if o[axis] < low[axis] || o[axis] > high[axis] {
                    return None;
                }
                continue;
            }
            let inv = 1.0 / d[axis];
            let (a, b) = ((low[axis] - o[axis]) * inv, (high[axis] - o[axis]) * inv);
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        // Also false for NaN.
        (t0 < t1).then_some((t0, t1))
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], that may meet extinction; `direction` is a unit vector.
    #[inline(always)]
    pub fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        let o = self.world_to_local.transform_point3(origin);
        // In double precision: the origin may be far off.
        let d = self.world_to_local.matrix3 * direction.as_dvec3();
        // Also refuses NaN, which the clipping would pass over.
        if !(d.length_squared() > 0.0) {
            return None;
        }
        let (t0, t1) = self.clip_local(o, d, 0.0, t_max)?;
        let line = Line { p: o + d * t0, d, length: t1 - t0 };
        Some(Span { t_enter: t0, length: line.length as f32, line })
    }

    /// The part of a ray up to `t_max` that may hold extinction, in world distance from its origin.
    pub fn extent(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<(f64, f64)> {
        let span = self.span(origin, direction, t_max)?;
        Some((span.t_enter, span.t_exit()))
    }

    /// Whether the grid is so wide that its rays are walked in parts: more than 2^13 voxels along an axis, which single precision cannot count
    /// from one corner. Only [`any_ray`](GridMedium::any_ray) and what is made of it does so.
    pub fn is_wide(&self) -> bool {
        self.wide
    }

    /// World distance from the ray's origin at parameter `t` of a field of this span: see [`RayField::distance`].
    #[inline]
    pub fn world_distance(&self, span: &Span, t: f32) -> f64 {
        let t = f64::from(t);
        let t = if self.is_wide() { distance(&self.grid, &span.line, t) } else { t };
        span.t_enter + t
    }

    /// The ray field of a span, for a grid stored as `V`, on the hierarchy that every medium has by default; for grids that are not
    /// [wide](GridMedium::is_wide).
    #[inline(always)]
    pub fn ray<'a, V: Voxel>(&'a self, voxels: &'a [V], span: &Span) -> GridRay<'a, V> {
        self.ray_of_share(voxels, span, 1.0)
    }

    /// The same for `share`, in (0, 1], of the extinction: that of a weaker channel, on cells that suit it.
    #[inline(always)]
    pub fn ray_of_share<'a, V: Voxel>(
        &'a self,
        voxels: &'a [V],
        span: &Span,
        share: f32,
    ) -> GridRay<'a, V> {
        let partition = Adaptive::new(&self.grid, self.per_voxel(span, share));
        self.ray_on(voxels, partition, span, share)
    }

    /// The same on any structure.
    #[inline]
    pub fn any_structure_ray<'a, V: Voxel>(
        &'a self,
        voxels: &'a [V],
        span: &Span,
    ) -> GridRay<'a, V, AnyPartition<'a>> {
        self.any_structure_ray_of_share(voxels, span, 1.0)
    }

    /// As [`ray_of_share`](GridMedium::ray_of_share), on any structure.
    #[inline]
    pub fn any_structure_ray_of_share<'a, V: Voxel>(
        &'a self,
        voxels: &'a [V],
        span: &Span,
        share: f32,
    ) -> GridRay<'a, V, AnyPartition<'a>> {
        let per_voxel = self.per_voxel(span, share);
        self.ray_on(voxels, self.majorants.partition(&self.grid, per_voxel), span, share)
    }

    /// Raw bound to majorant per voxel along a span.
    #[inline(always)]
    fn per_voxel(&self, span: &Span, share: f32) -> f32 {
        share * self.bound_scale / span.line.d.as_vec3().length()
    }

    #[inline(always)]
    fn ray_on<'a, V: Voxel, P: Partition>(
        &'a self,
        voxels: &'a [V],
        partition: P,
        span: &Span,
        share: f32,
    ) -> GridRay<'a, V, P> {
        let scales = [share * self.scale, share * self.bound_scale];
        GridRay::new(self.grid.view(voxels), partition, scales, Lowest, span.line)
    }

    /// The ray field of a span of a wide grid.
    #[inline(never)]
    fn wide_ray<'a>(&'a self, partition: AnyPartition<'a>, span: &Span) -> AnyGridRay<'a> {
        let scales = [self.scale, self.bound_scale];
        AnyGridRay::Wide(Box::new(WideRay::new(&self.grid, partition, scales, span.line)))
    }

    /// The ray field of a span on cells that are a function of the point alone, also where voxels are longer along some axes.
    pub(crate) fn point_ray(&self, span: &Span) -> AnyGridRay<'_> {
        let partition = self.point_cells();
        if self.is_wide() {
            return self.wide_ray(AnyPartition::Adaptive(partition), span);
        }
        match &self.grid.voxels {
            Voxels::Half(voxels) => AnyGridRay::Half(self.ray_on(voxels, partition, span, 1.0)),
            Voxels::Single(voxels) => AnyGridRay::Single(self.ray_on(voxels, partition, span, 1.0)),
        }
    }

    /// The majorant of a [`point_ray`](GridMedium::point_ray) at a point in the world, 1/length.
    pub(crate) fn point_rate(&self, p_world: DVec3) -> f32 {
        let p = self.world_to_local.transform_point3(p_world);
        let [low, high] = self.support();
        if !(p.cmpge(low).all() && p.cmplt(high).all()) {
            return 0.0;
        }
        // Within the support, which lies within the extent.
        self.point_cells().cell(p.to_array().map(|c| c as i32), 0).max * self.bound_scale
    }

    fn point_cells(&self) -> Adaptive<'_> {
        Adaptive::new(&self.grid, self.bound_scale * self.voxel_length())
    }

    /// The ray field of a span, whatever the voxel type and the structure.
    #[inline(always)]
    pub fn any_ray(&self, span: &Span) -> AnyGridRay<'_> {
        if self.is_wide() {
            let partition = self.majorants.partition(&self.grid, self.per_voxel(span, 1.0));
            return self.wide_ray(partition, span);
        }
        match (&self.grid.voxels, self.majorants.is_adaptive()) {
            (Voxels::Half(voxels), true) => AnyGridRay::Half(self.ray(voxels, span)),
            (Voxels::Single(voxels), true) => AnyGridRay::Single(self.ray(voxels, span)),
            (Voxels::Half(voxels), false) => {
                AnyGridRay::HalfOther(self.any_structure_ray(voxels, span))
            }
            (Voxels::Single(voxels), false) => {
                AnyGridRay::SingleOther(self.any_structure_ray(voxels, span))
            }
        }
    }

    /// Calls `kernel` with the ray field of a span for a share of the extinction, compiled for each voxel type on the structure that every medium has by default.
    #[inline(always)]
    pub fn with_ray<K: FieldKernel>(&self, span: &Span, share: f32, kernel: K) -> K::Output {
        // Not by way of `any_ray`: its rays are moved, and own memory in wide grids.
        match (&self.grid.voxels, self.majorants.is_adaptive() && !self.is_wide()) {
            (Voxels::Half(voxels), true) => kernel.run(self.ray_of_share(voxels, span, share)),
            (Voxels::Single(voxels), true) => kernel.run(self.ray_of_share(voxels, span, share)),
            _ => self.with_any_ray(span, share, kernel),
        }
    }

    /// As [`with_ray`](GridMedium::with_ray), by the ray that needs no kernel of its own.
    #[inline(never)]
    fn with_any_ray<K: FieldKernel>(&self, span: &Span, share: f32, kernel: K) -> K::Output {
        kernel.run(Scaled::new(self.any_ray(span), share))
    }

    /// Calls `kernel` with the voxels in their type: the one place where precision is chosen.
    #[inline(always)]
    pub fn with_voxels<K: VoxelKernel>(&self, kernel: K) -> K::Output {
        match &self.grid.voxels {
            Voxels::Half(voxels) => kernel.run(voxels),
            Voxels::Single(voxels) => kernel.run(voxels),
        }
    }
}

/// Code that is compiled for each voxel type.
pub trait VoxelKernel {
    /// What it returns.
    type Output;
    /// Runs on voxels of type `V`.
    fn run<V: Voxel>(self, voxels: &[V]) -> Self::Output;
}

/// Code that is compiled for each kind of field.
pub trait FieldKernel {
    /// What it returns.
    type Output;
    /// Runs on a field.
    fn run<F: RayField>(self, field: F) -> Self::Output;
}

/// A ray through a grid of either voxel type and any majorant structure, for code that is not compiled for each.
#[derive(Debug, Clone)]
pub enum AnyGridRay<'a> {
    /// Voxels stored as binary16.
    Half(GridRay<'a, Half>),
    /// Voxels stored as binary32.
    Single(GridRay<'a, f32>),
    /// Voxels stored as binary16, on another structure than every grid's hierarchy.
    HalfOther(GridRay<'a, Half, AnyPartition<'a>>),
    /// Voxels stored as binary32, likewise.
    SingleOther(GridRay<'a, f32, AnyPartition<'a>>),
    /// Through a grid that is too wide for single precision.
    Wide(Box<WideRay<'a>>),
}

impl AnyGridRay<'_> {
    /// The local point at ray parameter `t` of the segment handed out last, inside its cell whatever rounding says.
    #[inline]
    pub(crate) fn local_in_cell(&self, t: f32) -> DVec3 {
        match self {
            AnyGridRay::Half(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::Single(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::HalfOther(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::SingleOther(ray) => ray.local_in_cell(t).as_dvec3(),
            AnyGridRay::Wide(ray) => ray.local_in_cell(t),
        }
    }
}

impl RayField for AnyGridRay<'_> {
    #[inline]
    fn next_segment(&mut self) -> Option<MajorantSegment> {
        match self {
            AnyGridRay::Half(ray) => ray.next_segment(),
            AnyGridRay::Single(ray) => ray.next_segment(),
            AnyGridRay::HalfOther(ray) => ray.next_segment(),
            AnyGridRay::SingleOther(ray) => ray.next_segment(),
            AnyGridRay::Wide(ray) => ray.next_segment(),
        }
    }

    fn minorant(&self) -> f32 {
        match self {
            AnyGridRay::Half(ray) => ray.minorant(),
            AnyGridRay::Single(ray) => ray.minorant(),
            AnyGridRay::HalfOther(ray) => ray.minorant(),
            AnyGridRay::SingleOther(ray) => ray.minorant(),
            AnyGridRay::Wide(ray) => ray.minorant(),
        }
    }

    #[inline]
    fn sigma_t(&self, t: f32) -> f32 {
        match self {
            AnyGridRay::Half(ray) => ray.sigma_t(t),
            AnyGridRay::Single(ray) => ray.sigma_t(t),
            AnyGridRay::HalfOther(ray) => ray.sigma_t(t),
            AnyGridRay::SingleOther(ray) => ray.sigma_t(t),
            AnyGridRay::Wide(ray) => ray.sigma_t(t),
        }
    }

    fn sigma_t_anywhere(&self, t: f32) -> f32 {
        match self {
            AnyGridRay::Half(ray) => ray.sigma_t_anywhere(t),
            AnyGridRay::Single(ray) => ray.sigma_t_anywhere(t),
            AnyGridRay::HalfOther(ray) => ray.sigma_t_anywhere(t),
            AnyGridRay::SingleOther(ray) => ray.sigma_t_anywhere(t),
            AnyGridRay::Wide(ray) => ray.sigma_t_anywhere(t),
        }
    }

    fn distance(&self, t: f64) -> f64 {
        match self {
            AnyGridRay::Wide(ray) => ray.distance(t),
            _ => t,
        }
    }

    fn steps(&self) -> u64 {
        match self {
            AnyGridRay::Half(ray) => ray.steps(),
            AnyGridRay::Single(ray) => ray.steps(),
            AnyGridRay::HalfOther(ray) => ray.steps(),
            AnyGridRay::SingleOther(ray) => ray.steps(),
            AnyGridRay::Wide(ray) => ray.steps(),
        }
    }
}

impl ExactField for AnyGridRay<'_> {
    fn optical_depth(&self, tally: &mut Tally) -> f64 {
        match self {
            AnyGridRay::Half(ray) => ray.optical_depth(tally),
            AnyGridRay::Single(ray) => ray.optical_depth(tally),
            AnyGridRay::HalfOther(ray) => ray.optical_depth(tally),
            AnyGridRay::SingleOther(ray) => ray.optical_depth(tally),
            AnyGridRay::Wide(ray) => ray.optical_depth(tally),
        }
    }

    fn t_at_depth(&self, depth: f64, tally: &mut Tally) -> Result<f32, f64> {
        match self {
            AnyGridRay::Half(ray) => ray.t_at_depth(depth, tally),
            AnyGridRay::Single(ray) => ray.t_at_depth(depth, tally),
            AnyGridRay::HalfOther(ray) => ray.t_at_depth(depth, tally),
            AnyGridRay::SingleOther(ray) => ray.t_at_depth(depth, tally),
            AnyGridRay::Wide(ray) => ray.t_at_depth(depth, tally),
        }
    }
}

/// The strongest channel's extinction, and all channels relative to it.
pub(crate) fn strongest_and_relative(sigma_t: [f32; 3]) -> (f32, Vec3) {
    let sigma_t = Vec3::from_array(sigma_t);
    let scale = sigma_t.max_element();
    (scale, if scale > 0.0 { sigma_t / scale } else { Vec3::ONE })
}

pub(crate) fn check_albedo(albedo: &[f32; 3]) -> Result<(), Error> {
    if albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
        return Ok(());
    }
    Err(Error::invalid(format!("albedo {albedo:?} is outside [0, 1]"), "give numbers from 0 to 1"))
}

/// A participating medium.
#[derive(Debug, Clone)]
pub enum Medium {
    /// Extinction from a grid.
    Grid(GridMedium),
    /// The same extinction everywhere in a box or in all space.
    Homogeneous(HomogeneousMedium),
}

impl Medium {
    /// The box in the world that holds all extinction; `None` if there is none or if it fills all space.
    pub fn bounds_world(&self) -> Option<(DVec3, DVec3)> {
        match self {
            Medium::Grid(medium) => medium.bounds_world(),
            Medium::Homogeneous(medium) => medium.bounds_world(),
        }
    }

    /// Whether all channels have the same extinction.
    pub fn is_grey(&self) -> bool {
        match self {
            Medium::Grid(medium) => medium.is_grey(),
            Medium::Homogeneous(medium) => medium.is_grey(),
        }
    }

    /// Extinction per channel relative to the strongest.
    pub fn relative_extinction(&self) -> Vec3 {
        match self {
            Medium::Grid(medium) => medium.relative_extinction(),
            Medium::Homogeneous(medium) => medium.relative_extinction(),
        }
    }

    /// The phase function.
    pub fn phase(&self) -> &Phase {
        match self {
            Medium::Grid(medium) => medium.phase(),
            Medium::Homogeneous(medium) => medium.phase(),
        }
    }

    /// The phase function at a point in the world, for light that arrives along `incoming`; see [`Phase::at`].
    #[inline(always)]
    pub fn phase_at<R: Rng + ?Sized>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'_> {
        match self {
            Medium::Grid(medium) => medium.phase_at(p_world, incoming, rng),
            Medium::Homogeneous(medium) => medium.phase().at(|| p_world, incoming, rng),
        }
    }

    /// What the medium's flakes show to a ray along `direction`: a factor of its extinction; 1 for other media.
    pub fn projected_area(&self, p_world: DVec3, direction: Vec3) -> f32 {
        let Some(flakes) = self.phase().flakes() else { return 1.0 };
        match self {
            Medium::Grid(medium) => flakes.projected_area(|| medium.to_index(p_world), direction),
            Medium::Homogeneous(_) => flakes.projected_area(|| p_world, direction),
        }
    }

    /// The same medium under a transmittance law; `None` is the exponential one.
    pub fn with_law(self, law: Option<Arc<Law>>) -> Medium {
        match self {
            Medium::Grid(medium) => Medium::Grid(medium.with_law(law)),
            Medium::Homogeneous(medium) => Medium::Homogeneous(medium.with_law(law)),
        }
    }

    /// The transmittance law; `None` is the exponential one.
    pub fn law(&self) -> Option<&Law> {
        match self {
            Medium::Grid(medium) => medium.law(),
            Medium::Homogeneous(medium) => medium.law(),
        }
    }

    /// Extinction of the strongest channel at a point in the world, 1/length.
    pub fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        match self {
            Medium::Grid(medium) => medium.sigma_t_at(p_world),
            Medium::Homogeneous(medium) => medium.sigma_t_at(p_world),
        }
    }

    /// The part of a ray up to `t_max` that may hold extinction, in world distance from its origin; may end at infinity.
    pub fn extent(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<(f64, f64)> {
        match self {
            Medium::Grid(medium) => medium.extent(origin, direction, t_max),
            Medium::Homogeneous(medium) => {
                let (t_enter, length) = medium.span(origin, direction, t_max)?;
                Some((t_enter, t_enter + f64::from(length)))
            }
        }
    }

    /// As [`GridMedium::with_majorants`]; the bounds of homogeneous media are exact and stay so.
    ///
    /// # Errors
    /// As there.
    pub fn with_majorants(
        &self,
        structure: MajorantStructure,
        factor: f32,
    ) -> Result<Medium, Error> {
        match self {
            Medium::Grid(medium) => medium.with_majorants(structure, factor).map(Medium::Grid),
            Medium::Homogeneous(_) => Ok(self.clone()),
        }
    }

    /// Albedo at a point in the world.
    #[inline(always)]
    pub fn albedo_at(&self, p_world: DVec3) -> Vec3 {
        match self {
            Medium::Grid(medium) => medium.albedo_at(p_world),
            Medium::Homogeneous(medium) => medium.albedo(),
        }
    }
}
