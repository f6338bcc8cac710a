//! Options of `evaluate`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;

use super::{JsonArgs, PageArgs, RunsFolder};
use crate::completion::folders;

/// What the numbers in the files are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum QuantityOption {
    /// Depth along the optical axis.
    Depth,
    /// Disparity of the left image.
    Disparity,
    /// 1 / depth.
    InverseDepth,
}

/// The unit of the numbers in the files, after the division.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum UnitOption {
    /// Of depth.
    Metres,
    /// Of depth.
    Millimetres,
    /// Of disparity: pixels of the file's map.
    Pixels,
    /// Of disparity: share of the image's width.
    Share,
}

/// A known protocol: metrics, limits of depth, crop, alignment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProtocolOption {
    /// The eight metrics of Martins et al. 2018, up to 80 m.
    #[default]
    Martins2018,
    /// Those of Godard et al. (monodepth2): crop of Garg, median scaling, up to 80 m.
    Monodepth2,
    /// Crop of Eigen et al. 2014, up to 80 m.
    Eigen,
    /// Crop of Garg et al. 2016, up to 80 m.
    Garg,
    /// The depth benchmark of KITTI (2017).
    KittiDepth,
    /// NYU Depth V2: up to 10 m.
    Nyu,
    /// Disparity errors of KITTI stereo 2015: end-point error and D1.
    KittiStereo,
    /// Disparity errors of Middlebury: end-point error and bad-0.5 to bad-4.
    Middlebury,
}

impl ProtocolOption {
    /// Whether it scores disparities and not depths.
    pub(crate) const fn is_of_disparity(self) -> bool {
        matches!(self, Self::KittiStereo | Self::Middlebury)
    }
}

/// How estimates without a metric scale are aligned, frame by frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum AlignOption {
    /// Not at all.
    None,
    /// By the ratio of medians.
    Median,
    /// By a least-squares fit of scale and shift in inverse depth.
    ScaleAndShift,
}

/// How maps of another size are resized.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ResizeOption {
    /// For sparse maps.
    Nearest,
    /// For dense maps.
    Bilinear,
}

/// How files are matched to frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum MatchOption {
    /// By the frame's id in the file's name, or its number; by order, with a warning, where no name matches.
    #[default]
    Id,
    /// By order: the first file belongs to the first frame.
    Order,
}

/// A value for one estimate (`NAME=VALUE`), or for all.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ForEstimate<T> {
    pub name: Option<String>,
    pub value: T,
}

impl<T> ForEstimate<T> {
    /// The last value for an estimate, or else the last one for all.
    pub(crate) fn value_for<'a>(values: &'a [Self], name: &str) -> Option<&'a T> {
        let named = values.iter().rfind(|value| value.name.as_deref() == Some(name));
        named.or_else(|| values.iter().rfind(|value| value.name.is_none())).map(|value| &value.value)
    }
}

fn for_estimate<T>(text: &str, parse: impl Fn(&str) -> Result<T, String>) -> Result<ForEstimate<T>, String> {
    let (name, value) = match text.split_once('=') {
        Some((name, value)) => (Some(name.to_owned()), value),
        None => (None, text),
    };
    parse(value).map(|value| ForEstimate { name, value })
}

fn choice<T: ValueEnum>(text: &str) -> Result<ForEstimate<T>, String> {
    for_estimate(text, |value| {
        T::from_str(value, false).map_err(|_| {
            let names: Vec<String> = T::value_variants()
                .iter()
                .filter_map(|value| Some(value.to_possible_value()?.get_name().to_owned()))
                .collect();
            format!("`{value}` is not one of {}", names.join(", "))
        })
    })
}

fn number(text: &str) -> Result<ForEstimate<f64>, String> {
    for_estimate(text, |value| value.parse().map_err(|_| format!("`{value}` is not a number")))
}

