//! Choices by name that may be left to the plan, by the name `auto`.

use std::borrow::Cow;

use pileus_integrator::ShadowRoulette;
use pileus_media::distance::DistanceSampler;
use pileus_media::method::{Named, name_or_auto};
use pileus_media::transmittance::Estimator;
use pileus_scene::by_name::{read_name, schema_of_names};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A choice by name; `None`, written `auto`, leaves it to the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Auto<T>(pub Option<T>);

/// A choice that the plan can make.
pub trait LeftToThePlan: Named {
    /// What the plan chooses, for users.
    const AUTO: &'static str;
}

impl LeftToThePlan for Estimator {
    const AUTO: &'static str =
        "What costs the least error x time in whole images, by measurement: `ratio`.";
}

impl LeftToThePlan for DistanceSampler {
    const AUTO: &'static str = "What costs the least error x time in whole images, by measurement: `delta` for grey media, \
         `split` for one grid of extinction per channel, `spectral` for others; with `equiangular` \
         points where point or spot lights shine into very thin media.";
}

impl LeftToThePlan for ShadowRoulette {
    const AUTO: &'static str =
        "`expected` where paths scatter rarely, else `importance`, by measurement.";
}

impl<T: Named> Serialize for Auto<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(name_or_auto(self.0))
    }
}

impl<'de, T: Named> Deserialize<'de> for Auto<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        read_name(deserializer, &["auto"]).map(Auto)
    }
}

impl<T: LeftToThePlan> JsonSchema for Auto<T> {
    fn schema_name() -> Cow<'static, str> {
        T::TITLE.into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schema_of_names::<T>(&[("auto", T::AUTO)])
    }
}
