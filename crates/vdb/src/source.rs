//! The bytes of a file, on disk or in memory, of which no more is held at once than needed.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::cursor::Cursor;
use crate::error::{Error, Fault, Place};

/// Bytes that are read at first to parse a header.
const HEADER_WINDOW: u64 = 1 << 14;
/// Most bytes that a header (names, metadata and transform of one grid) may take.
const LARGEST_HEADER: u64 = 1 << 27;
/// Bytes of leaf buffers that are held at once. Small enough to be reused from the cache, large
/// enough to keep all cores busy.
const LEAF_WINDOW: u64 = 1 << 20;

/// The bytes of a file, on disk or in memory.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) name: String,
    pub(crate) length: u64,
    pub(crate) data: Data,
}

#[derive(Debug)]
pub(crate) enum Data {
    Path(PathBuf),
    Memory(Vec<u8>),
}

impl Source {
    /// The bytes `start..end`, cut at the end of the file.
    pub(crate) fn range(
        &self,
        start: u64,
        end: u64,
        grid: Option<&str>,
    ) -> Result<Cow<'_, [u8]>, Error> {
        let place = || Place {
            file: self.name.clone(),
            grid: grid.map(str::to_owned),
            offset: Some(start),
        };
        match &self.data {
            Data::Memory(bytes) => {
                let at =
                    |offset: u64| usize::try_from(offset).unwrap_or(usize::MAX).min(bytes.len());
                Ok(Cow::Borrowed(bytes.get(at(start)..at(end)).unwrap_or(&[])))
            }
            Data::Path(path) => read_range(path, start, end.min(self.length)).map_or_else(
                |source| {
                    let remedy = "check that the file is still there and not being written";
                    Err(Error::Io { place: place(), source, remedy })
                },
                |bytes| Ok(Cow::Owned(bytes)),
            ),
        }
    }

    /// Parses what begins at `start`.
    pub(crate) fn parse<T>(
        &self,
        start: u64,
        grid: Option<&str>,
        read: impl FnMut(&mut Cursor<'_>) -> Result<T, Fault>,
    ) -> Result<T, Error> {
        self.parse_named(start, read).map_err(|failure| failure.into_error(&self.name, grid))
    }

    /// Parses what begins at `start`, of which only so much is read from disk as the parser turns
    /// out to need.
    pub(crate) fn parse_named<T>(
        &self,
        start: u64,
        mut read: impl FnMut(&mut Cursor<'_>) -> Result<T, Fault>,
    ) -> Result<T, Failure> {
        let left = self.length.saturating_sub(start);
        let mut window = match self.data {
            Data::Path(_) => HEADER_WINDOW.min(left),
            Data::Memory(_) => left,
        };
        loop {
            let bytes =
                self.range(start, start.saturating_add(window), None).map_err(Failure::Io)?;
            let fault = match read(&mut Cursor::new(&bytes, start)) {
                Ok(value) => return Ok(value),
                Err(fault) => fault,
            };
            match fault.needed().map(|needed| needed.saturating_sub(start)) {
                Some(needed) if needed > window && needed <= left && window < LARGEST_HEADER => {
                    window = needed.max(window.saturating_mul(4)).min(left).min(LARGEST_HEADER);
                }
                _ => return Err(Failure::Fault(fault)),
            }
        }
    }
}

/// A failure of parsing or of reading what should be parsed.
pub(crate) enum Failure {
    Fault(Fault),
    Io(Error),
}

impl Failure {
    pub(crate) fn into_error(self, file: &str, grid: Option<&str>) -> Error {
        match self {
            Failure::Fault(fault) => fault.into_error(file, grid),
            Failure::Io(error) => error,
        }
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Failure {
        Failure::Fault(fault)
    }
}

fn read_range(path: &Path, start: u64, end: u64) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    append(&file, end.saturating_sub(start), &mut bytes)?;
    Ok(bytes)
}

/// Reads `count` bytes, fewer at the end of the file, behind those that are there.
fn append(file: &File, count: u64, bytes: &mut Vec<u8>) -> io::Result<()> {
    let size = usize::try_from(count).map_err(io::Error::other)?;
    bytes.try_reserve_exact(size).map_err(io::Error::other)?;
    file.take(count).read_to_end(bytes)?;
    Ok(())
}

/// A part of a range of the file that moves towards its end. A range in memory is one window.
pub(crate) struct Window<'s> {
    source: &'s Source,
    grid: &'s str,
    /// The file, positioned behind `bytes`.
    file: Option<File>,
    bytes: Cow<'s, [u8]>,
    /// Where `bytes` begins in the file, and where the range ends.
    base: u64,
    end: u64,
}

