//! A thin lens: an aperture that gathers rays, and the plane in which they meet.

use std::f64::consts::FRAC_PI_4;

use super::invalid;
use crate::error::Error;

/// A thin lens: a disc or a regular polygon of no thickness across the view axis, all of whose rays
/// through one point of the film meet in one point of the plane of focus.
///
/// Only what lies in that plane is sharp. A point at depth `z` along the view axis is spread over
/// an image of the aperture that is `aperture |z - f| / f` wide where it is, with `f` the distance
/// of focus.
#[derive(Debug, Clone, PartialEq)]
pub struct Lens {
    aperture: f64,
    focus_distance: f64,
    blades: u32,
    /// Corners of the polygon, right and up, scene units; none for a disc.
    corners: Vec<[f64; 2]>,
}

impl Lens {
    /// The most blades: a polygon of more is round to the eye.
    pub const MAX_BLADES: u32 = 64;

    /// A lens with an aperture of diameter `aperture`, above 0, that is sharp at `focus_distance`,
    /// above 0, along the view axis; both in scene units.
    ///
    /// `blades` is 0 for a disc, or from 3 to 64 for a regular polygon inscribed in it, one corner
    /// of which points to the top of the film.
    ///
    /// # Errors
    /// Values outside of their range, that are not finite, or whose quotient is not.
    pub fn new(aperture: f64, focus_distance: f64, blades: u32) -> Result<Self, Error> {
        /// Diameters per distance of focus above which directions would lose their digits.
        const WIDEST: f64 = 1e9;
        if !(aperture > 0.0 && aperture.is_finite()) {
            return Err(invalid(
                format!("the aperture of the camera's lens is {aperture} wide"),
                "give a diameter above 0 in scene units, or none for a pinhole",
            ));
        }
        if !(focus_distance > 0.0 && focus_distance.is_finite()) {
            return Err(invalid(
                format!(
                    "the camera's plane of focus is {focus_distance} in front of it, where it sees nothing"
                ),
                "focus on something that the camera looks at: a distance above 0, or a point in front of it",
            ));
        }
        if !(aperture / focus_distance <= WIDEST) {
            return Err(invalid(
                format!("the camera focuses at {focus_distance}, behind an aperture of {aperture}"),
                "focus farther away, or close the aperture",
            ));
        }
        if !(blades == 0 || (3..=Self::MAX_BLADES).contains(&blades)) {
            return Err(invalid(
                format!("the aperture has {blades} blades"),
                "use 0 for a disc, or 3 to 64",
            ));
        }
        let corner = |i: u32| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(i) / f64::from(blades));
            [-0.5 * aperture * sin, 0.5 * aperture * cos]
        };
        let corners = (0..blades).map(corner).collect();
        Ok(Self { aperture, focus_distance, blades, corners })
    }

    /// Diameter of the disc, or of the circle through the polygon's corners, scene units.
    pub fn aperture(&self) -> f64 {
        self.aperture
    }

    /// Distance of the plane of focus from the lens along the view axis, scene units.
    pub fn focus_distance(&self) -> f64 {
        self.focus_distance
    }

    /// Number of the polygon's sides; 0 for a disc.
    pub fn blades(&self) -> u32 {
        self.blades
    }

    /// A point of the aperture, uniform over its area, for two canonical random numbers: right and
    /// up from the middle, scene units.
    ///
    /// The square is mapped to the disc by the concentric map [Shirley and Chiu 1997], and to a
    /// polygon by one strip for each of its sides: both keep areas, and stratified numbers
    /// stratified.
    pub fn sample(&self, [u, v]: [f32; 2]) -> [f64; 2] {
        let [u, v] = [f64::from(u), f64::from(v)];
        if self.corners.is_empty() {
            return concentric([2.0 * u - 1.0, 2.0 * v - 1.0]).map(|x| 0.5 * self.aperture * x);
        }
        let sides = self.corners.len();
        let along = u * sides as f64;
        let side = (along as usize).min(sides - 1);
        let [a, b] = [self.corners[side], self.corners[(side + 1) % sides]];
        let (share, reach) = (along - side as f64, v.sqrt());
        [0, 1].map(|k| reach * (a[k] + share * (b[k] - a[k])))
    }
}

