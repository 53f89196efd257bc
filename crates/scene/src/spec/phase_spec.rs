//! What a user writes about the angular law of scattering.

use std::borrow::Cow;
use std::fmt;

use super::microflake_spec::{MicroflakeScatteringSpec, MicroflakeSpec};
use super::volume_rules as rules;
use crate::options;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{self, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A phase function, normalised over the sphere.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum PhaseSpec {
    /// Equal in all directions.
    Isotropic {},
    /// Henyey and Greenstein 1941.
    HenyeyGreenstein {
        /// Mean cosine between -1 and 1 without its ends; above 0 scatters forward.
        g: CosineSpec,
    },
    /// Two lobes of Henyey and Greenstein: `weight_forward` of the first, the rest of the second.
    TwoLobe {
        /// Mean cosine of the first lobe.
        #[schemars(extend("examples" = [0.9]))]
        #[schemars(transform = rules::cosine)]
        g_forward: f64,
        /// Mean cosine of the second lobe.
        #[schemars(extend("examples" = [-0.3]))]
        #[schemars(transform = rules::cosine)]
        g_backward: f64,
        /// Share of the first lobe, between 0 and 1.
        #[schemars(extend("examples" = [0.8]))]
        #[schemars(extend("minimum" = 0, "maximum" = 1))]
        weight_forward: f64,
    },
    /// A sum of up to 64 lobes of any kind without grids.
    Mixture {
        /// The lobes.
        #[schemars(transform = rules::lobes)]
        lobes: Vec<LobeSpec>,
    },
    /// Particles far smaller than the wavelength.
    Rayleigh {},
    /// Draine 2003: Henyey and Greenstein times `1 + alpha cos^2`.
    Draine {
        /// Parameter of the Henyey-Greenstein factor between -1 and 1 without its ends; not the
        /// mean cosine.
        #[schemars(transform = rules::cosine)]
        g: f64,
        /// Weight of the squared cosine, 0 to 1000000; 0 is Henyey-Greenstein, 1 with `g` 0 is
        /// Rayleigh.
        #[schemars(extend("minimum" = 0, "maximum" = 1e6))]
        alpha: f64,
    },
    /// Water droplets of clouds and fog: Henyey-Greenstein and Draine fitted to Mie theory
    /// (Jendersie and d'Eon 2023). Has neither fog bow nor glory; `tabulated` may.
    Mie {
        /// Diameter of the droplets in micrometres, 0.01 to 50.
        #[schemars(extend("examples" = [10]))]
        #[schemars(extend("minimum" = 0.01, "maximum" = 50))]
        droplet_diameter: f64,
    },
    /// Microflakes [Jakob et al. 2010] with normals by the SGGX distribution [Heitz et al. 2015].
    /// The extinction depends on direction: it is the density times the area that microflakes show,
    /// 1 where all face the ray.
    Sggx {
        /// How a microflake scatters.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        #[schemars(extend("default" = "specular"))]
        flakes: Option<MicroflakeScatteringSpec>,
        /// How their normals are distributed.
        distribution: MicroflakeSpec,
    },
    /// A table of measured or computed values.
    Tabulated {
        /// A text file with an angle in degrees and a value in each line, separated by a comma or
        /// blanks; `#` begins a comment. Angles ascend from 0 (forward) to 180; linear in the
        /// cosine between lines. Values are relative: the table is normalised. Relative to the file
        /// that names it.
        #[schemars(extend("examples" = ["water_10um.csv"]))]
        file: String,
    },
}

options! {
    /// A lobe of a mixture.
    pub struct LobeSpec {
        /// Relative to the other weights; at least 0.
        required weight: f64, rules::factor;
        /// The lobe.
        required phase: PhaseSpec;
    }
}

/// A mean cosine.
#[derive(Debug, Clone, PartialEq)]
pub enum CosineSpec {
    /// One cosine everywhere.
    Constant(f64),
    /// From a grid of the same file.
    Grid(CosineGridSpec),
}

options! {
    /// A mean cosine by a grid of the same file: `scale * value + offset`, clamped to -0.999 and
    /// 0.999.
    pub struct CosineGridSpec {
        /// Name of a grid of numbers.
        required grid: String;
        /// Factor.
        scale: f64 = 1.0, rules::offset;
        /// The mean cosine where the grid is 0.
        offset: f64 = 0.0, rules::offset;
    }
}

impl PhaseSpec {
    /// Changes the names of all files in it.
    pub fn map_files<E>(
        self,
        change: &mut dyn FnMut(String) -> Result<String, E>,
    ) -> Result<PhaseSpec, E> {
        Ok(match self {
            Self::Tabulated { file } => Self::Tabulated { file: change(file)? },
            Self::Mixture { lobes } => {
                let lobes = lobes.into_iter().map(|LobeSpec { weight, phase }| {
                    Ok(LobeSpec { weight, phase: phase.map_files(change)? })
                });
                Self::Mixture { lobes: lobes.collect::<Result<_, E>>()? }
            }
            other => other,
        })
    }
}

impl Serialize for CosineSpec {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Constant(g) => g.serialize(serializer),
            Self::Grid(grid) => grid.serialize(serializer),
        }
    }
}

/// Visits a number or an object; an untagged enum would do the same, but could not say what is
/// wrong.
struct CosineVisitor;

impl<'de> Visitor<'de> for CosineVisitor {
    type Value = CosineSpec;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number or {\"grid\": name}")
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<CosineSpec, E> {
        Ok(CosineSpec::Constant(value))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<CosineSpec, E> {
        self.visit_f64(value as f64)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<CosineSpec, E> {
        self.visit_f64(value as f64)
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CosineSpec, A::Error> {
        let map = de::value::MapAccessDeserializer::new(map);
        CosineGridSpec::deserialize(map).map(CosineSpec::Grid)
    }
}

impl<'de> Deserialize<'de> for CosineSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CosineVisitor)
    }
}

impl JsonSchema for CosineSpec {
    fn schema_name() -> Cow<'static, str> {
        "Cosine".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let grid = generator.subschema_for::<CosineGridSpec>();
        let limit = super::option::written(pileus_media::phase::MAX_G);
        json_schema!({
            "description": "A number, or a grid of the same file.",
            "anyOf": [{ "type": "number", "minimum": -limit, "maximum": limit }, grid]
        })
    }
}
