//! The majorant structures by name, and any of them behind one type.

use super::adaptive::Adaptive;
use super::hierarchy::Hierarchy;
use super::kd_tree::{KdNodes, KdTree};
use super::partition::{Cell, Partition};
use super::uniform::{Uniform, UniformCells};
use crate::Error;
use crate::grid::VoxelGrid;
use std::time::Instant;

/// How a grid is parted for its majorants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MajorantStructure {
    /// Cells of 4, 8, 16, ... voxels, merged bottom-up by the cost model: part of every grid, built
    /// once for all looks.
    #[default]
    Adaptive,
    /// Cells of 4, 8, 16, ... voxels, each level chosen by the walk: the largest in which at most
    /// one tentative collision is expected.
    Hierarchy,
    /// A kd-tree, split by the cost model.
    KdTree,
    /// Equal cells of this many voxels per edge.
    Uniform(u32),
    /// One bound for everything.
    Global,
}

impl MajorantStructure {
    /// Name of the structure, as options and charts have it.
    pub fn name(self) -> String {
        match self {
            MajorantStructure::Hierarchy => "hierarchy".into(),
            MajorantStructure::Adaptive => "adaptive".into(),
            MajorantStructure::KdTree => "kd_tree".into(),
            MajorantStructure::Uniform(size) => format!("uniform_{size}"),
            MajorantStructure::Global => "global".into(),
        }
    }

    /// The structure of a name.
    pub fn from_name(name: &str) -> Option<MajorantStructure> {
        Some(match name {
            "hierarchy" => MajorantStructure::Hierarchy,
            "adaptive" => MajorantStructure::Adaptive,
            "kd_tree" => MajorantStructure::KdTree,
            "global" => MajorantStructure::Global,
            _ => {
                let size = name.strip_prefix("uniform_")?.parse().ok()?;
                (size > 0).then_some(MajorantStructure::Uniform(size))?
            }
        })
    }
}

/// The majorants of a grid, built.
#[derive(Debug, Clone)]
pub struct Majorants {
    structure: MajorantStructure,
    cells: Cells,
    seconds: f64,
}

#[derive(Debug, Clone)]
enum Cells {
    Adaptive,
    Hierarchy,
    KdTree(KdNodes),
    Uniform(UniformCells),
}

impl Majorants {
    /// What every grid has.
    pub(crate) const ADAPTIVE: Majorants =
        Majorants { structure: MajorantStructure::Adaptive, cells: Cells::Adaptive, seconds: 0.0 };

    /// Builds a structure for raw bounds scaled to majorants per voxel by `per_voxel`.
    ///
    /// # Errors
    /// If it would take too many cells.
    pub(crate) fn new(
        grid: &VoxelGrid,
        structure: MajorantStructure,
        per_voxel: f32,
    ) -> Result<Majorants, Error> {
        let start = Instant::now();
        let cells = match structure {
            MajorantStructure::Hierarchy => Cells::Hierarchy,
            MajorantStructure::Adaptive => Cells::Adaptive,
            MajorantStructure::KdTree => Cells::KdTree(KdNodes::new(grid, per_voxel)),
            MajorantStructure::Uniform(size) => Cells::Uniform(UniformCells::new(grid, size)?),
            MajorantStructure::Global => Cells::Uniform(UniformCells::new(grid, u32::MAX)?),
        };
        Ok(Majorants { structure, cells, seconds: start.elapsed().as_secs_f64() })
    }

    /// The structure that they are built as.
    pub fn structure(&self) -> MajorantStructure {
        self.structure
    }

    /// Number of cells of the structure, and bytes that it takes beyond what every grid has.
    pub fn footprint(&self) -> (u64, u64) {
        match &self.cells {
            Cells::Adaptive | Cells::Hierarchy => (0, 0),
            Cells::KdTree(nodes) => nodes.footprint(),
            Cells::Uniform(cells) => cells.footprint(),
        }
    }

    /// Seconds that building took.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// Whether it is what every medium has by default.
    pub(crate) fn is_adaptive(&self) -> bool {
        matches!(self.cells, Cells::Adaptive)
    }

    /// The partition, whichever it is.
    #[inline]
    pub(crate) fn partition<'a>(&'a self, grid: &'a VoxelGrid, per_voxel: f32) -> AnyPartition<'a> {
        match &self.cells {
            Cells::Hierarchy => AnyPartition::Hierarchy(Hierarchy::new(grid, per_voxel)),
            Cells::Adaptive => AnyPartition::Adaptive(Adaptive::new(grid, per_voxel)),
            Cells::KdTree(nodes) => AnyPartition::KdTree(KdTree(nodes)),
            Cells::Uniform(cells) => AnyPartition::Uniform(Uniform(cells)),
        }
    }
}

/// Any partition: a branch per step, for code that is not compiled for each.
#[derive(Debug, Clone, Copy)]
pub(crate) enum AnyPartition<'a> {
    /// The merged hierarchy.
    Adaptive(Adaptive<'a>),
    /// Levels chosen by the walk.
    Hierarchy(Hierarchy<'a>),
    /// A kd-tree.
    KdTree(KdTree<'a>),
    /// Equal cells.
    Uniform(Uniform<'a>),
}

impl Partition for AnyPartition<'_> {
    #[inline]
    fn cell(&self, ijk: [i32; 3], last: u32) -> Cell {
        match self {
            AnyPartition::Hierarchy(cells) => cells.cell(ijk, last),
            AnyPartition::Adaptive(cells) => cells.cell(ijk, last),
            AnyPartition::KdTree(cells) => cells.cell(ijk, last),
            AnyPartition::Uniform(cells) => cells.cell(ijk, last),
        }
    }

    fn min(&self, cell: &Cell) -> f32 {
        match self {
            AnyPartition::Hierarchy(cells) => cells.min(cell),
            AnyPartition::Adaptive(cells) => cells.min(cell),
            AnyPartition::KdTree(cells) => cells.min(cell),
            AnyPartition::Uniform(cells) => cells.min(cell),
        }
    }
}
