//! An experiment, and what is asked of it before it runs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;

use super::JsonArgs;
use crate::completion::{experiments, folders};

/// An experiment file, and what of it is set otherwise.
#[derive(Clone, Debug, Args)]
pub(crate) struct ExperimentArgs {
    /// The experiment file (YAML). `check`, `plan` and `graph` read `-` from standard input.
    #[arg(add = ArgValueCompleter::new(experiments()))]
    pub experiment: PathBuf,

    /// Change the experiment before its variants do: `compare.mono.with.cap=50`. It takes precedence over the file,
    /// what the file extends, and defaults. A variant that sets the same path keeps its value: a warning if some
    /// variants do, an error if all do. `variants.full.compare.mono.with.cap=50` changes one variant;
    /// `matrix.AXIS.values=[3,5]`, `matrix.AXIS.to=20` and `matrix.sample.count=100` change an axis or the sample.
    /// `null` removes a stage, node, source, variant or axis: `variants.NAME=null`. May be repeated; is recorded.
    #[arg(long = "set", value_name = "PATH=VALUE", value_parser = parse_set)]
    pub set: Vec<(String, String)>,

    /// Run one variant of each value: `--matrix compare.stereo.with.block=[3,5,9]`, or of a range: `{from: 0, to: 20,
    /// steps: 3}`. Several are every combination. An axis that the experiment's `matrix` has takes these values
    /// instead. May be repeated, of each path once; is recorded.
    #[arg(long, value_name = "PATH=[VALUES]", value_parser = parse_matrix)]
    pub matrix: Vec<(String, String)>,

    /// Of the variants take those that are so called; `*` stands for any run of characters: `--variant full --variant
    /// 'no_*'`. May be repeated; is recorded.
    #[arg(long = "variant", value_name = "NAME")]
    pub variants: Vec<String>,
}

/// Whether programs may be started.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct ExecArgs {
    /// Let the experiment start the programs that it names (`process`, `process/source`); without it, it starts none.
    /// An experiment whose file is listed under `allow_exec` in ~/.config/depthloom/config.yaml needs it not.
    #[arg(long)]
    pub allow_exec: bool,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "check first.yaml" => "all of its mistakes, each where it stands",
    "check first.yaml --json | jq -r '.diagnostics[] | \"\\(.file):\\(.line): \\(.message)\"'" => "for programs",
    "check first.yaml --sarif > check.sarif" => "for code review; begin in the repository's root",
    "check first.yaml --data" => "every frame of its data too, before an hour is computed on them",
])]
pub(crate) struct CheckArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    #[command(flatten)]
    pub output: JsonArgs,

    /// Print the diagnostics as SARIF 2.1.0, which code review tools show at their lines.
    #[arg(long, conflicts_with = "json")]
    pub sarif: bool,

    /// Look at the data as well: every frame of every source is read and nothing is computed. Missing and unreadable
    /// files, sizes that differ inside a pair, a calibration that contradicts the images, left and right exchanged,
    /// truth of another unit: each is told with its file.
    #[arg(long, conflicts_with = "sarif")]
    pub data: bool,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Threads that read frames, with `--data`; by default one a core.
    #[arg(long, short = 'j', value_name = "N", requires = "data", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "plan experiments/table1.yaml" => "stereo is run once for all variants",
    "plan first.yaml --reuse --set compare.stereo.with.block=7" => "what a run would reuse",
])]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Say of every node on how many frames it would run and on how many its values would be taken from earlier runs,
    /// and why not from all. Opens sources and engines, as `run` does.
    #[arg(long)]
    pub reuse: bool,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// The folder that the run would write, with `--reuse`: what lies beside it is taken from, too.
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
#[command(after_help = examples![
    "graph first.yaml" => "Mermaid, for a Markdown file on GitHub",
    "graph first.yaml --format dot | dot -Tsvg > graph.svg" => "Graphviz",
    "graph first.yaml --json | jq '.edges[]'" => "for programs",
])]
pub(crate) struct GraphArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// The language to draw it in.
    #[arg(long, value_enum, default_value_t = GraphFormat::Mermaid)]
    pub format: GraphFormat,

    /// Print its nodes and edges as one JSON object instead of a drawing.
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
