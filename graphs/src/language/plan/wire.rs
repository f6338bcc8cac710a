//! One wire: the output a reference names, and whether it fits the input it is wired to.

use super::linked::Wire;
use super::stage_names::StageNames;
use crate::contracts::{Contract, Port, Rate, Signature, SwitchedOff};
use crate::language::check::params::Resolver;
use crate::language::check::reference::Reference;
use crate::language::check::score;
use crate::language::check::spec::{InputSpec, Wired};
use crate::language::ids::{StageId, StageNode};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::paths;
use crate::language::text::tree::Node;
use crate::plan::PortId;
use crate::registry::NodeKind;
use crate::values::ValueType;

pub(crate) struct Reachable<'r, 's, 'n> {
    pub(crate) stages: &'n [StageNames<'r, 's>],
    pub(crate) stage: StageId,
}

pub(crate) struct Output<'n> {
    wire: Wire,
    port: &'n Port,
    stage: StageId,
}

impl<'r> Reachable<'r, '_, '_> {
    pub(crate) fn read(&self, reference: &Reference) -> Option<StageNode> {
        let stage = self.stage_of(reference)?;
        Some(StageNode { stage, node: self.stages[stage].node(&reference.node.text)? })
    }

    fn stage_of(&self, reference: &Reference) -> Option<StageId> {
        match &reference.stage {
            None => Some(self.stage),
            Some(word) => self.stages.iter().position(|stage| stage.name == word.text).map(StageId),
        }
    }

    pub(crate) fn wire(
        &self,
        node: (&str, &NodeKind),
        signature: &Signature,
        port: &Port,
        input: &InputSpec,
        resolver: &mut Resolver,
        report: &mut Report,
    ) -> Option<Wire> {
        match input.from.as_ref()? {
            Wired::Nothing => None,
            Wired::File(file) => file_wire(port, file, resolver, report),
            Wired::Reference(reference) => {
                let output = self.find(reference, report)?;
                match self.misfit(node, signature, port, input, &output) {
                    None => Some(output.wire),
                    Some(error) => {
                        report.push(error);
                        None
                    }
                }
            }
        }
    }

    /// Reports a wire from an output that the parameters of the source switch off: an error if it is the ground truth
    /// of a score, because nothing would be scored.
    pub(crate) fn switched_off(
        &self,
        kind: &NodeKind,
        port: &Port,
        input: &InputSpec,
        wire: Option<&Wire>,
    ) -> Option<Diagnostic> {
        let Wire::Source { port: output } = wire? else { return None };
        let source = self.stages[self.stage].source.as_ref()?;
        let output = source.outputs.get(output.0)?.name;
        let SwitchedOff { why, remedy, .. } = source.switched_off.iter().find(|off| off.output == output)?;
        let what = format!("`{}` has no values: {why} in source `{}`", input.place.text(), source.name);
        let is_truth = score::is_kind(kind.declaration.kind) && port.name == "ground_truth";
        let (diagnostic, otherwise) = if is_truth {
            (Diagnostic::error(&input.place, what), "or leave out the score")
        } else {
            (Diagnostic::warning(&input.place, what), "or leave out this input")
        };
        Some(diagnostic.label("switched off").help(format!("{remedy} in the source, {otherwise}")))
    }

