//! Files appear whole or not at all.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::Error;

/// Writes a file beside `path` under a temporary name and renames it when it is complete.
///
/// The data reach the disk before the name does, so that a crash leaves the old file or the new
/// one. On any error, or a panic in `write`, the temporary file is removed and an existing target
/// is untouched. Where `path` is a symbolic link, the link is replaced.
///
/// # Errors
/// [`Error::Io`] with whatever `write` or the file system answered; [`Error::Invalid`] if `path`
/// does not end in a file name.
pub fn write_atomically<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
) -> Result<T, Error> {
    let Some(name) = path.file_name() else {
        return Err(Error::invalid(
            path.display().to_string(),
            "the path does not end in a file name",
            "add one",
        ));
    };
    let temporary = Temporary::create(path, name)
        .map_err(|e| Error::io(path, "create a file in that folder", e))?;
    let value = temporary.finish(path, write).map_err(|e| Error::io(path, "write it", e))?;
    Ok(value)
}

/// A file that removes itself unless it was renamed.
struct Temporary {
    path: PathBuf,
    file: Option<File>,
}

impl Temporary {
    fn create(target: &Path, name: &std::ffi::OsStr) -> io::Result<Self> {
        static SERIAL: AtomicU32 = AtomicU32::new(0);
        // Left-overs of killed programs may bear the number of this process.
        for _ in 0..1000 {
            let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
            let mut hidden = OsString::from(".");
            hidden.push(name);
            hidden.push(format!(".{}-{serial}.tmp", std::process::id()));
            let path = target.with_file_name(hidden);
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => return Ok(Self { path, file: Some(file) }),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    fn finish<T>(
        mut self,
        target: &Path,
        write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
    ) -> io::Result<T> {
        let Some(file) = self.file.take() else {
            return Err(io::ErrorKind::NotFound.into());
        };
        let mut writer = BufWriter::with_capacity(1 << 18, file);
        let value = write(&mut writer)?;
        writer.flush()?;
        let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        drop(file);
        fs::rename(&self.path, target)?;
        self.path = PathBuf::new();
        sync_folder(target);
        Ok(value)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        self.file = None;
        if !self.path.as_os_str().is_empty() {
            // Nothing can be done about a failure here, and the error that led here matters more.
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Makes the new name durable where folders can be synchronised; best effort.
fn sync_folder(target: &Path) {
    if cfg!(unix) {
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        if let Ok(folder) = File::open(folder) {
            let _ = folder.sync_all();
        }
    }
}
