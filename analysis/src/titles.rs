//! What readers see instead of the names of estimates, variants and axes: the labels of experiments.

use std::collections::HashMap;

use depthloom_figures::Place;
use depthloom_graphs::plan::{Labels, VariantId};
use depthloom_recording::RecordedPlan;

use crate::tables::{Cells, Column, Table};

/// Between two axes whose interaction has an effect.
const INTERACTION: &str = " x ";

/// The labels of one or more runs. Of several runs with a label for a name, the first decides.
#[derive(Clone, Debug, Default)]
pub(crate) struct Titles {
    labels: Vec<Labels>,
    variants: HashMap<String, String>,
    /// Estimates by their label, such as `base/fused`.
    estimates: HashMap<String, String>,
}

impl Titles {
    /// Reads the labels of plans.
    pub(crate) fn new<'p>(plans: impl IntoIterator<Item = &'p RecordedPlan>) -> Self {
        let mut titles = Self::default();
        for plan in plans.into_iter().filter(|plan| !plan.labels.is_empty()) {
            for (id, name) in VariantId::enumerate(&plan.variants) {
                let title = plan.labels.variant(name, plan.factors_of(id));
                if title != name.as_str() {
                    titles.variants.entry(name.clone()).or_insert_with(|| title.into_owned());
                }
            }
            titles.labels.push(plan.labels.clone());
            for estimate in plan.runs.iter().flat_map(|run| &run.estimates) {
                let variant = estimate.variant.and_then(|variant| plan.variants.get(variant.0));
                let title = titles.full(&estimate.label, variant.map(String::as_str), &estimate.name);
                titles.estimates.entry(estimate.label.clone()).or_insert(title);
            }
        }
        titles
    }

    /// Whether all names are shown as they are.
    pub(crate) fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    fn first<'a>(&'a self, name: &'a str, label: impl Fn(&'a Labels) -> &'a str) -> &'a str {
        self.labels.iter().map(label).find(|label| *label != name).unwrap_or(name)
    }

    pub(crate) fn estimate<'a>(&'a self, name: &'a str) -> &'a str {
        self.first(name, |labels| labels.estimate(name))
    }

    /// A variant, or an estimate by its label: a side of a comparison.
    pub(crate) fn side<'a>(&'a self, title: &'a str) -> &'a str {
        let known = self.variants.get(title).or_else(|| self.estimates.get(title));
        known.map_or_else(|| self.estimate(title), String::as_str)
    }

    /// A cell with an estimate by name or label, or with the names of estimates that share a row, such as
    /// `depth+disparity`.
    fn estimates(&self, text: &str) -> String {
        let is_labelled = |name: &str| self.estimate(name) != name;
        if let Some(title) = self.estimates.get(text).filter(|_| !is_labelled(text)) {
            return title.clone();
        }
        if !text.split('+').any(is_labelled) {
            return text.to_owned();
        }
        text.split('+').map(|name| self.estimate(name)).collect::<Vec<_>>().join(" + ")
    }

    pub(crate) fn variant<'a>(&'a self, name: &'a str) -> &'a str {
        self.variants.get(name).map_or(name, String::as_str)
    }

    pub(crate) fn axis<'a>(&'a self, name: &'a str) -> &'a str {
        self.first(name, |labels| labels.axis(name))
    }

    pub(crate) fn value<'a>(&'a self, axis: &str, value: &'a str) -> &'a str {
        self.first(value, |labels| labels.value(axis, value))
    }

    /// An estimate of a variant in one line, such as `Block size 9 / Fusion`. Without labels it is `label`.
    pub(crate) fn full(&self, label: &str, variant: Option<&str>, name: &str) -> String {
        match variant {
            _ if self.is_empty() => label.to_owned(),
            Some(variant) => format!("{} / {}", self.variant(variant), self.estimate(name)),
            // Two stages may have estimates of one name.
            None => label
                .strip_suffix(name)
                .map_or_else(|| label.to_owned(), |stage| stage.to_owned() + self.estimate(name)),
        }
    }

    /// The place of an estimate in a figure.
    pub(crate) fn place(&self, name: String, group: String, variant: Option<String>) -> Place {
        let title = Some(self.estimate(&name)).filter(|title| *title != name).map(str::to_owned);
        let variant_title = variant.as_deref().map(|variant| self.variant(variant).to_owned());
        let variant_title = variant_title.filter(|title| Some(title) != variant.as_ref());
        Place { name, group, variant, title, variant_title }
    }

    /// Replaces what text shows in the columns of estimates, variants and axes. Files keep the names.
    pub(crate) fn apply(&self, table: &mut Table) {
        if self.is_empty() {
            return;
        }
        let axis_of_row = table.columns.iter().find(|column| column.name == "axis").map(|column| column.cells.clone());
        for column in &mut table.columns {
            let name = column.name.clone();
            let cell = |row: usize, text: &str| match (name.as_str(), &axis_of_row) {
                ("estimate", _) => self.estimates(text),
                ("variant", _) => self.variant(text).to_owned(),
                ("axis", _) => {
                    text.split(INTERACTION).map(|axis| self.axis(axis)).collect::<Vec<_>>().join(INTERACTION)
                }
                ("level", Some(axes)) => match axes.text(row).as_deref() {
                    Some("estimate") => self.estimate(text).to_owned(),
                    Some(axis) => self.value(axis, text).to_owned(),
                    None => text.to_owned(),
                },
                (axis, _) => self.value(axis.strip_prefix("axis.").unwrap_or(axis), text).to_owned(),
            };
            let has_titles = column.is_axis || ["estimate", "variant", "axis", "level"].contains(&column.name.as_str());
            if has_titles && matches!(column.cells, Cells::Text(_) | Cells::Levels(_)) {
                let titles = |row: usize| column.cells.text(row).map(|text| cell(row, &text));
                column.titles = Some((0..column.cells.len()).map(titles).collect());
            }
            if column.is_axis {
                self.name_axis(column);
            }
        }
    }

    fn name_axis(&self, column: &mut Column) {
        let axis = column.name.strip_prefix("axis.").unwrap_or(&column.name);
        let title = self.axis(axis);
        if title != axis {
            column.shown = Some(title.to_owned());
        }
    }
}
