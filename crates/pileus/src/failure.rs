//! Everything that can end a command early, and the exit code of each kind.

use std::path::PathBuf;

/// Exit codes; the same numbers stand in `pileus --help`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Everything was done.
    Success = 0,
    /// The command line is wrong.
    Usage = 2,
    /// An input breaks its format or contradicts itself.
    Invalid = 3,
    /// A file is missing or cannot be read or written.
    Io = 4,
    /// The input is legal, but this version does not render it.
    Unsupported = 5,
    /// Stopped by SIGHUP, as when a terminal closes; what was rendered is written.
    HungUp = 129,
    /// Stopped by Ctrl-C; what was rendered is written.
    Interrupted = 130,
    /// Stopped by SIGTERM, as schedulers send it; what was rendered is written.
    Terminated = 143,
}

/// What ends a command early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// From the scene and everything read for it.
    #[error(transparent)]
    Scene(#[from] pileus_scene::Error),
    /// From an OpenVDB file.
    #[error(transparent)]
    Vdb(#[from] pileus_vdb::Error),
    /// From a medium.
    #[error(transparent)]
    Media(#[from] pileus_media::Error),
    /// From images.
    #[error(transparent)]
    Film(#[from] pileus_film::Error),
    /// From planning and rendering.
    #[error(transparent)]
    Integrator(#[from] pileus_integrator::Error),
    /// From measuring images.
    #[cfg(feature = "lab")]
    #[error(transparent)]
    Lab(#[from] pileus_lab::Error),
    /// The command line asks for something impossible.
    #[error("{what}")]
    Usage {
        /// What is wrong.
        what: String,
        /// What to do about it.
        remedy: String,
    },
    /// A file cannot be read or written.
    #[error("{}: {what}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was attempted.
        what: String,
        /// What the system says.
        #[source]
        source: std::io::Error,
    },
    /// A file is compared that is no picture.
    #[cfg(feature = "lab")]
    #[error("{}: it has no colour that is known by name; its channels are {names}", path.display())]
    NoColor {
        /// The file.
        path: PathBuf,
        /// The channels that it has.
        names: String,
    },
    /// Results cannot be printed.
    #[error("standard output cannot be written: {0}")]
    Output(std::io::Error),
    /// A signal.
    #[error("{what}")]
    Interrupted {
        /// What was done until then.
        what: String,
        /// The exit code that tells which signal it was.
        exit: Exit,
    },
}

impl Failure {
    /// A wrong command line.
    pub fn usage(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Usage { what: what.into(), remedy: remedy.into() }
    }

    /// The exit code of this kind of failure.
    pub fn exit(&self) -> Exit {
        match self {
            Self::Scene(error) => scene_exit(error),
            Self::Vdb(error) => vdb_exit(error),
            Self::Media(error) => media_exit(error),
            Self::Film(error) | Self::Integrator(pileus_integrator::Error::Memory(error)) => {
                film_exit(error)
            }
            #[cfg(feature = "lab")]
            Self::Lab(pileus_lab::Error::Film(error)) => film_exit(error),
            #[cfg(feature = "lab")]
            Self::Lab(_) | Self::NoColor { .. } => Exit::Invalid,
            Self::Integrator(_) => Exit::Invalid,
            Self::Usage { .. } => Exit::Usage,
            Self::Io { .. } | Self::Output(_) => Exit::Io,
            Self::Interrupted { exit, .. } => *exit,
        }
    }

    /// What the user can do about it; empty if the message says so already.
    pub fn remedy(&self) -> &str {
        match self {
            Self::Scene(error) => error.remedy(),
            Self::Usage { remedy, .. } => remedy,
            #[cfg(feature = "lab")]
            Self::NoColor { .. } => {
                "compare the image itself, or rename its channels to R, G and B"
            }
            _ => "",
        }
    }
}

fn film_exit(error: &pileus_film::Error) -> Exit {
    use pileus_film::Error as Film;
    match error {
        Film::Io { .. } | Film::Missing { .. } => Exit::Io,
        Film::Unsupported { .. } => Exit::Unsupported,
        _ => Exit::Invalid,
    }
}

fn scene_exit(error: &pileus_scene::Error) -> Exit {
    use pileus_scene::Error as Scene;
    match error {
        Scene::Io { .. } => Exit::Io,
        Scene::Unsupported { .. } => Exit::Unsupported,
        Scene::Vdb { source, .. } => vdb_exit(source),
        Scene::Medium { source, .. } => media_exit(source),
        _ => Exit::Invalid,
    }
}

fn vdb_exit(error: &pileus_vdb::Error) -> Exit {
    match error {
        pileus_vdb::Error::Io { .. } => Exit::Io,
        pileus_vdb::Error::Unsupported { .. } => Exit::Unsupported,
        _ => Exit::Invalid,
    }
}

fn media_exit(error: &pileus_media::Error) -> Exit {
    match error {
        pileus_media::Error::Unsupported { .. } => Exit::Unsupported,
        _ => Exit::Invalid,
    }
}
