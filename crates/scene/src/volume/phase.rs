//! From what a user wrote about the angular law of scattering to the law.

use std::path::Path;
use std::sync::Arc;

use glam::DAffine3;
use pileus_media::Phase;
use pileus_media::microflakes::{MicroflakeScattering, Microflakes};
use pileus_media::phase::{Draine, Lobe, MAX_G, MieFit, Mixture, Tabulated};

use super::microflakes::{self, MicroflakeGrids};
use crate::error::{Error, Place};
use crate::file;
use crate::spec::microflake_spec::MicroflakeScatteringSpec;
use crate::spec::option::written;
use crate::spec::phase_spec::{CosineSpec, LobeSpec, PhaseSpec};

/// Largest table in bytes.
const MAX_TABLE: u64 = 64 << 20;

/// The phase function of a volume whose placement is this; its place in the specification is
/// `/phase`. Mean cosines by grid are not looked up here.
pub(crate) fn phase(
    spec: Option<&PhaseSpec>,
    placement: &DAffine3,
    place: &dyn Fn(&str) -> Place,
    grids: Option<&mut dyn MicroflakeGrids>,
) -> Result<Phase, Error> {
    match spec {
        None => Ok(Phase::Isotropic),
        Some(PhaseSpec::Sggx { flakes, distribution }) => {
            let shape = microflakes::shape(distribution, place, grids)?;
            let scattering = match flakes.unwrap_or_default() {
                MicroflakeScatteringSpec::Specular => MicroflakeScattering::Specular,
                MicroflakeScatteringSpec::Diffuse => MicroflakeScattering::Diffuse,
            };
            Ok(Phase::Microflakes(Arc::new(Microflakes::new(shape, scattering, placement.matrix3))))
        }
        Some(spec) => mixture(spec, place, "/phase").map(Phase::mixture),
    }
}

fn mixture(
    spec: &PhaseSpec,
    place: &dyn Fn(&str) -> Place,
    pointer: &str,
) -> Result<Mixture, Error> {
    let at = |key: &str| place(&format!("{pointer}{key}"));
    let lobe = |g: f64, key: &str| Ok(Mixture::of(Lobe::henyey_greenstein(cosine(g, || at(key))?)));
    let medium = |source| Error::medium(at(""), source);
    match spec {
        PhaseSpec::Isotropic {} => Ok(Mixture::of(Lobe::Isotropic)),
        PhaseSpec::HenyeyGreenstein { g: CosineSpec::Constant(g) } => lobe(*g, "/g"),
        PhaseSpec::HenyeyGreenstein { g: CosineSpec::Grid(_) } => Err(Error::unsupported(
            at("/g"),
            "a mean cosine by grid is possible in volumes with `vdb`, outside of mixtures",
            "give a number",
        )),
        PhaseSpec::TwoLobe { g_forward, g_backward, weight_forward } => {
            if !(0.0..=1.0).contains(weight_forward) {
                return Err(Error::invalid(
                    at("/weight_forward"),
                    format!("weight_forward is {weight_forward}"),
                    "give a number between 0 and 1",
                ));
            }
            Mixture::new([
                (*weight_forward, lobe(*g_forward, "/g_forward")?),
                (1.0 - weight_forward, lobe(*g_backward, "/g_backward")?),
            ])
            .map_err(medium)
        }
        PhaseSpec::Mixture { lobes } => {
            let mut parts = Vec::new();
            for (i, LobeSpec { weight, phase }) in lobes.iter().enumerate() {
                if !(0.0..=1e30).contains(weight) {
                    return Err(Error::invalid(
                        at(&format!("/lobes/{i}/weight")),
                        format!("the weight is {weight}"),
                        "give a number of at least 0",
                    ));
                }
                let below = format!("{pointer}/lobes/{i}/phase");
                parts.push((*weight, mixture(phase, place, &below)?));
            }
            Mixture::new(parts).map_err(|source| Error::medium(at("/lobes"), source))
        }
        PhaseSpec::Rayleigh {} => Ok(Mixture::of(Lobe::Rayleigh)),
        PhaseSpec::Draine { g, alpha } => {
            let draine = Draine::new(cosine(*g, || at("/g"))?, *alpha as f32);
            draine
                .map(|draine| Mixture::of(Lobe::Draine(draine)))
                .map_err(|source| Error::medium(at("/alpha"), source))
        }
        PhaseSpec::Mie { droplet_diameter } => MieFit::new(*droplet_diameter)
            .and_then(|fit| fit.mixture())
            .map_err(|source| Error::medium(at("/droplet_diameter"), source)),
        PhaseSpec::Sggx { .. } => Err(Error::unsupported(
            at("/type"),
            "microflakes cannot be a lobe of a mixture: they have an extinction of their own",
            "write two volumes: media may overlap",
        )),
        PhaseSpec::Tabulated { file } => {
            let table = read_table(Path::new(file), &at("/file"))?;
            Ok(Mixture::of(Lobe::Tabulated(table)))
        }
    }
}

