//! `matrix:`: every combination of the values of some axes, or some of them drawn, with `include` and `exclude`.
//!
//! A map is a matrix; a list of maps is several, one after the other.

mod axis;
mod condition;
mod naming;
mod range;
mod sample;

use std::collections::HashSet;
use std::sync::Arc;

use axis::{Axis, Combination, Level, Part, Values, value_text};
use sample::{Method, Sample};

use super::apply::Change;
use super::parameter::Parameters;
use super::path::MATRIX_KEYS;
use super::variant::{MOST, Variant, changes, too_many};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::plan::Factor;

const MOST_AXES: usize = 64;
const MOST_EXCLUDED: usize = 1000;

pub(crate) struct Matrix {
    axes: Vec<Axis>,
    sample: Option<Sample>,
    excluded: Vec<Listed>,
    included: Vec<Listed>,
    place: Place,
    is_whole: bool,
}

struct Listed {
    parts: Combination,
    place: Place,
}

/// A variant that a matrix multiplies.
struct Base<'a> {
    changes: &'a [Change],
    parameters: &'a Parameters<'a>,
}

type Combined = (String, Vec<Factor>, Vec<Change>);

pub(crate) fn read(parameters: &Parameters<'_>, report: &mut Report) -> Vec<Matrix> {
    let Some(entry) = parameters.root.entry("matrix") else { return Vec::new() };
    let wrong = |node: &Node, report: &mut Report| {
        let error = node.not_a("`matrix`", "a map from paths to lists");
        report.push(error.help("e.g. `matrix: { STAGE.NODE.with.X: [1, 2, 3] }`"));
    };
    let mut matrices = Vec::new();
    match &entry.value.value {
        Tree::Null => {}
        Tree::Map(entries) if entries.is_empty() => {}
        Tree::Map(entries) => matrices.extend(matrix(entries, &entry.key_place, parameters, report)),
        Tree::List(items) => {
            for item in items {
                match &item.value {
                    Tree::Map(entries) => matrices.extend(matrix(entries, &item.place, parameters, report)),
                    _ => wrong(item, report),
                }
            }
        }
        Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => wrong(&entry.value, report),
    }
    matrices
}

/// For each variant, the name, factors and changes of its combinations. No axis may be named by a `reserved` word.
pub(crate) fn combined(
    declared: &[Variant],
    reserved: &[&str],
    matrices: &[Matrix],
    parameters: &Parameters<'_>,
    report: &mut Report,
) -> Vec<Vec<Combined>> {
    let mut combinations: Vec<Vec<Combination>> = vec![Vec::new(); declared.len()];
    let count = |combinations: &[Vec<Combination>]| combinations.iter().map(Vec::len).sum::<usize>();
    for matrix in matrices {
        let before = count(&combinations);
        let mut found = vec![false; matrix.excluded.len()];
        let mut nowhere: Vec<&Axis> = matrix.axes.iter().filter(|axis| !axis.when.is_empty()).collect();
        for (variant, combinations) in declared.iter().zip(&mut combinations) {
            let base = Base { changes: &variant.changes, parameters };
            let own = matrix.combinations(&base, &mut found, report);
            nowhere.retain(|axis| !own.iter().flatten().any(|level| level.axis == axis.key));
            combinations.extend(own);
            if combinations.len() > MOST {
                return Vec::new();
            }
        }
        if !matrix.is_whole {
            continue;
        }
        for (listed, _) in matrix.excluded.iter().zip(found).filter(|(_, found)| !found && !matrix.axes.is_empty()) {
            matrix.excludes_nothing(listed, report);
        }
        if count(&combinations) == before && !report.has_errors() {
            let error = Diagnostic::error(&matrix.place, "the matrix has no combination left");
            report.push(error.help("`exclude` and `when` remove all of them: relax a condition, or add values"));
        }
        for axis in nowhere.into_iter().filter(|_| !report.has_errors()).collect::<Vec<_>>() {
            let what = format!("the axis `{}` is in no combination: its `when` never holds", axis.key);
            let warning = Diagnostic::warning(&axis.when[0].place, what).label("has another value everywhere");
            report.push(
                warning.help("let an axis above or a variant set it to one of these values, or leave the axis out"),
            );
        }
    }
    let mut all: Vec<String> = combinations.iter().flatten().flatten().map(|level| level.axis.clone()).collect();
    all.extend(reserved.iter().map(|&word| word.to_owned()));
    all.sort_unstable();
    all.dedup();
    overridden(combinations.iter().flatten(), report);
    let named = |combinations: &Vec<Combination>| {
        let named = naming::named(combinations, &all).into_iter().zip(combinations);
        let changes = |parts: &Combination| parts.iter().flat_map(|part| part.changes.iter().cloned()).collect();
        named.map(|((name, factors), parts)| (name, factors, changes(parts))).collect()
    };
    combinations.iter().map(named).collect()
}

