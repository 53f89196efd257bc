//! From grid values to colours, piecewise linearly.

use crate::Error;
use glam::Vec3;

/// A colour for every value: linear between nodes, constant beyond the first and the last.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorRamp {
    /// Ascending in value; at least one.
    nodes: Vec<(f32, Vec3)>,
}

impl ColorRamp {
    /// A ramp through nodes of (value, colour in radiance per length).
    ///
    /// # Errors
    /// If there are no nodes, if their values do not ascend, or if a number is not finite or a
    /// colour negative.
    pub fn new(nodes: impl IntoIterator<Item = (f32, [f32; 3])>) -> Result<ColorRamp, Error> {
        let nodes: Vec<(f32, Vec3)> =
            nodes.into_iter().map(|(value, color)| (value, Vec3::from_array(color))).collect();
        if nodes.is_empty() {
            return Err(Error::invalid("the ramp has no nodes", "give it values with colours"));
        }
        for (value, color) in &nodes {
            if !(value.is_finite() && color.is_finite() && color.min_element() >= 0.0) {
                return Err(Error::invalid(
                    format!("the ramp's node {value}: {color} is negative or not finite"),
                    "give finite numbers, and colours of at least 0",
                ));
            }
        }
        if let Some(pair) = nodes.windows(2).find(|pair| !(pair[0].0 < pair[1].0)) {
            return Err(Error::invalid(
                format!("the ramp's value {} does not lie above {}", pair[1].0, pair[0].0),
                "list the values in ascending order, each once",
            ));
        }
        Ok(ColorRamp { nodes })
    }

    /// The colour of a value.
    pub fn at(&self, value: f32) -> Vec3 {
        let after = self.nodes.partition_point(|(node, _)| *node <= value);
        match (after.checked_sub(1).and_then(|i| self.nodes.get(i)), self.nodes.get(after)) {
            (Some(&(low, a)), Some(&(high, b))) => a + (value - low) / (high - low) * (b - a),
            (Some(&(_, color)), None) | (None, Some(&(_, color))) => color,
            (None, None) => Vec3::ZERO,
        }
    }

    /// Largest channel of any value between two: one of theirs or of a node between them.
    pub(crate) fn bound(&self, low: f32, high: f32) -> f32 {
        let ends = self.at(low).max_element().max(self.at(high).max_element());
        let first = self.nodes.partition_point(|(node, _)| *node < low);
        let between = self.nodes.iter().skip(first).take_while(|(node, _)| *node <= high);
        between.fold(ends, |most, (_, color)| most.max(color.max_element()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fire() -> ColorRamp {
        let nodes = [(0.0, [0.0; 3]), (0.3, [2.0, 0.1, 0.0]), (1.0, [1.0, 1.0, 0.5])];
        ColorRamp::new(nodes).unwrap()
    }

    #[test]
    fn is_linear_between_nodes_and_constant_beyond() {
        let ramp = fire();
        assert_eq!(ramp.at(-1.0), Vec3::ZERO);
        assert_eq!(ramp.at(0.3), Vec3::new(2.0, 0.1, 0.0));
        assert!((ramp.at(0.15) - Vec3::new(1.0, 0.05, 0.0)).length() < 1e-6);
        assert_eq!(ramp.at(7.0), Vec3::new(1.0, 1.0, 0.5));
        assert_eq!(ramp.bound(0.2, 0.9), 2.0);
        assert_eq!(ColorRamp::new([(1.0, [3.0; 3])]).unwrap().at(-5.0), Vec3::splat(3.0));
    }

    #[test]
    fn faults_are_refused() {
        for nodes in [
            vec![],
            vec![(0.0, [0.0; 3]), (0.0, [1.0; 3])],
            vec![(1.0, [0.0; 3]), (0.0, [1.0; 3])],
            vec![(0.0, [-1.0, 0.0, 0.0])],
            vec![(f32::NAN, [0.0; 3])],
            vec![(0.0, [0.0, f32::INFINITY, 0.0])],
        ] {
            assert!(ColorRamp::new(nodes.clone()).is_err(), "{nodes:?}");
        }
    }

    proptest! {
        #[test]
        fn bounds_hold(a in -0.5..2.0f32, b in -0.5..2.0f32, u in 0.0..=1.0f32) {
            let (low, high) = (a.min(b), a.max(b));
            let value = (low + u * (high - low)).clamp(low, high);
            prop_assert!(fire().at(value).max_element() <= fire().bound(low, high) * (1.0 + 1e-6));
        }
    }
}
