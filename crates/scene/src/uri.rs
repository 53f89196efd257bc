//! From names of files as people and glTF write them to paths.

use std::path::{Path, PathBuf};

use percent_encoding::percent_decode_str;

use crate::error::{Error, Place};

/// The path that a plain file name means, relative to the folder of the file that names it.
///
/// Blender marks names relative to its file by a leading `//`, which means the same here.
/// Backslashes separate folders, as in names that were written on Windows, unless there is a file
/// whose name has them.
pub fn resolve_name(base: &Path, name: &str) -> PathBuf {
    resolve_path(base, name.strip_prefix("//").unwrap_or(name))
}

/// The path `name` in the folder `base`. Backslashes separate folders, unless there is a file whose
/// name has them.
pub fn resolve_path(base: &Path, name: &str) -> PathBuf {
    let path = base.join(name);
    if !name.contains('\\') || exists(&path) {
        return path;
    }
    base.join(name.replace('\\', "/"))
}

/// The path that a glTF URI means, relative to the folder of the glTF file: percent-decoded,
/// without a scheme.
///
/// Other spellings count where a file of the plain one is missing: backslashes for slashes, and the
/// URI as it stands, without decoding.
///
/// # Errors
/// If it has a scheme, or if it cannot be decoded and no file has the URI itself as its name.
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
    let path = percent_decoded(uri).map(|name| resolve_path(base, &name));
    match path {
        Some(path) if !uri.contains('%') || exists(&path) => Ok(path),
        path => {
            let raw = resolve_path(base, uri);
            if exists(&raw) {
                return Ok(raw);
            }
            path.ok_or_else(|| {
                let shown: String = uri.chars().take(80).collect();
                Error::invalid(
                    place.clone(),
                    format!("the URI `{shown}` has a broken percent escape, or is not UTF-8"),
                    "write %25 for a percent sign",
                )
            })
        }
    }
}

fn exists(path: &Path) -> bool {
    path.symlink_metadata().is_ok()
}

fn is_scheme_byte(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b"+-.".contains(&byte)
}

/// The text that a percent-encoded one stands for; `None` if an escape is broken, stands for the
/// byte 0, which no name of a file has, or if the result is not UTF-8.
fn percent_decoded(text: &str) -> Option<String> {
    let bytes: Vec<u8> = percent_decode_str(text).collect();
    // Broken escapes are left as they are, others get shorter by two bytes.
    let escapes = text.bytes().filter(|byte| *byte == b'%').count();
    if text.len() - bytes.len() != 2 * escapes || bytes.contains(&0) {
        return None;
    }
    String::from_utf8(bytes).ok()
}

/// What follows `data:` in a URI, if it is one; schemes are written in any case.
pub(crate) fn data_of_uri(uri: &str) -> Option<&str> {
    let (scheme, rest) = uri.split_at_checked(5)?;
    scheme.eq_ignore_ascii_case("data:").then_some(rest)
}

/// The bytes of a data URI (RFC 2397), given what follows `data:`.
///
/// As other loaders do, this forgives what writers get wrong: spaces and line breaks inside the
/// data, missing padding, and the alphabet for URLs.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn decode_data_uri(rest: &str) -> Result<Vec<u8>, String> {
    use base64::Engine as _;
    use base64::alphabet::STANDARD;
    use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

    let Some((head, data)) = rest.split_once(',') else {
        return Err("the data URI has no comma before its data".into());
    };
    // Escapes that are broken stand for themselves.
    let mut bytes: Vec<u8> = percent_decode_str(data).collect();
    let is_base64 =
        head.rsplit_once(';').is_some_and(|(_, last)| last.trim().eq_ignore_ascii_case("base64"));
    if !is_base64 {
        return Ok(bytes);
    }
    bytes.retain(|byte| !byte.is_ascii_whitespace());
    for byte in &mut bytes {
        match byte {
            b'-' => *byte = b'+',
            b'_' => *byte = b'/',
            _ => {}
        }
    }
    let config = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    GeneralPurpose::new(&STANDARD, config)
        .decode(bytes)
        .map_err(|_| "the data URI is damaged: it is not base64".to_owned())
}

/// Longest run of `#`, which is the number of digits of a frame.
const MAX_RUN: usize = 32;