/// Refuses axes that set the same path: the later would override the earlier, and the variant's name would be wrong.
fn overridden<'c>(combinations: impl Iterator<Item = &'c Combination>, report: &mut Report) {
    let overlap = |a: &str, b: &str| {
        let within = |inner: &str, outer: &str| inner.strip_prefix(outer).is_some_and(|rest| rest.starts_with('.'));
        a == b || within(a, b) || within(b, a)
    };
    let mut reported: HashSet<(&str, &str)> = HashSet::new();
    for parts in combinations {
        for (place, later) in parts.iter().enumerate() {
            for earlier in parts[..place].iter().filter(|earlier| earlier.axis != later.axis) {
                let both = later.changes.iter().find_map(|change| {
                    let same = earlier.changes.iter().find(|other| overlap(&other.path, &change.path))?;
                    Some((change, same))
                });
                let Some((change, same)) = both.filter(|_| reported.insert((&earlier.axis, &later.axis))) else {
                    continue;
                };
                let what = format!(
                    "axis `{}` sets `{}`, and so does axis `{}` before it",
                    later.axis, change.path, earlier.axis
                );
                report.push(
                    Diagnostic::error(&change.place, what)
                        .related(&same.place, "set here too")
                        .help("one axis sets a path: leave one of them out, or let `when` say where each is there"),
                );
            }
        }
    }
}

/// The key of the axis that sets a path.
pub(crate) fn axis_of<'n>(root: &'n Node, path: &str) -> Option<&'n str> {
    let matrix = root.get("matrix")?;
    let matrices: Vec<&Node> = match &matrix.value {
        Tree::List(items) => items.iter().map(AsRef::as_ref).collect(),
        _ => vec![matrix],
    };
    let sets = |entry: &&Entry| {
        let set = entry.value.get("paths").map(|set| &set.value);
        entry.key == path
            || match set {
                Some(Tree::List(paths)) => paths.iter().any(|own| own.text() == Some(path)),
                Some(Tree::Text(own)) => own == path,
                _ => false,
            }
    };
    matrices.iter().flat_map(|matrix| matrix.entries()).find(sets).map(|entry| entry.key.as_str())
}

fn matrix(entries: &[Entry], place: &Place, parameters: &Parameters<'_>, report: &mut Report) -> Option<Matrix> {
    let own = |key: &str| entries.iter().find(|entry| entry.key == key);
    let of_axes = entries.iter().filter(|entry| !MATRIX_KEYS.contains(&entry.key.as_str()));
    let count = of_axes.clone().count();
    if count > MOST_AXES {
        let what = format!("a matrix of {count} paths: more than {MOST_AXES}");
        report.push(Diagnostic::error(place, what).help("what has one value belongs where it is defined"));
        return None;
    }
    let sample = own("sample").and_then(|entry| sample::read(entry, MOST, report));
    let is_sampled = own("sample").is_some();
    if let Some(entry) = own("sample").filter(|_| count == 0) {
        let error = Diagnostic::error(&entry.key_place, "`sample` has no axes to draw from").label("draws nothing");
        report.push(error.help("write an axis beside it, e.g. `STAGE.NODE.with.X: { from: 2, to: 64 }`"));
    }
    let axes: Vec<Axis> = of_axes.filter_map(|entry| Axis::read(entry, parameters, is_sampled, report)).collect();
    let is_whole = axes.len() == count && sample.is_some() == is_sampled;
    let mut matrix =
        Matrix { axes, sample, excluded: Vec::new(), included: Vec::new(), place: place.clone(), is_whole };
    matrix.excluded = own("exclude").map_or_else(Vec::new, |entry| matrix.listed(entry, report));
    if let Some(entry) = own("exclude").filter(|_| matrix.excluded.len() > MOST_EXCLUDED) {
        let what = format!("`exclude` of {} entries: more than {MOST_EXCLUDED}", matrix.excluded.len());
        report.push(Diagnostic::error(&entry.key_place, what).help("`include` names combinations one by one"));
        return None;
    }
    matrix.included = own("include").map_or_else(Vec::new, |entry| matrix.listed(entry, report));
    matrix.check_conditions(parameters, report);
    Some(matrix)
}

