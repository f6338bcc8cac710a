//! What combinations are called: by the file's text alone, so that a variant has one name on every machine.

use std::collections::{HashMap, HashSet};

use super::axis::{Combination, Part};
use crate::plan::Factor;

const LONGEST_VALUE: usize = 60;

const UNCHANGED: &str = "base";

pub(super) fn named(combinations: &[Combination], all: &[String]) -> Vec<(String, Vec<Factor>)> {
    let shorts: HashMap<&str, String> = all.iter().map(|axis| (axis.as_str(), short(axis, all))).collect();
    let mut taken = HashSet::new();
    let name = |combination: &Combination| {
        let factor = |level: &Part| Factor { axis: shorts[level.axis.as_str()].clone(), value: level.text.clone() };
        let factors: Vec<Factor> = combination.iter().map(factor).collect();
        let name = factors.iter().map(part_of_name).collect::<Vec<_>>().join("+");
        let name = if name.is_empty() && combinations.len() > 1 { UNCHANGED.to_owned() } else { name };
        let mut unique = name.clone();
        let mut number = 2;
        while !taken.insert(unique.clone()) {
            unique = format!("{name}-{number}");
            number += 1;
        }
        (unique, factors)
    };
    combinations.iter().map(name).collect()
}

/// The shortest suffix that no other path has, without `with` and `inputs`: `blur.size` for `blur.with.size`.
fn short(axis: &str, all: &[String]) -> String {
    let telling = |path: &str| {
        let parts: Vec<&str> = path.split('.').filter(|part| !matches!(*part, "with" | "inputs")).collect();
        parts.join(".")
    };
    let own = telling(axis);
    let others: Vec<String> = all.iter().filter(|other| *other != axis).map(|other| telling(other)).collect();
    let starts = own.rmatch_indices('.').map(|(at, _)| at + 1).chain([0]);
    let unique = |end: &&str| !others.iter().any(|other| other == *end || other.ends_with(&format!(".{end}")));
    starts.map(|start| &own[start..]).find(unique).unwrap_or(axis).to_owned()
}

/// `axis=value` without spaces and `/`, which separates variant and estimate.
fn part_of_name(factor: &Factor) -> String {
    let can_stand = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | '=');
    let value: String = if factor.value.starts_with(['[', '{']) {
        let words: Vec<&str> = factor.value.split(|c| !can_stand(c)).filter(|word| !word.is_empty()).collect();
        words.join("-").chars().take(LONGEST_VALUE).collect()
    } else {
        factor.value.chars().take(LONGEST_VALUE).map(|c| if can_stand(c) { c } else { '-' }).collect()
    };
    format!("{}={value}", factor.axis)
}

#[cfg(test)]
mod tests {
    use super::{Factor, part_of_name};

    #[test]
    fn lists_and_maps_are_named_by_their_words() {
        for (value, expected) in [
            ("-63", "left=-63"),
            ("ids/a b.txt", "left=ids-a-b.txt"),
            ("[320,96]", "left=320-96"),
            ("[-8,16]", "left=-8-16"),
            ("[\"all\"]", "left=all"),
            ("{\"with\":{\"uniqueness\":5,\"mode\":\"hh\"}}", "left=with-uniqueness-5-mode-hh"),
        ] {
            assert_eq!(part_of_name(&Factor { axis: "left".to_owned(), value: value.to_owned() }), expected);
        }
    }
}
