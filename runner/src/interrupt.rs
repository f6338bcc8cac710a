//! Ctrl-C, as a level.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// How urgently a run has to end. Clones share the level, and raising it is safe in a signal handler's thread.
///
/// Level 1: no more frames are admitted, and those in flight are finished. Level 2: the run is abandoned.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicU8>);

impl Interrupt {
    /// Raises the level by one, up to 2; returns the new level.
    pub fn raise(&self) -> u8 {
        let raise = |level: u8| Some(level.saturating_add(1).min(2));
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, raise).map_or(2, |before| (before + 1).min(2))
    }

    /// Takes back level 1, because a live stage has ended as requested: what follows it is not interrupted.
    pub(crate) fn take_back(&self) {
        let _ = self.0.compare_exchange(1, 0, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Whether no more frames are admitted.
    pub fn stops_admission(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 1
    }

    /// Whether the run is abandoned.
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
