//! Fragments of JSON Schema that say how keys depend on each other.
//!
//! A fragment may say what to tell people where it is broken, in its `$comment`: what is wrong on
//! the first line, what to do on the second.

use serde_json::{Value, json};

/// Pattern: the file name has one run of `#` at most.
pub const ONE_RUN: &str = "^([^\\u0000]*/)?[^#/]*(#+[^#/]*)?$";

/// The object has the key, and not as null: null is as good as nothing.
pub fn given(key: &str) -> Value {
    with(key, json!({ "not": { "type": "null" } }))
}

/// The object does not have the key, or as null.
pub fn absent(key: &str) -> Value {
    json!({ "properties": { key: { "type": "null" } } })
}

/// The object has none of the keys.
pub fn none_of(keys: &[&str]) -> Value {
    let keys: serde_json::Map<String, Value> =
        keys.iter().map(|key| ((*key).to_owned(), json!({ "type": "null" }))).collect();
    json!({ "properties": keys })
}

/// The object has the key, with a value that fits a schema.
pub fn with(key: &str, schema: Value) -> Value {
    json!({ "required": [key], "properties": { key: schema } })
}

/// What holds of both.
pub fn both(a: Value, b: Value) -> Value {
    json!({ "allOf": [a, b] })
}

/// At most one of the two.
pub fn not_both(a: Value, b: Value) -> Value {
    json!({ "not": both(a, b) })
}

/// Where one holds the other must.
pub fn implies(condition: Value, consequence: Value) -> Value {
    json!({ "if": condition, "then": consequence })
}

/// A fragment with what is wrong where it is broken, and what to do about it.
pub fn rule(fragment: Value, what: &str, remedy: &str) -> Value {
    commented(fragment, format!("{what}\n{remedy}"))
}

/// A [`rule`] on what is legal, but not rendered by this version.
pub fn later(fragment: Value, what: &str, remedy: &str) -> Value {
    commented(fragment, format!("{what}\n{remedy}\n{LATER}"))
}

/// The last line of the comment of what a later version will render.
pub const LATER: &str = "not in this version";

fn commented(mut fragment: Value, comment: String) -> Value {
    if let Value::Object(keys) = &mut fragment {
        keys.insert("$comment".into(), comment.into());
    }
    fragment
}

/// A list of numbers that are not all zero: a vector with a direction.
pub fn direction() -> Value {
    let zero = json!({ "type": "array", "items": { "const": 0 } });
    rule(json!({ "not": zero }), "the vector has no direction", "give one that is not zero")
}
