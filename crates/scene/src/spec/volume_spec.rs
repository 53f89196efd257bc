//! What a user writes about one volume: the same keys in a job, in the glTF extension
//! `PILEUS_volume` and in `extras`.

use std::borrow::Cow;
use std::fmt;

use super::by_name::ByName;
use super::option::{above, at_least, at_most, below, pattern};
use super::phase_spec::PhaseSpec;
use super::{volume_rules as rules, whole};
use crate::options;
use pileus_media::Interpolation;
use pileus_media::method::Named;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Albedo of a volume that does not name one.
pub const DEFAULT_ALBEDO: f64 = 0.999;

options! {
    /// One volume: grids of an OpenVDB file, or a homogeneous medium.
    #[derive(Default)]
    #[schemars(extend("allOf" = rules::volume()))]
    pub struct VolumeSpec {
        /// Name for messages and metadata. Default: the name of the file.
        name: String;
        /// The OpenVDB file, relative to the file that names it. A run of `#` stands for the frame
        /// number, padded with zeros to the length of the run. Either this or `homogeneous` is
        /// needed.
        #[schemars(extend("examples" = ["cumulus.vdb", "smoke.####.vdb"]))]
        vdb: String, pattern(super::schema_rule::ONE_RUN);
        /// The frame number that replaces `#` in `vdb`.
        #[serde(deserialize_with = "whole::option")]
        frame: i64;
        /// Which grid gives the density and how much extinction it means.
        density: DensitySpec;
        /// Extinction of the channels relative to each other; a number means grey.
        extinction: Rgb = Rgb::Grey(1.0), rules::at_most(1e30);
        /// Single-scattering albedo between 0 and 1: per channel, grey, or a grid.
        albedo: AlbedoSpec = AlbedoSpec::Constant(Rgb::Grey(DEFAULT_ALBEDO));
        /// The angular law of scattering.
        phase: PhaseSpec = PhaseSpec::Isotropic {};
        /// How light gets through: transmittance as a function of optical depth.
        law: TransmittanceFunctionSpec = TransmittanceFunctionSpec::Exponential {};
        /// A weighted sum of transmittance functions instead of `law`.
        #[schemars(extend("minItems" = 1, "maxItems" = 64))]
        law_mixture: Vec<MixtureComponentSpec>;
        /// Light that the volume emits.
        emission: EmissionSpec;
        /// How values between voxels are formed.
        interpolation: ByName<Interpolation> = ByName(Interpolation::Trilinear);
        /// Placement, applied after the grid's own transform (and after `up_axis`).
        transform: TransformSpec;
        /// The axis that points up in the OpenVDB file; `z` maps its (x, y, z) to (x, z, -y).
        up_axis: ByName<UpAxis> = ByName(UpAxis::Y);
        /// Extinction that is the same everywhere, instead of a grid.
        homogeneous: HomogeneousSpec;
    }
}

options! {
    /// Density: `sigma_t = scale * value * extinction`, per scene unit.
    #[derive(Default)]
    pub struct DensitySpec {
        /// Name of a float grid, or `name[i]` for the i-th of that name. Default: `density` if
        /// there is one, else the only fog volume of the file.
        #[schemars(extend("examples" = ["density", "density[1]"]))]
        grid: String;
        /// Extinction per scene unit where the grid has the value 1; at least 0.
        scale: f64 = 1.0, rules::factor;
    }
}

/// Largest number of a colour, what single precision has.
pub const LARGEST_COLOR: f64 = 3.4e38;

/// A number for all channels, or one per channel (linear Rec. 709).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rgb {
    /// One number for all channels.
    Grey(f64),
    /// Red, green and blue.
    Channels([f64; 3]),
}

impl Rgb {
    /// The three channels.
    pub fn channels(self) -> [f64; 3] {
        match self {
            Self::Grey(value) => [value; 3],
            Self::Channels(channels) => channels,
        }
    }
}

/// Single-scattering albedo.
#[derive(Debug, Clone, PartialEq)]
pub enum AlbedoSpec {
    /// One albedo everywhere.
    Constant(Rgb),
    /// The values of a grid of the same file.
    Grid(String),
}

