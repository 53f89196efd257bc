//! Opens files: header, list of grids, and the trees that are asked for.

use std::io;
use std::path::Path;

use half::f16;

use crate::cursor::Cursor;
use crate::error::{Error, Fault, Place, REWRITE, shown};
use crate::foreign;
use crate::grid::{Descriptor, Grid, GridInfo, ValueType, Values, split_suffix};
use crate::leaves::{self, LeafLayout};
use crate::metadata::Metadata;
use crate::packed::Encoding;
use crate::source::{Data, Failure, Source, Window};
use crate::topology;
use crate::tree::Tree;
use crate::value::Value;

/// `VDB ` read as a little-endian number, with four zero bytes behind it.
const MAGIC: i64 = 0x5644_4220;
/// Versions of the file format that are read: from compression per file to half grids.
const VERSIONS: std::ops::RangeInclusive<u32> = 220..=225;

/// An OpenVDB file: its header and what it says about its grids. Voxels are read by
/// [`VdbFile::read`].
#[derive(Debug)]
pub struct VdbFile {
    source: Source,
    header: Header,
    grids: Vec<GridInfo>,
}

#[derive(Debug, Clone)]
struct Header {
    version: u32,
    library: (u32, u32),
    has_offsets: bool,
    old_zip: bool,
    metadata: Metadata,
    grid_count: u32,
    /// Where the first grid begins.
    end: u64,
}

impl Header {
    fn read(cursor: &mut Cursor<'_>) -> Result<Header, Fault> {
        let mut start = cursor.at(0);
        if cursor.i64("the magic number").ok() != Some(MAGIC) {
            let bytes = start.take(start.remaining(), "the file")?;
            return Err(foreign::fault(bytes));
        }
        let start = cursor.offset();
        let version = cursor.u32("the version")?;
        if !VERSIONS.contains(&version) {
            return Err(Fault::unsupported(
                start,
                format!("the file has format version {version}, this crate reads 220 to 225"),
                "write the file again with OpenVDB 3 to 13",
            ));
        }
        let library = (cursor.u32("the library version")?, cursor.u32("the library version")?);
        let has_offsets = cursor.u8("the offset flag")? != 0;
        let old_zip = version < 222 && cursor.u8("the compression flag")? != 0;
        cursor.take(36, "the identifier of the file")?;
        let metadata = Metadata::read(cursor)?;
        let start = cursor.offset();
        let count = cursor.i32("the number of grids")?;
        let Ok(grid_count) = u32::try_from(count) else {
            return Err(Fault::invalid(start, format!("the number of grids is {count}")));
        };
        let end = cursor.offset();
        Ok(Header { version, library, has_offsets, old_zip, metadata, grid_count, end })
    }
}

impl VdbFile {
    /// Reads header and grid list of a file, not its voxels. The file is opened again for each grid
    /// that is read, so it must not change meanwhile. Only a file without grid offsets (one written
    /// to a stream) is read whole and kept in memory.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read; [`Error::Unsupported`] when it is no VDB file or
    /// of another format version than 220 to 225; [`Error::Invalid`] when header, metadata or
    /// transforms are damaged.
    pub fn open(path: impl AsRef<Path>) -> Result<VdbFile, Error> {
        let path = path.as_ref().to_owned();
        let place = Place { file: path.display().to_string(), grid: None, offset: None };
        let length = std::fs::metadata(&path).and_then(|meta| {
            if meta.is_file() { Ok(meta.len()) } else { Err(io::Error::other("not a file")) }
        });
        match length {
            Ok(length) => VdbFile::new(Source { name: place.file, length, data: Data::Path(path) }),
            Err(source) => {
                let remedy = "check the path and its permissions";
                Err(Error::Io { place, source, remedy })
            }
        }
    }

    /// Opens a file that is in memory: reads the header and what it says of each grid, no voxels.
    /// `name` stands for its path in errors.
    ///
    /// # Errors
    /// If it is no VDB file, or one of a version that is not read, or if header, metadata or
    /// transforms are damaged.
    pub fn from_bytes(name: impl Into<String>, bytes: Vec<u8>) -> Result<VdbFile, Error> {
        let length = bytes.len() as u64;
        VdbFile::new(Source { name: name.into(), length, data: Data::Memory(bytes) })
    }

