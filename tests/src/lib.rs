//! Shared statistics for the cross-crate tests.
