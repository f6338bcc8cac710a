//! Where the time goes: processor and wall time by class of task.

use std::time::Instant;

use depthloom_graphs::plan::{NodeId, PartId, RunId};
use rustix::time::{ClockId, clock_gettime};

/// What kind of work a time was spent on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Phase {
    /// Reading a frame.
    Source,
    /// A node on a frame.
    Node(NodeId),
    /// Encoding a part of a frame.
    Encode(PartId),
    /// Writing a frame.
    Write,
    /// An ordered node's end, or an aggregate node.
    Once(NodeId),
}

/// The time one task took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// The frame's index in its source; 0 for once-values.
    pub frame_index: u64,
    /// Processor time, of the threads that helped with tiles too, nanoseconds.
    pub cpu_ns: u64,
    /// Time from start to end, nanoseconds.
    pub wall_ns: u64,
}

/// Sum and extremes of a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// All together, nanoseconds.
    pub sum_ns: u64,
    /// The least, nanoseconds.
    pub min_ns: u64,
    /// The most, nanoseconds.
    pub max_ns: u64,
}

impl Spread {
    const NONE: Self = Self { sum_ns: 0, min_ns: u64::MAX, max_ns: 0 };

    fn add(&mut self, ns: u64) {
        self.sum_ns += ns;
        self.min_ns = self.min_ns.min(ns);
        self.max_ns = self.max_ns.max(ns);
    }
}

/// The times of one class of tasks in a stage run.
#[derive(Clone, Debug)]
pub struct Timing {
    /// The stage run.
    pub run: RunId,
    /// The node's name, or `source`, `encode`, `write`.
    pub label: String,
    /// What was done.
    pub phase: Phase,
    /// How many tasks there were.
    pub count: u64,
    /// Processor time.
    pub cpu: Spread,
    /// Time from start to end.
    pub wall: Spread,
    /// The single times, in the order of the frames: all of them up to [`Timing::KEPT`], of longer runs every
    /// [`Timing::stride`]th, so that memory stays bounded and medians stay good.
    pub samples: Vec<Sample>,
    /// Every how many tasks a sample was kept.
    pub stride: u64,
}

impl Timing {
    /// The most samples kept of a class.
    pub const KEPT: usize = 256;

    pub(crate) const fn new(run: RunId, label: String, phase: Phase) -> Self {
        Self { run, label, phase, count: 0, cpu: Spread::NONE, wall: Spread::NONE, samples: Vec::new(), stride: 1 }
    }

    pub(crate) fn add(&mut self, frame_index: u64, spent: Spent) {
        if self.count.is_multiple_of(self.stride) {
            if self.samples.len() == Self::KEPT {
                let mut kept = 0_usize;
                self.samples.retain(|_| {
                    kept += 1;
                    kept % 2 == 1
                });
                self.stride *= 2;
            }
            // The one at hand may be among those that the new stride leaves out.
            if self.count.is_multiple_of(self.stride) {
                self.samples.push(Sample { frame_index, cpu_ns: spent.cpu_ns, wall_ns: spent.wall_ns });
            }
        }
        self.count += 1;
        self.cpu.add(spent.cpu_ns);
        self.wall.add(spent.wall_ns);
    }

    /// The median processor time of the samples, nanoseconds; the lower one of two middles. `None` without samples.
    #[must_use]
    pub fn median_cpu_ns(&self) -> Option<u64> {
        median(self.samples.iter().map(|s| s.cpu_ns).collect())
    }

    /// The median of the samples' times from start to end, nanoseconds; see [`Timing::median_cpu_ns`].
    #[must_use]
    pub fn median_wall_ns(&self) -> Option<u64> {
        median(self.samples.iter().map(|s| s.wall_ns).collect())
    }
}

fn median(mut times: Vec<u64>) -> Option<u64> {
    times.sort_unstable();
    times.get(times.len().checked_sub(1)? / 2).copied()
}

/// What a task took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Spent {
    pub(crate) cpu_ns: u64,
    pub(crate) wall_ns: u64,
}

/// Measures a task on the thread it runs on: both clocks at its start.
#[derive(Clone, Copy)]
pub(crate) struct Stopwatch {
    cpu_ns: u64,
    wall: Instant,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { wall: Instant::now(), cpu_ns: thread_cpu_ns() }
    }

    /// This thread's processor time since the start.
    pub(crate) fn cpu_ns(&self) -> u64 {
        thread_cpu_ns().saturating_sub(self.cpu_ns)
    }

    /// The time since the start; `helpers_cpu_ns` is what other threads did for the task.
    pub(crate) fn stop(&self, helpers_cpu_ns: u64) -> Spent {
        self.lap(helpers_cpu_ns).0
    }

    /// The time since the start, and a start for what follows.
    pub(crate) fn lap(&self, helpers_cpu_ns: u64) -> (Spent, Self) {
        let now = Self::start();
        let wall_ns = now.wall.saturating_duration_since(self.wall).as_nanos();
        let cpu_ns = now.cpu_ns.saturating_sub(self.cpu_ns) + helpers_cpu_ns;
        (Spent { cpu_ns, wall_ns: u64::try_from(wall_ns).unwrap_or(u64::MAX) }, now)
    }
}

#[expect(clippy::cast_sign_loss, reason = "a thread's processor time is not negative")]
fn thread_cpu_ns() -> u64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::plan::{NodeId, RunId};

    use super::{Phase, Spent, Stopwatch, Timing};

    #[test]
    fn long_runs_keep_evenly_spaced_samples_and_exact_sums() {
        let mut timing = Timing::new(RunId(0), "stereo".into(), Phase::Node(NodeId(0)));
        let frames = 5 * Timing::KEPT as u64 + 3;
        (0..frames).for_each(|k| timing.add(k, Spent { cpu_ns: k, wall_ns: 2 * k }));
        assert!(timing.samples.len() <= Timing::KEPT && timing.samples.len() >= Timing::KEPT / 2);
        assert!(timing.samples.iter().zip(0..).all(|(s, i)| s.frame_index == i * timing.stride));
        assert_eq!((timing.count, timing.cpu.min_ns, timing.wall.max_ns), (frames, 0, 2 * (frames - 1)));
        assert_eq!(timing.cpu.sum_ns, frames * (frames - 1) / 2);
        let median = timing.median_cpu_ns().expect("there are samples");
        assert!(median.abs_diff(frames / 2) <= timing.stride, "{median}");
    }

    #[test]
    fn processor_time_is_counted_while_working() {
        let watch = Stopwatch::start();
        let mut x = 1_u64;
        while watch.cpu_ns() < 1_000_000 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(watch.stop(5).cpu_ns >= 1_000_005);
    }
}
