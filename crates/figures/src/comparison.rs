//! Series of estimates, compared: on which panel each is, and its colour and dashes.

use crate::colours::{EstimateKey, Look, colour, looks, tint};
use crate::drawing::{Colour, Fill, Stroke};
use crate::plot::{Axis, Entry, Item, Panel, Sheet, Swatch};

/// The width of a curve, points.
pub const LINE_PT: f64 = 1.2;
/// The line styles where all series are on one panel.
const DASHES: [&[f64]; 6] =
    [&[], &[5.0, 1.5], &[2.0, 1.2], &[6.0, 1.5, 1.5, 1.5], &[9.0, 2.0], &[6.0, 1.2, 1.2, 1.2, 1.2, 1.2]];
/// More filled curves than this hide each other.
const MAX_FILLED: usize = 4;

/// What a series shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The estimate's name, which has a colour.
    pub name: String,
    /// Its run and stage, where there are several; otherwise empty.
    pub group: String,
    /// Its variant; `None`: it is on the panels of all variants of its group.
    pub variant: Option<String>,
    /// What is shown instead of the name.
    pub title: Option<String>,
    /// What is shown instead of the variant.
    pub variant_title: Option<String>,
}

/// Whether each variant has its panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// A panel each.
    #[default]
    Multiples,
    /// One panel for all.
    Overlaid,
}

impl Place {
    /// Its group and variant.
    fn panel(&self) -> String {
        let variant = self.variant_title.as_deref().or(self.variant.as_deref());
        let parts = [Some(self.group.as_str()), variant].into_iter().flatten();
        parts.filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/")
    }

    /// The name as it is shown.
    fn shown(&self) -> &str {
        self.title.as_deref().unwrap_or(&self.name)
    }
}

/// Series that are compared.
pub(crate) struct Comparison<'a>(pub(crate) Vec<&'a Place>, pub(crate) Layout);

impl Comparison<'_> {
    /// Names in their first order: they choose the colours.
    pub(crate) fn names(&self) -> Vec<&str> {
        distinct(self.0.iter().map(|place| place.name.as_str()))
    }

    /// By panel its title and which series are on it, those that all variants of a group share first.
    pub(crate) fn panels(&self) -> Vec<(String, Vec<usize>)> {
        let all = || 0..self.0.len();
        if self.1 == Layout::Overlaid || self.0.is_empty() {
            return vec![(String::new(), all().collect())];
        }
        let has_variants = |group: &str| self.0.iter().any(|place| place.group == group && place.variant.is_some());
        let keys = self.0.iter().map(|place| (place.group.as_str(), place.variant.as_deref()));
        let keys = distinct(keys.filter(|(group, variant)| variant.is_some() || !has_variants(group)));
        let panel = |(group, variant): (&str, Option<&str>)| {
            let in_group = || all().filter(move |&at| self.0[at].group == group);
            let shared = in_group().filter(|&at| self.0[at].variant.is_none());
            let own = in_group().filter(|&at| variant.is_some() && self.0[at].variant.as_deref() == variant);
            let on: Vec<usize> = shared.chain(own).collect();
            (on.last().map_or_else(String::new, |&at| self.0[at].panel()), on)
        };
        keys.into_iter().map(panel).collect()
    }

    /// The colour of a series: that of its name, or on one panel that of its variant.
    pub(crate) fn tint(&self, at: usize) -> Colour {
        match self.1 {
            Layout::Multiples => tint(&self.names(), &self.0[at].name),
            Layout::Overlaid => colour(self.look(at).colour),
        }
    }

    /// The line of a series: on one panel in the colour of its variant and in the line style of its name.
    pub(crate) fn stroke(&self, at: usize) -> Stroke {
        let stroke = Stroke::new(self.tint(at), LINE_PT);
        match self.1 {
            Layout::Multiples => stroke,
            Layout::Overlaid => stroke.dashed(DASHES[self.look(at).dash % DASHES.len()]),
        }
    }

    /// The look of a series on one panel. Series of different runs differ as those of different variants do.
    fn look(&self, at: usize) -> Look {
        let panels: Vec<String> = self.0.iter().map(|place| place.panel()).collect();
        let keys = self.0.iter().zip(&panels).map(|(place, panel)| EstimateKey {
            stage: "",
            name: &place.name,
            variant: Some(panel.as_str()).filter(|panel| !panel.is_empty()),
            is_shown: true,
        });
        looks(&keys.collect::<Vec<_>>())[at]
    }

    /// An entry for each name with words after it, or on one panel for each series.
    pub(crate) fn legend(&self, words: &str) -> Vec<Entry> {
        if self.1 == Layout::Overlaid {
            let label =
                |place: &Place| [place.panel().as_str(), place.shown()].join("/").trim_start_matches('/').to_owned();
            let entry = |at: usize| Entry::new(label(self.0[at]), Swatch::Line(self.stroke(at)));
            return (0..self.0.len()).map(entry).collect();
        }
        let names = self.names();
        let line = |name: &str| Swatch::Line(Stroke::new(tint(&names, name), LINE_PT));
        let first = |name: &str| self.0.iter().find(|place| place.name == name);
        let entry = |name: &&str| {
            let shown = first(name).map_or(*name, |place| place.shown());
            Entry::new(format!("{shown}{words}"), line(name))
        };
        names.iter().map(entry).collect()
    }
}

/// Values without repetitions, in their first order.
pub fn distinct<T: PartialEq>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut all = Vec::new();
    for value in values {
        if !all.contains(&value) {
            all.push(value);
        }
    }
    all
}

/// Curves of estimates on equal axes, filled down to zero on request if a panel has few of them.
pub fn compared_curves(
    curves: &[(Place, Vec<(f64, f64)>)],
    layout: Layout,
    (x, y): (&Axis, &Axis),
    is_filled: bool,
) -> Sheet {
    let all = Comparison(curves.iter().map(|(place, _)| place).collect(), layout);
    let panel = |(title, on): (String, Vec<usize>)| {
        let mut panel = Panel::new(title, x.clone(), y.clone());
        for &at in on.iter().filter(|_| is_filled && on.len() <= MAX_FILLED) {
            let points = curves[at].1.iter().map(|(x, y)| (*x, 0.0, *y));
            panel.items.push(Item::band(points, Fill::new(all.tint(at), 0.12)));
        }
        panel.items.extend(on.iter().map(|&at| Item::Line(curves[at].1.clone(), all.stroke(at))));
        panel
    };
    Sheet {
        columns: 2,
        panels: all.panels().into_iter().map(panel).collect(),
        legend: all.legend(""),
        ..Sheet::default()
    }
}

#[cfg(test)]
mod tests;
