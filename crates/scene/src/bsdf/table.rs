//! Functions of a cosine and a roughness, tabulated where they are asked for and interpolated
//! linearly.

use std::sync::OnceLock;

/// Nodes over the roughness.
const ROWS: usize = 32;
/// Nodes over the cosine.
const COLUMNS: usize = 64;
/// Points of the rule for averages.
const AVERAGE: usize = 1024;

/// `K` functions of (cosine, roughness) on [0, 1]^2.
///
/// Rows are even in roughness. Along a row nodes are even in the mean of two roots: that of the
/// cosine, and that of `cos / (cos + s)` with `s` the cosine below which a surface of that
/// roughness darkens: so a narrow edge at grazing angles is resolved, and stays in its column from
/// row to row.
///
/// A row is made when it is first asked for: most scenes have a few roughnesses.
pub(super) struct CosineTable<const K: usize> {
    rows: [OnceLock<RowOfNodes<K>>; ROWS],
    f: fn(f32, f32) -> [f32; K],
    grazing: fn(f32) -> f32,
}

/// The functions at the nodes of one roughness, and their means over the hemisphere.
struct RowOfNodes<const K: usize> {
    values: [[f32; K]; COLUMNS],
    average: [f32; K],
}

/// Place of a cosine along a row, from 0 to 1.
#[inline]
fn column(cos: f32, grazing: f32) -> f32 {
    let cos = cos.max(0.0);
    0.5 * (cos.sqrt() + (cos * (1.0 + grazing) / (cos + grazing)).sqrt())
}

/// The cosine at a place along a row, by bisection.
fn cosine(x: f32, grazing: f32) -> f32 {
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if column(middle, grazing) < x { low = middle } else { high = middle }
    }
    if x >= 1.0 { 1.0 } else { low }
}

impl<const K: usize> CosineTable<K> {
    /// The table of `f(cosine, roughness)`. `grazing` is the cosine of the edge for a roughness.
    pub(super) const fn new(
        grazing: fn(f32) -> f32,
        f: fn(f32, f32) -> [f32; K],
    ) -> CosineTable<K> {
        CosineTable { rows: [const { OnceLock::new() }; ROWS], f, grazing }
    }

    /// The functions of the cosine for one roughness in [0, 1].
    pub(super) fn row(&'static self, roughness: f32) -> Row<K> {
        let (lower, fraction) = place(roughness, ROWS);
        let [low, high] = [lower, lower + 1].map(|row| self.nodes(row));
        Row { low, high, fraction, grazing: self.edge(roughness) }
    }

    fn edge(&self, roughness: f32) -> f32 {
        (self.grazing)(roughness).max(1e-5)
    }

    fn nodes(&self, row: usize) -> &RowOfNodes<K> {
        self.rows[row].get_or_init(|| self.make(row as f32 / (ROWS - 1) as f32))
    }

    #[cold]
    fn make(&self, roughness: f32) -> RowOfNodes<K> {
        let edge = self.edge(roughness);
        let node = |k: usize| cosine(k as f32 / (COLUMNS - 1) as f32, edge);
        let values: [[f32; K]; COLUMNS] = std::array::from_fn(|k| (self.f)(node(k), roughness));
        let mut sum = [0.0f64; K];
        for n in 0..AVERAGE {
            // Even in the root of the cosine.
            let x = (n as f64 + 0.5) / AVERAGE as f64;
            let (k, t) = place(column((x * x) as f32, edge), COLUMNS);
            for (sum, (a, b)) in sum.iter_mut().zip(values[k].iter().zip(values[k + 1])) {
                *sum += f64::from(a + t * (b - a)) * 4.0 * x.powi(3) / AVERAGE as f64;
            }
        }
        RowOfNodes { values, average: sum.map(|sum| sum as f32) }
    }
}

/// The node below a coordinate in [0, 1], and how far beyond it.
#[inline]
fn place(x: f32, nodes: usize) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * (nodes - 1) as f32;
    let lower = (x as usize).min(nodes - 2);
    (lower, x - lower as f32)
}

/// Functions of the cosine for one roughness.
#[derive(Clone, Copy)]
pub(super) struct Row<const K: usize> {
    low: &'static RowOfNodes<K>,
    high: &'static RowOfNodes<K>,
    fraction: f32,
    grazing: f32,
}

impl<const K: usize> std::fmt::Debug for Row<K> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Row({:?})", self.average())
    }
}

impl<const K: usize> Row<K> {
    /// Values at a cosine in [0, 1].
    #[inline]
    pub(super) fn at(&self, cos: f32) -> [f32; K] {
        let (column, t) = place(column(cos, self.grazing), COLUMNS);
        let (low, high) = (&self.low.values, &self.high.values);
        std::array::from_fn(|k| {
            let a = low[column][k] + t * (low[column + 1][k] - low[column][k]);
            let b = high[column][k] + t * (high[column + 1][k] - high[column][k]);
            a + self.fraction * (b - a)
        })
    }

    /// Means over the hemisphere, weighted by the cosine.
    #[inline]
    pub(super) fn average(&self) -> [f32; K] {
        let (low, high) = (&self.low.average, &self.high.average);
        std::array::from_fn(|k| low[k] + self.fraction * (high[k] - low[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static TABLE: CosineTable<2> = CosineTable::new(|r| r * r, |mu, r| [mu * (1.0 + r), 1.0 - r]);

    #[test]
    fn smooth_functions_and_their_averages() {
        for (mu, r) in [(0.0f32, 0.0f32), (0.013, 0.77), (0.5, 0.5), (0.98, 0.1), (1.0, 1.0)] {
            let row = TABLE.row(r);
            let [a, b] = row.at(mu);
            assert!((a - mu * (1.0 + r)).abs() < 2e-3, "{mu} {r}: {a}");
            assert!((b - (1.0 - r)).abs() < 1e-6);
            // The mean cosine is 2/3.
            let [mean, flat] = row.average();
            assert!((mean - (1.0 + r) * 2.0 / 3.0).abs() < 1e-3, "{r}: {mean}");
            assert!((flat - (1.0 - r)).abs() < 1e-5);
        }
    }

    #[test]
    fn columns_are_inverted() {
        for edge in [1e-5f32, 1e-3, 0.3, 1.0] {
            for k in 0..=20 {
                let x = k as f32 / 20.0;
                assert!((column(cosine(x, edge), edge) - x).abs() < 1e-5);
            }
        }
    }
}
