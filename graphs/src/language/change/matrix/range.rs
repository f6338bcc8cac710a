//! `{ from: 2, to: 64, steps: 6, log: true }`: numbers between two ends.
//!
//! Numbers are rounded to as few digits as their distance allows, so that a variant's name has the whole value.

use std::sync::Arc;

use serde_json::{Number, Value as Json};

use crate::language::check::schema_check::{is_infinite, is_odd};
use crate::language::check::spec::known_keys;
use crate::language::check::with_schema::alternatives;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::names;
use crate::language::text::tree::{Node, Tree};

pub(super) const KEYS: &[&str] = &["from", "to", "steps", "log"];

#[derive(Clone)]
pub(super) struct Range {
    from: f64,
    to: f64,
    log: bool,
    /// The whole numbers that the parameter accepts, if it accepts no others.
    whole: Option<Whole>,
    node: Arc<Node>,
}

/// The numbers `step * n + offset`.
#[derive(Clone, Copy)]
struct Whole {
    step: f64,
    offset: f64,
}

impl Whole {
    fn of_parameter(schema: &Json) -> Option<Self> {
        if !takes_whole_numbers(schema) {
            return None;
        }
        if is_odd(schema) {
            return Some(Self { step: 2.0, offset: 1.0 });
        }
        let step = schema.get("multipleOf").and_then(Json::as_f64).filter(|step| *step >= 1.0);
        Some(Self { step: step.unwrap_or(1.0), offset: 0.0 })
    }

    /// The least and the greatest `n` between two ends.
    fn between(self, from: f64, to: f64) -> (f64, f64) {
        (((from - self.offset) / self.step).ceil(), ((to - self.offset) / self.step).floor())
    }

    fn at(self, times: f64) -> f64 {
        self.step * times + self.offset
    }

    fn describe(self) -> String {
        match self {
            Self { offset, .. } if offset > 0.0 => "odd numbers".to_owned(),
            Self { step, .. } if step > 1.0 => format!("multiples of {step}"),
            Self { .. } => "whole numbers".to_owned(),
        }
    }
}

pub(super) enum Numbers {
    Steps(Vec<Arc<Node>>),
    Between(Range),
}

pub(super) fn read(node: &Arc<Node>, what: &str, schema: Option<&Json>, report: &mut Report) -> Option<Numbers> {
    known_keys(node, &format!("the range of {what}"), KEYS, report);
    let mut wrong = |at: &Node, what: String, help: &str| {
        report.push(Diagnostic::error(&at.place, what).help(help));
        None::<f64>
    };
    let mut end = |key: &str| match node.get(key).map(|end| (end, &end.value)) {
        Some((_, Tree::Number(number))) => number.as_f64(),
        Some((end, Tree::Text(text))) => {
            let help = if is_infinite(text) { "numbers are finite" } else { FORM };
            wrong(end, format!("`{key}` must be a number, not `{text}`"), help)
        }
        Some((end, _)) => wrong(end, format!("`{key}` must be a number, not {}", end.describe()), FORM),
        None => wrong(node, format!("the range of {what} has no `{key}`"), FORM),
    };
    let (from, to) = (end("from"), end("to"));
    let (from, to) = (from?, to?);
    if from >= to {
        wrong(node, format!("the range from {from} to {to} holds no numbers"), "`from` is the smaller one");
        return None;
    }
    let log = match node.get("log").map(|log| (log, &log.value)) {
        None => false,
        Some((_, Tree::Bool(log))) => *log,
        Some((log, _)) => {
            wrong(log, format!("`log` must be `true` or `false`, not {}", log.describe()), FORM);
            return None;
        }
    };
    if log && from <= 0.0 {
        wrong(node, "a range with `log` begins above 0".to_owned(), "its values have equal ratios: 2, 4, 8, 16");
        return None;
    }
    let whole = schema.and_then(Whole::of_parameter);
    if let Some(whole) = whole {
        let (least, most) = whole.between(from, to);
        if least > most {
            let what = format!("the range from {from} to {to} holds no {}", whole.describe());
            wrong(node, what, "its values are rounded to what the parameter takes: let it reach farther");
            return None;
        }
    }
    let range = Range { from, to, log, whole, node: Arc::clone(node) };
    match node.get("steps").map(|steps| (steps, &steps.value)) {
        None => Some(Numbers::Between(range)),
        Some((written, Tree::Number(steps)))
            if steps.as_u64().is_some_and(|steps| (2..=MOST_STEPS).contains(&steps)) =>
        {
            let steps = steps.as_u64().unwrap_or(2);
            let parts = (steps - 1) as f64;
            let mut values: Vec<Arc<Node>> = Vec::new();
            for step in 0..steps {
                let value = range.at(step as f64 / parts, parts);
                // Rounded to whole numbers, neighbours may be equal.
                if values.last().is_none_or(|last| last.to_json() != value.to_json()) {
                    values.push(value);
                }
            }
            if let Some(whole) = whole.filter(|_| (values.len() as u64) < steps) {
                let all: Vec<String> = values.iter().filter_map(|value| value.scalar_text()).collect();
                let all: Vec<&str> = all.iter().map(String::as_str).collect();
                let what = format!("the range of {what} holds {} {}, not {steps}", all.len(), whole.describe());
                let warning = Diagnostic::warning(&written.place, what).label("fewer than requested");
                report.push(warning.help(format!("it takes {}, each once", names::listed(&all))));
            }
            Some(Numbers::Steps(values))
        }
        Some((steps, _)) => {
            wrong(steps, format!("`steps` must be a whole number of 2 to {MOST_STEPS}"), FORM);
            None
        }
    }
}

