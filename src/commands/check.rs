//! `depthloom check`: is this experiment file right?

use std::path::Path;

use depthloom_graphs::Registry;
use depthloom_graphs::language::{Diagnostic, Loaded, Severity};
use depthloom_graphs::plan::Plan;
use serde_json::json;

use crate::args::{CheckArgs, ExperimentArgs};
use crate::counted::counted;
use crate::diagnostics::{self, error_json, list_json, sarif};
use crate::exit::{Exit, Problem, Stop};
use crate::streams::{print, print_json};

/// Loads the experiment and says what it holds.
pub fn check(args: &CheckArgs, registry: &Registry) -> Result<Exit, Stop> {
    let loaded = load(&args.experiment, registry, args.json || args.sarif);
    let experiment = &args.experiment.experiment;
    match (loaded, args.sarif, args.json) {
        (Ok(loaded), true, _) => print_json(&sarif(experiment, &loaded.warnings)).map(|()| Exit::Whole),
        (Err(stop), true, _) => print_json(&sarif(experiment, found(&stop))).map(|()| stop.exit),
        (Ok(loaded), _, true) => {
            let (variants, stage_runs, nodes) = counts(&loaded.plan);
            let right = json!({
                "experiment": experiment.to_string_lossy(),
                "variants": variants,
                "stage_runs": stage_runs,
                "nodes": nodes,
                "diagnostics": list_json(&loaded.warnings),
            });
            print_json(&right).map(|()| Exit::Whole)
        }
        (Err(stop), _, true) => {
            let wrong = json!({
                "experiment": experiment.to_string_lossy(),
                "diagnostics": list_json(found(&stop)),
                "error": error_json(&stop),
            });
            print_json(&wrong).map(|()| stop.exit)
        }
        (Ok(loaded), ..) => print(summary(experiment, &loaded.plan)).map(|()| Exit::Whole),
        (Err(stop), ..) => Err(stop),
    }
}

/// How many variants, stage runs and nodes a plan has.
fn counts(plan: &Plan) -> (usize, usize, usize) {
    (plan.variants.len(), plan.runs.len(), plan.runs.iter().map(|run| run.nodes.len()).sum())
}

fn summary(experiment: &Path, plan: &Plan) -> String {
    let (variants, runs, nodes) = counts(plan);
    format!(
        "{}: right; {}, {}, {} after sharing\n",
        experiment.display(),
        counted(variants as u64, "variant"),
        counted(runs as u64, "stage run"),
        counted(nodes as u64, "node"),
    )
}

/// What is wrong in the experiment.
fn found(stop: &Stop) -> impl Iterator<Item = &Diagnostic> {
    stop.problems.iter().filter_map(|problem| match problem {
        Problem::Placed(diagnostic) => Some(diagnostic),
        Problem::Here(..) => None,
    })
}

/// Loads an experiment; prints what it warns of unless `quiet`.
pub fn load(args: &ExperimentArgs, registry: &Registry, quiet: bool) -> Result<Loaded, Stop> {
    let ExperimentArgs { set, matrix, variants, .. } = args.clone();
    let options = depthloom_graphs::language::Options { set, matrix, only: variants, ..Default::default() };
    match depthloom_graphs::language::load(&args.experiment, registry, &options) {
        Ok(loaded) => {
            if !quiet {
                diagnostics::print(&loaded.warnings);
            }
            Ok(loaded)
        }
        Err(found) => {
            let errors = found.iter().filter(|diagnostic| diagnostic.severity == Severity::Error).count();
            let what = format!("{} has {}", args.experiment.display(), counted(errors as u64, "error"));
            Err(Stop::new(Exit::Before, what).problems(found.0.into_iter().map(Problem::Placed)))
        }
    }
}
