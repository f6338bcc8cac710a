//! What a run reuses of earlier runs: those in the same folder, and those in `runs/`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use depthloom_graphs::contracts::{InlineHost, SlotKey};
use depthloom_graphs::plan::{FrameIndex, NodeId, Plan, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_graphs::{Frame, Key, chain, counted};
use depthloom_recording::{EarlierRuns, Recording, RecordingError};
use depthloom_runner::{Audit, RecordedValues, Report, Share};
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::Serialize;

use crate::files::{RECORDING, outdated_files};
use crate::found::{all, in_folder, shards};
use crate::run_folder::RunFolder;

/// The recordings that a run may reuse, newest first: those of its own folder, of the runs beside it, and in the folder
/// of runs; without those whose folder `skips` names, because they have nothing to reuse. Empty with `--fresh`.
pub fn earlier_runs(
    is_fresh: bool,
    folder: &RunFolder,
    runs: &Path,
    plan: &Plan,
    skips: &dyn Fn(&Path) -> bool,
) -> EarlierRuns {
    let mut recordings = Vec::new();
    if !is_fresh {
        let mut own = vec![folder.file(RECORDING)];
        own.extend(outdated_files(&folder.partial).into_iter().rev());
        let found =
            found(folder.out.parent(), runs, skips).into_iter().filter(|path| !own.contains(path)).collect::<Vec<_>>();
        recordings.extend(own.into_iter().filter(|path| path.exists()));
        recordings.extend(found);
    }
    EarlierRuns::new(recordings, plan)
}

/// The recording of an interrupted run, for comparison with what the same run would record today.
struct RecordedKeys<'a>(&'a Recording);

impl RecordedValues for RecordedKeys<'_> {
    fn frames(&self, run: RunId) -> usize {
        self.0.frames(run).len()
    }

    fn is_frame(&self, run: RunId, position: FrameIndex, frame: &Frame) -> bool {
        self.0.is_frame(run, position, frame)
    }

    fn source_key(&self, run: RunId, position: FrameIndex) -> Option<Key> {
        self.0.frames(run)[position].source_key
    }

    fn has_failed(&self, run: RunId, position: FrameIndex) -> bool {
        !self.0.frames(run)[position].failures.is_empty()
    }

    fn node_keys(&self, run: RunId, position: FrameIndex) -> &[SlotKey] {
        &self.0.frames(run)[position].keys
    }

    fn aggregates(&self, run: RunId) -> Vec<(NodeId, Key)> {
        let values = self.0.aggregate_values().iter().filter(|value| value.run == run);
        values.map(|value| (value.node, value.key)).collect()
    }
}

/// Why the recording of an interrupted run is damaged, or differs from what this run would record; `None` if the run
/// can resume it.
///
/// # Errors
/// If it cannot be read, or today's keys cannot be computed.
pub fn outdated(
    ready: &Ready,
    earlier: &EarlierRuns,
    recording: &Recording,
    share: Option<&Share>,
) -> Result<Option<String>, CliError> {
    if let Err(error) = recording.check_committed() {
        let failed = |error| CliError::remedied(ExitCode::Engine, "failed to read the recording", error);
        return if error.is_damage() { Ok(Some(error.to_string())) } else { Err(failed(&error)) };
    }
    if !recording.has_plan(&ready.plan) {
        return Ok(Some("an engine or a program that it used changed".to_owned()));
    }
    let outdated = depthloom_runner::outdated(ready, earlier, &RecordedKeys(recording), &InlineHost, share);
    outdated.map_err(|error| CliError::new(ExitCode::Engine, format!("failed to compare cache keys: {error}")))
}

/// The recordings of the runs beside `out`, of those that `depthloom runs` lists, and of shards.
fn found(out: Option<&Path>, runs: &Path, skips: &dyn Fn(&Path) -> bool) -> Vec<PathBuf> {
    let folder = |beside: &Path| if beside.as_os_str().is_empty() { PathBuf::from(".") } else { beside.to_owned() };
    let siblings = out.into_iter().flat_map(|out| in_folder(&folder(out), skips));
    let found = siblings.chain(all(runs).unwrap_or_default()).chain(shards(runs, skips));
    let (mut seen, mut recordings) = (BTreeSet::new(), Vec::new());
    for path in found.map(|run| run.path.join(RECORDING)) {
        let Ok(metadata) = std::fs::metadata(&path) else { continue };
        let Ok(real) = std::fs::canonicalize(&path) else { continue };
        if seen.insert(real) {
            recordings.push((metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH), path));
        }
    }
    recordings.sort();
    recordings.into_iter().rev().map(|(_, path)| path).collect()
}