impl Matrix {
    fn listed(&self, entry: &Entry, report: &mut Report) -> Vec<Listed> {
        let key = &entry.key;
        let Tree::List(items) = &entry.value.value else {
            let error = entry.not_a("a list of maps from paths to values");
            report.push(error.help("e.g. `- { STAGE.NODE.with.X: 3 }`"));
            return Vec::new();
        };
        let mut listed = Vec::with_capacity(items.len());
        for item in items {
            let Some(changes) = changes(item, &format!("`{key}`"), report) else { continue };
            let parts: Option<Combination> = changes.iter().map(|change| self.part(change, report)).collect();
            listed.extend(parts.map(|parts| Listed { parts, place: item.place.clone() }));
        }
        listed
    }

    fn part(&self, change: &Change, report: &mut Report) -> Option<Part> {
        let (key, text) = (&change.path, value_text(&change.value));
        if key.contains('.') {
            return Some(Arc::new(Level { axis: key.clone(), text, changes: vec![change.clone()] }));
        }
        let Some(axis) = self.axes.iter().find(|axis| axis.key == *key) else {
            let error = Diagnostic::error(&change.place, format!("there is no axis `{key}`")).label("unknown name");
            report.push(error.maybe_help(names::suggestion(key, "its axes", &self.keys())));
            return None;
        };
        if let Some(level) = axis.named(&text) {
            return Some(Arc::clone(level));
        }
        if axis.paths.is_empty() {
            report.push(axis.no_value(&text, &change.value.place));
            return None;
        }
        Some(Arc::new(axis.level(text, &change.value)))
    }

    /// `found` marks the entries of `exclude` that matched.
    fn combinations(&self, base: &Base<'_>, found: &mut [bool], report: &mut Report) -> Vec<Combination> {
        let mut combinations = match &self.sample {
            Some(sample) => self.drawn(sample, base, report),
            None => self.product(&self.axes, base, report),
        };
        for (excluded, found) in self.excluded.iter().zip(found) {
            let before = combinations.len();
            combinations.retain(|combination| !excluded.parts.iter().all(|part| holds(combination, part)));
            *found |= combinations.len() < before;
        }
        for Listed { parts, place } in &self.included {
            if combinations.len() >= MOST {
                report.push(too_many(place, combinations.len() + 1));
                break;
            }
            if parts.is_empty() {
                report.push(
                    Diagnostic::error(place, "this includes no change")
                        .help("name the paths and values of this combination: they are its name, too"),
                );
                continue;
            }
            combinations.push(parts.clone());
        }
        combinations
    }

    fn product(&self, axes: &[Axis], base: &Base<'_>, report: &mut Report) -> Vec<Combination> {
        let mut combinations: Vec<Combination> = if axes.is_empty() { Vec::new() } else { vec![Vec::new()] };
        for axis in axes {
            let Values::Listed(levels) = &axis.values else { continue };
            let mut longer = Vec::with_capacity(combinations.len());
            for combination in combinations {
                if !self.is_there(axis, &combination, base, report) {
                    longer.push(combination);
                    continue;
                }
                longer.extend(levels.iter().map(|level| [&combination[..], &[Arc::clone(level)]].concat()));
                if longer.len() > MOST {
                    let count = axes.iter().fold(1_usize, |count, axis| count.saturating_mul(axis.len()));
                    report.push(too_many(&self.place, count));
                    return Vec::new();
                }
            }
            combinations = longer;
        }
        combinations
    }

