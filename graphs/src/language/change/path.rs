//! Resolves the path of a change, and explains paths that name nothing.

use std::ops::Range;
use std::sync::Arc;

use crate::language::text::names;
use crate::language::text::tree::{Entry, Node, Tree};

pub(super) const MATRIX_KEYS: &[&str] = &["include", "exclude", "sample"];
pub(super) const AXIS_KEYS: &[&str] = &["paths", "values", "when", "from", "to", "steps", "log"];
pub(super) const SAMPLE_KEYS: &[&str] = &["method", "count", "seed"];

const DEEPEST: usize = 32;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scope {
    Variant,
    CommandLine,
}

impl Scope {
    const fn describe(self) -> &'static str {
        match self {
            Self::Variant => "a variant",
            Self::CommandLine => "`--set`",
        }
    }
}

pub(crate) struct Unknown {
    pub(super) range: Range<usize>,
    pub(super) what: String,
    pub(super) help: Option<String>,
}

struct Path<'p> {
    text: &'p str,
    keys: Vec<(&'p str, Range<usize>)>,
}

impl<'p> Path<'p> {
    fn cut(text: &'p str) -> Self {
        let mut start = 0;
        let mut keys = Vec::new();
        for key in text.split('.') {
            keys.push((key, start..start + key.len()));
            start += key.len() + 1;
        }
        Self { text, keys }
    }

    fn len(&self) -> usize {
        self.keys.len()
    }

    fn key(&self, at: usize) -> Option<&'p str> {
        self.keys.get(at).map(|(key, _)| *key)
    }

    fn from(&self, at: usize) -> impl Iterator<Item = String> {
        self.keys.iter().skip(at).map(|(key, _)| (*key).to_owned())
    }

    fn text_from(&self, at: usize) -> Option<&'p str> {
        self.keys.get(at).map(|(_, range)| &self.text[range.start..])
    }

    fn unknown(&self, at: usize, what: impl Into<String>, help: Option<String>) -> Unknown {
        let range = self.keys.get(at).map_or(0..self.text.len(), |(_, range)| range.clone());
        Unknown { range, what: what.into(), help }
    }
}

pub(crate) fn keys(root: &Node, path: &str) -> Option<Vec<String>> {
    located(root, path, Scope::CommandLine).ok()
}

pub(crate) fn located(root: &Node, path: &str, scope: Scope) -> Result<Vec<String>, Unknown> {
    let path = Path::cut(path);
    if path.len() > DEEPEST {
        let what = format!("the path is deeper than {DEEPEST} keys, and no experiment is");
        return Err(Unknown { range: 0..path.text.len(), what, help: None });
    }
    if let Some(empty) = path.keys.iter().position(|(key, _)| key.trim().is_empty()) {
        let what = "a path is keys joined by dots, and one of these is empty";
        return Err(path.unknown(empty, what, Some(format!("e.g. `{}`", example(root)))));
    }
    let first = path.keys[0].0;
    let stage = root.get("stages").and_then(|stages| stages.get(first));
    let is_command_line = scope == Scope::CommandLine;
    match (first, stage) {
        ("record", _) | ("only", None) if is_command_line => Ok(path.from(0).collect()),
        ("variants", None) if is_command_line => in_variants(root, &path),
        ("matrix", None) if is_command_line => in_matrix(root, &path),
        ("sources", _) => in_sources(root, &path, scope),
        (_, Some(stage)) => in_stage(stage, &path, first),
        (_, None) => Err(no_stage(root, &path, first, scope)),
    }
}

