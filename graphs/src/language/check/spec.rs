//! One variant's experiment as types, not yet checked against any kind.

use std::sync::Arc;

use super::reference::Reference;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names::{self, EXPERIMENT_KEYS, RESERVED_NODES, RESERVED_STAGES};
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::language::text::word::Word;
use crate::registry::Registry;

const STAGE_KEYS: &[&str] = &["source", "nodes", "score"];
/// Keys of `score:` and of estimates that are optional inputs, not parameters: the zone of a pixel, its uncertainty.
pub(crate) const CLUES: [&str; 6] = ["image", "occluded", "obj_map", "calibration", "deviation", "confidence"];
/// Of these, how sure an estimate is. It has one or the other.
pub(crate) const UNCERTAINTIES: [&str; 2] = ["deviation", "confidence"];
const NODE_KEYS: &[&str] = &["kind", "inputs", "with"];
const SOURCE_KEYS: &[&str] = &["kind", "with", "concat"];

#[derive(Debug)]
pub(crate) struct Spec {
    pub(crate) sources: Vec<SourceSpec>,
    pub(crate) stages: Vec<StageSpec>,
}

#[derive(Debug)]
pub(crate) struct SourceSpec {
    pub(crate) name: Word,
    pub(crate) parts: Vec<Instance>,
}

#[derive(Debug)]
pub(crate) struct StageSpec {
    pub(crate) name: Word,
    pub(crate) source: Option<Word>,
    pub(crate) nodes: Vec<NodeSpec>,
    pub(crate) score: Option<ScoreSpec>,
}

#[derive(Clone, Debug)]
pub(crate) struct Instance {
    pub(crate) kind: Word,
    pub(crate) with: Option<Arc<Node>>,
}

#[derive(Debug)]
pub(crate) struct NodeSpec {
    pub(crate) name: Word,
    /// `None` if its kind could not be read.
    pub(crate) instance: Option<Instance>,
    pub(crate) inputs: Vec<InputSpec>,
}

#[derive(Clone, Debug)]
pub(crate) struct InputSpec {
    pub(crate) port: Word,
    pub(crate) place: Place,
    /// `None` if it could not be read (reported).
    pub(crate) from: Option<Wired>,
}

#[derive(Clone, Debug)]
pub(crate) enum Wired {
    Reference(Reference),
    File(Arc<Node>),
    /// `null`: explicitly unwired.
    Nothing,
}

#[derive(Debug)]
pub(crate) struct ScoreSpec {
    pub(crate) place: Place,
    /// The ground truth of estimates without their own.
    pub(crate) truth: Option<InputSpec>,
    pub(crate) clues: Vec<InputSpec>,
    pub(crate) parameters: Vec<Entry>,
    pub(crate) estimates: Vec<EstimateSpec>,
}

#[derive(Debug)]
pub(crate) struct EstimateSpec {
    pub(crate) name: Word,
    pub(crate) from: Option<InputSpec>,
    pub(crate) truth: Option<InputSpec>,
    pub(crate) clues: Vec<InputSpec>,
    pub(crate) parameters: Vec<Entry>,
}

pub(crate) fn read(root: &Node, registry: &Registry, report: &mut Report) -> Spec {
    let mut spec = Spec { sources: Vec::new(), stages: Vec::new() };
    known_keys(root, "an experiment", EXPERIMENT_KEYS, report);
    for entry in section(root, "sources", report) {
        names::check(&entry.key, "a source", &[], &entry.key_place, report);
        spec.sources.push(source(entry, registry, report));
    }
    for entry in section(root, "stages", report) {
        names::check(&entry.key, "a stage", RESERVED_STAGES, &entry.key_place, report);
        spec.stages.push(stage(entry, registry, report));
    }
    spec
}

