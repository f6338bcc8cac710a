//! `data`.

use std::path::PathBuf;

use clap::Args;
use clap_complete::engine::ArgValueCompleter;

use crate::completion::folders;

/// `data`.
#[derive(Debug, Args)]
pub struct DataArgs {
    /// The folder of a data set, or a file that holds one (a bag, a recording).
    #[arg(add = ArgValueCompleter::new(folders()))]
    pub root: PathBuf,

    /// Write a contact sheet (PNG): left images of frames from all over the data set, and their truth, red near and blue far.
    #[arg(long, value_name = "FILE")]
    pub sheet: Option<PathBuf>,

    /// Print one JSON object instead of text.
    #[arg(long)]
    pub json: bool,
}