/// A mean cosine that single precision can follow.
fn cosine(g: f64, place: impl Fn() -> Place) -> Result<f32, Error> {
    let limit = written(MAX_G);
    if g.abs() <= limit {
        return Ok(g as f32);
    }
    let what = format!("g is {g}");
    Err(if g.abs() < 1.0 {
        let remedy = format!("use a mean cosine between -{limit} and {limit}");
        Error::unsupported(place(), what, remedy)
    } else {
        Error::invalid(place(), what, "the mean cosine lies between -1 and 1 without its ends")
    })
}

/// Reads a table of angles in degrees and values.
fn read_table(path: &Path, asked_at: &Place) -> Result<Tabulated, Error> {
    let named = || Place { part: Some(format!("named at {asked_at}")), ..Place::file(path) };
    let io = |source| Error::io(named(), source);
    let bytes = file::read(path, MAX_TABLE + 1).map_err(io)?;
    if bytes.len() as u64 > MAX_TABLE {
        let what = format!("the table is larger than {MAX_TABLE} bytes");
        return Err(Error::unsupported(named(), what, "leave out rows"));
    }
    let text = std::str::from_utf8(crate::file::text_file(&bytes))
        .map_err(|_| Error::invalid(named(), "the text is not UTF-8", "save it as UTF-8"))?;
    let (mut rows, mut lines) = (Vec::new(), Vec::new());
    let at_line = |line: usize| Place { line: Some(line), ..named() };
    for (number, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default();
        if content.trim().is_empty() {
            continue;
        }
        let fields = content.split(|c: char| c == ',' || c == ';' || c.is_whitespace());
        let mut fields = fields.filter(|field| !field.is_empty());
        let numbers = (fields.next().map(str::parse), fields.next().map(str::parse), fields.next());
        let (Some(Ok(angle)), Some(Ok(value)), None) = numbers else {
            return Err(Error::invalid(
                // The line is not shown: whose file it is is not known.
                at_line(number + 1),
                "the line is not two numbers",
                "write an angle in degrees and a value in each line, separated by a comma; `#` begins a comment",
            ));
        };
        rows.push((angle, value));
        lines.push(number + 1);
    }
    Tabulated::new(&rows).map_err(|(row, source)| {
        let line = row.and_then(|row| lines.get(row)).copied();
        match source {
            pileus_media::Error::Invalid { what, remedy } => {
                Error::invalid(line.map_or_else(named, at_line), what, remedy)
            }
            other => Error::medium(line.map_or_else(named, at_line), other),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::json;

    fn load(text: &str) -> Result<Phase, Error> {
        let spec: PhaseSpec = json::parse(text).unwrap();
        phase(Some(&spec), &DAffine3::IDENTITY, &|key| Place::part("a.json", key), None)
    }

    #[test]
    fn every_law_is_loaded() {
        for (text, described) in [
            (r#"{"type":"isotropic"}"#, "isotropic"),
            (r#"{"type":"henyey_greenstein","g":0}"#, "isotropic"),
            (r#"{"type":"henyey_greenstein","g":-0.999}"#, "henyey_greenstein g -0.999"),
            (
                r#"{"type":"two_lobe","g_forward":0.9,"g_backward":-0.3,"weight_forward":0.75}"#,
                "mixture of 0.7500 henyey_greenstein g 0.9, 0.2500 henyey_greenstein g -0.3",
            ),
            (
                r#"{"type":"two_lobe","g_forward":0.9,"g_backward":-0.3,"weight_forward":1}"#,
                "henyey_greenstein g 0.9",
            ),
            (r#"{"type":"rayleigh"}"#, "rayleigh"),
            (r#"{"type":"draine","g":0.5,"alpha":3}"#, "draine g 0.5 alpha 3"),
            (
                r#"{"type":"mixture","lobes":[{"weight":1,"phase":{"type":"rayleigh"}},
                    {"weight":3,"phase":{"type":"isotropic"}}]}"#,
                "mixture of 0.2500 rayleigh, 0.7500 isotropic",
            ),
        ] {
            assert_eq!(load(text).unwrap().to_string(), described);
        }
        let mie = load(r#"{"type":"mie","droplet_diameter":10}"#).unwrap().to_string();
        assert!(mie.starts_with("mixture of 0.5") && mie.contains("draine"), "{mie}");
    }

    #[test]
    fn values_out_of_range_are_placed() {
        for (text, key) in [
            (r#"{"type":"henyey_greenstein","g":1}"#, "/phase/g"),
            (r#"{"type":"henyey_greenstein","g":-0.9999}"#, "/phase/g"),
            (r#"{"type":"henyey_greenstein","g":{"grid":"a"}}"#, "/phase/g"),
            (
                r#"{"type":"two_lobe","g_forward":0.9,"g_backward":-1.3,"weight_forward":1}"#,
                "/phase/g_backward",
            ),
            (
                r#"{"type":"two_lobe","g_forward":0.9,"g_backward":0,"weight_forward":-0.1}"#,
                "/phase/weight_forward",
            ),
            (r#"{"type":"draine","g":2,"alpha":0}"#, "/phase/g"),
            (r#"{"type":"draine","g":0,"alpha":1e9}"#, "/phase/alpha"),
            (r#"{"type":"mie","droplet_diameter":0}"#, "/phase/droplet_diameter"),
            (r#"{"type":"mixture","lobes":[]}"#, "/phase/lobes"),
            (
                r#"{"type":"mixture","lobes":[{"weight":1,"phase":{"type":"draine","g":0,"alpha":-1}}]}"#,
                "/phase/lobes/0/phase/alpha",
            ),
            (
                r#"{"type":"mixture","lobes":[{"weight":-1,"phase":{"type":"rayleigh"}}]}"#,
                "/phase/lobes/0/weight",
            ),
        ] {
            let error = load(text).unwrap_err();
            assert_eq!(error.place().part.as_deref(), Some(key), "{text}: {error}");
        }
    }

    #[test]
    fn tables_are_read_or_their_lines_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let read = |text: &[u8]| {
            std::fs::write(&path, text).unwrap();
            read_table(&path, &Place::part("a.json", "/phase/file"))
        };
        let table = read(b"\xef\xbb\xbf# comment\r\n\r\n0, 2 # peak\r\n90;1\n180\t1e-3\n").unwrap();
        assert_eq!(table.rows(), 3);
        assert!(table.mean_cosine() > 0.0);
        for (text, line) in [
            (&b"0,1\n90\n180,1"[..], Some(2)),
            (b"0,1\n90,1,1\n180,1", Some(2)),
            (b"angle,value\n0,1\n180,1", Some(1)),
            (b"# a\n0,1\n180,-1", Some(3)),
            (b"0,1\n\n95,1\n90,1\n180,1", Some(4)),
            (b"0,1\n170,1", Some(2)),
            (b"0,1\nnan,1\n180,1", Some(2)),
            (b"0,1\n180,inf", Some(2)),
            (b"0,0\n180,0", None),
            (b"", None),
            (b"\xff\xfe", None),
        ] {
            let error = read(text).unwrap_err();
            assert_eq!(error.place().line, line, "{}: {error}", String::from_utf8_lossy(text));
            assert_eq!(error.place().file.as_deref(), Some(path.as_path()));
            assert!(!error.remedy().is_empty());
        }
        let error = read_table(&folder.path().join("none"), &Place::default()).unwrap_err();
        assert!(matches!(error, Error::Io { .. }));
    }
}
