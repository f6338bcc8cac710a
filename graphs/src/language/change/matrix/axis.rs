//! An axis of a matrix: what it is called, what it sets, the values it takes, and when it is there.

use std::sync::Arc;

use super::range::{self, Numbers, Range};
use crate::language::change::apply::Change;
use crate::language::change::overrides::is_argument;
use crate::language::change::parameter::Parameters;
use crate::language::change::path::AXIS_KEYS;
use crate::language::change::variant;
use crate::language::check::spec::{known_keys, misspelt};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::resolved::as_written;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::plan::Factor;

pub(super) type Part = Arc<Level>;

pub(super) type Combination = Vec<Part>;

const FORM: &str =
    "an axis is a list of values, a range `{ from: 2, to: 64, steps: 6 }`, or a map of `paths`, `values` and `when`";

#[derive(Clone)]
pub(super) struct Axis {
    /// Its name, or the path it sets.
    pub(super) key: String,
    pub(super) place: Place,
    /// Where a plain value is set; empty where every value is a map of changes.
    pub(super) paths: Vec<(String, Place)>,
    pub(super) values: Values,
    /// When the axis is present; always, if empty.
    pub(super) when: Vec<Condition>,
}

#[derive(Clone)]
pub(super) enum Values {
    Listed(Vec<Arc<Level>>),
    /// All numbers between two ends, of which a sample draws some.
    Between(Range),
}

#[derive(Clone)]
pub(super) struct Level {
    /// Name or path of its axis.
    pub(super) axis: String,
    /// As written, or its name.
    pub(super) text: String,
    pub(super) changes: Vec<Change>,
}

#[derive(Clone)]
pub(super) struct Condition {
    pub(super) of: String,
    pub(super) place: Place,
    pub(super) among: Vec<Arc<Node>>,
}

impl Axis {
    pub(super) fn read(
        entry: &Entry,
        parameters: &Parameters<'_>,
        is_sampled: bool,
        report: &mut Report,
    ) -> Option<Self> {
        let (key, place, node) = (&entry.key, &entry.key_place, &entry.value);
        let is_path = key.contains('.');
        let mut axis = Self {
            key: key.clone(),
            place: place.clone(),
            paths: Vec::new(),
            values: Values::Listed(Vec::new()),
            when: Vec::new(),
        };
        // The key of a list is the path it is set at.
        if is_path || matches!(node.value, Tree::List(_)) {
            axis.paths.push((key.clone(), place.clone()));
        }
        let values = match &node.value {
            Tree::List(_) => node,
            Tree::Map(entries) if !entries.is_empty() => {
                known_keys(node, &format!("the axis `{key}`"), AXIS_KEYS, report);
                if !is_path {
                    names::check(key, "an axis", &[Factor::VARIANT], place, report);
                }
                match node.entry("paths") {
                    Some(entry) => axis.paths = paths(entry, report)?,
                    None if misspelt(node, "paths", AXIS_KEYS) => return None,
                    None => {}
                }
                axis.when = node.entry("when").map_or_else(Vec::new, |when| conditions(when, report));
                match node.get("values") {
                    Some(values) => values,
                    None if node.get("from").is_some() || node.get("to").is_some() => node,
                    None => {
                        report.push(
                            Diagnostic::error(place, format!("the axis `{key}` has no `values`"))
                                .label("takes no values")
                                .help(FORM),
                        );
                        return None;
                    }
                }
            }
            _ => {
                let error = node.not_a(&format!("`{key}`"), "a list of values");
                report.push(error.help("write the values in brackets: `[none, minmax]`"));
                return None;
            }
        };
        axis.values = axis.read_values(values, parameters, is_sampled, report)?;
        Some(axis)
    }

    fn read_values(
        &self,
        node: &Arc<Node>,
        parameters: &Parameters<'_>,
        is_sampled: bool,
        report: &mut Report,
    ) -> Option<Values> {
        let key = &self.key;
        let is_range = node.get("from").is_some() || node.get("to").is_some();
        let needs_paths = is_range || !node.is_map();
        if needs_paths && self.paths.is_empty() {
            let what = format!("the axis `{key}` has no `paths`");
            report.push(
                Diagnostic::error(&self.place, what)
                    .help("name the paths: `paths: [STAGE.NODE.with.X, STAGE.OTHER.with.X]`"),
            );
            return None;
        }
        match &node.value {
            Tree::List(values) if !values.is_empty() => Some(self.values_of(values)),
            Tree::Map(_) if is_range => {
                // The axis itself may be the range.
                let bare: Vec<Entry> =
                    node.entries().iter().filter(|e| !matches!(e.key.as_str(), "paths" | "when")).cloned().collect();
                let bare = Arc::new(Node::new(Tree::Map(bare), node.place.clone()));
                let schema = self.paths.iter().find_map(|(path, _)| parameters.schema(path));
                match range::read(&bare, &format!("`{key}`"), schema, report)? {
                    Numbers::Steps(values) => Some(self.values_of(&values)),
                    Numbers::Between(range) if is_sampled => Some(Values::Between(range)),
                    Numbers::Between(_) => {
                        let what = format!("the range of `{key}` does not say how many values it stands for");
                        report.push(
                            Diagnostic::error(&node.place, what).label("needs `steps`").help(
                                "`steps: 6` takes six, its ends among them; a `sample` beside the axes draws any",
                            ),
                        );
                        None
                    }
                }
            }
            Tree::Map(entries) if !entries.is_empty() => {
                let mut levels = Vec::with_capacity(entries.len());
                for entry in entries {
                    names::check(&entry.key, "a value of an axis", &[], &entry.key_place, report);
                    if !self.paths.is_empty() {
                        levels.push(Arc::new(self.level(entry.key.clone(), &entry.value)));
                        continue;
                    }
                    let what = format!("the value `{}` of the axis `{key}`", entry.key);
                    let changes = variant::changes(&entry.value, &what, report)?;
                    levels.push(Arc::new(Level { axis: key.clone(), text: entry.key.clone(), changes }));
                }
                Some(Values::Listed(levels))
            }
            Tree::List(_) | Tree::Map(_) | Tree::Null => {
                let place = if node.is_null() { &self.place } else { &node.place };
                report.push(
                    Diagnostic::error(place, format!("`{key}` has no values to take"))
                        .help("list at least one value, or remove it from the matrix"),
                );
                None
            }
            Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => {
                report.push(node.not_a(&format!("`{key}`"), "a list of values").help(FORM));
                None
            }
        }
    }

