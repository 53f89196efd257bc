//! The error type of this crate.

/// Why two images cannot be measured against each other.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The images do not cover the same pixels.
    #[error(
        "the images have {} x {} and {} x {} pixels; render both at one resolution and crop window",
        a[0], a[1], b[0], b[1]
    )]
    Size {
        /// Columns and rows of the first image.
        a: [u32; 2],
        /// Columns and rows of the second image.
        b: [u32; 2],
    },
    /// An image without colour.
    #[error("the {image} has no colour that is known by name; its channels are {names}")]
    Channels {
        /// Which image.
        image: &'static str,
        /// The channels that it has.
        names: String,
    },
    /// Nothing is left to compare.
    #[error("no pixel is finite in both images; look for failed renders among them")]
    NoPixels,
    /// The noise is unknown everywhere.
    #[error(
        "no pixel is finite and of known variance in both images; \
         render with two samples per pixel or more"
    )]
    NoVariance,
    /// A number that makes no sense.
    #[error("{what}; {remedy}")]
    Argument {
        /// What is wrong.
        what: String,
        /// What to do.
        remedy: &'static str,
    },
    /// A scene could not be rendered.
    #[error(transparent)]
    Render(pileus_integrator::Error),
    /// A medium could not be made.
    #[error(transparent)]
    Media(pileus_media::Error),
    /// A scene could not be made.
    #[error(transparent)]
    Scene(pileus_scene::Error),
    /// An image could not be made.
    #[error(transparent)]
    Film(#[from] pileus_film::Error),
}
