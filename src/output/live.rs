//! How a live run is doing: a display on a terminal, plain lines otherwise, nothing when asked to be quiet.

mod display;
mod picture;

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use depthloom_graphs::Frame;
use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, Plan, RunId};
use depthloom_runner::{LiveStatus, Observer};
use depthloom_terminal::say;
use depthloom_threads::locked;

use self::display::Display;
use super::progress::{EVERY, Progress};
use crate::execution::live::LatestMap;

/// Messages of other threads, which are shown with the next status.
#[derive(Clone, Default)]
pub(crate) struct Messages(Arc<Mutex<Vec<String>>>);

impl Messages {
    pub(crate) fn push(&self, text: String) {
        locked(&self.0).push(text);
    }

    fn take(&self) -> Vec<String> {
        std::mem::take(&mut *locked(&self.0))
    }

    /// Prints what came after the last status.
    pub(crate) fn print_rest(&self, is_silent: bool) {
        self.take().into_iter().filter(|_| !is_silent).for_each(say);
    }
}

/// The progress of a live run: of the stages before it, and of the live stage.
pub(crate) struct LiveProgress {
    before: Progress,
    run: RunId,
    stage: String,
    source: String,
    nodes: Vec<String>,
    is_silent: bool,
    messages: Messages,
    state: Mutex<State>,
}

struct State {
    /// Until the live stage starts, and where there is no terminal, there is no display.
    display: Option<Display>,
    wants_display: bool,
    latest: LatestMap,
    printed: Option<Instant>,
    failed: u64,
}

impl LiveProgress {
    /// `latest` has the map that the display shows. `is_plain` prints lines on a terminal, too.
    pub(crate) fn new(
        plan: &Plan,
        run: RunId,
        latest: LatestMap,
        messages: Messages,
        is_plain: bool,
        is_silent: bool,
    ) -> Self {
        let stage = &plan.runs[run];
        let wants_display = !is_plain && !is_silent && std::io::stderr().is_terminal();
        let state = State { display: None, wants_display, latest, printed: None, failed: 0 };
        Self {
            before: Progress::new(plan, is_silent),
            run,
            stage: stage.stage.clone(),
            source: stage.source.name.clone(),
            nodes: stage.nodes.iter().map(|node| node.name.clone()).collect(),
            is_silent,
            messages,
            state: Mutex::new(state),
        }
    }

    fn node(&self, node: Option<NodeId>) -> &str {
        node.map_or(Some(self.source.as_str()), |node| self.nodes.get(node.0).map(String::as_str)).unwrap_or_default()
    }

    /// Prints a line, or shows it as the last message of the display.
    fn message(&self, text: String) {
        match &mut locked(&self.state).display {
            Some(display) => display.message(text),
            None if self.is_silent => {}
            None => say(text),
        }
    }
}

/// One line about the last seconds of a live stage.
fn line(stage: &str, status: &LiveStatus) -> String {
    let ms = |ns: u64| ns as f64 / 1e6;
    let mut line = format!(
        "{stage}: {:.1} of {:.1} frames per second, {} processed, {} dropped",
        status.processed_hz,
        status.offered_hz,
        status.processed,
        status.drops.total()
    );
    if status.frames.count > 0 {
        let _ =
            write!(line, "; latency p50 {:.1} ms, p99 {:.1} ms", ms(status.frames.p50_ns), ms(status.frames.p99_ns));
    }
    let _ = write!(line, "; window {}", status.window);
    line
}

impl Observer for LiveProgress {
    fn stage_started(&self, run: RunId, frames: u64) {
        if run != self.run {
            return self.before.stage_started(run, frames);
        }
        let mut state = locked(&self.state);
        if state.wants_display {
            // A terminal that cannot be drawn on gets lines.
            state.display = Display::start(&self.stage).ok();
        }
        if state.display.is_none() && !self.is_silent {
            say(format_args!("{}: waiting for the first frame", self.stage));
        }
    }

    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        if run != self.run {
            return self.before.frame_retired(run, frame, failures);
        }
        let Some(failure) = failures.iter().find(|failure| !failure.what.starts_with("not run: ")) else { return };
        let mut state = locked(&self.state);
        state.failed += 1;
        // One failing node would fill the terminal.
        let is_first = state.failed.is_power_of_two();
        drop(state);
        if is_first {
            let node = self.node(failure.node);
            self.message(format!("{}.{node}: frame {} failed: {}", self.stage, frame.id, failure.what));
        }
    }

    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        if run != self.run {
            self.before.progress(run, node, done, total, message);
        }
    }

    fn warned(&self, run: RunId, node: Option<NodeId>, what: &str) {
        if run == self.run {
            self.message(format!("warning: {}.{}: {what}", self.stage, self.node(node)));
        }
    }

    fn info(&self, run: RunId, node: NodeId, what: &str) {
        if run == self.run {
            self.message(format!("{}.{}: {what}", self.stage, self.node(Some(node))));
        } else {
            self.before.info(run, node, what);
        }
    }

    fn live(&self, _run: RunId, status: &LiveStatus) {
        self.messages.take().into_iter().for_each(|text| self.message(text));
        let mut state = locked(&self.state);
        let map = locked(&state.latest).clone();
        if let Some(display) = &mut state.display {
            display.draw(status, map.as_ref());
            return;
        }
        if self.is_silent || state.printed.is_some_and(|printed| printed.elapsed() < EVERY) {
            return;
        }
        // The first line after a second: half of it has no frames yet.
        if status.elapsed >= Duration::from_secs(1) {
            state.printed = Some(Instant::now());
            drop(state);
            say(line(&self.stage, status));
        }
    }

    fn stage_finished(&self, run: RunId) {
        if run == self.run {
            // Restores the terminal.
            locked(&self.state).display = None;
        } else {
            self.before.stage_finished(run);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use depthloom_graphs::contracts::Drops;
    use depthloom_runner::{Latency, LiveStatus};

    use super::line;

    pub(super) fn status() -> LiveStatus {
        let frames = Latency {
            count: 12,
            p50_ns: 31_000_000,
            p95_ns: 38_000_000,
            p99_ns: 44_400_000,
            max_ns: 50_000_000,
            jitter_ns: 1_000_000,
        };
        LiveStatus {
            elapsed: Duration::from_secs(5),
            offered: 150,
            processed: 140,
            drops: Drops { graph: 7, recording: 2, source: 1 },
            offered_hz: 30.0,
            processed_hz: 28.04,
            window: 2,
            frames,
            steps: Vec::new(),
        }
    }

    #[test]
    fn a_line_has_rate_drops_and_latency() {
        assert_eq!(
            line("fly", &status()),
            "fly: 28.0 of 30.0 frames per second, 140 processed, 10 dropped; latency p50 31.0 ms, p99 44.4 ms; window 2"
        );
        let no_frames = LiveStatus { frames: Latency::default(), ..status() };
        assert!(line("fly", &no_frames).ends_with("10 dropped; window 2"));
    }
}
