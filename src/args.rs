//! The command line's grammar: one definition of every option yields its help, its completion and its manual page.

use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};
use clap_complete::engine::{ArgValueCandidates, ArgValueCompleter};
use depthloom_graphs::contracts::FrameSelection;

use crate::completion::{columns, experiments, folders, metrics, runs};
use crate::replay::Tolerance;
use crate::sizes::{parse_age, parse_size};

/// Declare depth-estimation experiments in YAML, run them fast, keep every intermediate.
#[derive(Debug, Parser)]
#[command(name = "depthloom", version, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,

    /// Colours in messages.
    #[arg(long, global = true, value_enum, default_value_t = Colour::Auto, value_name = "WHEN")]
    pub color: Colour,
}

/// When messages are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colour {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run an experiment: record every intermediate, score, and print the table.
    Run(RunArgs),
    /// Check an experiment file; runs nothing and opens no data.
    Check(CheckArgs),
    /// Show what would be run: every node, the variants that share it, and its recipe.
    Plan(PlanArgs),
    /// Draw the experiment's graph.
    Graph(GraphArgs),
    /// Make the tables and plots of a run again, from its recording alone, of which every byte is checked.
    Report(ReportArgs),
    /// Ask a run's scores: variants sorted, the effect of each axis, the best in each zone, error against time.
    Table(TableArgs),
    /// Say where a number of a table comes from: formula, pixels, frames, source, and the paper's convention beside it.
    Explain(ExplainArgs),
    /// Write recorded values as files that other programs read: PNG, NPY, PFM, PLY, PCD, ONNX.
    Export(ExportArgs),
    /// Show where a run's time went: core-milliseconds per frame by node, encoding, compression and writing.
    Timings(TimingsArgs),
    /// Show what a recording holds: topics, messages, bytes raw and stored, keys, attachments, and whether it is whole.
    Info(InfoArgs),
    /// Make nodes again from their recorded inputs and compare the values with those recorded.
    Replay(ReplayArgs),
    /// Make a finished recording of one that was not finished, for readers that need one; `run` goes on by itself.
    Recover(RecoverArgs),
    /// List the runs in a folder, newest first, with size, state and best score; show one, say why two differ, remove some.
    Runs(RunsArgs),
    /// List the kinds of nodes and sources, or explain one.
    Nodes(NodesArgs),
    /// Write synthetic street frames as a data set in KITTI stereo 2015 layout.
    Synth(SynthArgs),
    /// Show what this machine offers: cores, SIMD, engine of networks, data roots.
    Doctor(JsonArgs),
    /// Write a first experiment, commented, to begin from.
    New(NewArgs),
    /// Print the JSON Schema of experiment files, for editors.
    Schema,
    /// Print a shell's script that completes commands, options, kinds and files by asking this program.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Print the manual page (roff), or that of a command, or write them all.
    Man(ManArgs),
}

/// An experiment file, and what of it is set otherwise.
#[derive(Clone, Debug, Args)]
pub struct ExperimentArgs {
    /// The experiment file (YAML).
    #[arg(add = ArgValueCompleter::new(experiments()))]
    pub experiment: PathBuf,

    /// Set something in the experiment before its variants do: `compare.mono.with.cap=50`. Goes before the file and its defaults; a
    /// variant that sets the same keeps its own value, which is said, and where all do, it is an error. `variants.NAME.` in front sets it
    /// there: `variants.full.compare.mono.with.cap=50`, `matrix.` an axis or sample: `matrix.AXIS.values=[3,5]`, `matrix.AXIS.to=20`,
    /// `matrix.sample.count=100`. `null` takes away a stage, node, source, variant or axis: `variants.NAME=null`. May be repeated; is
    /// recorded.
    #[arg(long = "set", value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,

    /// Run one variant of each value: `--matrix compare.stereo.with.block=[3,5,9]`, or of a range: `{from: 0, to: 20, steps: 3}`. Several
    /// are every combination. An axis that the experiment's `matrix` has takes these values instead. May be repeated, of each path once;
    /// is recorded.
    #[arg(long, value_name = "PATH=[VALUES]", value_parser = parse_matrix)]
    pub matrix: Vec<(String, String)>,

