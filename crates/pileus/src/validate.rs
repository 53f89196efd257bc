//! Holds a JSON value against the job's schema, so that what the schema refuses is refused by the
//! program too, with a place and a remedy.
//!
//! Knows the keywords that the schema uses, and no more; a test holds it against a complete
//! validator. Patterns are known by name: see `fits` below.

use std::cmp::Ordering;

use pileus_scene::schema_rule::{LATER, ONE_RUN};
use serde_json::{Map, Number, Value};

use crate::job::rules::{EXR, FILE, MAJORANTS, PNG};

/// What is wrong with a value, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// JSON pointer (RFC 6901) of the value.
    pub pointer: String,
    /// What is wrong.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
    /// Whether the value is legal, but not rendered by this version.
    pub later: bool,
    /// Whether it is one item of a list that is too much: the place that a rule about the list
    /// means.
    surplus: bool,
}

impl Fault {
    fn new(pointer: &str, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        let (what, remedy) = (what.into(), remedy.into());
        Self { pointer: pointer.to_owned(), what, remedy, later: false, surplus: false }
    }
}

/// Holds a value against a schema.
///
/// # Errors
/// The first fault that was met; of alternatives that are all broken, that which lies deepest.
pub fn validate(schema: &Value, value: &Value) -> Result<(), Fault> {
    let definitions = schema.get("$defs").and_then(Value::as_object);
    Validator { definitions }.check(schema, value, "")
}

struct Validator<'a> {
    definitions: Option<&'a Map<String, Value>>,
}

