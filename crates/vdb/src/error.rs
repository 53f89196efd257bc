//! What can go wrong while reading, and where in the file it did.

use std::fmt;

use thiserror::Error;

/// Where an error happened: file, grid when one is concerned, byte offset from the start of the
/// file when one is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// Path of the file, or the name given to [`VdbFile::from_bytes`](crate::VdbFile::from_bytes).
    pub file: String,
    /// Name of the grid as [`VdbFile::find`](crate::VdbFile::find) takes it.
    pub grid: Option<String>,
    /// Bytes from the start of the file.
    pub offset: Option<u64>,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if let Some(grid) = &self.grid {
            write!(f, ": grid \"{}\"", shown(grid))?;
        }
        if let Some(offset) = self.offset {
            write!(f, ": byte {offset}")?;
        }
        Ok(())
    }
}

/// A name from a file for a message: control characters escaped, cut after 80.
pub(crate) fn shown(name: &str) -> String {
    let more = if name.chars().nth(80).is_some() { "..." } else { "" };
    name.chars().take(80).flat_map(char::escape_debug).chain(more.chars()).collect()
}

/// Any failure of this crate. The kinds say who can act: the system, the author of the file, we, or
/// the caller.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system could not open or read the file.
    #[error("{place}: cannot be read: {source}; {remedy}")]
    Io {
        /// File and byte range start.
        place: Place,
        /// What the system said.
        source: std::io::Error,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The bytes contradict the format: the file is damaged, cut off or no VDB file.
    #[error("{place}: {what}; {remedy}")]
    Invalid {
        /// Where the contradiction was met.
        place: Place,
        /// What contradicts the format.
        what: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// The file is (as far as seen) sound, but uses something this crate does not read.
    #[error("{place}: {what}; {remedy}")]
    Unsupported {
        /// Where it is used.
        place: Place,
        /// What is not supported.
        what: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A name or number that was asked for does not exist; `what` lists those that do.
    #[error("{place}: {what}; {remedy}")]
    Missing {
        /// The file that was searched.
        place: Place,
        /// What was asked for and what exists.
        what: String,
        /// What to do about it.
        remedy: &'static str,
    },
}

impl Error {
    /// File, grid and byte offset of the failure.
    pub fn place(&self) -> &Place {
        match self {
            Error::Io { place, .. }
            | Error::Invalid { place, .. }
            | Error::Unsupported { place, .. }
            | Error::Missing { place, .. } => place,
        }
    }

    /// What to do about it, one clause.
    pub fn remedy(&self) -> &'static str {
        match self {
            Error::Io { remedy, .. }
            | Error::Invalid { remedy, .. }
            | Error::Unsupported { remedy, .. }
            | Error::Missing { remedy, .. } => remedy,
        }
    }
}

/// Remedy for damaged files.
pub(crate) const REWRITE: &str = "the file is damaged or cut off, write or copy it again";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FaultKind {
    Invalid,
    Unsupported,
    /// More bytes are needed, up to this offset from the start of the file.
    Truncated {
        needed: u64,
    },
}

/// An error of a parser, which knows the byte offset but neither file nor grid. Boxed because
/// results of this type are passed around in hot loops.
#[derive(Debug)]
pub(crate) struct Fault(Box<FaultParts>);

#[derive(Debug)]
struct FaultParts {
    kind: FaultKind,
    offset: u64,
    what: String,
    remedy: &'static str,
}

impl Fault {
    fn new(kind: FaultKind, offset: u64, what: String, remedy: &'static str) -> Fault {
        Fault(Box::new(FaultParts { kind, offset, what, remedy }))
    }

    pub(crate) fn invalid(offset: u64, what: impl Into<String>) -> Fault {
        Fault::new(FaultKind::Invalid, offset, what.into(), REWRITE)
    }

    /// An invalid file that was not damaged on its way, but written so.
    pub(crate) fn invalid_with(
        offset: u64,
        what: impl Into<String>,
        remedy: &'static str,
    ) -> Fault {
        Fault::new(FaultKind::Invalid, offset, what.into(), remedy)
    }

    pub(crate) fn unsupported(offset: u64, what: impl Into<String>, remedy: &'static str) -> Fault {
        Fault::new(FaultKind::Unsupported, offset, what.into(), remedy)
    }

    pub(crate) fn truncated(offset: u64, needed: u64, what: impl Into<String>) -> Fault {
        Fault::new(FaultKind::Truncated { needed }, offset, what.into(), REWRITE)
    }

    /// Offset up to which bytes would have been needed, if that is the trouble.
    pub(crate) fn needed(&self) -> Option<u64> {
        match self.0.kind {
            FaultKind::Truncated { needed } => Some(needed),
            _ => None,
        }
    }

    pub(crate) fn into_error(self, file: &str, grid: Option<&str>) -> Error {
        let FaultParts { kind, offset, what, remedy } = *self.0;
        let place =
            Place { file: file.into(), grid: grid.map(str::to_owned), offset: Some(offset) };
        match kind {
            FaultKind::Invalid | FaultKind::Truncated { .. } => {
                Error::Invalid { place, what, remedy }
            }
            FaultKind::Unsupported => Error::Unsupported { place, what, remedy },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_names_file_grid_and_byte() {
        let error = Fault::invalid(77, "a count is negative").into_error("a.vdb", Some("density"));
        let text = error.to_string();
        assert!(text.starts_with("a.vdb: grid \"density\": byte 77: a count is negative; "));
        assert_eq!(error.place().offset, Some(77));
    }

    #[test]
    fn names_are_shown_safely() {
        assert_eq!(shown("Dichte-üß 雲"), "Dichte-üß 雲");
        assert_eq!(shown("a\u{1e}\u{1b}[2J"), "a\\u{1e}\\u{1b}[2J");
        assert_eq!(shown(&"x".repeat(99)).len(), 83);
    }

    #[test]
    fn results_stay_small() {
        assert_eq!(size_of::<Result<(), Fault>>(), size_of::<usize>());
        assert!(size_of::<Error>() < 128);
    }
}
