//! Options of `runs` and its commands.

use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgGroup, Args, Subcommand};
use clap_complete::engine::ArgValueCompleter;

use depthloom_runs::{Condition, parse_note, parse_tag};
use depthloom_terminal::{parse_age, parse_size};

use super::RunsFolder;
use crate::completion::runs;

#[derive(Debug, Args)]
#[command(disable_help_subcommand = true)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs" => "all runs in the folder `runs`",
    "report @latest" => "the newest finished run, in any command that takes a run; `first/@latest`: of those in runs/first",
    "table first/one" => "a run by its name, or by a unique prefix of it",
    "runs diff first/one @latest" => "which nodes changed, and why",
    "runs prune --keep 3 --dry-run" => "what would be removed if three runs of each experiment stayed",
    "runs --runs archive --json | jq -r '.runs[] | select(.state != \"complete\").path'" => "for programs",
])]
pub(crate) struct RunsArgs {
    /// Run this command (default: list).
    #[command(subcommand)]
    pub command: Option<RunsCommand>,

    #[command(flatten)]
    pub filter: ListFilter,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Print one JSON object instead of text.
    #[arg(long, global = true)]
    pub json: bool,
}

/// The commands of `runs`.
#[derive(Debug, Subcommand)]
pub(crate) enum RunsCommand {
    /// List runs, newest first.
    ///
    /// It is what `runs` does without a command.
    List(ListArgs),
    /// Show the details of a run.
    ///
    /// It prints the experiment, the state, when and how the run was made, and its files.
    Show(ShowArgs),
    /// Add, remove or print tags of a run.
    ///
    /// Tags are stored in the run's folder. `runs list --where tag=NAME` selects by tag, and `prune` keeps runs that
    /// have one.
    Tag(TagArgs),
    /// Write, remove or print a note on a run.
    ///
    /// The note is stored in the run's folder. `runs show` prints it, and `prune` keeps runs that have one.
    Note(NoteArgs),
    /// Show why two runs differ.
    ///
    /// It prints the changed values of the experiment, and the nodes that changed because of a parameter, version,
    /// input or file.
    Diff(DiffArgs),
    /// Show where a run spent its time.
    ///
    /// It prints core-milliseconds per frame by node, and of encoding, compression and writing.
    Timings(TimingsArgs),
    /// Make an unfinished recording readable for others.
    ///
    /// It writes a finished recording with the complete frames, for readers that need one. `depthloom run` does not
    /// need it to resume a run.
    Recover(RecoverArgs),
    /// Remove finished or interrupted runs.
    ///
    /// It does not ask for confirmation. It removes all of the runs, or none if one of them may not be removed.
    Rm(RmArgs),
    /// Remove runs by age, size or number.
    ///
    /// It keeps runs that are in progress, folders with files of others, runs with a tag or a note, and runs that the
    /// experiment of a kept run names.
    Prune(PruneArgs),
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs list" => "the runs in the folder `runs`",
    "runs list --runs archive" => "the runs in another folder",
    "runs list --where compare.stereo.with.block=5 --where state=complete" => "complete runs in which a variant has this parameter",
    "runs list --where tag=paper --names" => "names alone, for `depthloom table $(...)`",
])]
pub(crate) struct ListArgs {
    #[command(flatten)]
    pub filter: ListFilter,
}

/// Which runs are listed, and how.
#[derive(Clone, Debug, Default, Args, PartialEq)]
pub(crate) struct ListFilter {
    /// List only runs that fulfil this condition, e.g. `compare.stereo.with.block=5`.
    ///
    /// The operators are = != < <= > >=. On the left is the path of a parameter with its defaults filled in
    /// (`STAGE.NODE.with.NAME`, `sources.NAME.with.NAME`), of a `kind` (`STAGE.NODE.kind`), or one of `best`,
    /// `experiment`, `frames`, `state`, `tag` and `variants`. A run with several variants is listed if one of them
    /// fulfils it. Repeat the option for more conditions: a run must fulfil all, each in any of its variants. A file
    /// is compared by its content; of another path, the last name is compared. States: complete, unfinished, running,
    /// damaged, unreadable.
    #[arg(long = "where", value_name = "CONDITION")]
    pub conditions: Vec<Condition>,

