//! Shells: the connected parts of a mesh, which of them bound a body, and which way they face.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::triangle::ShearedRay;

/// How much of a body a shell bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Closure {
    /// A body: no edge is open.
    Closed,
    /// A body but for holes that are small against the shell.
    Holed,
    /// Closed, but nothing is inside: two sheets on each other.
    Flat,
    /// A sheet.
    Open,
}

/// A connected part of a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Shell {
    pub(crate) closure: Closure,
    /// Triangles.
    pub(crate) triangles: u32,
    /// Triangles that have to be turned round for all fronts to be outside.
    pub(crate) turned: u32,
    area: f64,
    /// Signed: positive where fronts are outside.
    volume: f64,
    low: DVec3,
    high: DVec3,
}

/// A mesh taken apart. Triangles belong together that share an edge, vertices at equal places
/// taken for one; sheets that hang on a closed shell by an edge are shells of their own.
#[derive(Debug)]
pub(crate) struct Shells {
    shells: Vec<Shell>,
    /// Of each triangle its shell; [`NONE`] for those with fewer than three places.
    of: Vec<u32>,
    turned: Vec<bool>,
}

/// No shell.
const NONE: u32 = u32::MAX;
/// Area that open edges could enclose, over the shell's own, up to which it has holes and is not
/// open.
const HOLES: f64 = 0.01;
/// Most tests of rays against triangles for whether a shell is the wall of a cavity.
const MAX_TESTS: usize = 1 << 28;

