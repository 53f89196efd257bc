//! Why a scene cannot be rendered.

use std::fmt;

/// A field of [`RenderSettings`](crate::RenderSettings) that an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Parameter {
    /// Most scattering events on a path.
    MaxBounces,
    /// Most events of any kind on a path.
    MaxEvents,
    /// The pixel filter.
    Filter,
    /// How transmittance is estimated.
    Transmittance,
    /// How distances are sampled.
    Distance,
    /// How grids are partitioned for their majorants.
    Majorants,
    /// Factor on the majorants of grids.
    MajorantScale,
}

impl Parameter {
    /// The name of the field.
    pub const fn name(self) -> &'static str {
        match self {
            Parameter::MaxBounces => "max_bounces",
            Parameter::MaxEvents => "max_events",
            Parameter::Filter => "filter",
            Parameter::Transmittance => "transmittance",
            Parameter::Distance => "distance",
            Parameter::Majorants => "majorants",
            Parameter::MajorantScale => "majorant_scale",
        }
    }
}

impl fmt::Display for Parameter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One way out of an error.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Remedy {
    /// Give a parameter this value.
    Set(Parameter, &'static str),
    /// Give a parameter that is unlimited a limit.
    Limit(Parameter),
    /// Leave these parameters to the plan, which finds what holds.
    Default(&'static [Parameter]),
    /// Change the scene, in words.
    Scene(&'static str),
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Remedy::Set(parameter, value) => write!(f, "set {parameter} to {value}"),
            Remedy::Limit(parameter) => write!(f, "set {parameter}"),
            Remedy::Default(parameters) => {
                let names: Vec<&str> = parameters.iter().map(|p| p.name()).collect();
                write!(f, "leave {} to the plan", names.join(" and "))
            }
            Remedy::Scene(change) => f.write_str(change),
        }
    }
}

/// Errors of planning and rendering.
///
/// Parameters are named as the fields of [`RenderSettings`](crate::RenderSettings); programs that
/// call them otherwise translate [`Error::parameter`] and [`Error::remedies`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter has a value that it cannot have, or that this scene does not allow.
    #[error("{parameter} is {value}: {why}")]
    Parameter {
        /// Which one.
        parameter: Parameter,
        /// The value that it has.
        value: String,
        /// Why that cannot be.
        why: String,
        /// What to do about it, any of these.
        remedies: Vec<Remedy>,
    },
    /// The scene cannot be rendered, whatever the methods.
    #[error("{what}")]
    Scene {
        /// What is wrong with it.
        what: String,
        /// What to do about it, any of these.
        remedies: Vec<Remedy>,
    },
    /// The film has no memory for the samples of a pass.
    #[error(transparent)]
    Memory(#[from] pileus_film::Error),
    /// The film is not one for this scene.
    #[error("{what}")]
    Film {
        /// What is wrong with it.
        what: String,
    },
}

impl Error {
    /// The parameter that has to change; `None` if it is none.
    pub fn parameter(&self) -> Option<Parameter> {
        match self {
            Error::Parameter { parameter, .. } => Some(*parameter),
            Error::Scene { .. } | Error::Memory(_) | Error::Film { .. } => None,
        }
    }

    /// What to do about it, any of these; may be empty.
    pub fn remedies(&self) -> &[Remedy] {
        match self {
            Error::Parameter { remedies, .. } | Error::Scene { remedies, .. } => remedies,
            Error::Memory(_) | Error::Film { .. } => &[],
        }
    }
}
