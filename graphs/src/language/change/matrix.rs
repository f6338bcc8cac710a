//! `matrix:`: every combination of some values, with `include` and `exclude`.

use std::collections::HashSet;
use std::sync::Arc;

use super::apply::Change;
use super::variant::{MOST, Variant, changes, too_many};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::resolved::as_written;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Node, Tree};
use crate::plan::Factor;

/// The most paths of a matrix, and the most entries of `exclude`.
const MOST_PATHS: usize = 64;
const MOST_EXCLUDED: usize = 1000;

/// One path and the values it takes.
struct Axis<'a> {
    entry: &'a Entry,
    values: &'a [Arc<Node>],
}

/// The combinations as variants named `last-path-segment=value`, joined by `+`.
pub(crate) fn read(matrix: &Entry, report: &mut Report) -> Vec<Variant> {
    let Tree::Map(entries) = &matrix.value.value else {
        let what = format!("`matrix` wants a map from paths to lists, not {}", matrix.value.describe());
        report
            .push(Diagnostic::error(&matrix.value.place, what).help("e.g. `matrix: { STAGE.NODE.with.X: [1, 2, 3] }`"));
        return Vec::new();
    };
    let axes = axes(entries, report);
    if axes.len() > MOST_PATHS {
        let what = format!("a matrix of {} paths: more than {MOST_PATHS}", axes.len());
        report.push(Diagnostic::error(&matrix.key_place, what).help("what has one value belongs where it is defined"));
        return Vec::new();
    }
    let count = axes.iter().fold(1_usize, |count, axis| count.saturating_mul(axis.values.len()));
    if count > MOST {
        report.push(too_many(&matrix.key_place, count));
        return Vec::new();
    }
    let mut combinations: Vec<Vec<Change>> = if axes.is_empty() { Vec::new() } else { vec![Vec::new()] };
    for axis in &axes {
        let mut longer = Vec::with_capacity(combinations.len() * axis.values.len());
        for combination in &combinations {
            for value in axis.values {
                let mut next = combination.clone();
                let place = axis.entry.key_place.clone();
                next.push(Change { path: axis.entry.key.clone(), place, value: Arc::clone(value) });
                longer.push(next);
            }
        }
        combinations = longer;
    }
    for (excluded, place) in listed(entries, "exclude", report) {
        let before = combinations.len();
        combinations.retain(|combination| !excluded.iter().all(|change| holds(combination, change)));
        if combinations.len() == before && !axes.is_empty() {
            let known = excluded.iter().find(|change| !axes.iter().any(|axis| axis.entry.key == change.path));
            let place = known.map_or(&place, |change| &change.place);
            report.push(
                Diagnostic::error(place, "this excludes no combination")
                    .help("an `exclude` names paths of the matrix with values that their lists hold"),
            );
        }
    }
    for (included, place) in listed(entries, "include", report) {
        if combinations.len() >= MOST {
            report.push(too_many(&place, combinations.len() + 1));
            break;
        }
        if included.is_empty() {
            report.push(
                Diagnostic::error(&place, "this includes no change")
                    .help("name the paths and values of this combination: they are its name, too"),
            );
            continue;
        }
        combinations.push(included);
    }
    if combinations.is_empty() && !report.has_errors() {
        report.push(Diagnostic::error(&matrix.key_place, "the matrix has no combination left"));
    }
    named(combinations, &matrix.key_place)
}

fn axes<'a>(entries: &'a [Entry], report: &mut Report) -> Vec<Axis<'a>> {
    let mut axes = Vec::new();
    for entry in entries.iter().filter(|entry| !matches!(entry.key.as_str(), "include" | "exclude")) {
        match &entry.value.value {
            Tree::List(values) if !values.is_empty() => axes.push(Axis { entry, values }),
            Tree::List(_) => report.push(
                Diagnostic::error(&entry.value.place, format!("`{}` has no values to take", entry.key))
                    .help("list at least one value, or remove the path from the matrix"),
            ),
            _ => report.push(
                Diagnostic::error(
                    &entry.value.place,
                    format!("`{}` wants a list of values, not {}", entry.key, entry.value.describe()),
                )
                .help("write the values in brackets: `[none, minmax]`"),
            ),
        }
    }
    axes
}

