//! What paths cost, expected or measured, in figures that can be compared.

use crate::counters::Counters;
use serde::Serialize;
use std::fmt;

/// Lookups and majorant steps of flights and shadow rays together, per path and per real collision.
/// Flights cross a unit of optical depth per real collision in the mean, so that the latter are
/// also per unit of optical depth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PathCost {
    /// Lookups per path.
    pub lookups_per_path: f64,
    /// Majorant steps per path.
    pub steps_per_path: f64,
    /// Real collisions per path: the optical depth that flights cross.
    pub collisions_per_path: f64,
    /// Lookups per real collision; none if nothing collided.
    pub lookups_per_collision: Option<f64>,
    /// Majorant steps per real collision; none if nothing collided.
    pub steps_per_collision: Option<f64>,
}

impl PathCost {
    /// From means per path, each finite and at least zero.
    pub(crate) fn new(lookups: f64, steps: f64, collisions: f64) -> PathCost {
        let per_collision = |n: f64| (collisions > 0.0).then(|| n / collisions);
        PathCost {
            lookups_per_path: lookups,
            steps_per_path: steps,
            collisions_per_path: collisions,
            lookups_per_collision: per_collision(lookups),
            steps_per_collision: per_collision(steps),
        }
    }

    /// What a render counted; none before its first path.
    pub fn measured(counters: &Counters) -> Option<PathCost> {
        let per_path = |n: u64| n as f64 / counters.paths as f64;
        (counters.paths > 0).then(|| {
            let Counters { lookups, majorant_steps, collisions, .. } = *counters;
            PathCost::new(per_path(lookups), per_path(majorant_steps), per_path(collisions))
        })
    }
}

impl fmt::Display for PathCost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PathCost { lookups_per_path, steps_per_path, collisions_per_path, .. } = self;
        write!(
            f,
            "{lookups_per_path:.2} lookups, {steps_per_path:.2} steps, {collisions_per_path:.2} real collisions per path"
        )?;
        if let (Some(lookups), Some(steps)) = (self.lookups_per_collision, self.steps_per_collision)
        {
            write!(f, "; {lookups:.2} lookups, {steps:.2} steps per real collision")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_become_means_and_nothing_is_divided_by_zero() {
        let counters = Counters {
            paths: 8,
            lookups: 24,
            majorant_steps: 40,
            collisions: 4,
            ..Counters::default()
        };
        let cost = PathCost::measured(&counters).unwrap();
        assert_eq!(cost, PathCost::new(3.0, 5.0, 0.5));
        assert_eq!((cost.lookups_per_collision, cost.steps_per_collision), (Some(6.0), Some(10.0)));
        assert!(cost.to_string().ends_with("6.00 lookups, 10.00 steps per real collision"));
        assert_eq!(PathCost::measured(&Counters::default()), None);
        let clear = PathCost::measured(&Counters { collisions: 0, ..counters }).unwrap();
        assert_eq!(clear.lookups_per_collision, None);
        assert!(clear.to_string().ends_with("per path"));
    }
}
