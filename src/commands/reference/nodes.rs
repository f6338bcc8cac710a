//! `depthloom nodes`: the kinds of nodes and sources.

use depthloom_graphs::{Registry, render};
use depthloom_terminal::{CliError, ExitCode, print};

use crate::args::NodesArgs;
use crate::output;

pub(crate) fn nodes(args: &NodesArgs, registry: &Registry) -> Result<ExitCode, CliError> {
    let Some(kind) = &args.kind else {
        if args.output.json {
            output::print(&render::kinds_json(registry))?;
            return Ok(ExitCode::Success);
        }
        let sources = registry.sources().map(|s| (s.declaration.kind, "source", s.declaration.summary));
        let nodes =
            registry.nodes().map(|n| (n.declaration.kind, n.declaration.contract.name(), n.declaration.summary));
        let rows: Vec<_> = sources.chain(nodes).collect();
        let width = rows.iter().map(|(kind, ..)| kind.len()).max().unwrap_or(0);
        let list: String =
            rows.iter().map(|(kind, contract, about)| format!("{kind:width$}  {contract:7}  {about}\n")).collect();
        print(&list)?;
        return Ok(ExitCode::Success);
    };
    let answer = if args.output.json {
        render::kind_json(registry, kind).map(|json| output::text(&json))
    } else {
        render::kind_reference(registry, kind)
    };
    let Some(answer) = answer else {
        let known = registry.nodes().map(|n| n.declaration.kind).chain(registry.sources().map(|s| s.declaration.kind));
        let near = depthloom_graphs::language::nearest(kind, known);
        return Err(CliError::unknown(format!("there is no kind `{kind}`"), near, "`depthloom nodes` lists them all"));
    };
    print(&answer)?;
    Ok(ExitCode::Success)
}
