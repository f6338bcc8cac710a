//! Sources whose frames arrive while the graph runs: cameras, or a data set at a camera's rate.

use std::time::Instant;

use super::{Fault, Frame, SourceOutputs};

/// A frame that has just been captured.
#[derive(Clone, Debug)]
pub struct StreamFrame {
    /// Its id, its number in the stream, and its time by the clock of the source. Lost frames count in the number, so
    /// a gap shows them.
    pub frame: Frame,
    /// Its values and their key.
    pub read: SourceOutputs,
    /// When it was captured, by the monotonic clock of this machine. Latencies count from here.
    pub captured: Instant,
    /// How many frames the source lost since the previous one.
    pub missed: u64,
}

/// What [`StreamingSource::next`] found.
#[derive(Debug)]
pub enum NextFrame {
    /// A frame.
    Captured(Box<StreamFrame>),
    /// No frame until the deadline.
    TimedOut,
    /// The stream has ended.
    Ended,
}

/// A source whose frames cannot be listed: each arrives once, when it is captured.
pub trait StreamingSource: Send {
    /// Waits for the next frame, at most until the deadline. The stream's end is final.
    ///
    /// A source that recovers by itself (a program that is started again) does so, and reports it with
    /// [`StreamingSource::take_warnings`].
    ///
    /// # Errors
    /// The device or program at fault, and the remedy. The stream has ended then.
    fn next(&mut self, deadline: Instant) -> Result<NextFrame, Fault>;

    /// Discards frames that wait to be taken: the next one is captured after this call. None of them counts as lost.
    fn skip_to_now(&mut self) {}

    /// The warnings since the last call, as lower-case fragments.
    fn take_warnings(&mut self) -> Vec<String> {
        Vec::new()
    }
}

/// How many frames of a stream were not processed, by cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drops {
    /// The nodes could not keep up.
    pub graph: u64,
    /// The recording could not keep up.
    pub recording: u64,
    /// The source lost them.
    pub source: u64,
}

impl Drops {
    /// Frames dropped, for any cause.
    pub const fn total(&self) -> u64 {
        self.graph + self.recording + self.source
    }

    /// The causes and their counts, for messages and records.
    pub const fn by_cause(&self) -> [(&'static str, u64); 3] {
        [("graph", self.graph), ("recording", self.recording), ("source", self.source)]
    }
}

impl std::ops::AddAssign for Drops {
    fn add_assign(&mut self, other: Self) {
        self.graph += other.graph;
        self.recording += other.recording;
        self.source += other.source;
    }
}

/// What a live run knows of a frame beyond its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveCommit {
    /// The frames dropped since the previous frame that was written.
    pub drops: Drops,
    /// The time from its capture until all its values were there, nanoseconds.
    pub latency_ns: u64,
}
