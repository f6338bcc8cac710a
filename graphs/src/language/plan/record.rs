//! `record:`: what is kept of a run; by default everything.
//!
//! A list of patterns, or `{ preset: lean, topics: [...], every: N, view: false, points: [...] }`. A pattern is
//! `[stage.]node[/port]` or `/stage[/node[/port]]`, where `*` stands for any characters and a missing part for all.
//! `!` in front excludes outputs of earlier patterns. Scores are always kept.

use std::cell::Cell;

use super::linked::Linked;
use crate::language::check::schema_check::is_yaml_1_1_bool;
use crate::language::check::spec::known_keys;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::glob::glob;
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::plan::{OutputPattern, Record};
use crate::{Port, Rate, ValueType};

pub(crate) struct Recorded {
    pub(crate) record: Record,
    preset: Preset,
    /// Changes to the preset, in order. `None`: none.
    patterns: Option<Vec<Pattern>>,
    points: Vec<Pattern>,
}

/// What is recorded if no pattern matches.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Preset {
    Everything,
    /// Inputs, disparities, metrics, numbers and aggregate values: what other values can be recomputed from, and what
    /// is costly to recompute.
    Lean,
    Nothing,
}

impl Preset {
    fn keeps(self, node: &str, port: &Port) -> bool {
        use ValueType::{Disparity, Number, Scores, TrueDisparity};
        match self {
            Self::Everything => true,
            Self::Lean => {
                node == "source"
                    || port.rate == Rate::Once
                    || matches!(port.value_type, Disparity | TrueDisparity | Scores | Number)
            }
            Self::Nothing => false,
        }
    }
}

struct Pattern {
    text: String,
    place: Place,
    leaves_out: bool,
    output: OutputPattern,
    matched: Cell<bool>,
}

impl Recorded {
    /// The source of a stage is its node `source`.
    pub(crate) fn keeps(&self, stage: &str, node: &str, port: &Port) -> bool {
        let mut is_recorded = self.preset.keeps(node, port);
        for pattern in self.patterns.iter().flatten() {
            if pattern.output.names(stage, node, port.name) {
                pattern.matched.set(true);
                is_recorded = !pattern.leaves_out;
            }
        }
        is_recorded
    }

    /// Whether a pattern names the stage or a node of it.
    pub(crate) fn asks_for(&self, stage: &str) -> bool {
        self.patterns.iter().flatten().any(|Pattern { output, leaves_out, .. }| {
            (output.stage != "*" || output.node != "*") && !leaves_out && glob(&output.stage, stage)
        })
    }

