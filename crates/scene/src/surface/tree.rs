//! A tree of boxes that is walked by rays in double precision.
//!
//! The tree itself (CWBVH of the `obvhs` crate: eight children a node, bounds of eight bits) counts
//! in single precision. It is built in units of its own, in which everything lies in [-1, 1], and
//! a ray starts in it where it enters its bounds. So the rounding of single precision is bounded by
//! one constant, whatever the scale, position and distance of what is in the tree, and boxes padded
//! by that constant never lose a primitive that double precision finds.

use glam::{DVec3, UVec2, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::faststack::{FastStack, HeapStack, StackStack};
use obvhs::ray::Ray;
use pileus_math::Bounds3;

use super::split;

/// By how much boxes are padded, in units of the tree. Rounding moves a ray against a box by less
/// than 2^-20: 2^-25 for its origin, 2^-24 of the distance (at most 2 sqrt(3)) for direction and
/// inverse, as much for each of the three operations of the test.
const PAD: f64 = 1.0 / (1u64 << 19) as f64;
/// Distances along a ray inside the tree are counted in this fraction of its unit, so that the
/// smallest distance that `obvhs` tells from zero (1e-4) is far below [`PAD`].
const STEPS: f64 = 4096.0;
/// Smallest component of a unit direction: over the tree's diagonal it moves a ray by far less
/// than [`PAD`].
const SMALLEST: f32 = 1.0 / (1u64 << 30) as f32;
/// Most boxes in a leaf: as many as the format holds.
const LEAF: u32 = 3;
/// Up to so many boxes are visited one after the other: nodes would cost more than they spare. A
/// square over which clouds stand is two triangles in one instance.
const FEW: usize = 4;
/// Depth up to which the walk's stack needs no allocation.
const SHALLOW: usize = 32;

/// A ray in double precision; its direction need not be of unit length, `t` counts in its lengths.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DRay {
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
}

/// A tree of boxes, see the module.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    bvh: CwBvh,
    centre: DVec3,
    /// Units of the tree per unit of its boxes.
    scale: f64,
    /// Half the size of the padded bounds, in units of the tree.
    half: DVec3,
    depth: usize,
}

impl Tree {
    /// A tree over boxes that are finite and below 1e150.
    pub(crate) fn new(boxes: &[Bounds3]) -> Self {
        let bounds = boxes.iter().copied().reduce(Bounds3::union);
        let Bounds3 { low, high } = bounds.unwrap_or(Bounds3::new(DVec3::ZERO, DVec3::ZERO));
        let centre = low + (high - low) * 0.5;
        let largest = (high - low).max_element() * 0.5;
        // A single point has no size to measure by; any will do that does not overflow.
        let scale = if largest > 1e-150 { 1.0 / largest } else { 1.0 };
        let padded: Vec<Aabb> = boxes
            .iter()
            .map(|Bounds3 { low, high }| {
                let corner =
                    |p: DVec3, pad: f64| Vec3A::from(((p - centre) * scale + pad).as_vec3());
                Aabb { min: corner(*low, -PAD), max: corner(*high, PAD) }
            })
            .collect();
        let bvh = bvh2_to_cwbvh(&split::build(&padded), LEAF, true, false);
        let depth = depth(&bvh);
        Self { bvh, centre, scale, half: (high - low) * (0.5 * scale) + 2.0 * PAD, depth }
    }

    /// The boxes' numbers in the order of the tree's leaves: a walk names boxes by their place in
    /// this list.
    pub(crate) fn order(&self) -> &[u32] {
        &self.bvh.primitive_indices
    }

