//! From what a user wrote about a transmittance function to the function.

use std::path::Path;
use std::sync::Arc;

use pileus_media::transmittance_function::{
    Component, DavisWeinstein, Erlang, Linear, Mixture, Power, Table, TransmittanceFunction,
};

use crate::error::{Error, Place};
use crate::file;
use crate::spec::volume_spec::{TransmittanceFunctionSpec, VolumeSpec};

/// Largest file of a tabulated transmittance function, bytes.
const MAX_TABLE: u64 = 4 << 20;

/// The transmittance function of a volume; `None` is the exponential one.
pub(crate) fn transmittance_function(
    spec: &VolumeSpec,
    place: &dyn Fn(&str) -> Place,
) -> Result<Option<Arc<TransmittanceFunction>>, Error> {
    let function = match (&spec.law, &spec.law_mixture) {
        (Some(_), Some(_)) => {
            return Err(Error::invalid(
                place("/law_mixture"),
                "the volume has both `law` and `law_mixture`",
                "keep one; a transmittance function can be a component of the mixture",
            ));
        }
        (Some(one), None) => single(one, "/law", place)?,
        (None, Some(components)) => {
            let mut functions = Vec::with_capacity(components.len());
            for (i, component) in components.iter().enumerate() {
                functions.push(Component {
                    weight: component.weight,
                    rate: component.rate(),
                    function: single(&component.law, &format!("/law_mixture/{i}/law"), place)?,
                });
            }
            let mixture =
                Mixture::new(functions).map_err(|source| at(place("/law_mixture"), source))?;
            Some(TransmittanceFunction::Mixture(mixture))
        }
        (None, None) => None,
    };
    Ok(function.map(Arc::new))
}

fn single(
    spec: &TransmittanceFunctionSpec,
    key: &str,
    place: &dyn Fn(&str) -> Place,
) -> Result<Option<TransmittanceFunction>, Error> {
    let wrong = |source| at(place(key), source);
    Ok(Some(match spec {
        TransmittanceFunctionSpec::Exponential {} => return Ok(None),
        TransmittanceFunctionSpec::Power { k } => {
            TransmittanceFunction::Power(Power::new(*k).map_err(wrong)?)
        }
        TransmittanceFunctionSpec::DavisWeinstein { h, c } => {
            TransmittanceFunction::DavisWeinstein(DavisWeinstein::new(*h, *c).map_err(wrong)?)
        }
        TransmittanceFunctionSpec::Erlang { n } => {
            TransmittanceFunction::Erlang(Erlang::new(*n).map_err(wrong)?)
        }
        TransmittanceFunctionSpec::Linear {} => TransmittanceFunction::Linear(Linear),
        TransmittanceFunctionSpec::Table { file } => {
            TransmittanceFunction::Table(table(Path::new(file), &|| place(&format!("{key}/file")))?)
        }
    }))
}

fn table(path: &Path, asked_at: &dyn Fn() -> Place) -> Result<Table, Error> {
    // The file that is not there, and who named it.
    let asked = || Place::part(path, format!("named at {}", asked_at()));
    let bytes = file::read(path, MAX_TABLE + 1).map_err(|source| Error::io(asked(), source))?;
    if bytes.len() as u64 > MAX_TABLE {
        return Err(Error::unsupported(
            asked(),
            format!("the table is larger than {MAX_TABLE} bytes"),
            "give a text file with an optical depth and a transmittance on each line",
        ));
    }
    let text = std::str::from_utf8(crate::file::text_file(&bytes))
        .map_err(|_| Error::invalid(asked(), "the text is not UTF-8", "save it as UTF-8"))?;
    Table::parse(text).map_err(|source| at(Place::file(path), source))
}

