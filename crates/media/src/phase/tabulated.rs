//! Phase functions from tables: measured ones, or Mie theory with all its bows and glories.

use super::cosine::Cosine;
use crate::Error;
use std::f64::consts::{PI, TAU};

/// Most rows of a table.
pub(crate) const MAX_ROWS: usize = 1 << 20;

/// A table of values by angle, linear in the cosine between rows, normalised.
#[derive(Debug, Clone, PartialEq)]
pub struct Tabulated {
    /// `1 - cos` of the rows, ascending from 0 to 2.
    one_minus: Vec<f64>,
    /// Values, 1/sr.
    value: Vec<f64>,
    /// Probability of less than each `1 - cos`, from 0 to 1.
    cumulative: Vec<f64>,
    mean_cosine: f32,
    /// What the table's integral over the sphere was.
    integral: f64,
}

impl Tabulated {
    /// The function through (scattering angle in degrees, value) by ascending angle, the first 0
    /// and the last 180 degrees. Values are relative: the table is normalised.
    ///
    /// # Errors
    /// If there are less than two rows or more than 2^20, if angles do not ascend or do not
    /// reach from 0 to 180, if a value is negative or not finite, or if all are zero. The number of
    /// the faulty row, from 0, comes along if there is one.
    pub fn new(rows: &[(f64, f64)]) -> Result<Tabulated, (Option<usize>, Error)> {
        let fault = |row: Option<usize>, what: String, remedy: &str| {
            Err((row, Error::invalid(what, remedy)))
        };
        if !(2..=MAX_ROWS).contains(&rows.len()) {
            return fault(
                None,
                format!("the table has {} rows", rows.len()),
                "give at least 2 and at most 1048576: angle in degrees and value",
            );
        }
        let mut before = f64::NEG_INFINITY;
        for (i, &(angle, value)) in rows.iter().enumerate() {
            if !(0.0..=180.0).contains(&angle) {
                let what = format!("the angle {angle} is outside 0 to 180 degrees");
                return fault(Some(i), what, "give scattering angles in degrees: 0 is forward");
            }
            if angle <= before {
                let what = format!("the angle {angle} follows {before}");
                return fault(Some(i), what, "sort the rows by ascending angle, each angle once");
            }
            if !(0.0..=1e30).contains(&value) {
                let what = format!("the value {value} is negative or out of range");
                return fault(Some(i), what, "give values from 0 to 1e30");
            }
            before = angle;
        }
        for (end, row, at) in [(0.0, rows.first(), 0), (180.0, rows.last(), rows.len() - 1)] {
            if let Some(&(angle, _)) = row
                && angle != end
            {
                let what = format!("the table begins or ends at {angle} degrees");
                return fault(Some(at), what, "let it reach from 0 to 180 degrees");
            }
        }
        // Half angles keep the digits that 1 - cos would lose.
        let one_minus: Vec<f64> = rows
            .iter()
            .map(|&(angle, _)| match angle {
                180.0 => 2.0,
                angle => {
                    let half = libm::sin(angle * (PI / 360.0));
                    2.0 * half * half
                }
            })
            .collect();
        let (mut total, mut cosine) = (0.0f64, 0.0f64);
        let mut cumulative = Vec::with_capacity(rows.len());
        cumulative.push(0.0);
        for (x, row) in one_minus.windows(2).zip(rows.windows(2)) {
            let (&[x0, x1], &[(_, p0), (_, p1)]) = (x, row) else { continue };
            let width = x1 - x0;
            total += 0.5 * width * (p0 + p1);
            // Integral of (1 - x) p over a segment on which p is linear.
            cosine += 0.5 * width * (p0 + p1)
                - width / 6.0 * (x0 * (2.0 * p0 + p1) + x1 * (p0 + 2.0 * p1));
            cumulative.push(total);
        }
        if !(total > 0.0) {
            return fault(None, "all values are 0".into(), "give values above 0");
        }
        cumulative.iter_mut().for_each(|c| *c /= total);
        let integral = TAU * total;
        Ok(Tabulated {
            one_minus,
            value: rows.iter().map(|&(_, value)| value / integral).collect(),
            cumulative,
            mean_cosine: (cosine / total) as f32,
            integral,
        })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.value.len()
    }

    /// Integral over the sphere that the table had before it was normalised.
    pub fn integral(&self) -> f64 {
        self.integral
    }

    /// Mean cosine of the scattering angle, exact for the table.
    pub fn mean_cosine(&self) -> f32 {
        self.mean_cosine
    }

    /// Value, 1/sr.
    pub(super) fn eval(&self, cosine: Cosine) -> f32 {
        let x = if cosine.one_minus < 1.0 {
            f64::from(cosine.one_minus)
        } else {
            2.0 - f64::from(cosine.one_plus)
        };
        let above = self.one_minus.partition_point(|&row| row <= x);
        let Some(segment) = self.segment(above) else { return 0.0 };
        let at = (x - segment.x0) / (segment.x1 - segment.x0);
        (segment.p0 + (segment.p1 - segment.p0) * at.clamp(0.0, 1.0)) as f32
    }

    /// The angle for a random number, by exact inversion: cumulative probability is quadratic
    /// between rows.
    pub(super) fn sample(&self, u: f32) -> Cosine {
        let u = f64::from(u);
        let above = self.cumulative.partition_point(|&c| c <= u);
        let Some(Segment { x0, x1, p0, p1, c0, c1 }) = self.segment(above) else {
            return Cosine { one_minus: 0.0, one_plus: 2.0 };
        };
        let share = ((u - c0) / (c1 - c0)).clamp(0.0, 1.0);
        let root = (p0 * p0 + share * (p1 * p1 - p0 * p0)).max(0.0).sqrt();
        let t = share * (p0 + p1) / (p0 + root);
        // 0 / 0 only at the very start of a segment that begins with 0.
        let t = if t.is_finite() { t } else { 0.0 };
        Cosine::from_one_minus(x0 + (x1 - x0) * t)
    }

    /// The segment that ends at row `above`, the last one if there is no such row.
    fn segment(&self, above: usize) -> Option<Segment> {
        let above = above.clamp(1, self.value.len().saturating_sub(1));
        let below = above.checked_sub(1)?;
        Some(Segment {
            x0: *self.one_minus.get(below)?,
            x1: *self.one_minus.get(above)?,
            p0: *self.value.get(below)?,
            p1: *self.value.get(above)?,
            c0: *self.cumulative.get(below)?,
            c1: *self.cumulative.get(above)?,
        })
    }
}

/// Two neighbouring rows.
struct Segment {
    x0: f64,
    x1: f64,
    p0: f64,
    p1: f64,
    c0: f64,
    c1: f64,
}
