//! Signals as a terminal's programs have them.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Once};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::register_conditional_shutdown;

/// Makes programs that are started from here take hangups, interrupts and terminations, whoever ignored them when the
/// tests began: `nohup` does, and a shell of its background jobs. Here they end the tests, as ever.
///
/// # Panics
/// If the system lets nobody handle signals.
pub fn as_usual() {
    static ONCE: Once = Once::new();
    // What is handled here is at its default in a program that is started: only what is ignored is inherited.
    ONCE.call_once(|| {
        for signal in [SIGHUP, SIGINT, SIGTERM] {
            let always = Arc::new(AtomicBool::new(true));
            register_conditional_shutdown(signal, 128 + signal, always).expect("a signal that can be handled");
        }
    });
}
