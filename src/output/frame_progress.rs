//! Progress of a walk over a data set: a bar on a terminal, otherwise a line now and then, or nothing with `--quiet`
//! quiet.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::Instant;

use depthloom_threads::locked;
use indicatif::ProgressBar;

use depthloom_graphs::counted;
use depthloom_terminal::say;

use crate::output::progress::{EVERY, frames_bar};

pub(crate) struct FrameProgress {
    name: String,
    frames: u64,
    bar: Option<ProgressBar>,
    now: Mutex<Now>,
}

struct Now {
    done: u64,
    faults: u64,
    /// When a line was printed last; `None`: none ever is.
    printed: Option<Instant>,
}

impl FrameProgress {
    /// Starts a walk over a number of frames of a source.
    pub(crate) fn new(name: &str, frames: u64, quiet: bool) -> Self {
        let is_bar = !quiet && std::io::stderr().is_terminal();
        let bar = is_bar.then(|| frames_bar(name, frames));
        let printed = (!quiet && !is_bar).then(Instant::now);
        Self { name: name.to_owned(), frames, bar, now: Mutex::new(Now { done: 0, faults: 0, printed }) }
    }

    /// Counts a frame that was read, and its faults.
    pub(crate) fn one_more(&self, faults: u64) {
        let mut now = locked(&self.now);
        now.done += 1;
        now.faults += faults;
        if let Some(bar) = &self.bar {
            bar.set_position(now.done);
            if now.faults > 0 {
                bar.set_message(counted(now.faults, "fault"));
            }
        }
        if now.printed.is_some_and(|printed| printed.elapsed() >= EVERY) {
            now.printed = Some(Instant::now());
            let frames = counted(self.frames, "frame");
            say(format_args!("{}: {}/{frames}, {}", self.name, now.done, counted(now.faults, "fault")));
        }
    }
}

impl Drop for FrameProgress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
