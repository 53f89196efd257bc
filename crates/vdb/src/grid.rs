//! What a file says about a grid, and a grid that has been read.

use std::fmt;

use crate::compression::Compression;
use crate::cursor::Cursor;
use crate::error::{Error, Fault, Place};
use crate::metadata::{MetaValue, Metadata};
use crate::transform::Transform;
use crate::tree::Tree;

/// Type of the voxels of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ValueType {
    /// 32-bit float (in the file perhaps half, see [`GridInfo::saved_as_half`]).
    Float,
    /// 64-bit float.
    Double,
    /// 16-bit float, of files of version 225; read as [`Values::Float`].
    Half,
    /// 32-bit signed integer.
    Int32,
    /// 64-bit signed integer.
    Int64,
    /// Truth value.
    Bool,
    /// No value, only active or not; read as truth values.
    Mask,
    /// Three 32-bit floats.
    Vec3f,
    /// Three 64-bit floats.
    Vec3d,
    /// Three 32-bit signed integers.
    Vec3i,
    /// Another type or another tree shape than 5-4-3; it can be listed but not read.
    /// [`GridInfo::type_name`] tells.
    Other,
}

impl ValueType {
    fn from_tree_name(name: &str) -> ValueType {
        match name {
            "Tree_float_5_4_3" => ValueType::Float,
            "Tree_double_5_4_3" => ValueType::Double,
            "Tree_half_5_4_3" => ValueType::Half,
            "Tree_int32_5_4_3" => ValueType::Int32,
            "Tree_int64_5_4_3" => ValueType::Int64,
            "Tree_bool_5_4_3" => ValueType::Bool,
            "Tree_mask_5_4_3" => ValueType::Mask,
            "Tree_vec3s_5_4_3" => ValueType::Vec3f,
            "Tree_vec3d_5_4_3" => ValueType::Vec3d,
            "Tree_vec3i_5_4_3" => ValueType::Vec3i,
            _ => ValueType::Other,
        }
    }
}

impl fmt::Display for ValueType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ValueType::Float => "float",
            ValueType::Double => "double",
            ValueType::Half => "half",
            ValueType::Int32 => "int32",
            ValueType::Int64 => "int64",
            ValueType::Bool => "bool",
            ValueType::Mask => "mask",
            ValueType::Vec3f => "vec3s",
            ValueType::Vec3d => "vec3d",
            ValueType::Vec3i => "vec3i",
            ValueType::Other => "other",
        })
    }
}

/// What a grid is meant to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[expect(missing_docs, reason = "the variants are named as OpenVDB names its classes")]
pub enum GridClass {
    #[default]
    Unknown,
    LevelSet,
    FogVolume,
    Staggered,
}

impl GridClass {
    pub(crate) fn from_metadata(metadata: &Metadata) -> GridClass {
        match metadata.text("class") {
            Some("level set") => GridClass::LevelSet,
            Some("fog volume") => GridClass::FogVolume,
            Some("staggered") => GridClass::Staggered,
            _ => GridClass::Unknown,
        }
    }
}

impl fmt::Display for GridClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            GridClass::Unknown => "unknown",
            GridClass::LevelSet => "level set",
            GridClass::FogVolume => "fog volume",
            GridClass::Staggered => "staggered",
        })
    }
}

/// Everything about a grid but its voxels.
#[derive(Debug, Clone)]
pub struct GridInfo {
    /// Name, without the suffix that OpenVDB adds to equal ones.
    pub name: String,
    /// Number among the grids of this name, from 0.
    pub index: usize,
    /// Type of the voxels.
    pub value_type: ValueType,
    /// Type of the tree as the file names it, `Tree_float_5_4_3` for instance.
    pub type_name: String,
    /// What the grid is meant to be.
    pub class: GridClass,
    /// Whether floating-point voxels are stored with 16 bits.
    pub saved_as_half: bool,
    /// How the voxels are packed.
    pub compression: Compression,
    /// Name, in the form that [`VdbFile::find`](crate::VdbFile::find) takes, of the grid whose tree
    /// this one shares.
    pub instance_of: Option<String>,
    /// Metadata of the grid.
    pub metadata: Metadata,
    /// From index space to the world space of the file.
    pub transform: Transform,
    /// Whether another grid of the file has the same name.
    pub(crate) shares_name: bool,
    /// Name and parent's name as the file has them, with suffix.
    pub(crate) unique_name: String,
    pub(crate) parent_name: String,
    /// Range of the tree in the file, in bytes from its start.
    pub(crate) tree_start: u64,
    pub(crate) tree_end: u64,
    /// Where the leaf buffers begin in it, by the file; only a hint how much to read at first.
    pub(crate) leaves_start: u64,
}

/// OpenVDB puts this character and a number behind names that occur more than once.
const SUFFIX: char = '\x1e';

/// Name and number of a unique name.
pub(crate) fn split_suffix(unique: &str) -> (&str, Option<usize>) {
    match unique.split_once(SUFFIX) {
        Some((name, number)) => (name, number.parse().ok()),
        None => (unique, None),
    }
}