    /// How many combinations there are; `None` if there are too many to count.
    fn different(&self, base: &Base<'_>, report: &mut Report) -> Option<usize> {
        let listed: Vec<Axis> = self.axes.iter().map(Axis::listed).collect::<Option<_>>()?;
        let count = listed.iter().fold(1_usize, |count, axis| count.saturating_mul(axis.len()));
        (count <= MOST).then(|| self.product(&listed, base, report).len())
    }

    fn drawn(&self, sample: &Sample, base: &Base<'_>, report: &mut Report) -> Vec<Combination> {
        // With few combinations, the same ones are drawn repeatedly.
        let draws = match sample.method {
            Method::LatinHypercube => sample.count,
            Method::Random => sample.count.saturating_mul(100),
        };
        let mut shares: Vec<_> = (0..self.axes.len()).map(|axis| sample.shares(axis)).collect();
        let most = self.different(base, report).map_or(sample.count, |all| all.min(sample.count));
        let mut seen = HashSet::new();
        let mut combinations = Vec::with_capacity(sample.count);
        for _ in 0..draws {
            let mut combination = Combination::new();
            for (axis, shares) in self.axes.iter().zip(&mut shares) {
                // Always drawn, so that the draws of other axes do not depend on it.
                let share = shares.next();
                if !self.is_there(axis, &combination, base, report) {
                    continue;
                }
                combination.push(match &axis.values {
                    Values::Listed(levels) => Arc::clone(&levels[(share * levels.len() as f64) as usize]),
                    Values::Between(range) => {
                        let value = range.draw(share, sample.count);
                        Arc::new(axis.level(value_text(&value), &value))
                    }
                });
            }
            let key: Vec<(String, String)> =
                combination.iter().map(|level| (level.axis.clone(), level.text.clone())).collect();
            if seen.insert(key) {
                combinations.push(combination);
            }
            if combinations.len() == most {
                break;
            }
        }
        if combinations.len() < sample.count && !self.axes.is_empty() {
            let what = format!("the sample of {} holds {} different combinations", sample.count, combinations.len());
            report.push(
                Diagnostic::warning(&sample.place, what)
                    .label("fewer than requested")
                    .help("its axes have few values: reduce `count`; without `sample` all combinations are taken"),
            );
        }
        combinations
    }

    fn keys(&self) -> Vec<&str> {
        self.axes.iter().map(|axis| axis.key.as_str()).collect()
    }

    fn excludes_nothing(&self, listed: &Listed, report: &mut Report) {
        let wrong = listed.parts.iter().find_map(|part| {
            let change = part.changes.first()?;
            match self.axes.iter().find(|axis| axis.key == part.axis || axis.sets(&part.axis)) {
                Some(axis) if axis.key == part.axis => axis.never_has(&change.value),
                Some(_) => None,
                None => {
                    let error = Diagnostic::error(&change.place, format!("no axis sets `{}`", part.axis));
                    let help = names::suggestion(&part.axis, "its axes", &self.keys());
                    Some(error.label("excludes nothing").maybe_help(help))
                }
            }
        });
        report.push(wrong.unwrap_or_else(|| {
            Diagnostic::error(&listed.place, "this excludes no combination")
                .help("an `exclude` names paths of the matrix with values that their lists hold")
        }));
    }
}

fn holds(combination: &Combination, part: &Part) -> bool {
    if !part.axis.contains('.') {
        return combination.iter().any(|level| level.axis == part.axis && level.text == part.text);
    }
    let among = |change: &Change| {
        let mut all = combination.iter().flat_map(|level| &level.changes);
        all.any(|own| own.path == change.path && own.value.to_json() == change.value.to_json())
    };
    part.changes.iter().all(among)
}
