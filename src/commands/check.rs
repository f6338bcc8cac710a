//! `depthloom check`: is this experiment file right?

use depthloom_graphs::Registry;
use depthloom_graphs::language::Loaded;

use crate::args::ExperimentArgs;
use crate::counted::counted;
use crate::diagnostics;
use crate::exit::{Exit, Stop};
use crate::streams::print;

/// Loads the experiment and says what it holds.
pub fn check(args: &ExperimentArgs, registry: &Registry) -> Result<Exit, Stop> {
    let Some(Loaded { plan, .. }) = load(args, registry, false)? else { return Ok(Exit::Before) };
    let nodes: usize = plan.runs.iter().map(|run| run.nodes.len()).sum();
    print(format!(
        "{}: right; {}, {}, {} after sharing\n",
        args.experiment.display(),
        counted(plan.variants.len() as u64, "variant"),
        counted(plan.runs.len() as u64, "stage run"),
        counted(nodes as u64, "node"),
    ))?;
    Ok(Exit::Whole)
}

/// Loads an experiment, printing every diagnostic (warnings not when `quiet`); `None` if there was an error.
pub fn load(args: &ExperimentArgs, registry: &Registry, quiet: bool) -> Result<Option<Loaded>, Stop> {
    let options = depthloom_graphs::language::Options { set: args.set.clone(), ..Default::default() };
    match depthloom_graphs::language::load(&args.experiment, registry, &options) {
        Ok(loaded) => {
            if !quiet {
                diagnostics::print(&loaded.warnings);
            }
            Ok(Some(loaded))
        }
        Err(found) => {
            diagnostics::print(&found);
            Ok(None)
        }
    }
}