impl GridInfo {
    /// The name by which [`VdbFile::find`](crate::VdbFile::find) finds this grid and no other:
    /// `density`, or `density[1]` when the file has several of that name.
    pub fn full_name(&self) -> String {
        if self.shares_name { format!("{}[{}]", self.name, self.index) } else { self.name.clone() }
    }
}

/// Name, type and position of a grid as they stand in front of it.
pub(crate) struct Descriptor {
    pub(crate) unique_name: String,
    pub(crate) type_name: String,
    pub(crate) half_suffix: bool,
    pub(crate) parent_name: String,
    /// Where metadata and transform, where the leaf buffers begin, and where the grid ends, from
    /// the start of the file; zero in streams.
    pub(crate) grid_pos: i64,
    pub(crate) block_pos: i64,
    pub(crate) end_pos: i64,
    /// Where in the file these three stand.
    pub(crate) positions_at: u64,
}

impl Descriptor {
    /// Fewest bytes of a descriptor: three empty strings and three positions.
    pub(crate) const LEAST_BYTES: u64 = 36;

    pub(crate) fn read(cursor: &mut Cursor<'_>) -> Result<Descriptor, Fault> {
        let unique_name = cursor.string("the name of a grid")?;
        let mut type_name = cursor.string("the type of a grid")?;
        let parent_name = cursor.string("the parent name of a grid")?;
        let positions_at = cursor.offset();
        let grid_pos = cursor.i64("the position of a grid")?;
        let block_pos = cursor.i64("the position of the blocks of a grid")?;
        let end_pos = cursor.i64("the end of a grid")?;
        let half_suffix = type_name.ends_with("_HalfFloat");
        if half_suffix {
            type_name.truncate(type_name.len() - "_HalfFloat".len());
        }
        Ok(Descriptor {
            unique_name,
            type_name,
            half_suffix,
            parent_name,
            grid_pos,
            block_pos,
            end_pos,
            positions_at,
        })
    }

    /// Reads what stands between the descriptor and the tree. `old_zip` is the compression of files
    /// before version 222, where it is one for all grids.
    pub(crate) fn read_head(
        self,
        cursor: &mut Cursor<'_>,
        version: u32,
        old_zip: bool,
    ) -> Result<GridInfo, Fault> {
        let compression = if version >= crate::packed::MASK_COMPRESSION {
            Compression::read(cursor)?
        } else {
            Compression { zip: old_zip, ..Compression::default() }
        };
        let metadata = Metadata::read(cursor)?;
        let transform = Transform::read(cursor, version)?;
        // OpenVDB goes by the metadata; the suffix of the type name alone counts when there is
        // none.
        let saved_as_half = match metadata.get("is_saved_as_half_float") {
            Some(MetaValue::Bool(half)) => *half,
            _ => self.half_suffix,
        };
        let (name, number) = split_suffix(&self.unique_name);
        let parent = self.parent_name.as_str();
        let instance_of = (!parent.is_empty()).then(|| match split_suffix(parent) {
            (name, Some(number)) => format!("{name}[{number}]"),
            (name, None) => name.to_owned(),
        });
        Ok(GridInfo {
            name: name.to_owned(),
            index: number.unwrap_or(0),
            value_type: ValueType::from_tree_name(&self.type_name),
            class: GridClass::from_metadata(&metadata),
            saved_as_half,
            compression,
            instance_of,
            metadata,
            transform,
            shares_name: false,
            type_name: self.type_name,
            unique_name: self.unique_name,
            parent_name: self.parent_name,
            tree_start: cursor.offset(),
            tree_end: cursor.offset(),
            leaves_start: cursor.offset(),
        })
    }
}

/// A grid with its voxels.
#[derive(Debug, Clone)]
pub struct Grid {
    /// What the file says about it.
    pub info: GridInfo,
    /// Its voxels.
    pub values: Values,
}

/// The voxels of a grid, by type.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the variants are named as the types of ValueType")]
pub enum Values {
    Float(Tree<f32>),
    Double(Tree<f64>),
    Int32(Tree<i32>),
    Int64(Tree<i64>),
    Bool(Tree<bool>),
    Mask(Tree<bool>),
    Vec3f(Tree<[f32; 3]>),
    Vec3d(Tree<[f64; 3]>),
    Vec3i(Tree<[i32; 3]>),
}

impl Grid {
    /// The voxels as 32-bit floats: floats as they are, other numbers rounded to the nearest float,
    /// truth values and masks as 0 and 1.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for grids of vectors.
    pub fn to_float(self) -> Result<Tree<f32>, Error> {
        match self.values {
            Values::Float(tree) => Ok(tree),
            Values::Double(tree) => Ok(tree.map(|value| value as f32)),
            Values::Int32(tree) => Ok(tree.map(|value| value as f32)),
            Values::Int64(tree) => Ok(tree.map(|value| value as f32)),
            Values::Bool(tree) | Values::Mask(tree) => Ok(tree.map(|v| f32::from(u8::from(v)))),
            Values::Vec3f(_) | Values::Vec3d(_) | Values::Vec3i(_) => Err(Error::Unsupported {
                place: Place { grid: Some(self.info.full_name()), ..self.info.transform.place() },
                what: format!("a grid of type {} has no single number", self.info.value_type),
                remedy: "name a grid of type float, double, int32, int64, bool or mask",
            }),
        }
    }
}
