//! `depthloom lsp`: the language server of experiment files, on the standard streams.

use std::io::{self, BufReader, IsTerminal as _};

use depthloom_graphs::Registry;
use depthloom_graphs::language::Loaded;
use depthloom_lsp::ReusedNode;
use depthloom_terminal::{CliError, ExitCode, Problem, say};

use super::plan;
use crate::args::RunsFolder;

/// Serves an editor until it ends the conversation.
pub(crate) fn lsp(registry: &Registry) -> Result<ExitCode, CliError> {
    if io::stdin().is_terminal() {
        say("waiting for an editor on standard input; docs/how-to/editor.md shows how to set one up");
    }
    let reuse = |loaded: &Loaded| reused(loaded, registry);
    let is_orderly = depthloom_lsp::serve(registry, BufReader::new(io::stdin()), io::stdout(), &reuse);
    Ok(if is_orderly { ExitCode::Success } else { ExitCode::Engine })
}

/// What `plan --reuse` prints for each node. No permission is ever given, so no program starts.
fn reused(loaded: &Loaded, registry: &Registry) -> Result<Vec<ReusedNode>, String> {
    let forecast = plan::forecast(loaded.plan.clone(), registry, None, &RunsFolder::default_path());
    let forecast = forecast.map_err(|stop| {
        let text = |problem: &Problem| match problem {
            Problem::Placed(diagnostic) => diagnostic.message.clone(),
            Problem::Here(message) => message.what.clone(),
        };
        let problems: Vec<String> = stop.problems.iter().map(text).collect();
        if problems.is_empty() { stop.message.what } else { problems.join("; ") }
    })?;
    let node = |node: plan::ReusedNode| {
        let plan::ReusedNode { stage, node, variants, runs, taken, why } = node;
        let summary = match (runs, taken) {
            (0, 0) => "not needed".to_owned(),
            (0, taken) => format!("all {taken} results would be reused"),
            (runs, 0) => format!("would run {runs} times"),
            (runs, taken) => format!("{taken} of {} results would be reused", runs + taken),
        };
        let summary = why.map_or(summary.clone(), |why| format!("{summary} ({why})"));
        let summary = match variants.is_empty() {
            true => summary,
            false => format!("{}: {summary}", variants.join(", ")),
        };
        ReusedNode { stage, node, summary }
    };
    Ok(forecast.runs.into_iter().flat_map(|run| run.nodes).map(node).collect())
}
