//! Values for other programs.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_analysis::FrameChoice;
use depthloom_export::ExportFormat;
use depthloom_graphs::contracts::FrameSelection;

use super::{JsonArgs, RunArg};
use crate::completion::folders;

/// The colours of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ColoursOption {
    /// Blue over green to red.
    Turbo,
    /// Violet over green to yellow.
    Viridis,
    /// Black over red to pale yellow.
    Magma,
    /// Black to white.
    Grey,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "export RUN depth --out depths" => "each frame's depth as a 16-bit PNG, as KITTI has them",
    "export RUN depth/depth --format npy,pfm --frames 3,7 --out arrays" => "the floats themselves, of two frames",
    "export RUN 'fused*' --colormap turbo --range 0..40 --out look" => "in colours, for a figure",
    "export RUN depth --format ply --range 0..60 --out clouds" => "points up to 60 m, coloured by the image",
    "export RUN --out all --json | jq '.topics[]'" => "everything; for programs",
])]
pub(crate) struct ExportArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// What to export: topics as `info` lists them (`/look/depth/depth`), or by their end or node (`depth/depth`,
    /// `depth`); of the source also by the output alone (`calibration`), where no node has that name. `*` stands for
    /// any run of characters. Without one, all.
    #[arg(value_name = "TOPIC")]
    pub topics: Vec<String>,

    /// The folder to write: `DIR/<topic>/<frame>.<format>`, and `DIR/<topic>.<format>` of what there is once. Each file
    /// is whole or not there.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: PathBuf,

    /// The formats, with commas between; each topic is written in those of them that it has. Without it: png, of
    /// networks onnx, of rows parquet.
    #[arg(long, value_enum, value_name = "FORMAT,...", value_delimiter = ',')]
    pub format: Vec<ExportFormat>,

    /// The frames: numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a text file with a frame id per line.
    /// Without it, all.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    /// Write disparities, depths and weights as PNG in colours, no answer black, into `DIR/<topic>.<colours>/`.
    #[arg(long, value_enum, value_name = "COLOURS")]
    pub colormap: Option<ColoursOption>,

    /// What the first and the last colour stand for, `80..0` the other way round; by default `0..80` m, `0..128` px,
    /// weights `0..1`. Of point clouds the points in this range of depth are written; by default all that are not at a
    /// depth where a node capped them.
    #[arg(long, value_name = "FROM..TO", value_parser = parse_range, allow_hyphen_values = true)]
    pub range: Option<(f64, f64)>,

    /// Replace files also in a folder that no export made.
    #[arg(long)]
    pub overwrite: bool,

    /// Print nothing but errors and warnings.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

pub(super) fn parse_frames(text: &str) -> Result<FrameSelection, String> {
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
