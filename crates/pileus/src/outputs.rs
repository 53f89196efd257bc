//! What a command writes, looked at before it works: no output may overwrite a file that is read or
//! another output, and all of them must be writable, with space for what they will hold.

use std::fs;
use std::path::{Path, PathBuf};

use pileus_film::{check_writable, remove_abandoned};
use pileus_scene::{Error, Place};

use crate::failure::Failure;

/// Largest number of bytes that are tried out.
const MAX_TRIED_BYTES: u64 = 1 << 28;

/// A file that will be written.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    /// What it is, for messages.
    pub(crate) what: &'static str,
    /// Path of the file.
    pub(crate) path: PathBuf,
    /// Where it was named; `None` on the command line.
    pub(crate) at: Option<Place>,
    /// How large it may become, bytes.
    pub(crate) bytes: u64,
    /// What to do where it cannot be written.
    pub(crate) remedy: &'static str,
}

impl Target {
    /// A file named by an option.
    pub(crate) fn by_option(what: &'static str, path: &Path, bytes: u64) -> Self {
        Self { what, path: path.to_owned(), at: None, bytes, remedy: "name another file" }
    }

    fn refuse(&self, what: String) -> Failure {
        match &self.at {
            Some(place) => Error::invalid(place.clone(), what, self.remedy).into(),
            None => Failure::usage(what, self.remedy),
        }
    }
}

/// Refuses targets that are files which are read, or are each other, under whatever names (links
/// are followed), and those that cannot be written.
///
/// Whether they can is found out by trying: files of the size to come are made beside the targets
/// and removed. What earlier runs left behind there when they were killed is removed as well.
pub(crate) fn check(reads: &[PathBuf], targets: &[Target]) -> Result<(), Failure> {
    check_names(reads, targets)?;
    let mut tried: Vec<PathBuf> = Vec::new();
    for target in targets {
        let folder = folder_of(&target.path);
        let mut bytes = 0;
        // Once for each folder, with all that goes there.
        if !tried.contains(&folder) {
            remove_abandoned(&folder);
            let beside = targets.iter().filter(|other| folder_of(&other.path) == folder);
            bytes = beside.fold(0u64, |sum, other| sum.saturating_add(other.bytes));
            tried.push(folder);
        }
        writable(target, bytes.min(MAX_TRIED_BYTES))?;
    }
    Ok(())
}

/// The part of [`check`] that writes nothing.
pub(crate) fn check_names(reads: &[PathBuf], targets: &[Target]) -> Result<(), Failure> {
    let reads: Vec<Identity> = reads.iter().map(|path| Identity::of(path)).collect();
    let own: Vec<Identity> = targets.iter().map(|target| Identity::of(&target.path)).collect();
    for (i, target) in targets.iter().enumerate() {
        let shown = target.path.display();
        if let Some(read) = reads.iter().find(|read| read.is(&own[i])) {
            let what = format!(
                "{} {shown} would overwrite {}, which is read",
                target.what,
                read.name.display()
            );
            return Err(target.refuse(what));
        }
        if let Some(other) = (0..i).find(|other| own[*other].is(&own[i])) {
            let what = format!(
                "{} {shown} would overwrite {} {}",
                target.what,
                targets[other].what,
                targets[other].path.display()
            );
            return Err(target.refuse(what));
        }
    }
    Ok(())
}

fn folder_of(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new(".")).to_owned()
}

fn writable(target: &Target, bytes: u64) -> Result<(), Failure> {
    let folder = folder_of(&target.path);
    let failed = |why: String, source: std::io::Error| Failure::Io {
        path: target.path.clone(),
        what: format!("{} cannot be written: {why}", target.what),
        source,
    };
    match fs::metadata(&folder) {
        Ok(found) if found.is_dir() => {}
        Ok(_) => {
            let why = format!("{} is a file, not a folder; {}", folder.display(), target.remedy);
            return Err(failed(why, std::io::ErrorKind::NotADirectory.into()));
        }
        Err(source) if source.kind() == std::io::ErrorKind::NotFound => {
            let why = format!("there is no folder {}; create it first", folder.display());
            return Err(failed(why, source));
        }
        Err(source) => {
            let why = format!("the folder {} cannot be used", folder.display());
            return Err(failed(why, source));
        }
    }
    // To rename over such a file is possible, and not what its owner meant.
    if fs::metadata(&target.path)
        .is_ok_and(|found| found.is_file() && found.permissions().readonly())
    {
        let why = "the file there is protected from writing".to_owned();
        return Err(failed(why, std::io::ErrorKind::PermissionDenied.into()));
    }
    check_writable(&target.path, bytes).map_err(|error| match error {
        pileus_film::Error::Io { action, source, .. } => {
            use std::io::ErrorKind::{IsADirectory, PermissionDenied, StorageFull};
            let why = match source.kind() {
                IsADirectory => format!("it is a folder; {}", target.remedy),
                PermissionDenied => {
                    format!("the folder {} is not writable for you", folder.display())
                }
                StorageFull => format!(
                    "there is no space for {bytes} bytes in {}; free some, or write elsewhere",
                    folder.display()
                ),
                _ => format!("the system refuses to {action}; {}", target.remedy),
            };
            failed(why, source)
        }
        other => other.into(),
    })
}

/// Which file a name means, whether it exists or not.
struct Identity {
    name: PathBuf,
    resolved: PathBuf,
    /// Device and number of the file, where it exists: equal for hard links.
    file: Option<(u64, u64)>,
}

impl Identity {
    fn of(path: &Path) -> Self {
        Self { name: path.to_owned(), resolved: resolved(path), file: file_number(path) }
    }

    fn is(&self, other: &Self) -> bool {
        self.resolved == other.resolved || (self.file.is_some() && self.file == other.file)
    }
}

/// The path without links; of a file that does not exist that of its folder and its name.
fn resolved(path: &Path) -> PathBuf {
    /// Most links in a row, as on Linux.
    const MAX_LINKS: usize = 40;
    let mut path = path.to_owned();
    for _ in 0..MAX_LINKS {
        if let Ok(whole) = fs::canonicalize(&path) {
            return whole;
        }
        // A link to a file that does not exist.
        let Ok(target) = fs::read_link(&path) else { break };
        path = folder_of(&path).join(target);
    }
    match (fs::canonicalize(folder_of(&path)), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => std::path::absolute(&path).unwrap_or(path),
    }
}

#[cfg(unix)]
fn file_number(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|metadata| (metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn file_number(_: &Path) -> Option<(u64, u64)> {
    None
}
