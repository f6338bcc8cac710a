//! What a run takes from earlier ones: those beside it, and those under `runs/`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use depthloom_graphs::plan::Plan;
use depthloom_recording::{EarlierRuns, Recording, RecordingError};
use depthloom_runner::Report;
use serde_json::{Value as Json, json};

use crate::args::RunArgs;
use crate::commands::report::RECORDING;
use crate::counted::counted;
use crate::exit::chain;
use crate::run_folder::RunFolder;
use crate::runs;

/// The recordings that a run may take from, the newest first: of the same run as far as an earlier process came, of the runs in the same
/// folder, and of those under `runs/`. None with `--fresh`.
pub fn of(args: &RunArgs, folder: &RunFolder, plan: &Plan, begun: Option<&Recording>) -> Arc<EarlierRuns> {
    let mut recordings = Vec::new();
    if !args.is_fresh() {
        recordings.extend(begun.map(|begun| begun.path().to_owned()));
        let own = folder.file(RECORDING);
        let found = found(folder.out.parent());
        recordings.extend(found.into_iter().filter(|path| *path != own));
    }
    Arc::new(EarlierRuns::new(recordings, plan))
}

/// The recordings of the runs in a folder, if one is given, and of those that `depthloom runs` lists.
fn found(beside: Option<&Path>) -> Vec<PathBuf> {
    let folder = |beside: &Path| if beside.as_os_str().is_empty() { PathBuf::from(".") } else { beside.to_owned() };
    let beside = beside.into_iter().flat_map(|beside| runs::in_folder(&folder(beside)));
    let found = beside.chain(runs::all(Path::new(runs::FOLDER)).unwrap_or_default());
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

/// The recordings that a run beside `out` may take from.
pub fn beside(out: Option<&Path>, plan: &Plan) -> EarlierRuns {
    EarlierRuns::new(found(out.and_then(Path::parent)), plan)
}

/// How many frames a recording holds, over all stage runs.
pub fn frames(recording: &Recording) -> u64 {
    (0..recording.plan().runs.len()).map(|run| recording.frames(run).len() as u64).sum()
}

/// The earlier runs that cannot be read, of which nothing is taken.
pub fn unreadable(earlier: &EarlierRuns) -> Vec<String> {
    let told = |(path, error): &(PathBuf, RecordingError)| {
        format!("nothing is taken from {}: {}", path.parent().unwrap_or(path).display(), chain(error))
    };
    earlier.unreadable().iter().map(told).collect()
}

/// What was damaged and made afresh.
pub fn warnings(earlier: &EarlierRuns) -> Vec<String> {
    let damage = earlier.damage().into_iter();
    damage.map(|(path, what)| format!("made afresh what {} should have had: {what}", path.display())).collect()
}

/// What a run took from earlier ones.
pub struct Reused {
    /// By stage run and node: how often it was taken, of how many times.
    nodes: Vec<(String, String, u64, u64)>,
    from: Vec<PathBuf>,
}

/// What a run took from earlier ones.
pub fn told(report: &Report, plan: &Plan, earlier: &EarlierRuns) -> Reused {
    let mut nodes = Vec::new();
    for (run, stage) in plan.runs.iter().zip(&report.stages) {
        for (node, (reused, fired)) in run.nodes.iter().zip(stage.reused.iter().zip(&stage.firings)) {
            nodes.push((run.stage.clone(), node.name.clone(), *reused, reused + fired));
        }
    }
    Reused { nodes, from: earlier.taken().map(Path::to_owned).collect() }
}

impl Reused {
    /// A line, if anything was taken.
    pub fn text(&self) -> Option<String> {
        let (whole, part): (Vec<_>, Vec<_>) =
            self.nodes.iter().filter(|(.., reused, _)| *reused > 0).partition(|(.., reused, all)| reused == all);
        if whole.is_empty() && part.is_empty() {
            return None;
        }
        let all = self.nodes.len() as u64;
        let mut text = format!("taken from earlier runs: {} of {all} nodes", whole.len());
        if !part.is_empty() {
            text.push_str(&format!(", and part of the frames of {}", counted(part.len() as u64, "node")));
        }
        let from: Vec<String> =
            self.from.iter().map(|path| path.parent().unwrap_or(path).display().to_string()).collect();
        if !from.is_empty() {
            text.push_str(&format!(" (from {}; --fresh makes all anew)", from.join(", ")));
        }
        Some(text)
    }

    /// The same for programs.
    pub fn json(&self) -> Json {
        let nodes = self.nodes.iter().filter(|(.., reused, _)| *reused > 0);
        let node = |(stage, node, reused, all): &(String, String, u64, u64)| json!({ "stage": stage, "node": node, "reused": reused, "of": all });
        json!({ "nodes": nodes.map(node).collect::<Vec<_>>(), "from": self.from })
    }
}
