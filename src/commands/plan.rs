//! `depthloom plan` and `depthloom graph`: what would be run, as a list and as a drawing.

use depthloom_graphs::Registry;
use depthloom_graphs::language::Loaded;

use super::check::load;
use crate::args::{GraphArgs, GraphFormat, PlanArgs};
use crate::exit::{Exit, Stop};
use crate::streams::{print, print_json};

/// Prints every node of the plan, the variants that share it, and its recipe.
pub fn plan(args: &PlanArgs, registry: &Registry) -> Result<Exit, Stop> {
    let Loaded { plan, .. } = load(&args.experiment, registry, args.json)?;
    if args.json {
        print_json(&plan.summary_json())?;
    } else {
        print(plan.summary_text())?;
    }
    Ok(Exit::Whole)
}

/// Prints the plan as a drawing.
pub fn graph(args: &GraphArgs, registry: &Registry) -> Result<Exit, Stop> {
    let Loaded { plan, .. } = load(&args.experiment, registry, true)?;
    if args.json {
        print_json(&plan.graph_json())?;
        return Ok(Exit::Whole);
    }
    print(match args.format {
        GraphFormat::Mermaid => plan.mermaid(),
        GraphFormat::Dot => plan.dot(),
    })?;
    Ok(Exit::Whole)
}
