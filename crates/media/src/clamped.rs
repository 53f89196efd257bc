//! What a grid of numbers that must lie in a range holds beyond it.

use pileus_vdb::Tree;
use rayon::prelude::*;

/// Values of a grid that count as something else: as zero where they are not finite, as the end of
/// the range where they lie beyond it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Clamped {
    /// Values that are not finite.
    pub non_finite: u64,
    /// Finite values below the range.
    pub below: u64,
    /// Finite values above the range.
    pub above: u64,
    /// The largest finite value; zero if there is none above.
    pub largest: f32,
}

impl Clamped {
    /// What a tree of numbers holds beyond `low..=high`, the range that they belong into.
    pub fn numbers(tree: &Tree<f32>, range: (f32, f32)) -> Clamped {
        Clamped::count(tree, range, |v| [v])
    }

    /// What a tree of vectors holds beyond `low..=high`, the range that components belong into;
    /// every component counts.
    pub fn vectors(tree: &Tree<[f32; 3]>, range: (f32, f32)) -> Clamped {
        Clamped::count(tree, range, |v| v)
    }

    /// Counts voxels, tiles and the background of a tree, as `value` reads them, against
    /// `low..=high`.
    fn count<T: Copy + Sync, const N: usize>(
        tree: &Tree<T>,
        (low, high): (f32, f32),
        value: impl Fn(T) -> [f32; N] + Sync,
    ) -> Clamped {
        let of = |all: &[T]| {
            let mut found = Clamped::default();
            for number in all.iter().flat_map(|v| value(*v)) {
                found.non_finite += u64::from(!number.is_finite());
                found.below += u64::from(number.is_finite() && number < low);
                if number.is_finite() && number > high {
                    found.above += 1;
                    found.largest = found.largest.max(number);
                }
            }
            found
        };
        let voxels =
            tree.values().par_chunks(1 << 16).map(of).reduce(Clamped::default, Clamped::and);
        let tiles = tree.tiles().iter().map(|tile| of(&[tile.value]));
        tiles.fold(voxels.and(of(&[*tree.background()])), Clamped::and)
    }

    fn and(self, other: Clamped) -> Clamped {
        Clamped {
            non_finite: self.non_finite + other.non_finite,
            below: self.below + other.below,
            above: self.above + other.above,
            largest: self.largest.max(other.largest),
        }
    }
}
