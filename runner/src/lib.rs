//! Executes a plan: admission, workers, tap.
//!
//! A stage run is a frame-synchronous dataflow: a node fires for frame k when its inputs for k are there, whatever other
//! frames do. What waits is counted by atomics; what is ready lies in crossbeam queues, one for each frame in flight, and
//! workers take from the oldest. Back-pressure acts at admission only: frame k is let in when k < oldest unretired frame +
//! window, and a frame retires when the tap has written it; no task ever waits for another, so that no cycle of waits exists.
//! A value is dropped when the last node that reads it and the tap are done with it.
//!
//! Results do not depend on the number of workers, nor on the window: bit for bit. Of several failures the one of the
//! lowest frame, and there of the lowest plan position, is told; the frames before it, and none after, are written.
//!
//! | who | does what |
//! |---|---|
//! | the thread that calls [`run`] | admits frames, writes them in order, calls the tap for once-values |
//! | workers | read frames, run nodes, encode parts |
//! | threads started by [`tiles`](depthloom_graphs::Host::tiles) | help a node with its tiles while permits are free: workers and helpers together never are more than [`Options::workers`] |

mod crew;
mod error;
mod host;
mod in_flight;
mod interrupt;
mod observer;
mod once;
mod options;
mod ordered;
mod panics;
mod queues;
mod report;
mod retire;
mod run;
mod stage;
mod timing;
mod wiring;

pub use error::RunError;
pub use interrupt::Interrupt;
pub use observer::{Observer, Unwatched};
pub use options::Options;
pub use report::{FrameFailure, Report, StageReport};
pub use run::run;
pub use timing::{Phase, Sample, Spread, Timing};
