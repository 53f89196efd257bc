//! Reading JSON that people write: every fault with its line, column and pointer.

use std::borrow::Cow;
use std::fmt::{self, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::{DeserializeOwned, IgnoredAny};

use crate::error::{Error, Place};
use crate::spec::by_name::LATER;

/// A JSON text and the name of its file, able to tell where each value stands.
#[derive(Debug, Clone)]
pub struct Document {
    path: PathBuf,
    text: String,
}

/// What is wrong in a JSON text, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// JSON pointer (RFC 6901) of the value or key; empty for the whole text.
    pub pointer: String,
    /// The faulty range of the text in bytes.
    pub span: Range<usize>,
    /// What is wrong.
    pub what: String,
    /// What to do about it; may be empty.
    pub remedy: String,
    /// Whether the value is one of the format's that this version does not render.
    pub later: bool,
}

impl Document {
    /// A document from its text; `path` names it in errors.
    pub fn new(path: impl AsRef<Path>, text: impl Into<String>) -> Self {
        Self { path: path.as_ref().to_owned(), text: text.into() }
    }

    /// The name of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Parses the whole document.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, Error> {
        parse(&self.text).map_err(|fault| self.error(fault))
    }

    /// Parses `text` instead, which has the same structure but for what is not read or has a
    /// default; the places of faults are those of this document.
    pub(crate) fn parse_edited<T: DeserializeOwned>(&self, text: &str) -> Result<T, Error> {
        self.check_syntax()?;
        parse_valid(&self.text, text).map_err(|fault| self.error(fault))
    }

    /// Fails unless the text is JSON.
    pub(crate) fn check_syntax(&self) -> Result<(), Error> {
        check_syntax(&self.text).map_err(|fault| self.error(fault))
    }

    /// Parses the value at a JSON pointer; `None` if there is no such value.
    pub fn parse_at<T: DeserializeOwned>(&self, pointer: &str) -> Option<Result<T, Error>> {
        let span = locate(&self.text, pointer)?.value;
        let part = self.text.get(span.clone())?;
        Some(parse(part).map_err(|fault| {
            self.error(Fault {
                pointer: format!("{pointer}{}", fault.pointer),
                span: fault.span.start + span.start..fault.span.end + span.start,
                ..fault
            })
        }))
    }

    /// The place of a value: file, line, column, pointer.
    pub fn place(&self, pointer: &str) -> Place {
        match locate(&self.text, pointer) {
            Some(spans) => self.place_at(pointer, spans.value.start),
            None => Place::part(&self.path, pointer),
        }
    }

    /// The error that a fault in this document is.
    pub fn error(&self, fault: Fault) -> Error {
        let place = self.place_at(&fault.pointer, fault.span.start);
        match fault.later {
            true => Error::unsupported(place, fault.what, fault.remedy),
            false => Error::invalid(place, fault.what, fault.remedy),
        }
    }

    fn place_at(&self, pointer: &str, offset: usize) -> Place {
        let (line, column) = line_and_column(&self.text, offset);
        let part = if pointer.is_empty() { "top level" } else { pointer };
        Place { line: Some(line), column: Some(column), ..Place::part(&self.path, part) }
    }
}

/// Parses a JSON text strictly: no comments, no trailing text, unknown keys as the type refuses
/// them. Numbers are what they are worth: `4.0` and `4e0` are whole.
pub fn parse<T: DeserializeOwned>(text: &str) -> Result<T, Fault> {
    // Syntax first: the places of values can only be told in a text that is JSON.
    check_syntax(text)?;
    parse_valid(text, text)
}

fn check_syntax(text: &str) -> Result<(), Fault> {
    match serde_json::from_str::<IgnoredAny>(text) {
        Ok(_) => Ok(()),
        Err(error) => Err(syntax_fault(text, &error)),
    }
}

/// Parses `edited`; faults are placed in `text`, which is valid JSON of the same structure.
fn parse_valid<T: DeserializeOwned>(text: &str, edited: &str) -> Result<T, Fault> {
    let plain = whole_numbers(edited);
    let mut deserializer = serde_json::Deserializer::from_str(&plain);
    serde_path_to_error::deserialize(&mut deserializer).map_err(|error| data_fault(text, &error))
}

