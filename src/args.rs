//! The command line's grammar: one definition of every option yields its help, its completion and its manual page.
//!
//! The first paragraph of a doc comment is what `-h` prints; `--help` prints all of it.

/// The end of a long help text: examples (arguments, and what they do), then the page of the guide.
macro_rules! examples {
    (guide: $guide:literal, $($arguments:literal => $about:literal),+ $(,)?) => {
        concat!(
            "Examples:\n", $("  depthloom ", $arguments, "\n          ", $about, "\n",)+
            "\nGuide: ", env!("CARGO_PKG_REPOSITORY"), "/blob/main/docs/", $guide,
        )
    };
}

mod analyse;
mod compare;
mod dora;
mod evaluate;
mod experiment;
mod export;
mod figure;
mod inspect;
mod jobs;
mod live;
mod recording;
mod run;
mod runs;
mod table;

use std::ops::Deref;
use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_terminal::CliError;

pub(crate) use analyse::AnalyseArgs;
pub(crate) use compare::{CompareArgs, CompareBy};
pub(crate) use dora::{DoraArgs, DoraNodeArgs};
pub(crate) use evaluate::{
    AlignOption, EvaluateArgs, ForEstimate, MatchOption, ProtocolOption, QuantityOption, ResizeOption, UnitOption,
};
pub(crate) use experiment::{CheckArgs, ExecArgs, ExperimentArgs, GraphArgs, GraphFormat, PlanArgs};
pub(crate) use export::{ColoursOption, ExportArgs};
pub(crate) use figure::{FigureArgs, FigureFormat};
pub(crate) use inspect::InspectArgs;
pub(crate) use jobs::{JobsArgs, JobsCommand, RetryArgs, SchedulerOption, StartArgs, SubmitArgs};
pub(crate) use live::{Cores, LimitArgs, LiveArgs, TriggerSignal};
pub(crate) use recording::VerifyArgs;
pub(crate) use run::{AuditMode, PageArgs, ReportArgs, RunArgs, SplitBy, is_fresh_everywhere};
pub(crate) use runs::{
    DiffArgs, ListFilter, NoteArgs, PruneArgs, RecoverArgs, RmArgs, RunsArgs, RunsCommand, ShowArgs, TagArgs,
    TimingsArgs,
};
pub(crate) use table::{ExplainArgs, PixelsOption, RowsOption, ScoresArgs, TableArgs, TableFormat, TypesettingArgs};

use crate::completion::{folders, runs};

/// Run reproducible depth-estimation experiments from one YAML file.
#[derive(Debug, Parser)]
#[command(name = "depthloom", version, propagate_version = true)]
#[command(after_long_help = examples![
    guide: "README.md",
    "new first.yaml" => "write a commented experiment that runs on any machine",
    "run first.yaml" => "run it: a recording, a table, plots, a report page",
    "nodes stereo/sgbm" => "explain a kind of node",
    "help run" => "explain a command",
])]
pub(crate) struct Cli {
    /// The command to run.
    #[command(subcommand)]
    pub command: Command,

    /// Colour messages.
    #[arg(long, global = true, value_enum, default_value_t = Colour::Auto, value_name = "WHEN")]
    pub color: Colour,
}

/// When messages are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Colour {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// The commands that `depthloom --help` lists, by workflow; a test compares them with the grammar.
pub(crate) const GROUPS: [(&str, &[&str]); 7] = [
    ("Author", &["new", "check", "plan", "graph", "nodes", "schema", "lsp"]),
    ("Data", &["inspect", "synth"]),
    ("Run", &["run", "live", "evaluate", "dora"]),
    ("Cluster", &["submit", "jobs"]),
    ("Results", &["report", "table", "compare", "explain", "analyse", "figure", "export"]),
    ("Runs and recordings", &["runs", "verify"]),
    ("Setup", &["doctor", "completions", "man"]),
];