    /// Of the variants take those that are so called; `*` stands for any run of characters: `--variant full --variant 'no_*'`. May be
    /// repeated; is recorded.
    #[arg(long = "variant", value_name = "NAME")]
    pub variants: Vec<String>,
}

/// `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The experiment.
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Print one JSON object instead of text: what the experiment holds, and every diagnostic.
    #[arg(long)]
    pub json: bool,

    /// Print the diagnostics as SARIF 2.1.0, which code review tools show at their lines.
    #[arg(long, conflicts_with = "json")]
    pub sarif: bool,
}

/// `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The experiment.
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// The folder to write; by default `runs/<experiment>/<UTC time>`.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Replace the output folder if it holds a run that is over.
    #[arg(long)]
    pub overwrite: bool,

    /// Make everything anew: take nothing from earlier runs, and do not go on with one that did not come to its end. So does
    /// DEPTHLOOM_FRESH=1 in the environment.
    #[arg(long)]
    pub fresh: bool,

    /// Wait for the disk after every frame, so that a power cut costs no frame that was written either.
    #[arg(long)]
    pub durable: bool,

    /// Worker threads; by default one a core. Never changes a result.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Frames in flight at most; by default two more than workers. Bounds memory, never changes a result.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub window: Option<u16>,

    /// Go on after a frame failed: what depended on it is left out, means are taken over the frames common to all.
    #[arg(long)]
    pub keep_going: bool,

    /// Print the paper's Table I beside the table.
    #[arg(long)]
    pub paper: bool,

    /// Print the run's folder and nothing else.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

impl RunArgs {
    /// Whether nothing is taken from earlier runs.
    pub fn is_fresh(&self) -> bool {
        self.fresh || std::env::var_os("DEPTHLOOM_FRESH").is_some_and(|told| !told.is_empty() && told != "0")
    }
}

/// `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// The experiment.
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Say of every node on how many frames it would run and on how many its values would be taken from earlier runs, and why not from
    /// all. Opens sources and engines, as `run` does.
    #[arg(long)]
    pub reuse: bool,

    /// The folder that the run would write, with `--reuse`: what lies beside it is taken from, too.
    #[arg(long, short, value_name = "DIR", requires = "reuse", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// How a graph is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GraphFormat {
    /// Mermaid, which GitHub and many editors draw.
    Mermaid,
    /// Graphviz.
    Dot,
}

/// `graph`.
#[derive(Debug, Args)]
pub struct GraphArgs {
    /// The experiment.
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// The language to draw it in.
    #[arg(long, value_enum, default_value_t = GraphFormat::Mermaid)]
    pub format: GraphFormat,

    /// Print its nodes and edges as one JSON object instead of a drawing.
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
}

/// `report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// The folder to write tables and plots to; by default the run's own.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print the paper's Table I beside the table.
    #[arg(long)]
    pub paper: bool,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// Which pixels scores are over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SetOption {
    /// Every true pixel.
    All,
    /// The true pixels that an estimate answered, which are its own.
    Answered,
    /// Of disparities: every true pixel, after the benchmark's filling of what was not answered.
    Filled,
    /// Of depths, taken again from recorded maps: the true pixels that all selected estimates answered.
    Common,
}

/// How frames' scores become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MeanOption {
    /// The unweighted mean of the frames' scores.
    Frames,
    /// As if all frames were one image.
    Pixels,
}

/// What a table is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TableFormat {
    /// Aligned text, the best marked by `*`.
    Terminal,
    /// Markdown, as GitHub shows it.
    Md,
    /// Comma-separated values: all digits, no marks.
    Csv,
    /// Parquet, with the columns of csv; a terminal takes none: with --out, or into a pipe.
    Parquet,
    /// A LaTeX float for the package booktabs, in the type's own size.
    Latex,
    /// One JSON object.
    Json,
}