impl Validator<'_> {
    fn check(&self, schema: &Value, value: &Value, pointer: &str) -> Result<(), Fault> {
        let keywords = match schema {
            Value::Bool(false) => {
                return Err(Fault::new(pointer, "nothing belongs here", "remove it"));
            }
            Value::Object(keywords) => keywords,
            _ => return Ok(()),
        };
        self.keywords(keywords, value, pointer).map_err(|fault| {
            // What a rule says of itself is better than what was met in it.
            let mut comment =
                keywords.get("$comment").and_then(Value::as_str).unwrap_or("").lines();
            match (comment.next(), comment.next()) {
                (Some(what), Some(remedy)) => {
                    let later = comment.next() == Some(LATER);
                    let place = if fault.surplus { &fault.pointer } else { pointer };
                    Fault { later, ..Fault::new(place, what, remedy) }
                }
                _ => fault,
            }
        })
    }

    fn keywords(
        &self,
        keywords: &Map<String, Value>,
        value: &Value,
        pointer: &str,
    ) -> Result<(), Fault> {
        if let Some(schema) = keywords.get("$ref").and_then(|name| self.definition(name)) {
            self.check(schema, value, pointer)?;
        }
        simple(keywords, value, pointer)?;
        match value {
            Value::Number(number) => in_range(keywords, number, pointer)?,
            Value::Array(items) => self.array(keywords, items, pointer)?,
            Value::Object(members) => self.object(keywords, members, pointer)?,
            _ => {}
        }
        for schema in list(keywords, "allOf") {
            self.check(schema, value, pointer)?;
        }
        if let Some(choices) = keywords.get("anyOf").and_then(Value::as_array) {
            self.choose(choices, value, pointer)?;
        }
        if let Some(choices) = keywords.get("oneOf").and_then(Value::as_array) {
            self.choose(choices, value, pointer)?;
            let fitting = choices.iter().filter(|c| self.check(c, value, pointer).is_ok()).count();
            if fitting > 1 {
                let what = "this fits several forms that exclude each other";
                return Err(Fault::new(pointer, what, "keep one of them"));
            }
        }
        if let Some(schema) = keywords.get("not")
            && self.check(schema, value, pointer).is_ok()
        {
            return Err(Fault::new(pointer, "this value is excluded", "use another one"));
        }
        if let (Some(condition), Some(consequence)) = (keywords.get("if"), keywords.get("then"))
            && self.check(condition, value, pointer).is_ok()
        {
            self.check(consequence, value, pointer)?;
        }
        Ok(())
    }

    fn definition(&self, name: &Value) -> Option<&Value> {
        let name = name.as_str()?.strip_prefix("#/$defs/")?;
        self.definitions?.get(name)
    }

    /// One of several schemas must fit; the fault is that of the one that was most likely meant.
    fn choose(&self, choices: &[Value], value: &Value, pointer: &str) -> Result<(), Fault> {
        let mut deepest: Option<Fault> = None;
        for choice in choices {
            let Err(fault) = self.check(choice, value, pointer) else { return Ok(()) };
            if self.is_other_kind(choice, value) {
                continue;
            }
            if deepest.as_ref().is_none_or(|known| known.pointer.len() < fault.pointer.len()) {
                deepest = Some(fault);
            }
        }
        let none =
            || Fault::new(pointer, "this fits none of the possible forms", "see the job reference");
        Err(deepest.unwrap_or_else(none))
    }

    /// Whether a choice is not meant: null, or an object of another `type`.
    fn is_other_kind(&self, choice: &Value, value: &Value) -> bool {
        let choice = choice.get("$ref").and_then(|name| self.definition(name)).unwrap_or(choice);
        if choice.get("type").is_some_and(|kind| kind == "null") {
            return true;
        }
        let tag = choice.pointer("/properties/type/const");
        tag.is_some() && tag != value.get("type")
    }

    fn array(
        &self,
        keywords: &Map<String, Value>,
        items: &[Value],
        pointer: &str,
    ) -> Result<(), Fault> {
        let count = items.len() as u64;
        let limit = |key: &str| keywords.get(key).and_then(Value::as_u64);
        if let Some(least) = limit("minItems").filter(|least| count < *least) {
            let what = format!("the list has {count} values, where {least} are the fewest");
            return Err(Fault::new(pointer, what, "add what is missing"));
        }
        if let Some(most) = limit("maxItems").filter(|most| count > *most) {
            let what = format!("the list has {count} values, where {most} are the most");
            return Err(Fault::new(pointer, what, "remove what is too much"));
        }
        let unique = keywords.get("uniqueItems") == Some(&Value::Bool(true));
        let again = |(i, item): &(usize, &Value)| items[..*i].iter().any(|one| same(one, item));
        if let Some((i, item)) = items.iter().enumerate().find(again).filter(|_| unique) {
            let what = format!("{item} stands in the list already");
            return Err(Fault::new(&format!("{pointer}/{i}"), what, "remove it here"));
        }
        let first = list(keywords, "prefixItems");
        for (i, item) in items.iter().enumerate() {
            let schema = first.get(i).or_else(|| keywords.get("items"));
            if let Some(schema) = schema {
                self.check(schema, item, &format!("{pointer}/{i}"))?;
            }
        }
        if let Some(schema) = keywords.get("contains") {
            let fits = |item: &&Value| self.check(schema, item, "").is_ok();
            let fitting = items.iter().filter(fits).count() as u64;
            let (least, most) = (limit("minContains").unwrap_or(1), limit("maxContains"));
            let what = || format!("{fitting} values of the list are of a kind that it limits");
            if fitting < least {
                return Err(Fault::new(pointer, what(), "see the job reference"));
            }
            let most = most.and_then(|most| usize::try_from(most).ok());
            let mut of_kind = items.iter().enumerate().filter(|(_, item)| fits(item));
            if let Some((i, _)) = most.and_then(|most| of_kind.nth(most)) {
                let place = format!("{pointer}/{i}");
                let fault = Fault::new(&place, what(), "see the job reference");
                return Err(Fault { surplus: true, ..fault });
            }
        }
        Ok(())
    }

    fn object(
        &self,
        keywords: &Map<String, Value>,
        members: &Map<String, Value>,
        pointer: &str,
    ) -> Result<(), Fault> {
        let missing = list(keywords, "required")
            .iter()
            .filter_map(Value::as_str)
            .find(|key| !members.contains_key(*key));
        if let Some(key) = missing {
            let what = format!("the key `{key}` is missing");
            return Err(Fault::new(pointer, what, format!("add `\"{key}\": ...` to this object")));
        }
        let properties = keywords.get("properties").and_then(Value::as_object);
        for (key, member) in members {
            let below = format!("{pointer}/{}", key.replace('~', "~0").replace('/', "~1"));
            match properties.and_then(|properties| properties.get(key)) {
                Some(schema) => self.check(schema, member, &below)?,
                None if keywords.get("additionalProperties") == Some(&Value::Bool(false)) => {
                    let what = format!("unknown key `{key}`");
                    return Err(Fault::new(&below, what, "remove it"));
                }
                None => {}
            }
        }
        Ok(())
    }
}

