//! Many lights as one: a tree over emissive triangles or over point and spot lights, descended by
//! what each side may contribute [after Conty Estevez and Kulla 2018, "Importance sampling of many
//! lights with adaptive tree splitting"].

use glam::{DVec3, Vec3};
use libm::{acosf, cosf, sinf};

/// What the tree knows of a triangle or of a point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TreeLight {
    /// Corners; of a point, three times itself.
    pub(crate) p: [DVec3; 3],
    /// Unit normal of the side that emits, or the axis of a spot.
    pub(crate) axis: Vec3,
    /// Cosine of the angle to the axis up to which light is sent: 0 for triangles, -1 in all
    /// directions.
    pub(crate) cos_emission: f32,
    /// The irradiance times distance squared that it gives on its axis, in luminance: radiance
    /// times area, or intensity.
    pub(crate) strength: f32,
    /// Whether both sides emit.
    pub(crate) two_sided: bool,
}

/// Boxes, strengths and directions of a set of lights.
#[derive(Debug, Clone, Copy)]
struct Bound {
    low: DVec3,
    high: DVec3,
    strength: f32,
    /// Cone of the axes: its own and the cosine of its half angle; -1: any direction.
    axis: Vec3,
    cos: f32,
    /// Smallest cosine to its own axis at which any of the set sends light.
    cos_emission: f32,
    two_sided: bool,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    bound: Bound,
    /// First child (the second follows), or the light with the high bit set.
    child: u32,
    parent: u32,
}

const LEAF: u32 = 1 << 31;

/// A tree over lights.
#[derive(Debug, Clone, Default)]
pub(crate) struct LightTree {
    nodes: Vec<Node>,
    /// Node of each light.
    leaf: Vec<u32>,
}

impl Bound {
    fn of(light: &TreeLight) -> Bound {
        let [a, b, c] = light.p;
        Bound {
            low: a.min(b).min(c),
            high: a.max(b).max(c),
            strength: light.strength,
            axis: light.axis,
            cos: 1.0,
            cos_emission: light.cos_emission,
            two_sided: light.two_sided,
        }
    }

    fn join(a: &Bound, b: &Bound) -> Bound {
        let (axis, cos) = join_cones((a.axis, a.cos), (b.axis, b.cos));
        Bound {
            low: a.low.min(b.low),
            high: a.high.max(b.high),
            strength: a.strength + b.strength,
            axis,
            cos,
            cos_emission: a.cos_emission.min(b.cos_emission),
            two_sided: a.two_sided || b.two_sided,
        }
    }

    fn centre(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// Bound-like estimate of what arrives at `p`: strength over distance squared, times the
    /// largest cosine at the lights. Not zero unless nothing of the set sends light towards `p`.
    fn estimate(&self, p: DVec3) -> f32 {
        let half = 0.5 * (self.high - self.low);
        let radius2 = half.length_squared();
        let to = p - self.centre();
        let distance2 = to.length_squared();
        // Inside its own sphere a set is as near as its size.
        let received = (f64::from(self.strength) / distance2.max(radius2).max(1e-30)) as f32;
        if distance2 <= radius2 || self.cos <= -1.0 || self.cos_emission <= -1.0 {
            return received;
        }
        let distance = distance2.sqrt();
        let cos_axis = self.axis.dot((to / distance).as_vec3()).clamp(-1.0, 1.0);
        let cos_axis = if self.two_sided { cos_axis.abs() } else { cos_axis };
        // Angle to the axis, less the cone's half angle, less that under which the set is seen.
        // Cosines alone: no function of a system's library.
        let sin2_seen = (radius2 / distance2) as f32;
        let to_axis = Angle::of(cos_axis);
        let seen = Angle { cos: (1.0 - sin2_seen).max(0.0).sqrt(), sin: sin2_seen.sqrt() };
        let cos = to_axis.less(Angle::of(self.cos.min(1.0))).less(seen).cos;
        // Wider and not below a floor, for rounding: what just faces away may be chosen, and then
        // brings nothing.
        if cos > self.cos_emission - 1e-4 { received * cos.max(1e-3) } else { 0.0 }
    }
}

/// An angle between 0 and a half turn.
#[derive(Debug, Clone, Copy)]
struct Angle {
    cos: f32,
    sin: f32,
}

impl Angle {
    fn of(cos: f32) -> Angle {
        Angle { cos, sin: (1.0 - cos * cos).max(0.0).sqrt() }
    }