    fn misfit(
        &self,
        node: (&str, &NodeKind),
        signature: &Signature,
        port: &Port,
        input: &InputSpec,
        output: &Output<'_>,
    ) -> Option<Diagnostic> {
        let written = input.place.text();
        let error = |what: String| Diagnostic::error(&input.place, what);
        let (wanted, given) = (port.value_type, output.port.value_type);
        let name = port.name;
        if output.stage != self.stage {
            let (other, own) = (self.stages[output.stage].name, self.stages[self.stage].name);
            if output.port.rate == Rate::Frame {
                let what = format!(
                    "`{written}` has one value per frame of stage `{other}`: other stages can use aggregate values only"
                );
                let help = format!(
                    "add the same node to stage `{own}`; identical nodes on the same frames are computed only once"
                );
                return Some(error(what).label("one value per frame").help(help));
            }
            if output.stage > self.stage {
                let what = format!("`{written}` is known only after stage `{other}`, which comes after `{own}`");
                return Some(error(what).label("not known yet").help(format!("move stage `{other}` above `{own}`")));
            }
        }
        if wanted != given {
            let what = format!("input `{name}` expects {wanted}, but `{written}` is {given}");
            let fitting = self.outputs_fitting(port, node.0);
            let fitting: Vec<&str> = fitting.iter().map(String::as_str).collect();
            let help = match fitting.is_empty() {
                false => format!("outputs that fit: {}", names::listed(&fitting)),
                true if port.takes_file() => format!(
                    "read it from a file, `{name}: {{ file: PATH }}`, or connect an output of type {wanted}, \
                     `{name}: STAGE.NODE/OUTPUT`"
                ),
                true => format!("add a node with an output of type {wanted}; `depthloom nodes` lists the kinds"),
            };
            return Some(error(what).label(format!("{given}, not {wanted}")).help(help));
        }
        match (port.rate, output.port.rate) {
            (Rate::Frame, Rate::Once) => {
                let what = format!(
                    "input `{name}` expects one value per frame, but `{written}` is one value for the whole stage"
                );
                let fitting = self.outputs_fitting(port, node.0);
                let fitting: Vec<&str> = fitting.iter().map(String::as_str).collect();
                let help = (!fitting.is_empty()).then(|| format!("outputs that fit: {}", names::listed(&fitting)));
                Some(error(what).label("an aggregate value").maybe_help(help))
            }
            (Rate::Once, Rate::Frame) => {
                let what = format!(
                    "input `{name}` expects one value for the whole stage, but `{written}` has one value per frame"
                );
                let help = format!("insert a node with `contract: ordered` that aggregates {given} over all frames");
                Some(error(what).label("one value per frame").help(help))
            }
            (Rate::Once, Rate::Once) if output.stage == self.stage && signature.contract != Contract::Once => {
                let what = format!(
                    "`{written}` is known only after the last frame of stage `{}`, but `{}` works frame by frame",
                    self.stages[self.stage].name, node.1.declaration.kind
                );
                Some(error(what).label("not known yet").help("move the node that reads it into a later stage"))
            }
            (Rate::Once, Rate::Once) | (Rate::Frame, Rate::Frame) => None,
        }
    }