/// The command to run.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Write a commented starter experiment.
    #[command(visible_alias = "init")]
    New(NewArgs),
    /// Check an experiment file for errors.
    ///
    /// It runs nothing and opens no data. With `--data` it also reads every frame.
    Check(CheckArgs),
    /// Show the nodes that would run.
    ///
    /// It lists every node, the variants that share it, and its hash. With `--reuse` it also shows what a run would
    /// reuse from earlier runs. With `--cost` it predicts CPU time, wall-clock time and bytes from an earlier run.
    Plan(PlanArgs),
    /// Draw the experiment's graph.
    Graph(GraphArgs),
    /// List or explain kinds of nodes and sources.
    Nodes(NodesArgs),
    /// Serve an editor with the language server protocol.
    ///
    /// It speaks over the standard streams: diagnostics, completion, hover, definitions and renaming in experiment
    /// files. It runs nothing and starts no program.
    Lsp(LspArgs),
    /// Print JSON Schemas for editors and programs.
    ///
    /// It prints the schema of experiment files, or, with `--of`, of what a command prints with `--json`.
    Schema(SchemaArgs),
    /// Describe a data set, recording or ONNX file
    ///
    /// - A data-set folder or a bag: frames, sizes, calibration, ground truth, faults, and the `sources:` entry to
    ///   paste into an experiment.
    /// - A recording or run: topics, messages, sizes, keys, attachments, and whether it is complete.
    /// - An `.onnx` file: inputs, outputs, operators, cost, and the `nodes:` entry to paste into an experiment.
    #[command(verbatim_doc_comment)]
    Inspect(InspectArgs),
    /// Write a synthetic stereo data set.
    ///
    /// It renders frames of a street, with ground truth, in the layout of KITTI stereo 2015.
    Synth(SynthArgs),
    /// Run an experiment and report its metrics.
    ///
    /// It records every intermediate value, scores the estimates against ground truth, and prints the table.
    Run(RunArgs),
    /// Run one stage live, at the rate of its source.
    ///
    /// Frames come from a camera, or from a data set at a rate. If the nodes cannot keep up, the newest frame is
    /// processed and older ones are dropped and counted; the exit code is then 3. The command prints the latency of
    /// every node and records what was processed.
    Live(LiveArgs),
    /// Evaluate predictions of other programs.
    ///
    /// It reads depth or disparity maps from files, scores them against the ground truth of a data set, and writes a
    /// run like any other. No YAML is needed.
    Evaluate(EvaluateArgs),
    /// Submit an experiment as jobs of a cluster.
    ///
    /// It splits the run into job arrays of Slurm: shards of frames or variants, one job for each training, and a last
    /// run that reuses everything, scores and reports. Its recording has the bytes that one machine would have written.
    Submit(SubmitArgs),
    /// Show, retry or cancel submitted jobs.
    ///
    /// Without a command it shows the states of the jobs: waiting, running, finished, stopped, failed.
    Jobs(JobsArgs),
    /// Print the experiment as a dora dataflow.
    ///
    /// Every node becomes a process of its own, on one machine or several; `dora run` runs the dataflow. The command
    /// takes the options of `run`, for the node that records, with these differences: `--workers` is the number of
    /// threads of each node (default: 1; all cores for aggregate nodes), `--window` is the largest number of frames in
    /// flight (default: 8), and nothing is reused from earlier runs.
    Dora(DoraArgs),
    /// Run as a node of such a dataflow; dora calls this.
    #[command(hide = true)]
    DoraNode(DoraNodeArgs),
    /// Recreate the tables, plots and page of a run.
    ///
    /// It reads the recording only, and checks every byte of it.
    Report(ReportArgs),
    /// Query metrics: rank variants, show effects.
    ///
    /// It sorts variants, shows the effect of each axis of the matrix, the best variant in each zone, or the best
    /// trade-offs between error and time.
    Table(TableArgs),
    /// Test whether one result is better than another.
    ///
    /// It compares runs, variants or estimates on the same frames, with confidence intervals, tests, and limits for CI.
    Compare(CompareArgs),
    /// Show how a number was computed.
    ///
    /// It prints the formula, pixels, frames and source of a metric, and the convention of the paper.
    Explain(ExplainArgs),
    /// Show errors by distance or another quantity.
    ///
    /// It puts scored pixels into bins of distance, confidence, image row, frame or anything else that was recorded,
    /// and prints percentiles, means and the share of outliers of their errors.
    #[command(visible_alias = "analyze")]
    Analyse(AnalyseArgs),
    /// Draw a figure for a paper.
    ///
    /// It writes SVG, PNG or PDF: error against distance, differences, histograms, metrics by frame or parameter,
    /// frames.
    Figure(FigureArgs),
    /// Export recorded values to common file formats.
    ///
    /// It writes PNG, NPY, PFM, PLY, PCD, ONNX and Parquet.
    Export(ExportArgs),
    /// List, compare, repair and remove runs.
    ///
    /// Without a command it lists the runs in the folder of runs, newest first, with size, state and best metric.
    Runs(RunsArgs),
    /// Recompute recorded values and compare them.
    ///
    /// Every node gets its recorded inputs, so that only a node that itself changed differs, not the nodes after it.
    /// The command reports the first and the largest difference of each node.
    Verify(VerifyArgs),
    /// Show what this machine offers.
    ///
    /// It prints cores, SIMD, the inference engine, and the data roots in the environment.
    #[command(after_long_help = examples![
        guide: "install.md",
        "doctor" => "for people",
        "doctor --json | jq .networks.engine" => "for programs",
    ])]
    Doctor(JsonArgs),
    /// Print a shell completion script.
    ///
    /// The script completes commands, options, kinds and files by asking this program.
    #[command(after_long_help = examples![
        guide: "install.md",
        "completions bash" => "bash, in ~/.bashrc: source <(depthloom completions bash)",
        "completions zsh" => "zsh, in ~/.zshrc after compinit: source <(depthloom completions zsh)",
        "completions fish" => "fish, in ~/.config/fish/config.fish: depthloom completions fish | source",
    ])]
    Completions {
        /// Print the script for this shell.
        shell: clap_complete::Shell,
    },
    /// Print or install manual pages.
    Man(ManArgs),
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "reference/nodes.md",
    "nodes" => "all kinds, one sentence each",
    "nodes stereo/sgbm" => "one kind: ports and parameters",
    "nodes learn/ssl --json | jq .parameters" => "for programs",
])]
pub(crate) struct NodesArgs {
    /// Explain this kind, e.g. `stereo/sgbm` (default: list all kinds).
    pub kind: Option<String>,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/editor.md",
    "lsp" => "an editor starts it; on a terminal it waits for one",
])]
pub(crate) struct LspArgs {
    /// Use the standard streams: always so; some editors add this option.
    #[arg(long)]
    pub stdio: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "reference/json.md",
    "schema > experiment.schema.json" => "an experiment names this file in its first line",
    "schema --of run" => "what `run --json` prints",
])]
pub(crate) struct SchemaArgs {
    /// Print the schema of an output of `--json` (default: of experiment files).
    #[arg(long, value_name = "OUTPUT", hide_possible_values = true)]
    pub of: Option<String>,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "reference/commands.md",
    "man run | man -l -" => "read the page of a command",
    "man --out ~/.local/share/man/man1" => "install all: then `man depthloom-run` finds them",
])]
pub(crate) struct ManArgs {
    /// Print the page of this command (default: of the program).
    pub command: Option<String>,