pub(crate) fn title(root: &Node, report: &mut Report) -> (String, String) {
    let mut text = |key: &str| {
        let entry = root.entry(key)?;
        let text = entry.value.scalar_text();
        if text.is_none() {
            report.push(entry.not_a("text").help(format!("e.g. `{key}: \"...\"`")));
        }
        text
    };
    let (name, description) = (text("experiment"), text("description"));
    // Shown and recorded with the names of variables.
    let description =
        root.get("description").and_then(|entry| entry.text_with_variables()).map(str::to_owned).or(description);
    if root.entry("experiment").is_none() && misspelt(root, "experiment", EXPERIMENT_KEYS) {
        // Reported where the keys are read.
    } else if root.entry("experiment").is_none() {
        let place = Place::start_of(&root.place.file);
        report.push(Diagnostic::error(&place, "the experiment has no name").help("begin with `experiment: NAME`"));
    } else if let (Some(entry), Some(name)) = (root.entry("experiment"), name.as_deref()) {
        match name.trim().is_empty() {
            true => {
                let error = Diagnostic::error(&entry.value.place, "the experiment's name is empty");
                report.push(error.help("write `experiment: NAME`"));
            }
            false => drop(names::check_experiment(name, &entry.value.place, report)),
        }
    }
    (name.unwrap_or_default(), description.unwrap_or_default())
}

/// An entry of a section, with its key.
fn section_example(key: &str) -> String {
    let entry = if key == "sources" { "{ kind: KIND, with: { ... } }" } else { "{ source: SOURCE, nodes: { ... } }" };
    format!("e.g. `{key}: {{ NAME: {entry} }}`")
}

fn section<'n>(root: &'n Node, key: &str, report: &mut Report) -> &'n [Entry] {
    let Some(entry) = root.entry(key) else {
        if misspelt(root, key, EXPERIMENT_KEYS) {
            return &[];
        }
        let place = root.entry("experiment").map_or_else(|| Place::start_of(&root.place.file), |e| e.key_place.clone());
        report.push(
            Diagnostic::error(&place, format!("the experiment has no `{key}`"))
                .label(format!("needs `{key}:` beside it"))
                .help(section_example(key)),
        );
        return &[];
    };
    if !matches!(&entry.value.value, Tree::Map(entries) if !entries.is_empty()) {
        let error = match entry.value.value {
            Tree::Map(_) | Tree::Null => Diagnostic::error(&entry.key_place, format!("`{key}` is empty")),
            _ => entry.not_a("a map from names"),
        };
        report.push(error.help(section_example(key)));
    }
    entry.value.entries()
}

pub(crate) fn known_keys(node: &Node, what: &str, known: &[&str], report: &mut Report) {
    for entry in node.entries().iter().filter(|entry| !known.contains(&entry.key.as_str())) {
        let help = names::key_suggestion(entry, known);
        let error = Diagnostic::error(&entry.key_place, format!("unknown key `{}` in {what}", entry.key));
        report.push(error.label("no such key").maybe_help(help));
    }
}

/// As [`known_keys`], with the corrected line for a parameter of the kind that is not under `with`.
fn instance_keys(node: &Node, what: &str, known: &[&str], registry: &Registry, report: &mut Report) {
    let kind = node.get("kind").and_then(|kind| registry.kind(kind.text()?));
    for entry in node.entries().iter().filter(|entry| !known.contains(&entry.key.as_str())) {
        let key = &entry.key;
        let error = Diagnostic::error(&entry.key_place, format!("unknown key `{key}` in {what}"));
        let kind = kind.as_ref().filter(|kind| kind.schema["properties"].get(key).is_some());
        report.push(match kind {
            Some(kind) => error.label("belongs under `with`").help(under_with(node, entry, kind.kind)),
            None => error.label("no such key").maybe_help(names::key_suggestion(entry, known)),
        });
    }
}

fn under_with(node: &Node, entry: &Entry, kind: &str) -> String {
    let key = &entry.key;
    let value = names::short_value(&entry.value);
    let corrected = match node.get("with").is_some_and(|with| !with.is_null()) {
        true => format!("move it into `with`: `{key}: {value}`"),
        false => format!("write `with: {{ {key}: {value} }}`"),
    };
    format!("`{key}` is a parameter of `{kind}`: {corrected}")
}

/// Whether a key is misspelt or has its old name, and was reported with this one as the suggestion.
pub(crate) fn misspelt(node: &Node, key: &str, known: &[&str]) -> bool {
    let unknown = node.entries().iter().filter(|entry| !known.contains(&entry.key.as_str()));
    unknown.into_iter().any(|entry| {
        let suggested = names::new_name(&entry.key, known);
        suggested.or_else(|| names::nearest(&entry.key, known.iter().copied())) == Some(key)
    })
}

