//! Default handling of signals in started programs.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Once};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag::register_conditional_shutdown;

/// Restores the default handling of SIGHUP, SIGINT and SIGTERM for started programs. `nohup` and shells with background
/// jobs ignore them, and programs inherit that. In the tests themselves these signals end the program.
///
/// # Panics
/// If the system refuses to handle signals.
pub fn restore_defaults() {
    static ONCE: Once = Once::new();
    // Only ignored signals are inherited. A signal that is handled here has its default handling in a started program.
    ONCE.call_once(|| {
        for signal in [SIGHUP, SIGINT, SIGTERM] {
            let always = Arc::new(AtomicBool::new(true));
            register_conditional_shutdown(signal, 128 + signal, always).expect("a signal that can be handled");
        }
    });
}
