//! What a job or a glTF says of volumes, as plain data, and how options are declared.
//!
//! An option is one row of [`options!`](crate::options); the schema and the reference page follow.

pub mod by_name;
mod hint;
pub mod microflake_spec;
pub mod option;
pub mod phase_spec;
pub mod schema_rule;
mod volume_rules;
pub mod volume_spec;
pub mod whole;

pub use hint::Hint;
