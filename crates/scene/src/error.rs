//! What can go wrong while a scene is put together, by who can act on it.

use std::fmt;
use std::path::{Path, PathBuf};

/// The place an error speaks of: a file and, when known, where in it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Place {
    /// The file, as the user named it.
    pub file: Option<PathBuf>,
    /// Line in the file, from 1.
    pub line: Option<usize>,
    /// Column in that line in characters, from 1.
    pub column: Option<usize>,
    /// JSON pointer (RFC 6901) or another name of the part, for example a node.
    pub part: Option<String>,
}

impl Place {
    /// A whole file.
    pub fn file(path: impl AsRef<Path>) -> Self {
        Self { file: Some(path.as_ref().to_owned()), ..Self::default() }
    }

    /// A named part of a file.
    pub fn part(path: impl AsRef<Path>, part: impl Into<String>) -> Self {
        Self { part: Some(part.into()), ..Self::file(path) }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}", file.display())?;
            if let Some(line) = self.line {
                write!(f, ":{line}")?;
                if let Some(column) = self.column {
                    write!(f, ":{column}")?;
                }
            }
        }
        match (&self.file, &self.part) {
            (Some(_), Some(part)) => write!(f, " ({part})"),
            (None, Some(part)) => write!(f, "{part}"),
            (None, None) => write!(f, "the scene"),
            _ => Ok(()),
        }
    }
}

/// An error of this crate; the variant says who can act, the text what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file is missing or cannot be read.
    #[error("{place}: the file cannot be read: {source}")]
    Io {
        /// The file and who asked for it.
        place: Box<Place>,
        /// What the system says.
        #[source]
        source: std::io::Error,
    },
    /// A file or a value in it breaks its format.
    #[error("{place}: {what}")]
    Invalid {
        /// Where.
        place: Box<Place>,
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The input is legal, but this version does not render it.
    #[error("{place}: {what}")]
    Unsupported {
        /// Where.
        place: Box<Place>,
        /// What is not supported.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// A name does not exist; the remedy lists the names that do.
    #[error("{place}: {what}")]
    Missing {
        /// Where the name is used.
        place: Box<Place>,
        /// What was not found.
        what: String,
        /// The names that exist.
        remedy: String,
    },
    /// An OpenVDB file cannot be read.
    #[error("{place}: the OpenVDB file cannot be used")]
    Vdb {
        /// The volume that wants it.
        place: Box<Place>,
        /// The reader's own error.
        #[source]
        source: Box<pileus_vdb::Error>,
    },
    /// A medium cannot be built from a volume.
    #[error("{place}: no medium can be made of this volume")]
    Medium {
        /// The volume.
        place: Box<Place>,
        /// The medium's own error.
        #[source]
        source: Box<pileus_media::Error>,
    },
}

impl Error {
    /// An [`Error::Invalid`] in few words.
    pub fn invalid(place: Place, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Invalid { place: Box::new(place), what: what.into(), remedy: remedy.into() }
    }

    /// An [`Error::Unsupported`] in few words.
    pub fn unsupported(place: Place, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Unsupported { place: Box::new(place), what: what.into(), remedy: remedy.into() }
    }

    /// An [`Error::Missing`] in few words.
    pub fn missing(place: Place, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Missing { place: Box::new(place), what: what.into(), remedy: remedy.into() }
    }

    /// A file that cannot be read.
    pub fn io(place: Place, source: std::io::Error) -> Self {
        Self::Io { place: Box::new(place), source }
    }

    /// An OpenVDB file that cannot be used.
    pub fn vdb(place: Place, source: pileus_vdb::Error) -> Self {
        Self::Vdb { place: Box::new(place), source: Box::new(source) }
    }

    /// A volume that makes no medium.
    pub fn medium(place: Place, source: pileus_media::Error) -> Self {
        Self::Medium { place: Box::new(place), source: Box::new(source) }
    }

    /// What the user can do about it; empty when there is nothing to add.
    pub fn remedy(&self) -> &str {
        match self {
            Self::Invalid { remedy, .. }
            | Self::Unsupported { remedy, .. }
            | Self::Missing { remedy, .. } => remedy,
            _ => "",
        }
    }

    /// What is wrong, without its place.
    pub(crate) fn what(&self) -> String {
        match self {
            Self::Invalid { what, .. }
            | Self::Unsupported { what, .. }
            | Self::Missing { what, .. } => what.clone(),
            other => other.to_string(),
        }
    }

    /// Where it happened.
    pub fn place(&self) -> &Place {
        match self {
            Self::Io { place, .. }
            | Self::Invalid { place, .. }
            | Self::Unsupported { place, .. }
            | Self::Missing { place, .. }
            | Self::Vdb { place, .. }
            | Self::Medium { place, .. } => place,
        }
    }
}
