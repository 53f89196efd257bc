//! Participating media: where there is extinction, and what it does to light.

mod any_ray;
mod grid;
mod homogeneous;
mod optics;
mod placed_grid;
mod span;

pub(crate) use any_ray::AnyGridRay;
pub use any_ray::AnyRay;
use any_ray::RayKind;
pub use grid::{GridShape, VoxelKernel};
pub use homogeneous::BoxShape;
use homogeneous::HomogeneousRay;
pub use optics::{Albedo, Optics};
pub(crate) use placed_grid::PlacedGrid;
pub use span::Span;

use crate::Error;
use crate::field::ExactField;
use crate::grid::{VoxelGrid, Voxels};
use crate::majorant::MajorantStructure;
use crate::microflakes::{MicroflakeRay, Microflakes};
use crate::phase::{Phase, PhaseAt};
use crate::transmittance_function::TransmittanceFunction;
use glam::{DAffine3, DVec3, Vec3};
use pileus_math::Bounds3;
use rand_core::Rng;
use std::sync::Arc;

/// A participating medium. Cheap to copy: voxels, bounds and tables are shared.
#[derive(Debug, Clone)]
pub struct Medium {
    shape: Shape,
    optics: Optics,
}

/// Where a medium has extinction, and how much: that of its strongest channel.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Extinction from a grid.
    Grid(GridShape),
    /// Constant extinction in a box or in all space.
    Box(BoxShape),
}

/// Code that is compiled for each kind of field.
pub trait FieldKernel {
    /// What it returns.
    type Output;
    /// Runs on a field.
    fn run<F: ExactField>(self, field: F) -> Self::Output;
}

impl Medium {
    /// A heterogeneous medium: `grid` placed in the world by `index_to_world`, with the extinction
    /// `sigma_t[channel] * value`, 1/length of the world.
    ///
    /// # Errors
    /// If the transform is singular or not finite, if an extinction is negative, not finite or out
    /// of range, if a constant albedo is outside [0, 1], or if the grid's background is not zero:
    /// such a medium would fill all space.
    pub fn from_grid(
        grid: Arc<VoxelGrid>,
        index_to_world: DAffine3,
        sigma_t: [f32; 3],
        albedo: Albedo,
        phase: Phase,
    ) -> Result<Medium, Error> {
        let (strongest, optics) = Optics::new(sigma_t, albedo, phase)?;
        let shape = GridShape::new(grid, index_to_world, strongest)?;
        Ok(Medium { shape: Shape::Grid(shape), optics })
    }

    /// A homogeneous medium: extinction `sigma_t` per channel, 1/length, inside the axis-aligned
    /// box `bounds` of the world (`None`: everywhere).
    ///
    /// # Errors
    /// If an extinction is negative, not finite or out of range, if the albedo is outside [0, 1],
    /// if the box is empty or not finite, or if the phase function comes from a grid.
    pub fn homogeneous(
        sigma_t: [f32; 3],
        bounds: Option<Bounds3>,
        albedo: [f32; 3],
        phase: Phase,
    ) -> Result<Medium, Error> {
        if matches!(phase, Phase::ByGrid(_))
            || phase.microflakes().is_some_and(Microflakes::by_grid)
        {
            return Err(Error::invalid(
                "a homogeneous medium has no grid for its phase function",
                "give numbers instead of grids",
            ));
        }
        let (strongest, optics) = Optics::new(sigma_t, Albedo::Constant(albedo), phase)?;
        let shape = BoxShape::new(strongest, bounds)?;
        Ok(Medium { shape: Shape::Box(shape), optics })
    }

    /// The medium with another transmittance function; `None` is the exponential one.
    pub fn with_transmittance_function(
        self,
        function: Option<Arc<TransmittanceFunction>>,
    ) -> Medium {
        let optics = self.optics.with_transmittance_function(function);
        Medium { optics, ..self }
    }

