//! A kd-tree over the grid, split where it saves most null collisions [after Yue et al. 2010].

use super::cost::leaf_cost;
use super::partition::{Cell, NO_BRICK, Partition};
use crate::grid::VoxelGrid;

/// Parts that a node is cut into along each axis to look for the best plane.
const CANDIDATES: usize = 8;

/// Planes lie at multiples of this many voxels: the finest cells whose bounds are kept.
const FINEST: i32 = 4;

/// An inner node or a leaf.
#[derive(Debug, Clone, Copy)]
enum Node {
    /// Voxels below the plane are in node `child`, others in the next one.
    Inner {
        axis: u8,
        plane: i32,
        child: u32,
    },
    Leaf {
        low: [i32; 3],
        high: [i32; 3],
        max: f32,
        min: f32,
    },
}

/// The nodes of a kd-tree.
#[derive(Debug, Clone)]
pub(crate) struct KdNodes(Vec<Node>);

/// A box with its range.
#[derive(Clone, Copy)]
struct Region {
    low: [i32; 3],
    high: [i32; 3],
    min: f32,
    max: f32,
}

impl Region {
    fn cost(&self, per_voxel: f32) -> f32 {
        let size = [0, 1, 2].map(|axis| (self.high[axis] - self.low[axis]) as f32);
        leaf_cost(size, self.max * per_voxel)
    }
}

/// A finished part of the tree.
enum Branch {
    Leaf(Region),
    Inner { axis: usize, plane: i32, below: Box<Branch>, above: Box<Branch> },
}

impl KdNodes {
    /// Builds a tree for raw bounds scaled to majorants per voxel by `per_voxel`. A node is split
    /// at the plane that lowers the cost most, as long as one does.
    pub(crate) fn new(grid: &VoxelGrid, per_voxel: f32) -> KdNodes {
        let (low, high) = ([0; 3], grid.topology.extent);
        let (min, max) = grid.box_range(low, high);
        let root = split(grid, Region { low, high, min, max }, per_voxel);
        let mut nodes = vec![Node::Leaf { low, high, max, min }];
        let mut open = vec![(0usize, root)];
        while let Some((index, branch)) = open.pop() {
            match branch {
                Branch::Leaf(Region { low, high, min, max }) => {
                    nodes[index] = Node::Leaf { low, high, max, min };
                }
                Branch::Inner { axis, plane, below, above } => {
                    let child = nodes.len() as u32;
                    nodes[index] = Node::Inner { axis: axis as u8, plane, child };
                    let blank = Node::Leaf { low: [0; 3], high: [0; 3], max: 0.0, min: 0.0 };
                    nodes.extend([blank; 2]);
                    open.push((child as usize, *below));
                    open.push((child as usize + 1, *above));
                }
            }
        }
        KdNodes(nodes)
    }

    /// Leaves and bytes.
    pub(crate) fn footprint(&self) -> (u64, u64) {
        let leaves = self.0.iter().filter(|n| matches!(n, Node::Leaf { .. })).count();
        (leaves as u64, (self.0.len() * size_of::<Node>()) as u64)
    }
}

fn split(grid: &VoxelGrid, region: Region, per_voxel: f32) -> Branch {
    let whole = region.cost(per_voxel);
    let mut best: Option<(f32, usize, Region, Region)> = None;
    for axis in 0..3 {
        let (low, high) = (region.low[axis], region.high[axis]);
        // Planes at multiples of the finest cell, at most so many.
        let width = ((high - low) / CANDIDATES as i32).max(FINEST) / FINEST * FINEST;
        let mut edges = vec![low];
        let mut plane = (low / FINEST + 1) * FINEST + width - FINEST;
        while plane < high && edges.len() < 2 * CANDIDATES {
            edges.push(plane);
            plane += width;
        }
        edges.push(high);
        if edges.len() < 3 {
            continue;
        }
        let slabs: Vec<(f32, f32)> = edges
            .windows(2)
            .map(|edge| {
                let (mut a, mut b) = (region.low, region.high);
                (a[axis], b[axis]) = (edge[0], edge[1]);
                grid.box_range(a, b)
            })
            .collect();
        let union = |slabs: &[(f32, f32)]| {
            slabs
                .iter()
                .fold((f32::INFINITY, 0.0f32), |(a, b), &(min, max)| (a.min(min), b.max(max)))
        };
        for cut in 1..slabs.len() {
            let part = |low: i32, high: i32, (min, max): (f32, f32)| {
                let mut part = Region { min, max, ..region };
                (part.low[axis], part.high[axis]) = (low, high);
                part
            };
            let below = part(low, edges[cut], union(&slabs[..cut]));
            let above = part(edges[cut], high, union(&slabs[cut..]));
            let cost = below.cost(per_voxel) + above.cost(per_voxel);
            if cost < whole && best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, below, above));
            }
        }
    }
    let Some((_, axis, below, above)) = best else {
        return Branch::Leaf(region);
    };
    let plane = above.low[axis];
    let (below, above) =
        rayon::join(|| split(grid, below, per_voxel), || split(grid, above, per_voxel));
    Branch::Inner { axis, plane, below: Box::new(below), above: Box::new(above) }
}

/// A view of a kd-tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KdTree<'a>(pub(crate) &'a KdNodes);

impl Partition for KdTree<'_> {
    #[inline]
    fn cell(&self, ijk: [i32; 3], _: u32) -> Cell {
        let mut index = 0u32;
        loop {
            match self.0.0[index as usize] {
                Node::Inner { axis, plane, child } => {
                    index = child + u32::from(ijk[axis as usize] >= plane);
                }
                Node::Leaf { low, high, max, .. } => {
                    return Cell { low, high, max, brick: NO_BRICK, key: index };
                }
            }
        }
    }

    fn min(&self, cell: &Cell) -> f32 {
        match self.0.0[cell.key as usize] {
            Node::Leaf { min, .. } => min,
            Node::Inner { .. } => 0.0,
        }
    }
}
