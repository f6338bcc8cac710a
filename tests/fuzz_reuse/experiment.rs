//! An experiment as data: what refers to a source, a node or a port does so by a number, so that names can change
//! independently.

use std::collections::BTreeSet;

use serde_json::{Map, Value as Json, json};

use crate::kinds::{Contract, Kind, Type};

/// The number of a source, stage, node, estimate or variant; the same in all steps of a sequence.
pub(crate) type Id = u32;

/// An experiment.
#[derive(Clone, Debug)]
pub(crate) struct Experiment {
    pub sources: Vec<Source>,
    pub stages: Vec<Stage>,
    pub variants: Vec<Variant>,
    /// The matrix, of one axis.
    pub axis: Option<Axis>,
    pub record: Record,
    /// The estimates and variants with labels, in the order of the labels, each with the number in its text.
    pub labels: Vec<(Id, usize)>,
    /// The number that the next new part gets.
    pub next_id: Id,
}

/// A named source.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    pub id: Id,
    pub name: String,
    /// One, or several that are joined.
    pub parts: Vec<SourcePart>,
}

/// A source of one kind.
#[derive(Clone, Debug)]
pub(crate) struct SourcePart {
    pub kind: &'static str,
    pub with: Map<String, Json>,
    pub ports: Vec<(String, Type)>,
}

/// A stage.
#[derive(Clone, Debug)]
pub(crate) struct Stage {
    pub id: Id,
    pub name: String,
    pub source: Id,
    pub nodes: Vec<Node>,
    pub score: Option<Score>,
}

/// A node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub id: Id,
    pub name: String,
    pub kind: &'static Kind,
    pub inputs: Vec<(&'static str, Input)>,
    pub with: Map<String, Json>,
}

