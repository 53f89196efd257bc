//! Phase functions from flat custom properties of a glTF node.

use std::path::Path;

use super::volume::Flat;
use crate::error::Error;
use crate::json::nearest;
use crate::spec::microflake_spec::{MicroflakeScatteringSpec, MicroflakeShapeSpec, MicroflakeSpec};
use crate::spec::phase_spec::{CosineGridSpec, CosineSpec, PhaseSpec};
use crate::uri::resolve_name;

/// A type of phase functions that flat keys can say.
struct FlatType {
    name: &'static str,
    keys: &'static [&'static str],
    /// From the keys to what they say.
    read: fn(&Keys<'_>) -> Result<PhaseSpec, Error>,
}

/// All of them; a node that names none has the first that has one of its keys.
static TYPES: [FlatType; 8] = [
    FlatType { name: "isotropic", keys: &[], read: |_| Ok(PhaseSpec::Isotropic {}) },
    FlatType {
        name: "henyey_greenstein",
        keys: &["pileus_g", "pileus_g_grid", "pileus_g_scale", "pileus_g_offset"],
        read: |keys| {
            let g = mean_cosine(keys.flat)?.ok_or_else(|| keys.missing("pileus_g"))?;
            Ok(PhaseSpec::HenyeyGreenstein { g })
        },
    },
    FlatType {
        name: "two_lobe",
        keys: &["pileus_g_forward", "pileus_g_backward", "pileus_weight_forward"],
        read: |keys| {
            Ok(PhaseSpec::TwoLobe {
                g_forward: keys.number("pileus_g_forward")?,
                g_backward: keys.number("pileus_g_backward")?,
                weight_forward: keys.number("pileus_weight_forward")?,
            })
        },
    },
    FlatType { name: "rayleigh", keys: &[], read: |_| Ok(PhaseSpec::Rayleigh {}) },
    FlatType {
        name: "draine",
        keys: &["pileus_g", "pileus_alpha"],
        read: |keys| {
            let (g, alpha) = (keys.number("pileus_g")?, keys.number("pileus_alpha")?);
            Ok(PhaseSpec::Draine { g, alpha })
        },
    },
    FlatType {
        name: "mie",
        keys: &["pileus_droplet_diameter"],
        read: |keys| {
            let droplet_diameter = keys.number("pileus_droplet_diameter")?;
            Ok(PhaseSpec::Mie { droplet_diameter })
        },
    },
    FlatType {
        name: "tabulated",
        keys: &["pileus_phase_file"],
        read: |keys| {
            let file = keys.flat.text("pileus_phase_file")?;
            let file = file.ok_or_else(|| keys.missing("pileus_phase_file"))?;
            let file = resolve_name(keys.base, &file).to_string_lossy().into_owned();
            Ok(PhaseSpec::Tabulated { file })
        },
    },
    FlatType {
        name: "sggx",
        keys: &[
            "pileus_flakes",
            "pileus_flake_shape",
            "pileus_flake_axis",
            "pileus_flake_axis_grid",
            "pileus_flake_roughness",
            "pileus_flake_roughness_grid",
            "pileus_flake_diagonal_grid",
            "pileus_flake_off_diagonal_grid",
        ],
        read: |keys| {
            let flat = keys.flat;
            let shape = choice(flat, "pileus_flake_shape", &MICROFLAKE_SHAPES)?;
            Ok(PhaseSpec::Sggx {
                flakes: choice(flat, "pileus_flakes", &MICROFLAKE_SCATTERING)?,
                distribution: MicroflakeSpec {
                    shape: shape.ok_or_else(|| keys.missing("pileus_flake_shape"))?,
                    axis: flat.vector("pileus_flake_axis")?,
                    axis_grid: flat.text("pileus_flake_axis_grid")?,
                    roughness: flat.number("pileus_flake_roughness")?,
                    roughness_grid: flat.text("pileus_flake_roughness_grid")?,
                    diagonal: None,
                    off_diagonal: None,
                    diagonal_grid: flat.text("pileus_flake_diagonal_grid")?,
                    off_diagonal_grid: flat.text("pileus_flake_off_diagonal_grid")?,
                },
            })
        },
    },
];

/// The flat keys of a node whose phase function is of the type `name`.
struct Keys<'a> {
    flat: &'a Flat<'a>,
    base: &'a Path,
    name: &'static str,
}