impl<'s> Window<'s> {
    /// The window on `start..end` (cut at the end of the file) that at first shows the bytes up to
    /// `first`.
    pub(crate) fn open(
        source: &'s Source,
        grid: &'s str,
        range: std::ops::Range<u64>,
        first: u64,
    ) -> Result<Window<'s>, Error> {
        let end = range.end.min(source.length);
        let mut window =
            Window { source, grid, file: None, bytes: Cow::Borrowed(&[]), base: range.start, end };
        match &source.data {
            Data::Memory(_) => window.bytes = source.range(range.start, end, Some(grid))?,
            Data::Path(path) => {
                let open = || {
                    let mut file = File::open(path)?;
                    file.seek(SeekFrom::Start(range.start))?;
                    Ok(file)
                };
                window.file = Some(open().map_err(|error| window.failed(error))?);
                window.bytes = Cow::Owned(Vec::new());
                window.grow(first.saturating_sub(range.start))?;
            }
        }
        Ok(window)
    }

    fn failed(&self, source: io::Error) -> Error {
        let place = Place {
            file: self.source.name.clone(),
            grid: Some(self.grid.to_owned()),
            offset: Some(self.shown_end()),
        };
        let remedy = "check that the file is still there and not being written";
        Error::Io { place, source, remedy }
    }

    /// Where the shown bytes end in the file.
    fn shown_end(&self) -> u64 {
        self.base.saturating_add(self.bytes.len() as u64)
    }

    /// Where the range ends in the file.
    pub(crate) fn end(&self) -> u64 {
        self.end
    }

    /// Shows `count` more bytes, or what is left of the range.
    fn grow(&mut self, count: u64) -> Result<(), Error> {
        let count = count.min(self.end.saturating_sub(self.shown_end()));
        if let (Some(file), Cow::Owned(bytes)) = (&self.file, &mut self.bytes) {
            let before = bytes.len() as u64;
            let done = append(file, count, bytes);
            let missing = count.saturating_sub((bytes.len() as u64).saturating_sub(before));
            done.map_err(|error| self.failed(error))?;
            if missing > 0 {
                return Err(self.failed(io::ErrorKind::UnexpectedEof.into()));
            }
        }
        Ok(())
    }

    /// A cursor at a place of the file, which must be shown.
    pub(crate) fn cursor(&self, offset: u64) -> Cursor<'_> {
        let at = usize::try_from(offset.saturating_sub(self.base)).unwrap_or(usize::MAX);
        Cursor::new(&self.bytes, self.base).at(at)
    }

    /// Tries to parse from `offset` on, with more and more bytes shown as long as the parser asks
    /// for them.
    pub(crate) fn parse<T>(
        &mut self,
        offset: u64,
        mut read: impl FnMut(&mut Cursor<'_>) -> Result<T, Fault>,
    ) -> Result<T, Failure> {
        loop {
            let fault = match read(&mut self.cursor(offset)) {
                Ok(value) => return Ok(value),
                Err(fault) => fault,
            };
            if !self.can_show(&fault) {
                return Err(Failure::Fault(fault));
            }
            let needed = fault.needed().unwrap_or(0).saturating_sub(self.shown_end());
            self.grow(needed.max(3 * self.bytes.len() as u64)).map_err(Failure::Io)?;
        }
    }

    /// Whether the fault is only that bytes are not shown yet.
    pub(crate) fn can_show(&self, fault: &Fault) -> bool {
        fault.needed().is_some_and(|needed| needed > self.shown_end() && needed <= self.end)
    }

    /// Drops what is before `keep` and shows the next bytes, at least up to `needed`.
    pub(crate) fn advance(&mut self, keep: u64, needed: u64) -> Result<(), Error> {
        if let Cow::Owned(bytes) = &mut self.bytes {
            let count = usize::try_from(keep.saturating_sub(self.base)).unwrap_or(usize::MAX);
            let count = count.min(bytes.len());
            bytes.drain(..count);
            self.base += count as u64;
        }
        let missing = needed.saturating_sub(self.shown_end());
        self.grow(missing.max(LEAF_WINDOW.saturating_sub(self.bytes.len() as u64)))
    }
}
