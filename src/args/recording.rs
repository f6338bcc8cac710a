//! A recording: looked at, made whole, made again.

use std::path::PathBuf;

use clap::Args;
use depthloom_verify::Tolerance;

use super::{ExecArgs, JsonArgs, RunArg};

#[derive(Debug, Args)]
#[command(after_help = examples![
    "info @latest" => "topics with their sizes and recipes",
    "info copied.mcap --check" => "is every byte what was written?",
    "info RUN --keys --json | jq -r '.keys[].key' | sort -u" => "for programs",
])]
pub(crate) struct InfoArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Check every byte; without it a finished recording is taken at its summary's word.
    #[arg(long)]
    pub check: bool,

    /// List the keys of all values, by frame and node: equal keys are equal values, in whichever recordings.
    #[arg(long)]
    pub keys: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "recover runs/first/2026-11-21T08-30-05Z.partial" => "what a killed run left, for any MCAP reader",
])]
pub(crate) struct RecoverArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// The file to write, where none is; by default `<name>.recovered.mcap` in the current folder.
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "replay RUN --check" => "every node whose values and inputs are recorded",
    "replay RUN --check compare.fused --tolerance depth=0.001" => "one node, to a millimetre",
    "replay RUN --check --json | jq '.nodes[] | select(.different > 0)'" => "for programs",
])]
pub(crate) struct ReplayArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Compare the values of every node with those recorded: where they differ, tell the first and the worst
    /// difference. Every node gets its recorded inputs, so that it is the node that changed which differs, and none
    /// behind it.
    #[arg(long, required = true)]
    pub check: bool,

    /// Only these nodes, by name or with their stage; `*` stands for any run of characters: `fused`, `compare.stereo`,
    /// `learn.*`. A node that is named and cannot be made again is an error.
    #[arg(value_name = "NODE")]
    pub nodes: Vec<String>,

    /// How far numbers may be apart and still count as equal, in the unit of their values; by default not by one bit.
    /// Of one type of values: `depth=0.001` (metres), `disparity=0.0625` (pixels), `weight`, `image`, `scores`, ...; or
    /// of all: `1e-6`. An answer and none are never equal. May be repeated.
    #[arg(long, value_name = "[TYPE=]MOST", value_parser = Tolerance::parse)]
    pub tolerance: Vec<Tolerance>,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Worker threads; by default one a core.
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    #[command(flatten)]
    pub output: JsonArgs,
}