/// The path that a variant changes is one key, with its dots.
fn in_variants(root: &Node, path: &Path<'_>) -> Result<Vec<String>, Unknown> {
    let known = keys_of(root.get("variants"));
    let Some(one) = known.first() else {
        let help =
            "another experiment that `extends` this one can add some, and `--matrix PATH=[...]` makes some of values";
        return Err(path.unknown(0, "there are no `variants` that `--set` could change", Some(help.to_owned())));
    };
    let Some(name) = path.key(1) else {
        let help = format!("e.g. `variants.{one}={{}}`, or `variants.{one}=null` to leave it out");
        return Err(path.unknown(0, "`--set` changes one entry of `variants` at a time", Some(help)));
    };
    if !known.contains(&name) {
        let what = format!("`variants` has no `{name}`");
        return Err(path.unknown(1, what, names::suggestion(name, "`variants` has", &known)));
    }
    Ok(["variants", name].into_iter().chain(path.text_from(2)).map(ToOwned::to_owned).collect())
}

/// In a list of matrices, the one that has the axis, or `matrix.0.PATH`. An unknown path becomes a new axis.
fn in_matrix(root: &Node, path: &Path<'_>) -> Result<Vec<String>, Unknown> {
    let matrix = root.get("matrix");
    let Some(name) = path.text_from(1) else {
        let one = keys_of(matrix).first().map_or_else(|| example(root), |one| (*one).to_owned());
        let what = "`--set` changes one axis of `matrix` at a time";
        return Err(path.unknown(0, what, Some(format!("e.g. `--matrix '{one}=[...]'`"))));
    };
    let below = |above: &[&str], matrix: Option<&Arc<Node>>, name: &str| -> Vec<String> {
        let own = within_matrix(matrix, name).unwrap_or_else(|| match name.split_once('.') {
            Some((sample @ "sample", key)) if SAMPLE_KEYS.contains(&key) => vec![sample, key],
            _ => vec![name],
        });
        above.iter().copied().chain(own).map(ToOwned::to_owned).collect()
    };
    if let Some(Tree::List(matrices)) = matrix.map(|matrix| &matrix.value) {
        let index = path.key(1).filter(|index| index.parse().is_ok_and(|index: usize| index < matrices.len()));
        if let (Some(index), Some(name)) = (index, path.text_from(2)) {
            let matrix = index.parse::<usize>().ok().and_then(|index| matrices.get(index));
            return Ok(below(&["matrix", index], matrix, name));
        }
        let with: Vec<usize> =
            (0..matrices.len()).filter(|&index| within_matrix(Some(&matrices[index]), name).is_some()).collect();
        return match with.as_slice() {
            [one] => Ok(below(&["matrix", &one.to_string()], matrices.get(*one), name)),
            several => {
                let has = if several.is_empty() { "none has" } else { "several have" };
                let what = format!("of {} matrices {has} `{name}`", matrices.len());
                Err(path.unknown(1, what, Some(format!("name the matrix by its index: `matrix.0.{name}`"))))
            }
        };
    }
    let known = keys_of(matrix);
    if !name.contains('.') && !known.contains(&name) && !MATRIX_KEYS.contains(&name) {
        let help = match known.is_empty() {
            true => Some(format!("an axis is the path that takes its values, e.g. `{}`", example(root))),
            false => names::suggestion(name, "its axes", &known),
        };
        return Err(path.unknown(1, format!("`matrix` has no axis `{name}`"), help));
    }
    let is_path =
        |first: &str| first == "sources" || root.get("stages").is_some_and(|stages| stages.get(first).is_some());
    if let (Some(axis), Some(key)) = (path.key(1), path.key(2))
        && !is_path(axis)
        && !MATRIX_KEYS.contains(&axis)
        && within_matrix(matrix, name).is_none()
    {
        if known.contains(&axis) {
            let what = format!("the axis `{axis}` has no `{key}`");
            return Err(path.unknown(2, what, names::suggestion(key, "it takes", AXIS_KEYS)));
        }
        if path.len() == 3 && AXIS_KEYS.contains(&key) {
            let what = format!("`matrix` has no axis `{axis}`");
            return Err(path.unknown(1, what, names::suggestion(axis, "its axes", &known)));
        }
    }
    Ok(below(&["matrix"], matrix, name))
}

