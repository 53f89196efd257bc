//! Functions of a cosine and a roughness, tabulated once and interpolated linearly.

/// Nodes along each axis.
const NODES: usize = 48;

/// `K` functions of (cosine, roughness) on [0, 1]^2.
///
/// Nodes are even in roughness and in the root of the cosine, since albedos change fastest at grazing angles.
pub(super) struct CosineTable<const K: usize> {
    values: Vec<[[f32; K]; NODES]>,
    averages: Vec<[f32; K]>,
}

impl<const K: usize> CosineTable<K> {
    /// Evaluates `f(cosine, roughness)` at the nodes.
    pub(super) fn build(f: impl Fn(f32, f32) -> [f32; K]) -> CosineTable<K> {
        let at = |k: usize| k as f32 / (NODES - 1) as f32;
        let values: Vec<[[f32; K]; NODES]> = (0..NODES)
            .map(|row| std::array::from_fn(|column| f(at(column) * at(column), at(row))))
            .collect();
        let averages = values.iter().map(|row| std::array::from_fn(|k| average(row, k))).collect();
        CosineTable { values, averages }
    }

    /// The functions of the cosine for one roughness in [0, 1].
    pub(super) fn row(&'static self, roughness: f32) -> Row<K> {
        let (lower, fraction) = place(roughness);
        Row { table: self, lower, fraction }
    }
}

/// Mean of the interpolated function over the hemisphere, weighted by the cosine; exact.
fn average<const K: usize>(row: &[[f32; K]; NODES], k: usize) -> f32 {
    // With x the root of the cosine: the integral of 4 x^3 (f0 + (f1 - f0) (x - a) / h) over each piece.
    let h = 1.0 / (NODES - 1) as f64;
    let mut sum = 0.0;
    for (piece, pair) in row.windows(2).enumerate() {
        let (a, b) = (piece as f64 * h, (piece + 1) as f64 * h);
        let (f0, f1) = (f64::from(pair[0][k]), f64::from(pair[1][k]));
        let slope = (f1 - f0) / h;
        let (quartic, quintic) = (b.powi(4) - a.powi(4), 0.8 * (b.powi(5) - a.powi(5)));
        sum += (f0 - slope * a) * quartic + slope * quintic;
    }
    sum as f32
}

/// The node below a coordinate in [0, 1], and how far beyond it.
#[inline]
fn place(x: f32) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * (NODES - 1) as f32;
    let lower = (x as usize).min(NODES - 2);
    (lower, x - lower as f32)
}

/// Functions of the cosine for one roughness.
#[derive(Clone, Copy)]
pub(super) struct Row<const K: usize> {
    table: &'static CosineTable<K>,
    lower: usize,
    fraction: f32,
}

impl<const K: usize> std::fmt::Debug for Row<K> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Row({})", self.lower as f32 + self.fraction)
    }
}

impl<const K: usize> Row<K> {
    /// Values at a cosine in [0, 1].
    #[inline]
    pub(super) fn at(&self, cos: f32) -> [f32; K] {
        let (column, t) = place(cos.max(0.0).sqrt());
        let (low, high) = (&self.table.values[self.lower], &self.table.values[self.lower + 1]);
        std::array::from_fn(|k| {
            let a = low[column][k] + t * (low[column + 1][k] - low[column][k]);
            let b = high[column][k] + t * (high[column + 1][k] - high[column][k]);
            a + self.fraction * (b - a)
        })
    }

    /// Means over the hemisphere, weighted by the cosine.
    #[inline]
    pub(super) fn average(&self) -> [f32; K] {
        let (low, high) = (&self.table.averages[self.lower], &self.table.averages[self.lower + 1]);
        std::array::from_fn(|k| low[k] + self.fraction * (high[k] - low[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::LazyLock;

    static TABLE: LazyLock<CosineTable<2>> =
        LazyLock::new(|| CosineTable::build(|mu, r| [mu.sqrt() * (1.0 + r), 1.0 - r]));

    #[test]
    fn bilinear_functions_are_exact() {
        for (mu, r) in [(0.0f32, 0.0f32), (0.013, 0.77), (0.5, 0.5), (1.0, 1.0)] {
            let row = TABLE.row(r);
            let [a, b] = row.at(mu);
            assert!((a - mu.sqrt() * (1.0 + r)).abs() < 1e-6 && (b - (1.0 - r)).abs() < 1e-6);
            // The mean of the root is 4/5.
            let [mean, flat] = row.average();
            assert!((mean - 0.8 * (1.0 + r)).abs() < 1e-6 && (flat - (1.0 - r)).abs() < 1e-6);
        }
    }
}
