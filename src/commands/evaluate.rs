//! `depthloom evaluate`: metrics of predictions on disk, without any YAML.
//!
//! The command finds the files of each frame, detects what their numbers are, and writes the experiment that a user
//! would have written; that experiment then runs like any other.

mod detect;
mod matching;
mod text;

use std::path::{Path, PathBuf};

use clap::Parser as _;
use depthloom_graphs::language::{self, Options};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::ready::Ready;
use depthloom_graphs::registry::SourceEntry;
use depthloom_graphs::{Context, Frame, Registry, Scratch, Source, Value};
use depthloom_runner::Unwatched;
use depthloom_terminal::{CliError, ExitCode, Problem, print, say};
use serde_json::{Map, Value as Json};

use self::detect::{Detected, Reference};
use self::matching::{Matched, match_files};
use self::text::experiment;
use crate::args::{
    Cli, Command, EvaluateArgs, ExecArgs, ExperimentArgs, ForEstimate, QuantityOption, RunArgs, SplitBy,
};
use crate::commands::analysis::compare;
use crate::execution::carry_out;
use crate::output::diagnostics::print_warning;
use crate::signals;

/// The name of the experiment, as messages show it.
const FILE: &str = "evaluate.yaml";

/// Frames that are searched for ground truth.
const MOST_TRIED: usize = 20;
/// Frames that a prediction is compared with, until one has numbers.
const MOST_COMPARED_FRAMES: usize = 5;

/// Words that mean something else in an experiment.
const RESERVED: [&str; 9] = ["source", "score", "null", "true", "false", "yes", "no", "on", "off"];

/// An estimate: its files and what their numbers are.
struct Prediction {
    name: String,
    matched: Matched,
    detected: Detected,
    invalid: Option<f64>,
    array: Option<String>,
    /// Warnings about its maps.
    noticed: Vec<String>,
}

/// The data set with the ground truth.
struct Target {
    kind: String,
    with: Map<String, Json>,
    source: Box<dyn Source>,
}

pub(crate) fn evaluate(args: &EvaluateArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let target = Target::open(args, registry)?;
    let references = target.with_ground_truth()?;
    let is_of_disparity = args.protocol.is_of_disparity();
    if is_of_disparity && args.align.is_some() {
        return Err(CliError::usage("--align is not part of a protocol of disparities", "leave it out"));
    }
    let mut predictions: Vec<Prediction> = Vec::new();
    for written in &args.predictions {
        let prediction = Prediction::new(args, written, &target, &references)?;
        let is_taken = |other: &Prediction| {
            let (one, two) = (&other.name, &prediction.name);
            one == two || *one == format!("{two}_disparity") || *two == format!("{one}_disparity")
        };
        if predictions.iter().any(is_taken) {
            let what = format!("the name `{}` is taken by another estimate", prediction.name);
            return Err(CliError::usage(what, "give every estimate a name of its own"));
        }
        if is_of_disparity && prediction.detected.quantity != QuantityOption::Disparity {
            let what = format!("`{}` is not a disparity, which this --protocol scores", prediction.name);
            return Err(CliError::usage(what, "set `--quantity disparity`, or choose another --protocol"));
        }
        predictions.push(prediction);
    }
    check_names(args, &predictions)?;
    let found: Vec<String> = predictions.iter().map(Prediction::text).collect();
    if !(args.quiet || args.output.json || args.print_yaml) {
        found.iter().for_each(say);
    }
    let warnings: Vec<String> = predictions.iter().flat_map(|prediction| prediction.warnings(args)).collect();
    if args.print_yaml {
        warnings.iter().for_each(|warning| print_warning(warning));
    }
    let yaml = experiment(args, &target, &target.read(references[0])?, &predictions)?;
    if args.print_yaml {
        print(yaml)?;
        return Ok(ExitCode::Success);
    }
    let options = Options { text: Some(yaml), ..Options::default() };
    let loaded = language::load(Path::new(FILE), registry, &options).map_err(|found| {
        let problems = found.0.into_iter().map(Problem::Placed);
        CliError::new(ExitCode::Usage, "the predictions cannot be evaluated like this").problems(problems)
    })?;
    let ready = Ready::new(loaded.plan.clone(), registry).map_err(|missing| CliError::of_missing(&missing))?;
    let interrupt = signals::listen("stopping: frames in flight are finished")?;
    let (exit, folder) = carry_out(&run_args(args), loaded, ready, &interrupt, None, &Unwatched, &warnings)?;
    match &args.baseline {
        Some(baseline) if predictions.len() > 1 && exit == ExitCode::Success => compare_with(baseline, &folder, exit),
        _ => Ok(exit),
    }
}

