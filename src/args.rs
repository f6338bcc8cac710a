//! The command line's grammar: one definition of every option yields its help, its completion and its manual page.

/// The examples at the end of a help text: arguments, and what they do.
macro_rules! examples {
    ($($arguments:literal => $about:literal),+ $(,)?) => {
        concat!("Examples:\n", $("  depthloom ", $arguments, "\n          ", $about, "\n"),+)
    };
}

mod analyse;
mod compare;
mod data;
mod dora;
mod experiment;
mod export;
mod figure;
mod recording;
mod run;
mod runs;
mod table;

use std::ops::Deref;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::engine::ArgValueCompleter;

pub(crate) use analyse::{AnalyseArgs, SamplesArgs};
pub(crate) use compare::{CompareArgs, CompareBy};
pub(crate) use data::DataArgs;
pub(crate) use dora::{DoraArgs, DoraNodeArgs};
pub(crate) use experiment::{CheckArgs, ExecArgs, ExperimentArgs, GraphArgs, GraphFormat, PlanArgs};
pub(crate) use export::{ColoursOption, ExportArgs};
pub(crate) use figure::{FigureArgs, FigureFormat};
pub(crate) use recording::{InfoArgs, RecoverArgs, ReplayArgs};
pub(crate) use run::{ReportArgs, RunArgs, TimingsArgs};
pub(crate) use runs::{PruneArgs, RmArgs, RunsArgs, RunsCommand, ShowArgs, WhyArgs};
pub(crate) use table::{ExplainArgs, RowsOption, ScoresArgs, SetOption, TableArgs, TableFormat, TypesettingArgs};

use crate::completion::{folders, runs};

/// Declare depth-estimation experiments in YAML, run them fast, keep every intermediate.
#[derive(Debug, Parser)]
#[command(name = "depthloom", version, propagate_version = true)]
#[command(after_help = examples![
    "new first.yaml" => "write a commented experiment that runs anywhere",
    "run first.yaml" => "run it: a recording, a table, plots",
    "nodes stereo/sgbm" => "explain a kind of node",
    "help run" => "explain a command",
])]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,

    /// Colours in messages.
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

/// What to do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run an experiment: record every intermediate, score, and print the table.
    Run(RunArgs),
    /// Check an experiment file; runs nothing and opens no data. With --data, look at every frame too.
    Check(CheckArgs),
    /// Say what a folder holds, which source it is, and what to paste into an experiment; 2 where no frame can be read.
    Data(DataArgs),
    /// Show what would be run: every node, the variants that share it, and its recipe.
    Plan(PlanArgs),
    /// Draw the experiment's graph.
    Graph(GraphArgs),
    /// Make the tables and plots of a run again, from its recording alone, of which every byte is checked.
    Report(ReportArgs),
    /// Ask a run's scores: variants sorted, the effect of each axis, the best in each zone, error against time.
    Table(TableArgs),
    /// Ask whether it is really better: runs, variants or estimates over the same frames, with intervals, tests and
    /// limits for CI.
    Compare(CompareArgs),
    /// Say where a number of a table comes from: formula, pixels, frames, source, and the paper's convention beside it.
    Explain(ExplainArgs),
    /// Errors of scored pixels against distance, weight, image row, frame or anything else recorded: percentiles,
    /// means, gross errors.
    Analyse(AnalyseArgs),
    /// Write one row per scored pixel to `samples.parquet`: truth, every estimate, every recorded weight.
    Samples(SamplesArgs),
    /// Draw a figure for a paper, as SVG, PNG or PDF: error against distance, differences, histograms, scores by frame
    /// or parameter, frames.
    Figure(FigureArgs),
    /// Write recorded values as files that other programs read: PNG, NPY, PFM, PLY, PCD, ONNX, Parquet.
    Export(ExportArgs),
    /// Show where a run's time went: core-milliseconds per frame by node, encoding, compression and writing.
    Timings(TimingsArgs),
    /// Show what a recording holds: topics, messages, bytes raw and stored, keys, attachments, and whether it is whole.
    Info(InfoArgs),
    /// Make nodes again from their recorded inputs and compare the values with those recorded.
    Replay(ReplayArgs),
    /// Make a finished recording of one that was not finished, for readers that need one; `run` goes on by itself.
    Recover(RecoverArgs),
    /// List the runs in a folder, newest first, with size, state and best score; show one, say why two differ, remove
    /// some.
    Runs(RunsArgs),
    /// List the kinds of nodes and sources, or explain one.
    Nodes(NodesArgs),
    /// Show what an ONNX file takes, gives and costs, and print the lines that put it into an experiment.
    Onnx(OnnxArgs),
    /// Print the experiment as a dataflow of dora's, every node a process of its own, on one machine or several; `dora
    /// run` runs it.
    ///
    /// It takes the options of `run`, for the node that records. Here `--workers` is how many threads each node has
    /// (one; all cores for what fires once), `--window` how many frames are on their way at most (8), and nothing is
    /// taken from earlier runs.
    Dora(DoraArgs),
    /// Be a node of such a dataflow; dora calls this.
    #[command(hide = true)]
    DoraNode(DoraNodeArgs),
    /// Write synthetic street frames as a data set in KITTI stereo 2015 layout.
    Synth(SynthArgs),
    /// Show what this machine offers: cores, SIMD, engine of networks, data roots.
    #[command(after_help = examples![
        "doctor --json | jq .networks.engine" => "for programs",
    ])]
    Doctor(JsonArgs),
    /// Write a first experiment, commented, to begin from.
    New(NewArgs),
    /// Print the JSON Schema of experiment files, for editors, or of what a command prints with --json.
    Schema(SchemaArgs),
    /// Print a shell's script that completes commands, options, kinds and files by asking this program.
    #[command(after_help = examples![
        "completions bash" => "bash, in ~/.bashrc: source <(depthloom completions bash)",
        "completions zsh" => "zsh, in ~/.zshrc behind compinit: source <(depthloom completions zsh)",
        "completions fish" => "fish, in ~/.config/fish/config.fish: depthloom completions fish | source",
    ])]
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page (roff), or that of a command, or write them all.
    Man(ManArgs),
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "onnx raft-stereo.onnx" => "inputs, outputs, operators, cost; the lines for an experiment",
    "onnx net.onnx --json | jq .operators" => "for programs",
])]
pub(crate) struct OnnxArgs {
    /// The model.
    #[arg(value_hint = clap::ValueHint::FilePath)]
    pub file: PathBuf,