/// A transmittance function: `T(tau)` between places that have nothing to do with the volume's
/// particles. Rays that start at one of them follow `T'(tau) / T'(0)`, so that transport conserves
/// energy and is reciprocal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum TransmittanceFunctionSpec {
    /// `exp(-tau)`: particles without order.
    Exponential {},
    /// `(1 + tau / k)^-k`: particles in clusters.
    Power {
        /// Above 1; exponential as it grows.
        #[schemars(extend("exclusiveMinimum" = 1, "maximum" = 1e9))]
        k: f64,
    },
    #[schemars(extend("allOf" = [rules::davis_weinstein()]))]
    /// Clusters at all scales (Davis and Mineev-Weinstein 2011): optical depths vary by a gamma
    /// distribution of variance `(c tau)^(2 h)`.
    DavisWeinstein {
        /// Hurst exponent, above 0.5 and at most 1; 1 is the power law of `k = 1 / c^2`.
        #[schemars(extend("exclusiveMinimum" = 0.5, "maximum" = 1))]
        h: f64,
        /// Strength of the variation, above 0; below 1 where `h` is 1.
        #[schemars(extend("exclusiveMinimum" = 0, "maximum" = 1000))]
        c: f64,
    },
    /// Particles that keep apart: flights between them are sums of `n` exponential ones.
    Erlang {
        /// From 2 to 64; the more, the more regular.
        #[serde(deserialize_with = "whole::number")]
        #[schemars(extend("minimum" = 2, "maximum" = 64))]
        n: u32,
    },
    /// `max(0, 1 - tau)`: from particle to particle always the same optical depth.
    Linear {},
    /// Through the points of a file.
    Table {
        /// A text file: an optical depth and a transmittance on each line, from `0, 1` on, falling
        /// and convex; `#` begins a comment. Where the last transmittance is not 0 the rest is
        /// exponential.
        file: String,
    },
}

options! {
    /// One transmittance function of a mixture.
    pub struct MixtureComponentSpec {
        /// Its share, above 0; shares are divided by their sum.
        required weight: f64, above(0), at_most(1e9);
        /// Factor on its optical depth, above 0.
        rate: f64 = 1.0, above(1e-9), at_most(1e9);
        /// The transmittance function.
        required law: TransmittanceFunctionSpec;
    }
}

impl VolumeSpec {
    /// Replaces the names of all files by what `resolve` makes of them; it is given the JSON
    /// pointer of the key, relative to this object.
    ///
    /// # Errors
    /// The first that `resolve` returns.
    pub fn resolve_files<E>(
        &mut self,
        mut resolve: impl FnMut(&str, &str) -> Result<String, E>,
    ) -> Result<(), E> {
        if let Some(vdb) = &mut self.vdb {
            *vdb = resolve("/vdb", vdb)?;
        }
        if let Some(phase) = self.phase.take() {
            self.phase = Some(phase.map_files(&mut |name| resolve("/phase", &name))?);
        }
        let mixture = self.law_mixture.iter_mut().flatten().enumerate();
        let functions = self
            .law
            .iter_mut()
            .map(|one| ("/law/file".to_owned(), one))
            .chain(mixture.map(|(i, c)| (format!("/law_mixture/{i}/law/file"), &mut c.law)));
        for (pointer, function) in functions {
            if let TransmittanceFunctionSpec::Table { file } = function {
                *file = resolve(&pointer, file)?;
            }
        }
        Ok(())
    }
}

/// Light that a volume emits, as radiance per scene unit along a ray; scaling the volume makes
/// it larger, and thereby brighter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum EmissionSpec {
    /// Glowing soot: `sigma_a = sigma_t * (1 - albedo)` of the volume times the radiance of a black
    /// body, so that there is light where there is both density and heat. Black below 500 K,
    /// constant above 20000 K; colours outside Rec. 709 are clamped at the same luminance.
    Blackbody {
        /// Where the temperature comes from.
        temperature: TemperatureSpec,
        /// Factor on the radiance.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 1))]
        #[schemars(transform = rules::factor)]
        intensity: Option<f64>,
        /// False: Planck's radiance in W/(m^2 sr), weighted by the CIE 1931 observer, so that 683
        /// times its luminance is in cd/m^2. True: the same colour at luminance 1 (rising from 0 at
        /// 500 K to 1 at 800 K).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = false))]
        normalised: Option<bool>,
    },
    #[schemars(extend("allOf" = [rules::color_or_ramp()]))]
    /// Radiance added per scene unit, whatever the density: `scale * color * value`, or `scale`
    /// times the colour that `ramp` gives the value. What Cycles calls emission coefficients.
    Grid {
        /// Name of a grid of numbers, or of vectors (red, green, blue).
        grid: String,
        /// Linear Rec. 709; excludes `ramp`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = [1, 1, 1]))]
        #[schemars(transform = rules::at_most(1e30))]
        color: Option<Rgb>,
        /// Factor.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = 1))]
        #[schemars(transform = rules::factor)]
        scale: Option<f64>,
        /// Colours by grid value, in ascending order: linear between them, constant beyond the
        /// first and the last. Black at the grid's background, 0 as a rule.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("minItems" = 1))]
        ramp: Option<Vec<RampNodeSpec>>,
    },
}