/// Prints the differences from the baseline.
fn compare_with(baseline: &str, folder: &Path, exit: ExitCode) -> Result<ExitCode, CliError> {
    let folder = folder.to_string_lossy();
    let line = ["depthloom", "compare", &folder, "--baseline", baseline];
    let parsed = Cli::try_parse_from(line).map_err(|error| CliError::new(ExitCode::Usage, error.to_string()))?;
    let Command::Compare(options) = parsed.command else { return Ok(exit) };
    say("");
    compare::compare(&options)?;
    Ok(exit)
}

fn run_args(args: &EvaluateArgs) -> RunArgs {
    RunArgs {
        experiment: ExperimentArgs {
            experiment: PathBuf::from(FILE),
            set: Vec::new(),
            matrix: Vec::new(),
            variants: Vec::new(),
        },
        out: args.out.clone(),
        overwrite: args.overwrite,
        fresh: false,
        audit: crate::args::AuditMode::Sample,
        durable: false,
        workers: args.workers,
        window: None,
        exec: ExecArgs::default(),
        keep_going: false,
        paper: false,
        samples: false,
        shard: None,
        by: SplitBy::default(),
        require_shards: false,
        page: args.page.clone(),
        folder: args.folder.clone(),
        quiet: args.quiet,
        output: args.output.clone(),
    }
}

/// Refuses options for estimates that do not exist.
fn check_names(args: &EvaluateArgs, predictions: &[Prediction]) -> Result<(), CliError> {
    let names: Vec<&str> = predictions.iter().map(|prediction| prediction.name.as_str()).collect();
    let given = |option: &'static str, name: &Option<String>| name.clone().map(|name| (option, name));
    let unknown = std::iter::empty()
        .chain(args.quantity.iter().filter_map(|value| given("--quantity", &value.name)))
        .chain(args.unit.iter().filter_map(|value| given("--unit", &value.name)))
        .chain(args.divide_by.iter().filter_map(|value| given("--divide-by", &value.name)))
        .chain(args.invalid.iter().filter_map(|value| given("--invalid", &value.name)))
        .chain(args.array.iter().filter_map(|value| given("--array", &value.name)))
        .chain(given("--baseline", &args.baseline))
        .find(|(_, name)| !names.contains(&name.as_str()));
    match unknown {
        Some((option, name)) => {
            let what = format!("{option} names `{name}`, which is not among the predictions: {}", names.join(", "));
            Err(CliError::usage(what, "correct the name"))
        }
        None => Ok(()),
    }
}

impl Target {
    fn open(args: &EvaluateArgs, registry: &Registry) -> Result<Self, CliError> {
        let Some((kind, root)) = args.ground_truth.split_once(':') else {
            let what = format!("--ground-truth is `{}`, expected KIND:FOLDER", args.ground_truth);
            return Err(CliError::usage(what, "write e.g. kitti/stereo2015:/data/kitti_stereo_2015"));
        };
        let kinds = || registry.sources().map(|source| source.declaration.kind).collect::<Vec<_>>().join(", ");
        let entry = registry.source_kind(kind).ok_or_else(|| {
            CliError::usage(format!("`{kind}` is not a kind of source"), format!("use one of {}", kinds()))
        })?;
        let mut with = Map::new();
        let takes = |name: &str| entry.schema["properties"].get(name).is_some();
        let folder = if takes("root") { "root" } else { "path" };
        if !root.is_empty() {
            with.insert(folder.to_owned(), root.into());
        }
        for written in &args.with {
            let Some((key, value)) = written.split_once('=') else {
                return Err(CliError::usage(
                    format!("--with is `{written}`, expected KEY=VALUE"),
                    "write split=training",
                ));
            };
            insert(&mut with, key, serde_json::from_str(value).unwrap_or_else(|_| value.into()));
        }
        let is_of_disparity = args.protocol.is_of_disparity();
        if is_of_disparity && takes("disparities") && !with.contains_key("disparities") {
            with.insert("disparities".to_owned(), true.into());
        }
        if let Some(frames) = &args.frames {
            with.insert("frames".to_owned(), serde_json::from_str(frames).unwrap_or_else(|_| frames.clone().into()));
        }
        let source = opened(entry, &with)?;
        if source.frames().is_empty() {
            return Err(CliError::usage(format!("{} has no frames", args.ground_truth), "correct --frames or --with"));
        }
        Ok(Self { kind: kind.to_owned(), with, source })
    }

