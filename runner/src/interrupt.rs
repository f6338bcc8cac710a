//! Ctrl-C, as a level.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// How urgently a run is asked to end; clones share the level, and raising it is safe in a signal handler's thread.
///
/// Raised once, no frame is admitted any more and those admitted retire; raised twice, the run is abandoned.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicU8>);

impl Interrupt {
    /// Raises the level by one, up to abandoning; returns how often it has been raised.
    pub fn raise(&self) -> u8 {
        let raise = |level: u8| Some(level.saturating_add(1).min(2));
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, raise).map_or(2, |before| (before + 1).min(2))
    }

    /// Whether no frame is to be admitted any more.
    #[must_use]
    pub fn stops_admission(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 1
    }

    /// Whether the run is abandoned.
    #[must_use]
    pub fn aborts(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 2
    }
}

#[cfg(test)]
mod tests {
    use super::Interrupt;

    #[test]
    fn the_first_stops_admission_and_the_second_aborts() {
        let interrupt = Interrupt::default();
        assert!(!interrupt.stops_admission() && !interrupt.aborts());
        assert_eq!(interrupt.clone().raise(), 1);
        assert!(interrupt.stops_admission() && !interrupt.aborts());
        assert_eq!((interrupt.raise(), interrupt.raise()), (2, 2));
        assert!(interrupt.aborts());
    }
}
