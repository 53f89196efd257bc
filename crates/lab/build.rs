//! Tells the charts which compiler and which commit they were made by.

use std::path::Path;
use std::process::Command;

fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program).args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    (output.status.success() && !text.trim().is_empty()).then(|| text.trim().to_owned())
}

fn main() {
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let compiler = output(&rustc, &["--version"]).unwrap_or_else(|| "unknown".into());
    println!("cargo::rustc-env=PILEUS_COMPILER={compiler}");
    // Builds without a repository, from a package, do not know their commit.
    let commit = output("git", &["rev-parse", "--short=10", "HEAD"]);
    println!("cargo::rustc-env=PILEUS_COMMIT={}", commit.unwrap_or_else(|| "unknown".into()));
    let target = std::env::var("TARGET").unwrap_or_else(|_| "unknown".into());
    println!("cargo::rustc-env=PILEUS_TARGET={target}");
    println!("cargo::rerun-if-changed=build.rs");
    for log in ["../../.git/logs/HEAD", "../../.git/HEAD"] {
        if Path::new(log).exists() {
            println!("cargo::rerun-if-changed={log}");
        }
    }
}
