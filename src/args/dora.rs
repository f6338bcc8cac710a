//! An experiment as a dataflow of dora's.

use std::path::PathBuf;

use clap::Args;

use super::RunArgs;

#[derive(Debug, Args)]
#[command(after_help = examples![
    "dora first.yaml --out look > dataflow.yml" => "then `dora run dataflow.yml`: every node a process, the same recording",
    "dora first.yaml --machine '*.mono=jetson' > dataflow.yml" => "and one of them on another machine",
])]
pub(crate) struct DoraArgs {
    #[command(flatten)]
    pub run: RunArgs,

    /// The Python that has dora's library (`pip install dora-rs pyarrow`), on every machine.
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: String,

    /// How long every node of the dataflow may take to start, seconds. Then the dataflow ends with an error that names
    /// those that did not.
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..))]
    pub start_timeout: u64,

    /// Where nodes run, by their names in the dataflow: `--machine '*.mono=jetson'`, for dora's daemon of that name.
    /// May be repeated; of several that fit the last counts.
    #[arg(long = "machine", value_name = "NODE=MACHINE", value_parser = parse_machine)]
    pub machines: Vec<(String, String)>,
}

impl DoraArgs {
    /// How many frames are on their way at most.
    pub(crate) fn window(&self) -> usize {
        usize::from(self.run.window.unwrap_or(8))
    }
}

#[derive(Debug, Args)]
pub(crate) struct DoraNodeArgs {
    /// Its name in the dataflow.
    #[arg(long, value_name = "NAME")]
    pub part: String,

    /// What the dataflow was written of: nodes that find something else do not begin.
    #[arg(long, value_name = "KEY")]
    pub plan: String,

    /// The folder that the dataflow was written from.
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