/// The error of a medium with its place.
fn at(place: Place, source: pileus_media::Error) -> Error {
    match source {
        pileus_media::Error::Invalid { what, remedy } => Error::invalid(place, what, remedy),
        other => Error::medium(place, other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::json;

    fn read(text: &str) -> Result<Option<Arc<TransmittanceFunction>>, Error> {
        let spec: VolumeSpec = json::parse(text).unwrap();
        transmittance_function(&spec, &|key| Place::part("job.json", key))
    }

    #[test]
    fn every_transmittance_function_is_read() {
        for (text, said) in [
            (r#"{"law": {"type": "power", "k": 2}}"#, "power k 2"),
            (r#"{"law": {"type": "davis_weinstein", "h": 0.75, "c": 1}}"#, "h 0.75 c 1"),
            (r#"{"law": {"type": "erlang", "n": 3}}"#, "erlang n 3"),
            (r#"{"law": {"type": "linear"}}"#, "linear"),
            (
                r#"{"law_mixture": [{"weight": 1, "law": {"type": "exponential"}},
                    {"weight": 3, "rate": 2, "law": {"type": "power", "k": 4}}]}"#,
                "mixture of 0.2500 exponential, 0.7500 (power k 4) at rate 2",
            ),
        ] {
            let read = read(text).unwrap().unwrap().to_string();
            assert!(read.contains(said), "{text}: {read}");
        }
        assert_eq!(read("{}").unwrap(), None);
        assert_eq!(read(r#"{"law": {"type": "exponential"}}"#).unwrap(), None);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("law.csv");
        std::fs::write(&path, "# tau, T\n0, 1\n0.5, 0.55\n1, 0.3\n").unwrap();
        let spec = VolumeSpec {
            law: Some(TransmittanceFunctionSpec::Table {
                file: path.to_string_lossy().into_owned(),
            }),
            ..VolumeSpec::default()
        };
        let read =
            transmittance_function(&spec, &|key| Place::part("job.json", key)).unwrap().unwrap();
        assert!(read.to_string().contains("table to depth 1"), "{read}");
        std::fs::write(&path, "0, 1\n0.5, 0.9\n1, 0.1\n").unwrap();
        let error = transmittance_function(&spec, &|key| Place::part("job.json", key)).unwrap_err();
        assert_eq!(error.place().file.as_deref(), Some(path.as_path()));
        assert!(error.to_string().contains("bends down"), "{error}");
    }

    #[test]
    fn faults_name_place_and_reason() {
        for (text, part, said) in [
            (r#"{"law": {"type": "power", "k": 1}}"#, "/law", "k of a power law is 1"),
            (r#"{"law": {"type": "davis_weinstein", "h": 0.3, "c": 1}}"#, "/law", "h of"),
            (r#"{"law": {"type": "erlang", "n": 1}}"#, "/law", "n of an Erlang transmittance is 1"),
            (
                r#"{"law_mixture": [{"weight": 1, "law": {"type": "power", "k": 0}}]}"#,
                "/law_mixture/0/law",
                "k of a power law is 0",
            ),
            (r#"{"law_mixture": []}"#, "/law_mixture", "0 transmittance functions"),
            (
                r#"{"law": {"type": "linear"}, "law_mixture": []}"#,
                "/law_mixture",
                "both `law` and `law_mixture`",
            ),
        ] {
            let error = read(text).unwrap_err();
            assert_eq!(error.place().part.as_deref(), Some(part), "{text}");
            assert!(error.to_string().contains(said), "{text}: {error}");
            assert!(!error.remedy().is_empty(), "{text}");
        }
        let error = read(r#"{"law": {"type": "table", "file": "no/such"}}"#).unwrap_err();
        let said = error.to_string();
        assert!(matches!(error, Error::Io { .. }), "{said}");
        assert!(said.contains("no/such") && said.contains("job.json (/law/file)"), "{said}");
        let fault = json::parse::<VolumeSpec>(r#"{"law": {"type": "powr"}}"#).unwrap_err();
        assert!(fault.remedy.contains("did you mean `power`?"), "{fault:?}");
    }
}
