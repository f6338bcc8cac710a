//! `depthloom plan` and `depthloom graph`: what would be run, as a list and as a drawing.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use depthloom_graphs::Registry;
use depthloom_graphs::contracts::{Contract, InlineHost};
use depthloom_graphs::language::Loaded;
use depthloom_graphs::plan::{NodeId, NodeRef, Plan, RunId};
use depthloom_graphs::ready::Ready;
use depthloom_recording::{RecordedPlan, node_pairs};
use depthloom_runner::Foreseen;
use depthloom_runs::reuse;
use depthloom_terminal::{CliError, ExitCode, aligned, print};
use schemars::JsonSchema;
use serde::Serialize;

use super::cost;
use crate::allow_exec;
use crate::args::PlanArgs;
use crate::experiment::load;
use crate::output;
use crate::output::diagnostics::print_warning;

/// Output of `plan --reuse`: what a run would reuse from earlier runs.
#[derive(JsonSchema, Serialize)]
pub(crate) struct PlanReuse {
    /// The run that is nearest.
    nearest: Option<String>,
    nodes: Vec<ReusedNode>,
    warnings: Vec<String>,
}

/// How often a node would run.
#[derive(JsonSchema, Serialize)]
pub(crate) struct ReusedNode {
    pub(crate) stage: String,
    pub(crate) node: String,
    /// Those that use it; none where all do.
    pub(crate) variants: Vec<String>,
    pub(crate) runs: u64,
    pub(crate) taken: u64,
    /// Why it runs.
    pub(crate) why: Option<String>,
}

/// Prints every node of the plan, the variants that share it, and its node hash.
pub(crate) fn plan(args: &PlanArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let loaded = load(&args.experiment, registry, args.output.json)?;
    if args.cost {
        return cost::cost(args, loaded, registry);
    }
    if args.reuse {
        return reuse(args, loaded, registry);
    }
    let plan = loaded.plan;
    if args.output.json {
        output::print(&plan.summary_json())?;
    } else {
        print(plan.summary_text())?;
    }
    Ok(ExitCode::Success)
}

/// Prints which nodes would run, what would be reused from earlier runs, and why not all.
fn reuse(args: &PlanArgs, loaded: Loaded, registry: &Registry) -> Result<ExitCode, CliError> {
    allow_exec::decide(args.exec, Some((&args.experiment.experiment, &loaded)))?;
    let forecast = forecast(loaded.plan, registry, args.out.as_deref(), &args.folder.path())?;
    if !args.output.json {
        forecast.warnings.iter().for_each(|warning| print_warning(warning));
    }
    if args.output.json {
        let nodes = forecast.runs.into_iter().flat_map(|run| run.nodes).collect();
        let nearest = forecast.nearest.map(|path| path.to_string_lossy().into_owned());
        output::print(&PlanReuse { nearest, nodes, warnings: forecast.warnings })?;
        return Ok(ExitCode::Success);
    }
    let mut stages = String::new();
    for run in &forecast.runs {
        let line = |node: &ReusedNode| {
            let ReusedNode { node: name, variants, runs, taken, why, .. } = node;
            let does = match (runs, taken) {
                (0, 0) => "not needed".to_owned(),
                (0, _) => "taken".to_owned(),
                (_, 0) => "runs".to_owned(),
                _ => format!("taken {taken} of {} times", runs + taken),
            };
            [name.clone(), variants.join(", "), does, why.clone().unwrap_or_default()]
        };
        let lines: Vec<_> = run.nodes.iter().map(line).collect();
        let _ = write!(stages, "\nstage {}\n{}", run.prefix.trim_start_matches('/'), aligned(&lines, &[]));
    }
    let head = forecast.nearest.map_or_else(
        || "no earlier run has anything of this experiment".to_owned(),
        |path| format!("against {}", path.display()),
    );
    print(format!("{head}\n{stages}"))?;
    Ok(ExitCode::Success)
}

/// What a run would reuse.
pub(crate) struct Forecast {
    /// The run that is nearest.
    nearest: Option<PathBuf>,
    pub(crate) runs: Vec<ForecastRun>,
    warnings: Vec<String>,
}