    /// The image that multiply-adds are counted for where the model leaves its size open, px.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1248x384", value_parser = size)]
    pub size: (usize, usize),

    #[command(flatten)]
    pub output: JsonArgs,
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=16_384).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    sides.ok_or_else(|| "a size is written 1248x384: columns, rows, each from 1 to 16384".to_owned())
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "nodes" => "all kinds, with a sentence each",
    "nodes stereo/sgbm" => "one kind: ports and parameters",
    "nodes learn/ssl --json | jq .parameters" => "for programs",
])]
pub(crate) struct NodesArgs {
    /// The kind to explain, e.g. `stereo/sgbm`.
    pub kind: Option<String>,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "schema > experiment.schema.json" => "an experiment names it in its first line",
    "schema --output run" => "what `run --json` prints",
])]
pub(crate) struct SchemaArgs {
    /// Print the schema of what a command prints with --json.
    #[arg(long, value_name = "COMMAND")]
    pub output: Option<String>,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "man run | man -l -" => "read the page of a command",
    "man --out ~/.local/share/man/man1" => "install all: then `man depthloom-run` finds them",
])]
pub(crate) struct ManArgs {
    /// The command to print the page of; without one, the program's own.
    pub command: Option<String>,

    /// Write the pages of the program and all its commands to a folder, e.g. `~/.local/share/man/man1`.
    #[arg(long, short, value_name = "DIR", conflicts_with = "command", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "new first.yaml" => "then: depthloom run first.yaml",
])]
pub(crate) struct NewArgs {
    /// The experiment file to write (YAML); it must not exist.
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub file: PathBuf,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "synth street --frames 40 --seed 7" => "40 frames, the ground truth with them",
])]
pub(crate) struct SynthArgs {
    /// The folder to write; it must not exist.
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// How many frames.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,

    /// The street's seed.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,

    /// Image width, pixels.
    #[arg(long, default_value_t = 1242, value_parser = clap::value_parser!(u32).range(64..=4096))]
    pub width: u32,

    /// Image height, pixels.
    #[arg(long, default_value_t = 375, value_parser = clap::value_parser!(u32).range(32..=4096))]
    pub height: u32,

    /// Print nothing but errors.
    #[arg(long, short)]
    pub quiet: bool,
}

/// A run.
#[derive(Debug, Args)]
pub(crate) struct RunArg {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    run: PathBuf,
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
    /// Only what these variants have, and what all share.
    #[arg(long, value_name = "GLOB,...")]
    pub variant: Option<String>,

    /// Only these stages.
    #[arg(long, value_name = "GLOB,...")]
    pub stage: Option<String>,
}

/// The form of an output.
#[derive(Debug, Args)]
pub(crate) struct JsonArgs {
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// The form of a table, and where it is written.
#[derive(Debug, Args)]
pub(crate) struct TableOutputArgs {
    /// What it is written as; by default as text for a terminal.
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub format: Option<TableFormat>,

    /// The file to write, in place of standard output.
    #[arg(long, short, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print one JSON object instead of text: the same as `--format json`.
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
}