const FORM: &str = "a range is `{ from: 2, to: 64, steps: 6 }`, with `log: true` for equal ratios";
const MOST_STEPS: u64 = 10_000;

impl Range {
    /// The number at a share of the way, 0 to 1, when `parts` of the way are distinguished.
    pub(super) fn at(&self, share: f64, parts: f64) -> Arc<Node> {
        let (from, to) = (self.from, self.to);
        // `libm` gives the same bits on all machines.
        let ratio = match to / from {
            _ if !self.log => 0.0,
            ratio if ratio.is_finite() => libm::log(ratio),
            _ => libm::log(to) - libm::log(from),
        };
        let value = match share {
            share if share <= 0.0 => from,
            share if share >= 1.0 => to,
            share if self.log && (to / from).is_finite() => from * libm::exp(share * ratio),
            share if self.log => libm::exp(libm::log(from) + share * ratio),
            share if (to - from).is_finite() => from + share * (to - from),
            share => from * (1.0 - share) + to * share,
        };
        let value = match self.whole {
            Some(whole) => {
                let (least, most) = whole.between(from, to);
                whole.at(((value - whole.offset) / whole.step).round().clamp(least, most))
            }
            None if share <= 0.0 || share >= 1.0 => value,
            None => {
                // With large ratios, the smaller neighbour keeps a digit.
                let apart = if self.log { value * libm::expm1(ratio / parts).min(100.0) } else { (to - from) / parts };
                short(value, apart)
            }
        };
        self.number(value)
    }

    fn number(&self, value: f64) -> Arc<Node> {
        let number = if value.fract() == 0.0 && value.abs() < 1e15 {
            Number::from(value as i64)
        } else {
            Number::from_f64(value).unwrap_or_else(|| 0.into())
        };
        Arc::new(Node::new(Tree::Number(number), self.node.place.clone()))
    }

    pub(super) fn whole_numbers(&self, most: usize) -> Option<Vec<Arc<Node>>> {
        let whole = self.whole?;
        let (first, last) = whole.between(self.from, self.to);
        let count = last - first + 1.0;
        let number = |index: usize| self.number(whole.at(first + index as f64));
        (count <= most as f64).then(|| (0..count as usize).map(number).collect())
    }

    /// The number drawn with a share in [0, 1); whole numbers are equally likely unless `log`.
    pub(super) fn draw(&self, share: f64, count: usize) -> Arc<Node> {
        let parts = (count as f64 / 10.0).max(10.0);
        let Some(whole) = self.whole.filter(|_| !self.log) else { return self.at(share, parts) };
        let (least, most) = whole.between(self.from, self.to);
        self.number(whole.at((least + (share * (most - least + 1.0)).floor()).min(most)))
    }
}

/// Rounds so that two numbers `apart` differ by about 100 units of the last decimal.
fn short(value: f64, apart: f64) -> f64 {
    let mut decimals = 0;
    let mut unit = 1.0;
    while unit * 100.0 > apart && decimals < 15 {
        unit /= 10.0;
        decimals += 1;
    }
    if unit * 100.0 > apart {
        // Far below 1, significant digits count instead of decimals.
        let digits = 2 + (0..15).take_while(|&power| value.abs() > apart * 10_f64.powi(power)).count();
        return format!("{value:.digits$e}").parse().unwrap_or(value);
    }
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

fn takes_whole_numbers(schema: &Json) -> bool {
    fn types<'s>(schema: &'s Json, found: &mut Vec<&'s str>) {
        match schema.get("type") {
            Some(Json::Array(several)) => found.extend(several.iter().filter_map(Json::as_str)),
            one => found.extend(one.and_then(Json::as_str)),
        }
        alternatives(schema).for_each(|inner| types(inner, found));
    }
    let mut found = Vec::new();
    types(schema, &mut found);
    found.contains(&"integer") && !found.contains(&"number")
}

#[cfg(test)]
mod tests {
    use super::short;

    #[test]
    fn numbers_are_as_short_as_their_distance_allows() {
        for (value, apart, expected) in [
            (1.0 / 3.0, 1.0 / 3.0, 0.333),
            (14.4, 12.4, 14.4),
            (26.799_999_999_999_997, 12.4, 26.8),
            (25_749.6, 24_750.0, 25_750.0),
            (10_000.5, 0.5, 10_000.5),
            (0.000_123_456, 0.000_15, 0.000_123),
            (1.234_567e-30, 1e-30, 1.235e-30),
        ] {
            assert_eq!(short(value, apart), expected);
        }
    }
}
