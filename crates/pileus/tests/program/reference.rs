//! Schema, parser and reference page say the same.

use pileus::job::Job;
use pileus::schema;
use serde_json::{Map, Value};

use crate::{folder, json, path, root, run};

const PAGE: &str = "docs/book/src/reference/job.md";

/// A value that the schema allows, with every key of every object. `choice` picks among variants.
fn instance(schema: &Value, choice: usize) -> Value {
    let definitions = schema::definitions_by_name();
    if let Some(reference) = schema["$ref"].as_str() {
        return instance(&definitions[reference.rsplit('/').next().unwrap()], choice);
    }
    if let Some(value) = schema.get("const") {
        return value.clone();
    }
    for key in ["enum", "anyOf", "oneOf"] {
        if let Some(list) = schema[key].as_array() {
            let list: Vec<&Value> = list.iter().filter(|v| v["type"] != "null").collect();
            let picked = list[choice % list.len()];
            return if key == "enum" { picked.clone() } else { instance(picked, choice) };
        }
    }
    let kind = match &schema["type"] {
        Value::Array(kinds) => kinds.iter().find(|k| *k != "null").unwrap().as_str().unwrap(),
        kind => kind.as_str().unwrap(),
    };
    match kind {
        "object" => {
            let keys = schema["properties"].as_object().unwrap();
            Value::Object(keys.iter().map(|(k, s)| (k.clone(), instance(s, choice))).collect())
        }
        "array" => {
            let count = schema["minItems"].as_u64().unwrap_or(4) as usize;
            // One further: a variant that holds a list of its own kind must come to an end.
            (0..count).map(|i| instance(&schema["items"], choice + i + 1)).collect()
        }
        "string" => "text".into(),
        "boolean" => true.into(),
        "integer" => 1.into(),
        "number" => 0.5.into(),
        other => panic!("{other}"),
    }
}

/// A schema without what it says of values and of several keys: keys and types alone.
fn types_alone(schema: &Value) -> Value {
    match schema {
        Value::Array(list) => list.iter().map(types_alone).collect(),
        Value::Object(keywords) => {
            let fixed = keywords.get("minItems") == keywords.get("maxItems");
            let stays = |key: &str| match key {
                "allOf" | "not" | "pattern" | "uniqueItems" => false,
                key if key.ends_with("imum") || key.ends_with("Minimum") => false,
                key if key.ends_with("Maximum") => false,
                "minItems" | "maxItems" => fixed,
                // Beside a choice it is a rule.
                "items" => keywords.contains_key("type"),
                _ => true,
            };
            let kept = keywords.iter().filter(|(key, _)| stays(key));
            Value::Object(kept.map(|(key, value)| (key.clone(), types_alone(value))).collect())
        }
        other => other.clone(),
    }
}

fn read(value: &Value) -> Result<Job, pileus_scene::json::Fault> {
    pileus_scene::json::parse(&value.to_string())
}

#[test]
fn the_parser_reads_every_key_of_the_schema() {
    let job_schema = schema::job_schema();
    let validator = jsonschema::validator_for(&types_alone(&job_schema)).unwrap();
    for choice in 0..8 {
        let job = instance(&job_schema, choice);
        assert!(validator.is_valid(&job), "{job:#}");
        let parsed = read(&job).unwrap_or_else(|fault| panic!("{fault:?}\n{job:#}"));
        // What was read is written back, so nothing was ignored.
        assert_eq!(serde_json::to_value(&parsed).unwrap(), job);
    }
}

