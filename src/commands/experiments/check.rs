//! `depthloom check`: is this experiment file right?

use std::collections::BTreeSet;
use std::path::Path;

use depthloom_graphs::plan::Plan;
use depthloom_graphs::{Registry, counted};
use depthloom_nodes::dora::KIND;
use depthloom_terminal::{CliError, ExitCode, print, print_json};
use schemars::JsonSchema;
use serde::Serialize;

use crate::allow_exec;
use crate::args::CheckArgs;
use crate::check_data::{self, CheckedSource};
use crate::experiment::load;
use crate::output;
use crate::output::diagnostics::{self, DiagnosticJson, Error, sarif};

/// Of `check`: the counts where the experiment is without error.
#[derive(Default, JsonSchema, Serialize)]
pub(crate) struct Check {
    /// The file.
    experiment: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    variants: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    stage_runs: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    nodes: Option<u64>,
    /// Nodes of the kind `dora`, as `stage.node`: `run` refuses them, and `depthloom dora` writes a dataflow that runs
    /// them.
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

/// Loads the experiment and prints a summary; with `--data` it also reads the frames.
pub(crate) fn check(args: &CheckArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let loaded = load(&args.experiment, registry, args.output.json || args.sarif);
    let experiment = &args.experiment.experiment;
    if args.data {
        allow_exec::decide(args.exec, loaded.as_ref().ok().map(|loaded| (experiment.as_path(), loaded)))?;
    }
    let workers = args.workers.map_or(depthloom_runner::Options::default().workers, usize::from);
    let data = match &loaded {
        Ok(loaded) if args.data => check_data::walk(&loaded.plan, registry, workers, args.output.json),
        _ => Vec::new(),
    };
    let faulty = check_data::stop(&data);
    match (loaded, args.sarif, args.output.json) {
        (Ok(loaded), true, _) => print_json(&sarif(experiment, &loaded.warnings)).map(|()| ExitCode::Success),
        (Err(stop), true, _) => print_json(&sarif(experiment, diagnostics::placed(&stop))).map(|()| stop.exit),
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
            output::print(&checked).map(|()| faulty.map_or(ExitCode::Success, |stop| stop.exit))
        }
        (Err(stop), _, true) => {
            let wrong = Check {
                experiment: experiment.to_string_lossy().into_owned(),
                diagnostics: diagnostics::placed(&stop).map(DiagnosticJson::from).collect(),
                error: Some(Error::from(&stop)),
                ..Check::default()
            };
            output::print(&wrong).map(|()| stop.exit)
        }
        (Ok(loaded), ..) => {
            for of in &data {
                of.warnings
                    .iter()
                    .for_each(|what| diagnostics::print_warning(&format!("source `{}`: {what}", of.name)));
            }
            print(summary(experiment, &loaded.plan, faulty.is_some()) + &check_data::text(&data))?;
            faulty.map_or(Ok(ExitCode::Success), Err)
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