fn word(text: &str) -> Result<ForEstimate<String>, String> {
    for_estimate(text, |value| Ok(value.to_owned()))
}

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/predictions.md",
    "evaluate --ground-truth kitti/stereo2015:street mine='preds/*.png'" => "metrics of depths or disparities on disk",
    "evaluate --ground-truth kitti/stereo2015:street sgbm='sgbm/*.png' mine='preds/*.png' --baseline sgbm" => "compare two programs",
    "evaluate --ground-truth kitti/stereo2015:street mine='preds/*.png' --print-yaml" => "the equivalent experiment",
])]
pub(crate) struct EvaluateArgs {
    /// Evaluate these predictions: a name, and the files or one array of all frames
    ///
    /// - `mine='preds/*.npy'`: one file per frame; `*` stands for any text within a name
    /// - `mine=preds.npy`: one NPY or NPZ array of all frames (frames x rows x columns)
    ///
    /// Formats: PNG, TIFF, PNM, PFM, NPY, NPZ and EXR.
    #[arg(required = true, value_name = "NAME=FILES", verbatim_doc_comment)]
    pub predictions: Vec<String>,

    /// Use this data set: a kind of source and its folder.
    ///
    /// `depthloom nodes` lists the kinds; `depthloom inspect FOLDER` shows which kind a folder is.
    #[arg(long, value_name = "KIND:FOLDER")]
    pub ground_truth: String,

    /// Set a parameter of the source: `split=training`. Can be repeated.
    #[arg(long = "with", value_name = "KEY=VALUE")]
    pub with: Vec<String>,

    /// Evaluate these frames, as the source's parameter `frames` (default: all).
    #[arg(long, value_name = "FRAMES")]
    pub frames: Option<String>,

    /// State what the numbers are (default: detected): `depth`, `disparity` or `inverse-depth`.
    ///
    /// `mine=disparity` is for one estimate; so are `--unit mine=share`, and the like.
    #[arg(long, value_name = "[NAME=]QUANTITY", value_parser = choice::<QuantityOption>)]
    pub quantity: Vec<ForEstimate<QuantityOption>>,

    /// State the unit (default: detected): `metres`, `millimetres`, `pixels` or `share` (of the image's width).
    #[arg(long, value_name = "[NAME=]UNIT", value_parser = choice::<UnitOption>)]
    pub unit: Vec<ForEstimate<UnitOption>>,

    /// Divide the numbers by this (default: detected), e.g. 256 for KITTI's PNG.
    #[arg(long, value_name = "[NAME=]NUMBER", value_parser = number)]
    pub divide_by: Vec<ForEstimate<f64>>,

    /// Treat this number as invalid, beside NaN and infinity.
    ///
    /// Depths and disparities that are not above 0 are invalid, too. In inverse depth they are the largest depth, or
    /// what `--align scale-and-shift` makes of them.
    #[arg(long, value_name = "[NAME=]NUMBER", value_parser = number, allow_hyphen_values = true)]
    pub invalid: Vec<ForEstimate<f64>>,

    /// Read this array of NPZ files, or this channel of EXR files (default: the only one).
    #[arg(long, value_name = "[NAME=]ARRAY", value_parser = word)]
    pub array: Vec<ForEstimate<String>>,

    /// Resize maps of another size than the image (default: an error).
    #[arg(long, value_enum, value_name = "METHOD")]
    pub resize: Option<ResizeOption>,

    /// Match files to frames by this.
    #[arg(long = "match", value_enum, value_name = "WHAT", default_value = "id")]
    pub match_by: MatchOption,

    /// Use the metrics and limits of this protocol.
    #[arg(long, value_enum, value_name = "PROTOCOL", default_value = "martins2018")]
    pub protocol: ProtocolOption,

    /// Align estimates frame by frame (default: that of the protocol).
    #[arg(long, value_enum, value_name = "METHOD")]
    pub align: Option<AlignOption>,

    /// Compare with this estimate: intervals and tests of the differences.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["json", "print_yaml"])]
    pub baseline: Option<String>,

    /// Print the equivalent experiment, and run nothing.
    #[arg(long, conflicts_with = "json")]
    pub print_yaml: bool,

    /// Write to this folder (default: `<runs>/evaluate/<UTC time>`).
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Replace the output folder if it holds a run, finished or not.
    #[arg(long)]
    pub overwrite: bool,

    /// Set the number of worker threads (default: number of cores).
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    #[command(flatten)]
    pub page: PageArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Print only the run's folder.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}
