//! Labels: the names that tables, figures and pages show for estimates, variants and axes, and the order of these.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::plan::Factor;

/// The labels of an experiment. They change no value and are in no node hash. Names that are listed come first, in
/// the order of the lists.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Labels {
    /// The estimates, by their name under `estimates:`.
    pub estimates: Vec<Label>,
    /// The variants, by their full name, or by their name under `variants:` if a matrix multiplies them.
    pub variants: Vec<Label>,
    /// The axes of `matrix:`.
    pub axes: Vec<AxisLabels>,
}

/// A name and its label.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Label {
    /// The name in the experiment.
    pub name: String,
    /// The text that is shown.
    pub label: String,
}

/// The labels of an axis and of its values.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisLabels {
    /// The axis, as in the names of variants.
    pub name: String,
    /// The text that is shown.
    pub label: String,
    /// Its values, as in the names of variants.
    pub values: Vec<Label>,
}

impl Labels {
    /// Whether nothing has a label or a place in the order.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.estimates.is_empty() && self.variants.is_empty() && self.axes.is_empty()
    }

    /// The label of an estimate.
    #[must_use]
    pub fn estimate<'a>(&'a self, name: &'a str) -> &'a str {
        listed(&self.estimates, name).unwrap_or(name)
    }

    /// The label of an axis. The axis `variant` keeps its name unless it is listed.
    #[must_use]
    pub fn axis<'a>(&'a self, name: &'a str) -> &'a str {
        self.axes.iter().find(|axis| axis.name == name).map_or(name, |axis| &axis.label)
    }

    /// The label of a value of an axis.
    #[must_use]
    pub fn value<'a>(&'a self, axis: &str, value: &'a str) -> &'a str {
        self.listed_value(axis, value).unwrap_or(value)
    }

    /// The label of a variant, given its values on the axes: the one listed, or, if any variant or axis is listed, the
    /// labels of its parts, such as `Full, Block size 9` for `full+block=9`.
    #[must_use]
    pub fn variant<'a>(&'a self, name: &'a str, factors: &[Factor]) -> Cow<'a, str> {
        if let Some(label) = listed(&self.variants, name) {
            return Cow::Borrowed(label);
        }
        // All variants have one style.
        if factors.is_empty() || self.variants.is_empty() && self.axes.is_empty() {
            return Cow::Borrowed(name);
        }
        let part = |factor: &Factor| {
            let value = self.value(&factor.axis, &factor.value);
            let names_itself =
                factor.axis == Factor::VARIANT || self.listed_value(&factor.axis, &factor.value).is_some();
            if names_itself { value.to_owned() } else { format!("{} {value}", self.axis(&factor.axis)) }
        };
        Cow::Owned(factors.iter().map(part).collect::<Vec<_>>().join(", "))
    }

    /// The place of an estimate in the order: listed ones first, all others equal.
    #[must_use]
    pub fn estimate_place(&self, name: &str) -> usize {
        place(&self.estimates, name)
    }

    /// The place of a variant in the order, given its values on the axes: by its name, then by the listed values of
    /// each labelled axis.
    #[must_use]
    pub fn variant_place(&self, name: &str, factors: &[Factor]) -> Vec<usize> {
        let on = |axis: &str| factors.iter().find(|factor| factor.axis == axis);
        let base = on(Factor::VARIANT).map_or(usize::MAX, |factor| place(&self.variants, &factor.value));
        let first = place(&self.variants, name).min(base);
        let of_axis = |axis: &AxisLabels| on(&axis.name).map_or(usize::MAX, |own| place(&axis.values, &own.value));
        std::iter::once(first).chain(self.axes.iter().map(of_axis)).collect()
    }

    /// The place of a value of an axis in the order.
    #[must_use]
    pub fn value_place(&self, axis: &str, value: &str) -> usize {
        place(self.values(axis), value)
    }

    fn values(&self, axis: &str) -> &[Label] {
        match axis {
            Factor::VARIANT => &self.variants,
            axis => self.axes.iter().find(|known| known.name == axis).map_or(&[], |axis| &axis.values),
        }
    }

    fn listed_value(&self, axis: &str, value: &str) -> Option<&str> {
        listed(self.values(axis), value)
    }
}

fn listed<'a>(labels: &'a [Label], name: &str) -> Option<&'a str> {
    labels.iter().find(|label| label.name == name).map(|label| label.label.as_str())
}

fn place(labels: &[Label], name: &str) -> usize {
    labels.iter().position(|label| label.name == name).unwrap_or(usize::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn label(name: &str, label: &str) -> Label {
        Label { name: name.to_owned(), label: label.to_owned() }
    }

    fn factor(axis: &str, value: &str) -> Factor {
        Factor { axis: axis.to_owned(), value: value.to_owned() }
    }

    fn labels() -> Labels {
        let values = vec![label("hh", "8 paths")];
        Labels {
            estimates: vec![label("fused", "Fusion")],
            variants: vec![label("full", "Full"), label("bare+block=9", "Smallest")],
            axes: vec![
                AxisLabels { name: "block".to_owned(), label: "Block size".to_owned(), values: Vec::new() },
                AxisLabels { name: "mode".to_owned(), label: "Mode".to_owned(), values },
            ],
        }
    }

    #[test]
    fn names_without_a_label_stay_as_they_are() {
        let labels = labels();
        assert_eq!((labels.estimate("fused"), labels.estimate("mono")), ("Fusion", "mono"));
        assert_eq!((labels.axis("block"), labels.axis("size")), ("Block size", "size"));
        assert_eq!((labels.value("mode", "hh"), labels.value("mode", "sgbm")), ("8 paths", "sgbm"));
        assert_eq!(labels.variant("bare", &[]), "bare");
        assert_eq!(labels.variant("size=3", &[factor("size", "3")]), "size 3");
        assert_eq!(Labels::default().variant("size=3", &[factor("size", "3")]), "size=3");
    }

    #[test]
    fn a_variant_has_its_own_label_or_those_of_its_parts() {
        let labels = labels();
        let shown = |variant: &str, block: &str, mode: &str| {
            let factors = [factor("variant", variant), factor("block", block), factor("mode", mode)];
            labels.variant(&format!("{variant}+block={block}"), &factors).into_owned()
        };
        assert_eq!(shown("full", "9", "hh"), "Full, Block size 9, 8 paths");
        assert_eq!(shown("bare", "3", "sgbm"), "bare, Block size 3, Mode sgbm");
        assert_eq!(shown("bare", "9", "hh"), "Smallest");
    }

    #[test]
    fn listed_names_come_first_in_the_order_of_the_lists() {
        let labels = labels();
        assert!(labels.estimate_place("fused") < labels.estimate_place("mono"));
        let full = labels.variant_place("full+mode=sgbm", &[factor("variant", "full"), factor("mode", "sgbm")]);
        let eight = labels.variant_place("full+mode=hh", &[factor("variant", "full"), factor("mode", "hh")]);
        let other = labels.variant_place("other+mode=hh", &[factor("variant", "other"), factor("mode", "hh")]);
        assert!(eight < full && full < other);
    }
}