impl Keys<'_> {
    /// The number of a key that the type needs.
    fn number(&self, key: &str) -> Result<f64, Error> {
        self.flat.number(key)?.ok_or_else(|| self.missing(key))
    }

    fn missing(&self, key: &str) -> Error {
        // Without `pileus_phase` the place is that of the node's properties.
        Error::invalid(
            self.flat.place("pileus_phase"),
            format!("the phase function `{}` needs `{key}`", self.name),
            format!("add `{key}`"),
        )
    }
}

/// What the flat keys of phase functions mean.
const MEANINGS: [(&str, &str); 19] = [
    (
        "pileus_phase",
        "the angular law of scattering: `isotropic`, `henyey_greenstein`, `two_lobe`, `rayleigh`, `draine`, `mie`, `tabulated`, `sggx`; default: that which has the keys given",
    ),
    ("pileus_g", "of `henyey_greenstein` and `draine`: between -1 and 1; above 0 scatters forward"),
    ("pileus_g_grid", "of `henyey_greenstein`: a grid of mean cosines"),
    ("pileus_g_scale", "factor on that grid; default 1"),
    ("pileus_g_offset", "mean cosine where that grid is 0; default 0"),
    ("pileus_g_forward", "of `two_lobe`: mean cosine of the first lobe"),
    ("pileus_g_backward", "of `two_lobe`: mean cosine of the second lobe"),
    ("pileus_weight_forward", "of `two_lobe`: share of the first lobe, 0 to 1"),
    ("pileus_alpha", "of `draine`: weight of the squared cosine, 0 to 1000000"),
    ("pileus_droplet_diameter", "of `mie`: diameter of the droplets in micrometres, 0.01 to 50"),
    ("pileus_phase_file", "of `tabulated`: a text file of angles in degrees and values"),
    ("pileus_flakes", "of `sggx`: `specular` or `diffuse` microflakes; default `specular`"),
    ("pileus_flake_shape", "of `sggx`: `isotropic`, `fibre`, `surface` or `matrix`"),
    ("pileus_flake_axis", "of `fibre` and `surface`: the axis, of any length"),
    ("pileus_flake_axis_grid", "a grid of vectors with the axis"),
    ("pileus_flake_roughness", "of `fibre` and `surface`: 0.001 to 1"),
    ("pileus_flake_roughness_grid", "a grid of numbers with the roughness"),
    ("pileus_flake_diagonal_grid", "of `matrix`: a grid of vectors with xx, yy, zz"),
    ("pileus_flake_off_diagonal_grid", "of `matrix`: a grid of vectors with xy, xz, yz"),
];

/// All flat keys of phase functions, each once, and what each means.
pub(crate) fn flat_phase_keys() -> impl Iterator<Item = (&'static str, &'static str)> {
    MEANINGS.into_iter()
}

/// The phase function that flat keys describe: of the type that `pileus_phase` names, or of the
/// first type that has one of the keys given.
pub(crate) fn flat_phase(flat: &Flat<'_>, base: &Path) -> Result<Option<PhaseSpec>, Error> {
    let names = || TYPES.iter().map(|kind| kind.name);
    let kind = match flat.text("pileus_phase")? {
        Some(name) => match TYPES.iter().find(|kind| kind.name == name) {
            Some(found) => found,
            None => {
                let near = nearest(&name, names()).unwrap_or_default();
                let known = names().collect::<Vec<_>>().join("`, `");
                return Err(Error::invalid(
                    flat.place("pileus_phase"),
                    format!("unknown phase function `{name}`"),
                    format!(
                        "did you mean `{near}`? Known here: `{known}`; mixtures can be written in the object `pileus_volume`"
                    ),
                ));
            }
        },
        None => match TYPES.iter().find(|kind| kind.keys.iter().any(|key| flat.has(key))) {
            Some(found) => found,
            None => return Ok(None),
        },
    };
    let FlatType { name, keys, read } = kind;
    let foreign =
        TYPES.iter().flat_map(|other| other.keys).find(|key| flat.has(key) && !keys.contains(key));
    if let Some(key) = foreign {
        return Err(Error::invalid(
            flat.place(key),
            format!("`{key}` does not belong to the phase function `{name}`"),
            format!(
                "remove it, or name another type with `pileus_phase`: `{}`",
                names().collect::<Vec<_>>().join("`, `")
            ),
        ));
    }
    read(&Keys { flat, base, name: kind.name }).map(Some)
}

const MICROFLAKE_SHAPES: [(&str, MicroflakeShapeSpec); 4] = [
    ("isotropic", MicroflakeShapeSpec::Isotropic),
    ("fibre", MicroflakeShapeSpec::Fibre),
    ("surface", MicroflakeShapeSpec::Surface),
    ("matrix", MicroflakeShapeSpec::Matrix),
];