/// Every object of an instance with one more key, or one with a wrong type: neither schema nor
/// parser may accept it.
#[test]
fn schema_and_parser_refuse_the_same() {
    fn objects(value: &Value, pointer: &str, found: &mut Vec<String>) {
        match value {
            Value::Object(map) => {
                found.push(pointer.to_owned());
                map.iter().for_each(|(k, v)| objects(v, &format!("{pointer}/{k}"), found));
            }
            Value::Array(list) => {
                list.iter()
                    .enumerate()
                    .for_each(|(i, v)| objects(v, &format!("{pointer}/{i}"), found));
            }
            _ => {}
        }
    }
    let job_schema = schema::job_schema();
    let validator = jsonschema::validator_for(&types_alone(&job_schema)).unwrap();
    for choice in 0..3 {
        let job = instance(&job_schema, choice);
        let mut found = Vec::new();
        objects(&job, "", &mut found);
        for pointer in found {
            let mut wrong = job.clone();
            wrong.pointer_mut(&pointer).unwrap()["surplus"] = 1.into();
            assert!(!validator.is_valid(&wrong), "schema: {pointer}");
            let fault = read(&wrong).unwrap_err();
            assert_eq!(fault.pointer, format!("{pointer}/surplus"));
            let remedies = ["did you mean", "no further keys belong here"];
            assert!(remedies.iter().any(|r| fault.remedy.contains(r)), "{fault:?}");
        }
    }
}

#[test]
fn defaults_of_the_schema_can_be_written_down() {
    fn defaults(schema: &Value) -> Option<Value> {
        if let Some(value) = schema.get("default") {
            return Some(value.clone());
        }
        let definitions = schema::definitions_by_name();
        let reference = schema["$ref"].as_str().or(schema["anyOf"][0]["$ref"].as_str());
        let schema = match reference {
            Some(reference) => &definitions[reference.rsplit('/').next().unwrap()],
            None => schema,
        };
        let keys = schema["properties"].as_object()?;
        let map: Map<String, Value> =
            keys.iter().filter_map(|(k, s)| Some((k.clone(), defaults(s)?))).collect();
        (!map.is_empty()).then_some(Value::Object(map))
    }
    let job = defaults(&schema::job_schema()).unwrap();
    assert_eq!(job["sampling"]["spp"], 64);
    assert_eq!(job["gltf"]["lumens_per_watt"], 683.0);
    assert_eq!(job["film"]["filter"]["type"], "box");
    assert!(read(&job).is_ok(), "{job}");
}

#[test]
fn example_jobs_fit_the_schema() {
    let validator = jsonschema::validator_for(&schema::job_schema()).unwrap();
    let mut seen = 0;
    for entry in std::fs::read_dir(root().join("scenes/peers")).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|e| e == "json") {
            let text = std::fs::read_to_string(&file).unwrap();
            let job: Value = serde_json::from_str(&text).unwrap();
            assert!(validator.is_valid(&job), "{}", file.display());
            assert!(read(&job).is_ok(), "{}", file.display());
            seen += 1;
        }
    }
    assert!(seen >= 5);
    let page = std::fs::read_to_string(root().join(PAGE)).unwrap();
    let example = page.split("```json").nth(1).unwrap().split("```").next().unwrap();
    let example: Value = serde_json::from_str(example).unwrap();
    assert!(validator.is_valid(&example) && read(&example).is_ok());
}

#[test]
fn the_page_is_up_to_date() {
    let page = std::fs::read_to_string(root().join(PAGE)).unwrap_or_default();
    assert!(
        page.trim_end() == schema::reference_page().trim_end(),
        "{PAGE} is stale; write it again with: cargo run -p pileus -- schema --markdown > {PAGE}"
    );
}

#[test]
fn the_page_has_exactly_the_keys_of_the_schema() {
    let page = std::fs::read_to_string(root().join(PAGE)).unwrap();
    let (mut section, mut keys) = (String::new(), Vec::new());
    for line in page.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            section = name.to_owned();
        } else if let Some(name) = line.strip_prefix("### `") {
            assert!(name.ends_with('`'));
            keys.push(format!("{section}.type"));
        } else if let Some(row) = line.strip_prefix("| `") {
            keys.push(format!("{section}.{}", row.split('`').next().unwrap()));
        }
    }
    keys.sort();
    keys.dedup();
    assert_eq!(keys, schema::keys());
}

#[test]
fn the_command_prints_them() {
    let folder = folder(&[]);
    assert_eq!(json(folder.path(), &["schema"]), schema::job_schema());
    let page = run(folder.path(), &["schema", "--markdown"]).stdout;
    assert_eq!(String::from_utf8(page).unwrap().trim_end(), schema::reference_page().trim_end());
    let _ = path(PAGE);
}
