//! Options of `inspect`.

use std::path::PathBuf;

use clap::Args;
use clap_complete::engine::ArgValueCompleter;

use super::{JsonArgs, RunsFolder};
use crate::completion::inspectable;

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/own-data.md",
    "inspect street" => "a data set: frames, sizes, calibration, ground truth, and the source to paste",
    "inspect street --contact-sheet street.png" => "the same, and a picture of its frames",
    "inspect @latest" => "a run: topics with their sizes and keys",
    "inspect copied.mcap --verify-bytes" => "a recording: is every byte what was written?",
    "inspect @latest --keys --json | jq -r '.keys[].key' | sort -u" => "for programs",
    "inspect street-network.onnx" => "a network: inputs, outputs, operators, cost, and the node to paste",
])]
pub(crate) struct InspectArgs {
    /// Inspect this folder, file or run.
    ///
    /// Name the folder of a data set, a bag, a recording, an `.onnx` file, or a run: its folder, a unique prefix of its
    /// name in the folder of runs, or `@latest`.
    #[arg(add = ArgValueCompleter::new(inspectable))]
    pub path: PathBuf,

    /// Write a contact sheet (PNG) of a data set.
    ///
    /// It shows left images from the whole data set, and their ground truth: red is near, blue is far.
    #[arg(long, value_name = "FILE")]
    pub contact_sheet: Option<PathBuf>,

    /// Describe a recording as a data source.
    ///
    /// By default the contents of a recording are listed. With this option its frames are read, and the `sources:`
    /// entry is printed, as for a data set.
    #[arg(long, conflicts_with_all = ["verify_bytes", "keys"])]
    pub as_source: bool,

    /// Verify every byte of a recording (default: trust its summary).
    #[arg(long)]
    pub verify_bytes: bool,

    /// List the keys of all values of a recording, by frame and node.
    ///
    /// Equal keys mean equal values, also in different recordings.
    #[arg(long)]
    pub keys: bool,

    /// Count multiply-adds of a network at this size, px (default: 1248x384).
    ///
    /// It applies where the network leaves the size of its input open.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub size: Option<(usize, usize)>,

    #[command(flatten)]
    pub folder: RunsFolder,

    #[command(flatten)]
    pub output: JsonArgs,
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=16_384).contains(side));
    let sides = text.split_once('x').and_then(|(width, height)| Some((side(width)?, side(height)?)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, e.g. 1248x384, each from 1 to 16384".to_owned())
}
