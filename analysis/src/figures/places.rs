//! What a curve is of, which panel it stands on, and how it is told from others.

/// The lines of one method's variants, where all are on one panel.
const DASHES: [&[f64]; 4] = [&[], &[5.0, 1.5], &[2.0, 1.2], &[6.0, 1.5, 1.5, 1.5]];

/// What a curve is of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    /// The estimator's name, which has a colour.
    pub(crate) name: String,
    /// Its run and stage, where there are several; empty where not.
    pub(crate) group: String,
    /// Its variant; `None`: it is on the panels of all variants of its group.
    pub(crate) variant: Option<String>,
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
    pub(crate) fn label(&self) -> String {
        let panel = self.panel();
        if panel.is_empty() { self.name.clone() } else { format!("{panel}/{}", self.name) }
    }
}

/// By panel its title, and which of these are on it: what all variants of a group share comes first.
pub(crate) fn panels(places: &[&Place], layout: Layout) -> Vec<(Option<String>, Vec<usize>)> {
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

/// The dashes of one's line where all of these are on one panel: they tell variants of one name from each other.
pub(crate) fn dashes<'a>(all: impl Iterator<Item = &'a Place>, one: &Place) -> &'static [f64] {
    let mut known: Vec<String> = Vec::new();
    for other in all.filter(|other| other.name == one.name) {
        let panel = other.panel();
        if !known.contains(&panel) {
            known.push(panel);
        }
    }
    let place = known.iter().position(|of| *of == one.panel()).unwrap_or(0);
    DASHES[place % DASHES.len()]
}