options! {
    /// One colour of a ramp.
    pub struct RampNodeSpec {
        /// Value of the grid.
        required value: f64, rules::offset;
        /// Linear Rec. 709.
        required color: Rgb, rules::at_most(1e30);
    }
}

options! {
    /// Temperature in kelvin: `scale * value + offset`.
    pub struct TemperatureSpec {
        /// Name of a grid of numbers; negative ones count as 0.
        required grid: String;
        /// Kelvin per grid unit; at least 0.
        scale: f64 = 1.0, rules::factor;
        /// Kelvin where the grid is 0.
        offset: f64 = 0.0, rules::offset;
    }
}

options! {
    /// Scale, then rotation, then translation.
    #[derive(Default)]
    pub struct TransformSpec {
        /// Scene units.
        translation: [f64; 3] = [0.0; 3];
        /// Quaternion (x, y, z, w).
        #[schemars(extend("allOf" = [super::schema_rule::direction()]))]
        rotation: [f64; 4] = [0.0, 0.0, 0.0, 1.0];
        /// Factors along the axes, none of them 0.
        scale: [f64; 3] = [1.0; 3], rules::scales;
    }
}

/// The axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// +Y, as in glTF.
    #[default]
    Y,
    /// +Z, as in Blender.
    Z,
}

impl Named for UpAxis {
    const ALL: &'static [UpAxis] = &[UpAxis::Y, UpAxis::Z];
    const TITLE: &'static str = "UpAxis";
    const QUESTION: &'static str = "The axis that points up";

    fn name(self) -> &'static str {
        match self {
            UpAxis::Y => "y",
            UpAxis::Z => "z",
        }
    }

    fn about(self) -> &'static str {
        match self {
            UpAxis::Y => "+Y, as in glTF.",
            UpAxis::Z => "+Z, as in Blender.",
        }
    }
}

options! {
    /// Extinction that is the same everywhere.
    pub struct HomogeneousSpec {
        /// Extinction per scene unit, multiplied by `extinction`; at least 0.
        required sigma_t: f64, at_least(0), below(1e30);
        /// Lowest and highest corner of the box it fills; null fills space.
        #[schemars(extend("default" = null))]
        bounds: [[f64; 3]; 2];
    }
}

impl Serialize for Rgb {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Grey(value) => value.serialize(serializer),
            Self::Channels(channels) => channels.serialize(serializer),
        }
    }
}

impl Serialize for AlbedoSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Constant(rgb) => rgb.serialize(serializer),
            Self::Grid(grid) => GridKey { grid: grid.clone() }.serialize(serializer),
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GridKey {
    grid: String,
}

/// Visits a number or three numbers; with `GRID` also an object with the key `grid`. Untagged enums
/// would do the same, but could not say what is wrong.
struct RgbVisitor<const GRID: bool>;

impl<'de, const GRID: bool> Visitor<'de> for RgbVisitor<GRID> {
    type Value = AlbedoSpec;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or three numbers")?;
        if GRID { f.write_str(" or {\"grid\": name}") } else { Ok(()) }
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<AlbedoSpec, E> {
        Ok(AlbedoSpec::Constant(Rgb::Grey(value)))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<AlbedoSpec, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<AlbedoSpec, E> {
        self.visit_f64(value as f64)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<AlbedoSpec, A::Error> {
        let mut channels = [0.0; 3];
        for (i, channel) in channels.iter_mut().enumerate() {
            *channel = seq.next_element()?.ok_or_else(|| de::Error::invalid_length(i, &self))?;
        }
        if seq.next_element::<de::IgnoredAny>()?.is_some() {
            return Err(de::Error::invalid_length(4, &self));
        }
        Ok(AlbedoSpec::Constant(Rgb::Channels(channels)))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<AlbedoSpec, A::Error> {
        if !GRID {
            return Err(de::Error::invalid_type(de::Unexpected::Map, &self));
        }
        let key = GridKey::deserialize(de::value::MapAccessDeserializer::new(map))?;
        Ok(AlbedoSpec::Grid(key.grid))
    }
}

impl<'de> Deserialize<'de> for Rgb {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match deserializer.deserialize_any(RgbVisitor::<false>)? {
            AlbedoSpec::Constant(rgb) => Ok(rgb),
            AlbedoSpec::Grid(_) => Err(de::Error::custom("a grid is not possible here")),
        }
    }
}

impl<'de> Deserialize<'de> for AlbedoSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RgbVisitor::<true>)
    }
}

