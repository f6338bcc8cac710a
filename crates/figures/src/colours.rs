//! The colour of an estimate: the same for the same method in every figure. On the page, a method that differs between
//! variants has the colour of its variant.
//!
//! They are Paul Tol's *vibrant* scheme (personal.sron.nl/~pault), whose hues differ for colour-blind eyes too and read
//! on white and on near-black.

use std::collections::{BTreeMap, BTreeSet};

use crate::drawing::Colour;

/// Stereo, as in the paper.
pub const BLUE: &str = "#0077bb";
/// Monocular, as in the paper.
pub const RED: &str = "#cc3311";
/// What is fused, alone, and what follows in the order it comes.
pub const OTHERS: [&str; 6] = ["#009988", "#ee7733", "#aa3377", "#33bbee", "#ee3377", "#777777"];

/// The colour of an estimate among those of these names, in the order of the tables; more than there are colours share
/// them.
///
/// A method is known by the first word of its name, whatever follows: `stereo`, `stereo_sgbm` and `stereo-filtered`. Of
/// several of a family the first has its colour, the rest one of those that are left.
fn colour_of(names: &[&str], name: &str) -> &'static str {
    let first_of = |family: &str| {
        names.iter().find(|name| **name == family).or_else(|| names.iter().find(|name| self::family(name) == family))
    };
    let families = [("stereo", BLUE), ("mono", RED), ("fused", OTHERS[0])];
    let own = |name: &str| families.iter().find(|(family, _)| first_of(family).is_some_and(|first| *first == name));
    if let Some((_, colour)) = own(name) {
        return colour;
    }
    let left = &OTHERS[1..];
    let before = names.iter().filter(|name| own(name).is_none()).take_while(|other| **other != name).count();
    left[before % left.len()]
}

/// How the curves of an estimate on the page look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    /// Written `#rrggbb`.
    pub colour: &'static str,
    /// The line style, by its place among those of the page: 0 is a solid line.
    pub dash: usize,
}

/// What the [`Look`] of an estimate depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EstimateKey<'a> {
    /// The stage of the estimate.
    pub stage: &'a str,
    /// The name of the estimate.
    pub name: &'a str,
    /// Its variant; `None` if all variants share it.
    pub variant: Option<&'a str>,
    /// Whether the figures show it: their variants get different colours first.
    pub is_shown: bool,
}

/// The hues of variants, beside [`BLUE`] and [`RED`]: of the *vibrant* scheme, then of Paul Tol's *muted* scheme.
const VARIANTS: [&str; 12] = [
    OTHERS[0], OTHERS[1], OTHERS[2], OTHERS[3], OTHERS[4], "#999933", "#332288", "#117733", "#cc6677", "#88ccee",
    "#882255", "#ddcc77",
];

/// The looks of estimates, in their order.
///
/// If some name belongs to several variants, each variant has a hue, and the names of its estimates have different line
/// styles. Otherwise, and for estimates that all variants share, the hue is that of the name, and
/// estimates of one name have different line styles.
pub fn looks(estimates: &[EstimateKey<'_>]) -> Vec<Look> {
    let mut names: Vec<&str> = Vec::new();
    for estimate in estimates {
        if !names.contains(&estimate.name) {
            names.push(estimate.name);
        }
    }
    let belongs_to_others = |one: &EstimateKey<'_>| {
        one.variant.is_some()
            && estimates
                .iter()
                .any(|other| other.name == one.name && other.variant.is_some() && other.variant != one.variant)
    };
    let has_variants = estimates.iter().any(belongs_to_others);
    let has_hue_of_variant = |one: &&EstimateKey<'_>| has_variants && one.variant.is_some();
    let shared = estimates.iter().filter(|one| !has_hue_of_variant(one)).map(|one| colour_of(&names, one.name));
    let used: BTreeSet<&str> = shared.collect();
    let free: Vec<&'static str> = VARIANTS.into_iter().chain([BLUE, RED]).filter(|hue| !used.contains(hue)).collect();
    let shown_first = || {
        let with_hue = || estimates.iter().filter(has_hue_of_variant);
        with_hue().filter(|one| one.is_shown).chain(with_hue().filter(|one| !one.is_shown))
    };
    let variants = places(shown_first().filter_map(|one| one.variant));
    let methods = places(estimates.iter().filter(has_hue_of_variant).map(|one| (one.stage, one.name)));
    let place = |one: &EstimateKey<'_>| Some((*variants.get(one.variant?)?, *methods.get(&(one.stage, one.name))?));
    let mut times_seen: BTreeMap<&str, usize> = BTreeMap::new();
    let mut looks = Vec::with_capacity(estimates.len());
    for one in estimates {
        looks.push(if let Some((variant, method)) = place(one) {
            // With more variants than hues, those of one hue differ in their line styles.
            let (hue, round) = (variant % free.len(), variant / free.len());
            Look { colour: free[hue], dash: method + round * methods.len() }
        } else {
            let seen = times_seen.entry(one.name).or_default();
            *seen += 1;
            Look { colour: colour_of(&names, one.name), dash: *seen - 1 }
        });
    }
    looks
}