    /// `None` without a report if its node is broken.
    pub(crate) fn find(&self, reference: &Reference, report: &mut Report) -> Option<Output<'_>> {
        let Some(stage) = self.stage_of(reference) else {
            let word = reference.stage.as_ref()?;
            let known: Vec<&str> = self.stages.iter().map(|stage| stage.name).collect();
            let error =
                Diagnostic::error(&word.place, format!("there is no stage `{}`", word.text)).label("unknown name");
            report.push(error.maybe_help(names::suggestion(&word.text, "stages", &known)));
            return None;
        };
        let names = &self.stages[stage];
        let output = &reference.output;
        let node = names.node(&reference.node.text);
        let (owner, ports): (String, &[Port]) = match node {
            Some(node) => {
                let (_, types) = &names.nodes[node];
                let (kind, signature) = (types.kind?, types.signature.as_ref()?);
                (format!("`{}` ({})", reference.node.text, kind.declaration.kind), &signature.outputs)
            }
            None if reference.node.text == "source" => {
                let source = names.source.as_ref()?;
                (format!("source `{}`", source.name), &source.outputs)
            }
            None => {
                self.unknown_node(reference, stage, report);
                return None;
            }
        };
        match ports.iter().position(|port| port.name == output.text).map(PortId) {
            Some(port) => {
                let wire =
                    node.map_or(Wire::Source { port }, |node| Wire::Node { node: StageNode { stage, node }, port });
                Some(Output { wire, port: &ports[port], stage })
            }
            None => {
                let known: Vec<&str> = ports.iter().map(|port| port.name).collect();
                let what = format!("{owner} has no output `{}`", output.text);
                let source = names.source.as_ref().filter(|_| node.is_none());
                let off = source.and_then(|source| source.switched_off.iter().find(|off| off.output == output.text));
                let (what, help) = match off {
                    Some(SwitchedOff { why, remedy, .. }) => (format!("{what}: {why}"), Some(remedy.clone())),
                    None => (what, names::suggestion(&output.text, "outputs", &known)),
                };
                report.push(Diagnostic::error(&output.place, what).label("no such output").maybe_help(help));
                None
            }
        }
    }

    fn unknown_node(&self, reference: &Reference, stage: StageId, report: &mut Report) {
        let name = &reference.node.text;
        let names = &self.stages[stage];
        let what = format!("stage `{}` has no node `{name}`", names.name);
        let mut known: Vec<&str> =
            names.nodes.iter().map(|(name, _)| *name).filter(|name| !name.contains('.')).collect();
        known.push("source");
        let elsewhere = self.stages[..self.stage.0].iter().find(|earlier| earlier.node(name).is_some());
        let help = match elsewhere {
            Some(earlier) => {
                Some(format!("did you mean `{}.{name}/{}`, of stage `{0}`?", earlier.name, reference.output.text))
            }
            None if self.stages.iter().any(|stage| stage.name == name) => {
                Some(format!("`{name}` is a stage: its aggregate values are `{name}.NODE/OUTPUT`"))
            }
            None => names::suggestion(name, "nodes of the stage", &known),
        };
        report.push(Diagnostic::error(&reference.node.place, what).label("unknown name").maybe_help(help));
    }

    /// Outputs that could be wired to a port, best first: the source's, then those of other nodes.
    pub(crate) fn outputs_fitting(&self, port: &Port, node: &str) -> Vec<String> {
        const MOST: usize = 100;
        let mut fitting = Vec::new();
        let fits = |output: &Port| output.value_type == port.value_type && output.rate == port.rate;
        for (index, stage) in StageId::enumerate(self.stages).take(self.stage.0 + 1) {
            let here = index == self.stage;
            if !here && port.rate == Rate::Frame {
                continue;
            }
            let prefix = if here { String::new() } else { format!("{}.", stage.name) };
            if let Some(source) = stage.source.as_ref().filter(|_| here) {
                let own = source.outputs.iter().filter(|output| fits(output));
                fitting.extend(own.map(|output| format!("source/{}", output.name)));
            }
            for &(name, ref types) in &stage.nodes {
                if name.contains('.') || here && name == node || fitting.len() >= MOST {
                    continue;
                }
                let outputs = types.outputs().iter().filter(|output| fits(output));
                fitting.extend(outputs.map(|output| format!("{prefix}{name}/{}", output.name)));
            }
        }
        // First the output or node of the same name (`left` from `source/left`); last the source's depth, which is
        // ground truth.
        let truth = |output: &str| port.value_type == ValueType::Depth && output.starts_with("source/");
        let of_that_name = |output: &str| {
            output.ends_with(&format!("/{}", port.name)) || output.starts_with(&format!("{}/", port.name))
        };
        fitting.sort_by_key(|output: &String| (truth(output), !of_that_name(output)));
        fitting
    }
}

fn file_wire(port: &Port, file: &Node, resolver: &mut Resolver, report: &mut Report) -> Option<Wire> {
    let Some(text) = file.text() else {
        report.push(file.not_a("`file`", "a path"));
        return None;
    };
    if port.rate == Rate::Frame {
        let what = format!("input `{}` expects one value per frame: a file can only be an aggregate value", port.name);
        let help = format!("connect an output: `{0}: source/OUTPUT` or `{0}: NODE/OUTPUT`", port.name);
        report.push(Diagnostic::error(&file.place, what).help(help));
        return None;
    }
    if !port.takes_file() {
        let what = format!("input `{}` expects {}, which cannot be read from a file", port.name, port.value_type);
        let help = format!("connect an output of type {}: `{}: STAGE.NODE/OUTPUT`", port.value_type, port.name);
        report.push(Diagnostic::error(&file.place, what).help(help));
        return None;
    }
    resolver.anywhere.add(file, text);
    let path = paths::located(file, text);
    match resolver.contents.hash_of(&path) {
        Some(content) => {
            let shown = file.text_with_variables().map(str::to_owned);
            Some(Wire::File { path, content, shown })
        }
        None => {
            let what = format!("there is no file `{}`", path.display());
            let error = Diagnostic::error(&file.place, what).label("cannot be read");
            report.push(error.help("relative paths start at the folder of the YAML file they are written in"));
            None
        }
    }
}
