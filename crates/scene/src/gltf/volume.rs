//! Volumes in glTF: the extension `PILEUS_volume` and its fallback, a node's `extras`.

use std::path::Path;

use serde_json::{Map, Value};

use super::phase::{flat_phase, flat_phase_keys};
use crate::error::{Error, Place};
use crate::json::{Document, nearest};
use crate::spec::by_name::ByName;
use crate::spec::volume_spec::{
    AlbedoSpec, DensitySpec, EmissionSpec, Rgb, TemperatureSpec, TransmittanceFunctionSpec, UpAxis,
    VolumeSpec,
};
use crate::uri::{resolve_name, resolve_uri};

/// The name of the node extension.
pub(crate) const EXTENSION: &str = "PILEUS_volume";

/// Key of `extras` that holds the same object as the extension.
const NESTED: &str = "pileus_volume";

/// Key of `extras` under which three.js keeps the extensions that it does not know.
pub(crate) const KEPT: &str = "gltfExtensions";

/// Flat keys of `extras`, what Blender writes from an object's custom properties, and what each
/// means; those of phase functions stand with their types.
const FLAT: [(&str, &str); 19] = [
    ("pileus_vdb", "path of the OpenVDB file, relative to the glTF file"),
    ("pileus_frame", "the frame number that replaces `#` in the name of that file"),
    ("pileus_grid", "name of the density grid; default `density`, or the only fog volume"),
    ("pileus_density_scale", "extinction per scene unit where the grid is 1; default 1"),
    ("pileus_albedo", "single-scattering albedo, a number or a colour; default 0.999"),
    ("pileus_extinction", "extinction of the channels relative to each other; default 1"),
    (
        "pileus_law",
        "how light gets through: `exponential`, `power`, `davis_weinstein`, `erlang`, `linear`, `table`",
    ),
    ("pileus_law_k", "of `power`: above 1"),
    ("pileus_law_h", "of `davis_weinstein`: above 0.5 and at most 1"),
    ("pileus_law_c", "of `davis_weinstein`: above 0"),
    ("pileus_law_n", "of `erlang`: a whole number from 2 to 64"),
    ("pileus_law_file", "of `table`: a text file of optical depths and transmittances"),
    ("pileus_temperature_grid", "a grid of temperatures: the volume glows as a black body"),
    ("pileus_temperature_scale", "kelvin per unit of that grid; default 1"),
    ("pileus_emission_intensity", "factor on the black body's radiance; default 1"),
    ("pileus_emission_grid", "a grid of radiance per scene unit, numbers or colours"),
    ("pileus_emission_color", "colour of that light; default 1, 1, 1"),
    ("pileus_emission_scale", "factor on that light; default 1"),
    ("pileus_up_axis", "`y`, or `z` for files written by Blender; default `y`"),
];

/// All flat keys, and what each means.
pub(crate) fn flat_keys() -> Vec<(&'static str, &'static str)> {
    FLAT.into_iter().chain(flat_phase_keys()).collect()
}

/// What node `index` says about a volume, its paths resolved relative to the glTF file.
///
/// Returns the specification and the JSON pointer where it stands.
pub(crate) fn volume_of_node(
    document: &Document,
    index: usize,
    has_extension: bool,
    extras: Option<&Map<String, Value>>,
) -> Result<Option<(VolumeSpec, String)>, Error> {
    let base = document.path().parent().unwrap_or(Path::new(""));
    let node = format!("/nodes/{index}");
    let kept = extras.and_then(|extras| extras.get(KEPT)?.get(EXTENSION));
    if has_extension || kept.is_some() {
        let pointer = match has_extension {
            true => format!("{node}/extensions/{EXTENSION}"),
            false => format!("{node}/extras/{KEPT}/{EXTENSION}"),
        };
        if let Some(spec) = document.parse_at::<VolumeSpec>(&pointer) {
            let mut spec = spec?;
            spec.resolve_files(|key, uri| {
                let place = document.place(&format!("{pointer}{key}"));
                resolve_uri(base, uri, &place).map(|path| path_text(&path))
            })?;
            return Ok(Some((spec, pointer)));
        }
    }
    let Some(extras) = extras else { return Ok(None) };
    let pointer = format!("{node}/extras");
    if extras.contains_key(NESTED) {
        let pointer = format!("{pointer}/{NESTED}");
        let Some(spec) = document.parse_at::<VolumeSpec>(&pointer) else { return Ok(None) };
        let mut spec = spec?;
        spec.resolve_files(|_, name| Ok::<_, Error>(path_text(&resolve_name(base, name))))?;
        return Ok(Some((spec, pointer)));
    }
    let flat = Flat { document, pointer: &pointer, extras };
    Ok(flat.volume(base)?.map(|spec| (spec, pointer)))
}

