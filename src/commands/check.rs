//! `depthloom check`: is this experiment file right?

use std::collections::BTreeSet;
use std::io::{self, Read as _};
use std::path::Path;

use depthloom_graphs::language::{Diagnostic, Loaded, Severity};
use depthloom_graphs::plan::Plan;
use depthloom_graphs::{Registry, counted};
use depthloom_nodes::dora::KIND;
use depthloom_terminal::{Exit, Problem, Stop, print, print_json};
use schemars::JsonSchema;
use serde::Serialize;

use super::check_data::{self, CheckedSource};
use crate::allow_exec;
use crate::args::{CheckArgs, ExperimentArgs};
use crate::diagnostics::{self, DiagnosticJson, Error, sarif};
use crate::outputs::{self, CommandOutput, Output};

/// Of `check`: the counts where the experiment is without error.
#[derive(JsonSchema, Serialize)]
pub struct Check {
    /// The file.
    experiment: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    variants: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stage_runs: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    nodes: Option<u64>,
    /// Nodes of the kind `dora`, as `stage.node`: `run` refuses them, and `depthloom dora` writes a dataflow that runs them.
    #[serde(skip_serializing_if = "Option::is_none")]
    dora_nodes: Option<Vec<String>>,
    /// Errors and warnings, in the order of files and lines.
    diagnostics: Vec<DiagnosticJson>,
    /// With `--data`: the sources whose frames were read.
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<Vec<CheckedSource>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

impl CommandOutput for Check {
    const OUTPUT: Output = Output::Check;
}

/// Loads the experiment and says what it holds; with `--data` looks at its frames as well.
pub fn check(args: &CheckArgs, registry: &Registry) -> Result<Exit, Stop> {
    let loaded = load(&args.experiment, registry, args.json || args.sarif);
    let experiment = &args.experiment.experiment;
    if args.data {
        allow_exec::decide(args.exec, loaded.as_ref().ok().map(|loaded| (experiment.as_path(), loaded)))?;
    }
    let workers = args.workers.map_or(depthloom_runner::Options::default().workers, usize::from);
    let data = match &loaded {
        Ok(loaded) if args.data => check_data::walk(&loaded.plan, registry, workers, args.json),
        _ => Vec::new(),
    };
    let faulty = check_data::stop(&data);
    match (loaded, args.sarif, args.json) {
        (Ok(loaded), true, _) => print_json(&sarif(experiment, &loaded.warnings)).map(|()| Exit::Whole),
        (Err(stop), true, _) => print_json(&sarif(experiment, found(&stop))).map(|()| stop.exit),
        (Ok(loaded), _, true) => {
            let (variants, stage_runs, nodes) = counts(&loaded.plan);
            let checked = Check {
                experiment: experiment.to_string_lossy().into_owned(),
                variants: Some(variants as u64),
                stage_runs: Some(stage_runs as u64),
                nodes: Some(nodes as u64),
                dora_nodes: Some(dora_nodes(&loaded.plan).into_iter().collect()),
                diagnostics: loaded.warnings.iter().map(DiagnosticJson::from).collect(),
                data: args.data.then(|| data.iter().map(CheckedSource::from).collect()),
                error: faulty.as_ref().map(Error::from),
            };
            outputs::print(&checked).map(|()| faulty.map_or(Exit::Whole, |stop| stop.exit))
        }
        (Err(stop), _, true) => {
            let wrong = Check {
                experiment: experiment.to_string_lossy().into_owned(),
                variants: None,
                stage_runs: None,
                nodes: None,
                dora_nodes: None,
                diagnostics: found(&stop).map(DiagnosticJson::from).collect(),
                data: None,
                error: Some(Error::from(&stop)),
            };
            outputs::print(&wrong).map(|()| stop.exit)
        }
        (Ok(loaded), ..) => {
            for of in &data {
                of.warnings
                    .iter()
                    .for_each(|what| diagnostics::print_warning(&format!("source `{}`: {what}", of.name)));
            }
            print(summary(experiment, &loaded.plan, faulty.is_some()) + &check_data::text(&data))?;
            faulty.map_or(Ok(Exit::Whole), Err)
        }
        (Err(stop), ..) => Err(stop),
    }
}

/// How many variants, stage runs and nodes a plan has.
fn counts(plan: &Plan) -> (usize, usize, usize) {
    (plan.variants.len(), plan.runs.len(), plan.runs.iter().map(|run| run.nodes.len()).sum())
}

fn summary(experiment: &Path, plan: &Plan, are_data_wrong: bool) -> String {
    let (variants, runs, nodes) = counts(plan);
    let verdict = if are_data_wrong { "the experiment is right, its data are not" } else { "right" };
    let of_dora: Vec<String> = dora_nodes(plan).into_iter().map(|node| format!("`{node}`")).collect();
    let note = match of_dora.len() {
        0 => String::new(),
        count => format!(
            "note: `depthloom run` refuses {} of the kind `{KIND}` ({}); `depthloom dora` writes a dataflow that runs it\n",
            counted(count, "node"),
            of_dora.join(", ")
        ),
    };
    format!(
        "{}: {verdict}; {}, {}, {} after sharing\n{note}",
        experiment.display(),
        counted(variants, "variant"),
        counted(runs, "stage run"),
        counted(nodes, "node"),
    )
}

/// The nodes of the kind `dora`, which `run` refuses, as `stage.node`.
fn dora_nodes(plan: &Plan) -> BTreeSet<String> {
    let nodes = plan.runs.iter().flat_map(|run| run.nodes.iter().map(move |node| (run, node)));
    nodes.filter(|(_, node)| node.kind == KIND).map(|(run, node)| format!("{}.{}", run.stage, node.name)).collect()
}

/// What is wrong in the experiment.
fn found(stop: &Stop) -> impl Iterator<Item = &Diagnostic> {
    stop.problems.iter().filter_map(|problem| match problem {
        Problem::Placed(diagnostic) => Some(diagnostic),
        Problem::Here(..) => None,
    })
}

/// What stands for standard input in place of a file.
const STANDARD_INPUT: &str = "-";

/// The most bytes that are read from standard input: no experiment is larger.
const LARGEST: u64 = 64 << 20;

/// The text on standard input.
fn standard_input() -> Result<String, Stop> {
    let mut text = String::new();
    match io::stdin().lock().take(LARGEST).read_to_string(&mut text) {
        Ok(_) => Ok(text),
        Err(error) => Err(Stop::because(Exit::Before, "failed to read the experiment from standard input", &error)),
    }
}

/// That a command needs the experiment as a file.
pub fn is_file(args: &ExperimentArgs) -> Result<(), Stop> {
    if args.experiment != Path::new(STANDARD_INPUT) {
        return Ok(());
    }
    let what = "an experiment from standard input can be checked, planned and drawn, but not run";
    Err(Stop::new(Exit::Before, what).remedy("write it to a file, and name the file"))
}

/// Loads an experiment; prints what it warns of unless `quiet`.
pub fn load(args: &ExperimentArgs, registry: &Registry, quiet: bool) -> Result<Loaded, Stop> {
    let ExperimentArgs { set, matrix, variants, .. } = args.clone();
    let text = if args.experiment == Path::new(STANDARD_INPUT) { Some(standard_input()?) } else { None };
    let options = depthloom_graphs::language::Options { set, matrix, only: variants, text, ..Default::default() };
    match depthloom_graphs::language::load(&args.experiment, registry, &options) {
        Ok(loaded) => {
            if !quiet {
                diagnostics::print(&loaded.warnings);
            }
            Ok(loaded)
        }
        Err(found) => {
            let errors = found.iter().filter(|diagnostic| diagnostic.severity == Severity::Error).count();
            let what = format!("{} has {}", args.experiment.display(), counted(errors, "error"));
            Err(Stop::new(Exit::Before, what).problems(found.0.into_iter().map(Problem::Placed)))
        }
    }
}