/// Which scores of a run, of what.
#[derive(Debug, Args)]
pub struct ScoresArgs {
    /// The pixels that scores are over; by default every true pixel, where those were scored.
    #[arg(long, value_enum)]
    pub set: Option<SetOption>,

    /// A zone that the experiment scored, e.g. `10..20`; by default the whole image.
    #[arg(long, value_name = "ZONE")]
    pub zone: Option<String>,

    /// What a score of all frames is taken over; by default what the experiment says, which is frames where it says nothing.
    #[arg(long, value_enum)]
    pub mean: Option<MeanOption>,
}

/// `table`.
#[derive(Debug, Args)]
pub struct TableArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Which scores.
    #[command(flatten)]
    pub scores: ScoresArgs,

    /// Only estimators whose label or name this is; `*` stands for any run of characters: `fused`, `no_*/mono`.
    #[arg(long, value_name = "GLOB")]
    pub estimators: Option<String>,

    /// Sort by a score, `ms`, `density`, `frames` or `pixels`, best first, or by an axis, numbers by size and words in the
    /// file's order; by default `abs_rel`, or the first error that was scored.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns))]
    pub sort: Option<String>,

    /// Show so many rows at most.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub top: Option<u32>,

    /// What is in rows: variants, their axes in columns; or scores, as in the paper's Table I.
    #[arg(long, value_enum, default_value = "variant")]
    pub rows: RowsOption,

    /// The columns behind the axes, with commas between: scores, `density` (the share of true pixels that were answered), `ms`
    /// (core-milliseconds a frame: the processor time of all nodes that the estimate is computed from, as if it had been run alone; a
    /// node that several share counts for each; without reading, scoring, recording and learning), `frames`, `pixels`. Scores of depths and of
    /// disparities stand in one row where the depth is made of the disparity by `depth/from-disparity`; `disparity_density`, `disparity_frames` and
    /// `disparity_pixels` are then the disparity's.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', add = ArgValueCandidates::new(columns))]
    pub columns: Vec<String>,

    /// Show only what no other row that it can be compared with beats in all of these, e.g. `abs_rel,ms`.
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',', add = ArgValueCandidates::new(columns))]
    pub pareto: Vec<String>,

    /// Show what each axis did to a score or to `ms`: the mean of all rows with a level, and the share of the variance between rows that the axis
    /// explains alone (eta squared); what is left are interactions of axes.
    #[arg(long, value_name = "COLUMN", add = ArgValueCandidates::new(columns), conflicts_with_all = ["best_per_zone", "sort", "top", "columns", "pareto", "rows"])]
    pub effects: Option<String>,

    /// Show which row is best in each zone that the experiment scored.
    #[arg(long, value_name = "SCORE", add = ArgValueCandidates::new(columns), conflicts_with_all = ["zone", "sort", "top", "columns", "pareto", "rows"])]
    pub best_per_zone: Option<String>,

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

/// What a table has in rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum RowsOption {
    /// An estimate of a variant a row, or a depth and the disparity it is made of; its axes and scores in columns.
    Variant,
    /// A score a row, estimates in columns.
    Score,
}

/// `explain`.
#[derive(Debug, Args)]
pub struct ExplainArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// The score, e.g. `abs_rel`.
    #[arg(add = ArgValueCandidates::new(metrics))]
    pub score: String,

    /// The estimator as tables name it: `fused`, `full/fused`.
    pub estimator: String,

    /// Which scores.
    #[command(flatten)]
    pub scores: ScoresArgs,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// What values are exported as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Images as they are; disparity and depth in 16 bits, 256ths of a pixel or metre, 0 = none, as KITTI has them; weights in 65535ths.
    Png,
    /// NumPy arrays: pixels of disparity, metres of depth as float32, NaN = none; images and masks as they are.
    Npy,
    /// Portable float maps, infinity = none, as Middlebury has them.
    Pfm,
    /// Point clouds of depths and disparities: metres, x to the right, y down, z forward, coloured by the source's first image.
    Ply,
    /// The same, as the Point Cloud Library has them.
    Pcd,
    /// Learnt networks.
    Onnx,
}