/// Replaces the run of `#` in the name of a file by the frame number, padded with zeros to its
/// length. In the names of its folders `#` means nothing. Without a frame number the name may be
/// that of a file itself.
///
/// # Errors
/// If there is a run and no frame number, or more than one run, or one of more than 32 `#`.
pub fn with_frame(name: &str, frame: Option<i64>, place: &Place) -> Result<String, Error> {
    let file = name.rfind(std::path::is_separator).map_or(0, |separator| separator + 1);
    let (folder, file) = name.split_at(file);
    let Some(start) = file.find('#') else { return Ok(name.to_owned()) };
    let shown: String = name.chars().take(200).collect();
    let Some(frame) = frame else {
        if exists(Path::new(name)) {
            return Ok(name.to_owned());
        }
        return Err(Error::invalid(
            place.clone(),
            format!("`{shown}` does not exist, and its `#` need a frame number"),
            "add `\"frame\": ...` beside `vdb`, or the custom property `pileus_frame`",
        ));
    };
    let (before, rest) = file.split_at(start);
    let after = rest.trim_start_matches('#');
    let run = rest.len() - after.len();
    if after.contains('#') {
        return Err(Error::invalid(
            place.clone(),
            format!("`{shown}` has more than one run of `#`"),
            "keep one run, it stands for the frame number",
        ));
    }
    if run > MAX_RUN {
        return Err(Error::invalid(
            place.clone(),
            format!("the run of `#` in `{shown}` has {run} digits"),
            format!("use at most {MAX_RUN} `#`"),
        ));
    }
    let sign = if frame < 0 { "-" } else { "" };
    Ok(format!("{folder}{before}{sign}{:0run$}{after}", frame.unsigned_abs()))
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
    fn names_by_other_systems_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path();
        let place = Place::default();
        std::fs::create_dir(base.join("a")).unwrap();
        for name in ["a/b c.png", "50%.png", "x%20y.png", "a/100%#1.png"] {
            std::fs::write(base.join(name), "").unwrap();
        }
        for (uri, file) in [
            (r"a\b%20c.png", "a/b c.png"),
            ("a%5Cb c.png", "a/b c.png"),
            (r".\a\..\a\b c.png", "./a/../a/b c.png"),
            ("50%.png", "50%.png"),
            ("x%20y.png", "x%20y.png"),
            (r"a\100%#1.png", "a/100%#1.png"),
            (r"a\none.png", "a/none.png"),
        ] {
            assert_eq!(resolve_uri(base, uri, &place).unwrap(), base.join(file), "{uri}");
        }
        assert_eq!(resolve_name(base, r"//..\b\c.vdb"), base.join("../b/c.vdb"));
        assert_eq!(resolve_name(base, r"//a\b c.png"), base.join("a/b c.png"));
        #[cfg(unix)]
        {
            std::fs::write(base.join(r"c\d.png"), "").unwrap();
            assert_eq!(resolve_uri(base, r"c\d.png", &place).unwrap(), base.join(r"c\d.png"));
        }
    }

    #[test]
    fn data_uris_are_read_as_others_read_them() {
        for data in [
            "data:application/octet-stream;base64,+/8BAg==",
            "data:application/octet-stream;base64,+/8BAg",
            "data:;base64,+/8B\nAg==\r\n",
            "data:;base64,+/8B Ag=",
            "DATA:image/png;BASE64,+/8BAg==",
            "data:application/gltf-buffer;base64,%2B%2F8BAg%3D%3D",
            "data:a/b;name=x;base64,-_8BAg",
            "data:;base64,+/8BAh==",
            "data:,%fb%ff%01%02",
        ] {
            let rest = data_of_uri(data).unwrap();
            assert_eq!(decode_data_uri(rest), Ok(vec![251, 255, 1, 2]), "{data}");
        }
        assert_eq!(decode_data_uri("text/plain,a%20b+c%"), Ok(b"a b+c%".to_vec()));
        for broken in ["base64", ";base64,a", ";base64,!!!!", ";base64,ab=c"] {
            assert!(decode_data_uri(broken).is_err(), "{broken}");
        }
        assert_eq!(data_of_uri("dat"), None);
        assert_eq!(data_of_uri("a.bin"), None);
        assert_eq!(data_of_uri("datä:"), None);
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
        // A folder's name is a name.
        assert_eq!(fill("a#1/b##c/d.##.vdb", Some(3)).unwrap(), "a#1/b##c/d.03.vdb");
        assert_eq!(fill("a#1/b.vdb", None).unwrap(), "a#1/b.vdb");
        let width = |n: usize| fill(&"#".repeat(n), Some(7));
        assert_eq!(width(32).unwrap().len(), 32);
        for run in [33, 65_535, 65_536, 1 << 20] {
            assert!(matches!(width(run), Err(Error::Invalid { .. })), "{run}");
        }
        // A file of that very name needs no frame.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("take#1#.vdb");
        std::fs::write(&path, "").unwrap();
        let name = path.to_string_lossy();
        assert_eq!(fill(&name, None).unwrap(), name);
    }
}
