//! Choices by name in JSON: read, written and described from their list alone.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;

use pileus_media::method::{Expectation, Named};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Value, json};

/// A choice that JSON writes as its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ByName<T>(pub T);

/// What follows the name of a choice that the format has and this version does not render.
pub(crate) const LATER: &str = " is not rendered by this version";

struct NameVisitor<'a, T> {
    /// Names that are known beside those of the type.
    others: &'a [&'static str],
    of: PhantomData<T>,
}

impl<T: Named> Visitor<'_> for NameVisitor<'_, T> {
    type Value = Option<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name")
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<Option<T>, E> {
        if self.others.contains(&name) {
            return Ok(None);
        }
        T::from_name(name).map(Some).ok_or_else(|| {
            let known =
                self.others.iter().copied().chain(T::ALL.iter().map(|choice| choice.name()));
            let known: Vec<String> = known.map(|name| format!("`{name}`")).collect();
            let known = known.join(", ");
            match T::LATER.contains(&name) {
                true => E::custom(format!("`{name}`{LATER}; there are {known}")),
                // The words of serde, of which messages are made.
                false => E::custom(format!("unknown variant `{name}`, expected one of {known}")),
            }
        })
    }
}

/// Reads the name of a choice; one of `others` is none.
///
/// # Errors
/// If there is no such name.
pub fn read_name<'de, T: Named, D: Deserializer<'de>>(
    deserializer: D,
    others: &[&'static str],
) -> Result<Option<T>, D::Error> {
    deserializer.deserialize_str(NameVisitor { others, of: PhantomData })
}

/// The schema of a list of choices, after others that the type does not have: name and meaning.
pub fn schema_of_names<T: Named>(others: &[(&'static str, &'static str)]) -> Schema {
    let row = |name: &str, about: String| -> Value {
        json!({ "type": "string", "const": name, "description": about })
    };
    let others = others.iter().map(|(name, about)| row(name, (*about).to_owned()));
    let own = T::ALL.iter().map(|choice| {
        let about = choice.about();
        match choice.expectation() {
            Some(Expectation::Biased(how)) => row(choice.name(), format!("{about} Biased: {how}.")),
            _ => row(choice.name(), about.to_owned()),
        }
    });
    let rows: Vec<Value> = others.chain(own).collect();
    let biased: Vec<String> = T::ALL
        .iter()
        .filter(|choice| matches!(choice.expectation(), Some(Expectation::Biased(_))))
        .map(|choice| format!("`{}`", choice.name()))
        .collect();
    let about = match biased.is_empty() {
        true => format!("{}.", T::QUESTION),
        false => format!("{}; all but {} are unbiased.", T::QUESTION, biased.join(" and ")),
    };
    let mut schema = Schema::default();
    schema.insert("description".into(), about.into());
    schema.insert("oneOf".into(), rows.into());
    schema
}

impl<T: Named> Serialize for ByName<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.name())
    }
}

impl<'de, T: Named> Deserialize<'de> for ByName<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let read = read_name(deserializer, &[])?;
        read.map(ByName).ok_or_else(|| de::Error::custom("there is no name"))
    }
}

impl<T: Named> JsonSchema for ByName<T> {
    fn schema_name() -> Cow<'static, str> {
        T::TITLE.into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        schema_of_names::<T>(&[])
    }
}
