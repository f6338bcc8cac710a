//! `depthloom graph`: the plan as a drawing.

use depthloom_graphs::Registry;
use depthloom_graphs::language::Loaded;
use depthloom_terminal::{CliError, ExitCode, print};

use crate::args::{GraphArgs, GraphFormat};
use crate::experiment::load;
use crate::output;

pub(crate) fn graph(args: &GraphArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let Loaded { plan, .. } = load(&args.experiment, registry, true)?;
    if args.json {
        output::print(&plan.graph_json())?;
        return Ok(ExitCode::Success);
    }
    print(match args.format {
        GraphFormat::Mermaid => plan.mermaid(),
        GraphFormat::Dot => plan.dot(),
    })?;
    Ok(ExitCode::Success)
}