/// The text with whole numbers written as such: `1.0` and `1e3` become `1` and `1000`.
///
/// JSON has one kind of number, and glTF follows it (glTF 2.0, section 2.7), while the parser takes
/// integers from tokens without fraction and exponent alone. `text` is valid JSON.
fn whole_numbers(text: &str) -> Cow<'_, str> {
    /// From here on not every whole number is a double.
    const LARGEST: f64 = 9_007_199_254_740_992.0;
    let bytes = text.as_bytes();
    let mut editor = Editor::new(text);
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        match byte {
            b'"' => at = skip_value(bytes, at).unwrap_or(bytes.len()),
            b'-' | b'0'..=b'9' => {
                let start = at;
                let part = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
                at += bytes.iter().skip(at).take_while(|&b| part(b)).count();
                let Some(token) = text.get(start..at) else { continue };
                if !token.bytes().any(|b| b".eE".contains(&b)) {
                    continue;
                }
                if let Ok(value) = token.parse::<f64>()
                    && value.fract() == 0.0
                    && value.abs() < LARGEST
                    // The sign of zero would be lost.
                    && !(value == 0.0 && value.is_sign_negative())
                {
                    editor.replace(start..at, format_args!("{}", value as i64));
                }
            }
            _ => at += 1,
        }
    }
    editor.finish()
}

/// A text of which ranges are replaced, in ascending order.
struct Editor<'a> {
    text: &'a str,
    edited: String,
    /// Up to where `edited` stands for `text`.
    done: usize,
}

impl<'a> Editor<'a> {
    fn new(text: &'a str) -> Self {
        Self { text, edited: String::new(), done: 0 }
    }

    fn replace(&mut self, span: Range<usize>, new: fmt::Arguments<'_>) {
        self.edited.push_str(self.text.get(self.done..span.start).unwrap_or_default());
        // Writing to a string does not fail.
        let _ = self.edited.write_fmt(new);
        self.done = span.end;
    }

    fn finish(mut self) -> Cow<'a, str> {
        if self.done == 0 {
            return Cow::Borrowed(self.text);
        }
        self.edited.push_str(self.text.get(self.done..).unwrap_or_default());
        Cow::Owned(self.edited)
    }
}

/// The text of a glTF file, which is valid JSON, as the parser takes it, and the number of its
/// animations: these are not read, since their targets may be what the parser does not know, and
/// scenes may be without nodes.
pub(crate) fn acceptable_gltf(text: &str) -> (Cow<'_, str>, usize) {
    let mut editor = Editor::new(text);
    let mut animations = 0;
    let root = skip_space(text.as_bytes(), 0);
    let named = |key: Option<&Range<usize>>, name: &str| {
        let key = key.and_then(|key| unquote(text.get(key.clone())?));
        key.is_some_and(|key| key == name)
    };
    visit_members(text, root, &mut |key, value| {
        if text.as_bytes().get(value.start) != Some(&b'[') {
            return;
        }
        if named(key.as_ref(), "animations") {
            visit_members(text, value.start, &mut |_, _| animations += 1);
            editor.replace(value, format_args!("[]"));
        } else if named(key.as_ref(), "scenes") {
            visit_members(text, value.start, &mut |_, scene| {
                let (mut empty, mut has_nodes) = (true, false);
                visit_members(text, scene.start, &mut |key, _| {
                    empty = false;
                    has_nodes |= named(key.as_ref(), "nodes");
                });
                if text.as_bytes().get(scene.start) == Some(&b'{') && !has_nodes {
                    let comma = if empty { "" } else { "," };
                    let brace = scene.start..scene.start + 1;
                    editor.replace(brace, format_args!("{{\"nodes\":[]{comma}"));
                }
            });
        }
    });
    (editor.finish(), animations)
}

/// The name among `known` that is closest to `name`.
pub fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let score = |candidate: &str| {
        strsim::normalized_damerau_levenshtein(&name.to_lowercase(), &candidate.to_lowercase())
            + 0.2 * strsim::jaro_winkler(name, candidate)
    };
    known.into_iter().max_by(|a, b| score(a).total_cmp(&score(b)))
}