fn listed(entries: &[Entry], key: &str, report: &mut Report) -> Vec<(Vec<Change>, Place)> {
    let Some(entry) = entries.iter().find(|entry| entry.key == key) else { return Vec::new() };
    let Tree::List(items) = &entry.value.value else {
        let what = format!("`{key}` wants a list of maps from paths to values, not {}", entry.value.describe());
        report.push(Diagnostic::error(&entry.value.place, what).help("e.g. `- { STAGE.NODE.with.X: 3 }`"));
        return Vec::new();
    };
    if key == "exclude" && items.len() > MOST_EXCLUDED {
        let what = format!("`exclude` of {} entries: more than {MOST_EXCLUDED}", items.len());
        report.push(Diagnostic::error(&entry.key_place, what).help("`include` names combinations one by one"));
        return Vec::new();
    }
    items.iter().filter_map(|item| Some((changes(item, &format!("`{key}`"), report)?, item.place.clone()))).collect()
}

fn holds(combination: &[Change], change: &Change) -> bool {
    combination.iter().any(|c| c.path == change.path && c.value.to_json() == change.value.to_json())
}

/// Names each combination by the shortest ends of its paths that tell them apart.
fn named(combinations: Vec<Vec<Change>>, place: &Place) -> Vec<Variant> {
    let mut paths: Vec<String> = combinations.iter().flatten().map(|change| change.path.clone()).collect();
    paths.sort_unstable();
    paths.dedup();
    let mut variants: Vec<Variant> = Vec::with_capacity(combinations.len());
    let mut taken = HashSet::new();
    for changes in combinations {
        let factor = |change: &Change| Factor { axis: short(&change.path, &paths), value: value_text(&change.value) };
        let factors: Vec<Factor> = changes.iter().map(factor).collect();
        let name = factors.iter().map(part_of_name).collect::<Vec<_>>().join("+");
        let mut unique = name.clone();
        let mut number = 2;
        while !taken.insert(unique.clone()) {
            unique = format!("{name}-{number}");
            number += 1;
        }
        variants.push(Variant { name: unique, place: place.clone(), changes, factors });
    }
    variants
}

/// The shortest end of a path that no other path has. `with` and `inputs` tell nothing: `blur.with.size` is `blur.size`.
fn short(path: &str, all: &[String]) -> String {
    let telling = |path: &str| {
        let parts: Vec<&str> = path.split('.').filter(|part| !matches!(*part, "with" | "inputs")).collect();
        parts.join(".")
    };
    let own = telling(path);
    let others: Vec<String> = all.iter().filter(|other| *other != path).map(|other| telling(other)).collect();
    let starts = own.rmatch_indices('.').map(|(at, _)| at + 1).chain([0]);
    let unique = |end: &&str| !others.iter().any(|other| other == *end || other.ends_with(&format!(".{end}")));
    starts.map(|start| &own[start..]).find(unique).unwrap_or(path).to_owned()
}

/// The longest part of a name that a value gives, characters.
const LONGEST_VALUE: usize = 60;

/// A value as it is written. Of a variable its name, not what this machine has for it.
fn value_text(value: &Node) -> String {
    match &value.written {
        Some(written) => written.text.replace("${", "").replace(":-", "-").replace('}', ""),
        None => value.scalar_text().unwrap_or_else(|| as_written(value, None).to_string()),
    }
}

/// An axis with its value as part of a name: no `/`, which separates variant and estimate, and no space.
fn part_of_name(factor: &Factor) -> String {
    let text = factor.value.chars().take(LONGEST_VALUE);
    let value: String =
        text.map(|c| if c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '=') { c } else { '-' }).collect();
    format!("{}={value}", factor.axis)
}