    /// This medium with another majorant structure, and all majorants multiplied by `factor`: 1,
    /// but for experiments; above one they are looser than need be, below one they do not bound.
    /// The bounds of homogeneous media are exact and stay so.
    ///
    /// # Errors
    /// If the factor is not a positive number, or so large that majorants leave the range of single
    /// precision; if the structure takes too many cells.
    pub fn with_majorants(
        &self,
        structure: MajorantStructure,
        factor: f32,
    ) -> Result<Medium, Error> {
        let shape = match &self.shape {
            Shape::Grid(grid) => Shape::Grid(grid.with_majorants(structure, factor)?),
            Shape::Box(_) => self.shape.clone(),
        };
        Ok(Medium { shape, optics: self.optics.clone() })
    }

    /// Where the medium has extinction, and how much.
    #[inline(always)]
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// What the extinction does to light.
    #[inline(always)]
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// The grid of a heterogeneous medium.
    #[inline(always)]
    pub fn grid(&self) -> Option<&GridShape> {
        match &self.shape {
            Shape::Grid(grid) => Some(grid),
            Shape::Box(_) => None,
        }
    }

    /// The grid, if [`GridShape::ray`] is the ray of this medium: neither is the grid
    /// [wide](GridShape::is_wide), nor has it another majorant structure than every grid has, nor
    /// is it one of microflakes.
    #[inline(always)]
    pub fn default_grid(&self) -> Option<&GridShape> {
        let is_default = |grid: &&GridShape| grid.majorants().is_adaptive() && !grid.is_wide();
        self.grid().filter(is_default).filter(|_| self.phase().microflakes().is_none())
    }

    /// The box, or all space, of a homogeneous medium.
    #[inline(always)]
    pub fn homogeneous_box(&self) -> Option<&BoxShape> {
        match &self.shape {
            Shape::Box(shape) => Some(shape),
            Shape::Grid(_) => None,
        }
    }

    /// Whether all channels have the same extinction.
    #[inline(always)]
    pub fn is_grey(&self) -> bool {
        self.optics.is_grey()
    }

    /// Extinction per channel over that of the strongest, in [0, 1].
    #[inline(always)]
    pub fn chromatic_ratio(&self) -> Vec3 {
        self.optics.chromatic_ratio()
    }

    /// The phase function.
    #[inline(always)]
    pub fn phase(&self) -> &Phase {
        self.optics.phase()
    }

    /// The transmittance function; `None` is the exponential one.
    #[inline(always)]
    pub fn transmittance_function(&self) -> Option<&TransmittanceFunction> {
        self.optics.transmittance_function()
    }

    /// The box in the world that holds all extinction; `None` if there is none or if it fills all
    /// space.
    pub fn bounds_world(&self) -> Option<Bounds3> {
        match &self.shape {
            Shape::Grid(grid) => grid.bounds_world(),
            Shape::Box(shape) => shape.bounds_world(),
        }
    }

    /// Extinction of the strongest channel at a point in the world, 1/length. Microflakes count as
    /// if each showed an area of one: see [`projected_area`](Medium::projected_area).
    pub fn sigma_t_at(&self, p_world: DVec3) -> f64 {
        match &self.shape {
            Shape::Grid(grid) => grid.sigma_t_at(p_world),
            Shape::Box(shape) => shape.sigma_t_at(p_world),
        }
    }

    /// Upper bound of the extinction of the strongest channel, 1/length, with microflakes counted
    /// as in [`sigma_t_at`](Medium::sigma_t_at).
    pub fn largest_sigma_t(&self) -> f64 {
        match &self.shape {
            Shape::Grid(grid) => grid.largest_sigma_t(),
            Shape::Box(shape) => f64::from(shape.sigma_t()),
        }
    }

    /// A point of the world in the space that lookups of albedo and phase function take: the
    /// grid's index space; the world for homogeneous media.
    #[inline(always)]
    fn to_index(&self, p_world: DVec3) -> DVec3 {
        match &self.shape {
            Shape::Grid(grid) => grid.to_index(p_world),
            Shape::Box(_) => p_world,
        }
    }