/// The keys of a matrix that a name stands for: an axis, or a key of an axis or of `sample`.
fn within_matrix<'p>(matrix: Option<&Arc<Node>>, name: &'p str) -> Option<Vec<&'p str>> {
    let axis_of = |key: &str| matrix?.get(key);
    if axis_of(name).is_some() {
        return Some(vec![name]);
    }
    let (axis, rest) = match name.split_once('.') {
        Some((first, rest)) if first == "sample" || axis_of(first).is_some() => (first, rest),
        _ => name.rsplit_once('.')?,
    };
    let node = axis_of(axis);
    if axis == "sample" {
        return (node.is_some() && !rest.contains('.')).then(|| vec![axis, rest]);
    }
    let (key, deeper) = rest.split_once('.').map_or((rest, None), |(key, deeper)| (key, Some(deeper)));
    match &node?.value {
        Tree::Map(_) if AXIS_KEYS.contains(&key) => Some([axis, key].into_iter().chain(deeper).collect()),
        Tree::List(_) if rest == "values" => Some(vec![axis]),
        _ => None,
    }
}

fn in_sources(root: &Node, path: &Path<'_>, scope: Scope) -> Result<Vec<String>, Unknown> {
    let known = keys_of(root.get("sources"));
    let Some(name) = path.key(1) else {
        let what = format!("{} changes one source at a time, not all `sources`", scope.describe());
        let help = format!("e.g. `sources.{}.with.PARAMETER`", known.first().unwrap_or(&"NAME"));
        return Err(path.unknown(0, what, Some(help)));
    };
    if !known.contains(&name) {
        let what = format!("there is no source `{name}`");
        return Err(path.unknown(1, what, names::suggestion(name, "sources", &known)));
    }
    match path.key(2) {
        None | Some("kind" | "with" | "concat") => Ok(path.from(0).collect()),
        Some(other) => {
            let help = names::renamed(other, &["concat"])
                .unwrap_or_else(|| format!("did you mean `sources.{name}.with.{other}`?"));
            Err(path.unknown(2, format!("a source has no `{other}`"), Some(help)))
        }
    }
}

fn in_stage(stage: &Node, path: &Path<'_>, stage_name: &str) -> Result<Vec<String>, Unknown> {
    let nodes = keys_of(stage.get("nodes"));
    let Some(name) = path.key(1) else {
        let what = format!("`{stage_name}` is a whole stage: the path ends too early");
        let node = nodes.first().unwrap_or(&"NODE");
        return Err(path.unknown(0, what, Some(format!("e.g. `{stage_name}.{node}.with.PARAMETER`"))));
    };
    let below = |section: &[&str], from: usize| {
        let start = ["stages", stage_name].into_iter().chain(section.iter().copied()).map(ToOwned::to_owned);
        start.chain(path.from(from)).collect::<Vec<String>>()
    };
    let score = stage.get("score");
    match (name, score) {
        _ if nodes.contains(&name) => check_node(path, stage_name, name).map(|()| below(&["nodes"], 1)),
        ("source", _) if path.len() == 2 => Ok(below(&[], 1)),
        ("score", Some(score)) => check_score(score, path, stage_name).map(|()| below(&[], 1)),
        _ => Err(no_node(&nodes, score.is_some(), path, stage_name, name)),
    }
}

fn check_node(path: &Path<'_>, stage: &str, node: &str) -> Result<(), Unknown> {
    match path.key(2) {
        None | Some("with") => Ok(()),
        Some("kind") if path.len() == 3 => Ok(()),
        Some("inputs") if path.len() <= 4 => Ok(()),
        Some(key @ ("kind" | "inputs")) => {
            let help = match key {
                "kind" => format!("set the kind as a whole: `{stage}.{node}.kind`"),
                _ => format!("set the input as a whole: `{stage}.{node}.inputs.{}`", path.key(3).unwrap_or("NAME")),
            };
            Err(path.unknown(path.len() - 1, format!("`{key}` of a node has no keys below it"), Some(help)))
        }
        Some(other) => {
            let help = match names::nearest(other, ["kind", "inputs", "with"]) {
                Some(near) => format!("did you mean `{stage}.{node}.{near}`?"),
                None => format!("did you mean `{stage}.{node}.with.{other}`?"),
            };
            Err(path.unknown(2, format!("a node has no `{other}`"), Some(help)))
        }
    }
}

