//! `depthloom nodes` and `depthloom schema`: what can stand in an experiment.

use depthloom_graphs::Registry;
use depthloom_graphs::render::{self, Nodes, NodesKind};
use depthloom_terminal::{Exit, Stop, print, print_json};

use crate::args::{NodesArgs, SchemaArgs};
use crate::outputs::{self, CommandOutput, Output};

impl CommandOutput for Nodes {
    const OUTPUT: Output = Output::Nodes;
}

impl CommandOutput for NodesKind {
    const OUTPUT: Output = Output::NodesKind;
}

/// Lists all kinds, or explains one.
pub fn nodes(args: &NodesArgs, registry: &Registry) -> Result<Exit, Stop> {
    let Some(kind) = &args.kind else {
        if args.json {
            outputs::print(&render::kinds_json(registry))?;
            return Ok(Exit::Whole);
        }
        let sources = registry.sources().map(|s| (s.declaration.kind, "source", s.declaration.summary));
        let nodes =
            registry.nodes().map(|n| (n.declaration.kind, n.declaration.contract.name(), n.declaration.summary));
        let rows: Vec<_> = sources.chain(nodes).collect();
        let width = rows.iter().map(|(kind, ..)| kind.len()).max().unwrap_or(0);
        let list: String =
            rows.iter().map(|(kind, contract, about)| format!("{kind:width$}  {contract:7}  {about}\n")).collect();
        print(&list)?;
        return Ok(Exit::Whole);
    };
    let answer = if args.json {
        render::kind_json(registry, kind).map(|json| outputs::text(&json))
    } else {
        render::kind_reference(registry, kind)
    };
    let Some(answer) = answer else {
        let known = registry.nodes().map(|n| n.declaration.kind).chain(registry.sources().map(|s| s.declaration.kind));
        let stop = Stop::new(Exit::Before, format!("there is no kind `{kind}`"));
        return Err(match depthloom_graphs::language::nearest(kind, known) {
            Some(near) => stop.remedy(format!("did you mean `{near}`? `depthloom nodes` lists them all")),
            None => stop.remedy("`depthloom nodes` lists them all"),
        });
    };
    print(&answer)?;
    Ok(Exit::Whole)
}

/// Prints the JSON Schema of experiment files, or of what a command prints with `--json`.
pub fn schema(args: &SchemaArgs, registry: &Registry) -> Result<Exit, Stop> {
    let schema = args.output.map_or_else(|| depthloom_graphs::language::schema(registry), Output::schema);
    print_json(&schema)?;
    Ok(Exit::Whole)
}