    /// Write all pages to a folder, e.g. `~/.local/share/man/man1`.
    #[arg(long, short, value_name = "DIR", conflicts_with = "command", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "tutorial/first-run.md",
    "new first.yaml" => "then: depthloom run first.yaml",
])]
pub(crate) struct NewArgs {
    /// Write this experiment file (YAML); it must not exist.
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub file: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/own-data.md",
    "synth street --frames 4 --seed 7" => "4 frames, with ground truth",
])]
pub(crate) struct SynthArgs {
    /// Write this folder; it must not exist.
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// Write this number of frames.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,

    /// Choose the street by its seed.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,

    /// Set the image width, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 1242, value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub width: u32,

    /// Set the image height, pixels.
    #[arg(long, value_name = "PIXELS", default_value_t = 375, value_parser = clap::value_parser!(u32).range(32..=4096))]
    pub height: u32,

    /// Print only errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// The folder in which runs are looked up by name.
#[derive(Clone, Debug, Args)]
pub(crate) struct RunsFolder {
    /// Use this folder of runs (default: $DEPTHLOOM_RUNS, or `runs`).
    #[arg(id = "runs_folder", long = "runs", global = true, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    folder: Option<PathBuf>,
}

/// The environment variable that names the folder of runs.
const RUNS_VARIABLE: &str = "DEPTHLOOM_RUNS";

impl RunsFolder {
    /// The folder of runs where no option names one.
    pub(crate) fn default_path() -> PathBuf {
        let folder = std::env::var_os(RUNS_VARIABLE).filter(|folder| !folder.is_empty());
        folder.map_or_else(|| PathBuf::from(depthloom_runs::FOLDER), PathBuf::from)
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.clone().unwrap_or_else(Self::default_path)
    }

    /// The recording of a run that is named in this folder, or the recording itself; `command` is for messages.
    pub(crate) fn recording(&self, run: &Path, command: &str) -> Result<PathBuf, CliError> {
        depthloom_runs::recording_in(&self.path(), run, command)
    }
}

/// A run.
#[derive(Debug, Args)]
pub(crate) struct RunArg {
    /// Read this run.
    ///
    /// Name its folder, its recording, a unique prefix of its name in the folder of runs, or `@latest`, the newest
    /// finished run.
    #[arg(add = ArgValueCompleter::new(runs))]
    run: PathBuf,

    #[command(flatten)]
    folder: RunsFolder,
}

impl RunArg {
    /// The run's recording; `command` is for messages.
    pub(crate) fn recording(&self, command: &str) -> Result<PathBuf, CliError> {
        self.folder.recording(&self.run, command)
    }
}

impl Deref for RunArg {
    type Target = PathBuf;

    fn deref(&self) -> &PathBuf {
        &self.run
    }
}

/// A part of a run.
#[derive(Debug, Args)]
pub(crate) struct PartArgs {
    /// Use only these variants, and what all variants share (default: all).
    #[arg(long, value_name = "GLOB,...")]
    pub variant: Option<String>,

    /// Use only these stages (default: all).
    #[arg(long, value_name = "GLOB,...")]
    pub stage: Option<String>,
}

/// The form of an output.
#[derive(Clone, Debug, Args)]
pub(crate) struct JsonArgs {
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// The form of a table, and where it is written.
#[derive(Debug, Args)]
pub(crate) struct TableOutputArgs {
    /// Write the table in this format (default: terminal).
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub format: Option<TableFormat>,

    /// Write to this file (default: standard output).
    #[arg(long, short, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print one JSON object: the same as `--format json`.
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
}
