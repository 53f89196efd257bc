//! Where the values of a job stand.

use std::path::{Path, PathBuf};

use pileus_scene::json::Document;
use pileus_scene::{Error, Place};
use serde_json::Value;

use crate::failure::Failure;
use crate::schema::job_schema;
use crate::validate::validate;

/// Where the values of a job stand.
#[derive(Debug, Clone)]
pub(super) enum Places {
    /// In a file.
    Job(Document),
    /// Nowhere: the job was made up for this file.
    File(PathBuf),
}

impl Places {
    /// The file that was given.
    pub(super) fn file(&self) -> &Path {
        match self {
            Self::Job(document) => document.path(),
            Self::File(path) => path,
        }
    }

    /// Where a value stands, or would if it were not left out.
    pub(super) fn at(&self, pointer: &str) -> Place {
        match self {
            Self::File(path) => Place::file(path),
            Self::Job(document) => {
                // A value that has a default need not be there: its parent is.
                let mut pointer = pointer;
                loop {
                    let place = document.place(pointer);
                    match pointer.rfind('/') {
                        Some(end) if place.line.is_none() => pointer = &pointer[..end],
                        _ => return place,
                    }
                }
            }
        }
    }

    /// An error about a value.
    pub(super) fn invalid(&self, pointer: &str, what: impl Into<String>, remedy: &str) -> Failure {
        Error::invalid(self.at(pointer), what, remedy).into()
    }

    /// What the schema refuses the program refuses: limits are told there and nowhere else. Jobs
    /// that were made up for a file are within them.
    pub(super) fn hold_against_schema(&self) -> Result<(), Failure> {
        let Self::Job(document) = self else { return Ok(()) };
        let value: Value = document.parse()?;
        let Err(fault) = validate(&job_schema(), &value) else { return Ok(()) };
        let place = document.place(&fault.pointer);
        Err(match fault.later {
            true => Error::unsupported(place, fault.what, fault.remedy),
            false => Error::invalid(place, fault.what, fault.remedy),
        }
        .into())
    }
}