fn is_map(node: &Node, what: &str, example: &str, report: &mut Report) -> bool {
    if !node.is_map() {
        report.push(node.not_a(what, "a map").label("not a map").help(format!("e.g. `{example}`")));
    }
    node.is_map()
}

fn source(entry: &Entry, registry: &Registry, report: &mut Report) -> SourceSpec {
    let name = entry.key();
    let node = &entry.value;
    let mut parts = Vec::new();
    if !map_of(entry, "a source", "{ kind: KIND, with: { ... } }", report) {
        return SourceSpec { name, parts };
    }
    instance_keys(node, "a source", SOURCE_KEYS, registry, report);
    match node.entry("concat") {
        None if misspelt(node, "concat", SOURCE_KEYS) => {}
        None => parts.extend(instance(node, &entry.key_place, "source", report)),
        Some(concat) => {
            for other in node.entries().iter().filter(|e| matches!(e.key.as_str(), "kind" | "with")) {
                let error = Diagnostic::error(&other.key_place, format!("`{}` beside `concat`", other.key));
                report.push(error.help("each of the sources in `concat` has its own `kind` and `with`"));
            }
            match &concat.value.value {
                Tree::List(items) if !items.is_empty() => {
                    for item in items {
                        if is_map(item, "a joined source", "{ kind: KIND, with: { ... } }", report) {
                            instance_keys(item, "a joined source", &["kind", "with"], registry, report);
                            parts.extend(instance(item, &item.place, "source", report));
                        }
                    }
                }
                _ => {
                    let error = Diagnostic::error(&concat.value.place, "`concat` must be a list of sources");
                    report.push(error.help("e.g. `concat: [ { kind: KIND }, { kind: KIND } ]`"));
                }
            }
        }
    }
    SourceSpec { name, parts }
}

/// As [`is_map`]; an empty value has no text of its own to underline.
fn map_of(entry: &Entry, what: &str, example: &str, report: &mut Report) -> bool {
    if entry.value.is_null() {
        let error = Diagnostic::error(&entry.key_place, format!("`{}` is empty: {what} must be a map", entry.key));
        let removal = "`null` takes away what this file inherits by `extends`, and nothing of that name is inherited";
        let help = match matches!(entry.value.place.text(), "null" | "~" | "Null" | "NULL") {
            true => format!("{removal}; e.g. `{example}`"),
            false => format!("e.g. `{example}`"),
        };
        report.push(error.help(help));
        return false;
    }
    is_map(&entry.value, what, example, report)
}

fn instance(node: &Node, place: &Place, what: &str, report: &mut Report) -> Option<Instance> {
    let Some(kind) = node.entry("kind") else {
        if misspelt(node, "kind", NODE_KEYS) {
            return None;
        }
        let error = Diagnostic::error(place, format!("this {what} has no `kind`"));
        report.push(error.help("set its `kind:`, e.g. `kind: family/name`; `depthloom nodes` lists all kinds"));
        return None;
    };
    let Some(text) = kind.value.text() else {
        report.push(kind.not_a("the name of a kind").help("`depthloom nodes` lists all kinds"));
        return None;
    };
    let kind = Word { text: text.to_owned(), place: kind.value.place.clone() };
    let with = node
        .entry("with")
        .filter(|with| with.value.is_null() || is_map(&with.value, "`with`", "with: { parameter: value }", report));
    Some(Instance { kind, with: with.map(|with| Arc::clone(&with.value)) })
}