/// Line and column, both from 1, of a byte offset; the column counts characters.
pub fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
    let start = before.iter().rposition(|&b| b == b'\n').map_or(0, |p| p + 1);
    // A byte that does not continue a UTF-8 sequence starts a character.
    let column = before.iter().skip(start).filter(|&&b| b & 0xc0 != 0x80).count() + 1;
    (line, column)
}

fn syntax_fault(text: &str, error: &serde_json::Error) -> Fault {
    let line_start = text
        .split_inclusive('\n')
        .take(error.line().saturating_sub(1))
        .map(str::len)
        .sum::<usize>();
    // serde_json counts columns in bytes and points at the offending byte, or past the end.
    let offset = (line_start + error.column().saturating_sub(1)).min(text.len());
    let rest = text.as_bytes().get(offset..).unwrap_or_default();
    let comment = rest.first() == Some(&b'/') || rest.first() == Some(&b'#');
    // Where the word begins that holds the offending byte: `NaN` and its relatives are told by
    // name.
    let before = text.get(..offset).unwrap_or_default();
    let letters = before.bytes().rev().take_while(u8::is_ascii_alphabetic).count();
    let word = before.len() - letters;
    let word = text.get(word..).unwrap_or_default().trim_start_matches(['-', '+']);
    let word: String = word.chars().take_while(char::is_ascii_alphabetic).collect();
    let no_number = ["nan", "inf", "infinity"].contains(&word.to_ascii_lowercase().as_str());
    let (what, remedy) = if no_number {
        let what = format!("`{word}` is not a number that JSON has");
        (what, "write a finite number, or remove the key")
    } else if comment {
        ("comments are not part of JSON".to_owned(), "remove the comment")
    } else {
        let message = strip_position(&error.to_string());
        (format!("this is not JSON: {message}"), "check commas, quotes and brackets here")
    };
    let pointer = String::new();
    let span = offset..(offset + 1).min(text.len());
    Fault { pointer, span, what, remedy: remedy.into(), later: false }
}

fn data_fault(text: &str, error: &serde_path_to_error::Error<serde_json::Error>) -> Fault {
    use serde_path_to_error::Segment;
    let mut segments: Vec<String> = Vec::new();
    for segment in error.path().iter() {
        match segment {
            Segment::Seq { index } => segments.push(index.to_string()),
            Segment::Map { key } => segments.push(key.clone()),
            Segment::Enum { .. } | Segment::Unknown => {}
        }
    }
    let mut message = strip_position(&error.inner().to_string());
    let mut remedy = String::new();
    let mut span = None;
    let names: Vec<String> = quoted(&message);
    let later = message.contains(LATER);
    if later {
        if let Some((what, known)) = message.split_once("; ") {
            remedy = known.to_owned();
            message = what.to_owned();
        }
    } else if let Some((name, known)) =
        names.split_first().filter(|_| message.starts_with("unknown "))
    {
        let is_key = message.starts_with("unknown field");
        if is_key {
            if segments.last().is_some_and(|last| last == name) {
                segments.pop();
            }
            if let Some(path) = find_key(text, &segments, name) {
                segments = path;
            }
            span = locate_segments(text, &segments).and_then(|spans| spans.key);
        }
        let thing = if is_key { "key" } else { "value" };
        message = format!("unknown {thing} `{name}`");
        remedy = match nearest(name, known.iter().map(String::as_str)) {
            Some(near) => {
                let known = known.iter().map(|k| format!("`{k}`")).collect::<Vec<_>>().join(", ");
                format!("did you mean `{near}`? Known here: {known}")
            }
            None => "remove it: no further keys belong here".to_owned(),
        };
    } else if let Some(name) = names.first().filter(|_| message.starts_with("missing field")) {
        message = format!("the key `{name}` is missing");
        remedy = format!("add `\"{name}\": ...` to this object");
    } else if let Some(name) = names.first().filter(|_| message.starts_with("duplicate field")) {
        message = format!("the key `{name}` stands here twice");
        remedy = "keep one of them".to_owned();
    } else {
        if let Some(path) = find_unexpected(text, &segments, &message) {
            segments = path;
        }
        if let Some((found, expected)) = message.split_once(", expected ") {
            let found = found.trim_start_matches("invalid type: ");
            let expected = in_words(expected);
            remedy = format!("write {expected} here");
            message = format!("{found}, where {expected} is expected");
        }
    }
    let span = span
        .or_else(|| locate_segments(text, &segments).map(|spans| spans.value))
        .unwrap_or(0..text.len().min(1));
    Fault { pointer: pointer_of(&segments), span, what: message, remedy, later }
}