    fn new(mut source: Source) -> Result<VdbFile, Error> {
        let header = source.parse(0, None, Header::read)?;
        let grids = if header.has_offsets {
            list_by_offsets(&source, &header)?
        } else {
            let bytes = source.range(0, source.length, None)?.into_owned();
            source.data = Data::Memory(bytes);
            list_by_scanning(&source, &header)?
        };
        Ok(VdbFile { grids: number_names(grids, &source.name), source, header })
    }

    /// Version of the file format, 220 to 225.
    pub fn version(&self) -> u32 {
        self.header.version
    }

    /// Major and minor version of the library that wrote the file.
    pub fn library_version(&self) -> (u32, u32) {
        self.header.library
    }

    /// Metadata of the file.
    pub fn metadata(&self) -> &Metadata {
        &self.header.metadata
    }

    /// The grids, in the order of the file.
    pub fn grids(&self) -> &[GridInfo] {
        &self.grids
    }

    /// Position in [`VdbFile::grids`] of the grid of that name. `density` finds the first of
    /// several, `density[1]` the one with that number; a name that itself ends in brackets is found
    /// too and goes first.
    ///
    /// # Errors
    /// [`Error::Missing`], which lists the names that exist.
    pub fn find(&self, name: &str) -> Result<usize, Error> {
        let first = |(_, grid): &(usize, &GridInfo)| grid.name == name;
        let plain = self.grids.iter().enumerate().filter(first).min_by_key(|(_, g)| g.index);
        if let Some((position, _)) = plain {
            return Ok(position);
        }
        let numbered = name.strip_suffix(']').and_then(|rest| rest.rsplit_once('['));
        if let Some((base, number)) = numbered
            && let Ok(number) = number.parse::<usize>()
            && let Some(position) =
                self.grids.iter().position(|grid| grid.name == base && grid.index == number)
        {
            return Ok(position);
        }
        let names: Vec<String> =
            self.grids.iter().map(|grid| format!("\"{}\"", shown(&grid.full_name()))).collect();
        let names = if names.is_empty() { "no grid".into() } else { names.join(", ") };
        Err(Error::Missing {
            place: Place { file: self.source.name.clone(), grid: None, offset: None },
            what: format!("there is no grid \"{}\", the file has {names}", shown(name)),
            remedy: "name one of these grids",
        })
    }

    /// Reads the voxels of the grid at a position of [`VdbFile::grids`]: its bytes once, decoded on
    /// the current rayon pool.
    ///
    /// Takes 512 values per leaf and little else, for the bytes pass through a window of 1 MiB. An
    /// instance reads the tree of its parent. A frustum transform is no obstacle here, only to
    /// [`Transform::matrix`](crate::Transform::matrix).
    ///
    /// # Errors
    /// [`Error::Missing`] when there is no such position; [`Error::Unsupported`] for other voxel
    /// types than those of [`Values`]; [`Error::Invalid`] when the bytes are damaged;
    /// [`Error::Io`].
    pub fn read(&self, grid: usize) -> Result<Grid, Error> {
        let Some(info) = self.grids.get(grid) else {
            return Err(Error::Missing {
                place: Place { file: self.source.name.clone(), grid: None, offset: None },
                what: format!("there is no grid number {grid}, the file has {}", self.grids.len()),
                remedy: "take a position that `find` returns",
            });
        };
        let name = info.full_name();
        let owner = self.tree_owner(info)?;
        let range = owner.tree_start..owner.tree_end;
        let mut window = Window::open(&self.source, &name, range, owner.leaves_start)?;
        let values = read_values(&mut window, owner, self.header.version)
            .map_err(|failure| failure.into_error(&self.source.name, Some(&name)))?;
        Ok(Grid { info: info.clone(), values })
    }

    /// The grid whose tree this one uses: itself, or the end of its chain of parents.
    fn tree_owner<'s>(&'s self, info: &'s GridInfo) -> Result<&'s GridInfo, Error> {
        let fail = |what: String| Error::Invalid {
            place: Place {
                file: self.source.name.clone(),
                grid: Some(info.full_name()),
                offset: Some(info.tree_start),
            },
            what,
            remedy: REWRITE,
        };
        let mut owner = info;
        for _ in 0..self.grids.len() {
            if owner.parent_name.is_empty() {
                if owner.type_name != info.type_name {
                    let what = format!(
                        "an instance of type {} has a parent of type {}",
                        info.type_name, owner.type_name
                    );
                    return Err(fail(what));
                }
                return Ok(owner);
            }
            let parent = self.grids.iter().find(|grid| grid.unique_name == owner.parent_name);
            let Some(parent) = parent else {
                let (name, _) = split_suffix(&owner.parent_name);
                return Err(fail(format!(
                    "the grid shares the tree of \"{name}\", which is missing"
                )));
            };
            owner = parent;
        }
        Err(fail("the grid shares a tree with itself in a circle".into()))
    }
}

