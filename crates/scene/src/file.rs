//! The one way in which files that a scene names are opened.
//!
//! Scenes come from others. What they name is read only if it is a plain file: a pipe would be
//! waited for, a device read without end.

use std::fs::{File, Metadata};
use std::io::{self, Read};
use std::path::Path;

/// Fails unless `path` is a plain file; links are followed.
pub(crate) fn check(path: &Path) -> io::Result<()> {
    std::fs::metadata(path).and_then(|metadata| plain(&metadata))
}

/// At most `limit` bytes of a plain file.
///
/// # Errors
/// If it is missing, cannot be read or is no plain file.
pub(crate) fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    // Before it is opened: opening a pipe waits for its other end.
    check(path)?;
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    plain(&metadata)?;
    // The file is what limits the allocation, not what is declared.
    let length = usize::try_from(metadata.len().min(limit)).unwrap_or(0);
    let mut bytes = Vec::new();
    bytes.try_reserve(length).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    file.take(limit).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a file of text, without the byte order mark that some programs begin it with.
pub(crate) fn text_file(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

fn plain(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let what = if metadata.is_dir() { "a folder" } else { "a pipe, a socket or a device" };
    Err(io::Error::other(format!("it is {what}, where a plain file is expected")))
}
