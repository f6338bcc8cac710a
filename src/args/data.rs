//! `data`.

use std::path::PathBuf;

use clap::Args;
use clap_complete::engine::ArgValueCompleter;

use super::JsonArgs;
use crate::completion::folders;

#[derive(Debug, Args)]
#[command(after_help = examples![
    "data /data/kitti" => "frames, sizes, calibration and truth, and the source to paste",
    "data /data/robot --sheet robot.png" => "and a picture of its frames",
])]
pub(crate) struct DataArgs {
    /// The folder of a data set, or a file that holds one (a bag, a recording).
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub root: PathBuf,

    /// Write a contact sheet (PNG): left images of frames from all over the data set, and their truth, red near and
    /// blue far.
    #[arg(long, value_name = "FILE")]
    pub sheet: Option<PathBuf>,

    #[command(flatten)]
    pub output: JsonArgs,
}
