//! The colour of an estimate: the same for the same method in every figure and on the page.
//!
//! They are Paul Tol's *vibrant* scheme (personal.sron.nl/~pault), whose hues differ for colour-blind eyes too and read
//! on white and on near-black.

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
pub fn colour_of(names: &[&str], name: &str) -> &'static str {
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
