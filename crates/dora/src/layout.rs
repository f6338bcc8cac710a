//! Which parts a plan has, and what flows between them.

use std::collections::{BTreeMap, BTreeSet};

use depthloom_graphs::contracts::{Contract, Slot};
use depthloom_graphs::plan::{NodeId, NodeRef, Origin, Plan, PlannedNode, PlannedOutput, RunId};
use depthloom_graphs::{Key, Rate};
use depthloom_nodes::dora::KIND;

use crate::channel;

/// The parts of a plan.
pub struct Layout {
    /// The recorder is the last.
    pub parts: Vec<Part>,
}

/// A node of the dataflow.
pub struct Part {
    /// Its name.
    pub id: String,
    /// What it does.
    pub role: Role,
    /// Its inputs.
    pub inputs: Vec<Link>,
    /// Its outputs.
    pub outputs: Vec<String>,
}

/// What a part does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Reads a stage run's frames.
    Source {
        /// The stage run.
        run: RunId,
    },
    /// A node of a stage run.
    Node(NodeRef),
    /// A node of a third-party program, which one of our parts calls.
    Foreign(NodeRef),
    /// The recorder.
    Recorder,
}

pub struct Link {
    pub input: String,
    pub part: String,
    pub output: String,
}

const RECORDER: &str = "recorder";

impl Part {
    fn new(id: String, role: Role) -> Self {
        Self { id, role, inputs: Vec::new(), outputs: Vec::new() }
    }

    fn gets(&mut self, input: impl Into<String>, part: &str, output: impl Into<String>) {
        self.inputs.push(Link { input: input.into(), part: part.to_owned(), output: output.into() });
    }
}

/// The recorder's output that admits frames of a stage run.
pub(crate) fn admission(run: RunId) -> String {
    format!("{}.{run}", channel::ADMITTED)
}

/// The output of a request to a third-party node.
pub(crate) fn request_output(port: &str) -> String {
    format!("ask.{port}")
}

/// The input of its reply.
pub(crate) fn reply_input(port: &str) -> String {
    format!("answer.{port}")
}

impl Layout {
    /// The parts of a plan.
    pub fn from_plan(plan: &Plan) -> Self {
        let names = Names::from_plan(plan);
        let mut parts = Vec::new();
        let mut recorder = Part::new(RECORDER.to_owned(), Role::Recorder);
        recorder.outputs.extend(RunId::all(plan.runs.len()).map(admission));
        recorder.outputs.extend([channel::ENGINES, channel::END].map(str::to_owned));
        for (run, planned) in RunId::enumerate(&plan.runs) {
            let id = &names.sources[run];
            let mut source = Part::new(id.clone(), Role::Source { run });
            source.gets(channel::ADMITTED, RECORDER, admission(run));
            source.gets(channel::END, RECORDER, channel::END);
            source.outputs.extend([channel::READY, channel::FRAMES, channel::REPORT].map(str::to_owned));
            source.outputs.extend(planned.source.outputs.iter().map(|output| output.port.name.to_owned()));
            recorder.gets(format!("{id}/{}", channel::FRAMES), id, channel::FRAMES);
            recorded(&mut recorder, id, &planned.source.outputs);
            parts.push(source);
            for (node, planned) in NodeId::enumerate(&planned.nodes) {
                parts.extend(node_parts(&names, NodeRef { run, node }, planned));
                recorded(&mut recorder, &names.nodes[run][node], &planned.outputs);
            }
        }
        parts.push(recorder);
        Self { parts }
    }

    /// The part of that name.
    pub fn part(&self, id: &str) -> Option<&Part> {
        self.parts.iter().find(|part| part.id == id)
    }

    /// The name of a part.
    pub fn id(&self, role: Role) -> &str {
        self.parts.iter().find(|part| part.role == role).map_or("", |part| &part.id)
    }
}

