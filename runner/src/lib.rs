//! Executes a plan: admission, workers, sink.
//!
//! A stage run is a frame-synchronous dataflow: a node runs on frame k when its inputs for k are there, whatever other
//! frames do. Atomic counters count what a step waits for. Ready steps are in crossbeam queues, one per frame in
//! flight, and workers take the oldest frame first. The only back-pressure is admission: frame k is admitted when k <
//! oldest unwritten frame + window. No task waits for another, so there is no deadlock. A value is dropped after its
//! last use.
//!
//! Results do not depend on the number of workers, nor on the window, to the bit. Of several failures, the one of the
//! lowest frame, and there of the lowest plan position, is reported; exactly the frames before it are written.
//!
//! | thread | task |
//! |---|---|
//! | the caller of [`run`](fn@run) | admits frames, writes them in order, writes aggregate values |
//! | workers | read frames, run nodes, encode parts |
//! | threads started by [`tiles`](depthloom_graphs::Host::tiles) | help a node with its tiles while permits are free: with the workers, at most [`Options::workers`](field@Options::workers) |
//!
//! A sink that prints, and a run without nodes:
//!
//! ```
//! use depthloom_graphs::contracts::{Commit, Slot, Sink, ErrorMessage, NodeWarning};
//! use depthloom_graphs::plan::{FrameIndex, PartId, Plan, PlannedSource, Record, RunId, StageRun, VariantId};
//! use depthloom_graphs::ready::{Ready, ReadyRun};
//! use depthloom_graphs::{Context, Fault, Frame, Key, Outputs, Source, SourceOutputs, Value};
//! use depthloom_runner::{Interrupt, Options, Unwatched, run};
//!
//! struct Empty(Vec<Frame>);
//!
//! impl Source for Empty {
//!     fn frames(&self) -> &[Frame] {
//!         &self.0
//!     }
//!     fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
//!         Ok(Key::of_content(&position.0.to_le_bytes()))
//!     }
//!     fn read(&self, position: FrameIndex, _: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
//!         Ok(SourceOutputs { outputs: Outputs::none(), key: self.key(position)? })
//!     }
//! }
//!
//! struct Printer;
//!
//! impl Sink for Printer {
//!     type Part = ();
//!     fn parts(&self, _run: RunId) -> usize {
//!         0
//!     }
//!     fn part(&self, _run: RunId, _slot: Slot) -> Option<PartId> {
//!         None
//!     }
//!     fn encode(
//!         &self,
//!         _: RunId,
//!         _: (FrameIndex, &Frame),
//!         _: PartId,
//!         _: &[(Slot, Value)],
//!     ) -> Result<(), ErrorMessage> {
//!         Ok(())
//!     }
//!     fn write(&self, commit: &Commit<'_>, _parts: Vec<()>) -> Result<(), ErrorMessage> {
//!         println!("frame {}", commit.frame.id);
//!         Ok(())
//!     }
//!     fn once(&self, _: RunId, _: Slot, _: &Key, _: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
//!         Ok(())
//!     }
//! }
//!
//! let stage = StageRun {
//!     stage: "compare".to_owned(),
//!     prefix: "/compare".to_owned(),
//!     source: PlannedSource { name: "test".to_owned(), parts: vec![], outputs: vec![] },
//!     nodes: vec![],
//!     estimates: vec![],
//!     variants: vec![VariantId(0)],
//! };
//! let plan = Plan {
//!     experiment: "empty".to_owned(),
//!     description: String::new(),
//!     variants: vec![String::new()],
//!     factors: vec![],
//!     labels: Default::default(),
//!     runs: vec![stage],
//!     record: Record { every: 1, view: false, points: Vec::new() },
//!     written: vec![],
//!     resolved: String::new(),
//! };
//! let frames = (0..3).map(|k| Frame::at_10_hz(format!("{k:06}_10"), k)).collect();
//! let runs = vec![ReadyRun { source: Box::new(Empty(frames)), nodes: vec![] }];
//! let ready = Ready { plan, runs, files: Default::default(), warnings: vec![], builders: Default::default() };
//!
//! let report = run(ready, &Printer, &Options::default(), &Unwatched, &Interrupt::default())?;
//! assert_eq!(report.stages[0].retired, 3);
//! # Ok::<(), depthloom_runner::RunError>(())
//! ```

mod aggregate;
mod aggregate_values;
mod audit;
mod checkpoints;
mod error;
mod host;
mod interrupt;
mod live;
mod observer;
mod options;
mod panics;
mod report;
mod reuse;
mod run;
mod run_context;
mod share;
mod stage;
mod timing;
mod warnings;

pub use audit::failure::{AuditFailure, Cause};
pub use checkpoints::Checkpoints;
pub use error::RunError;
pub use interrupt::Interrupt;
pub use live::{Latency, Live, LiveOptions, LiveReport, LiveStatus, Pace, Paced, Playback, StepLatency};
pub use observer::{Observer, Unwatched};
pub use options::{Audit, Options};
pub use report::{FrameFailure, Report, StageReport};
pub use reuse::foresee::{Foreseen, foresee};
pub use reuse::recorded::{RecordedValues, outdated};
pub use run::{run, run_live};
pub use share::{Share, StageShare};
pub use timing::{Phase, Sample, Spread, Timing};
pub use warnings::Warning;