    /// Reports patterns that match no output of any variant.
    pub(crate) fn check(&self, variants: &[Linked<'_>], report: &mut Report) {
        self.check_points(variants, report);
        let Some(patterns) = &self.patterns else { return };
        let mut topics: Vec<String> = Vec::new();
        let mut outputs: Vec<&str> = Vec::new();
        let mut whole = true;
        for stage in variants.iter().flat_map(|linked| &linked.stages) {
            let source = stage.source.as_ref().map(|source| ("source", source.outputs.as_slice()));
            let nodes = stage.nodes.iter().map(|node| {
                whole &= node.types.signature.is_some();
                (node.name.text.as_str(), node.types.outputs())
            });
            for (node, ports) in source.into_iter().chain(nodes) {
                for port in ports {
                    self.keeps(&stage.name.text, node, port);
                    topics.push(format!("{}.{node}/{}", stage.name.text, port.name));
                    outputs.push(port.name);
                }
            }
        }
        if !whole {
            return;
        }
        topics.sort();
        topics.dedup();
        for pattern in patterns.iter().filter(|pattern| !pattern.matched.get()) {
            let written = pattern.text.trim_start_matches(['!', '/']);
            let written = if pattern.text.contains("./") {
                written.to_owned()
            } else {
                written.replacen('/', ".", usize::from(pattern.text.trim_start_matches('!').starts_with('/')))
            };
            let nodes = topics.iter().filter_map(|topic| Some(topic.split_once('.')?.1));
            let near = names::nearest(&written, topics.iter().map(String::as_str).chain(nodes));
            let of_outputs =
                !pattern.text.contains('/') && outputs.iter().any(|output| glob(&pattern.output.node, output));
            let help = match near {
                _ if of_outputs => {
                    format!("without `/` a pattern names nodes; outputs of any node are `*/{}`", pattern.output.node)
                }
                Some(near) => format!("did you mean `{near}`?"),
                None => FORM.to_owned(),
            };
            let what = format!("`{}` matches nothing that could be recorded", pattern.text);
            report.push(Diagnostic::error(&pattern.place, what).label("matches nothing").help(help));
        }
    }

    /// Points need a recorded depth, and the recorded calibration of its source.
    fn check_points(&self, variants: &[Linked<'_>], report: &mut Report) {
        for stage in variants.iter().flat_map(|linked| &linked.stages) {
            let name = stage.name.text.as_str();
            let source = stage.source.as_ref().map_or(&[][..], |source| source.outputs.as_slice());
            let has_calibration =
                source.iter().any(|port| port.value_type == ValueType::Calibration && self.keeps(name, "source", port));
            let nodes = stage.nodes.iter().map(|node| {
                // Unknown for an unknown kind.
                let outputs = node.types.signature.as_ref().map(|signature| signature.outputs.as_slice());
                (node.name.text.as_str(), outputs)
            });
            for (node, ports) in nodes.chain([("source", Some(source))]) {
                for pattern in &self.points {
                    let is_meant = |port: &Port| {
                        pattern.output.names(name, node, port.name)
                            && port.value_type == ValueType::Depth
                            && self.keeps(name, node, port)
                    };
                    let is_unknown = ports.is_none() && glob(&pattern.output.node, node);
                    if is_unknown || (has_calibration && ports.is_some_and(|ports| ports.iter().any(is_meant))) {
                        pattern.matched.set(true);
                    }
                }
            }
        }
        for pattern in self.points.iter().filter(|pattern| !pattern.matched.get()) {
            let what = format!("`{}` matches no depth that points could be kept of", pattern.text);
            let help = "points are of depths that are recorded, in stages whose source's calibration is";
            report.push(Diagnostic::error(&pattern.place, what).label("matches nothing").help(help));
        }
    }
}

pub(crate) fn read(root: &Node, report: &mut Report) -> Recorded {
    let record = Record { every: 1, view: true, points: Vec::new() };
    let mut recording = Recorded { record, preset: Preset::Everything, patterns: None, points: Vec::new() };
    let Some(entry) = root.entry("record").filter(|entry| !entry.value.is_null()) else { return recording };
    match &entry.value.value {
        Tree::List(items) => {
            recording.preset = Preset::Nothing;
            recording.patterns = Some(items.iter().filter_map(|item| pattern(item, report)).collect());
        }
        Tree::Map(entries) => {
            known_keys(&entry.value, "`record`", &["preset", "topics", "every", "view", "points"], report);
            for entry in entries {
                setting(entry, &mut recording, report);
            }
            if recording.preset == Preset::Everything && recording.patterns.is_some() {
                recording.preset = Preset::Nothing;
            }
        }
        _ => {
            let help =
                "e.g. `record: [compare.*/depth]` or `record: { every: 10 }`; without `record` everything is recorded";
            report.push(entry.not_a("a list of patterns or a map").help(help));
        }
    }
    recording
}

fn setting(entry: &Entry, recording: &mut Recorded, report: &mut Report) {
    let node = &entry.value;
    let mut patterns = || match &node.value {
        Tree::List(items) => items.iter().filter_map(|item| pattern(item, report)).collect(),
        _ => {
            report.push(entry.not_a("a list of patterns").help(format!("e.g. `{}: [compare.*/depth]`", entry.key)));
            Vec::new()
        }
    };
    match (entry.key.as_str(), &node.value) {
        ("topics", _) => recording.patterns = Some(patterns()),
        ("points", _) => {
            recording.points = patterns();
            recording.record.points = recording.points.iter().map(|pattern| pattern.output.clone()).collect();
        }
        ("preset", Tree::Text(text)) if text == "lean" => recording.preset = Preset::Lean,
        ("preset", _) => {
            let help = "`preset: lean` records inputs, disparities, metrics, numbers and trained networks; `topics` adds to them";
            report.push(entry.not_a("`lean`").help(help));
        }
        ("every", Tree::Number(number)) => match number.as_u64() {
            Some(every) if every >= 1 => recording.record.every = every,
            _ => {
                let what = format!("`every` must be a whole number of at least 1, not {number}");
                report.push(Diagnostic::error(&node.place, what).help("`every: 10` records every tenth frame"));
            }
        },
        ("every", _) => report.push(entry.not_a("a whole number").help("`every: 10` records every tenth frame")),
        ("view", Tree::Bool(view)) => recording.record.view = *view,
        ("view", _) => {
            let is_bool = node.text().is_some_and(is_yaml_1_1_bool);
            let help = is_bool.then(|| "YAML 1.2 knows `true` and `false` only".to_owned());
            report.push(entry.not_a("`true` or `false`").maybe_help(help));
        }
        _ => {}
    }
}

const FORM: &str = "patterns are written `stage.node/port`, `node`, `/stage/node/port`, with `*` for anything";

fn pattern(item: &Node, report: &mut Report) -> Option<Pattern> {
    let Some(text) = item.text() else {
        report.push(Diagnostic::error(&item.place, format!("a pattern is text, not {}", item.describe())).help(FORM));
        return None;
    };
    let (leaves_out, bare) = text.strip_prefix('!').map_or((false, text), |bare| (true, bare));
    let all = || "*".to_owned();
    let parts: Vec<&str> = bare.split('/').collect();
    let (stage, node, port) = match parts.as_slice() {
        ["", stage] => ((*stage).to_owned(), all(), all()),
        ["", stage, node] => ((*stage).to_owned(), (*node).to_owned(), all()),
        ["", stage, node, port] => ((*stage).to_owned(), (*node).to_owned(), (*port).to_owned()),
        [name] | [name, _] if !name.is_empty() => {
            let (stage, node) = name.split_once('.').map_or((all(), *name), |(stage, node)| (stage.to_owned(), node));
            (stage, node.to_owned(), parts.get(1).map_or_else(all, |port| (*port).to_owned()))
        }
        _ => {
            report.push(Diagnostic::error(&item.place, format!("`{text}` is not a pattern")).help(FORM));
            return None;
        }
    };
    let place = item.place.clone();
    let output = OutputPattern { stage, node, port };
    Some(Pattern { text: text.to_owned(), place, leaves_out, output, matched: Cell::new(false) })
}