fn list<'a>(keywords: &'a Map<String, Value>, key: &str) -> &'a [Value] {
    keywords.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// What needs no other schema: types, constants, texts.
fn simple(keywords: &Map<String, Value>, value: &Value, pointer: &str) -> Result<(), Fault> {
    let types: Vec<&str> = match keywords.get("type") {
        Some(Value::String(name)) => vec![name],
        Some(Value::Array(names)) => names.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    };
    if !types.is_empty() && !types.iter().any(|name| is_of_type(value, name)) {
        let names: Vec<&str> =
            types.iter().filter(|n| **n != "null").map(|n| in_words(n)).collect();
        let expected = names.join(" or ");
        let what = format!("{} where {expected} is expected", kind_of(value));
        return Err(Fault::new(pointer, what, format!("write {expected} here")));
    }
    if let Some(constant) = keywords.get("const").filter(|constant| !same(constant, value)) {
        let what = format!("{value} where {constant} is expected");
        return Err(Fault::new(pointer, what, format!("write {constant} here")));
    }
    let choices = list(keywords, "enum");
    if keywords.contains_key("enum") && !choices.iter().any(|choice| same(choice, value)) {
        let known: Vec<String> = choices.iter().map(Value::to_string).collect();
        let what = format!("unknown value {value}");
        return Err(Fault::new(pointer, what, format!("known here: {}", known.join(", "))));
    }
    if let (Some(pattern), Value::String(text)) =
        (keywords.get("pattern").and_then(Value::as_str), value)
        && let Err((what, remedy)) = fits(pattern, text)
    {
        let later = what == HAS_FRAME;
        return Err(Fault { later, ..Fault::new(pointer, format!("{value} {what}"), remedy) });
    }
    Ok(())
}

fn kind_of(value: &Value) -> String {
    match value {
        Value::Null => "null".into(),
        Value::Bool(_) | Value::Number(_) => value.to_string(),
        Value::String(_) => "a text".into(),
        Value::Array(_) => "a list".into(),
        Value::Object(_) => "an object".into(),
    }
}

fn in_words(name: &str) -> &str {
    match name {
        "integer" => "a whole number",
        "number" => "a number",
        "string" => "a text",
        "boolean" => "true or false",
        "array" => "a list",
        "object" => "an object",
        other => other,
    }
}

fn is_of_type(value: &Value, name: &str) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        "number" => value.is_number(),
        "integer" => match value {
            Value::Number(number) => is_whole(number),
            _ => false,
        },
        _ => false,
    }
}

fn is_whole(number: &Number) -> bool {
    number.is_u64() || number.is_i64() || number.as_f64().is_some_and(|v| v.fract() == 0.0)
}

/// Equality as JSON Schema has it: 0 and 0.0 are one number.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => compare(a, b) == Some(Ordering::Equal),
        _ => a == b,
    }
}

