//! Options of `analyse`.

use std::path::PathBuf;

use clap::Args;
use clap_complete::engine::ArgValueCompleter;
use depthloom_analysis::{Bins, FrameChoice, Outlier, SampleSet};

use super::{PartArgs, RunsFolder, TableOutputArgs, TypesettingArgs};
use crate::completion::runs;

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "explanation/error-against-distance.md",
    "analyse @latest" => "error against distance, in bins of one metre",
    "analyse @latest --bins log:12 --estimates '*/fused' --pixels common" => "some estimates, on the pixels that are valid in all of them",
    "analyse @latest --by weight --percentiles 50,95" => "does higher confidence mean smaller error?",
    "analyse first/one first/two --by frame --format csv --out frames.csv" => "two runs, frame by frame",
    "analyse @latest --bins quantile:5 --digits 2 --format latex --out errors.tex" => "for a paper",
    "analyse @latest --samples-only" => "write samples.parquet into the run's folder: one row per scored pixel",
])]
pub(crate) struct AnalyseArgs {
    /// Analyse these runs.
    ///
    /// Name a run's folder, its recording, a unique prefix of its name in the folder of runs, `@latest`, or a file of
    /// samples (`samples.parquet`).
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    /// Put pixels into bins of this quantity
    ///
    /// - `distance`: the ground-truth distance
    /// - `estimate`: the estimated distance
    /// - `error`: the absolute error, or with --relative the relative error
    /// - `weight`: the confidence that was recorded for a variant
    /// - `row`, `column`: the position in the image
    /// - `frame`: one bin per frame
    /// - any column of the samples, e.g. `full/weight.weight`
    #[arg(long, value_name = "QUANTITY", default_value = "distance", verbatim_doc_comment)]
    pub by: String,

    /// Set the bins: `width:2`, `linear:20`, `log:20`, `quantile:10`, `edges:0,5,10`.
    ///
    /// By default distances have bins of one metre, confidences ten bins, everything else twenty.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse)]
    pub bins: Option<Bins>,

    /// Print these percentiles of the error.
    #[arg(long, value_name = "P,...", value_delimiter = ',', default_value = "5,25,50,75,95")]
    pub percentiles: Vec<f64>,

    /// Use only these estimates, by label or name (default: all).
    ///
    /// `*` matches any characters, and commas separate several: `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub part: PartArgs,

    /// Use only these frames (default: all).
    ///
    /// They are numbers (`3`, `3,7`, `0..4`, `1..=40`), ids (`000150_10`), or a text file with one frame id per line.
    #[arg(long, value_name = "FRAMES", value_parser = FrameChoice::parse)]
    pub frames: Option<FrameChoice>,

    /// Use these pixel sets.
    ///
    /// `valid` is each estimate on its own valid pixels; `common` is the pixels that are valid in all estimates.
    /// Figures of errors (`depthloom figure`) show `common` by default.
    #[arg(long, value_enum, value_name = "PIXELS,...", value_delimiter = ',', default_value = "valid")]
    pub pixels: Vec<SampleSet>,

    /// Show errors as shares of the ground-truth distance (default: metres).
    #[arg(long)]
    pub relative: bool,

    /// Count errors above this limit as outliers: metres (`3m`) or a share (`25%`).
    ///
    /// A share is of the ground-truth distance.
    #[arg(long, value_name = "LIMIT", value_parser = Outlier::parse, default_value = "25%")]
    pub outlier: Outlier,

    /// Write `samples.parquet` and print no table.
    ///
    /// The file has one row per scored pixel: ground truth, every estimate, every recorded confidence. It is written
    /// into the run's folder, or to `--out`. With `--frames`, `--out` is required.
    #[arg(
        long,
        conflicts_with_all = ["by", "bins", "percentiles", "estimates", "variant", "stage", "pixels", "relative", "outlier", "caption", "label", "digits", "format"]
    )]
    pub samples_only: bool,

    /// Print only errors, with --samples-only.
    #[arg(long, short, requires = "samples_only", conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub typesetting: TypesettingArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    #[command(flatten)]
    pub output: TableOutputArgs,
}