fn stage(entry: &Entry, registry: &Registry, report: &mut Report) -> StageSpec {
    let name = entry.key();
    let mut stage = StageSpec { name, source: None, nodes: Vec::new(), score: None };
    if !map_of(entry, "a stage", "{ source: SOURCE, nodes: { ... } }", report) {
        return stage;
    }
    let node = &entry.value;
    known_keys(node, "a stage", STAGE_KEYS, report);
    match node.entry("source") {
        None if misspelt(node, "source", STAGE_KEYS) => {}
        None => {
            let error = Diagnostic::error(&entry.key_place, format!("stage `{}` has no `source`", entry.key));
            report.push(error.help("write `source: NAME`, with one of the names in `sources`"));
        }
        Some(source) => match source.value.scalar_text() {
            Some(text) => stage.source = Some(Word { text, place: source.value.place.clone() }),
            None => report.push(source.not_a("the name of a source").help("e.g. `source: NAME`")),
        },
    }
    if let Some(nodes) = node.entry("nodes").filter(|nodes| !nodes.value.is_null()) {
        is_map(&nodes.value, "`nodes`", "nodes: { NAME: { kind: KIND, inputs: { ... } } }", report);
        for entry in nodes.value.entries() {
            names::check(&entry.key, "a node", RESERVED_NODES, &entry.key_place, report);
            stage.nodes.push(node_spec(entry, registry, report));
        }
    }
    if let Some(score) = node.entry("score").filter(|score| map_of(score, "`score`", SCORE_EXAMPLE, report)) {
        stage.score = Some(score_spec(score, report));
    }
    stage
}

const SCORE_EXAMPLE: &str = "score: { ground_truth: source/depth, estimates: { stereo: depth/depth } }";

fn node_spec(entry: &Entry, registry: &Registry, report: &mut Report) -> NodeSpec {
    let name = entry.key();
    let mut spec = NodeSpec { name, instance: None, inputs: Vec::new() };
    if !map_of(entry, "a node", "{ kind: KIND, inputs: { ... }, with: { ... } }", report) {
        return spec;
    }
    instance_keys(&entry.value, "a node", NODE_KEYS, registry, report);
    spec.instance = instance(&entry.value, &entry.key_place, "node", report);
    if let Some(inputs) = entry.value.entry("inputs").filter(|inputs| !inputs.value.is_null()) {
        is_map(&inputs.value, "`inputs`", "inputs: { image: source/left }", report);
        for entry in inputs.value.entries().iter().filter(|entry| is_of_node(entry)) {
            let key = &entry.key;
            let error = Diagnostic::error(&entry.key_place, format!("`{key}` is inside `inputs`, but is not an input"));
            let form = "NAME: { kind: KIND, inputs: { PORT: NODE/OUTPUT }, with: { PARAMETER: VALUE } }";
            report.push(error.label("belongs beside `inputs`").help(format!("move it out, one level up: `{form}`")));
        }
        let entries = inputs.value.entries().iter().filter(|entry| !is_of_node(entry));
        spec.inputs = entries.map(|entry| optional_input(entry, report)).collect();
    }
    spec
}

fn is_of_node(entry: &Entry) -> bool {
    NODE_KEYS.contains(&entry.key.as_str()) && (entry.key == "with" || entry.value.is_map())
}

/// An input that `null` leaves unwired.
fn optional_input(entry: &Entry, report: &mut Report) -> InputSpec {
    if entry.value.is_null() {
        return InputSpec { port: entry.key(), place: entry.key_place.clone(), from: Some(Wired::Nothing) };
    }
    input(entry, report)
}

fn input(entry: &Entry, report: &mut Report) -> InputSpec {
    let port = entry.key();
    let node = &entry.value;
    let form = "write `node/output`, `source/output`, `stage.node/output`, or `{ file: PATH }` for an aggregate value";
    let (from, place) = match &node.value {
        Tree::Text(text) => match Reference::parse(text, &node.place) {
            Ok(reference) => (Some(Wired::Reference(reference)), node.place.clone()),
            Err(what) => {
                report.push(Diagnostic::error(&node.place, what).label("not a reference").help(form));
                (None, node.place.clone())
            }
        },
        Tree::Map(_) if node.entry("file").is_some() => {
            known_keys(node, "an input", &["file"], report);
            (node.get("file").map(|file| Wired::File(Arc::clone(file))), node.place.clone())
        }
        _ => {
            report.push(entry.not_a("a reference to an output").help(form));
            (None, entry.value_place().clone())
        }
    };
    InputSpec { port, place, from }
}

/// Reports and removes a misspelt `key` among a score's parameters.
fn misspelt_own_key(parameters: &mut Vec<Entry>, key: &str, what: &str, report: &mut Report) -> bool {
    let Some(at) = parameters.iter().position(|entry| names::nearest(&entry.key, [key]).is_some()) else {
        return false;
    };
    let entry = parameters.remove(at);
    let error = Diagnostic::error(&entry.key_place, format!("unknown key `{}` in {what}", entry.key));
    report.push(
        error
            .label("no such key")
            .help(names::renamed_key(&entry, &[key]).unwrap_or_else(|| format!("did you mean `{key}`?"))),
    );
    true
}

