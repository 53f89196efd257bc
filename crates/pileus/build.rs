//! Tells `pileus --version` which commit it is made of, where there is a repository to ask.

use std::path::{Path, PathBuf};
use std::process::Command;

/// What git answers in this package's folder; `None` without git or without a repository.
fn git(arguments: &[&str]) -> Option<String> {
    let folder = std::env::var_os("CARGO_MANIFEST_DIR")?;
    let output = Command::new("git").current_dir(folder).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // A repository around an unpacked archive has commits of something else.
    let ours = git(&["ls-files", "--error-unmatch", "Cargo.toml"]).is_some();
    let commit = git(&["rev-parse", "--short=10", "HEAD"]).filter(|_| ours);
    let suffix = commit.as_ref().map_or(String::new(), |commit| format!(" ({commit})"));
    println!("cargo::rustc-env=PILEUS_COMMIT_SUFFIX={suffix}");
    if commit.is_none() {
        return;
    }
    // What changes with every commit and checkout. Files that do not exist would always be stale.
    let folder = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", name]) {
            let path = folder.join(Path::new(&path));
            if path.is_file() {
                println!("cargo::rerun-if-changed={}", path.display());
            }
        }
    }
}
