//! Options of `verify`.

use clap::Args;
use depthloom_verify::Tolerance;

use super::{ExecArgs, JsonArgs, RunArg};

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/ci.md",
    "verify @latest" => "every node whose values and inputs were recorded",
    "verify @latest compare.fused --tolerance depth=0.001" => "one node, to a millimetre",
    "verify @latest --json | jq '.nodes[] | select(.different > 0)'" => "for programs",
])]
pub(crate) struct VerifyArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// Verify only these nodes, by name or with their stage (default: all).
    ///
    /// `*` matches any characters: `fused`, `compare.stereo`, `learn.*`. It is an error if a node that is named cannot
    /// be recomputed.
    #[arg(value_name = "NODE")]
    pub nodes: Vec<String>,

    /// Accept differences up to this size (default: 0). Can be repeated.
    ///
    /// The unit is that of the values. The limit applies to one value type, `depth=0.001` (metres),
    /// `disparity=0.0625` (pixels), `weight`, `image` and others, or to all types: `1e-6`. A valid pixel and an
    /// invalid one always differ.
    #[arg(long, value_name = "[TYPE=]LIMIT", value_parser = Tolerance::parse)]
    pub tolerance: Vec<Tolerance>,

    #[command(flatten)]
    pub exec: ExecArgs,

    /// Set the number of worker threads (default: number of cores).
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    #[command(flatten)]
    pub output: JsonArgs,
}