    /// The difference, not below zero.
    fn less(self, other: Angle) -> Angle {
        if self.cos > other.cos {
            return Angle { cos: 1.0, sin: 0.0 };
        }
        Angle {
            cos: self.cos * other.cos + self.sin * other.sin,
            sin: self.sin * other.cos - self.cos * other.sin,
        }
    }
}

/// The smallest cone (axis, cosine of its half angle) around two.
fn join_cones((a, cos_a): (Vec3, f32), (b, cos_b): (Vec3, f32)) -> (Vec3, f32) {
    if cos_a <= -1.0 || cos_b <= -1.0 {
        return (a, -1.0);
    }
    let (angle_a, angle_b) = (acosf(cos_a.min(1.0)), acosf(cos_b.min(1.0)));
    let between = acosf(a.dot(b).clamp(-1.0, 1.0));
    if between + angle_b <= angle_a {
        return (a, cos_a);
    }
    if between + angle_a <= angle_b {
        return (b, cos_b);
    }
    let half = 0.5 * (angle_a + between + angle_b);
    if half >= std::f32::consts::PI || between > 3.1 {
        return (a, -1.0);
    }
    // From `a` towards `b`.
    let away = (b - a * a.dot(b)).normalize_or_zero();
    let turn = half - angle_a;
    // Wider by a little, for the rounding of angles.
    (a * cosf(turn) + away * sinf(turn), cosf(half + 1e-3))
}

impl LightTree {
    /// Builds a tree by splitting at the middle of the widest axis; sets whose normals differ most
    /// are not treated apart: emissive are flat or small.
    pub(crate) fn new(lights: &[TreeLight]) -> LightTree {
        let mut tree = LightTree { nodes: Vec::new(), leaf: vec![u32::MAX; lights.len()] };
        let mut order: Vec<u32> =
            (0..lights.len() as u32).filter(|&i| lights[i as usize].strength > 0.0).collect();
        if order.is_empty() {
            return tree;
        }
        let blank = Node { bound: Bound::of(&lights[order[0] as usize]), child: 0, parent: 0 };
        tree.nodes.push(blank);
        let mut open = vec![(0usize, 0usize, order.len())];
        while let Some((node, from, to)) = open.pop() {
            let bound = order[from..to]
                .iter()
                .map(|&i| Bound::of(&lights[i as usize]))
                .reduce(|a, b| Bound::join(&a, &b));
            let Some(bound) = bound else { continue };
            tree.nodes[node].bound = bound;
            if to - from == 1 {
                let light = order[from];
                tree.nodes[node].child = LEAF | light;
                tree.leaf[light as usize] = node as u32;
                continue;
            }
            let size = bound.high - bound.low;
            let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
            let key = |i: u32| {
                let [a, b, c] = lights[i as usize].p;
                a[axis] + b[axis] + c[axis]
            };
            let middle = (to - from) / 2;
            order[from..to]
                .select_nth_unstable_by(middle, |&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
            let child = tree.nodes.len();
            tree.nodes[node].child = child as u32;
            let blank = Node { parent: node as u32, ..blank };
            tree.nodes.extend([blank; 2]);
            open.push((child, from, from + middle));
            open.push((child + 1, from + middle, to));
        }
        tree
    }

    /// Whether nothing in it gives light.
    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// What all lights together may give at `p`: irradiance, roughly.
    pub(crate) fn estimate(&self, p: DVec3) -> f32 {
        self.nodes.first().map_or(0.0, |root| root.bound.estimate(p))
    }

    /// Draws a light for a vertex at `p`, with its probability; `None` if none faces it.
    pub(crate) fn choose(&self, p: DVec3, mut u: f32) -> Option<(u32, f32)> {
        let mut node = self.nodes.first()?;
        let mut probability = 1.0;
        while node.child & LEAF == 0 {
            let [a, b] = [0, 1].map(|k| &self.nodes[node.child as usize + k]);
            let share = share(&a.bound, &b.bound, p)?;
            if u < share {
                (node, probability, u) = (a, probability * share, u / share);
            } else {
                let rest = 1.0 - share;
                (node, probability, u) = (b, probability * rest, (u - share) / rest);
            }
            u = u.min(1.0 - f32::EPSILON);
        }
        Some((node.child & !LEAF, probability))
    }

    /// Probability with which [`LightTree::choose`] draws `light` for a vertex at `p`.
    pub(crate) fn probability(&self, light: u32, p: DVec3) -> f32 {
        let Some(&leaf) = self.leaf.get(light as usize).filter(|&&leaf| leaf != u32::MAX) else {
            return 0.0;
        };
        let mut probability = 1.0;
        let mut at = leaf;
        while at != 0 {
            let parent = self.nodes[at as usize].parent;
            let first = self.nodes[parent as usize].child;
            let [a, b] = [0, 1].map(|k| &self.nodes[(first + k) as usize]);
            let Some(share) = share(&a.bound, &b.bound, p) else { return 0.0 };
            probability *= if at == first { share } else { 1.0 - share };
            at = parent;
        }
        probability
    }
}

/// Share of the first of two sets; `None` if neither faces `p`.
fn share(a: &Bound, b: &Bound, p: DVec3) -> Option<f32> {
    let (a, b) = (a.estimate(p), b.estimate(p));
    let sum = a + b;
    (sum > 0.0).then(|| a / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pileus_media::random::uniform;
    use rand_pcg::Pcg32;

    fn triangles(n: usize, rng: &mut Pcg32) -> Vec<TreeLight> {
        let u = |rng: &mut Pcg32| f64::from(uniform(rng)) - 0.5;
        (0..n)
            .map(|i| {
                let mut v = || DVec3::new(u(rng), u(rng), u(rng));
                let (a, b, c) = (10.0 * v(), 0.5 * v(), 0.5 * v());
                let cross = b.cross(c);
                TreeLight {
                    p: [a, a + b, a + c],
                    axis: cross.normalize().as_vec3(),
                    cos_emission: 0.0,
                    strength: (0.5 * cross.length()) as f32 * if i % 7 == 0 { 50.0 } else { 1.0 },
                    two_sided: i % 3 == 0,
                }
            })
            .collect()
    }

    /// Probabilities of all lights sum to one or less (what faces away is lost), they are what
    /// `choose` draws with (z-test per light, |z| < 6 on 3 x 60 lights: false alarm 4e-7), and
    /// every light that faces the point has one.
    #[test]
    fn choices_follow_their_probabilities() {
        let mut rng = Pcg32::new(1, 1);
        let lights = triangles(60, &mut rng);
        let tree = LightTree::new(&lights);
        for p in [DVec3::ZERO, DVec3::new(20.0, 1.0, -3.0), DVec3::new(0.0, 3.0, 1.0)] {
            let n = 400_000;
            let mut counts = vec![0u32; lights.len()];
            let mut none = 0;
            for _ in 0..n {
                match tree.choose(p, uniform(&mut rng)) {
                    Some((light, probability)) => {
                        counts[light as usize] += 1;
                        let again = tree.probability(light, p);
                        assert!((again - probability).abs() <= 1e-5 * again);
                    }
                    None => none += 1,
                }
            }
            let mut sum = f64::from(none) / f64::from(n);
            for (i, light) in lights.iter().enumerate() {
                let q = f64::from(tree.probability(i as u32, p));
                sum += q;
                let deviation = (f64::from(n) * q * (1.0 - q)).sqrt().max(1.0);
                let z = (f64::from(counts[i]) - f64::from(n) * q) / deviation;
                assert!(z.abs() < 6.0, "{i}: {z}");
                let facing = light.p.iter().any(|corner| {
                    let cos = light.axis.dot((p - *corner).normalize().as_vec3());
                    cos > 1e-3 || light.two_sided
                });
                assert!(!facing || q > 0.0, "light {i} faces {p} and is never drawn");
            }
            assert!((sum - 1.0).abs() < 0.02, "{sum}");
        }
    }

    /// Points that shine everywhere have a probability everywhere, spots where they shine.
    #[test]
    fn whatever_shines_on_a_point_may_be_drawn() {
        let mut rng = Pcg32::new(4, 4);
        let mut lights = triangles(40, &mut rng);
        for (i, light) in lights.iter_mut().enumerate() {
            light.p = [light.p[0]; 3];
            light.two_sided = false;
            light.cos_emission = [-1.0, 0.9, 0.2, -0.5][i % 4];
        }
        let tree = LightTree::new(&lights);
        for _ in 0..200 {
            let mut v = || 16.0 * (f64::from(uniform(&mut rng)) - 0.5);
            let p = DVec3::new(v(), v(), v());
            let mut sum = 0.0;
            for (i, light) in lights.iter().enumerate() {
                let q = tree.probability(i as u32, p);
                sum += q;
                let cos = light.axis.dot((p - light.p[0]).normalize().as_vec3());
                assert!(cos < light.cos_emission || q > 0.0, "light {i} shines on {p}");
            }
            assert!(sum < 1.0 + 1e-4);
        }
    }

    #[test]
    fn trees_of_none_and_of_one() {
        assert!(LightTree::new(&[]).choose(DVec3::ZERO, 0.5).is_none());
        let mut one = triangles(1, &mut Pcg32::new(2, 2));
        one[0].two_sided = true;
        let tree = LightTree::new(&one);
        assert_eq!(tree.choose(DVec3::splat(9.0), 0.99), Some((0, 1.0)));
        assert_eq!(tree.probability(0, DVec3::splat(9.0)), 1.0);
        assert!(tree.estimate(DVec3::splat(9.0)) > 0.0);
        one[0].strength = 0.0;
        assert!(LightTree::new(&one).choose(DVec3::ZERO, 0.5).is_none());
    }
}
