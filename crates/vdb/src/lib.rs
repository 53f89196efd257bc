//! Reads OpenVDB files into sparse trees.
#![forbid(unsafe_code)]

mod tree;

pub use tree::{Coord, LEAF_VALUES, Leaf, Tile, Tree};