    pub(super) fn listed(&self) -> Option<Self> {
        let values = match &self.values {
            Values::Listed(levels) => Values::Listed(levels.clone()),
            Values::Between(range) => self.values_of(&range.whole_numbers(variant::MOST)?),
        };
        Some(Self { values, ..self.clone() })
    }

    fn values_of(&self, values: &[Arc<Node>]) -> Values {
        Values::Listed(values.iter().map(|value| Arc::new(self.level(value_text(value), value))).collect())
    }

    pub(super) fn level(&self, text: String, value: &Arc<Node>) -> Level {
        let change = |(path, place): &(String, Place)| Change {
            path: path.clone(),
            place: place.clone(),
            value: Arc::clone(value),
        };
        Level { axis: self.key.clone(), text, changes: self.paths.iter().map(change).collect() }
    }

    pub(super) fn len(&self) -> usize {
        match &self.values {
            Values::Listed(levels) => levels.len(),
            Values::Between(_) => usize::MAX,
        }
    }

    pub(super) fn named(&self, text: &str) -> Option<&Arc<Level>> {
        self.levels().iter().find(|level| level.text == text)
    }

    pub(super) fn no_value(&self, text: &str, place: &Place) -> Diagnostic {
        let known: Vec<&str> = self.levels().iter().map(|level| level.text.as_str()).collect();
        let error = Diagnostic::error(place, format!("the axis `{}` has no value `{text}`", self.key));
        let help = match text.parse::<f64>() {
            Ok(_) => Some(format!("its values: {}", names::listed(&known))),
            Err(_) => names::suggestion(text, "its values", &known),
        };
        error.label("no such value").maybe_help(help)
    }

    /// `--matrix` may leave out values that the file mentions.
    pub(super) fn never_has(&self, wanted: &Node) -> Option<Diagnostic> {
        let text = value_text(wanted);
        let mut changes = self.levels().iter().flat_map(|level| &level.changes);
        let is_open = self.levels().is_empty() || changes.any(|change| is_argument(&change.value.place.file));
        (!is_open && self.named(&text).is_none()).then(|| self.no_value(&text, &wanted.place))
    }

    fn levels(&self) -> &[Arc<Level>] {
        match &self.values {
            Values::Listed(levels) => levels,
            Values::Between(_) => &[],
        }
    }

    pub(super) fn sets(&self, path: &str) -> bool {
        let among = |changes: &[Change]| changes.iter().any(|change| change.path == path);
        self.paths.iter().any(|(own, _)| own == path) || self.levels().iter().any(|level| among(&level.changes))
    }
}

fn paths(entry: &Entry, report: &mut Report) -> Option<Vec<(String, Place)>> {
    let node = &entry.value;
    let items: Vec<&Arc<Node>> = match &node.value {
        Tree::List(items) if !items.is_empty() => items.iter().collect(),
        Tree::Text(_) => vec![node],
        _ => Vec::new(),
    };
    let paths: Option<Vec<(String, Place)>> =
        items.iter().map(|item| Some((item.text()?.to_owned(), item.place.clone()))).collect();
    let paths = paths.filter(|paths| !paths.is_empty());
    if paths.is_none() {
        report.push(
            Diagnostic::error(entry.value_place(), "`paths` must be the paths that take the axis's value")
                .help("e.g. `paths: [STAGE.LEFT.with.X, STAGE.RIGHT.with.X]`"),
        );
    }
    paths
}

fn conditions(entry: &Entry, report: &mut Report) -> Vec<Condition> {
    if !entry.value.is_map() || entry.value.entries().is_empty() {
        let error = match entry.value.is_map() {
            true => Diagnostic::error(&entry.value.place, "`when` names no condition"),
            false => entry.not_a("a map from paths or axes to values"),
        };
        report.push(error.help("e.g. `when: { STAGE.NODE.with.mode: hh }`; of several values, `[sgbm, hh]`"));
        return Vec::new();
    }
    let condition = |entry: &Entry| Condition {
        of: entry.key.clone(),
        place: entry.key_place.clone(),
        among: match &entry.value.value {
            Tree::List(values) => values.clone(),
            _ => vec![Arc::clone(&entry.value)],
        },
    };
    entry.value.entries().iter().map(condition).collect()
}

/// The value as written: with the name of a variable, not its value on this machine.
pub(super) fn value_text(value: &Node) -> String {
    match &value.written {
        Some(written) => written.text.replace("${", "").replace(":-", "-").replace('}', ""),
        None => value.scalar_text().unwrap_or_else(|| as_written(value, None).to_string()),
    }
}
