//! How far a run is: a bar on a terminal, plain lines otherwise, nothing when asked to be quiet.

use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use depthloom_graphs::contracts::Failure;
use depthloom_graphs::plan::{NodeId, Plan, RunId};
use depthloom_graphs::{Frame, counted};
use depthloom_runner::Observer;
use depthloom_terminal::{on_one_line, say};
use depthloom_threads::locked;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A plain line is printed this often at most.
pub(crate) const EVERY: Duration = Duration::from_secs(5);

pub(crate) struct Progress {
    how: How,
    stages: Vec<Stage>,
    now: Mutex<Now>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum How {
    Bar,
    Lines,
    Silent,
}

struct Stage {
    name: String,
    nodes: Vec<String>,
}

struct Now {
    bar: ProgressBar,
    frames: u64,
    done: u64,
    failed: u64,
    started: Instant,
    said: Instant,
}

impl Progress {
    /// For a plan's stage runs; silent if asked to be quiet.
    pub(crate) fn new(plan: &Plan, quiet: bool) -> Self {
        let how = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => How::Silent,
            (false, true) => How::Bar,
            (false, false) => How::Lines,
        };
        let stage = |run: &depthloom_graphs::plan::StageRun| Stage {
            name: run.prefix.trim_start_matches('/').to_owned(),
            nodes: run.nodes.iter().map(|node| node.name.clone()).collect(),
        };
        let (started, said) = (Instant::now(), Instant::now());
        let now = Now { bar: ProgressBar::hidden(), frames: 0, done: 0, failed: 0, started, said };
        Self { how, stages: plan.runs.iter().map(stage).collect(), now: Mutex::new(now) }
    }

    fn with_now<R>(&self, f: impl FnOnce(&mut Now) -> R) -> R {
        // A panic in another observer call must not hide the progress of the rest.
        f(&mut locked(&self.now))
    }
}

/// A bar for a terminal, hidden if it is `quiet`.
pub(crate) fn bar(quiet: bool, length: u64, template: &str) -> ProgressBar {
    let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(length) };
    bar.with_style(style(template))
}

/// A bar for the frames of a stage or a source, on standard error.
pub(crate) fn frames_bar(name: &str, frames: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(frames), ProgressDrawTarget::stderr());
    bar.set_style(style("{prefix:12} {bar:30} {pos}/{len} frames  {per_sec}  {eta} left  {msg}"));
    bar.with_prefix(on_one_line(name).into_owned())
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

impl Observer for Progress {
    fn stage_started(&self, run: RunId, frames: u64) {
        let name = &self.stages[run].name;
        self.with_now(|now| {
            (now.frames, now.done, now.failed) = (frames, 0, 0);
            (now.started, now.said) = (Instant::now(), Instant::now());
            match self.how {
                How::Bar => now.bar = frames_bar(name, frames),
                How::Lines => say(format_args!("{name}: {}", counted(frames, "frame"))),
                How::Silent => {}
            }
        });
    }

    fn frame_retired(&self, run: RunId, frame: &Frame, failures: &[Failure]) {
        self.with_now(|now| {
            now.done += 1;
            now.failed += u64::from(!failures.is_empty());
            match self.how {
                How::Bar => {
                    now.bar.set_position(now.done);
                    if now.failed > 0 {
                        now.bar.set_message(format!("{} failed", now.failed));
                    }
                }
                How::Lines => {
                    // An ordered node that failed once is not run on any later frame: the first line says why.
                    if let Some(failure) = failures.iter().find(|failure| !failure.what.starts_with("not run: ")) {
                        let stage = &self.stages[run];
                        let node =
                            failure.node.map_or(Some("source"), |node| stage.nodes.get(node.0).map(String::as_str));
                        let (stage, node) = (&stage.name, node.unwrap_or_default());
                        say(format_args!("{stage}.{node}: frame {} failed: {}", frame.id, failure.what));
                    }
                    if now.said.elapsed() >= EVERY {
                        now.said = Instant::now();
                        let per_second = now.done as f64 / now.started.elapsed().as_secs_f64();
                        let left = (now.frames - now.done) as f64 / per_second;
                        let (done, frames) = (now.done, now.frames);
                        let name = &self.stages[run].name;
                        let frames = counted(frames, "frame");
                        say(format_args!("{name}: {done}/{frames}, {per_second:.1} a second, {left:.0} s left"));
                    }
                }
                How::Silent => {}
            }
        });
    }

    fn progress(&self, run: RunId, node: NodeId, done: u64, total: u64, message: &str) {
        let stage = &self.stages[run];
        let name = stage.nodes.get(node.0).map_or("", String::as_str);
        self.with_now(|now| match self.how {
            How::Bar => {
                now.bar.set_message(on_one_line(&format!("{name} {done}/{total} {message}")).into_owned());
            }
            How::Lines if now.said.elapsed() >= EVERY || done == total => {
                now.said = Instant::now();
                say(format_args!("{}.{name}: {done}/{total} {message}", stage.name));
            }
            How::Lines | How::Silent => {}
        });
    }

    fn info(&self, run: RunId, node: NodeId, what: &str) {
        let stage = &self.stages[run];
        let name = stage.nodes.get(node.0).map_or("", String::as_str);
        let line = format!("{}.{name}: {what}", stage.name);
        self.with_now(|now| match self.how {
            How::Bar => now.bar.suspend(|| say(line)),
            How::Lines => say(line),
            How::Silent => {}
        });
    }

    fn stage_finished(&self, run: RunId) {
        self.with_now(|now| match self.how {
            How::Bar => now.bar.finish_and_clear(),
            How::Lines => {
                let seconds = now.started.elapsed().as_secs_f64();
                let frames = counted(now.frames, "frame");
                say(format_args!("{}: {} of {frames} in {seconds:.1} s", self.stages[run].name, now.done));
            }
            How::Silent => {}
        });
    }
}