impl Shells {
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let edges = Edges::new(triangles);
        let kept = edges.peeled();
        let mut forest = Forest::new(triangles.len());
        // Of closed shells: edges at which triangles meet that do not bound anything together, and
        // those that have no sides.
        let (mut odd, mut one_sided, mut open) = (Vec::new(), Vec::new(), Vec::new());
        let mut around: Vec<(u32, bool)> = Vec::new();
        for edge in edges.groups() {
            around.clear();
            let mut sheet: Option<u32> = None;
            for &(_, used) in edge {
                let triangle = used >> 1;
                if kept[triangle as usize] {
                    around.push((triangle, used & 1 == 1));
                } else if let Some(first) = sheet {
                    forest.join(first, triangle, false);
                } else {
                    sheet = Some(triangle);
                }
            }
            if let [(key, used)] = edge {
                open.push((used >> 1, edges.length(*key)));
            }
            match around.as_slice() {
                [] => {}
                // Neighbours run along their edge in opposite directions.
                &[(a, along), (b, other)] => {
                    if !forest.join(a, b, along == other) {
                        one_sided.push(a);
                    }
                }
                // Where more meet, the file is believed.
                all => match edges.wedges(triangles, edge[0].0, all) {
                    Some(pairs) => pairs.into_iter().for_each(|(a, b)| {
                        forest.join(a, b, false);
                    }),
                    None => {
                        odd.push(all[0].0);
                        all.windows(2).for_each(|pair| {
                            forest.join(pair[0].0, pair[1].0, false);
                        });
                    }
                },
            }
        }
        let mut found = Self { shells: Vec::new(), of: Vec::new(), turned: Vec::new() };
        let mut facts = found.sum_up(triangles, &edges, &kept, &mut forest);
        for (triangle, length) in open {
            facts[found.of[triangle as usize] as usize].border += length;
        }
        for triangle in odd {
            facts[found.of[triangle as usize] as usize].closed = false;
        }
        for triangle in one_sided {
            facts[found.of[triangle as usize] as usize].one_sided = true;
        }
        found.judge(&facts);
        found.turn(triangles, &facts);
        found
    }

    /// Gives every tree of the forest a number, and measures it.
    fn sum_up(
        &mut self,
        triangles: &[[Vec3; 3]],
        edges: &Edges,
        kept: &[bool],
        forest: &mut Forest,
    ) -> Vec<Facts> {
        let mut facts: Vec<Facts> = Vec::new();
        let mut numbers = vec![NONE; triangles.len()];
        self.of = vec![NONE; triangles.len()];
        self.turned = vec![false; triangles.len()];
        for (i, corners) in triangles.iter().enumerate() {
            if !edges.counts(i) {
                continue;
            }
            let (root, turned) = forest.find(i as u32);
            let [a, b, c] = corners.map(|p| p.as_dvec3());
            let number = &mut numbers[root as usize];
            if *number == NONE {
                *number = self.shells.len() as u32;
                facts.push(Facts { from: a, closed: kept[i], ..Facts::default() });
                self.shells.push(Shell {
                    closure: Closure::Open,
                    triangles: 0,
                    turned: 0,
                    area: 0.0,
                    volume: 0.0,
                    low: a,
                    high: a,
                });
            }
            self.of[i] = *number;
            self.turned[i] = turned;
            let (shell, fact) = (&mut self.shells[*number as usize], &mut facts[*number as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            let volume = (a - fact.from).dot((b - fact.from).cross(c - fact.from)) / 6.0;
            shell.triangles += 1;
            shell.area += area;
            shell.volume += if turned { -volume } else { volume };
            shell.low = shell.low.min(a).min(b).min(c);
            shell.high = shell.high.max(a).max(b).max(c);
            if turned {
                fact.turned_area += area;
            }
        }
        facts
    }

    fn judge(&mut self, facts: &[Facts]) {
        for (shell, facts) in self.shells.iter_mut().zip(facts) {
            let border = facts.border * facts.border / (4.0 * std::f64::consts::PI);
            // Single precision moves walls by that much.
            let rounding = shell.low.abs().max(shell.high.abs()).max_element() * 2f64.powi(-23);
            shell.closure = match facts.closed {
                true if shell.volume.abs() <= shell.area * rounding => Closure::Flat,
                true => Closure::Closed,
                false
                    if facts.border > 0.0
                        && border <= HOLES * shell.area
                        && shell.volume.abs() > shell.area * rounding =>
                {
                    Closure::Holed
                }
                false => Closure::Open,
            };
        }
    }

    /// Finds the triangles whose fronts are inside of a body. Walls of cavities face into the
    /// cavity: that is outside.
    fn turn(&mut self, triangles: &[[Vec3; 3]], facts: &[Facts]) {
        let bounds_body = |shell: &Shell| matches!(shell.closure, Closure::Closed | Closure::Holed);
        // Relative to each other fronts are right now; as most of a shell has it in the file is
        // taken for meant.
        let mut flips = vec![false; self.shells.len()];
        for ((shell, facts), flip) in self.shells.iter_mut().zip(facts).zip(&mut flips) {
            *flip = facts.turned_area > 0.5 * shell.area;
            if *flip {
                shell.volume = -shell.volume;
            }
        }
        let mut tests = 0usize;
        // Large ones first: what is around is known before what is inside.
        let mut order: Vec<usize> = (0..self.shells.len()).collect();
        order.sort_by(|a, b| self.shells[*b].area.total_cmp(&self.shells[*a].area));
        for number in order {
            let shell = &self.shells[number];
            if !bounds_body(shell) || shell.volume > 0.0 {
                continue;
            }
            let around: Vec<bool> = self
                .shells
                .iter()
                .map(|outer| {
                    bounds_body(outer)
                        && outer.volume > 0.0
                        && outer.low.cmple(shell.low).all()
                        && outer.high.cmpge(shell.high).all()
                })
                .collect();
            tests = tests.saturating_add(self.shells.len());
            let cavity = around.contains(&true) && {
                tests = tests.saturating_add(3 * triangles.len());
                tests > MAX_TESTS || self.is_within(triangles, number, &around, &flips)
            };
            if !cavity {
                flips[number] = !flips[number];
                self.shells[number].volume = -shell.volume;
            }
            if tests > MAX_TESTS {
                // The file has thousands of shells that are inside out: the rest is believed.
                break;
            }
        }
        for (triangle, number) in self.of.iter().enumerate() {
            let Some(shell) = self.shells.get_mut(*number as usize) else { continue };
            let turned = &mut self.turned[triangle];
            *turned = bounds_body(shell)
                && !facts[*number as usize].one_sided
                && (*turned ^ flips[*number as usize]);
            shell.turned += u32::from(*turned);
        }
    }

    /// Whether a shell lies inside the bodies `around`: a ray from it leaves more of them than it
    /// enters, by the majority of three.
    fn is_within(
        &self,
        triangles: &[[Vec3; 3]],
        number: usize,
        around: &[bool],
        flips: &[bool],
    ) -> bool {
        let Some(first) = self.of.iter().position(|&of| of as usize == number) else {
            return false;
        };
        let [a, b, c] = triangles[first].map(|p| p.as_dvec3());
        let from = (a + b + c) / 3.0;
        let directions = [
            DVec3::new(0.36, 0.48, 0.8),
            DVec3::new(-0.8, 0.36, -0.48),
            DVec3::new(0.48, -0.8, 0.36),
        ];
        let inside = directions.map(|direction| {
            let ray = ShearedRay::new(from, direction);
            let mut left = 0i64;
            for (i, corners) in triangles.iter().enumerate() {
                let of = self.of[i] as usize;
                if !around.get(of).is_some_and(|around| *around) {
                    continue;
                }
                if let Some(hit) = ray.intersect(corners, f64::INFINITY) {
                    let front = hit.front_face ^ self.turned[i] ^ flips[of];
                    left += if front { -1 } else { 1 };
                }
            }
            left > 0
        });
        inside.into_iter().filter(|inside| *inside).count() >= 2
    }

    /// The shell that a triangle belongs to; `None` if it has fewer than three places.
    pub(crate) fn shell(&self, triangle: usize) -> Option<&Shell> {
        self.shells.get(*self.of.get(triangle)? as usize)
    }

    /// The number of its shell.
    pub(crate) fn number(&self, triangle: usize) -> u32 {
        self.of.get(triangle).copied().unwrap_or(NONE)
    }

    /// Whether the front of a triangle is inside of the body that its shell bounds.
    pub(crate) fn is_turned(&self, triangle: usize) -> bool {
        self.turned.get(triangle).is_some_and(|turned| *turned)
    }

    /// Whether all shells are closed.
    pub(crate) fn are_closed(&self) -> bool {
        let closed = |shell: &Shell| matches!(shell.closure, Closure::Closed | Closure::Flat);
        !self.shells.is_empty() && self.shells.iter().all(closed)
    }
}

/// What is known of a shell beside what is kept.
#[derive(Debug, Clone, Copy, Default)]
struct Facts {
    /// Where volumes are measured from.
    from: DVec3,
    /// Whether no edge is open.
    closed: bool,
    /// Whether its triangles cannot be turned so that neighbours agree.
    one_sided: bool,
    /// Area of the triangles that face the other way than the first.
    turned_area: f64,
    /// Length of open edges.
    border: f64,
}

/// Edges of triangles.
struct Edges {
    /// Lower and higher vertex of an edge; twice the triangle's number, one more if it runs
    /// upwards.
    uses: Vec<(u64, u32)>,
    /// Of each triangle its edges' numbers in order of `uses`; [`NONE`] for those that are nothing.
    of: Vec<[u32; 3]>,
    places: Vec<Vec3>,
}

impl Edges {
    fn new(triangles: &[[Vec3; 3]]) -> Self {
        let mut vertices: HashMap<[u32; 3], u32> = HashMap::new();
        let mut places = Vec::new();
        let mut uses = Vec::with_capacity(3 * triangles.len());
        for (triangle, corners) in triangles.iter().enumerate() {
            let [a, b, c] = corners.map(|p| {
                // Adding 0 makes the two zeros one.
                *vertices.entry(p.to_array().map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                    places.push(p);
                    places.len() as u32 - 1
                })
            });
            if a == b || b == c || c == a {
                continue;
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let key = u64::from(from.min(to)) << 32 | u64::from(from.max(to));
                uses.push((key, (triangle as u32) << 1 | u32::from(from < to)));
            }
        }
        uses.sort_unstable();
        let mut of = vec![[NONE; 3]; triangles.len()];
        for (edge, group) in uses.chunk_by(|a, b| a.0 == b.0).enumerate() {
            for &(_, used) in group {
                let slots = &mut of[(used >> 1) as usize];
                if let Some(slot) = slots.iter_mut().find(|slot| **slot == NONE) {
                    *slot = edge as u32;
                }
            }
        }
        Self { uses, of, places }
    }

    /// All uses of each edge.
    fn groups(&self) -> impl Iterator<Item = &[(u64, u32)]> {
        self.uses.chunk_by(|a, b| a.0 == b.0)
    }

    fn counts(&self, triangle: usize) -> bool {
        self.of[triangle][0] != NONE
    }

    fn length(&self, key: u64) -> f64 {
        let [a, b] = [key >> 32, key & 0xffff_ffff].map(|v| self.places[v as usize].as_dvec3());
        (b - a).length()
    }

    /// Pairs of the triangles around an edge between which a body lies, seen along the edge: the
    /// shells that touch there. `None` if they do not pair.
    fn wedges(
        &self,
        triangles: &[[Vec3; 3]],
        key: u64,
        around: &[(u32, bool)],
    ) -> Option<Vec<(u32, u32)>> {
        /// Angles that are equal but for rounding, in radians.
        const SAME: f64 = 1e-5;
        let [a, b] = [key >> 32, key & 0xffff_ffff].map(|v| self.places[v as usize].as_dvec3());
        let axis = (b - a).try_normalize()?;
        let arm = |triangle: u32| {
            // Of the three corners the one off the edge.
            let corners = triangles[triangle as usize].map(|p| p.as_dvec3() - a);
            let off = corners.map(|p| p - axis * axis.dot(p));
            let far = |p: &&DVec3| p.length_squared();
            off.iter().max_by(|p, q| far(p).total_cmp(&far(q))).copied().unwrap_or(DVec3::ZERO)
        };
        let x = arm(around.first()?.0).try_normalize()?;
        let y = axis.cross(x);
        let mut turns: Vec<(f64, bool, u32)> = around
            .iter()
            .map(|&(triangle, along)| {
                let arm = arm(triangle);
                let angle = libm::atan2(arm.dot(y), arm.dot(x));
                let angle = if angle < -SAME { angle + std::f64::consts::TAU } else { angle };
                (angle, along, triangle)
            })
            .collect();
        turns.sort_by(|p, q| p.0.total_cmp(&q.0));
        // A triangle that runs upwards has its back, where its body is, on the side of smaller
        // angles: there the body ends. Of those in one place bodies end before others begin.
        for place in turns.chunk_by_mut(|p, q| q.0 - p.0 < SAME) {
            place.sort_by_key(|(_, ends, triangle)| (!ends, *triangle));
        }
        let mut begun: Vec<u32> = Vec::new();
        let mut pairs = Vec::new();
        let mut ended = vec![false; turns.len()];
        // Twice around, for bodies across the first angle.
        for round in 0..2 {
            for (i, (_, ends, triangle)) in turns.iter().enumerate() {
                if !ends && round == 0 {
                    begun.push(*triangle);
                } else if *ends
                    && !ended[i]
                    && let Some(first) = begun.pop()
                {
                    ended[i] = true;
                    pairs.push((first, *triangle));
                }
            }
        }
        (2 * pairs.len() == turns.len()).then_some(pairs)
    }

    /// Which triangles are left when those with an open edge are taken away, again and again: what
    /// bounds something, without the sheets that hang on it.
    fn peeled(&self) -> Vec<bool> {
        let mut kept: Vec<bool> = self.of.iter().map(|edges| edges[0] != NONE).collect();
        // Of each edge how many triangles are left, and all their numbers in one: of a single one
        // it is that.
        let mut left: Vec<(u32, u32)> = Vec::new();
        for group in self.groups() {
            let all = group.iter().fold(0, |all, (_, used)| all ^ (used >> 1));
            left.push((group.len() as u32, all));
        }
        let single = left.iter().filter(|(count, _)| *count == 1);
        let mut open: Vec<u32> = single.map(|(_, triangle)| *triangle).collect();
        while let Some(triangle) = open.pop() {
            if !std::mem::replace(&mut kept[triangle as usize], false) {
                continue;
            }
            for edge in self.of[triangle as usize] {
                let (count, all) = &mut left[edge as usize];
                *count -= 1;
                *all ^= triangle;
                if *count == 1 {
                    open.push(*all);
                }
            }
        }
        kept
    }
}