    /// Bytes that the tree takes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.bvh.nodes.as_slice()) + size_of_val(self.bvh.primitive_indices.as_slice())
    }

    /// Calls `visit` with every box (its place in [`Self::order`]) that the ray may meet at a `t`
    /// in [0, `t_max`], near ones roughly first. `visit` gets the present end of the ray and
    /// returns the new one, which may be closer; a negative end stops the walk.
    #[inline]
    pub(crate) fn walk(&self, ray: &DRay, t_max: f64, mut visit: impl FnMut(usize, f64) -> f64) {
        let origin = (ray.origin - self.centre) * self.scale;
        let direction = ray.direction * self.scale;
        let Some(start) = self.entry(origin, direction, t_max) else { return };
        let boxes = self.order().len();
        if boxes <= FEW {
            if !(direction.length() > 0.0) {
                return;
            }
            let mut end = t_max;
            for place in 0..boxes {
                end = end.min(visit(place, end));
                if end < 0.0 {
                    return;
                }
            }
            return;
        }
        if self.depth < SHALLOW {
            let stack = StackStack::<UVec2, SHALLOW>::default();
            self.walk_from(origin, direction, start, t_max, stack, visit);
        } else {
            let stack = HeapStack::new_with_capacity(self.depth + 1);
            self.walk_from(origin, direction, start, t_max, stack, visit);
        }
    }

    /// Where the ray enters the bounds, 0 if it starts within; `None` if it passes by.
    #[inline]
    fn entry(&self, origin: DVec3, direction: DVec3, t_max: f64) -> Option<f64> {
        let (mut start, mut end) = (0.0f64, t_max);
        for axis in 0..3 {
            let (o, d, half) = (origin[axis], direction[axis], self.half[axis]);
            if d == 0.0 {
                if !(o.abs() <= half) {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / d;
            let (a, b) = ((-half - o) * inverse, (half - o) * inverse);
            start = start.max(a.min(b));
            end = end.min(a.max(b));
        }
        (start <= end).then_some(start)
    }

    #[inline]
    fn walk_from<S: FastStack<UVec2>>(
        &self,
        origin: DVec3,
        direction: DVec3,
        start: f64,
        mut t_max: f64,
        stack: S,
        mut visit: impl FnMut(usize, f64) -> f64,
    ) {
        let length = direction.length();
        if self.bvh.nodes.is_empty() || !(length > 0.0) {
            return;
        }
        let unit = (direction / length).as_vec3a();
        let clamped = |c: f32| if c.abs() < SMALLEST { SMALLEST.copysign(c) } else { c };
        let unit = Vec3A::new(clamped(unit.x), clamped(unit.y), clamped(unit.z));
        let steps = length * STEPS;
        // The end is rounded up, by the pad and by more than single precision rounds.
        let end = |t: f64| (((t - start) * steps + PAD * STEPS) * (1.0 + 1e-6)) as f32;
        let mut ray = Ray {
            origin: (origin + direction * start).as_vec3a(),
            direction: unit,
            inv_direction: STEPS as f32 / unit,
            tmin: 0.0,
            tmax: end(t_max),
        };
        let traversal = self.bvh.new_traversal(unit);
        let mut state = State {
            stack,
            current_group: traversal.current_group,
            primitive_group: traversal.primitive_group,
            oct_inv4: traversal.oct_inv4,
            primitive_id: 0,
            hitmask: 0,
        };
        let mut node;
        obvhs::traverse!(self.bvh, node, state, node.intersect_ray(&ray, state.oct_inv4), {
            let closer = visit(state.primitive_id as usize, t_max);
            if closer < t_max {
                t_max = closer;
                if t_max < 0.0 {
                    return;
                }
                ray.tmax = end(t_max);
            }
        });
    }
}

/// What `traverse!` keeps, with a stack of any kind.
struct State<S> {
    stack: S,
    current_group: UVec2,
    primitive_group: UVec2,
    oct_inv4: u32,
    primitive_id: u32,
    hitmask: u32,
}

/// Nodes on the longest way down: a walk's stack holds at most as many.
fn depth(bvh: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut stack = vec![(0u32, 1usize)];
    while let Some((index, depth)) = stack.pop() {
        let Some(node) = bvh.nodes.get(index as usize) else { continue };
        deepest = deepest.max(depth);
        let children = node.imask.count_ones();
        stack.extend((0..children).map(|child| (node.child_base_idx + child, depth + 1)));
    }
    deepest
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    fn uniform(rng: &mut Pcg64Mcg) -> f64 {
        (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(rng: &mut Pcg64Mcg) -> DVec3 {
        DVec3::new(uniform(rng), uniform(rng), uniform(rng))
    }

    /// Boxes that a ray meets, by the definition.
    fn meets(ray: &DRay, Bounds3 { low, high }: Bounds3, t_max: f64) -> bool {
        let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
        let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
        near.max(0.0) <= far.min(t_max)
    }

    /// At every scale and place nothing that is met is missed.
    #[test]
    fn no_box_is_lost() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        for (scale, centre) in [(1.0, 0.0), (1e-9, 1.0), (1e30, 0.0), (3.0, 1e6), (1e-40, 0.0)] {
            let boxes: Vec<Bounds3> = (0..500)
                .map(|_| {
                    let low = centre + point(&mut rng) * scale;
                    Bounds3::new(low, low + point(&mut rng) * (0.3 * scale))
                })
                .collect();
            let tree = Tree::new(&boxes);
            let mut met = 0;
            for _ in 0..300 {
                let origin = centre + (point(&mut rng) - 0.5) * (30.0 * scale);
                let target = centre + point(&mut rng) * scale;
                let ray = DRay { origin, direction: (target - origin) / scale * 0.37 };
                let t_max = scale * 4.0 * uniform(&mut rng);
                let mut seen = vec![false; boxes.len()];
                tree.walk(&ray, t_max, |place, end| {
                    seen[tree.order()[place] as usize] = true;
                    end
                });
                for (i, bounds) in boxes.iter().enumerate() {
                    if meets(&ray, *bounds, t_max) {
                        assert!(seen[i], "scale {scale}, centre {centre}");
                        met += 1;
                    }
                }
            }
            assert!(met > 500, "{met}");
        }
    }

    /// Rays along axes and in planes of boxes, flat boxes, one box, none.
    #[test]
    fn flat_and_empty_trees() {
        let flat = [Bounds3::new(DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, 1.0))];
        let count = |tree: &Tree, origin, direction| {
            let mut n = 0;
            tree.walk(&DRay { origin, direction }, f64::INFINITY, |_, end| {
                n += 1;
                end
            });
            n
        };
        let tree = Tree::new(&flat);
        assert_eq!(count(&tree, DVec3::new(0.3, 5.0, 0.2), DVec3::NEG_Y), 1);
        assert_eq!(count(&tree, DVec3::new(0.3, 5.0, 0.2), DVec3::Y), 0);
        assert_eq!(count(&tree, DVec3::new(0.3, 0.0, 5.0), DVec3::NEG_Z), 1);
        assert_eq!(count(&tree, DVec3::new(1.0, 1.0, 1.0), DVec3::NEG_Y), 1);
        assert_eq!(count(&Tree::new(&[]), DVec3::ZERO, DVec3::X), 0);
        let point = Tree::new(&[Bounds3::new(DVec3::ONE, DVec3::ONE)]);
        assert_eq!(count(&point, DVec3::new(1.0, 1.0, 9.0), DVec3::NEG_Z), 1);
    }

    /// Boxes that no order tells apart, and boxes one inside the other: time and depth stay
    /// bounded.
    #[test]
    fn hostile_sets_are_walked() {
        let n = 50_000;
        let same = vec![Bounds3::new(DVec3::ZERO, DVec3::ONE); n];
        let nested: Vec<_> = (0..n)
            .map(|i| {
                let size = 0.5f64.powf(i as f64 * 0.01);
                Bounds3::new(DVec3::ZERO, DVec3::splat(size))
            })
            .collect();
        let centred: Vec<_> = (1..n)
            .map(|i| Bounds3::new(DVec3::splat(-(i as f64)), DVec3::splat(i as f64)))
            .chain([Bounds3::new(DVec3::ZERO, DVec3::ZERO)])
            .collect();
        for boxes in [same, nested, centred] {
            let tree = Tree::new(&boxes);
            assert!(tree.depth < 80, "{}", tree.depth);
            let mut seen = 0;
            let ray = DRay { origin: DVec3::splat(-1e5), direction: DVec3::ONE };
            tree.walk(&ray, 1e6, |_, end| {
                seen += 1;
                end
            });
            assert_eq!(seen, n, "depth {}", tree.depth);
        }
    }
}