impl ExportFormat {
    /// As it is written on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Npy => "npy",
            Self::Pfm => "pfm",
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::Onnx => "onnx",
        }
    }
}

/// The colours of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ColoursOption {
    /// Blue over green to red.
    Turbo,
    /// Violet over green to yellow.
    Viridis,
    /// Black over red to pale yellow.
    Magma,
    /// Black to white.
    Grey,
}

/// `export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// What to export: topics as `info` lists them (`/look/depth/depth`), or by their end or node (`depth/depth`, `depth`); `*` stands for
    /// any run of characters. Without one, all.
    #[arg(value_name = "TOPIC")]
    pub topics: Vec<String>,

    /// The folder to write: `DIR/<topic>/<frame>.<format>`, and `DIR/<topic>.<format>` of what there is once. Each file is whole or not there.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// The formats, with commas between; each topic is written in those of them that it has. Without it: png, and onnx of networks.
    #[arg(long, value_enum, value_name = "FORMAT,...", value_delimiter = ',')]
    pub format: Vec<ExportFormat>,

    /// The frames: `3`, `3,7`, `0..4`, `1..=40`, or a text file with a frame id a line. Without it, all.
    #[arg(long, value_name = "FRAMES", value_parser = parse_frames)]
    pub frames: Option<FrameSelection>,

    /// Write disparities, depths and weights as PNG in colours, no answer black, into `DIR/<topic>.<colours>/`.
    #[arg(long, value_enum, value_name = "COLOURS")]
    pub colormap: Option<ColoursOption>,

    /// What the first and the last colour stand for, `80..0` the other way round; by default `0..80` m, `0..128` px, weights `0..1`. Of
    /// point clouds the points in this range of depth are written, by default all.
    #[arg(long, value_name = "FROM..TO", value_parser = parse_range, allow_hyphen_values = true)]
    pub range: Option<(f64, f64)>,

    /// Replace files also in a folder that no export made.
    #[arg(long)]
    pub overwrite: bool,

    /// Print nothing but errors and warnings.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// `timings`.
#[derive(Debug, Args)]
pub struct TimingsArgs {
    /// A run: its folder, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Print one JSON object instead of text; times in nanoseconds, in all frames together.
    #[arg(long)]
    pub json: bool,
}

/// `replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// A run: its folder, its recording, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,

    /// Compare the values of every node with those recorded: where they differ, tell the first and the worst difference. Every node gets its
    /// recorded inputs, so that it is the node that changed which differs, and none behind it.
    #[arg(long, required = true)]
    pub check: bool,

    /// Only these nodes, by name or with their stage; `*` stands for any run of characters: `fused`, `compare.stereo`, `learn.*`. A node that
    /// is named and cannot be made again is an error.
    #[arg(value_name = "NODE")]
    pub nodes: Vec<String>,

    /// How far numbers may be apart and still count as equal, in the unit of their values; by default not by one bit. Of one type of values:
    /// `depth=0.001` (metres), `disparity=0.0625` (pixels), `weight`, `image`, `scores`, ...; or of all: `1e-6`. An answer and none are never equal.
    /// May be repeated.
    #[arg(long, value_name = "[TYPE=]MOST", value_parser = Tolerance::parse)]
    pub tolerance: Vec<Tolerance>,

    /// Worker threads; by default one a core.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// `runs`.
#[derive(Debug, Args)]
#[command(disable_help_subcommand = true)]
pub struct RunsArgs {
    /// What to do; without one, list them.
    #[command(subcommand)]
    pub command: Option<RunsCommand>,

    /// The folder of runs.
    #[arg(long = "in", global = true, value_name = "DIR", default_value = crate::runs::FOLDER, add = ArgValueCompleter::new(folders()))]
    pub folder: PathBuf,

    /// Print one JSON object instead of text.
    #[arg(long, global = true)]
    pub json: bool,
}

