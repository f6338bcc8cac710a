//! `labels:`: what tables, figures and pages show instead of the names of estimates, variants and axes.
//!
//! `{ estimates: { NAME: TEXT }, variants: { NAME: TEXT }, axes: { AXIS: TEXT } }`. A name without a text keeps its
//! name and gets a place in the order. An axis may also be `{ label: TEXT, values: { VALUE: TEXT } }`.

use std::collections::HashMap;

use super::change::variant::Variant;
use super::check::spec::known_keys;
use super::text::diagnostics::{Diagnostic, Report};
use super::text::names;
use super::text::tree::{Entry, Node, Tree};
use crate::plan::{AxisLabels, Label, Labels, StageRun};

/// Characters of a label.
const LONGEST: usize = 100;

pub(crate) fn read(root: &Node, report: &mut Report) -> Labels {
    let Some(entry) = root.entry("labels").filter(|entry| !entry.value.is_null()) else { return Labels::default() };
    if !entry.value.is_map() {
        report.push(entry.not_a("a map").help("e.g. `labels: { estimates: { fused: Fusion (ours) } }`"));
        return Labels::default();
    }
    known_keys(&entry.value, "`labels`", &["estimates", "variants", "axes"], report);
    let section = |key: &str| entry.value.entry(key).filter(|section| !section.value.is_null());
    let mut texts = |key: &str| section(key).map(|section| texts(section, report)).unwrap_or_default();
    let (estimates, variants) = (texts("estimates"), texts("variants"));
    let axes = section("axes").map(|axes| read_axes(axes, report)).unwrap_or_default();
    Labels { estimates, variants, axes }
}

/// A map from names to texts.
fn texts(section: &Entry, report: &mut Report) -> Vec<Label> {
    let Tree::Map(entries) = &section.value.value else {
        report.push(section.not_a("a map from names to texts"));
        return Vec::new();
    };
    let mut labels: Vec<Label> = Vec::new();
    let mut known: HashMap<String, &Entry> = HashMap::new();
    for entry in entries {
        let Some(label) = text(entry, report) else { continue };
        if let Some(other) = known.insert(label.clone(), entry) {
            let what = format!("`{}` and `{}` have the same label", other.key, entry.key);
            report.push(Diagnostic::error(entry.value_place(), what).help("give each a label of its own"));
        }
        labels.push(Label { name: entry.key.clone(), label });
    }
    labels
}

/// The text of an entry, or its key if it is empty.
fn text(entry: &Entry, report: &mut Report) -> Option<String> {
    if entry.value.is_null() {
        return Some(entry.key.clone());
    }
    let Some(text) = entry.value.scalar_text().map(|text| text.trim().to_owned()) else {
        report.push(entry.not_a("text").help(format!("e.g. `{}: \"...\"`", entry.key)));
        return None;
    };
    let wrong = if text.is_empty() {
        "is empty".to_owned()
    } else if text.chars().count() > LONGEST {
        format!("is longer than {LONGEST} characters")
    } else if text.chars().any(char::is_control) {
        "contains a line break or another control character".to_owned()
    } else if let Some(letter) = text.chars().find(changes_direction) {
        format!("contains U+{:04X}, which changes the direction or the lines of the text around it", u32::from(letter))
    } else {
        return Some(text);
    };
    report.push(Diagnostic::error(entry.value_place(), format!("the label of `{}` {wrong}", entry.key)));
    None
}

