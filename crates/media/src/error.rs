//! Why a medium cannot be built.

/// Errors of this crate; each says what was wrong with the input and what to do.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The input is not a valid medium.
    #[error("{what}; {remedy}")]
    Invalid {
        /// What was wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The input is valid, but this version cannot represent it.
    #[error("{what}; {remedy}")]
    Unsupported {
        /// What is not supported.
        what: String,
        /// What to do about it.
        remedy: String,
    },
}

impl Error {
    pub(crate) fn invalid(what: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::Invalid { what: what.into(), remedy: remedy.into() }
    }
    pub(crate) fn unsupported(what: impl Into<String>, remedy: impl Into<String>) -> Error {
        Error::Unsupported { what: what.into(), remedy: remedy.into() }
    }
}
