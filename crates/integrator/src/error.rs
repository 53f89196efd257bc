//! Why a scene cannot be rendered.

/// Errors of planning and rendering.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The settings ask for what this version does not have.
    #[error("{what}; {remedy}")]
    Unsupported {
        /// What is not supported.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// The film has no memory for the samples of a pass.
    #[error(transparent)]
    Film(#[from] pileus_film::Error),
    /// The settings contradict themselves or the film.
    #[error("{what}; {remedy}")]
    Invalid {
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
}