/// Where an input's value comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Input {
    Source(String),
    Node(Id, &'static str),
    File(&'static str),
}

/// The `score` of a stage.
#[derive(Clone, Debug)]
pub(crate) struct Score {
    pub truth: Input,
    pub settings: Map<String, Json>,
    pub estimates: Vec<Estimate>,
}

/// A scored estimate.
#[derive(Clone, Debug)]
pub(crate) struct Estimate {
    pub id: Id,
    pub name: String,
    pub from: Input,
    pub settings: Map<String, Json>,
}

/// A variant.
#[derive(Clone, Debug)]
pub(crate) struct Variant {
    pub id: Id,
    pub name: String,
    pub changes: Vec<Change>,
}

/// A changed value of a variant or of `--set`.
#[derive(Clone, Debug)]
pub(crate) enum Change {
    Parameter(Id, &'static str, Json),
    Input(Id, &'static str, Input),
    SourceParameter(Id, &'static str, Json),
}

/// A parameter of a node that takes several values, each in a variant.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub node: Id,
    pub parameter: &'static str,
    pub values: Vec<Json>,
}

/// What is recorded.
#[derive(Clone, Debug, Default)]
pub(crate) struct Record {
    /// All topics, or these nodes (0: the sources) and whatever nothing reads.
    pub topics: Option<BTreeSet<Id>>,
    /// The preset `lean`, to which the topics are added.
    pub is_lean: bool,
    pub every: Option<u64>,
    pub view: Option<bool>,
    pub points: BTreeSet<Id>,
}

impl Change {
    /// The part that is changed.
    pub(crate) const fn target(&self) -> Id {
        match self {
            Self::Parameter(id, ..) | Self::Input(id, ..) | Self::SourceParameter(id, ..) => *id,
        }
    }
}

impl Experiment {
    pub(crate) fn nodes(&self) -> impl Iterator<Item = (&Stage, &Node)> {
        self.stages.iter().flat_map(|stage| stage.nodes.iter().map(move |node| (stage, node)))
    }

    pub(crate) fn node(&self, id: Id) -> Option<(&Stage, &Node)> {
        self.nodes().find(|(_, node)| node.id == id)
    }

    pub(crate) fn node_mut(&mut self, id: Id) -> Option<&mut Node> {
        self.stages.iter_mut().flat_map(|stage| &mut stage.nodes).find(|node| node.id == id)
    }

    pub(crate) fn source(&self, id: Id) -> Option<&Source> {
        self.sources.iter().find(|source| source.id == id)
    }

    pub(crate) fn new_id(&mut self) -> Id {
        self.next_id += 1;
        self.next_id
    }

    /// The nodes that a node's values depend on, itself included, with the base inputs and those of all variants.
    pub(crate) fn upstream(&self, id: Id) -> BTreeSet<Id> {
        let mut found = BTreeSet::from([id]);
        let mut open = vec![id];
        while let Some(id) = open.pop() {
            let inputs = self.node(id).into_iter().flat_map(|(_, node)| node.inputs.iter().map(|(_, input)| input));
            let changes = self.variants.iter().flat_map(|variant| &variant.changes);
            let changed = changes.filter_map(|change| match change {
                Change::Input(of, _, input) if *of == id => Some(input),
                _ => None,
            });
            for input in inputs.chain(changed) {
                if let Input::Node(read, _) = input
                    && found.insert(*read)
                {
                    open.push(*read);
                }
            }
        }
        found
    }

    /// All values of a type that an input of a node in a stage may be connected to; `avoid`: the node itself, which
    /// nothing may read that it depends on.
    pub(crate) fn values(&self, stage: usize, of: Type, contract: Contract, avoid: Option<Id>) -> Vec<Input> {
        let of_source = || {
            let source = self.source(self.stages[stage].source)?;
            let ports = source.parts.first()?.ports.iter().filter(|(_, port)| *port == of);
            Some(ports.map(|(name, _)| Input::Source(name.clone())).collect::<Vec<_>>())
        };
        let mut found = if contract == Contract::Aggregate { Vec::new() } else { of_source().unwrap_or_default() };
        let is_late = of.is_aggregate() && contract != Contract::Aggregate;
        let first = if of.is_aggregate() { 0 } else { stage };
        let last = if is_late { stage } else { stage + 1 };
        for stage in &self.stages[first..last] {
            for node in &stage.nodes {
                let ports = node.kind.outputs.iter().filter(|(_, port)| *port == of);
                if avoid.is_none_or(|avoid| !self.upstream(node.id).contains(&avoid)) {
                    found.extend(ports.map(|(name, _)| Input::Node(node.id, name)));
                }
            }
        }
        found
    }

    /// Removes whatever refers to a part that is no longer there, until nothing does.
    pub(crate) fn prune(&mut self) {
        loop {
            let before = self.count();
            self.prune_once();
            if self.count() == before {
                return;
            }
        }
    }

    fn count(&self) -> usize {
        let nodes = self.nodes().map(|(_, node)| 1 + node.inputs.len()).sum::<usize>();
        let estimates =
            self.stages.iter().filter_map(|stage| stage.score.as_ref()).map(|score| 1 + score.estimates.len());
        let changes = self.variants.iter().map(|variant| 1 + variant.changes.len()).sum::<usize>();
        self.stages.len() + self.sources.len() + nodes + estimates.sum::<usize>() + changes
    }

    fn prune_once(&mut self) {
        let sources: BTreeSet<Id> = self.sources.iter().map(|source| source.id).collect();
        self.stages.retain(|stage| sources.contains(&stage.source) && !stage.nodes.is_empty());
        let before = self.clone();
        // What a node of a stage may read: the source's ports, per-frame values of the stage and aggregate values of it
        // and of earlier stages.
        let reads = |stage: usize, of: Option<&Node>, input: &Input| match input {
            Input::File(_) => true,
            Input::Source(port) => before
                .source(before.stages[stage].source)
                .is_some_and(|source| source.parts.iter().all(|part| part.ports.iter().any(|(name, _)| name == port))),
            Input::Node(id, port) => before.stages[..=stage].iter().enumerate().any(|(at, other)| {
                let Some(node) = other.nodes.iter().find(|node| node.id == *id) else { return false };
                let Some((_, of_port)) = node.kind.outputs.iter().find(|(name, _)| name == port) else { return false };
                match of {
                    Some(reader) if of_port.is_aggregate() => reader.kind.contract == Contract::Aggregate || at < stage,
                    _ => at == stage,
                }
            }),
        };
        for (at, stage) in self.stages.iter_mut().enumerate() {
            for node in &mut stage.nodes {
                let reader = node.clone();
                node.inputs.retain(|(_, input)| reads(at, Some(&reader), input));
            }
            let is_complete =
                |node: &Node| node.kind.inputs.iter().all(|(port, _)| node.inputs.iter().any(|(name, _)| name == port));
            stage.nodes.retain(is_complete);
            if let Some(score) = &mut stage.score {
                score.estimates.retain(|estimate| reads(at, None, &estimate.from));
                if score.estimates.is_empty() || !reads(at, None, &score.truth) {
                    stage.score = None;
                }
            }
        }
        let nodes: BTreeSet<Id> = self.nodes().map(|(_, node)| node.id).collect();
        for variant in &mut self.variants {
            variant.changes.retain(|change| match change {
                Change::Parameter(id, ..) => nodes.contains(id),
                Change::SourceParameter(id, ..) => sources.contains(id),
                Change::Input(id, _, input) => before
                    .stages
                    .iter()
                    .enumerate()
                    .find_map(|(at, stage)| Some((at, stage.nodes.iter().find(|node| node.id == *id)?)))
                    .is_some_and(|(at, node)| nodes.contains(id) && reads(at, Some(node), input)),
            });
        }
        if self.axis.as_ref().is_some_and(|axis| !nodes.contains(&axis.node)) {
            self.axis = None;
        }
        self.record.points.retain(|id| nodes.contains(id));
        if let Some(topics) = &mut self.record.topics {
            topics.retain(|id| *id == 0 || nodes.contains(id));
        }
    }

    /// Removes the part of that number, and whatever cannot be there without it.
    pub(crate) fn remove(&mut self, id: Id) {
        self.sources.retain(|source| source.id != id);
        self.stages.retain(|stage| stage.id != id);
        self.variants.retain(|variant| variant.id != id);
        for stage in &mut self.stages {
            stage.nodes.retain(|node| node.id != id);
            if let Some(score) = &mut stage.score {
                score.estimates.retain(|estimate| estimate.id != id);
            }
        }
        self.prune();
    }

    /// The numbers of all parts, large ones first.
    pub(crate) fn ids(&self) -> Vec<Id> {
        let stages = self.stages.iter().map(|stage| stage.id);
        let sources = self.sources.iter().map(|source| source.id);
        let variants = self.variants.iter().map(|variant| variant.id);
        let nodes = self.nodes().map(|(_, node)| node.id);
        let scores = self.stages.iter().filter_map(|stage| stage.score.as_ref());
        let estimates = scores.flat_map(|score| score.estimates.iter().map(|estimate| estimate.id));
        stages.chain(sources).chain(variants).chain(nodes).chain(estimates).collect()
    }

    fn reference(&self, stage: Option<Id>, input: &Input) -> Json {
        match input {
            Input::Source(port) => json!(format!("source/{port}")),
            Input::File(path) => json!({ "file": path }),
            Input::Node(id, port) => match self.node(*id) {
                Some((of, node)) if Some(of.id) == stage => json!(format!("{}/{port}", node.name)),
                Some((of, node)) => json!(format!("{}.{}/{port}", of.name, node.name)),
                None => json!(format!("missing/{port}")),
            },
        }
    }

    /// The path and the value of a change; `None` if its part is not there.
    pub(crate) fn change(&self, change: &Change, program: &str) -> Option<(String, Json)> {
        let of_node = |id: Id| self.node(id).map(|(stage, node)| (stage.id, format!("{}.{}", stage.name, node.name)));
        Some(match change {
            Change::Parameter(id, parameter, value) => {
                (format!("{}.with.{parameter}", of_node(*id)?.1), with_program(value, program))
            }
            Change::Input(id, port, input) => {
                let (stage, node) = of_node(*id)?;
                (format!("{node}.inputs.{port}"), self.reference(Some(stage), input))
            }
            Change::SourceParameter(id, parameter, value) => {
                (format!("sources.{}.with.{parameter}", self.source(*id)?.name), value.clone())
            }
        })
    }

    /// The nodes that nothing reads and that are not scored.
    fn unread(&self) -> impl Iterator<Item = (&Stage, &Node)> {
        let inputs = self.nodes().flat_map(|(_, node)| node.inputs.iter().map(|(_, input)| input));
        let scores = self.stages.iter().filter_map(|stage| stage.score.as_ref());
        let estimates = scores.flat_map(|score| score.estimates.iter().map(|estimate| &estimate.from));
        let node = |input: &Input| if let Input::Node(id, _) = input { Some(*id) } else { None };
        let read: BTreeSet<Id> = inputs.chain(estimates).filter_map(node).collect();
        self.nodes().filter(move |(_, node)| !read.contains(&node.id))
    }

    fn record_yaml(&self) -> Option<Json> {
        let pattern = |(stage, node): (&Stage, &Node)| format!("{}.{}", stage.name, node.name);
        let mut record = Map::new();
        if let Some(topics) = &self.record.topics {
            let mut patterns: Vec<String> = if topics.contains(&0) { vec!["source".to_owned()] } else { Vec::new() };
            patterns.extend(self.nodes().filter(|(_, node)| topics.contains(&node.id)).map(pattern));
            patterns.extend(self.unread().filter(|(_, node)| !topics.contains(&node.id)).map(pattern));
            record.insert("topics".to_owned(), json!(patterns));
        }
        if self.record.is_lean {
            record.insert("preset".to_owned(), json!("lean"));
        }
        if let Some(every) = self.record.every {
            record.insert("every".to_owned(), json!(every));
        }
        if let Some(view) = self.record.view {
            record.insert("view".to_owned(), json!(view));
        }
        if !self.record.points.is_empty() {
            let nodes = self.nodes().filter(|(_, node)| self.record.points.contains(&node.id));
            record.insert("points".to_owned(), json!(nodes.map(pattern).collect::<Vec<_>>()));
        }
        (!record.is_empty()).then_some(Json::Object(record))
    }

    /// The estimates, then the variants, by number and name; of estimates with one name the first.
    pub(crate) fn labelled(&self) -> [Vec<(Id, &str)>; 2] {
        let mut known = BTreeSet::new();
        let scores = self.stages.iter().filter_map(|stage| stage.score.as_ref());
        let estimates = scores.flat_map(|score| score.estimates.iter().map(|own| (own.id, own.name.as_str())));
        let estimates = estimates.filter(|(_, name)| known.insert(*name)).collect();
        [estimates, self.variants.iter().map(|variant| (variant.id, variant.name.as_str())).collect()]
    }

    fn labels_yaml(&self) -> String {
        let mut text = String::new();
        for (section, named) in ["estimates", "variants"].into_iter().zip(self.labelled()) {
            let label = |(id, number): &(Id, usize)| {
                let (_, name) = named.iter().find(|(known, _)| known == id)?;
                Some(format!("    {name}: Label {number} of {id}\n"))
            };
            let labels: String = self.labels.iter().filter_map(label).collect();
            if !labels.is_empty() {
                text.push_str(&format!("  {section}:\n{labels}"));
            }
        }
        if text.is_empty() { text } else { format!("labels:\n{text}") }
    }

    /// The experiment file; `program` is the path of the program that processes run.
    pub(crate) fn yaml(&self, program: &str) -> String {
        let mut text = "experiment: random\nsources:\n".to_owned();
        let part = |part: &SourcePart| json!({ "kind": part.kind, "with": with_program(&Json::Object(part.with.clone()), program) });
        for source in &self.sources {
            let body = match &source.parts[..] {
                [only] => part(only),
                several => json!({ "concat": several.iter().map(part).collect::<Vec<_>>() }),
            };
            text.push_str(&format!("  {}: {body}\n", source.name));
        }
        text.push_str("stages:\n");
        for stage in &self.stages {
            let source = self.source(stage.source).map_or("missing", |source| &source.name);
            text.push_str(&format!("  {}:\n    source: {source}\n    nodes:\n", stage.name));
            for node in &stage.nodes {
                let reference =
                    |(port, input): &(&str, Input)| ((*port).to_owned(), self.reference(Some(stage.id), input));
                let inputs: Map<String, Json> = node.inputs.iter().map(reference).collect();
                let mut body = json!({ "kind": node.kind.kind });
                if !inputs.is_empty() {
                    body["inputs"] = Json::Object(inputs);
                }
                if !node.with.is_empty() {
                    body["with"] = with_program(&Json::Object(node.with.clone()), program);
                }
                text.push_str(&format!("      {}: {body}\n", node.name));
            }
            if let Some(score) = &stage.score {
                text.push_str(&format!(
                    "    score:\n      ground_truth: {}\n",
                    self.reference(Some(stage.id), &score.truth)
                ));
                score.settings.iter().for_each(|(name, value)| text.push_str(&format!("      {name}: {value}\n")));
                text.push_str("      estimates:\n");
                for estimate in &score.estimates {
                    let mut body =
                        Map::from_iter([("from".to_owned(), self.reference(Some(stage.id), &estimate.from))]);
                    body.extend(estimate.settings.clone());
                    text.push_str(&format!("        {}: {}\n", estimate.name, Json::Object(body)));
                }
            }
        }
        if !self.variants.is_empty() {
            text.push_str("variants:\n");
        }
        for variant in &self.variants {
            let changes: Map<String, Json> =
                variant.changes.iter().filter_map(|change| self.change(change, program)).collect();
            text.push_str(&format!("  {}: {}\n", variant.name, Json::Object(changes)));
        }
        if let Some(axis) = &self.axis
            && let Some((path, _)) = self.change(&Change::Parameter(axis.node, axis.parameter, Json::Null), program)
        {
            text.push_str(&format!("matrix: {}\n", with_program(&json!({ path: axis.values }), program)));
        }
        text.push_str(&self.labels_yaml());
        if let Some(record) = self.record_yaml() {
            text.push_str(&format!("record: {record}\n"));
        }
        text
    }
}

/// Sets a parameter at a path in `with`.
pub(crate) fn set(with: &mut Map<String, Json>, path: &str, value: Json) {
    match path.split_once('.') {
        None => drop(with.insert(path.to_owned(), value)),
        Some((first, rest)) => {
            let inner = with.entry(first).or_insert_with(|| json!({}));
            if let Some(inner) = inner.as_object_mut() {
                set(inner, rest, value);
            }
        }
    }
}

/// A value with the path of the program in the place of `PROGRAM`.
fn with_program(value: &Json, program: &str) -> Json {
    match value {
        Json::String(text) if text == "PROGRAM" => json!(program),
        Json::Array(items) => items.iter().map(|item| with_program(item, program)).collect(),
        Json::Object(parts) => {
            Json::Object(parts.iter().map(|(name, part)| (name.clone(), with_program(part, program))).collect())
        }
        other => other.clone(),
    }
}
