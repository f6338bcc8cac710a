//! `depthloom dora`: an experiment as a dataflow of dora's.

use std::ffi::OsString;
use std::path::Path;

use depthloom_dora::{DataflowOptions, Layout, dataflow, print_of, too_large};
use depthloom_graphs::Registry;
use depthloom_graphs::plan::Plan;
use depthloom_nodes::dora::{DoraParams, KIND};
use depthloom_terminal::{CliError, ExitCode, print_quoted};

use crate::allow_exec;
use crate::args::DoraArgs;
use crate::experiment::{is_file, load};
use crate::output::diagnostics::print_warning;

pub(crate) fn dora(args: &DoraArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    is_file(&args.run.experiment)?;
    if args.run.shard.is_some() || args.run.require_shards {
        return Err(CliError::usage(
            "a dataflow computes everything: --shard and --require-shards are options of `run`",
            "leave them out",
        ));
    }
    let loaded = load(&args.run.experiment, registry, false)?;
    allow_exec::decide(args.run.exec, Some((&args.run.experiment.experiment, &loaded)))?;
    let plan = loaded.plan;
    may_start(&plan)?;
    let layout = Layout::from_plan(&plan);
    let wanted = DataflowOptions {
        program: text(std::env::current_exe().map_err(|error| before("failed to find this program", &error))?)?,
        arguments: arguments(&plan)?,
        // A node sends at most one message per frame, and one more at the end.
        queue: args.window() + 8,
        machines: args.machines.clone(),
    };
    let dataflow = dataflow(&plan, &layout, &wanted).map_err(|pattern| {
        let ids: Vec<&str> = layout.parts.iter().map(|part| part.id.as_str()).collect();
        CliError::usage(
            format!("--machine names `{pattern}`, which is not a node of the dataflow"),
            format!("its nodes are {}", ids.join(", ")),
        )
    })?;
    if let Some(warning) = too_large(&dataflow) {
        print_warning(&warning);
    }
    print_quoted(&dataflow).map(|()| ExitCode::Success)
}

fn before(intent: &str, error: &dyn std::error::Error) -> CliError {
    CliError::because(ExitCode::Usage, intent, error)
}

fn text(words: impl Into<OsString>) -> Result<String, CliError> {
    words.into().into_string().map_err(|words| {
        CliError::new(ExitCode::Usage, format!("{} is not UTF-8, but a dataflow must be", Path::new(&words).display()))
    })
}

/// Checks the permission to start programs, because a dataflow starts them.
fn may_start(plan: &Plan) -> Result<(), CliError> {
    for (run, node) in plan.runs.iter().flat_map(|run| run.nodes.iter().map(move |node| (run, node))) {
        if node.kind == KIND
            && let Ok(params) = serde_json::from_value::<DoraParams>(node.params.clone())
            && let Err(fault) = params.ask()
        {
            let intent = format!("node `{}.{}` ({KIND})", run.stage, node.name);
            return Err(CliError::remedied(ExitCode::Usage, intent, &fault));
        }
    }
    Ok(())
}

/// The arguments of every node besides its name: those of this command.
fn arguments(plan: &Plan) -> Result<Vec<String>, CliError> {
    let folder = std::env::current_dir().map_err(|error| before("failed to find the current folder", &error))?;
    let mut words = vec!["--plan".to_owned(), print_of(plan).to_string(), "--folder".to_owned(), text(folder)?];
    // Options of the program are in front of its command, and none of them has a value of that name.
    let mut words_of_command = std::env::args_os().skip_while(|word| word != "dora").skip(1);
    while let Some(word) = words_of_command.next() {
        let word = text(word)?;
        // Only dora needs to know where a node runs.
        if word == "--machine" {
            words_of_command.next();
        } else if !word.starts_with("--machine=") {
            words.push(word);
        }
    }
    Ok(words)
}