/// From the square [-1, 1]^2 to the unit disc, rings of squares to rings of circles.
fn concentric([x, y]: [f64; 2]) -> [f64; 2] {
    if x == 0.0 && y == 0.0 {
        return [0.0; 2];
    }
    let (radius, swap) = if x.abs() > y.abs() { (x, false) } else { (y, true) };
    let (sin, cos) = libm::sincos(FRAC_PI_4 * if swap { x / y } else { y / x });
    if swap { [radius * sin, radius * cos] } else { [radius * cos, radius * sin] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point of a fine lattice of the square, at the middle of its cell.
    fn lattice(n: u32) -> impl Iterator<Item = [f32; 2]> {
        let at = move |i: u32| (i as f32 + 0.5) / n as f32;
        (0..n * n).map(move |i| [at(i % n), at(i / n)])
    }

    /// Twice the area of the triangle from the middle to two corners.
    fn cross([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
        ax * by - ay * bx
    }

    /// Whether a point is in the aperture, but for rounding.
    fn is_inside(lens: &Lens, p: [f64; 2]) -> bool {
        let n = lens.corners.len();
        let inner = |i: usize| {
            let (a, b) = (lens.corners[i], lens.corners[(i + 1) % n]);
            cross([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]) >= -1e-9
        };
        p[0].hypot(p[1]) <= 0.5 * lens.aperture * (1.0 + 1e-9) && (0..n).all(inner)
    }

    /// Null hypothesis, without randomness: the map keeps areas. Cells of the square are mapped to
    /// parts of the aperture of equal area, by differences of the map itself.
    #[test]
    fn maps_keep_areas() {
        for blades in [0, 3, 4, 5, 6, 9, 64] {
            let lens = Lens::new(0.7, 3.0, blades).unwrap();
            let area = match blades {
                0 => std::f64::consts::PI * 0.35 * 0.35,
                n => {
                    let n = f64::from(n);
                    0.5 * n * 0.35 * 0.35 * (std::f64::consts::TAU / n).sin()
                }
            };
            let h = 1.0 / 4096.0;
            let mut seen = 0;
            for [u, v] in lattice(61) {
                let [a, b] = [lens.sample([u - h, v]), lens.sample([u + h, v])];
                let [c, d] = [lens.sample([u, v - h]), lens.sample([u, v + h])];
                assert!([a, b, c, d].into_iter().all(|p| is_inside(&lens, p)), "{blades} {u} {v}");
                // Differences across the edges of triangles and diagonals tell nothing.
                let strip = |u: f32| (f64::from(u) * f64::from(blades.max(1))) as u32;
                let diagonal = (u - v).abs() < 4.0 * h || (u + v - 1.0).abs() < 4.0 * h;
                if strip(u - h) != strip(u + h) || blades == 0 && diagonal {
                    continue;
                }
                seen += 1;
                let step = 2.0 * f64::from(h);
                let jacobian = cross(
                    [(b[0] - a[0]) / step, (b[1] - a[1]) / step],
                    [(d[0] - c[0]) / step, (d[1] - c[1]) / step],
                );
                // The second order of the difference is largest near the middle.
                assert!((jacobian.abs() / area - 1.0).abs() < 2e-3, "{blades} {u} {v}: {jacobian}");
            }
            assert!(seen > 2500, "{blades}: {seen}");
        }
    }

    /// Second moments over the lattice are those of the disc, `r^2 / 4` on each axis, and of the
    /// regular polygon, `r^2 (2 + cos(2 pi / n)) / 12`; first ones are zero.
    #[test]
    fn moments_are_those_of_the_aperture() {
        for blades in [0, 3, 5, 6] {
            let lens = Lens::new(2.0, 3.0, blades).unwrap();
            let second = match blades {
                0 => 0.25,
                n => (2.0 + (std::f64::consts::TAU / f64::from(n)).cos()) / 12.0,
            };
            let n = 240u32;
            let mut sums = [0.0; 5];
            for [x, y] in lattice(n).map(|u| lens.sample(u)) {
                for (sum, value) in sums.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                    *sum += value / f64::from(n * n);
                }
            }
            let expected = [0.0, 0.0, second, second, 0.0];
            for (found, expected) in sums.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{blades}: {sums:?} {second}");
            }
        }
    }

    #[test]
    fn a_corner_points_up_and_ends_belong_to_the_aperture() {
        let lens = Lens::new(2.0, 1.0, 3).unwrap();
        let [x, y] = lens.sample([0.0, 1.0]);
        assert!(x.abs() < 1e-15 && (y - 1.0).abs() < 1e-15);
        for blades in [0, 3, 7] {
            let lens = Lens::new(2.0, 1.0, blades).unwrap();
            for u in [[0.0, 0.0], [1.0, 1.0], [0.5, 0.5], [0.0, 1.0], [1.0 - f32::EPSILON, 0.3]] {
                assert!(is_inside(&lens, lens.sample(u)), "{blades} {u:?}");
            }
        }
    }

    #[test]
    fn refuses_what_is_no_lens() {
        for (aperture, focus, blades) in [
            (0.0, 1.0, 0),
            (-1.0, 1.0, 0),
            (f64::NAN, 1.0, 0),
            (f64::INFINITY, 1.0, 0),
            (1.0, 0.0, 0),
            (1.0, -2.0, 0),
            (1.0, f64::NAN, 0),
            (1.0, 1e-12, 0),
            (1.0, 1.0, 1),
            (1.0, 1.0, 2),
            (1.0, 1.0, 65),
        ] {
            let error = Lens::new(aperture, focus, blades).unwrap_err();
            assert!(matches!(error, Error::Invalid { .. }), "{error}");
            assert!(!error.remedy().is_empty());
        }
    }
}
