#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod active;
mod blosc;
mod blosclz;
mod compression;
#[cfg(any(test, feature = "vdb-rs"))]
mod convert;
mod cursor;
mod error;
mod foreign;
mod grid;
mod leaves;
mod lookup;
mod metadata;
mod packed;
mod reader;
mod shuffle;
mod source;
#[cfg(test)]
mod synthetic;
mod topology;
mod transform;
mod tree;
mod value;

pub use active::ActiveValue;
pub use compression::Compression;
#[cfg(any(test, feature = "vdb-rs"))]
pub use convert::from_vdb_rs;
pub use error::{Error, Place};
pub use grid::{Grid, GridClass, GridInfo, ValueType, Values};
pub use lookup::Accessor;
pub use metadata::{MetaValue, Metadata};
pub use reader::VdbFile;
pub use transform::{Transform, TransformKind};
pub use tree::{Coord, LEAF_VALUES, Leaf, Tile, Tree};
