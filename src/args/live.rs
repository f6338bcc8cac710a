//! Options of `live`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use clap_complete::engine::ArgValueCompleter;
use depthloom_terminal::{parse_duration, parse_size};

use super::{ExecArgs, ExperimentArgs, JsonArgs, RunsFolder};
use crate::completion::folders;

#[derive(Debug, Args)]
#[command(after_long_help = examples![
    guide: "how-to/robot.md",
    "live first.yaml --allow-drops" => "its last stage, at the time stamps of its source",
    "live first.yaml --rate 25 --for 20s --deadline 60ms --no-drop" => "a data set as a camera, with a deadline",
    "live first.yaml --allow-drops --keep 30s --on SIGUSR1" => "write the last 30 s when the signal arrives",
])]
pub(crate) struct LiveArgs {
    #[command(flatten)]
    pub experiment: ExperimentArgs,

    /// Run this stage live (default: the last one).
    ///
    /// Stages before it run first, or their networks are reused from earlier runs. Their maps are not recorded. Stages
    /// after it do not run.
    #[arg(long, value_name = "STAGE")]
    pub stage: Option<String>,

    /// Play a data set at N frames per second (default: at its time stamps).
    #[arg(long, value_name = "N", value_parser = parse_rate)]
    pub rate: Option<f64>,

    /// Stop after this time: `20s`, `500ms`, `10min`, `2h` (default: at the end of the stream).
    ///
    /// It counts from the second frame: on the first one, nodes build their networks.
    #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
    pub duration: Option<Duration>,

    /// Read N frames of a data set into memory before the first one is played (default: 0).
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub preload: usize,

    /// Repeat a data set when all its frames were played.
    #[arg(long)]
    pub repeat: bool,

    /// Count frames whose latency exceeds this time: `60ms`.
    #[arg(long, value_name = "TIME", value_parser = parse_duration)]
    pub deadline: Option<Duration>,

    /// Let the source wait instead of dropping frames.
    #[arg(long)]
    pub no_drop: bool,

    /// Exit with 0 although frames were dropped.
    #[arg(long, conflicts_with = "no_drop")]
    pub allow_drops: bool,

    /// Score the estimates, if the source has ground truth.
    ///
    /// Without it, ground truth is hidden: a camera does not measure it.
    #[arg(long)]
    pub scores: bool,

    /// Record nothing.
    #[arg(long, conflicts_with_all = ["out", "overwrite", "durable", "scores"])]
    pub no_record: bool,

    /// Keep the last frames in memory only: `30s`.
    ///
    /// The signal of `--on` writes them to `kept-0001.mcap` and so on, in the folder of `--out`. At most 512 MiB are
    /// kept.
    #[arg(long, value_name = "TIME", value_parser = parse_duration, conflicts_with_all = ["no_record", "overwrite", "durable", "scores"])]
    pub keep: Option<Duration>,

    /// Write the kept frames on this signal (default: `SIGUSR1`).
    #[arg(
        long,
        value_enum,
        value_name = "SIGNAL",
        requires = "keep",
        default_value = "SIGUSR1",
        hide_default_value = true
    )]
    pub on: TriggerSignal,

    /// Serve the values to Foxglove and other viewers at this address: `127.0.0.1:8765`.
    ///
    /// The program must be built with the feature `serve`. A slow viewer misses frames, and never slows the run.
    #[arg(long, value_name = "ADDRESS")]
    pub serve: Option<String>,

    /// Serve only these topics (default: all). Can be repeated.
    ///
    /// `*` matches any characters: `--topic '*/fused/*'`. `depthloom plan` lists the topics.
    #[arg(long = "topic", value_name = "GLOB", requires = "serve")]
    pub topics: Vec<String>,

    /// Write to this folder (default: `<runs>/<experiment>/<UTC time>`).
    ///
    /// `<runs>` is the folder of `--runs`.
    #[arg(long, short, value_name = "DIR", add = ArgValueCompleter::new(folders()))]
    pub out: Option<PathBuf>,

    /// Replace the output folder if it holds a run, finished or not.
    #[arg(long)]
    pub overwrite: bool,

    /// Wait for the disk after every frame.
    ///
    /// After a power cut, no frame that was written is lost.
    #[arg(long)]
    pub durable: bool,

    /// Set the number of worker threads (default: number of cores).
    #[arg(long, short = 'j', value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub workers: Option<u16>,

    /// Limit the frames in flight (default: workers + 2).
    ///
    /// Without the option, fewer are in flight while frames are dropped, as long as that keeps the rate. Latency is
    /// then lower.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub window: Option<u16>,

    #[command(flatten)]
    pub limits: LimitArgs,

    #[command(flatten)]
    pub exec: ExecArgs,

    #[command(flatten)]
    pub folder: RunsFolder,

    /// Print lines instead of the display.
    #[arg(long)]
    pub plain: bool,

    /// Print only the run's folder.
    #[arg(long, short, conflicts_with = "json")]
    pub quiet: bool,

    #[command(flatten)]
    pub output: JsonArgs,
}

/// The signal that writes the kept frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum TriggerSignal {
    /// The first user-defined signal.
    #[value(name = "SIGUSR1")]
    User1,
    /// The second user-defined signal.
    #[value(name = "SIGUSR2")]
    User2,
}

/// What the process takes of the machine.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct LimitArgs {
    /// Lower the priority of this process by N (default: 0).
    ///
    /// Negative numbers raise it, which needs the right to do so.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(i32).range(-20..=19))]
    pub nice: Option<i32>,

    /// Run on these cores only: `0-1` or `0,2` (default: all).
    #[arg(long, value_name = "LIST", value_parser = parse_cores)]
    pub cores: Option<Cores>,

    /// Limit the memory of this process: `2GB` (default: no limit).
    ///
    /// It limits the address space. Where it is exceeded, the program ends with a message, and what was recorded stays.
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub memory: Option<u64>,
}

/// The numbers of cores.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Cores(pub(crate) Vec<usize>);

fn parse_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok().filter(|rate| (0.001..=10_000.0).contains(rate));
    rate.ok_or_else(|| "expected frames per second, 0.001 to 10000".to_owned())
}

fn parse_cores(text: &str) -> Result<Cores, String> {
    let expected = || "expected numbers of cores such as 0-1 or 0,2".to_owned();
    let number = |text: &str| text.trim().parse::<usize>().ok().filter(|core| *core < 1024).ok_or_else(expected);
    let mut cores = Vec::new();
    for part in text.split(',') {
        match part.split_once('-') {
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                if first > last {
                    return Err(expected());
                }
                cores.extend(first..=last);
            }
            None => cores.push(number(part)?),
        }
    }
    Ok(Cores(cores))
}

#[cfg(test)]
mod tests {
    use super::{Cores, parse_cores, parse_rate};

    #[test]
    fn cores_are_numbers_and_ranges() {
        assert_eq!(parse_cores("0-2,5"), Ok(Cores(vec![0, 1, 2, 5])));
        for wrong in ["", "a", "2-1", "0-", "99999"] {
            assert!(parse_cores(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rates_are_positive() {
        assert_eq!(parse_rate("29.97"), Ok(29.97));
        for wrong in ["0", "-1", "inf", "nan", "1e9"] {
            assert!(parse_rate(wrong).is_err(), "{wrong}");
        }
    }
}
