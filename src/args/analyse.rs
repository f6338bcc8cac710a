//! Errors asked for.

use std::path::PathBuf;

use clap::Args;
use clap_complete::engine::ArgValueCompleter;
use depthloom_analysis::{Bins, Gross, SampleSet};

use super::{JsonArgs, PartArgs, RunArg, TableOutputArgs};
use crate::completion::{folders, runs};

#[derive(Debug, Args)]
#[command(after_help = examples![
    "samples @latest" => "samples.parquet into the run's folder",
    "samples RUN --out /data/samples.parquet" => "elsewhere",
])]
pub(crate) struct SamplesArgs {
    #[command(flatten)]
    pub run: RunArg,

    /// The file to write; by default `samples.parquet` in the run's folder.
    #[arg(long, short, value_name = "FILE", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Print nothing but errors.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

#[derive(Debug, Args)]
#[command(after_help = examples![
    "analyse @latest" => "error against distance, a metre a bin",
    "analyse @latest --bins log:12 --estimates '*/fused' --set common" => "of some estimates, on the pixels that are valid in all of them",
    "analyse @latest --by weight --percentiles 50,95" => "is a higher weight a smaller error?",
    "analyse one two --by frame --format csv --out frames.csv" => "two runs, frame by frame",
])]
pub(crate) struct AnalyseArgs {
    /// Runs: their folders, recordings, the beginnings of their names in `runs`, or `@latest`; also files of samples.
    #[arg(required = true, value_name = "RUN", add = ArgValueCompleter::new(runs))]
    pub runs: Vec<PathBuf>,

    /// What pixels are put into bins by: `distance` (the truth), `estimate` (the answer), `error` (its absolute error,
    /// with --relative its relative error), `weight` (the one recorded for a variant), `row`, `column`, `frame` (a bin
    /// a frame), or a column of the samples by its name, e.g. `full/weight.weight`.
    #[arg(long, value_name = "WHAT", default_value = "distance")]
    pub by: String,

    /// The bins: `width:2`, `linear:20`, `log:20`, `quantile:10` or `edges:0,5,10,20,80`. By default a metre wide of
    /// distances, tenths of weights, twenty of anything else.
    #[arg(long, value_name = "BINS", value_parser = Bins::parse)]
    pub bins: Option<Bins>,

    /// The percentiles of the error, with commas between.
    #[arg(long, value_name = "P,...", value_delimiter = ',', default_value = "5,25,50,75,95")]
    pub percentiles: Vec<f64>,

    /// Only estimates whose label or name this is; `*` stands for any run of characters, several have commas between:
    /// `fused`, `stereo,no_*/mono`.
    #[arg(long, value_name = "GLOB,...")]
    pub estimates: Option<String>,

    #[command(flatten)]
    pub part: PartArgs,

    /// Over which pixels; several with commas between.
    #[arg(long, value_enum, value_name = "SET,...", value_delimiter = ',', default_value = "valid")]
    pub set: Vec<SampleSet>,

    /// Errors as shares of the true distance, in place of metres.
    #[arg(long)]
    pub relative: bool,

    /// From where on an error is a gross one: metres (`3m`) or a share of the true distance (`25%`).
    #[arg(long, value_name = "LIMIT", value_parser = Gross::parse, default_value = "25%")]
    pub gross: Gross,

    #[command(flatten)]
    pub output: TableOutputArgs,
}