/// The place of each item among the distinct ones.
fn places<T: Ord>(items: impl Iterator<Item = T>) -> BTreeMap<T, usize> {
    let mut places = BTreeMap::new();
    for item in items {
        let next = places.len();
        places.entry(item).or_insert(next);
    }
    places
}

/// The same as numbers.
pub fn tint(names: &[&str], name: &str) -> Colour {
    colour(colour_of(names, name))
}

/// A colour written `#rrggbb`.
pub fn colour(text: &str) -> Colour {
    let part = |at: usize| text.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).unwrap_or(0);
    [part(1), part(3), part(5)]
}

/// The first word of a name; `fusion` and `fuse` are `fused`.
fn family(name: &str) -> &str {
    let word = name.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    if ["fuse", "fusion"].contains(&word) { "fused" } else { word }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mono_is_red_and_stereo_blue_and_others_differ() {
        let names = ["filled", "stereo", "fused", "mono", "mono_scaled"];
        let expected = [OTHERS[1], BLUE, OTHERS[0], RED, OTHERS[2]];
        assert_eq!(names.map(|name| colour_of(&names, name)), expected);
    }

    fn key<'a>(name: &'a str, variant: Option<&'a str>) -> EstimateKey<'a> {
        EstimateKey { stage: "compare", name, variant, is_shown: true }
    }

    #[test]
    fn with_one_variant_colours_are_those_of_names() {
        let estimates = ["stereo", "mono", "fused"].map(|name| key(name, Some("full")));
        let expected = [BLUE, RED, OTHERS[0]].map(|colour| Look { colour, dash: 0 });
        assert_eq!(looks(&estimates), expected);
        let twice = [key("stereo", None), EstimateKey { stage: "test", ..key("stereo", None) }];
        assert_eq!(looks(&twice), [0, 1].map(|dash| Look { colour: BLUE, dash }));
    }

    #[test]
    fn variants_differ_in_hue_and_their_estimates_in_line_style() {
        let shared = key("stereo", None);
        let own = ["a", "b", "c"].into_iter().flat_map(|v| [key("mono", Some(v)), key("fused", Some(v))]);
        let estimates: Vec<EstimateKey<'_>> = std::iter::once(shared).chain(own).collect();
        let found = looks(&estimates);
        assert_eq!(found[0], Look { colour: BLUE, dash: 0 });
        for pair in found[1..].chunks(2) {
            assert_eq!((pair[0].colour, pair[0].dash, pair[1].dash), (pair[1].colour, 0, 1));
        }
        let hues: BTreeSet<&str> = found.iter().map(|look| look.colour).collect();
        assert_eq!(hues.len(), 4, "{found:?}");
    }

    #[test]
    fn many_shown_variants_have_different_looks() {
        let variants: Vec<String> = (0..60).map(|i| i.to_string()).collect();
        let is_shown = |i: usize| i % 5 < 2;
        let estimates: Vec<EstimateKey<'_>> = (variants.iter().enumerate())
            .map(|(i, variant)| EstimateKey { is_shown: is_shown(i), ..key("fused", Some(variant)) })
            .collect();
        let found = looks(&estimates);
        let shown = || found.iter().enumerate().filter(|(i, _)| is_shown(*i)).map(|(_, look)| (look.colour, look.dash));
        assert_eq!(shown().collect::<BTreeSet<_>>().len(), shown().count());
        assert!(shown().all(|(_, dash)| dash < 2), "24 shown variants need two line styles");
    }

    #[test]
    fn a_method_is_known_by_the_first_word_of_its_name() {
        assert_eq!(
            ["stereo-sgbm", "mono.depth", "fusion_2"].map(|name| colour_of(&[name], name)),
            [BLUE, RED, OTHERS[0]]
        );
        let names = ["stereo_raw", "stereo", "monocle"];
        assert_eq!(names.map(|name| colour_of(&names, name)), [OTHERS[1], BLUE, OTHERS[2]]);
    }
}