/// The recorder's inputs from a part: recorded values, and aggregate values, whose content enters keys.
fn recorded(recorder: &mut Part, id: &str, outputs: &[PlannedOutput]) {
    let values = outputs
        .iter()
        .filter(|output| output.recorded || output.port.rate == Rate::Once)
        .map(|output| output.port.name);
    for output in [channel::READY, channel::REPORT].into_iter().chain(values) {
        recorder.gets(format!("{id}/{output}"), id, output);
    }
}

fn node_parts(names: &Names, node: NodeRef, planned: &PlannedNode) -> Vec<Part> {
    let run = node.run;
    let id = &names.nodes[run][node.node];
    let mut part = Part::new(id.clone(), Role::Node(node));
    for input in &planned.inputs {
        let (sender, port) = match &input.from {
            Some(Origin::Here(Slot::Source { port })) => (&names.sources[run], names.source_ports[run][*port]),
            Some(Origin::Here(Slot::Node { node, port })) => (&names.nodes[run][*node], names.ports[run][*node][*port]),
            Some(Origin::Once { run, node, port }) => (&names.nodes[*run][*node], names.ports[*run][*node][*port]),
            Some(Origin::File(_)) | None => continue,
        };
        part.gets(input.port.name, sender, port);
    }
    if planned.contract == Contract::Once {
        part.gets(channel::ENGINES, RECORDER, channel::ENGINES);
    } else {
        part.gets(channel::FRAMES, &names.sources[run], channel::FRAMES);
    }
    part.gets(channel::END, RECORDER, channel::END);
    part.outputs.extend([channel::READY, channel::REPORT].map(str::to_owned));
    part.outputs.extend(planned.outputs.iter().map(|output| output.port.name.to_owned()));
    if planned.kind != KIND {
        return vec![part];
    }
    let mut foreign = Part::new(format!("{id}.dora"), Role::Foreign(node));
    for input in planned.inputs.iter().filter(|input| input.from.is_some()) {
        part.outputs.push(request_output(input.port.name));
        foreign.gets(input.port.name, id, request_output(input.port.name));
    }
    for output in &planned.outputs {
        foreign.outputs.push(output.port.name.to_owned());
        part.gets(reply_input(output.port.name), &foreign.id, output.port.name);
    }
    vec![part, foreign]
}

struct Names {
    sources: Vec<String>,
    source_ports: Vec<Vec<&'static str>>,
    nodes: Vec<Vec<String>>,
    ports: Vec<Vec<Vec<&'static str>>>,
}

impl Names {
    fn from_plan(plan: &Plan) -> Self {
        let mut taken = BTreeSet::from([RECORDER.to_owned()]);
        let of_ports = |outputs: &[PlannedOutput]| outputs.iter().map(|output| output.port.name).collect();
        let (mut sources, mut nodes) = (Vec::new(), Vec::new());
        for run in &plan.runs {
            sources.push(free(&mut taken, &format!("{}/source", run.prefix)));
            let named = run.nodes.iter().map(|node| {
                // `/compare/no_scaling/fused` of its topics, which variants that do not share it have each of their
                // own.
                let topic = node.outputs.first().and_then(|output| output.topic.rsplit_once('/'));
                let name = topic.map_or_else(|| format!("{}/{}", run.prefix, node.name), |(node, _)| node.to_owned());
                free(&mut taken, &name)
            });
            nodes.push(named.collect());
        }
        Self {
            sources,
            source_ports: plan.runs.iter().map(|run| of_ports(&run.source.outputs)).collect(),
            nodes,
            ports: plan.runs.iter().map(|run| run.nodes.iter().map(|node| of_ports(&node.outputs)).collect()).collect(),
        }
    }
}

/// A unique name with characters that dora allows, and without the ending `.dora` of third-party nodes.
fn free(taken: &mut BTreeSet<String>, name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "_-".contains(c) { c } else { '.' };
    let name: String = name.trim_matches('/').chars().map(plain).collect();
    let mut free = if name.starts_with('.') { format!("_{name}") } else { name.clone() };
    let mut next = 2;
    while taken.contains(&free) || free.ends_with(".dora") {
        free = format!("{name}-{next}");
        next += 1;
    }
    taken.insert(free.clone());
    free
}

