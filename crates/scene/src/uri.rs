//! From names of files as people and glTF write them to paths.

use std::path::{Path, PathBuf};

use crate::error::{Error, Place};

/// The path that a plain file name means, relative to the folder of the file that names it.
///
/// Blender marks names relative to its file by a leading `//`, which means the same here.
pub fn resolve_name(base: &Path, name: &str) -> PathBuf {
    base.join(name.strip_prefix("//").unwrap_or(name))
}

/// The path that a glTF URI means, relative to the folder of the glTF file: percent-decoded,
/// without a scheme.
pub fn resolve_uri(base: &Path, uri: &str, place: &Place) -> Result<PathBuf, Error> {
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    // One letter before the colon is a drive, which some exporters write.
    if let Some(scheme) = scheme.filter(|s| s.len() > 1 && s.bytes().all(is_scheme_byte)) {
        return Err(Error::unsupported(
            place.clone(),
            format!("the URI has the scheme `{scheme}:`"),
            "name a file relative to the glTF file",
        ));
    }
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        let decoded = if byte == b'%' {
            let digit = |b: Option<u8>| b.and_then(|b| char::from(b).to_digit(16));
            let (high, low) = (digit(rest.next()), digit(rest.next()));
            high.zip(low).and_then(|(high, low)| u8::try_from(high * 16 + low).ok())
        } else {
            Some(byte)
        };
        let Some(decoded) = decoded.filter(|&b| b != 0) else {
            return Err(Error::invalid(
                place.clone(),
                format!("the URI `{uri}` has a broken percent escape"),
                "write %25 for a percent sign",
            ));
        };
        bytes.push(decoded);
    }
    let name = String::from_utf8(bytes).map_err(|_| {
        Error::invalid(place.clone(), format!("the URI `{uri}` is not UTF-8"), "rename the file")
    })?;
    Ok(base.join(name))
}

fn is_scheme_byte(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b"+-.".contains(&byte)
}

/// Replaces the run of `#` in a file name by the frame number, padded with zeros to its length.
pub fn with_frame(name: &str, frame: Option<i64>, place: &Place) -> Result<String, Error> {
    let Some(start) = name.find('#') else { return Ok(name.to_owned()) };
    let run = name[start..].bytes().take_while(|&b| b == b'#').count();
    let (before, after) = (&name[..start], &name[start + run..]);
    if after.contains('#') {
        return Err(Error::invalid(
            place.clone(),
            format!("`{name}` has more than one run of `#`"),
            "keep one run, it stands for the frame number",
        ));
    }
    let Some(frame) = frame else {
        return Err(Error::invalid(
            place.clone(),
            format!("`{name}` needs a frame number for its `#`"),
            "add `\"frame\": ...` beside `vdb`",
        ));
    };
    let sign = if frame < 0 { "-" } else { "" };
    Ok(format!("{before}{sign}{:0run$}{after}", frame.unsigned_abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_uris_are_relative_to_their_file() {
        let base = Path::new("shots/a");
        assert_eq!(resolve_name(base, "b c.vdb"), base.join("b c.vdb"));
        assert_eq!(resolve_name(base, "//../b.vdb"), base.join("../b.vdb"));
        let place = Place::default();
        assert_eq!(resolve_uri(base, "b%20c%C3%A9.vdb", &place).unwrap(), base.join("b cé.vdb"));
        assert!(resolve_uri(base, "http://a/b.vdb", &place).is_err());
        assert!(resolve_uri(base, "data:x;base64,aa", &place).is_err());
        for broken in ["a%2", "a%", "a%zz", "%00", "%ff"] {
            assert!(resolve_uri(base, broken, &place).is_err(), "{broken}");
        }
    }

    #[test]
    fn frames_fill_the_run() {
        let fill = |name: &str, frame| with_frame(name, frame, &Place::default());
        assert_eq!(fill("a.####.vdb", Some(17)).unwrap(), "a.0017.vdb");
        assert_eq!(fill("a.##.vdb", Some(1234)).unwrap(), "a.1234.vdb");
        assert_eq!(fill("a.###.vdb", Some(-5)).unwrap(), "a.-005.vdb");
        assert_eq!(fill("a.vdb", Some(5)).unwrap(), "a.vdb");
        assert!(fill("a.#.vdb", None).is_err());
        assert!(fill("a.#.#.vdb", Some(1)).is_err());
    }
}