impl JsonSchema for Rgb {
    fn schema_name() -> Cow<'static, str> {
        "Rgb".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A number for all channels, or [red, green, blue] (linear Rec. 709).",
            "anyOf": [
                { "type": "number", "minimum": 0, "maximum": LARGEST_COLOR },
                {
                    "type": "array",
                    "items": { "type": "number", "minimum": 0, "maximum": LARGEST_COLOR },
                    "minItems": 3,
                    "maxItems": 3
                }
            ]
        })
    }
}

impl JsonSchema for AlbedoSpec {
    fn schema_name() -> Cow<'static, str> {
        "Albedo".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "A number for all channels, [red, green, blue], or a grid of the same file.",
            "anyOf": [
                { "type": "number", "minimum": 0, "maximum": 1 },
                {
                    "type": "array",
                    "items": { "type": "number", "minimum": 0, "maximum": 1 },
                    "minItems": 3,
                    "maxItems": 3
                },
                {
                    "type": "object",
                    "properties": {
                        "grid": { "type": "string", "description": "Name of a float or vector grid." }
                    },
                    "required": ["grid"],
                    "additionalProperties": false
                }
            ]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::json;

    #[test]
    fn reads_every_form_of_the_specification() {
        let text = r#"{
            "name": "cloud", "vdb": "cumulus.vdb", "frame": 3,
            "density": { "grid": "density[1]", "scale": 40.0 },
            "extinction": [1, 0.5, 0.25], "albedo": {"grid": "Cd"},
            "phase": { "type": "henyey_greenstein", "g": 0.8 },
            "emission": { "type": "blackbody", "temperature": { "grid": "temperature", "scale": 1.0,
                          "offset": 0.0 }, "intensity": 1.0, "normalised": false },
            "interpolation": "nearest", "up_axis": "z",
            "transform": { "translation": [0,0,0], "rotation": [0,0,0,1], "scale": [1,1,1] }
        }"#;
        let spec: VolumeSpec = json::parse(text).unwrap();
        assert_eq!(spec.albedo, Some(AlbedoSpec::Grid("Cd".into())));
        assert_eq!(spec.extinction.unwrap().channels(), [1.0, 0.5, 0.25]);
        let again: VolumeSpec = json::parse(&serde_json::to_string(&spec).unwrap()).unwrap();
        assert_eq!(again, spec);
        let fog: VolumeSpec = json::parse(
            r#"{ "name": "fog", "homogeneous": { "sigma_t": 0.01, "bounds": null }, "albedo": 0.9 }"#,
        )
        .unwrap();
        assert_eq!(fog.homogeneous.unwrap().bounds, None);
        assert_eq!(fog.albedo, Some(AlbedoSpec::Constant(Rgb::Grey(0.9))));
        let grid: VolumeSpec = json::parse(
            r#"{"emission": { "type": "grid", "grid": "flame", "color": [1,0.35,0.08], "scale": 20 }}"#,
        )
        .unwrap();
        assert!(matches!(grid.emission, Some(EmissionSpec::Grid { .. })));
        let ramp: VolumeSpec = json::parse(
            r#"{"emission": { "type": "grid", "grid": "heat", "ramp": [{"value": 0, "color": 0},
                {"value": 1, "color": [1, 0.5, 0]}] }}"#,
        )
        .unwrap();
        let Some(EmissionSpec::Grid { ramp: Some(ramp), .. }) = ramp.emission else { panic!() };
        assert_eq!(ramp[1].color, Rgb::Channels([1.0, 0.5, 0.0]));
    }

    #[test]
    fn faults_are_placed() {
        let fault = |text: &str| json::parse::<VolumeSpec>(text).unwrap_err();
        assert_eq!(fault(r#"{"albedo": [1, 2]}"#).pointer, "/albedo");
        assert!(fault(r#"{"albedo": [1, 2]}"#).what.contains("three numbers"));
        assert_eq!(fault(r#"{"albedo": {"gird": "a"}}"#).pointer, "/albedo/gird");
        assert!(fault(r#"{"extinction": {"grid": "a"}}"#).what.contains("three numbers"));
        assert!(
            fault(r#"{"phase": {"type": "isotropic", "g": 1}}"#).what.contains("unknown key `g`")
        );
        assert!(
            fault(r#"{"phase": {"type": "henyey_greenstein", "G": 1}}"#).remedy.contains("`g`")
        );
        assert!(fault(r#"{"up_axis": "x"}"#).what.contains("unknown value `x`"));
    }
}
