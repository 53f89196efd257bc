//! Trees of other value types with the same topology.

use crate::{Tile, Tree};
use rayon::prelude::*;

impl<T: Sync> Tree<T> {
    /// The same topology with every value mapped, e.g. one channel of a vector grid.
    pub fn map<U: Send>(&self, f: impl Fn(&T) -> U + Sync) -> Tree<U> {
        Tree {
            background: f(&self.background),
            leaves: self.leaves.clone(),
            values: self.values.par_iter().map(&f).collect(),
            tiles: self
                .tiles
                .iter()
                .map(|tile| Tile {
                    origin: tile.origin,
                    log2_size: tile.log2_size,
                    value: f(&tile.value),
                    active: tile.active,
                })
                .collect(),
        }
    }
}