    /// Print only names, one per line.
    #[arg(long, conflicts_with = "json")]
    pub names: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs tag @latest paper" => "add a tag",
    "runs tag @latest" => "print the tags",
])]
pub(crate) struct TagArgs {
    /// Tag this run: its folder, a unique prefix of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Add these tags (default: print the tags).
    ///
    /// A tag has 1 to 64 letters, digits and `-_.:/+`.
    #[arg(value_name = "TAG", value_parser = parse_tag)]
    pub tags: Vec<String>,

    /// Remove the tags instead.
    #[arg(long, requires = "tags")]
    pub remove: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs note @latest 'block 9 was a mistake'" => "write a note",
    "runs note @latest" => "print it",
])]
pub(crate) struct NoteArgs {
    /// Write on this run: its folder, a unique prefix of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Write this text in place of the earlier note (default: print the note).
    #[arg(value_name = "TEXT", value_parser = parse_note)]
    pub text: Option<String>,

    /// Remove the note.
    #[arg(long, conflicts_with = "text")]
    pub remove: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs rm look.partial" => "the files of an interrupted run",
    "runs rm first/one first/two" => "several",
])]
pub(crate) struct RmArgs {
    /// Remove these runs: folders, full names, or `@latest`.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,
}

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("rules").required(true).multiple(true).args(["keep", "older_than", "max_size", "unfinished"]))]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs prune --keep 3 --dry-run" => "show what would be removed if the newest three of each experiment stayed",
    "runs prune --older-than 30d --keep 1" => "remove runs older than 30 days, but keep the last of each experiment",
    "runs prune --max-size 100GB --unfinished" => "remove the unfinished runs, then the oldest until the rest fits",
])]
pub(crate) struct PruneArgs {
    /// Keep the newest N finished runs of each experiment.
    ///
    /// It takes precedence over the other rules. Alone, it removes all other finished runs.
    #[arg(long, value_name = "N")]
    pub keep: Option<usize>,

    /// Remove runs that are older, e.g. `30d` (units: min, h, d, w).
    #[arg(long, value_name = "AGE", value_parser = parse_age)]
    pub older_than: Option<Duration>,

    /// Remove the oldest runs until the rest fits, e.g. `50GB`.
    ///
    /// The units are kB, MB, GB and TB.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub max_size: Option<u64>,

    /// Also remove incomplete runs; they can no longer be resumed.
    #[arg(long)]
    pub unfinished: bool,

    /// Consider only runs of this experiment (default: all).
    #[arg(long, value_name = "NAME")]
    pub experiment: Option<String>,

    /// Show what would be removed, and remove nothing.
    #[arg(long, short = 'n')]
    pub dry_run: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs show @latest" => "the newest finished run",
    "runs show look.partial --json | jq .stages" => "for programs",
])]
pub(crate) struct ShowArgs {
    /// Show this run: its folder, a unique prefix of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs diff first/one @latest" => "what changed since that run, and why",
    "runs diff first/one first/two --json | jq -r '.nodes[] | select(.same | not) | .node'" => "for programs: the nodes whose values differ",
])]
pub(crate) struct DiffArgs {
    /// Compare with this earlier run.
    ///
    /// Name its folder, its recording, a unique prefix of its name, or `@latest`.
    #[arg(value_name = "BEFORE", add = ArgValueCompleter::new(runs))]
    pub before: PathBuf,

    /// Compare this later run.
    #[arg(value_name = "AFTER", add = ArgValueCompleter::new(runs))]
    pub after: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/manage-runs.md",
    "runs timings @latest" => "which nodes take how long",
    "runs timings @latest --json | jq '.timings[].cpu_ns'" => "for programs",
])]
pub(crate) struct TimingsArgs {
    /// Show the timings of this run.
    ///
    /// Name its folder, a unique prefix of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/resume.md",
    "runs recover look.partial" => "write look.recovered.mcap into the current folder",
    "runs recover look.partial --out look.mcap" => "write another file",
])]
pub(crate) struct RecoverArgs {
    /// Read this run or recording.
    ///
    /// Name its folder (`<run>.partial`), its recording, a unique prefix of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Write this file (default: `<name>.recovered.mcap` in this folder).
    ///
    /// The default is in the current folder. A file that exists is not replaced.
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
}