/// Compares numbers; whole ones exactly, which doubles cannot hold from 2^53 on.
fn compare(a: &Number, b: &Number) -> Option<Ordering> {
    let exact = |number: &Number| {
        let from_double = || {
            let value = number.as_f64()?;
            (value.fract() == 0.0 && value.abs() < 1e30).then_some(value as i128)
        };
        number
            .as_u64()
            .map(i128::from)
            .or_else(|| number.as_i64().map(i128::from))
            .or_else(from_double)
    };
    match (exact(a), exact(b)) {
        (Some(a), Some(b)) => Some(a.cmp(&b)),
        _ => a.as_f64()?.partial_cmp(&b.as_f64()?),
    }
}

fn in_range(keywords: &Map<String, Value>, number: &Number, pointer: &str) -> Result<(), Fault> {
    let compared = |key: &str| match keywords.get(key) {
        Some(Value::Number(limit)) => compare(number, limit).map(|order| (order, limit)),
        _ => None,
    };
    for (key, wrong, what, remedy) in [
        ("minimum", [Some(Ordering::Less), None], "below", "of at least"),
        ("maximum", [Some(Ordering::Greater), None], "above", "of at most"),
        ("exclusiveMinimum", [Some(Ordering::Less), Some(Ordering::Equal)], "not above", "above"),
        (
            "exclusiveMaximum",
            [Some(Ordering::Greater), Some(Ordering::Equal)],
            "not below",
            "below",
        ),
    ] {
        if let Some((order, limit)) = compared(key)
            && wrong.contains(&Some(order))
        {
            let what = format!("{number} is {what} {limit}");
            return Err(Fault::new(pointer, what, format!("use a number {remedy} {limit}")));
        }
    }
    Ok(())
}

/// What is wrong with names in which later versions fill in a frame number.
const HAS_FRAME: &str = "has a `#`";

/// Whether a text fits a pattern of the schema; what is wrong and what to do if not. Patterns are
/// those of the schema's rules, each with a function here; a test compares the two.
fn fits(pattern: &str, text: &str) -> Result<(), (&'static str, &'static str)> {
    // `$` of the patterns is the end of the text, whatever it holds.
    let name = text.rsplit('/').next().unwrap_or_default();
    let plain = !text.contains('\0') && !name.is_empty();
    let frame =
        (HAS_FRAME, "name the file without it: no frame number is filled in by this version");
    let extension = |wanted: &str| {
        let dot = name.len().checked_sub(wanted.len() + 1).filter(|dot| *dot > 0);
        dot.and_then(|dot| Some((name.get(dot..dot + 1)?, name.get(dot + 1..)?)))
            .is_some_and(|(dot, rest)| dot == "." && rest.eq_ignore_ascii_case(wanted))
    };
    let file = |wanted: Option<&str>, remedy: &'static str| {
        if plain && name.contains('#') {
            Err(frame)
        } else if plain && wanted.is_none_or(extension) {
            Ok(())
        } else {
            Err(("is not the name of such a file", remedy))
        }
    };
    match pattern {
        EXR => file(Some("exr"), "name a file that ends in .exr"),
        PNG => file(Some("png"), "name a file that ends in .png"),
        FILE => file(None, "name a file"),
        ONE_RUN => {
            let folder = text.len() - name.len();
            let after = name.trim_start_matches(|c| c != '#').trim_start_matches('#');
            let one = !after.contains('#');
            if one && !text.get(..folder).unwrap_or_default().contains('\0') {
                Ok(())
            } else {
                Err((
                    "has more than one run of `#`",
                    "keep one run, it stands for the frame number",
                ))
            }
        }
        MAJORANTS => {
            let cells = text.strip_prefix("uniform_").is_some_and(|digits| {
                let significant = digits.trim_start_matches('0');
                digits.bytes().all(|b| b.is_ascii_digit()) && (1..=9).contains(&significant.len())
            });
            let named = ["auto", "adaptive", "hierarchy", "kd_tree", "global"].contains(&text);
            if cells || named {
                Ok(())
            } else {
                Err((
                    "is no majorant structure",
                    "take auto, adaptive, hierarchy, kd_tree, uniform_N with N voxels, or global",
                ))
            }
        }
        // A pattern that a later schema brings: the parser is what refuses then.
        _ => Ok(()),
    }
}