fn score_spec(entry: &Entry, report: &mut Report) -> ScoreSpec {
    let own = |key: &str| matches!(key, "ground_truth" | "estimates") || CLUES.contains(&key);
    let mut parameters: Vec<Entry> = entry.value.entries().iter().filter(|e| !own(&e.key)).cloned().collect();
    let missing = |key: &str| entry.value.entry(key).is_none();
    let no_estimates = missing("estimates") && !misspelt_own_key(&mut parameters, "estimates", "`score`", report);
    let truth = entry.value.entry("ground_truth").map(|truth| input(truth, report));
    // Each estimate may have its own ground truth.
    let has_own = |estimate: &Entry| estimate.value.is_null() || estimate.value.entry("ground_truth").is_some();
    let estimates = entry.value.get("estimates").map_or(&[][..], |estimates| estimates.entries());
    let wanted = estimates.is_empty() || !estimates.iter().all(has_own);
    if truth.is_none() && wanted && !misspelt_own_key(&mut parameters, "ground_truth", "`score`", report) {
        let error = Diagnostic::error(&entry.key_place, "`score` has no `ground_truth`");
        report.push(error.help("name the ground truth, e.g. `ground_truth: source/depth`"));
    }
    let clues = clues(&entry.value, report);
    let mut score = ScoreSpec { place: entry.key_place.clone(), truth, clues, parameters, estimates: Vec::new() };
    match entry.value.entry("estimates") {
        Some(estimates) if matches!(&estimates.value.value, Tree::Map(list) if !list.is_empty()) => {
            // `null` removes an estimate in a variant or in an experiment that extends another.
            for entry in estimates.value.entries().iter().filter(|entry| !entry.value.is_null()) {
                names::check(&entry.key, "an estimate", &[], &entry.key_place, report);
                score.estimates.push(estimate(entry, report));
            }
            if score.estimates.is_empty() {
                let error = Diagnostic::error(&estimates.key_place, "every entry of `estimates` is removed (`null`)");
                report.push(error.help("name what is scored, e.g. `estimates: { stereo: depth/depth }`"));
            }
        }
        Some(estimates) => {
            let error =
                Diagnostic::error(&estimates.key_place, "`estimates` must be a map from names to `node/output`");
            report.push(error.help("e.g. `estimates: { stereo: depth/depth }`"));
        }
        None if !no_estimates => {}
        None => {
            let error = Diagnostic::error(&entry.key_place, "`score` has no `estimates`");
            report.push(error.help("name what is scored, e.g. `estimates: { stereo: depth/depth }`"));
        }
    }
    score
}

fn estimate(entry: &Entry, report: &mut Report) -> EstimateSpec {
    let name = entry.key();
    if !entry.value.is_map() {
        let from = Some(input(entry, report));
        return EstimateSpec { name, from, truth: None, clues: Vec::new(), parameters: Vec::new() };
    }
    let from = entry.value.entry("from");
    let own = |key: &str| matches!(key, "from" | "ground_truth") || CLUES.contains(&key);
    let mut parameters: Vec<Entry> = entry.value.entries().iter().filter(|e| !own(&e.key)).cloned().collect();
    if from.is_none() && !misspelt_own_key(&mut parameters, "from", "an estimate", report) {
        let error = Diagnostic::error(&entry.key_place, format!("estimate `{}` has no `from`", entry.key));
        report.push(error.help("`from: node/output` names the depth that is scored"));
    }
    let from = from.map(|from| input(from, report));
    let truth = entry.value.entry("ground_truth").map(|truth| input(truth, report));
    if truth.is_none() {
        misspelt_own_key(&mut parameters, "ground_truth", "an estimate", report);
    }
    EstimateSpec { name, from, truth, clues: clues(&entry.value, report), parameters }
}

fn clues(node: &Node, report: &mut Report) -> Vec<InputSpec> {
    CLUES.iter().filter_map(|key| Some(optional_input(node.entry(key)?, report))).collect()
}
