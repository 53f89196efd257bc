//! Lists of names in messages.

/// Names that a list in a message shows.
pub(super) const SHOWN: usize = 8;

/// Names in backticks, of which a few are shown.
pub(crate) fn list_names<T: AsRef<str>>(names: &[T]) -> String {
    let mut list: Vec<String> =
        names.iter().take(SHOWN).map(|name| format!("`{}`", name.as_ref())).collect();
    if let Some(more) = names.len().checked_sub(SHOWN).filter(|&more| more > 0) {
        list.push(format!("and {more} more"));
    }
    list.join(", ")
}
