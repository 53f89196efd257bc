//! Transmittance functions from pairs of numbers.

use super::StartCorrelation;
use crate::Error;
use libm::exp;
use std::fmt;

/// Most rows of a table.
pub(crate) const MAX_ROWS: usize = 65_536;

/// Relative excess of a slope over the next that counts as rounding.
const ROUNDING: f64 = 1e-6;

/// A knot of the spline.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Knot {
    tau: f64,
    transmittance: f64,
    /// `T'`, not positive.
    slope: f64,
}

/// `T` through given points: a quadratic spline with continuous slope that keeps their convexity
/// [Schumaker 1983], and an exponential tail where the last value is not zero.
///
/// `p_u` is linear between knots and `p_c` constant. The points are taken as they are: their first
/// slope sets the mean free path between collisions.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    knots: Vec<Knot>,
    /// Rate of the tail; infinite if there is none.
    tail: f64,
}

impl Table {
    /// The transmittance function through points of optical depth and transmittance.
    ///
    /// # Errors
    /// If there are fewer than two points or more than 65,536, if depths do not ascend from
    /// 0, or if transmittances do not start at 1, fall to at least 0 and do so in a convex curve.
    /// The row, from 1, is named.
    pub fn new(points: &[[f64; 2]]) -> Result<Table, Error> {
        let wrong = |row: usize, what: String, remedy: &str| {
            Err(Error::invalid(format!("row {row}: {what}"), remedy))
        };
        if !(2..=MAX_ROWS).contains(&points.len()) {
            return Err(Error::invalid(
                format!("the table has {} rows", points.len()),
                format!("give from 2 to {MAX_ROWS}"),
            ));
        }
        if points[0] != [0.0, 1.0] {
            return wrong(
                1,
                format!("the first point is {:?}", points[0]),
                "start with optical depth 0 and transmittance 1",
            );
        }
        let mut secants: Vec<f64> = Vec::with_capacity(points.len());
        for (i, pair) in points.windows(2).enumerate() {
            let ([x0, y0], [x1, y1]) = (pair[0], pair[1]);
            let row = i + 2;
            if !(x1 > x0 && x1 <= 1e9) {
                return wrong(
                    row,
                    format!("optical depth {x1} after {x0}"),
                    "let optical depths ascend, to at most 1e9",
                );
            }
            if !(y1 >= 0.0 && y1 < y0) {
                return wrong(
                    row,
                    format!("transmittance {y1} after {y0}"),
                    "let transmittances fall, to at least 0; end the table at the first 0",
                );
            }
            let secant = (y1 - y0) / (x1 - x0);
            if !(secant < -1e-30 && secant > -1e9) {
                return wrong(
                    row,
                    format!("the slope to optical depth {x1} is {secant:e}"),
                    "leave out rows that lie this close in transmittance or depth",
                );
            }
            if let Some(before) = secants.last()
                && secant < before * (1.0 + ROUNDING)
            {
                return wrong(
                    i + 1,
                    format!(
                        "the curve bends down at optical depth {x0}: slope {before:.6} before, {secant:.6} after"
                    ),
                    "let the curve be convex: else the density of flights between collisions would be negative",
                );
            }
            secants.push(secant);
        }
        Ok(Table::spline(points, &secants))
    }

