//! `depthloom synth`: a synthetic street as a data set in KITTI stereo 2015 layout.

use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_datasets::kitti_layout;
use depthloom_graphs::contracts::FrameSelection;
use depthloom_graphs::{Fault, Host, counted};
use depthloom_nodes::sources::SyntheticRoadParams;
use depthloom_runner::Interrupt;
use depthloom_terminal::{CliError, ExitCode, is_refused, print_path};
use depthloom_threads::{Budget, core_count};
use indicatif::ProgressBar;

use crate::args::SynthArgs;
use crate::output::progress::bar;
use crate::signals;

pub(crate) fn synth(args: &SynthArgs) -> Result<ExitCode, CliError> {
    let params = SyntheticRoadParams {
        frames: FrameSelection::Range(0..u64::from(args.frames)),
        seed: args.seed,
        width: args.width,
        height: args.height,
        ..SyntheticRoadParams::default()
    };
    let bar = bar(args.quiet, u64::from(args.frames), "{bar:30} {pos}/{len} frames  {eta} left");
    let (budget, interrupt) = (Budget::new(core_count()), signals::listen("stopping: started frames are finished")?);
    let _own = budget.permit();
    let renderer = Renderer { bar: &bar, interrupt, budget: &budget, has_begun: AtomicBool::new(false) };
    let frames = kitti_layout::write(&args.out, &params, &renderer).map_err(|fault| {
        let exit = match (&fault, renderer.has_begun.load(Ordering::Relaxed)) {
            (Fault::Cancelled, _) => return CliError::new(ExitCode::Interrupted, "interrupted"),
            (fault, false) if !is_refused(fault) => ExitCode::Usage,
            (_, false) => ExitCode::Engine,
            (_, true) => ExitCode::Engine,
        };
        let stop = CliError::from_error(exit, &fault);
        if is_refused(&fault) {
            stop.remedy("choose a folder on a disk with space, that you may write to")
        } else {
            stop
        }
    })?;
    bar.finish_and_clear();
    if !args.quiet {
        print_path(&format!("{} in ", counted(frames, "frame")), &args.out)?;
    }
    Ok(ExitCode::Success)
}

/// Renders with every core; one frame at a time.
struct Renderer<'a> {
    bar: &'a ProgressBar,
    interrupt: Interrupt,
    budget: &'a Budget,
    has_begun: AtomicBool,
}

impl Host for Renderer<'_> {
    fn cancelled(&self) -> bool {
        self.interrupt.stops_admission()
    }

    fn progress(&self, done: u64, _total: u64, _message: &str) {
        self.has_begun.store(true, Ordering::Relaxed);
        self.bar.set_position(done);
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        self.budget.tiles(n, f, &|work| work());
    }

    fn width(&self) -> usize {
        self.budget.width()
    }
}