/// Sets of triangles, each turned or not relative to the others of its set: union-find.
struct Forest {
    parents: Vec<u32>,
    /// Relative to the parent.
    turned: Vec<bool>,
    depths: Vec<u8>,
}

impl Forest {
    fn new(n: usize) -> Self {
        Self { parents: (0..n as u32).collect(), turned: vec![false; n], depths: vec![0; n] }
    }

    /// The set's first member, and whether `i` is turned relative to it.
    fn find(&mut self, i: u32) -> (u32, bool) {
        let (mut root, mut turned) = (i, false);
        while self.parents[root as usize] != root {
            turned ^= self.turned[root as usize];
            root = self.parents[root as usize];
        }
        let (mut at, mut rest) = (i, turned);
        while at != root {
            let next = std::mem::replace(&mut self.parents[at as usize], root);
            rest ^= std::mem::replace(&mut self.turned[at as usize], rest);
            at = next;
        }
        (root, turned)
    }

    /// Makes one set of two; whether that agrees with what was known.
    fn join(&mut self, a: u32, b: u32, turned: bool) -> bool {
        let ((a, turned_a), (b, turned_b)) = (self.find(a), self.find(b));
        let between = turned_a ^ turned_b ^ turned;
        if a == b {
            return !between;
        }
        let (above, below) = match self.depths[a as usize] >= self.depths[b as usize] {
            true => (a, b),
            false => (b, a),
        };
        if self.depths[above as usize] == self.depths[below as usize] {
            self.depths[above as usize] += 1;
        }
        self.parents[below as usize] = above;
        self.turned[below as usize] = between;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An axis-aligned box, fronts outside.
    fn cuboid(low: Vec3, high: Vec3) -> Vec<[Vec3; 3]> {
        let p = |i: usize| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        };
        [
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ]
        .map(|t| t.map(p))
        .to_vec()
    }

