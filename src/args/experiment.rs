//! Options of commands that read an experiment: `check`, `plan`, `graph`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;

use super::{JsonArgs, RunsFolder};
use crate::completion::{experiments, folders, runs};

/// An experiment file, and the changes to it.
#[derive(Clone, Debug, Args)]
pub(crate) struct ExperimentArgs {
    /// Read this experiment file (YAML).
    ///
    /// `check`, `plan` and `graph` read `-` from standard input.
    #[arg(add = ArgValueCompleter::new(experiments()))]
    pub experiment: PathBuf,

    /// Change a value: `compare.mono.with.cap=50`. Can be repeated
    ///
    /// The change takes precedence over the file, the file that it extends, and defaults. A variant that sets the same
    /// path keeps its own value: depthloom warns if some variants do, and fails if all do. More paths:
    ///
    /// - `variants.full.compare.mono.with.cap=50` changes one variant
    /// - `matrix.AXIS.values=[3,5]`, `matrix.AXIS.to=20` and `matrix.sample.count=100` change an axis or the sample
    /// - `variants.NAME=null` removes a variant; `null` also removes a stage, node, source or axis
    ///
    /// The changes are stored with the run.
    #[arg(long = "set", value_name = "PATH=VALUE", value_parser = parse_set, verbatim_doc_comment)]
    pub set: Vec<(String, String)>,

    /// Add an axis: `compare.stereo.with.block=[3,5,9]`. Can be repeated.
    ///
    /// One variant runs for each value. A range is written `{from: 0, to: 20, steps: 3}`. Several axes are combined. If
    /// the experiment's `matrix` has this axis, these values replace its values. Each path can be given once. The axes
    /// are stored with the run.
    #[arg(long, value_name = "PATH=[VALUES]", value_parser = parse_matrix)]
    pub matrix: Vec<(String, String)>,

    /// Use only variants with this name (default: all). Can be repeated.
    ///
    /// `*` matches any characters: `--variant full --variant 'no_*'`. The selection is stored with the run.
    #[arg(long = "variant", value_name = "NAME")]
    pub variants: Vec<String>,
}

/// Whether programs may be started.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct ExecArgs {
    /// Allow the experiment to start the programs that it names.
    ///
    /// These are the commands of `process` and `process/source`. Without the option none is started, unless the file is
    /// listed under `allow_exec` in ~/.config/depthloom/config.yaml.
    #[arg(long)]
    pub allow_exec: bool,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/troubleshooting.md",
    "check first.yaml" => "all errors, each with its line",
    "check first.yaml --json | jq -r '.diagnostics[] | \"\\(.file):\\(.line): \\(.message)\"'" => "for programs",
    "check first.yaml --sarif > check.sarif" => "for code review; start it in the root of the repository",
    "check first.yaml --data" => "read every frame of its data, too",
])]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    #[command(flatten)]
    pub output: JsonArgs,

    /// Print the diagnostics as SARIF 2.1.0, for code review tools.
    #[arg(long, conflicts_with = "json")]
    pub sarif: bool,

    /// Also read every frame of every source.
    ///
    /// Nothing is computed. The command reports, with the file: missing and unreadable files, sizes that differ within
    /// a pair, a calibration that contradicts the images, exchanged left and right images, ground truth in another
    /// unit.
    #[arg(long, conflicts_with = "sarif")]
    pub data: bool,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Read frames with N threads, with `--data` (default: number of cores).
    #[arg(long, short = 'j', value_name = "N", requires = "data", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "explanation/keys-and-reuse.md",
    "plan first.yaml" => "stereo runs once for all variants",
    "plan first.yaml --reuse --set compare.stereo.with.block=7" => "what a run would reuse",
    "plan first.yaml --cost --frames 10000 --workers 64" => "what a run would cost, from the newest run of it",
    "plan first.yaml --cost --from first/one --json | jq .core_hours" => "for programs",
])]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Show what a run would reuse from earlier runs.
    ///
    /// For every node it prints the number of frames that would run, the number whose values would be reused, and why
    /// not all are. It opens sources and inference engines, as `run` does.
    #[arg(long)]
    pub reuse: bool,

    /// Predict the cost of a run from an earlier run.
    ///
    /// It prints CPU time, wall-clock time, bytes read and written, and the load of the file system. They come from
    /// the CPU time and the bytes per frame that the earlier run measured. A node that the earlier run does not have
    /// costs as much as one of the same kind. Aggregate nodes, such as trainings, cost the same for any number of
    /// frames. The command opens sources and inference engines, as `run` does.
    #[arg(long, conflicts_with = "reuse")]
    pub cost: bool,

    /// Use the measurements of this run, with `--cost` (default: the nearest run).
    ///
    /// It is the folder of a run, a unique prefix of its name in the folder of runs, or `@latest`. The nearest run is
    /// the finished run that measured the most nodes of the experiment, and of several the newest one. Values that a
    /// run reused have no measurement.
    #[arg(long, value_name = "RUN", requires = "cost", add = ArgValueCompleter::new(runs))]
    pub from: Option<PathBuf>,

    /// Predict for N frames in every stage, with `--cost` (default: the frames of its source).
    ///
    /// A stage that another stage reads, such as a training, keeps the frames of its source.
    #[arg(long, value_name = "N", requires = "cost", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub frames: Option<u64>,

    /// Predict for N variants, with `--cost` (default: those of the experiment).
    ///
    /// Each costs as much as a variant of the experiment on average. Nodes that all variants share count once.
    #[arg(
        long = "variants",
        value_name = "N",
        requires = "cost",
        value_parser = clap::value_parser!(u64).range(1..=1_000_000),
    )]
    pub variant_count: Option<u64>,

    /// Predict the time of N workers, with `--cost` (default: number of cores).
    #[arg(long, short = 'j', value_name = "N", requires = "cost", value_parser = clap::value_parser!(u16).range(1..))]
    pub workers: Option<u16>,

    /// Assume this bandwidth of the file system, MB/s (default: 500).
    ///
    /// It is the number of megabytes that all workers together can read and write in a second.
    #[arg(
        long,
        value_name = "MB/S",
        requires = "cost",
        default_value_t = 500,
        hide_default_value = true,
        value_parser = clap::value_parser!(u64).range(1..=1_000_000_000),
    )]
    pub bandwidth: u64,

    /// Predict the cost without `report.html`, with `--cost`.
    #[arg(long, requires = "cost")]
    pub no_page: bool,

    #[command(flatten)]
    pub exec: ExecArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Also search the runs next to this folder, with `--reuse`.
    ///
    /// It is the folder that the run would write.
    #[arg(long, short, value_name = "DIR", requires = "reuse", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    #[command(flatten)]
    pub output: JsonArgs,
}

/// How a graph is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum GraphFormat {
    /// Mermaid, which GitHub and many editors draw.
    Mermaid,
    /// Graphviz.
    Dot,
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "concepts.md",
    "graph first.yaml" => "Mermaid, for a Markdown file on GitHub",
    "graph first.yaml --format dot | dot -Tsvg > graph.svg" => "Graphviz",
    "graph first.yaml --json | jq '.edges[]'" => "for programs",
])]
pub(crate) struct GraphArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Draw it in this language.
    #[arg(long, value_enum, default_value_t = GraphFormat::Mermaid)]
    pub format: GraphFormat,

    /// Print nodes and edges as one JSON object.
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
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