/// The recordings that a run at `out` may reuse.
pub fn beside(out: Option<&Path>, runs: &Path, plan: &Plan) -> EarlierRuns {
    EarlierRuns::new(found(out.and_then(Path::parent), runs, &|_| false), plan)
}

/// The number of frames in a recording, over all stage runs.
pub fn frames(recording: &Recording) -> u64 {
    RunId::all(recording.plan().runs.len()).map(|run| recording.frames(run).len() as u64).sum()
}

/// The folders of the runs whose values were reused: this run's report can reuse parts of theirs. Empty if everything
/// that is reused is computed again.
pub fn reports(earlier: &EarlierRuns, audit: Audit) -> Vec<PathBuf> {
    match audit {
        Audit::All => Vec::new(),
        Audit::Sample | Audit::None => earlier.reused().filter_map(|path| path.parent().map(Path::to_owned)).collect(),
    }
}

/// The earlier runs that cannot be read, so that nothing of them is reused.
pub fn unreadable(earlier: &EarlierRuns) -> Vec<String> {
    let message = |(path, error): &(PathBuf, RecordingError)| {
        format!("cannot reuse values of {}: {}", path.parent().unwrap_or(path).display(), chain(error))
    };
    earlier.unreadable().iter().map(message).collect()
}

/// The damaged values that were recomputed.
pub fn warnings(earlier: &EarlierRuns) -> Vec<String> {
    let damage = earlier.damage().into_iter();
    damage.map(|(path, what)| format!("recomputed damaged values of {}: {what}", path.display())).collect()
}

/// What was reused from earlier runs.
#[derive(JsonSchema, Serialize)]
pub struct Reused {
    nodes: Vec<ReusedNode>,
    /// The recordings with the reused values.
    from: Vec<String>,
    /// The number of reused values that the audit recomputed and found equal.
    audited: u64,
}

/// How often a node's values were reused.
#[derive(JsonSchema, Serialize)]
pub struct ReusedNode {
    stage: String,
    node: String,
    reused: u64,
    of: u64,
}

/// How many earlier runs a line names.
const NAMED: usize = 5;

/// What a run reused of earlier runs, for all its nodes.
pub struct ReuseCounts {
    /// By stage run and node: how often its values were reused, of how many times.
    nodes: Vec<(String, String, u64, u64)>,
    from: Vec<PathBuf>,
    /// The number of reused values that were recomputed and found equal.
    audited: u64,
}

/// What a run reused of earlier runs.
pub fn reuse_counts(report: &Report, plan: &Plan, earlier: &EarlierRuns) -> ReuseCounts {
    let mut nodes = Vec::new();
    for (run, stage) in plan.runs.iter().zip(&report.stages) {
        for (node, (reused, fired)) in run.nodes.iter().zip(stage.reused.iter().zip(&stage.firings)) {
            nodes.push((run.stage.clone(), node.name.clone(), *reused, reused + fired));
        }
    }
    let audited = report.stages.iter().map(|stage| stage.audited).sum();
    ReuseCounts { nodes, from: earlier.reused().map(Path::to_owned).collect(), audited }
}

impl ReuseCounts {
    /// A line, if anything was reused.
    pub fn text(&self) -> Option<String> {
        let (whole, part): (Vec<_>, Vec<_>) =
            self.nodes.iter().filter(|(.., reused, _)| *reused > 0).partition(|(.., reused, all)| reused == all);
        if whole.is_empty() && part.is_empty() {
            return None;
        }
        let all = self.nodes.len() as u64;
        let mut text = format!("reused from earlier runs: {} of {all} nodes", whole.len());
        if !part.is_empty() {
            text.push_str(&format!(", and some frames of {}", counted(part.len(), "node")));
        }
        let from = self.from.iter().map(|path| path.parent().unwrap_or(path).display().to_string());
        // A run that was divided has hundreds.
        let mut named: Vec<String> = from.take(NAMED).collect();
        if self.from.len() > named.len() {
            named.push(format!("{} more", self.from.len() - named.len()));
        }
        if !named.is_empty() {
            text.push_str(&format!(" (from {}; --fresh recomputes all)", named.join(", ")));
        }
        Some(text)
    }

    /// The same for JSON.
    pub fn output(&self) -> Reused {
        let nodes = self.nodes.iter().filter(|(.., reused, _)| *reused > 0);
        let node = |(stage, node, reused, all): &(String, String, u64, u64)| ReusedNode {
            stage: stage.clone(),
            node: node.clone(),
            reused: *reused,
            of: *all,
        };
        // A path may contain bytes that are not UTF-8.
        let from = self.from.iter().map(|path| path.to_string_lossy().into_owned()).collect();
        Reused { nodes: nodes.map(node).collect(), from, audited: self.audited }
    }
}