/// What serde calls a type, for people.
fn in_words(expected: &str) -> &str {
    match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number of at least 0",
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number",
        "f32" | "f64" => "a number",
        other if other.starts_with("struct ") || other.starts_with("internally tagged enum ") => {
            "an object"
        }
        other => other,
    }
}

/// The words between backticks, in order.
fn quoted(message: &str) -> Vec<String> {
    message.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn strip_position(message: &str) -> String {
    match message.rfind(" at line ") {
        Some(end) => message[..end].to_owned(),
        None => message.to_owned(),
    }
}

fn pointer_of(segments: &[String]) -> String {
    segments.iter().map(|s| format!("/{}", s.replace('~', "~0").replace('/', "~1"))).collect()
}

/// Where a value stands in the text, and its key if it is a member of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spans {
    /// The key with its quotes.
    pub key: Option<Range<usize>>,
    /// The value.
    pub value: Range<usize>,
}

/// Finds the value at a JSON pointer in a text that is valid JSON.
pub fn locate(text: &str, pointer: &str) -> Option<Spans> {
    let mut parts = pointer.split('/');
    if !parts.next()?.is_empty() {
        return None;
    }
    let segments: Vec<String> = parts.map(|p| p.replace("~1", "/").replace("~0", "~")).collect();
    locate_segments(text, &segments)
}

fn locate_segments(text: &str, segments: &[String]) -> Option<Spans> {
    let bytes = text.as_bytes();
    let start = skip_space(bytes, 0);
    let mut spans = Spans { key: None, value: start..skip_value(bytes, start)? };
    for segment in segments {
        spans = members(text, spans.value.start)?
            .into_iter()
            .find(|member| member.name == *segment)
            .map(|member| member.spans)?;
    }
    Some(spans)
}

struct Member {
    name: String,
    spans: Spans,
}

/// The members of the object or array that starts at `start`; `None` for other values.
fn members(text: &str, start: usize) -> Option<Vec<Member>> {
    let mut found: Vec<Member> = Vec::new();
    let mut damaged = false;
    visit_members(text, start, &mut |key, value| {
        let name = match &key {
            Some(key) => text.get(key.clone()).and_then(unquote),
            None => Some(found.len().to_string()),
        };
        match name {
            Some(name) => found.push(Member { name, spans: Spans { key, value } }),
            None => damaged = true,
        }
    })?;
    (!damaged).then_some(found)
}

fn unquote(key: &str) -> Option<String> {
    serde_json::from_str(key).ok()
}

/// Calls `visit` with the spans of key (in objects) and value of each member of the object or
/// array that starts at `start`; `None` for other values.
fn visit_members(
    text: &str,
    start: usize,
    visit: &mut dyn FnMut(Option<Range<usize>>, Range<usize>),
) -> Option<()> {
    let bytes = text.as_bytes();
    let (is_object, end) = match bytes.get(start)? {
        b'{' => (true, b'}'),
        b'[' => (false, b']'),
        _ => return None,
    };
    let mut at = skip_space(bytes, start + 1);
    while *bytes.get(at)? != end {
        let mut key = None;
        if is_object {
            let key_end = skip_value(bytes, at)?;
            key = Some(at..key_end);
            at = skip_space(bytes, skip_space(bytes, key_end) + 1);
        }
        let value_end = skip_value(bytes, at)?;
        visit(key, at..value_end);
        at = skip_space(bytes, value_end);
        if *bytes.get(at)? == b',' {
            at = skip_space(bytes, at + 1);
        }
    }
    Some(())
}

fn skip_space(bytes: &[u8], mut at: usize) -> usize {
    while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
        at += 1;
    }
    at
}