    fn turned(mut triangles: Vec<[Vec3; 3]>) -> Vec<[Vec3; 3]> {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
        triangles
    }

    fn pane(corner: Vec3, a: Vec3, b: Vec3) -> Vec<[Vec3; 3]> {
        vec![[corner, corner + a, corner + a + b], [corner, corner + a + b, corner + b]]
    }

    /// Closure and number of turned triangles of the shells of lists of triangles in one mesh.
    fn shells(lists: &[Vec<[Vec3; 3]>]) -> Vec<(Closure, u32)> {
        let all = lists.concat();
        let found = Shells::new(&all);
        let mut at = 0;
        let mut result = Vec::new();
        for list in lists {
            let shell = found.shell(at).unwrap();
            assert!(
                (at..at + list.len()).all(|i| found.shell(i).unwrap().closure == shell.closure)
            );
            result.push((shell.closure, shell.turned));
            at += list.len();
        }
        result
    }

    const UNIT: (Vec3, Vec3) = (Vec3::ZERO, Vec3::ONE);

    #[test]
    fn closedness_is_per_connected_part() {
        use Closure::*;
        let cube = cuboid(UNIT.0, UNIT.1);
        let apart = pane(Vec3::X * 3.0, Vec3::X, Vec3::Y);
        // Hangs on the cube by one of its edges.
        let fin = pane(Vec3::ZERO, Vec3::X, Vec3::NEG_Y);
        let next = cuboid(Vec3::X, Vec3::new(2.0, 1.0, 1.0));
        assert_eq!(shells(&[cube.clone(), apart]), [(Closed, 0), (Open, 0)]);
        assert_eq!(shells(&[fin, cube.clone()]), [(Open, 0), (Closed, 0)]);
        // Boxes that share the four vertices of a face.
        assert_eq!(shells(&[cube.clone(), next.clone()]), [(Closed, 0), (Closed, 0)]);
        assert!(Shells::new(&[cube.clone(), next].concat()).are_closed());
        assert_eq!(shells(&[cube[..11].to_vec()]), [(Open, 0)]);
        let sheet = pane(Vec3::ZERO, Vec3::X, Vec3::Y);
        assert_eq!(shells(&[[sheet.clone(), turned(sheet)].concat()]), [(Flat, 0)]);
        assert!(!Shells::new(&[]).are_closed());
    }