const MICROFLAKE_SCATTERING: [(&str, MicroflakeScatteringSpec); 2] = [
    ("specular", MicroflakeScatteringSpec::Specular),
    ("diffuse", MicroflakeScatteringSpec::Diffuse),
];

/// One of a few names.
fn choice<T: Copy>(flat: &Flat<'_>, key: &str, choices: &[(&str, T)]) -> Result<Option<T>, Error> {
    let Some(name) = flat.text(key)? else { return Ok(None) };
    match choices.iter().find(|(known, _)| *known == name) {
        Some((_, value)) => Ok(Some(*value)),
        None => {
            let known: Vec<&str> = choices.iter().map(|(known, _)| *known).collect();
            Err(Error::invalid(
                flat.place(key),
                format!("`{key}` is `{name}`"),
                format!("give one of `{}`", known.join("`, `")),
            ))
        }
    }
}

fn mean_cosine(flat: &Flat<'_>) -> Result<Option<CosineSpec>, Error> {
    let (g, grid) = (flat.number("pileus_g")?, flat.text("pileus_g_grid")?);
    let (scale, offset) = (flat.number("pileus_g_scale")?, flat.number("pileus_g_offset")?);
    match (g, grid) {
        (Some(_), Some(_)) => Err(Error::invalid(
            flat.place("pileus_g_grid"),
            "`pileus_g` and `pileus_g_grid` each say what the mean cosine is",
            "keep one; `pileus_g_offset` is added to the grid",
        )),
        (None, Some(grid)) => Ok(Some(CosineSpec::Grid(CosineGridSpec { grid, scale, offset }))),
        (_, None) if scale.is_some() || offset.is_some() => Err(Error::invalid(
            flat.place(if scale.is_some() { "pileus_g_scale" } else { "pileus_g_offset" }),
            "scale and offset of a mean cosine belong to `pileus_g_grid`",
            "add `pileus_g_grid` with the name of a grid, or remove them",
        )),
        (g, None) => Ok(g.map(CosineSpec::Constant)),
    }
}

#[cfg(test)]
mod tests {
    /// The keys that types have are those that have a meaning.
    #[test]
    fn keys_have_a_meaning() {
        let of_types = super::TYPES.iter().flat_map(|kind| kind.keys).copied();
        let mut keys: Vec<&str> = of_types.chain(["pileus_phase"]).collect();
        keys.sort_unstable();
        keys.dedup();
        let mut known: Vec<&str> = super::flat_phase_keys().map(|(key, _)| key).collect();
        known.sort_unstable();
        assert_eq!(keys, known);
    }

    use super::*;
    use crate::gltf::parse;

    /// Flat keys say every type that a specification has but mixtures, and their meaning names all.
    #[test]
    fn no_type_is_forgotten() {
        let schema = schemars::schema_for!(PhaseSpec);
        let kinds = schema.get("oneOf").and_then(|kinds| kinds.as_array()).unwrap();
        let mut specified: Vec<&str> = kinds
            .iter()
            .map(|kind| kind["properties"]["type"]["const"].as_str().unwrap())
            .filter(|name| *name != "mixture")
            .collect();
        specified.sort_unstable();
        let mut flat: Vec<&str> = TYPES.iter().map(|kind| kind.name).collect();
        let list = format!("`{}`; default", flat.join("`, `"));
        let (_, meaning) = flat_phase_keys().find(|(key, _)| *key == "pileus_phase").unwrap();
        assert!(meaning.contains(&list), "{meaning}");
        flat.sort_unstable();
        assert_eq!(flat, specified);
    }

