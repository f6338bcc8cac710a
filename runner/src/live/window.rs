//! The smallest window that keeps the rate.
//!
//! By Little's law, latency grows with the number of frames in flight while the rate does not, as soon as all workers
//! are busy. This matters only while the nodes cannot keep up: otherwise frames arrive more slowly than they are
//! processed, and a large window absorbs a moment in which the machine does other work. So while a good part of the
//! frames is dropped, the window is tried one smaller or one larger for a period. The smaller one must be as fast, the
//! larger one faster; if neither is, the next trials come later. When frames are dropped no longer, the window is the
//! largest again.

/// The largest loss in rate for which a smaller window is kept, and the least gain for which a larger one is.
const LOSS: f64 = 0.97;
const GAIN: f64 = 1.03;
/// The share of dropped frames from which the nodes cannot keep up.
const OVERLOAD: f64 = 0.05;
/// Periods between trials, once neither a smaller nor a larger window was better.
const REST: u32 = 20;
/// Periods without overload after which the window is the largest again.
const QUIET: u32 = 6;

/// Chooses the window of a live stage.
pub(crate) struct WindowControl {
    window: usize,
    most: usize,
    is_fixed: bool,
    /// The rate before a trial, and whether the trial is of a larger window.
    trial: Option<(f64, bool)>,
    tries_larger: bool,
    /// Trials that failed since the last one that was kept.
    failed: u32,
    rest: u32,
    quiet: u32,
}

impl WindowControl {
    /// Starts with the largest window.
    pub(crate) const fn new(most: usize) -> Self {
        Self { window: most, most, is_fixed: false, trial: None, tries_larger: false, failed: 0, rest: 0, quiet: 0 }
    }

    pub(crate) const fn fixed(window: usize) -> Self {
        Self { is_fixed: true, ..Self::new(window) }
    }

    pub(crate) const fn window(&self) -> usize {
        self.window
    }

    /// Ends a period in which `rate` frames per second were written, and this share of the captured ones was dropped.
    pub(crate) fn end_period(&mut self, rate: f64, dropped: f64) {
        if self.is_fixed || self.most == 1 {
            return;
        }
        if dropped < OVERLOAD {
            self.trial = None;
            self.quiet += 1;
            if self.quiet >= QUIET {
                *self = Self::new(self.most);
            }
            return;
        }
        self.quiet = 0;
        if let Some((before, is_larger)) = self.trial.take() {
            self.end_trial(rate, before, is_larger);
        } else if self.rest > 0 {
            self.rest -= 1;
        } else {
            let is_larger = self.window == 1 || self.tries_larger && self.window < self.most;
            self.trial = Some((rate, is_larger));
            self.window = if is_larger { self.window + 1 } else { self.window - 1 };
        }
    }

    const fn end_trial(&mut self, rate: f64, before: f64, is_larger: bool) {
        let is_kept = rate >= before * if is_larger { GAIN } else { LOSS };
        if is_kept {
            self.failed = 0;
            return;
        }
        self.window = if is_larger { self.window - 1 } else { self.window + 1 };
        self.tries_larger = !is_larger;
        self.failed += 1;
        // At the ends there is only one direction.
        if self.failed >= 2 || self.window == self.most || self.window == 1 {
            (self.failed, self.rest) = (0, REST);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::WindowControl;

    /// The window in most periods, if the rate follows from the window and the nodes cannot keep up.
    fn settled(most: usize, rate: impl Fn(usize) -> f64) -> usize {
        let mut control = WindowControl::new(most);
        let windows: Vec<usize> = (0..400)
            .map(|_| {
                control.end_period(rate(control.window()), 0.5);
                control.window()
            })
            .collect();
        (1..=most).max_by_key(|window| windows.iter().filter(|at| *at == window).count()).expect("a window")
    }

    #[test]
    fn the_smallest_window_that_keeps_the_rate_is_found() {
        assert_eq!(settled(4, |_| 10.0), 1);
        assert_eq!(settled(4, |window| 10.0 * window.min(2) as f64), 2);
        assert_eq!(settled(4, |window| 10.0 * window.min(3) as f64), 3);
        assert_eq!(settled(10, |window| 10.0 * window as f64), 10);
        assert_eq!(settled(1, |_| 10.0), 1);
    }

    #[test]
    fn the_window_is_the_largest_where_the_nodes_keep_up_and_again_when_they_do() {
        let mut control = WindowControl::new(4);
        (0..50).for_each(|_| control.end_period(30.0, 0.01));
        assert_eq!(control.window(), 4);
        (0..50).for_each(|_| control.end_period(30.0, 0.5));
        assert!(control.window() < 4);
        (0..10).for_each(|_| control.end_period(30.0, 0.0));
        assert_eq!(control.window(), 4);
    }

    #[test]
    fn a_fixed_window_stays() {
        let mut control = WindowControl::fixed(3);
        (0..50).for_each(|_| control.end_period(30.0, 0.9));
        assert_eq!(control.window(), 3);
    }
}