/// The end of the value that starts at `at`, in bytes that are valid JSON.
fn skip_value(bytes: &[u8], mut at: usize) -> Option<usize> {
    let mut depth = 0usize;
    loop {
        match *bytes.get(at)? {
            b'"' => {
                at += 1;
                while *bytes.get(at)? != b'"' {
                    at += if bytes.get(at) == Some(&b'\\') { 2 } else { 1 };
                }
                at += 1;
            }
            b'{' | b'[' => {
                depth += 1;
                at += 1;
            }
            b'}' | b']' => {
                depth = depth.checked_sub(1)?;
                at += 1;
            }
            b',' | b':' => at += 1,
            byte if byte.is_ascii_whitespace() => at += 1,
            _ => {
                while bytes.get(at).is_some_and(|b| !b" \t\r\n,:]}".contains(b)) {
                    at += 1;
                }
            }
        }
        if depth == 0 {
            return Some(at);
        }
    }
}

/// Most values that a search below a faulty object looks at.
const MAX_SEARCH: usize = 10_000;

/// The path of the first value at or below `below` for which `wanted` holds; the value itself is
/// given as text, its name is that of its member.
fn search(
    text: &str,
    below: &[String],
    wanted: impl Fn(&str, &str) -> bool,
) -> Option<Vec<String>> {
    let start = locate_segments(text, below)?.value;
    let mut queue = std::collections::VecDeque::from([(below.to_vec(), start)]);
    let mut seen = 0;
    while let Some((path, span)) = queue.pop_front() {
        for member in members(text, span.start).unwrap_or_default() {
            seen += 1;
            if seen > MAX_SEARCH {
                return None;
            }
            let mut inner = path.clone();
            inner.push(member.name.clone());
            if wanted(&member.name, text.get(member.spans.value.clone())?) {
                return Some(inner);
            }
            queue.push_back((inner, member.spans.value));
        }
    }
    None
}

/// Objects that choose their keys by a `type` are read as a whole, so that the parser's path ends
/// at them: the offending key stands somewhere below.
fn find_key(text: &str, below: &[String], name: &str) -> Option<Vec<String>> {
    search(text, below, |key, _| key == name)
}