    fn read(node: &str) -> Result<Option<PhaseSpec>, Error> {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{node}]}}"#
        );
        let scene = parse("folder/a.gltf", text.as_bytes(), 683.0)?;
        Ok(scene.volumes.first().and_then(|volume| volume.spec.phase.clone()))
    }

    /// Every type in the extension, in the object of `extras` and, but for mixtures, flat.
    #[test]
    fn all_ways_to_write_a_phase_function_say_the_same() {
        for (object, flat) in [
            (r#"{"type":"isotropic"}"#, r#""pileus_phase":"isotropic""#),
            (r#"{"type":"henyey_greenstein","g":0.3}"#, r#""pileus_g":0.3"#),
            (
                r#"{"type":"henyey_greenstein","g":{"grid":"a","scale":2,"offset":-1}}"#,
                r#""pileus_g_grid":"a","pileus_g_scale":2,"pileus_g_offset":-1"#,
            ),
            (
                r#"{"type":"two_lobe","g_forward":0.9,"g_backward":-0.3,"weight_forward":0.8}"#,
                r#""pileus_g_forward":0.9,"pileus_g_backward":-0.3,"pileus_weight_forward":0.8"#,
            ),
            (r#"{"type":"rayleigh"}"#, r#""pileus_phase":"rayleigh""#),
            (
                r#"{"type":"draine","g":0.5,"alpha":3}"#,
                r#""pileus_phase":"draine","pileus_g":0.5,"pileus_alpha":3"#,
            ),
            (
                r#"{"type":"sggx","flakes":"diffuse","distribution":{"shape":"fibre","axis":[0,1,0],"roughness":0.1}}"#,
                r#""pileus_flakes":"diffuse","pileus_flake_shape":"fibre","pileus_flake_axis":[0,1,0],"pileus_flake_roughness":0.1"#,
            ),
            (
                r#"{"type":"sggx","distribution":{"shape":"surface","axis_grid":"n","roughness_grid":"r"}}"#,
                r#""pileus_flake_shape":"surface","pileus_flake_axis_grid":"n","pileus_flake_roughness_grid":"r""#,
            ),
            (
                r#"{"type":"sggx","distribution":{"shape":"matrix","diagonal_grid":"d","off_diagonal_grid":"o"}}"#,
                r#""pileus_flake_shape":"matrix","pileus_flake_diagonal_grid":"d","pileus_flake_off_diagonal_grid":"o""#,
            ),
            (r#"{"type":"mie","droplet_diameter":12}"#, r#""pileus_droplet_diameter":12"#),
            (r#"{"type":"tabulated","file":"a b.csv"}"#, r#""pileus_phase_file":"a b.csv""#),
        ] {
            let uri = object.replace("a b", "a%20b");
            let extension =
                format!(r#"{{"extensions":{{"PILEUS_volume":{{"vdb":"a","phase":{uri}}}}}}}"#);
            let nested =
                format!(r#"{{"extras":{{"pileus_volume":{{"vdb":"a","phase":{object}}}}}}}"#);
            let flat = format!(r#"{{"extras":{{"pileus_vdb":"a",{flat}}}}}"#);
            let [a, b, c] = [extension, nested, flat].map(|node| read(&node).unwrap());
            assert!(a.is_some() && a == b && a == c, "{a:?} {b:?} {c:?}");
            if let Some(PhaseSpec::Tabulated { file }) = a {
                assert_eq!(Path::new(&file), Path::new("folder/a b.csv"));
            }
        }
        let mixture = r#"{"extensions":{"PILEUS_volume":{"vdb":"a","phase":{"type":"mixture",
            "lobes":[{"weight":1,"phase":{"type":"tabulated","file":"t.csv"}}]}}}}"#;
        let Some(PhaseSpec::Mixture { lobes }) = read(mixture).unwrap() else {
            panic!("a mixture")
        };
        let PhaseSpec::Tabulated { file } = &lobes[0].phase else { panic!("a table") };
        assert_eq!(Path::new(file), Path::new("folder/t.csv"));
    }

    #[test]
    fn wrong_properties_are_placed() {
        for (flat, key, remedy) in [
            (r#""pileus_phase":"mei""#, "pileus_phase", "did you mean `mie`?"),
            (r#""pileus_phase":"mie""#, "pileus_phase", "pileus_droplet_diameter"),
            (r#""pileus_phase":"mie","pileus_g":0.1"#, "pileus_g", "another type"),
            (r#""pileus_alpha":3"#, "pileus_phase", "`pileus_g`"),
            (r#""pileus_g_scale":3"#, "pileus_g_scale", "pileus_g_grid"),
            (r#""pileus_g":0,"pileus_g_grid":"g""#, "pileus_g_grid", "keep one"),
            (r#""pileus_g":0,"pileus_droplet_diameter":3"#, "pileus_droplet_diameter", "remove it"),
            (r#""pileus_droplet_diameter":"x""#, "pileus_droplet_diameter", "a number"),
        ] {
            let error = read(&format!(r#"{{"extras":{{"pileus_vdb":"a",{flat}}}}}"#)).unwrap_err();
            let part = error.place().part.clone().unwrap_or_default();
            assert!(part == format!("/nodes/0/extras/{key}"), "{flat}: {error} at {part}");
            assert!(error.remedy().contains(remedy), "{flat}: {}", error.remedy());
        }
    }
}
