//! `depthloom synth`: a synthetic street as a data set in KITTI stereo 2015 layout.

use std::sync::atomic::{AtomicUsize, Ordering};

use depthloom_graphs::Host;
use depthloom_graphs::contracts::FrameSelection;
use depthloom_nodes::kitti_layout;
use depthloom_nodes::sources::SyntheticRoadParams;
use indicatif::{ProgressBar, ProgressStyle};

use super::print;
use crate::args::SynthArgs;
use crate::environment;
use crate::exit::{Exit, Stop, chain};

/// Writes the frames.
pub fn synth(args: &SynthArgs) -> Result<Exit, Stop> {
    let params = SyntheticRoadParams {
        frames: FrameSelection::Range(0..u64::from(args.frames)),
        seed: args.seed,
        width: args.width,
        height: args.height,
        ..SyntheticRoadParams::default()
    };
    let bar = if args.quiet { ProgressBar::hidden() } else { ProgressBar::new(u64::from(args.frames)) };
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} frames  {eta} left") {
        bar.set_style(style);
    }
    let frames = kitti_layout::write(&args.out, &params, &Renderer { bar: &bar }).map_err(|fault| {
        let stop = Stop::new(Exit::Before, chain(&fault));
        match fault.remedy_text() {
            Some(remedy) => stop.remedy(remedy),
            None => stop,
        }
    })?;
    bar.finish_and_clear();
    if !args.quiet {
        print(&format!("{frames} frames in {}\n", args.out.display()))?;
    }
    Ok(Exit::Whole)
}

/// Renders with every core; one frame at a time.
struct Renderer<'a> {
    bar: &'a ProgressBar,
}

impl Host for Renderer<'_> {
    fn cancelled(&self) -> bool {
        false
    }

    fn progress(&self, done: u64, _total: u64, _message: &str) {
        self.bar.set_position(done);
    }

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                match next.fetch_add(1, Ordering::Relaxed) {
                    tile if tile < n => f(tile),
                    _ => break,
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.width().min(n) {
                scope.spawn(work);
            }
            work();
        });
    }

    fn width(&self) -> usize {
        environment::cores()
    }
}
