//! Choices that were made while loading and that a user may want to make otherwise.

/// A choice that was made while loading, and told in a note, which a program says how to change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hint {
    /// Of several grids of one name the first was taken; the volume's density can name another.
    OtherGrid,
    /// A volume is tallest along what lies on its side: the file's z axis may point up.
    ZIsUp,
    /// Of several cameras the first was taken; a node can be named.
    OtherCamera,
}
