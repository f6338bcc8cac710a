//! Live operation: one stage of a run whose frames arrive at their own rate.
//!
//! A thread captures frames and hands the newest one over; a frame that was not taken when the next one arrives is
//! dropped. This is the only place where frames are dropped: a frame that was admitted is processed and written. At
//! most one frame waits, and at most a window of frames is in flight, so memory is bounded at any rate.
//!
//! The second frame is captured when the first one has been written, because nodes build their networks on it.
//!
//! Workers run nodes before they encode values for the recording, of the oldest frame first. The window is the smallest
//! one that keeps the rate (`window.rs`).

pub(crate) mod capture;
pub(crate) mod latency;
pub(crate) mod mailbox;
mod paced;
mod window;

use std::time::Duration;

use depthloom_graphs::contracts::{Drops, StreamingSource};
use depthloom_graphs::plan::RunId;

pub use latency::{Latency, StepLatency};
pub use paced::{Pace, Paced, Playback};
pub(crate) use window::WindowControl;

/// The stage that runs live, and its stream.
pub struct Live {
    /// The stage. The others run as usual.
    pub run: RunId,
    /// Its frames.
    pub stream: Box<dyn StreamingSource>,
    /// How it runs.
    pub options: LiveOptions,
}

/// How a stage runs live.
#[derive(Clone, Debug, Default)]
pub struct LiveOptions {
    /// How long frames are captured; without it, until the stream ends or the run is interrupted.
    pub duration: Option<Duration>,
    /// Whether the source waits until a frame has been admitted, instead of dropping frames.
    pub no_drop: bool,
    /// The latency that a frame should not exceed.
    pub deadline: Option<Duration>,
    /// Frames in flight; without it, at most [`Options::window`](field@crate::Options::window), and under overload the
    /// smallest number that keeps the rate.
    pub window: Option<usize>,
}

/// A live stage at one moment: since its start, and since the previous moment.
#[derive(Clone, Debug)]
pub struct LiveStatus {
    /// The time since the first frame was awaited.
    pub elapsed: Duration,
    /// Frames captured, with those that were dropped.
    pub offered: u64,
    /// Frames written.
    pub processed: u64,
    /// Frames dropped.
    pub drops: Drops,
    /// Frames captured per second, lately.
    pub offered_hz: f64,
    /// Frames written per second, lately.
    pub processed_hz: f64,
    /// Frames that may be in flight.
    pub window: usize,
    /// The latency of frames, lately: see [`LiveReport::frames`].
    pub frames: Latency,
    /// By step, lately.
    pub steps: Vec<StepLatency>,
}

/// What a live stage did.
#[derive(Clone, Debug)]
pub struct LiveReport {
    /// The stage.
    pub run: RunId,
    /// The time from the first wait for a frame until the last frame was written.
    pub elapsed: Duration,
    /// Frames captured, with those that were dropped. Equal to `processed` and the drops together.
    pub offered: u64,
    /// Frames written.
    pub processed: u64,
    /// Frames dropped, by cause.
    pub drops: Drops,
    /// The deadline, and how many frames missed it.
    pub deadline: Option<(Duration, u64)>,
    /// The last window.
    pub window: usize,
    /// The latency of the first frame, on which nodes start up, nanoseconds; 0 if there was none. It is in none of the
    /// others, and the next frame is captured after it.
    pub first_frame_ns: u64,
    /// From the capture of a frame until the last of its estimates was there, or the last value of a node if the stage
    /// has no estimates.
    pub frames: Latency,
    /// By step: the source, the nodes, the parts of the recording, writing.
    pub steps: Vec<StepLatency>,
    /// The step that takes most of a frame's time, and its share of the time of all steps, if frames were dropped
    /// because the nodes could not keep up.
    pub bottleneck: Option<(String, f64)>,
}
