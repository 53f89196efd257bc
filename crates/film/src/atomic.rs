//! Files appear whole or not at all.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::Error;

/// What names of temporary files begin with.
const PREFIX: &str = ".pileus-";
/// What they end with.
const SUFFIX: &str = ".tmp";

/// Writes a file beside `path` under a temporary name and renames it when it is complete.
///
/// The data reach the disk before the name does, so that a crash leaves the old file or the new
/// one. On any error, or a panic in `write`, the temporary file is removed and an existing target
/// is untouched. Where `path` is a symbolic link, the link is replaced.
///
/// # Errors
/// [`Error::Io`] with whatever `write` or the file system answered, or where `path` is a folder or
/// a device, which no file replaces; [`Error::Invalid`] if `path` does not end in a file name.
pub fn write_atomically<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
) -> Result<T, Error> {
    let temporary = begin(path)?;
    let value = temporary.finish(path, write).map_err(|e| Error::io(path, "write it", e))?;
    Ok(value)
}

/// Finds out whether [`write_atomically`] could write `bytes` bytes to `path` now, by writing as
/// many zeros beside it and removing them again: hours of rendering must not end in a file that
/// nobody can write. An existing target is untouched.
///
/// # Errors
/// As [`write_atomically`].
pub fn check_writable(path: &Path, bytes: u64) -> Result<(), Error> {
    static ZEROS: [u8; 1 << 16] = [0; 1 << 16];
    let mut temporary = begin(path)?;
    let mut fill = || {
        let Some(file) = &mut temporary.file else { return Ok(()) };
        let mut left = bytes;
        while left > 0 {
            let part = usize::try_from(left).unwrap_or(usize::MAX).min(ZEROS.len());
            file.write_all(&ZEROS[..part])?;
            left -= part as u64;
        }
        file.flush()
    };
    fill().map_err(|e| Error::io(path, "write that many bytes there", e))
}

/// Removes the temporary files in a folder whose programs ended without doing so (killed, or by a
/// loss of power), and tells how many there were. Those that are being written are locked by their
/// programs and stay, as does everything on file systems without locks. Best effort.
pub fn remove_abandoned(folder: &Path) -> usize {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let mut removed = 0;
    for entry in entries.flatten() {
        let plain = entry.file_type().is_ok_and(|kind| kind.is_file());
        if !plain || !is_temporary(&entry.file_name()) {
            continue;
        }
        let path = entry.path();
        // The lock is held until the file is gone, see `Temporary::create`.
        let Ok(file) = OpenOptions::new().write(true).open(&path) else { continue };
        if file.try_lock().is_ok() && fs::remove_file(&path).is_ok() {
            removed += 1;
        }
    }
    removed
}

/// Whether a file bears a name that [`Temporary`] gives: the prefix, a process, a serial number.
fn is_temporary(name: &OsStr) -> bool {
    let name = name.to_str();
    let middle = name.and_then(|n| n.strip_prefix(PREFIX)).and_then(|n| n.strip_suffix(SUFFIX));
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    middle
        .and_then(|middle| middle.split_once('-'))
        .is_some_and(|(process, serial)| number(process) && number(serial))
}

/// A temporary file for a target that a file can take the place of.
fn begin(path: &Path) -> Result<Temporary, Error> {
    if path.file_name().is_none() {
        return Err(Error::invalid(
            path.display().to_string(),
            "the path does not end in a file name",
            "add one",
        ));
    }
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => {
            let kind = io::ErrorKind::IsADirectory.into();
            return Err(Error::io(path, "put a file where a folder is", kind));
        }
        Ok(found) if !found.is_file() => {
            // Renaming would replace the device by a plain file.
            let source = io::Error::new(io::ErrorKind::InvalidInput, "this is no plain file");
            return Err(Error::io(path, "put a file where a device or pipe is", source));
        }
        // A link to nothing is replaced like any link.
        Ok(_) => {}
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(Error::io(path, "write it", error)),
    }
    Temporary::create(path).map_err(|e| Error::io(path, "create a file in that folder", e))
}

/// A file that removes itself unless it was renamed. It is locked as long as it is open.
struct Temporary {
    path: PathBuf,
    file: Option<File>,
}

impl Temporary {
    fn create(target: &Path) -> io::Result<Self> {
        static SERIAL: AtomicU32 = AtomicU32::new(0);
        // Left-overs of killed programs may bear the number of this process.
        for _ in 0..1000 {
            let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
            // Not made of the target's name, which may be as long as names can be.
            let hidden = format!("{PREFIX}{}-{serial}{SUFFIX}", std::process::id());
            let path = target.with_file_name(hidden);
            let file = match OpenOptions::new().read(true).write(true).create_new(true).open(&path)
            {
                Ok(file) => file,
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(e) => return Err(e),
            };
            match file.try_lock() {
                // Before it was locked another program may have taken it for abandoned.
                Ok(()) if is_removed(&file) => continue,
                Err(TryLockError::WouldBlock) => continue,
                // On file systems without locks nobody removes what he cannot lock.
                Ok(()) | Err(TryLockError::Error(_)) => {}
            }
            return Ok(Self { path, file: Some(file) });
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
        // Open until it has its name, so that it stays locked.
        fs::rename(&self.path, target)?;
        drop(file);
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

#[cfg(unix)]
fn is_removed(file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    file.metadata().is_ok_and(|metadata| metadata.nlink() == 0)
}

#[cfg(not(unix))]
fn is_removed(_: &File) -> bool {
    false
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
