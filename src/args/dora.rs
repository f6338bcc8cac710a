//! Options of `dora`.

use std::path::PathBuf;

use clap::Args;

use super::RunArgs;

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/dora.md",
    "dora first.yaml --out look > dataflow.yml" => "then `dora run dataflow.yml`: every node is a process, the recording is the same",
    "dora first.yaml --machine '*.mono=jetson' > dataflow.yml" => "one of the nodes runs on another machine",
])]
pub(crate) struct DoraArgs {
    #[command(flatten)]
    pub run: RunArgs,

    /// Use this Python, which has `dora-rs` and `pyarrow`.
    ///
    /// Every machine needs it: `pip install dora-rs pyarrow`.
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: String,

    /// Give every node this time to start, seconds.
    ///
    /// After it the dataflow ends with an error that names the nodes that did not start.
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..))]
    pub start_timeout: u64,

    /// Run nodes on this machine: `'*.mono=jetson'`. Can be repeated.
    ///
    /// Nodes are named as in the dataflow, and a machine by the name of its dora daemon. If several match a node, the
    /// last one applies.
    #[arg(long = "machine", value_name = "NODE=MACHINE", value_parser = parse_machine)]
    pub machines: Vec<(String, String)>,
}

impl DoraArgs {
    /// The largest number of frames in flight.
    pub(crate) fn window(&self) -> usize {
        usize::from(self.run.window.unwrap_or(8))
    }
}

#[derive(Debug, Args)]
pub(crate) struct DoraNodeArgs {
    /// Run this node of the dataflow.
    #[arg(long, value_name = "NAME")]
    pub part: String,

    /// Expect this plan: a node that finds another one does not start.
    #[arg(long, value_name = "KEY")]
    pub plan: String,

    /// Work in this folder, in which the dataflow was written.
    #[arg(long, value_name = "DIR")]
    pub folder: PathBuf,

    #[command(flatten)]
    pub dora: DoraArgs,
}

fn parse_machine(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((part, machine)) if !part.is_empty() && !machine.is_empty() => Ok((part.to_owned(), machine.to_owned())),
        _ => Err("expected NODE=MACHINE, e.g. 'compare.*=jetson'".to_owned()),
    }
}
