//! What the program asks of the machine: memory used, signals.

use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::failure::Exit;

/// Most memory that this process had at any time, bytes; `None` where the system does not tell.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// Signals that end the program: Ctrl-C (SIGINT), and where there are such, SIGTERM and SIGHUP.
///
/// The first one while a picture is rendered is remembered, so that what was rendered can be
/// written. Before that there is nothing to write: a signal ends the program at once, as a second
/// one always does. In all cases the exit code is 128 plus the signal's number.
#[derive(Debug, Default)]
pub(crate) struct Signals {
    /// Exit code of the first signal caught; 0 is none.
    caught: Arc<AtomicUsize>,
    /// Whether the next signal ends the program.
    at_once: Arc<AtomicBool>,
}

impl Signals {
    /// The signals of this process, handled from now on.
    pub(crate) fn handled() -> &'static Signals {
        static SIGNALS: OnceLock<Signals> = OnceLock::new();
        SIGNALS.get_or_init(|| {
            let signals = Signals::default();
            signals.at_once.store(true, Ordering::SeqCst);
            if let Err(error) = signals.handle() {
                tracing::warn!("signals will end the program without an image: {error}");
            }
            signals
        })
    }

    /// From now on there is a picture to save.
    pub(crate) fn wait_for_the_first(&self) {
        self.at_once.store(false, Ordering::SeqCst);
    }

    /// Whether a signal came.
    pub(crate) fn came(&self) -> bool {
        self.caught.load(Ordering::Relaxed) != 0
    }

    /// The exit code of the first signal that came.
    pub(crate) fn exit(&self) -> Exit {
        let code = self.caught.load(Ordering::Relaxed);
        [Exit::Terminated, Exit::HungUp]
            .into_iter()
            .find(|exit| *exit as usize == code)
            .unwrap_or(Exit::Interrupted)
    }

    #[cfg(unix)]
    fn handle(&self) -> std::io::Result<()> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        for (signal, exit) in
            [(SIGINT, Exit::Interrupted), (SIGTERM, Exit::Terminated), (SIGHUP, Exit::HungUp)]
        {
            // Who starts a program by `nohup` wants it to outlive the terminal.
            if signal == SIGHUP && ignores(signal) {
                continue;
            }
            // In the order in which they run: a first signal arms what ends the program at the
            // second.
            use signal_hook::flag;
            flag::register_conditional_shutdown(signal, exit as i32, Arc::clone(&self.at_once))?;
            flag::register_usize(signal, Arc::clone(&self.caught), exit as usize)?;
            flag::register(signal, Arc::clone(&self.at_once))?;
        }
        Ok(())
    }

    #[cfg(not(unix))]
    fn handle(&self) -> Result<(), ctrlc::Error> {
        let (caught, at_once) = (Arc::clone(&self.caught), Arc::clone(&self.at_once));
        ctrlc::set_handler(move || {
            if at_once.swap(true, Ordering::SeqCst) {
                std::process::exit(Exit::Interrupted as i32);
            }
            caught.store(Exit::Interrupted as usize, Ordering::SeqCst);
        })
    }
}

/// Whether this process was started with a signal ignored; `false` where the system does not tell.
#[cfg(unix)]
fn ignores(signal: i32) -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return false };
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    let bit = u32::try_from(signal - 1).unwrap_or(u32::MAX);
    mask.checked_shr(bit).unwrap_or(0) & 1 == 1
}

#[cfg(test)]
mod tests {
    #[test]
    #[cfg(target_os = "linux")]
    fn memory_is_known_on_linux() {
        assert!(super::peak_memory_bytes().unwrap() > 100_000);
    }
}