    fn frames(&self) -> &[Frame] {
        self.source.frames()
    }

    fn read(&self, position: usize) -> Result<Reference, CliError> {
        let (host, mut scratch) = (depthloom_graphs::contracts::InlineHost, Scratch::default());
        let read = self.source.read(FrameIndex(position), &mut Context::new(&host, &mut scratch));
        let outputs = read.map_err(|fault| CliError::from_error(ExitCode::Usage, &fault))?.outputs;
        Ok(Reference::new(outputs.entries()))
    }

    fn image_size(&self, position: usize) -> Result<(u32, u32), CliError> {
        self.read(position).map(|frame| frame.size())
    }

    /// Positions of the first frames that have ground truth.
    fn with_ground_truth(&self) -> Result<Vec<usize>, CliError> {
        let mut found = Vec::new();
        for position in 0..self.frames().len().min(MOST_TRIED) {
            if self.read(position)?.has_ground_truth() {
                found.push(position);
            }
            // The later ones are for predictions without a valid number on the first.
            if found.len() == MOST_COMPARED_FRAMES {
                break;
            }
        }
        if found.is_empty() {
            return Err(CliError::usage(
                "the first frames have no ground truth",
                "choose other frames, or set the source's parameters for ground truth by --with",
            ));
        }
        Ok(found)
    }
}

/// Inserts a value at a path with dots.
fn insert(with: &mut Map<String, Json>, key: &str, value: Json) {
    match key.split_once('.') {
        None => drop(with.insert(key.to_owned(), value)),
        Some((outer, rest)) => {
            let inner = with.entry(outer.to_owned()).or_insert_with(|| Json::Object(Map::new()));
            if let Json::Object(inner) = inner {
                insert(inner, rest, value);
            }
        }
    }
}

fn opened(entry: &SourceEntry, with: &Map<String, Json>) -> Result<Box<dyn Source>, CliError> {
    let resolved = entry.resolve(&Json::Object(with.clone())).map_err(|error| {
        let place = if error.path.is_empty() { "--with".to_owned() } else { error.path.join(".") };
        CliError::usage(
            format!("{}: {place}: {}", entry.declaration.kind, error.what),
            "correct --ground-truth, --frames or --with",
        )
    })?;
    entry.open(&resolved).map_err(|fault| CliError::from_error(ExitCode::Usage, &fault))
}

impl Prediction {
    fn new(args: &EvaluateArgs, written: &str, target: &Target, references: &[usize]) -> Result<Self, CliError> {
        let Some((name, pattern)) = written.split_once('=') else {
            let what = format!("`{written}` has no name");
            return Err(CliError::usage(what, format!("write NAME=FILES, e.g. mine='{written}'")));
        };
        let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if !name.starts_with(|c: char| c.is_ascii_lowercase()) || !name.chars().all(is_name) {
            let what = format!("`{name}` is not a name of an estimate");
            return Err(CliError::usage(what, "use lower-case letters, digits and `_`, and begin with a letter"));
        }
        if RESERVED.contains(&name) {
            return Err(CliError::usage(format!("`{name}` is not a name of an estimate"), "choose another name"));
        }
        let array = ForEstimate::value_for(&args.array, name).cloned();
        let matched = match_files(args, name, pattern, array.as_deref(), target.frames())?;
        let invalid = ForEstimate::value_for(&args.invalid, name).copied();
        let noticed = matched.check(args, name, (array.as_deref(), invalid), target)?;
        let mut detected = Detected::default();
        for &position in references {
            let map = matched.map(position, array.as_deref())?;
            detected = detect::detect(args, name, &map, invalid, &target.read(position)?)?;
            if detected.is_compared() {
                break;
            }
        }
        Ok(Self { name: name.to_owned(), matched, detected, invalid, array, noticed })
    }

    /// What was found, in one line.
    fn text(&self) -> String {
        format!("{}: {}; {}", self.name, self.matched.text(), self.detected.text())
    }

    fn warnings(&self, args: &EvaluateArgs) -> Vec<String> {
        let warnings =
            self.detected.warnings(args).into_iter().chain(self.noticed.clone()).chain(self.matched.warnings());
        warnings.map(|warning| format!("{}: {warning}", self.name)).collect()
    }
}

/// A value's depth or disparity, for comparison.
fn numbers(value: &Value) -> Option<&[f32]> {
    match value {
        Value::TrueDisparity(disparity) => Some(&disparity.px),
        other => other.metres().map(|metres| metres.as_raw().as_slice()),
    }
}
