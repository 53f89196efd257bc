//! Text from files and names of files, made harmless to terminals: control characters can recolour,
//! overwrite and forge what a terminal shows, and marks of direction can reorder it.

use std::borrow::Cow;
use std::fmt::Write;

/// Whether a terminal would do something else than show the character.
fn is_control(c: char) -> bool {
    // C0 and C1; line and paragraph separator; marks that turn the direction of what follows.
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, keep: impl Fn(char) -> bool) -> Cow<'_, str> {
    let bad = |c: char| is_control(c) && !keep(c);
    if !text.contains(bad) {
        return Cow::Borrowed(text);
    }
    let mut safe = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if bad(c) {
            safe.extend(c.escape_default());
        } else {
            safe.push(c);
        }
    }
    Cow::Owned(safe)
}

/// One line: all control characters escaped as in Rust, line ends among them.
pub(crate) fn line(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

/// Several lines: as [`line()`], but for line ends and tabs.
pub(crate) fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c == '\n' || c == '\t')
}

/// The text of a JSON value: what JSON lets stand inside of texts is escaped as JSON does.
pub(crate) fn json(text: &str) -> Cow<'_, str> {
    let bad = |c: char| is_control(c) && c != '\n' && c != '\t';
    if !text.contains(bad) {
        return Cow::Borrowed(text);
    }
    let mut safe = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if bad(c) {
            // All of them are below U+10000.
            let _ = write!(safe, "\\u{:04x}", u32::from(c));
        } else {
            safe.push(c);
        }
    }
    Cow::Owned(safe)
}

/// Of equal length in bytes, for text of which places are counted: question marks for what a
/// terminal would not show.
pub(crate) fn same_length(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        if is_control(c) && c != '\n' && c != '\t' && c != '\r' {
            safe.extend(std::iter::repeat_n('?', c.len_utf8()));
        } else {
            safe.push(if c == '\r' { ' ' } else { c });
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminals_are_told_nothing() {
        let bad = "a\u{1b}[31m\r\n\u{9b}b\u{202e}\u{7f}é";
        assert_eq!(line(bad), "a\\u{1b}[31m\\r\\n\\u{9b}b\\u{202e}\\u{7f}é");
        assert!(lines(bad).contains('\n') && !lines(bad).contains('\u{1b}'));
        assert_eq!(json("\"\u{9b}\u{7f}\""), "\"\\u009b\\u007f\"");
        assert_eq!(same_length(bad).len(), bad.len());
        assert!(matches!(line("plain é"), Cow::Borrowed(_)));
    }
}
