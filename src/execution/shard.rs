//! A shard of a run: its values are recorded for a last run, which reuses them, scores and reports.

use std::path::{Path, PathBuf};

use depthloom_analysis::plan_key;
use depthloom_graphs::counted;
use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_jobs::{Shard, ShardFolder, damage};
use depthloom_recording::RecordedPlan;
use depthloom_runner::{Interrupt, Observer, Share, StageShare};
use depthloom_runs::environment::{self, ENVIRONMENT};
use depthloom_runs::run_folder::CHECKPOINTS;
use depthloom_runs::{GitState, reuse};
use depthloom_terminal::{CliError, ExitCode, print_path, say};

use super::folder::{FolderRequest, Reusable, make_folder};
use super::{Recorded, Target, is_silent, options, print_warnings, record};
use crate::args::{RunArgs, is_fresh_everywhere};

/// The folder of the shards of a plan, in the folder of runs.
///
/// # Errors
/// If the plan cannot be recorded.
pub(crate) fn shard_folder(runs: &Path, plan: &Plan) -> Result<ShardFolder, CliError> {
    let recorded = RecordedPlan::read_back(plan).map_err(|what| CliError::new(ExitCode::Engine, what))?;
    Ok(ShardFolder::new(runs, &plan.experiment, &plan_key(&recorded)))
}

/// Refuses shards where nothing is reused.
///
/// # Errors
/// If DEPTHLOOM_FRESH is set.
pub(crate) fn needs_reuse() -> Result<(), CliError> {
    if !is_fresh_everywhere() {
        return Ok(());
    }
    let what = "DEPTHLOOM_FRESH is set: the last run would compute all values again instead of reusing the shards";
    Err(CliError::usage(what, "remove DEPTHLOOM_FRESH from the environment"))
}

/// Computes a shard and writes it to `out`. A shard that is complete is left as it is. Returns what it computed.
pub(crate) fn compute(
    args: &RunArgs,
    loaded: Loaded,
    ready: Ready,
    interrupt: &Interrupt,
    shard: &Shard,
    (folder, out): (&ShardFolder, &Path),
    watch: &dyn Observer,
) -> Result<Computed, CliError> {
    let Loaded { stored, read, .. } = loaded;
    let plan = ready.plan.clone();
    if out.exists() {
        let Some(damage) = damage(out, true) else {
            if !is_silent(args) {
                say(format_args!("{} is complete in {}", shard.text(), out.display()));
            }
            return Ok(Computed { failed: 0, out: out.to_owned() });
        };
        print_warnings(args, &[format!("recomputing {}: {damage}", out.display())]);
    }
    let runs = args.folder.path();
    let request = FolderRequest {
        out: Some(out),
        overwrite: args.overwrite || out.exists(),
        is_fresh: false,
        is_json: args.output.json,
        runs: &runs,
    };
    let written = plan.written.iter().map(|(_, text)| text.as_str());
    let git = GitState::of_files(read.iter().map(PathBuf::as_path).zip(written));
    let (run_folder, resumable) = make_folder(&request, &plan, &stored, &read)?;
    // The others of a split have other frames: with thousands, looking into each would cost more than the shard.
    let skips = |other: &Path| other.file_name() != out.file_name() && shard.shares_no_frame(other);
    let earlier = reuse::earlier_runs(false, &run_folder, &runs, &plan, &skips);
    let counts: Vec<usize> = ready.runs.iter().map(|run| run.source.frames().len()).collect();
    let share = shard.share(&plan, &counts, earlier.aggregates_in(folder.path()));
    let resumable = Reusable { resumable, earlier }.verified(args, &run_folder, &ready, Some(&share), false)?;
    let text = describe(shard, &share, &plan);
    if !is_silent(args) {
        say(text);
    }
    let mut options = options(args, &run_folder);
    options.share = Some(share);
    // Checkpoints are where the next process finds them, on whichever machine it runs.
    options.checkpoints = Some(folder.path().join(CHECKPOINTS));
    let partial = run_folder.partial.clone();
    let target = Target { folder: &run_folder, partial: &partial, remote: None, shard: Some(shard), watch };
    let recorded = record(ready, &plan, args, &options, target, resumable, interrupt, &|| false);
    let Recorded { failed, checkpoints, .. } = match recorded {
        Ok(recorded) => recorded,
        Err(ended) => return Err(ended.stop_shard(run_folder)),
    };
    let environment = environment::describe(options.workers, options.window, &read, git);
    run_folder.write(ENVIRONMENT, &environment.text())?;
    let out = run_folder.finish()?;
    checkpoints.remove();
    Ok(Computed { failed, out })
}

/// What came of a shard.
pub(crate) struct Computed {
    /// Frames that failed.
    pub(crate) failed: u64,
    pub(crate) out: PathBuf,
}

impl Computed {
    /// Prints where the shard is. Returns the exit code.
    pub(crate) fn print(&self) -> Result<ExitCode, CliError> {
        print_path("shard: ", &self.out)?;
        if self.failed == 0 {
            return Ok(ExitCode::Success);
        }
        let what = format!("{} failed; values that depend on them are left out", counted(self.failed, "frame"));
        Err(CliError::new(ExitCode::FrameFailures, what))
    }
}

/// `shard 1/4 of the frames: 12 frames of learn, 4 frames of compare`.
fn describe(shard: &Shard, share: &Share, plan: &Plan) -> String {
    let stages = RunId::enumerate(&share.runs).filter(|(_, stage)| !stage.frames.is_empty());
    let frames = |(run, stage): (RunId, &StageShare)| {
        format!("{} of {}", counted(stage.frames.len() as u64, "frame"), plan.runs[run].stage)
    };
    let frames: Vec<String> = stages.map(frames).collect();
    format!("{}: {}", shard.text(), if frames.is_empty() { "no frames".to_owned() } else { frames.join(", ") })
}
