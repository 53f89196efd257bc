//! The one error type of this crate.

use std::io;
use std::path::{Path, PathBuf};

/// What can go wrong with films and image files, by who can act on it.
///
/// Every message names the place (a file, or what was being read) and ends in the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file system refused; the cause tells whether permissions, space or the path are at
    /// fault.
    #[error("{place}: cannot {action}; check that the folder exists, is writable and has space")]
    Io {
        /// File or stream.
        place: String,
        /// What was attempted, as a verb phrase ("write the image").
        action: &'static str,
        /// The system's answer.
        source: io::Error,
    },
    /// No file of that name.
    #[error("{place}: no such file; check the path, it is relative to the working folder")]
    Missing {
        /// File that was asked for.
        place: String,
    },
    /// The content or the arguments break a rule.
    #[error("{place}: {problem}; {remedy}")]
    Invalid {
        /// File, stream or argument.
        place: String,
        /// What is wrong.
        problem: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A correct file that uses something this crate does not do.
    #[error("{place}: {problem} is not supported; {remedy}")]
    Unsupported {
        /// File or stream.
        place: String,
        /// The feature.
        problem: String,
        /// What to do about it.
        remedy: &'static str,
    },
    /// A size that exceeds a limit or the memory at hand.
    #[error("{place}: {problem}; {remedy}")]
    TooLarge {
        /// File, stream or argument.
        place: String,
        /// The size and the limit.
        problem: String,
        /// What to do about it.
        remedy: &'static str,
    },
}

impl Error {
    /// Wraps a system error; a file that is not there becomes [`Error::Missing`].
    pub(crate) fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        let place = path.display().to_string();
        Self::Io { place, action, source }
    }

    /// Wraps the failure to open an input file.
    pub(crate) fn open(path: &Path, source: io::Error) -> Self {
        if source.kind() == io::ErrorKind::NotFound {
            Self::Missing { place: path.display().to_string() }
        } else {
            Self::io(path, "open it", source)
        }
    }

    pub(crate) fn invalid(
        place: impl Into<String>,
        problem: impl Into<String>,
        remedy: &'static str,
    ) -> Self {
        Self::Invalid { place: place.into(), problem: problem.into(), remedy }
    }

    pub(crate) fn too_large(
        place: impl Into<String>,
        problem: impl Into<String>,
        remedy: &'static str,
    ) -> Self {
        Self::TooLarge { place: place.into(), problem: problem.into(), remedy }
    }

    /// This error with `path` as its place: for errors of a stream whose file the caller knows.
    #[must_use]
    pub fn in_file(mut self, path: &Path) -> Self {
        let (Self::Io { place, .. }
        | Self::Missing { place }
        | Self::Invalid { place, .. }
        | Self::Unsupported { place, .. }
        | Self::TooLarge { place, .. }) = &mut self;
        *place = path.display().to_string();
        self
    }

    /// The file, stream or argument at fault.
    pub fn place(&self) -> PathBuf {
        let (Self::Io { place, .. }
        | Self::Missing { place }
        | Self::Invalid { place, .. }
        | Self::Unsupported { place, .. }
        | Self::TooLarge { place, .. }) = self;
        PathBuf::from(place)
    }
}
