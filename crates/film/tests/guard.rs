//! The guard around decoders; alone in its program, since it looks at the panic hook.

use std::panic::{catch_unwind, set_hook};
use std::sync::atomic::{AtomicUsize, Ordering};

use pileus_film::{DecoderPanic, guarded};

#[test]
fn panics_of_decoders_are_silent_errors_and_others_are_not() {
    static HEARD: AtomicUsize = AtomicUsize::new(0);
    set_hook(Box::new(|_| {
        HEARD.fetch_add(1, Ordering::Relaxed);
    }));
    let heard = || HEARD.load(Ordering::Relaxed);

    assert_eq!(guarded(|| 3), Ok(3));
    assert_eq!(guarded::<()>(|| panic!("a damaged block")), Err(DecoderPanic));
    let empty: [u8; 0] = [];
    let index = std::hint::black_box(7);
    assert_eq!(guarded(|| empty[index]), Err(DecoderPanic));
    // A decoder within a decoder.
    assert_eq!(guarded(|| guarded::<()>(|| panic!("inner"))), Ok(Err(DecoderPanic)));
    assert_eq!(
        guarded::<()>(|| {
            let _ = guarded(|| 1);
            panic!("outer, after an inner one")
        }),
        Err(DecoderPanic)
    );
    assert_eq!(heard(), 0);

    // Faults of our own are heard, on this thread and on others, even while one is guarded.
    assert!(catch_unwind(|| panic!("ours")).is_err());
    assert_eq!(heard(), 1);
    let other = guarded(|| std::thread::spawn(|| panic!("elsewhere")).join().is_err());
    assert_eq!(other, Ok(true));
    assert_eq!(heard(), 2);
    for _ in 0..3 {
        assert_eq!(guarded::<()>(|| panic!("again")), Err(DecoderPanic));
    }
    assert_eq!(heard(), 2);
}
