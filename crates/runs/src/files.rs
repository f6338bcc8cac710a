//! The names of files and folders of runs.

/// The folder of runs without an `--out`.
pub const FOLDER: &str = "runs";
/// The recording in a run's folder.
pub const RECORDING: &str = "recording.mcap";
/// The timings of a run.
pub const TIMINGS: &str = "timings.parquet";
/// In the folder of an unfinished run: what an interrupted process recorded of data, programs or engines that changed
/// since. Its values are still reused by their cache keys.
pub const OUTDATED: &str = "recording.outdated.mcap";
/// The file that marks a run's folder.
pub const MARKER: &str = "depthloom-run.json";
/// The folder of trained models in a run's folder.
pub const MODELS: &str = "models";