fn check_score(score: &Node, path: &Path<'_>, stage: &str) -> Result<(), Unknown> {
    let known = keys_of(score.get("estimates"));
    match (path.key(2), path.key(3)) {
        (Some("estimates"), Some(estimate)) if !known.contains(&estimate) => {
            let help = names::suggestion(estimate, "estimates", &known);
            Err(path.unknown(3, format!("stage `{stage}` has no estimate `{estimate}`"), help))
        }
        _ => Ok(()),
    }
}

fn no_node(nodes: &[&str], has_score: bool, path: &Path<'_>, stage: &str, name: &str) -> Unknown {
    let candidates: Vec<&str> = nodes.iter().copied().chain(["source"]).chain(has_score.then_some("score")).collect();
    let help = match path.text_from(2) {
        Some(rest) if name == "nodes" => Some(format!("leave out `nodes.`: `{stage}.{rest}`")),
        _ => names::suggestion(name, "nodes of the stage", &candidates),
    };
    path.unknown(1, format!("stage `{stage}` has no node `{name}`"), help)
}

fn no_stage(root: &Node, path: &Path<'_>, first: &str, scope: Scope) -> Unknown {
    if first == "stages" {
        let Some(rest) = path.text_from(1) else {
            let what = format!("{} changes one node at a time, not all `stages`", scope.describe());
            return path.unknown(0, what, Some(format!("e.g. `{}`", example(root))));
        };
        return begins_with_stages(root, path, rest, scope);
    }
    if names::EXPERIMENT_KEYS.contains(&first) {
        let what = format!("{} cannot change `{first}`", scope.describe());
        let others = match scope {
            Scope::CommandLine => ", `sources`, `record`, `only`, entries of `variants` and axes of `matrix`",
            Scope::Variant => " and `sources`",
        };
        let help = format!(
            "it changes stages{others}, e.g. `{}`; another experiment that `extends` this one changes all",
            example(root)
        );
        return path.unknown(0, what, Some(help));
    }
    let mut known = keys_of(root.get("stages"));
    known.push("sources");
    if scope == Scope::CommandLine {
        known.extend(["record", "only", "variants", "matrix"]);
    }
    let help = names::suggestion(first, "a path begins with one of", &known);
    path.unknown(0, format!("there is no stage `{first}`"), help)
}

/// Suggests the path without `stages.`, or explains what would be wrong with it.
fn begins_with_stages(root: &Node, path: &Path<'_>, rest: &str, scope: Scope) -> Unknown {
    let corrected = match rest.split_once(".nodes.") {
        Some((stage, below)) if !stage.contains('.') => format!("{stage}.{below}"),
        _ => rest.to_owned(),
    };
    match located(root, &corrected, scope) {
        Ok(_) => {
            let what = "a path begins with the name of a stage itself";
            path.unknown(0, what, Some(format!("leave out `stages.`: `{corrected}`")))
        }
        Err(Unknown { what, help, .. }) => Unknown { range: 0..path.text.len(), what, help },
    }
}

fn example(root: &Node) -> String {
    let stage = root.get("stages").and_then(|stages| stages.entries().first());
    let node = stage.and_then(|stage| stage.value.get("nodes")?.entries().first());
    let name = |entry: Option<&Entry>, other: &str| entry.map_or_else(|| other.to_owned(), |entry| entry.key.clone());
    format!("{}.{}.with.PARAMETER", name(stage, "STAGE"), name(node, "NODE"))
}

pub(super) fn keys_of(node: Option<&Arc<Node>>) -> Vec<&str> {
    node.map(|node| node.entries().iter().map(|entry| entry.key.as_str()).collect()).unwrap_or_default()
}