/// A digest of what all parts must agree on: the nodes, their sources and their wiring.
pub fn print_of(plan: &Plan) -> Key {
    let mut key = Key::build("dora dataflow").text(env!("CARGO_PKG_VERSION"));
    for (at, part) in Layout::from_plan(plan).parts.iter().enumerate() {
        key = key.number(at as u64).text(&part.id).number(part.inputs.len() as u64);
        key = part.inputs.iter().fold(key, |key, link| key.text(&link.input).text(&link.part).text(&link.output));
    }
    let mut portable = BTreeMap::new();
    for run in &plan.runs {
        for (at, part) in run.source.parts.iter().enumerate() {
            portable.insert((run.prefix.as_str(), at), (part.kind.as_str(), part.portable.to_string()));
        }
        key = run.nodes.iter().fold(key, |key, node| key.key(&node.node_hash));
    }
    portable.into_values().fold(key, |key, (kind, params)| key.text(kind).text(&params)).finish()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::language;

    use super::{Layout, Role, print_of};

    const EXPERIMENT: &str = "
experiment: own
sources: { street: { kind: synthetic/road, with: { frames: 0..2 } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      far:
        kind: dora
        inputs: { depth: depth/depth }
        with: { path: far.py, ports: { inputs: { depth: depth }, outputs: { far: mask } }, version: 1 }
matrix:
  look.stereo.with.block: [3, 5]
";

    fn layout(text: &str) -> (Layout, String) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("own.yaml");
        std::fs::write(&path, text).unwrap();
        let loaded = language::load(&path, &depthloom_nodes::registry(), &language::Options::default());
        let plan = loaded.unwrap_or_else(|found| panic!("{:?}", found.0.first().map(|first| &first.message))).plan;
        (Layout::from_plan(&plan), print_of(&plan).to_string())
    }

    #[test]
    fn every_part_has_a_name_that_dora_takes_and_every_input_a_giver() {
        let (layout, _) = layout(EXPERIMENT);
        let ids: Vec<&str> = layout.parts.iter().map(|part| part.id.as_str()).collect();
        assert_eq!(ids.len(), 1 + 2 * 4 + 1, "{ids:?}");
        for (at, part) in layout.parts.iter().enumerate() {
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
            assert!(part.id.chars().all(is_plain) && !part.id.starts_with('.'), "{}", part.id);
            assert!(!ids[..at].contains(&part.id.as_str()), "{} twice", part.id);
            for link in &part.inputs {
                let giver = layout.part(&link.part).unwrap_or_else(|| panic!("{} gets of {}", part.id, link.part));
                assert!(giver.outputs.contains(&link.output), "{} gives no {}", giver.id, link.output);
            }
        }
        let foreign = layout.parts.iter().find(|part| matches!(part.role, Role::Foreign(_))).unwrap();
        assert_eq!((foreign.inputs[0].input.as_str(), foreign.outputs[0].as_str()), ("depth", "far"));
        assert_eq!(foreign.id, format!("{}.dora", foreign.inputs[0].part));
    }

    #[test]
    fn parts_agree_on_what_decides_results_and_on_nothing_else() {
        let (_, print) = layout(EXPERIMENT);
        assert_eq!(layout(EXPERIMENT).1, print);
        assert_ne!(layout(&EXPERIMENT.replace("[3, 5]", "[3, 7]")).1, print);
        assert_ne!(layout(&EXPERIMENT.replace("version: 1", "version: 2")).1, print);
        assert_ne!(layout(&EXPERIMENT.replace("0..2", "0..3")).1, print);
        // How long one may take decides no result.
        assert_eq!(layout(&EXPERIMENT.replace("version: 1", "version: 1, timeout_s: 9")).1, print);
    }
}