/// Whether a character is invisible and changes the order of others, or ends a line: the terminal, a Markdown file and
/// a page would show another text than the file.
const fn changes_direction(letter: &char) -> bool {
    matches!(*letter, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn read_axes(section: &Entry, report: &mut Report) -> Vec<AxisLabels> {
    let Tree::Map(entries) = &section.value.value else {
        report.push(section.not_a("a map from axes to texts"));
        return Vec::new();
    };
    let axis = |entry: &Entry| {
        let name = entry.key.clone();
        if !entry.value.is_map() {
            return Some(AxisLabels { label: text(entry, report)?, name, values: Vec::new() });
        }
        known_keys(&entry.value, &format!("the labels of `{name}`"), &["label", "values"], report);
        let own = entry.value.entry("label").filter(|own| !own.value.is_null());
        let label = match own {
            Some(own) => text(own, report)?,
            None => name.clone(),
        };
        let values = entry.value.entry("values").filter(|values| !values.value.is_null());
        let values = values.map(|values| texts(values, report)).unwrap_or_default();
        Some(AxisLabels { name, label, values })
    };
    entries.iter().filter_map(axis).collect()
}

/// What labels are for.
#[derive(Clone, Copy)]
pub(crate) struct Named<'a> {
    pub(crate) labels: &'a Labels,
    pub(crate) runs: &'a [StageRun],
    pub(crate) chosen: &'a [Variant],
    pub(crate) left_out: &'a [Variant],
}

impl Named<'_> {
    /// Reports two names that would be shown alike, because one is the label of the other.
    fn check_distinct(&self, section: &Node, report: &mut Report) {
        let Self { labels, runs, chosen, left_out } = *self;
        let variants = || chosen.iter().chain(left_out);
        let mut alike = |key: &str, what: &str, names: &mut dyn Iterator<Item = (String, String)>| {
            let mut shown: HashMap<String, String> = HashMap::new();
            for (name, title) in names {
                let first = shown.entry(title.clone()).or_insert_with(|| name.clone());
                if *first != name {
                    let place = section.entry(key).map_or(&section.place, |entry| &entry.key_place);
                    let what = format!("{what} `{first}` and `{name}` would both be shown as `{title}`");
                    report.push(Diagnostic::error(place, what).help("give one of them another label"));
                    return;
                }
            }
        };
        let estimates = runs.iter().flat_map(|run| &run.estimates).map(|estimate| estimate.name.clone());
        let mut estimates = estimates.map(|name| (name.clone(), labels.estimate(&name).to_owned()));
        alike("estimates", "the estimates", &mut estimates);
        let mut names = variants()
            .map(|variant| (variant.name.clone(), labels.variant(&variant.name, &variant.factors).into_owned()));
        alike("variants", "the variants", &mut names);
        let factors = || variants().flat_map(|variant| &variant.factors);
        let mut axes = factors().map(|factor| (factor.axis.clone(), labels.axis(&factor.axis).to_owned()));
        alike("axes", "the axes", &mut axes);
        for axis in &labels.axes {
            let own = factors().filter(|factor| factor.axis == axis.name);
            let mut values = own.map(|own| (own.value.clone(), labels.value(&own.axis, &own.value).to_owned()));
            alike("axes", &format!("the values of `{}`,", axis.name), &mut values);
        }
    }
}

/// Warns of labels of names that the experiment does not have. With unselected variants, only names of variants and
/// axes are known.
pub(crate) fn check(root: &Node, named: Named<'_>, report: &mut Report) {
    let Some(labels) = root.get("labels") else { return };
    let Named { runs, chosen, left_out, .. } = named;
    named.check_distinct(labels, report);
    let entries = |key: &str| labels.get(key).map_or(&[][..], |section| section.entries());
    let mut unknown = |entry: &Entry, what: &str, known: &[&str]| {
        if known.contains(&entry.key.as_str()) {
            return;
        }
        let warning = Diagnostic::warning(&entry.key_place, format!("`{}` is labelled, but is not {what}", entry.key));
        let near = names::nearest(&entry.key, known.iter().copied());
        let help = near.map_or_else(|| "remove its label".to_owned(), |near| format!("did you mean `{near}`?"));
        report.push(warning.label("not used").help(help));
    };
    if left_out.is_empty() {
        let mut known: Vec<&str> =
            runs.iter().flat_map(|run| run.estimates.iter().map(|estimate| estimate.name.as_str())).collect();
        known.sort_unstable();
        known.dedup();
        entries("estimates").iter().for_each(|entry| unknown(entry, "an estimate", &known));
    }
    let variants = || chosen.iter().chain(left_out);
    let factors = || variants().flat_map(|variant| &variant.factors);
    let is_base = |axis: &str| axis == crate::plan::Factor::VARIANT;
    let mut known: Vec<&str> = variants().map(|variant| variant.name.as_str()).collect();
    known.extend(factors().filter(|factor| is_base(&factor.axis)).map(|factor| factor.value.as_str()));
    entries("variants").iter().for_each(|entry| unknown(entry, "a variant", &known));
    let axes: Vec<&str> = factors().map(|factor| factor.axis.as_str()).filter(|axis| !is_base(axis)).collect();
    for entry in entries("axes") {
        unknown(entry, "an axis of `matrix`", &axes);
        let known: Vec<&str> =
            factors().filter(|factor| factor.axis == entry.key).map(|factor| factor.value.as_str()).collect();
        let values = entry.value.get("values").map_or(&[][..], |values| values.entries());
        let what = format!("a value of the axis `{}`", entry.key);
        values.iter().filter(|_| !known.is_empty()).for_each(|value| unknown(value, &what, &known));
    }
}