fn path_text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

pub(crate) struct Flat<'a> {
    document: &'a Document,
    pointer: &'a str,
    extras: &'a Map<String, Value>,
}

impl Flat<'_> {
    fn volume(&self, base: &Path) -> Result<Option<VolumeSpec>, Error> {
        let mut any = false;
        let known: Vec<&str> = flat_keys().into_iter().map(|(key, _)| key).collect();
        for key in self.extras.keys().filter(|key| key.starts_with("pileus_")) {
            any = true;
            if !known.contains(&key.as_str()) {
                let near = nearest(key, known.iter().copied().chain([NESTED])).unwrap_or_default();
                return Err(Error::invalid(
                    self.place(key),
                    format!("unknown custom property `{key}`"),
                    format!("did you mean `{near}`? Known here: `{}`", known.join("`, `")),
                ));
            }
        }
        if !any {
            return Ok(None);
        }
        let Some(vdb) = self.text("pileus_vdb")? else {
            return Err(Error::invalid(
                self.document.place(self.pointer),
                "the node has `pileus_` properties but no `pileus_vdb`",
                "add `pileus_vdb` with the name of an OpenVDB file",
            ));
        };
        let up_axis = match self.text("pileus_up_axis")?.as_deref() {
            None => None,
            Some("y" | "Y") => Some(UpAxis::Y),
            Some("z" | "Z") => Some(UpAxis::Z),
            Some(_) => return Err(self.wrong("pileus_up_axis", "\"y\" or \"z\"")),
        };
        Ok(Some(VolumeSpec {
            vdb: Some(path_text(&resolve_name(base, &vdb))),
            frame: self.whole("pileus_frame")?,
            density: Some(DensitySpec {
                grid: self.text("pileus_grid")?,
                scale: self.number("pileus_density_scale")?,
            }),
            albedo: self.rgb("pileus_albedo")?.map(AlbedoSpec::Constant),
            extinction: self.rgb("pileus_extinction")?,
            phase: flat_phase(self, base)?,
            law: self.transmittance_function(base)?,
            emission: self.emission()?,
            up_axis: up_axis.map(ByName),
            ..VolumeSpec::default()
        }))
    }

    fn transmittance_function(
        &self,
        base: &Path,
    ) -> Result<Option<TransmittanceFunctionSpec>, Error> {
        let name = self.text("pileus_law")?;
        let needs = |key: &str, what: &str| self.number(key)?.ok_or_else(|| self.lacks(key, what));
        let (function, own): (Option<TransmittanceFunctionSpec>, &[&str]) = match name.as_deref() {
            None => (None, &[]),
            Some("exponential") => (Some(TransmittanceFunctionSpec::Exponential {}), &[]),
            Some("linear") => (Some(TransmittanceFunctionSpec::Linear {}), &[]),
            Some("power") => {
                let k = needs("pileus_law_k", "a power law")?;
                (Some(TransmittanceFunctionSpec::Power { k }), &["pileus_law_k"])
            }
            Some("davis_weinstein") => {
                let h = needs("pileus_law_h", "a Davis-Weinstein transmittance")?;
                let c = needs("pileus_law_c", "a Davis-Weinstein transmittance")?;
                (
                    Some(TransmittanceFunctionSpec::DavisWeinstein { h, c }),
                    &["pileus_law_h", "pileus_law_c"],
                )
            }
            Some("erlang") => {
                let n = needs("pileus_law_n", "an Erlang transmittance")?;
                if !(n.fract() == 0.0 && (0.0..=1e6).contains(&n)) {
                    return Err(self.wrong("pileus_law_n", "a whole number"));
                }
                (Some(TransmittanceFunctionSpec::Erlang { n: n as u32 }), &["pileus_law_n"])
            }
            Some("table") => {
                let Some(file) = self.text("pileus_law_file")? else {
                    return Err(self.lacks("pileus_law_file", "a tabulated transmittance function"));
                };
                let file = path_text(&resolve_name(base, &file));
                (Some(TransmittanceFunctionSpec::Table { file }), &["pileus_law_file"])
            }
            Some(_) => {
                let expected = "\"exponential\", \"power\", \"davis_weinstein\", \"erlang\", \"linear\" or \"table\"; mixtures stand in an object `pileus_volume`";
                return Err(self.wrong("pileus_law", expected));
            }
        };
        let keys = FLAT.into_iter().map(|(key, _)| key);
        for key in keys.filter(|key| key.starts_with("pileus_law_")) {
            if self.extras.contains_key(key) && !own.contains(&key) {
                return Err(Error::invalid(
                    self.place(key),
                    format!(
                        "`{key}` means nothing to the transmittance function `{}`",
                        name.as_deref().unwrap_or("exponential")
                    ),
                    format!(
                        "remove `{key}`, or set `pileus_law` to the transmittance function that it belongs to"
                    ),
                ));
            }
        }
        Ok(function)
    }

    fn lacks(&self, key: &str, what: &str) -> Error {
        Error::invalid(
            self.place("pileus_law"),
            format!("{what} needs `{key}`"),
            format!("add `{key}`"),
        )
    }

    fn emission(&self) -> Result<Option<EmissionSpec>, Error> {
        let intensity = self.number("pileus_emission_intensity")?;
        let temperature_scale = self.number("pileus_temperature_scale")?;
        let color = self.rgb("pileus_emission_color")?;
        let scale = self.number("pileus_emission_scale")?;
        let needs = |key: &str, grid: &str| {
            Error::invalid(
                self.place(key),
                format!("`{key}` without `{grid}` means nothing"),
                format!("add `{grid}` with the name of a grid, or remove `{key}`"),
            )
        };
        match (self.text("pileus_emission_grid")?, self.text("pileus_temperature_grid")?) {
            (Some(_), Some(_)) => Err(Error::invalid(
                self.place("pileus_temperature_grid"),
                "`pileus_emission_grid` and `pileus_temperature_grid` each say what the volume emits",
                "keep one; for both, add a second node with `pileus_density_scale` 0",
            )),
            (Some(grid), None) => Ok(Some(EmissionSpec::Grid { grid, color, scale, ramp: None })),
            (None, _) if color.is_some() => {
                Err(needs("pileus_emission_color", "pileus_emission_grid"))
            }
            (None, _) if scale.is_some() => {
                Err(needs("pileus_emission_scale", "pileus_emission_grid"))
            }
            (None, Some(grid)) => Ok(Some(EmissionSpec::Blackbody {
                temperature: TemperatureSpec { grid, scale: temperature_scale, offset: None },
                intensity,
                normalised: None,
            })),
            (None, None) if intensity.is_some() => {
                Err(needs("pileus_emission_intensity", "pileus_temperature_grid"))
            }
            (None, None) => Ok(None),
        }
    }

    pub(crate) fn place(&self, key: &str) -> Place {
        let key = key.replace('~', "~0").replace('/', "~1");
        self.document.place(&format!("{}/{key}", self.pointer))
    }

    /// Whether the property is there.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.extras.contains_key(key)
    }

    fn wrong(&self, key: &str, expected: &str) -> Error {
        let found = self.extras.get(key).map(Value::to_string).unwrap_or_default();
        let found: String = found.chars().take(60).collect();
        Error::invalid(self.place(key), format!("`{key}` is {found}"), format!("give {expected}"))
    }

    pub(crate) fn text(&self, key: &str) -> Result<Option<String>, Error> {
        match self.extras.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text.clone())),
            Some(_) => Err(self.wrong(key, "a text")),
        }
    }

    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>, Error> {
        match self.extras.get(key) {
            None => Ok(None),
            Some(value) => value.as_f64().map(Some).ok_or_else(|| self.wrong(key, "a number")),
        }
    }

    fn whole(&self, key: &str) -> Result<Option<i64>, Error> {
        match self.number(key)? {
            None => Ok(None),
            Some(n) if n.fract() == 0.0 && n.abs() < 1e15 => Ok(Some(n as i64)),
            Some(_) => Err(self.wrong(key, "a whole number")),
        }
    }

    /// A vector of three numbers.
    pub(crate) fn vector(&self, key: &str) -> Result<Option<[f64; 3]>, Error> {
        match self.rgb(key)? {
            None => Ok(None),
            Some(Rgb::Channels(vector)) => Ok(Some(vector)),
            Some(Rgb::Grey(_)) => Err(self.wrong(key, "three numbers")),
        }
    }

    fn rgb(&self, key: &str) -> Result<Option<Rgb>, Error> {
        let wrong = || self.wrong(key, "a number or three numbers");
        match self.extras.get(key) {
            None => Ok(None),
            Some(Value::Array(values)) => {
                let numbers: Option<Vec<f64>> = values.iter().map(Value::as_f64).collect();
                match numbers.as_deref() {
                    // Blender's colour properties may carry an alpha, which means nothing here.
                    Some(&[r, g, b] | &[r, g, b, _]) => Ok(Some(Rgb::Channels([r, g, b]))),
                    _ => Err(wrong()),
                }
            }
            Some(value) => value.as_f64().map(|v| Some(Rgb::Grey(v))).ok_or_else(wrong),
        }
    }
}
