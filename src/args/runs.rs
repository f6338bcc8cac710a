//! The folder of runs.

use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgGroup, Args, Subcommand};
use clap_complete::engine::ArgValueCompleter;

use depthloom_terminal::{parse_age, parse_size};

use crate::completion::{folders, runs};

#[derive(Debug, Args)]
#[command(disable_help_subcommand = true)]
#[command(after_help = examples![
    "runs" => "all runs below `runs`",
    "report @latest" => "the newest that is over, wherever a run is wanted; `table1/@latest`: of those in runs/table1",
    "table table1/2026-11-21" => "or the beginning of its name, if no other's begins so",
    "runs why table1/2026-11-20 @latest" => "which node is another since, and why",
    "runs prune --keep 3 --dry-run" => "what would go if three of each experiment stayed",
    "runs --in /data/runs --json | jq -r '.runs[] | select(.state != \"whole\").path'" => "for programs",
])]
pub(crate) struct RunsArgs {
    /// What to do; without one, list them.
    #[command(subcommand)]
    pub command: Option<RunsCommand>,

    /// The folder of runs.
    #[arg(long = "in", global = true, value_name = "DIR", default_value = depthloom_runs::FOLDER, add = ArgValueCompleter::new(folders()))]
    pub folder: PathBuf,

    /// Print one JSON object instead of text.
    #[arg(long, global = true)]
    pub json: bool,
}

/// What to do with runs.
#[derive(Debug, Subcommand)]
pub(crate) enum RunsCommand {
    /// List the runs in a folder, newest first; what `runs` does without a command.
    #[command(after_help = examples![
        "runs list --in /data/runs" => "the runs below another folder",
    ])]
    List,
    /// Show a run: what it is of, what became of it, how it was made, and its files.
    Show(ShowArgs),
    /// Say why two runs differ: what was set otherwise, and by parameter, version, input or file which nodes are
    /// others.
    Why(WhyArgs),
    /// Remove runs that are over. Asks nothing: of several all are removed, or none if one may not be.
    Rm(RmArgs),
    /// Remove runs by age, size or number. A run that goes on, holds anything else, or is named by the experiment of
    /// one that stays, is kept.
    Prune(PruneArgs),
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "runs rm look.partial" => "the files of an interrupted run",
    "runs rm table1/2026-11-20 table1/2026-11-21" => "several",
])]
pub(crate) struct RmArgs {
    /// The runs: folders, names in full, or `@latest`.
    #[arg(required = true, add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,
}

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("rules").required(true).multiple(true).args(["keep", "older_than", "max_size", "unfinished"]))]
#[command(after_help = examples![
    "runs prune --keep 3 --dry-run" => "all but the newest three of each experiment: what would go",
    "runs prune --older-than 30d --keep 1" => "what is older than 30 days, but never an experiment's last",
    "runs prune --max-size 100GB --unfinished" => "the unfinished, then the oldest until the rest fits",
])]
pub(crate) struct PruneArgs {
    /// Keep the newest N whole runs of each experiment, whatever else is said; alone, remove all other whole runs.
    #[arg(long, value_name = "N")]
    pub keep: Option<usize>,

    /// Remove runs that are older: `30d`; `min`, `h`, `d` and `w` are known.
    #[arg(long, value_name = "AGE", value_parser = parse_age)]
    pub older_than: Option<Duration>,

    /// Remove the oldest runs until all that stay take no more room: `50GB`; `kB`, `MB`, `GB` and `TB` are known.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub max_size: Option<u64>,

    /// Remove runs that ended before they were whole, too; nothing can go on from them then.
    #[arg(long)]
    pub unfinished: bool,

    /// Look at the runs of this experiment alone.
    #[arg(long, value_name = "NAME")]
    pub experiment: Option<String>,

    /// Say what would be removed, and remove nothing.
    #[arg(long, short = 'n')]
    pub dry_run: bool,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "runs show @latest" => "the newest that is over",
    "runs show look.partial --json | jq .stages" => "for programs",
])]
pub(crate) struct ShowArgs {
    /// A run: its folder, the beginning of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "runs why table1/2026-11-20 table1/@latest" => "what is another since that day, and why",
    "runs why A B --json | jq -r '.nodes[] | select(.same | not) | .node'" => "for programs: the nodes whose values differ",
])]
pub(crate) struct WhyArgs {
    /// The earlier run: its folder, its recording, the beginning of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub before: PathBuf,

    /// The later run.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub after: PathBuf,
}
