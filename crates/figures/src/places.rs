//! What a curve is of, which panel it stands on, and how it is told from others.

use crate::drawing::Colour;

/// The lines of one method's variants, where all are on one panel.
const DASHES: [&[f64]; 4] = [&[], &[5.0, 1.5], &[2.0, 1.2], &[6.0, 1.5, 1.5, 1.5]];

/// What a curve is of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// The estimator's name, which has a colour.
    pub name: String,
    /// Its run and stage, where there are several; empty where not.
    pub group: String,
    /// Its variant; `None`: it is on the panels of all variants of its group.
    pub variant: Option<String>,
}

/// Whether each variant has its panel, or all are on one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layout {
    /// A panel each.
    #[default]
    Multiples,
    /// One panel for all.
    Overlaid,
}

impl Place {
    /// Its group and variant, as far as they tell it from others.
    fn panel(&self) -> String {
        let parts = [Some(self.group.as_str()), self.variant.as_deref()].into_iter().flatten();
        parts.filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/")
    }

    /// The same with its name.
    pub fn label(&self) -> String {
        let panel = self.panel();
        if panel.is_empty() { self.name.clone() } else { format!("{panel}/{}", self.name) }
    }
}

/// By panel its title, and which of these are on it: what all variants of a group share comes first.
pub fn panels(places: &[&Place], layout: Layout) -> Vec<(Option<String>, Vec<usize>)> {
    let all = || (0..places.len()).collect::<Vec<usize>>();
    if layout == Layout::Overlaid || places.is_empty() {
        return vec![(None, all())];
    }
    let mut known: Vec<(&str, Option<&str>)> = Vec::new();
    let mut panels = Vec::new();
    for place in places {
        let of_group = || all().into_iter().filter(|&at| places[at].group == place.group);
        let has_variants = of_group().any(|at| places[at].variant.is_some());
        let key = (place.group.as_str(), place.variant.as_deref());
        if known.contains(&key) || has_variants && place.variant.is_none() {
            continue;
        }
        known.push(key);
        let shared = of_group().filter(|&at| places[at].variant.is_none());
        let own = of_group().filter(|&at| places[at].variant.is_some() && places[at].variant == place.variant);
        let title = place.panel();
        panels.push(((!title.is_empty()).then_some(title), shared.chain(own).collect()));
    }
    panels
}

/// The shades of one method's variants, where all are on one panel: how far towards white, or towards black where that is below 0. With the dashes they make twelve lines.
const SHADES: [f64; 3] = [0.0, -0.45, 0.45];

/// The shade of one's line where all of these are on one panel.
pub fn shade<'a>(all: impl Iterator<Item = &'a Place>, one: &Place, colour: Colour) -> Colour {
    let share = SHADES[place(all, one) % SHADES.len()];
    let towards = if share < 0.0 { 0.0 } else { 255.0 };
    colour.map(|part| (f64::from(part) + (towards - f64::from(part)) * share.abs()).round() as u8)
}

/// The dashes of one's line where all of these are on one panel: they tell variants of one name from each other.
pub fn dashes<'a>(all: impl Iterator<Item = &'a Place>, one: &Place) -> &'static [f64] {
    DASHES[place(all, one) % DASHES.len()]
}

/// Its place among those of its name.
fn place<'a>(all: impl Iterator<Item = &'a Place>, one: &Place) -> usize {
    let mut known: Vec<String> = Vec::new();
    for other in all.filter(|other| other.name == one.name) {
        let panel = other.panel();
        if !known.contains(&panel) {
            known.push(panel);
        }
    }
    known.iter().position(|of| *of == one.panel()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_variants_of_one_method_have_twelve_lines() {
        let of = |at: usize| Place { name: "fused".to_owned(), group: String::new(), variant: Some(format!("v{at}")) };
        let all: Vec<Place> = (0..12).map(of).collect();
        let mut lines: Vec<(Vec<u64>, Colour)> = all
            .iter()
            .map(|one| {
                let dashes = dashes(all.iter(), one).iter().map(|dash| dash.to_bits()).collect();
                (dashes, shade(all.iter(), one, [0x00, 0x99, 0x88]))
            })
            .collect();
        lines.sort();
        lines.dedup();
        assert_eq!(lines.len(), 12);
    }
}