    #[test]
    fn small_holes_are_told_from_open_sheets() {
        // A sphere of many triangles, one of them missing.
        let n = 24;
        let point = |i: usize, j: usize| {
            let (sin, cos) = (std::f64::consts::PI * i as f64 / n as f64).sin_cos();
            let (y, x) = (std::f64::consts::TAU * (j % n) as f64 / n as f64).sin_cos();
            let sin = if i == 0 || i == n { 0.0 } else { sin };
            DVec3::new(sin * x, sin * y, cos).as_vec3() + Vec3::splat(3.0)
        };
        let mut sphere = Vec::new();
        for i in 0..n {
            for j in 0..n {
                let [a, b, c, d] =
                    [point(i, j), point(i, j + 1), point(i + 1, j), point(i + 1, j + 1)];
                sphere.extend(
                    [[a, c, d], [a, d, b]].into_iter().filter(|t| t[0] != t[2] && t[1] != t[2]),
                );
            }
        }
        assert_eq!(shells(std::slice::from_ref(&sphere)), [(Closure::Closed, 0)]);
        let holed = sphere[1..].to_vec();
        assert_eq!(shells(std::slice::from_ref(&holed)), [(Closure::Holed, 0)]);
        let number = holed.len() as u32;
        assert_eq!(shells(&[turned(holed)]), [(Closure::Holed, number)]);
        assert_eq!(shells(&[sphere[sphere.len() / 2..].to_vec()]), [(Closure::Open, 0)]);
    }

