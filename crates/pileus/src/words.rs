//! Errors of the renderer in the words of jobs: its parameters are keys here.

use pileus_integrator::{Error, Parameter, Remedy};
use pileus_scene::{Error as SceneError, Hint};

use crate::failure::Failure;
use crate::settings::Settings;

/// The JSON pointer of the option that a parameter of the renderer comes from.
fn pointer(parameter: Parameter) -> &'static str {
    match parameter {
        Parameter::MaxBounces => "/sampling/max_bounces",
        Parameter::MaxEvents => "/sampling/max_events",
        Parameter::Filter => "/film/filter",
        Parameter::Transmittance => "/sampling/transmittance",
        Parameter::Distance => "/sampling/distance",
        Parameter::Majorants => "/sampling/majorants",
        Parameter::MajorantScale => "/sampling/majorant_scale",
        // A parameter that no job can set.
        _ => "/sampling",
    }
}

/// The option as people say it: `sampling.distance`.
fn key(parameter: Parameter) -> String {
    pointer(parameter).trim_start_matches('/').replace('/', ".")
}

/// What to do, in the words of jobs.
fn remedy(remedy: &Remedy) -> String {
    match remedy {
        Remedy::Set(parameter, value) => format!("set {} to \"{value}\"", key(*parameter)),
        Remedy::Limit(parameter) => format!("give the job a limit, {}", key(*parameter)),
        Remedy::Default(parameters) => {
            let keys: Vec<String> = parameters.iter().map(|p| key(*p)).collect();
            format!("leave {} out", keys.join(" and "))
        }
        Remedy::Scene(change) => (*change).to_owned(),
        other => other.to_string(),
    }
}

/// How a choice that was made while loading is made otherwise.
pub(crate) fn hint(hint: Hint) -> &'static str {
    match hint {
        Hint::OtherGrid => {
            "another grid is taken by `--grid NAME`, or by `density` of the volume in a job"
        }
        Hint::ZIsUp => {
            "z is up by `--up-axis z`, by `up_axis` of the volume in a job, or by the custom \
             property `pileus_up_axis`"
        }
        Hint::OtherCamera => {
            "another camera is taken by `--camera NAME`, or by `node` of the job's `camera`"
        }
        _ => "the job can say otherwise",
    }
}

/// An error of planning or rendering with its place in the job.
pub(crate) fn of_job(settings: &Settings, error: Error) -> Failure {
    let remedies = error.remedies().iter().map(remedy).collect::<Vec<_>>().join(", or ");
    match &error {
        Error::Parameter { parameter, value, why, .. } => {
            let what = format!("{} is {value}: {why}", key(*parameter));
            SceneError::invalid(settings.place(pointer(*parameter)), what, remedies).into()
        }
        Error::Scene { what, .. } => {
            SceneError::invalid(settings.place(""), what.clone(), remedies).into()
        }
        _ => Failure::Integrator(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::job_schema;

    /// Every parameter that the renderer names is an option of jobs.
    #[test]
    fn parameters_are_options() {
        let schema = job_schema();
        for parameter in [
            Parameter::MaxBounces,
            Parameter::MaxEvents,
            Parameter::Filter,
            Parameter::Transmittance,
            Parameter::Distance,
            Parameter::Majorants,
            Parameter::MajorantScale,
        ] {
            let (object, key) = pointer(parameter)[1..].split_once('/').unwrap();
            let definition = if object == "film" { "FilmSpec" } else { "SamplingSpec" };
            let place = format!("/$defs/{definition}/properties/{key}");
            assert!(schema.pointer(&place).is_some(), "{place}");
        }
    }
}