    /// The table of a text: two numbers a line, separated by a comma or space; empty lines and what
    /// follows `#` do not count.
    ///
    /// # Errors
    /// If a line holds anything else, which is named; or if the points are none of a transmittance
    /// function, see [`new`](Table::new).
    pub fn parse(text: &str) -> Result<Table, Error> {
        let mut points = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default();
            let mut words =
                line.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty());
            let Some(first) = words.next() else { continue };
            let pair = (first.parse::<f64>(), words.next().map(str::parse::<f64>), words.next());
            let (Ok(tau), Some(Ok(transmittance)), None) = pair else {
                // The line is not shown: whose file it is is not known.
                return Err(Error::invalid(
                    format!("line {} is not a pair of numbers", number + 1),
                    "write an optical depth and a transmittance on each line; begin comments with #",
                ));
            };
            if points.len() >= MAX_ROWS {
                return Err(Error::invalid(
                    format!("line {}: more than {MAX_ROWS} rows", number + 1),
                    "give fewer",
                ));
            }
            points.push([tau, transmittance]);
        }
        Table::new(&points)
    }

    fn spline(points: &[[f64; 2]], secants: &[f64]) -> Table {
        let n = secants.len();
        let width = |i: usize| points[i + 1][0] - points[i][0];
        // Slopes at the points, between those of the neighbouring secants: of the parabola through
        // three points.
        let mut slopes = vec![0.0; n + 1];
        for i in 1..n {
            let (before, after) = (width(i - 1), width(i));
            slopes[i] = (secants[i - 1] * after + secants[i] * before) / (before + after);
        }
        let (first, last) = (secants[0], secants[n - 1]);
        let ends = points[n][1] == 0.0;
        slopes[n] = if n > 1 { 2.0 * last - slopes[n - 1] } else { last };
        slopes[n] = slopes[n].clamp(last, if ends { 0.0 } else { 0.5 * last });
        slopes[0] = if n > 1 { 2.0 * first - slopes[1] } else { first };
        let mut knots = vec![Knot { tau: 0.0, transmittance: 1.0, slope: slopes[0] }];
        let mut push = |tau: f64, slope: f64| {
            let Some(&before) = knots.last() else { return };
            let slope = slope.max(before.slope);
            let transmittance =
                before.transmittance + 0.5 * (before.slope + slope) * (tau - before.tau);
            if tau > before.tau {
                knots.push(Knot { tau, transmittance: transmittance.max(0.0), slope });
            }
        };
        for i in 0..n {
            // A knot where the slope is the secant's: then both parts meet the points, whatever the
            // slopes at them.
            let rise = slopes[i + 1] - slopes[i];
            if rise > 0.0 {
                let q = ((slopes[i + 1] - secants[i]) / rise).clamp(0.0, 1.0);
                push(points[i][0] + q * width(i), secants[i]);
            }
            push(points[i + 1][0], slopes[i + 1]);
        }
        let end = knots[knots.len() - 1];
        let tail = if ends || !(end.transmittance > 0.0) {
            f64::INFINITY
        } else {
            -end.slope / end.transmittance
        };
        Table { knots, tail }
    }

    fn first_slope(&self) -> f64 {
        self.knots[0].slope
    }

    /// Transmittance, slope and curvature at a depth.
    fn at(&self, tau: f64) -> [f64; 3] {
        let next = self.knots.partition_point(|knot| knot.tau <= tau).max(1);
        let a = self.knots[next - 1];
        let x = tau - a.tau;
        let Some(b) = self.knots.get(next) else {
            if self.tail == f64::INFINITY {
                return [0.0; 3];
            }
            let fall = exp(-self.tail * x);
            return [a.transmittance * fall, a.slope * fall, -a.slope * self.tail * fall];
        };
        let curvature = (b.slope - a.slope) / (b.tau - a.tau);
        let transmittance = a.transmittance + x * (a.slope + 0.5 * curvature * x);
        [transmittance.max(0.0), a.slope + curvature * x, curvature]
    }

    pub(super) fn survival(&self, start: StartCorrelation, tau: f64) -> f64 {
        let [transmittance, slope, _] = self.at(tau);
        match start {
            StartCorrelation::Uncorrelated => transmittance,
            StartCorrelation::Correlated => slope / self.first_slope(),
        }
    }

    pub(super) fn density(&self, start: StartCorrelation, tau: f64) -> f64 {
        let [_, slope, curvature] = self.at(tau);
        match start {
            StartCorrelation::Uncorrelated => -slope,
            StartCorrelation::Correlated => -curvature / self.first_slope(),
        }
    }

    pub(super) fn depth(&self, start: StartCorrelation, drawn: f64) -> f64 {
        let survival = exp(-drawn);
        let end = self.knots[self.knots.len() - 1];
        // Depth beyond the last knot, if the survival there is `left`.
        let beyond = |left: f64| {
            if self.tail == f64::INFINITY {
                end.tau
            } else {
                end.tau + (drawn + libm::log(left)) / self.tail
            }
        };
        match start {
            StartCorrelation::Uncorrelated => {
                let next = self.knots.partition_point(|knot| knot.transmittance > survival).max(1);
                let a = self.knots[next - 1];
                let Some(b) = self.knots.get(next) else { return beyond(end.transmittance) };
                let curvature = (b.slope - a.slope) / (b.tau - a.tau);
                let fall = a.transmittance - survival;
                let root = (a.slope * a.slope - 2.0 * curvature * fall).max(0.0).sqrt();
                (a.tau + 2.0 * fall / (root - a.slope)).clamp(a.tau, b.tau)
            }
            StartCorrelation::Correlated => {
                let target = survival * self.first_slope();
                let next = self.knots.partition_point(|knot| knot.slope < target).max(1);
                let a = self.knots[next - 1];
                let Some(b) = self.knots.get(next) else {
                    return beyond(end.slope / self.first_slope());
                };
                let share = (target - a.slope) / (b.slope - a.slope);
                // The first of several knots of one slope.
                if b.slope > a.slope { a.tau + share * (b.tau - a.tau) } else { a.tau }
            }
        }
    }

    pub(super) fn mean_free_path(&self) -> f64 {
        -1.0 / self.first_slope()
    }

    pub(super) fn has_atom(&self, start: StartCorrelation) -> bool {
        let end = self.knots[self.knots.len() - 1];
        start == StartCorrelation::Correlated && self.tail == f64::INFINITY && end.slope < 0.0
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = self.knots[self.knots.len() - 1].tau;
        write!(f, "table to depth {end}, mean free path {:.4}", self.mean_free_path())
    }
}