/// Reads the tree that begins at the start of the grid's range.
fn read_values(window: &mut Window<'_>, info: &GridInfo, version: u32) -> Result<Values, Failure> {
    let start = info.tree_start;
    let encoding = Encoding { version, compression: info.compression, half: info.saved_as_half };
    Ok(match info.value_type {
        ValueType::Float => Values::Float(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Double => {
            Values::Double(read_tree(window, start, &encoding, LeafLayout::Packed)?)
        }
        ValueType::Half => {
            let tree = read_tree::<f16>(window, start, &encoding, LeafLayout::Packed)?;
            Values::Float(tree.map(f16::to_f32))
        }
        ValueType::Int32 => Values::Int32(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Int64 => Values::Int64(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Bool => Values::Bool(read_tree(window, start, &encoding, LeafLayout::Bits)?),
        ValueType::Mask => Values::Mask(read_tree(window, start, &encoding, LeafLayout::Mask)?),
        ValueType::Vec3f => Values::Vec3f(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Vec3d => Values::Vec3d(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Vec3i => Values::Vec3i(read_tree(window, start, &encoding, LeafLayout::Packed)?),
        ValueType::Other => return Err(unknown_type(start, info).into()),
    })
}

fn read_tree<V: Value>(
    window: &mut Window<'_>,
    start: u64,
    encoding: &Encoding,
    layout: LeafLayout,
) -> Result<Tree<V>, Failure> {
    let (topology, leaves_start) = window.parse(start, |cursor| {
        let topology = topology::read::<V>(cursor, encoding)?;
        Ok((topology, cursor.offset()))
    })?;
    leaves::read(window, leaves_start, encoding, layout, topology)
}

/// Steps over the tree that begins at the cursor.
fn skip_values(cursor: &mut Cursor<'_>, info: &GridInfo, version: u32) -> Result<(), Fault> {
    fn skip<V: Value>(c: &mut Cursor<'_>, e: &Encoding, layout: LeafLayout) -> Result<(), Fault> {
        let topology = topology::read::<V>(c, e)?;
        topology
            .leaves
            .iter()
            .try_for_each(|leaf| leaves::step_over(c, e, layout, topology.background, leaf))
    }
    let encoding = Encoding { version, compression: info.compression, half: info.saved_as_half };
    match info.value_type {
        ValueType::Float => skip::<f32>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Double => skip::<f64>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Half => skip::<f16>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Int32 => skip::<i32>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Int64 => skip::<i64>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Bool => skip::<bool>(cursor, &encoding, LeafLayout::Bits),
        ValueType::Mask => skip::<bool>(cursor, &encoding, LeafLayout::Mask),
        ValueType::Vec3f => skip::<[f32; 3]>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Vec3d => skip::<[f64; 3]>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Vec3i => skip::<[i32; 3]>(cursor, &encoding, LeafLayout::Packed),
        ValueType::Other => Err(unknown_type(cursor.offset(), info)),
    }
}

fn unknown_type(offset: u64, info: &GridInfo) -> Fault {
    Fault::unsupported(
        offset,
        format!("the grid has the type \"{}\"", shown(&info.type_name)),
        "write the grid with a float, double, int, bool, mask or vec3 tree of shape 5-4-3",
    )
}

/// Lists the grids of a file that says where each begins and ends.
fn list_by_offsets(source: &Source, header: &Header) -> Result<Vec<GridInfo>, Error> {
    let mut grids = Vec::new();
    let mut at = header.end;
    for number in 0..header.grid_count {
        let left = u64::from(header.grid_count - number).saturating_mul(Descriptor::LEAST_BYTES);
        if left > source.length.saturating_sub(at) {
            let what = format!(
                "{} more grids are announced, only {} bytes are left",
                header.grid_count - number,
                source.length.saturating_sub(at)
            );
            return Err(Fault::invalid(at, what).into_error(&source.name, None));
        }
        let mut name = None;
        let read = |cursor: &mut Cursor<'_>| {
            let descriptor = Descriptor::read(cursor)?;
            name = Some(split_suffix(&descriptor.unique_name).0.to_owned());
            let (end, positions_at) = (descriptor.end_pos, descriptor.positions_at);
            let blocks = u64::try_from(descriptor.block_pos).unwrap_or(0);
            let gap = checked_gap(cursor, &descriptor, source.length)?;
            cursor.take(gap, "the space before a grid")?;
            let mut info = descriptor.read_head(cursor, header.version, header.old_zip)?;
            match u64::try_from(end) {
                Ok(end) if end >= info.tree_start && end <= source.length => {
                    info.tree_end = end;
                    info.leaves_start = blocks.clamp(info.tree_start, end);
                }
                _ => {
                    let what = format!(
                        "the grid ends at byte {end}, outside the {} bytes of the file",
                        source.length
                    );
                    return Err(Fault::invalid(positions_at + 16, what));
                }
            }
            Ok(info)
        };
        let info = source.parse_named(at, read);
        let info = info.map_err(|fault| fault.into_error(&source.name, name.as_deref()))?;
        at = info.tree_end;
        grids.push(info);
    }
    Ok(grids)
}

/// Bytes between a descriptor and the grid it announces, zero in all files that OpenVDB writes.
fn checked_gap(cursor: &Cursor<'_>, descriptor: &Descriptor, length: u64) -> Result<usize, Fault> {
    let gap = u64::try_from(descriptor.grid_pos)
        .ok()
        .filter(|position| *position <= length)
        .and_then(|position| position.checked_sub(cursor.offset()))
        .and_then(|gap| usize::try_from(gap).ok());
    gap.ok_or_else(|| {
        let what = format!(
            "the grid begins at byte {}, which is not behind its descriptor or past the file's end",
            descriptor.grid_pos
        );
        Fault::invalid(descriptor.positions_at, what)
    })
}

/// Lists the grids of a stream, whose positions show only by reading over each of them.
fn list_by_scanning(source: &Source, header: &Header) -> Result<Vec<GridInfo>, Error> {
    let bytes = source.range(header.end, source.length, None)?;
    let mut cursor = Cursor::new(&bytes, header.end);
    let mut grids = Vec::new();
    let count = u64::from(header.grid_count);
    let mut name = None;
    let mut scan = || -> Result<(), Fault> {
        cursor.check_count(count, Descriptor::LEAST_BYTES, "grids")?;
        for _ in 0..count {
            name = None;
            let descriptor = Descriptor::read(&mut cursor)?;
            name = Some(split_suffix(&descriptor.unique_name).0.to_owned());
            let mut info = descriptor.read_head(&mut cursor, header.version, header.old_zip)?;
            if info.parent_name.is_empty() {
                skip_values(&mut cursor, &info, header.version)?;
            }
            info.tree_end = cursor.offset();
            grids.push(info);
        }
        Ok(())
    };
    let done = scan();
    done.map_err(|fault| fault.into_error(&source.name, name.as_deref()))?;
    Ok(grids)
}

/// Gives grids of equal names their numbers: those of the file if they differ, else by order.
fn number_names(mut grids: Vec<GridInfo>, file: &str) -> Vec<GridInfo> {
    let mut groups: std::collections::HashMap<String, Vec<usize>> = Default::default();
    for (position, grid) in grids.iter().enumerate() {
        groups.entry(grid.name.clone()).or_default().push(position);
    }
    for members in groups.values().filter(|members| members.len() > 1) {
        let mut numbers: Vec<Option<usize>> =
            members.iter().map(|m| split_suffix(&grids[*m].unique_name).1).collect();
        numbers.sort_unstable();
        let usable =
            numbers.iter().all(Option::is_some) && numbers.windows(2).all(|w| w[0] != w[1]);
        for (order, member) in members.iter().enumerate() {
            let grid = &mut grids[*member];
            grid.shares_name = true;
            if !usable {
                grid.index = order;
            }
        }
    }
    for grid in &mut grids {
        if !grid.shares_name {
            grid.index = 0;
        }
        let name = grid.full_name();
        grid.transform.name_place(file, &name);
    }
    grids
}
