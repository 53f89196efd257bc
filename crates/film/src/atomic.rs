//! Files appear whole or not at all.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use tempfile::{Builder, TempPath};

use crate::error::Error;

/// What names of temporary files begin with.
const PREFIX: &str = ".pileus-";
/// What they end with.
const SUFFIX: &str = ".tmp";
/// Letters and digits in between, at random.
const RANDOM: usize = 6;

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
/// [`Error::Io`] with whatever the file system answered, or where `path` is a folder or a device,
/// which no file replaces; [`Error::Invalid`] if `path` does not end in a file name.
pub fn check_writable(path: &Path, bytes: u64) -> Result<(), Error> {
    static ZEROS: [u8; 1 << 16] = [0; 1 << 16];
    let mut temporary = begin(path)?;
    let mut fill = || {
        let mut left = bytes;
        while left > 0 {
            let part = usize::try_from(left).unwrap_or(usize::MAX).min(ZEROS.len());
            temporary.file.write_all(&ZEROS[..part])?;
            left -= part as u64;
        }
        temporary.file.flush()
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

/// Whether a file bears a name that [`Temporary`] gives: the prefix, letters and digits, the
/// suffix. Releases before 2027 put a process and a serial number in between.
fn is_temporary(name: &OsStr) -> bool {
    let name = name.to_str();
    let middle = name.and_then(|n| n.strip_prefix(PREFIX)).and_then(|n| n.strip_suffix(SUFFIX));
    let number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    middle.is_some_and(|middle| match middle.split_once('-') {
        Some((process, serial)) => number(process) && number(serial),
        None => middle.len() == RANDOM && middle.bytes().all(|b| b.is_ascii_alphanumeric()),
    })
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
    file: File,
    // Behind the file, which some systems want closed before it is removed.
    path: TempPath,
}

impl Temporary {
    fn create(target: &Path) -> io::Result<Self> {
        let folder = match target.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        // Not named after the target, whose name may be as long as names can be.
        let (file, path) = Builder::new()
            .prefix(PREFIX)
            .suffix(SUFFIX)
            .rand_bytes(RANDOM)
            .make_in(folder, |path| {
                let file = OpenOptions::new().read(true).write(true).create_new(true).open(path)?;
                match file.try_lock() {
                    // Before it was locked another program may have taken it for abandoned: then
                    // another name is tried.
                    Ok(()) if is_removed(&file) => Err(io::ErrorKind::AlreadyExists.into()),
                    Err(TryLockError::WouldBlock) => Err(io::ErrorKind::AlreadyExists.into()),
                    // On file systems without locks nobody removes what he cannot lock.
                    Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
                }
            })?
            .into_parts();
        Ok(Self { file, path })
    }

    fn finish<T>(
        self,
        target: &Path,
        write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
    ) -> io::Result<T> {
        let Self { file, path } = self;
        let mut writer = BufWriter::with_capacity(1 << 18, file);
        let value = write(&mut writer)?;
        writer.flush()?;
        let file = writer.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.sync_all()?;
        // Open until it has its name, so that it stays locked.
        path.persist(target).map_err(|failed| failed.error)?;
        drop(file);
        sync_folder(target);
        Ok(value)
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
