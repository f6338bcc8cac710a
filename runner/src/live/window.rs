//! The smallest window that keeps the rate.
//!
//! By Little's law, frames wait for each other if more are in flight than the workers need, and latency grows with the
//! window while the rate does not. Only while frames are dropped does the window matter: otherwise frames arrive more
//! slowly than they are processed. So the window is tried one larger or one smaller for a period in which frames are
//! dropped. The larger one must be faster, the smaller one as fast; if neither is, the next trials come later.

/// The least gain in rate for which a larger window is kept, and the largest loss for which a smaller one is.
const GAIN: f64 = 1.03;
const LOSS: f64 = 0.98;
/// Periods between trials, once neither a larger nor a smaller window was better.
const REST: u32 = 20;

/// Chooses the window of a live stage.
pub(crate) struct WindowControl {
    window: usize,
    most: usize,
    /// The rate before a trial, and whether the trial is of a larger window.
    trial: Option<(f64, bool)>,
    tries_larger: bool,
    failed: u32,
    rest: u32,
}

impl WindowControl {
    /// Starts with a frame for every worker.
    pub(crate) fn new(workers: usize, most: usize) -> Self {
        let window = workers.clamp(1, most);
        Self { window, most, trial: None, tries_larger: true, failed: 0, rest: 0 }
    }

    pub(crate) fn fixed(window: usize) -> Self {
        Self { window, most: window, trial: None, tries_larger: true, failed: 0, rest: u32::MAX }
    }

    pub(crate) const fn window(&self) -> usize {
        self.window
    }

    /// Ends a period in which `rate` frames per second were written, and frames were dropped or not.
    pub(crate) fn end_period(&mut self, rate: f64, has_drops: bool) {
        if self.rest == u32::MAX {
            return;
        }
        if !has_drops {
            // A trial that ends without drops keeps the rate.
            self.trial = None;
            return;
        }
        if let Some((before, is_larger)) = self.trial.take() {
            let is_kept = rate >= before * if is_larger { GAIN } else { LOSS };
            if is_kept {
                self.failed = 0;
            } else {
                self.window = if is_larger { self.window - 1 } else { self.window + 1 };
                self.failed += 1;
                self.tries_larger = !is_larger;
            }
            if self.failed >= 2 {
                (self.failed, self.rest) = (0, REST);
            }
            return;
        }
        if self.rest > 0 {
            self.rest -= 1;
            return;
        }
        let is_larger = if self.window == 1 { true } else { self.tries_larger && self.window < self.most };
        if is_larger && self.window == self.most {
            return;
        }
        self.trial = Some((rate, is_larger));
        self.window = if is_larger { self.window + 1 } else { self.window - 1 };
    }
}

#[cfg(test)]
mod tests {
    use super::WindowControl;

    /// The window after many periods, if the rate follows from the window.
    fn settled(workers: usize, most: usize, rate: impl Fn(usize) -> f64) -> usize {
        let mut control = WindowControl::new(workers, most);
        let windows: Vec<usize> = (0..400)
            .map(|_| {
                control.end_period(rate(control.window()), true);
                control.window()
            })
            .collect();
        // The most frequent one: trials come and go.
        (1..=most).max_by_key(|window| windows.iter().filter(|at| *at == window).count()).expect("a window")
    }

    #[test]
    fn the_smallest_window_that_keeps_the_rate_is_found() {
        assert_eq!(settled(2, 4, |_| 10.0), 1);
        assert_eq!(settled(2, 4, |window| 10.0 * window.min(2) as f64), 2);
        assert_eq!(settled(2, 4, |window| 10.0 * window.min(3) as f64), 3);
        assert_eq!(settled(8, 10, |window| 10.0 * window as f64), 10);
    }

    #[test]
    fn nothing_changes_without_drops_or_with_a_fixed_window() {
        let mut control = WindowControl::new(2, 4);
        (0..50).for_each(|_| control.end_period(30.0, false));
        assert_eq!(control.window(), 2);
        let mut control = WindowControl::fixed(3);
        (0..50).for_each(|_| control.end_period(30.0, true));
        assert_eq!(control.window(), 3);
    }
}