/// A stage run.
pub(crate) struct ForecastRun {
    /// The prefix of its topics.
    prefix: String,
    pub(crate) nodes: Vec<ReusedNode>,
}

/// Determines what a run would reuse of the runs in `folder` and beside `out`. It opens the sources.
///
/// # Errors
/// What is missing on this machine.
pub(crate) fn forecast(
    plan: Plan,
    registry: &Registry,
    out: Option<&Path>,
    folder: &Path,
) -> Result<Forecast, CliError> {
    let ready = Ready::new(plan, registry).map_err(|missing| CliError::of_missing(&missing))?;
    let plan = ready.plan.clone();
    let earlier = reuse::beside(out, folder, &plan);
    let warnings = reuse::unreadable(&earlier);
    let foreseen = depthloom_runner::foresee(&ready, &earlier, &InlineHost)
        .map_err(|what| CliError::new(ExitCode::Engine, format!("failed to determine what would be reused: {what}")))?;
    let nearest = earlier.nearest(&plan);
    let pairs = nearest.map(|(_, before)| node_pairs(before, &RecordedPlan::from_plan(&plan))).unwrap_or_default();
    let why = |node: NodeRef, foreseen: Foreseen| {
        let pair = pairs.iter().find(|pair| pair.after == Some(node))?;
        match (pair.before, pair.differences.as_slice()) {
            (None, _) => Some("is new".to_owned()),
            (Some(_), []) => Some(why_equal_nodes_run(plan.runs[node.run].nodes[node.node].contract, foreseen)),
            (Some(_), differences) => Some(differences.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")),
        }
    };
    let mut runs = Vec::new();
    for (run, (planned, foreseen_nodes)) in RunId::enumerate(plan.runs.iter().zip(&foreseen)) {
        let mut nodes = Vec::new();
        for (node, (planned, foreseen)) in NodeId::enumerate(planned.nodes.iter().zip(foreseen_nodes)) {
            let Foreseen { fires, taken, .. } = *foreseen;
            let why = if fires > 0 { why(NodeRef { run, node }, *foreseen) } else { None };
            let variants = planned.variant_names(&plan);
            nodes.push(ReusedNode {
                stage: plan.runs[run].stage.clone(),
                node: planned.name.clone(),
                variants: variants.iter().map(|&name| name.to_owned()).collect(),
                runs: fires,
                taken,
                why,
            });
        }
        runs.push(ForecastRun { prefix: plan.runs[run].prefix.clone(), nodes });
    }
    let nearest = nearest.map(|(path, _)| path.parent().unwrap_or(path).to_owned());
    Ok(Forecast { nearest, runs, warnings })
}

/// Why a node runs that is equal to one of an earlier run.
fn why_equal_nodes_run(contract: Contract, foreseen: Foreseen) -> String {
    let Foreseen { fires, known, .. } = foreseen;
    match contract {
        Contract::Ordered if known > 0 && known < fires => {
            format!("an ordered node runs on all frames: {known} of {fires} are known, the others are new")
        }
        Contract::Ordered if known > 0 => {
            "an ordered node runs on all frames: one of its values is not stored".to_owned()
        }
        Contract::Pure if known > 0 && known == fires => "its values were not recorded".to_owned(),
        Contract::Pure | Contract::Ordered | Contract::Once => "other frames".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::contracts::Contract;
    use depthloom_runner::Foreseen;

    use super::why_equal_nodes_run;

    #[test]
    fn an_ordered_node_that_runs_for_other_frames_is_not_explained_by_other_frames() {
        let why = |contract, fires, known| why_equal_nodes_run(contract, Foreseen { fires, taken: 0, known });
        assert!(why(Contract::Ordered, 4, 3).contains("3 of 4 are known"));
        assert!(why(Contract::Ordered, 4, 4).contains("is not stored"));
        assert_eq!(why(Contract::Pure, 4, 4), "its values were not recorded");
        assert_eq!([why(Contract::Ordered, 4, 0), why(Contract::Pure, 1, 0)], ["other frames"; 2]);
    }
}
