//! Boxes parallel to the axes.

use glam::{DAffine3, DVec3};

/// A box parallel to the axes, with its faces: the points `p` with `low <= p <= high` on every
/// axis. Units are those of its space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds3 {
    /// The corner with the smallest coordinates.
    pub low: DVec3,
    /// The corner with the largest coordinates.
    pub high: DVec3,
}

impl Bounds3 {
    /// No points: what a union begins with.
    pub const EMPTY: Bounds3 = Bounds3 { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The box from `low` to `high`; without points where `low` exceeds `high`.
    #[inline(always)]
    pub const fn new(low: DVec3, high: DVec3) -> Bounds3 {
        Bounds3 { low, high }
    }

    /// The smallest box that holds all points; empty without points. NaN is passed over.
    pub fn of_points(points: impl IntoIterator<Item = DVec3>) -> Bounds3 {
        points.into_iter().fold(Bounds3::EMPTY, Bounds3::with)
    }

    /// The smallest box that holds this one and a point.
    #[inline]
    pub fn with(self, p: DVec3) -> Bounds3 {
        Bounds3 { low: self.low.min(p), high: self.high.max(p) }
    }

    /// The smallest box that holds both.
    #[inline]
    pub fn union(self, other: Bounds3) -> Bounds3 {
        Bounds3 { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Edge lengths.
    #[inline]
    pub fn size(self) -> DVec3 {
        self.high - self.low
    }

    /// The point in the middle.
    #[inline]
    pub fn centre(self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// The point at `u`, per axis 0 at `low` and 1 at `high`.
    #[inline]
    pub fn at(self, u: DVec3) -> DVec3 {
        self.low + (self.high - self.low) * u
    }

    /// Whether a point is in the box or on its faces.
    #[inline]
    pub fn contains(self, p: DVec3) -> bool {
        self.low.cmple(p).all() && self.high.cmpge(p).all()
    }

    /// Whether two boxes share a point, be it on their faces alone.
    #[inline]
    pub fn overlaps(self, other: Bounds3) -> bool {
        self.low.cmple(other.high).all() && self.high.cmpge(other.low).all()
    }

    /// The eight corners, x first.
    pub fn corners(self) -> [DVec3; 8] {
        std::array::from_fn(|corner| {
            let pick = |axis: usize| {
                if corner >> axis & 1 == 1 { self.high[axis] } else { self.low[axis] }
            };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// The smallest box that holds the moved corners; rounding may narrow it.
    pub fn moved(self, transform: &DAffine3) -> Bounds3 {
        Bounds3::of_points(self.corners().map(|corner| transform.transform_point3(corner)))
    }

    /// Mean length of the chords of isotropic uniform lines, `4 V / S` (Cauchy).
    pub fn mean_chord(self) -> f64 {
        let d = self.size();
        2.0 * d.x * d.y * d.z / (d.x * d.y + d.y * d.z + d.z * d.x)
    }

    /// Where the ray `origin + t direction`, t in [t_min, t_max], is inside: its first and last
    /// `t`, in multiples of the direction's length. `None` if it passes by, touches one point
    /// alone, or a number is NaN that matters. Of a box with points: an empty one is not asked.
    ///
    /// The slab test [Kay and Kajiya 1986]. Axes along which the direction is zero do not bound the
    /// ray unless it starts outside of their slab.
    #[inline(always)]
    pub fn clip(
        self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(f64, f64)> {
        let (mut t0, mut t1) = (t_min, t_max);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d == 0.0 {
                if o < self.low[axis] || o > self.high[axis] {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / d;
            let (a, b) = ((self.low[axis] - o) * inverse, (self.high[axis] - o) * inverse);
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        // Also false for NaN.
        (t0 < t1).then_some((t0, t1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point(range: std::ops::Range<f64>) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(range).prop_map(DVec3::from_array)
    }

    proptest! {
        /// Against the definition: points between the ends are inside, points before and behind are
        /// not, and a ray without ends has no point inside.
        #[test]
        fn clipping_finds_where_a_ray_is_inside(
            low in point(-5.0..5.0),
            size in point(0.01..4.0),
            origin in point(-9.0..9.0),
            target in point(-9.0..9.0),
            flat in 0usize..4,
            t_max in 0.1..3.0f64,
        ) {
            let bounds = Bounds3::new(low, low + size);
            let mut direction = target - origin;
            if flat < 3 {
                direction[flat] = 0.0;
            }
            prop_assume!(direction.length() > 1e-3);
            let steps = 400;
            let at = |i: i32| t_max * (f64::from(i) + 0.5) / f64::from(steps);
            let slack = 1e-9 * (1.0 + t_max);
            match bounds.clip(origin, direction, 0.0, t_max) {
                Some((t0, t1)) => {
                    prop_assert!((0.0..=t_max).contains(&t0) && t1 <= t_max);
                    for t in (0..steps).map(at) {
                        let inside = bounds.contains(origin + direction * t);
                        let between = t >= t0 && t <= t1;
                        let near = (t - t0).abs() < slack || (t - t1).abs() < slack;
                        prop_assert!(inside == between || near, "{t} in {t0} to {t1}");
                    }
                }
                None => prop_assert!(
                    (0..steps).all(|i| !bounds.contains(origin + direction * at(i)))
                ),
            }
        }

        #[test]
        fn moved_points_are_in_the_moved_box(
            low in point(-5.0..5.0),
            size in point(0.0..4.0),
            u in point(0.0..1.0),
            columns in prop::array::uniform3(point(-2.0..2.0)),
            shift in point(-90.0..90.0),
        ) {
            let bounds = Bounds3::new(low, low + size);
            let [x, y, z] = columns;
            let map = DAffine3::from_mat3_translation(glam::DMat3::from_cols(x, y, z), shift);
            let moved = bounds.moved(&map);
            let grown = Bounds3::new(moved.low - 1e-12 * 200.0, moved.high + 1e-12 * 200.0);
            prop_assert!(grown.contains(map.transform_point3(bounds.at(u))));
        }
    }

    #[test]
    fn what_is_no_ray_through_the_box_is_none() {
        let bounds = Bounds3::new(DVec3::ZERO, DVec3::ONE);
        let (middle, nan) = (DVec3::splat(0.5), DVec3::new(f64::NAN, 0.5, 0.5));
        let clip = |o, d, t0, t1| bounds.clip(o, d, t0, t1);
        assert_eq!(clip(middle, DVec3::X, 0.0, f64::INFINITY), Some((0.0, 0.5)));
        assert_eq!(clip(middle, DVec3::X, -2.0, 9.0), Some((-0.5, 0.5)));
        assert_eq!(clip(middle, DVec3::X, 0.0, 0.0), None);
        assert_eq!(clip(middle, DVec3::X, 0.0, f64::NAN), Some((0.0, 0.5)));
        assert_eq!(clip(middle, DVec3::ZERO, 0.0, 2.0), Some((0.0, 2.0)));
        assert_eq!(clip(DVec3::splat(2.0), DVec3::ZERO, 0.0, 2.0), None);
        // On a face, along it.
        assert_eq!(clip(DVec3::new(-1.0, 1.0, 0.5), DVec3::X, 0.0, 9.0), Some((1.0, 2.0)));
        assert!(!bounds.contains(nan));
    }

    #[test]
    fn boxes_are_made_of_points() {
        let bounds = Bounds3::of_points([DVec3::X, DVec3::NEG_Y, DVec3::new(0.0, 2.0, -3.0)]);
        assert_eq!(bounds, Bounds3::new(DVec3::new(0.0, -1.0, -3.0), DVec3::new(1.0, 2.0, 0.0)));
        assert_eq!(bounds.union(Bounds3::EMPTY), bounds);
        assert_eq!(bounds.size(), DVec3::new(1.0, 3.0, 3.0));
        assert_eq!(bounds.centre(), DVec3::new(0.5, 0.5, -1.5));
        let corners = bounds.corners();
        assert_eq!((corners[0], corners[7]), (bounds.low, bounds.high));
        assert_eq!(corners[1], DVec3::new(1.0, -1.0, -3.0));
        assert_eq!(Bounds3::of_points(corners), bounds);
        // A cube of edge 2: 4 * 8 / 24.
        let cube = Bounds3::new(DVec3::ZERO, DVec3::splat(2.0));
        assert!((cube.mean_chord() - 4.0 / 3.0).abs() < 1e-15);
    }
}
