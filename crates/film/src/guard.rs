//! The one guard around decoders of other crates.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether a panic of this thread is expected, so that nothing is printed about it.
    static GUARDED: Cell<bool> = const { Cell::new(false) };
}

static HOOK: Once = Once::new();

/// A decoder panicked: the bytes are damaged in a way that it does not expect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the decoder gave up: the data is damaged")]
pub struct DecoderPanic;

/// Runs a decoder of another crate and turns its panics into errors, without a word on standard
/// error.
///
/// Decoders of PNG (`png` 0.18) and OpenEXR (`exr` 1.74: B44, DWA) panic on some damaged images; a
/// picture that somebody else wrote must not end a render. What `decoder` borrows must not be used
/// after a panic. The memory that a decoder may ask for is not bounded here: callers check sizes
/// in the header against limits and against the size of the file first, since an allocation that
/// fails ends the process.
///
/// The first call installs a panic hook that hands every other panic to the hook before it. The
/// decoder must run on the calling thread: panics of threads that it starts are not covered.
///
/// # Errors
/// [`DecoderPanic`] if it panicked.
pub fn guarded<T>(decoder: impl FnOnce() -> T) -> Result<T, DecoderPanic> {
    HOOK.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            if !GUARDED.get() {
                before(panic);
            }
        }));
    });
    let outer = GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(decoder));
    GUARDED.set(outer);
    result.map_err(|_| DecoderPanic)
}
