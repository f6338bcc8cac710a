//! CPU and wall time by class of task.

use std::time::Instant;

use depthloom_graphs::plan::{NodeId, PartId, RunId};
use rustix::time::{ClockId, clock_gettime};

/// A class of tasks.
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
    /// An ordered node after its last frame, or an aggregate node.
    Once(NodeId),
}

/// The time of one task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sample {
    /// The frame's index in its source; 0 outside frames.
    pub frame_index: u64,
    /// CPU time, with that of threads that helped with tiles, nanoseconds.
    pub cpu_ns: u64,
    /// Wall time, nanoseconds.
    pub wall_ns: u64,
}

/// Sum and extremes of a time, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spread {
    /// The sum.
    pub sum_ns: u64,
    /// The minimum.
    pub min_ns: u64,
    /// The maximum.
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

/// The times of a class of tasks in a stage run.
#[derive(Clone, Debug)]
pub struct Timing {
    /// The stage run.
    pub run: RunId,
    /// The node's name, or `source`, `encode`, `write`.
    pub label: String,
    /// The class.
    pub phase: Phase,
    /// The number of tasks.
    pub count: u64,
    /// CPU time.
    pub cpu: Spread,
    /// Wall time.
    pub wall: Spread,
    /// Times of single tasks in the order of the frames: every [`Timing::stride`]th, at most [`Timing::KEPT`].
    pub samples: Vec<Sample>,
    /// The distance between two samples, in tasks.
    pub stride: u64,
}

impl Timing {
    /// The most samples per class.
    pub const KEPT: usize = 256;

    pub(crate) const fn new(run: RunId, label: String, phase: Phase) -> Self {
        Self { run, label, phase, count: 0, cpu: Spread::NONE, wall: Spread::NONE, samples: Vec::new(), stride: 1 }
    }

    pub(crate) fn add(&mut self, frame_index: u64, spent: Spent) {
        if self.count.is_multiple_of(self.stride) {
            if self.samples.len() == Self::KEPT {
                let mut index = 0_usize;
                self.samples.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
                self.stride *= 2;
            }
            // The new stride may leave out this one.
            if self.count.is_multiple_of(self.stride) {
                self.samples.push(Sample { frame_index, cpu_ns: spent.cpu_ns, wall_ns: spent.wall_ns });
            }
        }
        self.count += 1;
        self.cpu.add(spent.cpu_ns);
        self.wall.add(spent.wall_ns);
    }

    /// The median CPU time of the samples, nanoseconds; the lower one of two. `None` without samples.
    pub fn median_cpu_ns(&self) -> Option<u64> {
        let mut times: Vec<u64> = self.samples.iter().map(|sample| sample.cpu_ns).collect();
        times.sort_unstable();
        times.get(times.len().checked_sub(1)? / 2).copied()
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Spent {
    pub(crate) cpu_ns: u64,
    pub(crate) wall_ns: u64,
    /// When the task ended.
    pub(crate) ended: Option<Instant>,
}

/// A task that takes less time than this does nothing but compute: a thread that waits or is interrupted takes longer.
const SHORT_NS: u64 = 10_000;

/// Both clocks at the start of a task, on the thread that runs it.
#[derive(Clone, Copy)]
pub(crate) struct Stopwatch {
    cpu_ns: u64,
    wall: Instant,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { wall: Instant::now(), cpu_ns: thread_cpu_ns() }
    }

    /// This thread's CPU time since the start.
    pub(crate) fn cpu_ns(&self) -> u64 {
        thread_cpu_ns().saturating_sub(self.cpu_ns)
    }

    /// The time since the start; `helpers_cpu_ns` is the CPU time of other threads for the task.
    pub(crate) fn stop(&self, helpers_cpu_ns: u64) -> Spent {
        self.lap(helpers_cpu_ns).0
    }

    /// The time since the start, and the start of the next task. The CPU time of a short task is its wall time: asking
    /// the system for it would be a fifth of the engine's cost per task.
    pub(crate) fn lap(&self, helpers_cpu_ns: u64) -> (Spent, Self) {
        let wall = Instant::now();
        let wall_ns = u64::try_from(wall.saturating_duration_since(self.wall).as_nanos()).unwrap_or(u64::MAX);
        let now = if wall_ns < SHORT_NS { self.cpu_ns + wall_ns } else { thread_cpu_ns() };
        let cpu_ns = now.saturating_sub(self.cpu_ns) + helpers_cpu_ns;
        (Spent { cpu_ns, wall_ns, ended: Some(wall) }, Self { cpu_ns: now, wall })
    }
}

#[expect(clippy::cast_sign_loss, reason = "a thread's CPU time is not negative")]
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
        (0..frames).for_each(|k| timing.add(k, Spent { cpu_ns: k, wall_ns: 2 * k, ended: None }));
        assert!(timing.samples.len() <= Timing::KEPT && timing.samples.len() >= Timing::KEPT / 2);
        assert!(timing.samples.iter().zip(0..).all(|(s, i)| s.frame_index == i * timing.stride));
        assert_eq!((timing.count, timing.cpu.min_ns, timing.wall.max_ns), (frames, 0, 2 * (frames - 1)));
        assert_eq!(timing.cpu.sum_ns, frames * (frames - 1) / 2);
        let median = timing.median_cpu_ns().expect("there are samples");
        assert!(median.abs_diff(frames / 2) <= timing.stride, "{median}");
    }

    #[test]
    fn cpu_time_is_counted_while_working() {
        let watch = Stopwatch::start();
        let mut x = 1_u64;
        while watch.cpu_ns() < 1_000_000 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        assert!(watch.stop(5).cpu_ns >= 1_000_005);
    }
}
