//! `sample: { method: latin-hypercube, count: 40, seed: 7 }`: a random sample of all combinations.
//!
//! Every axis has its own random numbers, so that one more axis at the end does not change the draws of the others.

use depthloom_random::SplitMix64;

use crate::language::change::path::SAMPLE_KEYS;
use crate::language::check::spec::known_keys;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Entry, Tree};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    Random,
    /// Draws each of `count` equal parts of every axis once (McKay, Beckman, Conover 1979).
    LatinHypercube,
}

#[derive(Clone, Debug)]
pub(super) struct Sample {
    pub(super) method: Method,
    pub(super) count: usize,
    pub(super) seed: u64,
    pub(super) place: Place,
}

const METHODS: [(&str, Method); 2] = [("latin-hypercube", Method::LatinHypercube), ("random", Method::Random)];
const FORM: &str = "e.g. `sample: { method: latin-hypercube, count: 40, seed: 7 }`";

pub(super) fn read(entry: &Entry, most: usize, report: &mut Report) -> Option<Sample> {
    let node = &entry.value;
    if !node.is_map() {
        report.push(entry.not_a("a map").help(FORM));
        return None;
    }
    known_keys(node, "`sample`", SAMPLE_KEYS, report);
    let method = match node.get("method") {
        None => Some(Method::LatinHypercube),
        Some(written) => {
            let text = written.scalar_text().unwrap_or_default();
            let found = METHODS.iter().find(|(name, _)| *name == text).map(|(_, method)| *method);
            if found.is_none() {
                let what = format!("there is no method `{text}` of drawing");
                let known = METHODS.map(|(name, _)| name);
                report.push(
                    Diagnostic::error(&written.place, what).maybe_help(names::suggestion(&text, "it takes", &known)),
                );
            }
            found
        }
    };
    let whole = |key: &str| match node.get(key).map(|value| &value.value) {
        Some(Tree::Number(number)) => number.as_u64(),
        _ => None,
    };
    let count = whole("count").and_then(|count| usize::try_from(count).ok()).filter(|count| (1..=most).contains(count));
    if count.is_none() {
        let place = node.get("count").map_or(&entry.key_place, |count| &count.place);
        report.push(Diagnostic::error(place, format!("`count` must be a whole number of 1 to {most}")).help(FORM));
    }
    let seed = if node.get("seed").is_some() { whole("seed") } else { Some(1) };
    if let (None, Some(written)) = (seed, node.get("seed")) {
        report.push(Diagnostic::error(&written.place, "`seed` must be a whole number of at least 0").help(FORM));
    }
    Some(Sample { method: method?, count: count?, seed: seed?, place: entry.key_place.clone() })
}

impl Sample {
    /// An endless series of shares in [0, 1) for an axis.
    pub(super) fn shares(&self, axis: usize) -> Shares {
        let mut random = SplitMix64::part(self.seed, axis as u64);
        let parts = match self.method {
            Method::Random => Vec::new(),
            Method::LatinHypercube => {
                let mut parts: Vec<usize> = (0..self.count).collect();
                for last in (1..self.count).rev() {
                    parts.swap(last, random.below(last + 1));
                }
                parts
            }
        };
        Shares { random, parts: parts.into_iter(), count: self.count as f64 }
    }
}

pub(super) struct Shares {
    random: SplitMix64,
    parts: std::vec::IntoIter<usize>,
    count: f64,
}

impl Shares {
    pub(super) fn next(&mut self) -> f64 {
        let within = (self.random.next() >> 11) as f64 / (1_u64 << 53) as f64;
        match self.parts.next() {
            Some(part) => (part as f64 + within) / self.count,
            None => within,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use super::{Method, Place, Sample};
    use crate::language::text::source_file::SourceFile;

    fn sample(method: Method) -> Sample {
        let place = Place::whole(&Arc::new(SourceFile::new("test", String::new(), Path::new(""))));
        Sample { method, count: 40, seed: 7, place }
    }

    #[test]
    fn a_latin_hypercube_has_every_part_of_every_axis_once() {
        for axis in 0..5 {
            let mut shares = sample(Method::LatinHypercube).shares(axis);
            let mut parts: Vec<usize> = (0..40).map(|_| (shares.next() * 40.0) as usize).collect();
            assert!(!parts.is_sorted(), "in an order of its own");
            parts.sort_unstable();
            assert_eq!(parts, (0..40).collect::<Vec<_>>());
        }
    }

    #[test]
    fn axes_and_seeds_are_drawn_apart_and_always_alike() {
        let drawn = |seed: u64, axis: usize| {
            let mut shares = Sample { seed, ..sample(Method::Random) }.shares(axis);
            [shares.next(), shares.next(), shares.next()]
        };
        assert_eq!(drawn(7, 0), drawn(7, 0));
        assert!(drawn(7, 0) != drawn(7, 1) && drawn(7, 0) != drawn(8, 0));
        assert!(drawn(7, 3).iter().all(|share| (0.0..1.0).contains(share)));
    }
}
