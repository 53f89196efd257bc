//! Media of microflakes [Jakob et al. 2010, "A radiative transfer framework for rendering
//! materials with anisotropic structure"]: extinction depends on the direction of the ray,
//! scattering on both directions, and both follow from one distribution of microflake normals.
//!
//! With density `rho` (a medium's extinction where all microflakes face the ray) the extinction
//! along `w` is `rho sigma(w)`, and `sigma(w) f(w, w') = sigma(w') f(w', w)`: light paths may be
//! reversed.

mod grid;
mod ray;
mod sggx;
#[cfg(test)]
mod tests;

pub use grid::{MicroflakeGrid, Roughness};
pub(crate) use ray::MicroflakeRay;
pub use sggx::{MIN_ROUGHNESS, Sggx};

use crate::phase::PhaseAt;
use glam::{DMat3, DVec3, Mat3, Vec3};
use pileus_math::random::uniform;
use rand_core::Rng;
use std::fmt;

/// Where the distribution of microflakes comes from.
#[derive(Debug, Clone)]
pub enum MicroflakeShape {
    /// One distribution everywhere.
    Constant(Sggx),
    /// By grids.
    Grid(Box<MicroflakeGrid>),
}

/// How a microflake scatters light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MicroflakeScattering {
    /// Specular: the microflake is a mirror.
    Specular,
    /// Diffuse: the microflake is a Lambertian surface, on the side that it is lit from.
    Diffuse,
}

/// The microflakes of a medium, in the volume's own space.
#[derive(Debug, Clone)]
pub struct Microflakes {
    shape: MicroflakeShape,
    scattering: MicroflakeScattering,
    /// From the volume's space to the world; a rotation, perhaps with a reflection.
    to_world: Mat3,
}

impl Microflakes {
    /// Microflakes of a shape, placed: `placement` turns the volume's space into the world; its
    /// scale is left out.
    pub fn new(
        shape: MicroflakeShape,
        scattering: MicroflakeScattering,
        placement: DMat3,
    ) -> Microflakes {
        Microflakes { shape, scattering, to_world: rotation_of(placement).as_mat3() }
    }

    /// How the microflakes scatter.
    pub fn scattering(&self) -> MicroflakeScattering {
        self.scattering
    }

    /// Whether the distribution comes from grids.
    pub fn by_grid(&self) -> bool {
        matches!(self.shape, MicroflakeShape::Grid(_))
    }

    /// The microflakes at a point, in the volume's own space.
    fn shape_at(&self, p_index: impl FnOnce() -> DVec3) -> Sggx {
        match &self.shape {
            MicroflakeShape::Constant(s) => *s,
            MicroflakeShape::Grid(grid) => grid.at_index(p_index()),
        }
    }

    /// The factor of extinction along `direction` (world, unit) at a point of the medium's index
    /// space.
    pub fn projected_area(&self, p_index: impl FnOnce() -> DVec3, direction: Vec3) -> f32 {
        self.shape_at(p_index).projected_area(self.to_world.transpose() * direction)
    }

    /// Bound of [`projected_area`](Microflakes::projected_area) over all points: exact where the
    /// distribution is the same everywhere.
    pub fn largest_area(&self, direction: Vec3) -> f32 {
        match &self.shape {
            MicroflakeShape::Constant(s) => s.projected_area(self.to_world.transpose() * direction),
            MicroflakeShape::Grid(grid) => grid.largest_area(),
        }
    }

    /// Bound of [`projected_area`](Microflakes::projected_area) over all points and directions.
    pub fn largest_area_to_any(&self) -> f32 {
        match &self.shape {
            MicroflakeShape::Constant(s) => s.largest_area(),
            MicroflakeShape::Grid(grid) => grid.largest_area(),
        }
    }

    /// The phase function at a point for light that arrives along `incoming`. Diffuse microflakes:
    /// that of one microflake, drawn by what it shows to the ray; the mean over draws is the phase
    /// function, and each of them has an exact density, as any phase function has.
    pub fn at<R: Rng + ?Sized>(
        &self,
        p_index: impl FnOnce() -> DVec3,
        incoming: Vec3,
        rng: &mut R,
    ) -> PhaseAt<'static> {
        let s = self.shape_at(p_index).turned(&self.to_world);
        match self.scattering {
            MicroflakeScattering::Specular => PhaseAt::Microflakes(s),
            MicroflakeScattering::Diffuse => {
                let normal = s.sample_visible(-incoming, [uniform(rng), uniform(rng)]);
                PhaseAt::Microflake { normal }
            }
        }
    }
}

impl fmt::Display for Microflakes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scattering = match self.scattering {
            MicroflakeScattering::Specular => "specular",
            MicroflakeScattering::Diffuse => "diffuse",
        };
        let by = if self.by_grid() { " by grid" } else { "" };
        write!(f, "sggx, {scattering} microflakes{by}")
    }
}

/// The orthogonal matrix nearest to a linear map, by Newton's iteration for the polar decomposition
/// [Higham 1986]; the identity for maps without an inverse.
fn rotation_of(map: DMat3) -> DMat3 {
    let size = libm::cbrt(map.determinant().abs());
    if !(size.is_normal() && map.is_finite()) {
        return DMat3::IDENTITY;
    }
    let mut q = map * (1.0 / size);
    for _ in 0..60 {
        let next = (q + q.transpose().inverse()) * 0.5;
        let change = (next - q).to_cols_array().iter().fold(0.0f64, |a, d| a.max(d.abs()));
        q = next;
        if change < 1e-15 {
            break;
        }
    }
    if q.is_finite() { q } else { DMat3::IDENTITY }
}