    #[test]
    fn fronts_are_turned_outside_and_cavities_left() {
        use Closure::Closed;
        let (cube, inner) = (cuboid(UNIT.0, UNIT.1), cuboid(Vec3::splat(0.25), Vec3::splat(0.75)));
        assert_eq!(shells(&[turned(cube.clone())]), [(Closed, 12)]);
        // A hollow cube; one that is inside out with a cube inside of it.
        assert_eq!(shells(&[cube.clone(), turned(inner.clone())]), [(Closed, 0), (Closed, 0)]);
        assert_eq!(shells(&[turned(cube.clone()), inner.clone()]), [(Closed, 12), (Closed, 0)]);
        // A cavity that is filled to its wall by a body of the same mesh.
        let filled = [cube.clone(), turned(inner.clone()), inner.clone()];
        assert_eq!(shells(&filled), [(Closed, 0); 3]);
        // Beside, not inside.
        let away = cuboid(Vec3::splat(2.0), Vec3::splat(3.0));
        assert_eq!(shells(&[cube.clone(), turned(away)]), [(Closed, 0), (Closed, 12)]);
        // Some triangles of a shell face the other way than the rest.
        let mut mixed = cube.clone();
        mixed[3].swap(1, 2);
        mixed[7].swap(1, 2);
        let found = Shells::new(&mixed);
        let wrong: Vec<usize> = (0..12).filter(|i| found.is_turned(*i)).collect();
        assert_eq!(wrong, [3, 7]);
    }
}