/// The path of the scalar that a message speaks of: for "invalid type: string "abc", expected ..."
/// the one that reads so.
fn find_unexpected(text: &str, below: &[String], message: &str) -> Option<Vec<String>> {
    let unexpected =
        message.strip_prefix("invalid type: ").or(message.strip_prefix("invalid value: "))?;
    let unexpected = &unexpected[..unexpected.find(", expected")?];
    let value = locate_segments(text, below)?.value;
    if !matches!(text.as_bytes().get(value.start)?, b'{' | b'[') {
        return None;
    }
    let wanted = match unexpected.split_once(' ') {
        Some(("string", quoted)) => quoted.to_owned(),
        Some((_, rest)) => quoted(rest).pop()?,
        None if unexpected == "null" => "null".to_owned(),
        None => return None,
    };
    search(text, below, |_, value| value == wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Outer {
        inner: Vec<Inner>,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
    enum Inner {
        Plain {},
        Scaled { scale: f32 },
    }

    fn fault(text: &str) -> Fault {
        parse::<Outer>(text).unwrap_err()
    }

    #[test]
    fn whole_numbers_may_have_fractions_and_exponents() {
        for (text, plain) in [
            ("1.0", "1"),
            ("[1.50e1,-2.0,-0.0,0.0,0.5,1e3]", "[15,-2,-0.0,0,0.5,1000]"),
            (r#"{"1.0":"2.0","a\"1.0":[3.0]}"#, r#"{"1.0":"2.0","a\"1.0":[3]}"#),
            ("1e-3", "1e-3"),
            ("9007199254740993.0", "9007199254740993.0"),
            ("1e300", "1e300"),
            ("12", "12"),
        ] {
            assert_eq!(whole_numbers(text), plain);
        }
        assert_eq!(parse::<Vec<u8>>("[4.0, 2.55e2]"), Ok(vec![4, 255]));
        assert_eq!(parse::<f32>("4.0"), Ok(4.0));
        assert_eq!(parse::<Vec<u8>>("[4.5]").unwrap_err().pointer, "/0");
        assert_eq!(parse::<Vec<u8>>("[0, -1.0]").unwrap_err().pointer, "/1");
    }

    #[test]
    fn what_the_gltf_parser_does_not_take_is_left_out() {
        let text = r#"{"scenes":[{},{"name":"a"},{"nodes":[1]}],"animations":[{"x":1},2]}"#;
        let edited =
            r#"{"scenes":[{"nodes":[]},{"nodes":[],"name":"a"},{"nodes":[1]}],"animations":[]}"#;
        let (found, animations) = acceptable_gltf(text);
        assert_eq!((&*found, animations), (edited, 2));
        for other in ["3", "[]", r#"{"scenes":3,"animations":{"a":1}}"#] {
            assert_eq!(acceptable_gltf(other), (Cow::Borrowed(other), 0));
        }
    }

    #[test]
    fn unknown_keys_name_the_nearest_and_their_place() {
        let text = "{\n  \"iner\": []\n}";
        let found = fault(text);
        assert_eq!(found.pointer, "/iner");
        assert_eq!(&text[found.span.clone()], "\"iner\"");
        assert_eq!(line_and_column(text, found.span.start), (2, 3));
        assert!(found.remedy.contains("did you mean `inner`?"), "{found:?}");
    }

    #[test]
    fn unknown_keys_in_tagged_objects_are_found_as_well() {
        let text = "{ \"inner\": [ {\"type\":\"plain\"},\n{\"type\":\"scaled\", \"sclae\": 2} ] }";
        let found = fault(text);
        assert_eq!(found.pointer, "/inner/1/sclae");
        assert_eq!(line_and_column(text, found.span.start), (2, 19));
        assert!(found.remedy.contains("`scale`"));
        let found = fault("{\"inner\":[{\"type\":\"plain\",\"x\":1}]}");
        assert_eq!(found.pointer, "/inner/0/x");
    }

    #[test]
    fn wrong_types_and_variants_are_placed() {
        let found = fault("{\"inner\":[{\"type\":\"scaled\",\"scale\":\"big\"}]}");
        assert_eq!(found.pointer, "/inner/0/scale");
        let found = fault("{\"inner\":[{\"type\":\"scald\"}]}");
        assert_eq!(
            (found.pointer.as_str(), found.what.as_str()),
            ("/inner/0/type", "unknown value `scald`")
        );
        assert!(found.remedy.contains("did you mean `scaled`?"));
        let found = fault("{\"inner\":[{\"type\":\"scaled\"}]}");
        assert_eq!(found.what, "the key `scale` is missing");
        let found = fault("{\"inner\":[{\"type\":\"scaled\",\"scale\":true}]}");
        assert_eq!(found.what, "boolean `true`, where a number is expected");
        assert_eq!(found.pointer, "/inner/0/scale");
        assert_eq!(fault("{\"inner\":3}").pointer, "/inner");
        assert!(fault("{\"inner\":[],\"inner\":[]}").what.contains("twice"));
        assert_eq!(fault("[]").pointer, "");
    }

    #[test]
    fn syntax_errors_and_comments_are_placed() {
        let text = "{\n // a comment\n \"inner\": [] }";
        let found = fault(text);
        assert!(found.what.contains("comments"), "{found:?}");
        assert_eq!(line_and_column(text, found.span.start), (2, 2));
        assert!(fault("{\"inner\": [}").what.contains("not JSON"));
        assert!(fault("").what.contains("not JSON"));
        assert!(fault("{\"inner\":[]} x").what.contains("not JSON"));
        assert!(fault("{\"inner\":[] /* x */}").what.contains("comments"));
    }

    #[test]
    fn locates_values_with_escapes_and_strings_that_look_like_structure() {
        let text = r#" {"a/b": ["x]\"}", {"\u00e9": 1.5e3}], "c~": null}"#;
        let value = |p: &str| locate(text, p).map(|s| &text[s.value]);
        assert_eq!(value("/a~1b/0"), Some(r#""x]\"}""#));
        assert_eq!(value("/a~1b/1/é"), Some("1.5e3"));
        assert_eq!(value("/c~0"), Some("null"));
        assert_eq!(value("/nothing"), None);
        assert_eq!(value("/a~1b/2"), None);
        assert_eq!(value("").unwrap().len(), text.len() - 1);
    }

    #[test]
    fn deep_and_odd_texts_end_in_errors() {
        let deep = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
        assert!(parse::<serde_json::Value>(&deep).is_err());
        assert!(parse::<Outer>(&format!("{{\"inner\":{deep}}}")).is_err());
    }
}
