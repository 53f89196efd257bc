//! The JSON Schema of jobs, made from the options' declarations.

mod reference;

pub use reference::{properties_table, reference_page};

use serde_json::{Map, Value};

use crate::job::Job;

/// The JSON Schema (draft 2020-12) of a job.
pub fn job_schema() -> Value {
    let mut schema = schemars::schema_for!(Job).to_value();
    limit_integers(&mut schema);
    schema
}

/// Smallest and largest whole number of a `format`.
fn limits_of_format(format: &str) -> Option<[Value; 2]> {
    match format {
        "uint32" => Some([0.into(), u32::MAX.into()]),
        "uint64" => Some([0.into(), u64::MAX.into()]),
        "int64" => Some([i64::MIN.into(), i64::MAX.into()]),
        _ => None,
    }
}

/// Writes out what the `format` of whole numbers means, which validators do not hold values
/// against.
fn limit_integers(schema: &mut Value) {
    match schema {
        Value::Array(list) => list.iter_mut().for_each(limit_integers),
        Value::Object(keywords) => {
            let format = keywords.get("format").and_then(Value::as_str);
            let limits = format.and_then(limits_of_format);
            for (key, limit) in ["minimum", "maximum"].into_iter().zip(limits.into_iter().flatten())
            {
                keywords.entry(key).or_insert(limit);
            }
            keywords.values_mut().for_each(limit_integers);
        }
        _ => {}
    }
}

/// Every key that the schema knows, as `Object.key`.
pub fn keys() -> Vec<String> {
    let schema = job_schema();
    let mut keys = Vec::new();
    let mut collect = |name: &str, schema: &Value| {
        for object in objects(schema) {
            keys.extend(properties(object).map(|(key, _)| format!("{name}.{key}")));
        }
    };
    collect("Job", &schema);
    for (name, definition) in definitions(&schema) {
        collect(name, definition);
    }
    keys.sort();
    keys.dedup();
    keys
}

/// What the page calls a definition.
fn title(name: &str) -> &str {
    name.strip_suffix("Spec").unwrap_or(name)
}

fn definitions(schema: &Value) -> impl Iterator<Item = (&str, &Value)> {
    schema
        .get("$defs")
        .and_then(Value::as_object)
        .into_iter()
        .flatten()
        .map(|(name, definition)| (title(name), definition))
}

fn properties(object: &Value) -> impl Iterator<Item = (&str, &Value)> {
    object
        .get("properties")
        .and_then(Value::as_object)
        .into_iter()
        .flatten()
        .map(|(key, schema)| (key.as_str(), schema))
}

/// The object schemas of a definition: itself, or its variants.
fn objects(schema: &Value) -> Vec<&Value> {
    if schema.get("properties").is_some() {
        return vec![schema];
    }
    variants(schema).iter().filter(|v| v.get("properties").is_some()).collect()
}

fn variants(schema: &Value) -> &[Value] {
    let list = schema.get("oneOf").or_else(|| schema.get("anyOf"));
    list.and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// The `$defs` of the schema by name.
pub fn definitions_by_name() -> Map<String, Value> {
    match job_schema().get("$defs") {
        Some(Value::Object(map)) => map.clone(),
        _ => Map::new(),
    }
}

/// What is said of an option, on one line: `spp` of `SamplingSpec`, for the help of the command
/// line.
pub(crate) fn about(definition: &str, key: &str) -> String {
    let schema = job_schema();
    let option = schema.pointer(&format!("/$defs/{definition}/properties/{key}"));
    option.and_then(description).unwrap_or_default()
}

/// The description on one line.
fn description(schema: &Value) -> Option<String> {
    let text = schema.get("description")?.as_str()?;
    Some(text.split_whitespace().collect::<Vec<_>>().join(" "))
}