    /// Single-scattering albedo per channel at a point in the world, in [0, 1].
    #[inline(always)]
    pub fn albedo_at(&self, p_world: DVec3) -> Vec3 {
        self.optics.albedo_at(|| self.to_index(p_world))
    }

    /// The phase function at a point in the world, for light that arrives along `incoming`; see
    /// [`Phase::at`].
    #[inline(always)]
    pub fn phase_at<R: Rng + ?Sized>(
        &self,
        p_world: DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'_> {
        self.phase().at(|| self.to_index(p_world), incoming, rng)
    }

    /// What the medium's microflakes show to a ray along `direction`: a factor of its extinction; 1
    /// for other media.
    pub fn projected_area(&self, p_world: DVec3, direction: Vec3) -> f32 {
        let Some(microflakes) = self.phase().microflakes() else { return 1.0 };
        microflakes.projected_area(|| self.to_index(p_world), direction)
    }

    /// The part of the ray `origin + t direction`, t in [0, t_max], that may meet extinction;
    /// `direction` is a unit vector. It may end at infinity if the medium fills all space.
    #[inline]
    pub fn span(&self, origin: DVec3, direction: Vec3, t_max: f64) -> Option<Span> {
        match &self.shape {
            Shape::Grid(grid) => grid.span(origin, direction, t_max),
            Shape::Box(shape) => shape.span(origin, direction, t_max),
        }
    }

    /// World distance from the ray's origin at parameter `t` of a field of this span: see
    /// [`RayField::distance`](crate::RayField::distance).
    #[inline]
    pub fn world_distance(&self, span: &Span, t: f32) -> f64 {
        match &self.shape {
            Shape::Grid(grid) => grid.world_distance(span, t),
            Shape::Box(_) => span.t_enter + f64::from(t),
        }
    }

    /// The extinction along a span, times `factor`, which is positive and may exceed one: whatever
    /// the shape, the voxel type, the structure of the majorants and the microflakes. Majorants are
    /// on cells that suit the factor.
    #[inline]
    pub fn any_ray(&self, span: &Span, factor: f32) -> AnyRay<'_> {
        AnyRay(match (&self.shape, self.phase().microflakes()) {
            (Shape::Grid(grid), None) => RayKind::Grid(grid.any_ray(span, factor)),
            (Shape::Box(shape), None) => RayKind::Box(shape.ray(span, factor)),
            (Shape::Grid(grid), Some(microflakes)) => {
                let index = [span.line.p + grid.local_to_index(), span.line.d];
                let density = grid.any_ray(span, factor);
                let ray = MicroflakeRay::new(density, microflakes, span.direction, index);
                RayKind::GridOfMicroflakes(ray)
            }
            (Shape::Box(shape), Some(microflakes)) => {
                let index = [span.line.p, span.line.d];
                let density = shape.ray(span, factor);
                let ray = MicroflakeRay::new(density, microflakes, span.direction, index);
                RayKind::BoxOfMicroflakes(ray)
            }
        })
    }

    /// Calls `kernel` with the extinction along a span, times `factor`, which is positive and may
    /// exceed one: compiled for each voxel type on the majorant structure that every medium has by
    /// default, and for constant extinction; everything else is an [`AnyRay`].
    #[inline(always)]
    pub fn with_ray<K: FieldKernel>(&self, span: &Span, factor: f32, kernel: K) -> K::Output {
        // Not by way of `any_ray`: its rays are moved, and own memory in wide grids.
        if let Some(grid) = self.default_grid() {
            return match grid.stored() {
                Voxels::Half(voxels) => kernel.run(grid.ray(voxels, span, factor)),
                Voxels::Single(voxels) => kernel.run(grid.ray(voxels, span, factor)),
            };
        }
        match (&self.shape, self.phase().microflakes()) {
            (Shape::Box(shape), None) => kernel.run(shape.ray(span, factor)),
            _ => kernel.run(self.any_ray(span, factor)),
        }
    }
}
