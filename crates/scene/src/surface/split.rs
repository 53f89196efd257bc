//! Builds binary trees of boxes by splitting sets where it pays.
//!
//! The builder of the `obvhs` crate merges neighbours instead. On sets of boxes around a common
//! centre, one inside the other, it takes quadratic time and makes a tree as deep as the set is
//! large, so that a small file could keep it busy for hours; this one's time and depth are bounded.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;

/// Bins of centres along each axis.
const BINS: usize = 16;
/// Depth from which sets are halved without looking, which bounds the depth of the tree.
const DEEP: u32 = 48;

/// A set that waits to be split: its node, its range of the order, its depth.
struct Task {
    node: usize,
    start: usize,
    end: usize,
    depth: u32,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Aabb,
    count: usize,
}

/// A tree with one box a leaf; at most some `DEEP + log2(n)` levels, in O(n log n).
///
/// Sets are split between bins of their centres where the surface area heuristic is least
/// (Wald, "On fast construction of SAH-based bounding volume hierarchies", 2007).
pub(super) fn build(boxes: &[Aabb]) -> Bvh2 {
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes: Vec<Bvh2Node> = Vec::with_capacity((2 * boxes.len()).saturating_sub(1));
    let mut tasks = Vec::new();
    if !boxes.is_empty() {
        nodes.push(Bvh2Node::new(Aabb::empty(), 0, 0));
        tasks.push(Task { node: 0, start: 0, end: boxes.len(), depth: 0 });
    }
    while let Some(Task { node, start, end, depth }) = tasks.pop() {
        let set = &mut order[start..end];
        let bounds = set.iter().fold(Aabb::empty(), |bounds, &i| bounds.union(&boxes[i as usize]));
        if set.len() == 1 {
            nodes[node] = Bvh2Node::new(bounds, 1, start as u32);
            continue;
        }
        let middle = if depth < DEEP { split(boxes, set) } else { None };
        let middle = start + middle.unwrap_or(set.len() / 2);
        let first = nodes.len();
        nodes[node] = Bvh2Node::new(bounds, 0, first as u32);
        nodes.extend([Bvh2Node::new(Aabb::empty(), 0, 0); 2]);
        tasks.push(Task { node: first + 1, start: middle, end, depth: depth + 1 });
        tasks.push(Task { node: first, start, end: middle, depth: depth + 1 });
    }
    Bvh2 { nodes, primitive_indices: order, ..Bvh2::default() }
}

/// Reorders a set of two or more and returns where to split it; `None` if all centres are one.
fn split(boxes: &[Aabb], set: &mut [u32]) -> Option<usize> {
    let centre = |i: u32| boxes[i as usize].center();
    let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    for &i in set.iter() {
        low = low.min(centre(i));
        high = high.max(centre(i));
    }
    let extent = high - low;
    // Bins per unit of length; an axis without extent is not looked at.
    let scale = Vec3A::splat(BINS as f32 * 0.9999) / extent;
    let bin_of = |i: u32, axis: usize| {
        (((centre(i)[axis] - low[axis]) * scale[axis]) as usize).min(BINS - 1)
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in 0..3 {
        if !(extent[axis] > 0.0 && scale[axis].is_finite()) {
            continue;
        }
        let mut bins = [Bin { bounds: Aabb::empty(), count: 0 }; BINS];
        for &i in set.iter() {
            let bin = &mut bins[bin_of(i, axis)];
            bin.bounds = bin.bounds.union(&boxes[i as usize]);
            bin.count += 1;
        }
        // Costs of what is above each place, then of what is below.
        let mut above = [0.0f32; BINS];
        let (mut bounds, mut count) = (Aabb::empty(), 0usize);
        for place in (1..BINS).rev() {
            bounds = bounds.union(&bins[place].bounds);
            count += bins[place].count;
            above[place] = if count == 0 { 0.0 } else { bounds.half_area() * count as f32 };
        }
        let (mut bounds, mut count) = (Aabb::empty(), 0usize);
        for place in 1..BINS {
            bounds = bounds.union(&bins[place - 1].bounds);
            count += bins[place - 1].count;
            if count == 0 || count == set.len() {
                continue;
            }
            let cost = bounds.half_area() * count as f32 + above[place];
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, place));
            }
        }
    }
    let (_, axis, place) = best?;
    // Stable in its outcome: the same for the same boxes.
    let mut middle = 0;
    for at in 0..set.len() {
        if bin_of(set[at], axis) < place {
            set.swap(at, middle);
            middle += 1;
        }
    }
    (middle > 0 && middle < set.len()).then_some(middle)
}
