//! What a partition costs: the model that structures are chosen and built by.
//!
//! Isotropic uniform lines cross a body of surface `S` and volume `V` in number proportional to
//! `S`, with a total chord in proportion to `4 V` (Cauchy's mean chord `4 V / S`). A leaf of a
//! partition costs a step per line that crosses it and a tentative collision per unit of majorant
//! depth: `STEP_COST S + 4 COLLISION_COST majorant V`. The model compares a split with a leaf
//! exactly, whatever the rest of the partition does [after Yue et al. 2010, 2011].

/// Nanoseconds of a step from cell to cell. Measured (`docs/charts/majorants.md`); only the ratio
/// of the two matters. They are constants of the program and not measured where it runs: the image
/// depends on the cells, and must be the same on every machine.
pub(crate) const STEP_COST: f32 = 50.0;

/// Nanoseconds of a tentative collision: an exponential variate, a lookup, a decision.
pub(crate) const COLLISION_COST: f32 = 50.0;

/// Expected cost of a structure on given rays.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StructureCost {
    /// Steps from cell to cell.
    pub steps: f64,
    /// Tentative collisions: the majorants' optical depth.
    pub collisions: f64,
}

impl StructureCost {
    /// The cost in nanoseconds, at 50 for a step and 50 for a collision: constants of the program,
    /// not measured where it runs.
    pub fn nanoseconds(&self) -> f64 {
        self.steps * f64::from(STEP_COST) + self.collisions * f64::from(COLLISION_COST)
    }
}

/// Cost of a leaf of `size` voxels per axis under a majorant per voxel, in units that only compare.
pub(crate) fn leaf_cost(size: [f32; 3], majorant: f32) -> f32 {
    let [x, y, z] = size;
    let surface = 2.0 * (x * y + y * z + z * x);
    STEP_COST * surface + 4.0 * COLLISION_COST * majorant * x * y * z
}