/// What to do with runs.
#[derive(Debug, Subcommand)]
pub enum RunsCommand {
    /// List the runs in a folder, newest first; what `runs` does without a command.
    List,
    /// Show a run: what it is of, what became of it, how it was made, and its files.
    Show(ShowArgs),
    /// Say why two runs differ: what was set otherwise, and by parameter, version, input or file which nodes are others.
    Why(WhyArgs),
    /// Remove runs that are over. Asks nothing: of several all are removed, or none if one may not be.
    Rm(RmArgs),
    /// Remove runs by age, size or number. A run that goes on, holds anything else, or is named by the experiment of one that stays, is kept.
    Prune(PruneArgs),
}

/// `runs rm`.
#[derive(Debug, Args)]
pub struct RmArgs {
    /// The runs: folders, beginnings of names, or `@latest`.
    #[arg(required = true, add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,
}

/// `runs prune`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("rules").required(true).multiple(true).args(["keep", "older_than", "max_size", "unfinished"]))]
pub struct PruneArgs {
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

/// `runs show`.
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// A run: its folder, the beginning of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub run: PathBuf,
}

/// `runs why`.
#[derive(Debug, Args)]
pub struct WhyArgs {
    /// The earlier run: its folder, its recording, the beginning of its name, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub before: PathBuf,

    /// The later run.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub after: PathBuf,
}

/// `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A recording, or its run: the folder, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub file: PathBuf,

    /// Check every byte; without it a finished recording is taken at its summary's word.
    #[arg(long)]
    pub check: bool,

    /// List the keys of all values, by frame and node: equal keys are equal values, in whichever recordings.
    #[arg(long)]
    pub keys: bool,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// `recover`.
#[derive(Debug, Args)]
pub struct RecoverArgs {
    /// The recording, or its run: the folder, the beginning of its name in `runs`, or `@latest`.
    #[arg(add = ArgValueCompleter::new(runs))]
    pub file: PathBuf,

    /// The file to write, where none is; by default `<name>.recovered.mcap` in the current folder.
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

/// `nodes`.
#[derive(Debug, Args)]
pub struct NodesArgs {
    /// The kind to explain, e.g. `stereo/sgbm`.
    pub kind: Option<String>,

    /// Print one JSON object instead of text: the kinds, or one with its ports and the JSON Schema of its parameters.
    #[arg(long)]
    pub json: bool,
}

/// `man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The command to print the page of; without one, the program's own.
    pub command: Option<String>,

    /// Write the pages of the program and all its commands to a folder, e.g. `~/.local/share/man/man1`.
    #[arg(long, short, value_name = "DIR", conflicts_with = "command", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,
}

/// `new`.
#[derive(Debug, Args)]
pub struct NewArgs {
    /// The experiment file to write (YAML); it must not exist.
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub file: PathBuf,
}

/// `synth`.
#[derive(Debug, Args)]
pub struct SynthArgs {
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

/// Only `--json`.
#[derive(Debug, Args)]
pub struct JsonArgs {
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}

fn parse_frames(text: &str) -> Result<FrameSelection, String> {
    let list: Option<Vec<u64>> = text.split(',').map(|index| index.trim().parse().ok()).collect();
    list.map_or_else(|| FrameSelection::parse(text), |list| Ok(FrameSelection::List(list)))
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    let range = text.split_once("..").and_then(|(from, to)| Some((number(from)?, number(to)?)));
    range
        .filter(|(from, to)| from != to)
        .ok_or_else(|| "expected FROM..TO, two different numbers, e.g. 0..80".to_owned())
}

fn parse_set(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((path, value)) if !path.is_empty() => Ok((path.to_owned(), value.to_owned())),
        _ => Err("expected PATH=VALUE, e.g. compare.mono.with.cap=50".to_owned()),
    }
}

fn parse_matrix(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((path, values)) if !path.is_empty() => Ok((path.to_owned(), values.to_owned())),
        _ => Err("expected PATH=[VALUES], e.g. compare.stereo.with.block=[3,5,9]".to_owned()),
    }
}
