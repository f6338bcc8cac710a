//! Conditions that select runs: `look.stereo.with.block=5`, `state=complete`, `best<0.1`.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::path::Path;
use std::str::FromStr;
use std::sync::OnceLock;

use depthloom_graphs::{Key, regular_file};
use depthloom_recording::RecordedPlan;
use serde_json::Value as Json;

use crate::glance::{Glance, State};

/// A condition on a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// What is compared: a path to a parameter or kind, or a property of the run.
    pub path: String,
    comparison: Comparison,
    value: String,
    /// The hash of the file that `value` names, or why it has no hash; computed if a run has a hash to compare it with.
    content: OnceLock<Result<Key, String>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Comparison {
    Equal,
    Unequal,
    Less,
    AtMost,
    Greater,
    AtLeast,
}

/// Longer operators first.
const COMPARISONS: [(&str, Comparison); 6] = [
    ("!=", Comparison::Unequal),
    ("<=", Comparison::AtMost),
    (">=", Comparison::AtLeast),
    ("=", Comparison::Equal),
    ("<", Comparison::Less),
    (">", Comparison::Greater),
];

/// Properties of a run that are not parameters.
const PROPERTIES: [&str; 6] = ["best", "experiment", "frames", "state", "tag", "variants"];

impl FromStr for Condition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = COMPARISONS.iter().filter_map(|(sign, comparison)| Some((text.find(sign)?, *sign, *comparison)));
        // The first operator, and of those at one place the longest.
        let Some((at, sign, comparison)) = found.min_by_key(|(at, sign, _)| (*at, usize::MAX - sign.len())) else {
            return Err("a condition is PATH=VALUE, with one of = != < <= > >=: `look.stereo.with.block=5`".to_owned());
        };
        let (path, value) = (text[..at].trim(), text[at + sign.len()..].trim());
        if path.is_empty() {
            return Err("the path before the operator is missing: `look.stereo.with.block=5`".to_owned());
        }
        let states = State::ALL.map(State::name);
        if path == "state" && !states.contains(&value) {
            return Err(format!("there is no state `{value}`; states are {}", states.join(", ")));
        }
        Ok(Self { path: path.to_owned(), comparison, value: value.to_owned(), content: OnceLock::new() })
    }
}

impl Condition {
    /// Whether a value of the run fulfils the condition. `None` if the run has no such path.
    ///
    /// # Errors
    /// If the run has the hash of a file, and the condition has neither a hash nor a file that can be read.
    pub fn holds(&self, glance: &Glance, plan: Option<&RecordedPlan>) -> Result<Option<bool>, String> {
        let values = self.values(glance, plan);
        let mut holds = (!values.is_empty()).then_some(false);
        for value in &values {
            if self.is_true_of(value)? {
                holds = Some(true);
            }
        }
        Ok(holds)
    }

    /// The hash that the value is, or that of the file that it names.
    fn content(&self) -> Result<Key, String> {
        let hash = || {
            let read = || regular_file::open(Path::new(&self.value)).and_then(Key::of_reader);
            Key::parse(&self.value).map_or_else(read, Ok).map_err(|error| {
                format!("{} is stored as the hash of a file, and {} cannot be read: {error}", self.path, self.value)
            })
        };
        self.content.get_or_init(hash).clone()
    }

    fn values(&self, glance: &Glance, plan: Option<&RecordedPlan>) -> Vec<Json> {
        match self.path.as_str() {
            "best" => glance.best.iter().map(|best| best.value.into()).collect(),
            "experiment" => glance.experiment.iter().map(|name| name.as_str().into()).collect(),
            "frames" => vec![glance.frames.into()],
            "state" => vec![glance.state.name().into()],
            // A run without tags has an empty one, so that `tag!=draft` selects it.
            "tag" if glance.notes.tags.is_empty() => vec!["".into()],
            "tag" => glance.notes.tags.iter().map(|tag| tag.as_str().into()).collect(),
            "variants" => vec![glance.variants.into()],
            _ => plan.map_or_else(Vec::new, |plan| values_at(plan, &self.path)),
        }
    }

    fn is_true_of(&self, value: &Json) -> Result<bool, String> {
        // A recording has the hash of a file, and the last name of another path.
        let only = |key: &str| {
            value.as_object().filter(|object| object.len() == 1).and_then(|object| object.get(key)?.as_str())
        };
        if let Some(content) = only("content").and_then(Key::parse) {
            return match self.comparison {
                Comparison::Equal => Ok(content == self.content()?),
                Comparison::Unequal => Ok(content != self.content()?),
                _ => Ok(false),
            };
        }
        if let Some(name) = only("name") {
            let wanted = self.value.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
            return Ok(match self.comparison {
                Comparison::Equal => name == wanted,
                Comparison::Unequal => name != wanted,
                _ => false,
            });
        }
        let text = match value {
            Json::String(text) => text.clone(),
            other => other.to_string(),
        };
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| !number.is_nan());
        let wanted = if self.value == "~" { "null" } else { &self.value };
        let order = match (number(&text), number(wanted)) {
            (Some(value), Some(wanted)) => value.partial_cmp(&wanted),
            _ if text == wanted || is_same_json(value, wanted) => Some(Ordering::Equal),
            // Texts have no order here: only `!=` holds.
            _ => None,
        };
        Ok(match self.comparison {
            Comparison::Equal => order == Some(Ordering::Equal),
            Comparison::Unequal => order != Some(Ordering::Equal),
            Comparison::Less => order == Some(Ordering::Less),
            Comparison::AtMost => matches!(order, Some(Ordering::Less | Ordering::Equal)),
            Comparison::Greater => order == Some(Ordering::Greater),
            Comparison::AtLeast => matches!(order, Some(Ordering::Greater | Ordering::Equal)),
        })
    }
}

/// `[640, 192]` whatever its spaces.
fn is_same_json(value: &Json, text: &str) -> bool {
    serde_json::from_str::<Json>(text).is_ok_and(|other| other == *value)
}

/// The values at a path in all variants: `STAGE.NODE.with.NAME`, `STAGE.NODE.kind`, `sources.NAME.with.NAME`.
fn values_at(plan: &RecordedPlan, path: &str) -> Vec<Json> {
    let mut values = Vec::new();
    for run in &plan.runs {
        for node in &run.nodes {
            let owner = format!("{}.{}.", run.stage, node.name);
            values.extend(path.strip_prefix(&owner).and_then(|rest| value_in(&node.kind, &node.params, rest)));
        }
        let owner = format!("sources.{}.", run.source.name);
        for part in &run.source.parts {
            values.extend(path.strip_prefix(&owner).and_then(|rest| value_in(&part.kind, &part.params, rest)));
        }
    }
    values
}

fn value_in(kind: &str, params: &Json, rest: &str) -> Option<Json> {
    match rest.strip_prefix("with.") {
        Some(names) => names.split('.').try_fold(params, |value, name| value.get(name)).cloned(),
        None => (rest == "kind").then(|| kind.into()),
    }
}

/// The paths that conditions on a run of this plan can name.
pub fn condition_paths(plan: &RecordedPlan) -> BTreeSet<String> {
    let mut paths: BTreeSet<String> = PROPERTIES.iter().map(|name| (*name).to_owned()).collect();
    for run in &plan.runs {
        for node in &run.nodes {
            add_paths(&format!("{}.{}", run.stage, node.name), &node.params, &mut paths);
        }
        for part in &run.source.parts {
            add_paths(&format!("sources.{}", run.source.name), &part.params, &mut paths);
        }
    }
    paths
}

fn add_paths(owner: &str, params: &Json, paths: &mut BTreeSet<String>) {
    paths.insert(format!("{owner}.kind"));
    add_params(&format!("{owner}.with"), params, paths);
}

fn add_params(prefix: &str, params: &Json, paths: &mut BTreeSet<String>) {
    for (name, value) in params.as_object().into_iter().flatten() {
        let path = format!("{prefix}.{name}");
        add_params(&path, value, paths);
        paths.insert(path);
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{Comparison, Condition, Key};

    fn holds(condition: &str, value: &serde_json::Value) -> bool {
        condition.parse::<Condition>().expect("a condition").is_true_of(value).expect("it can be compared")
    }

    #[test]
    fn a_condition_has_a_path_an_operator_and_a_value() {
        let parsed: Condition = "look.stereo.with.block >= 5".parse().expect("a condition");
        let parts = (parsed.path.as_str(), parsed.comparison, parsed.value.as_str());
        assert_eq!(parts, ("look.stereo.with.block", Comparison::AtLeast, "5"));
        assert_eq!(
            "tag!=a=b".parse::<Condition>().map(|one| (one.comparison, one.value)),
            Ok((Comparison::Unequal, "a=b".into()))
        );
        let error = "state=finished".parse::<Condition>().unwrap_err();
        assert!(error.contains("there is no state `finished`") && error.contains("complete"), "{error}");
        assert!("block".parse::<Condition>().is_err() && "=5".parse::<Condition>().is_err());
    }

    #[test]
    fn numbers_compare_by_value_and_other_values_by_their_text() {
        assert!(holds("x=5", &json!(5.0)) && holds("x=5.0", &json!(5)) && !holds("x=5", &json!("five")));
        assert!(holds("x<10", &json!(9)) && !holds("x<10", &json!(10)) && holds("x<=10", &json!(10)));
        assert!(holds("x>2", &json!(10)) && holds("x!=2", &json!(10)) && !holds("x>2", &json!("many")));
        assert!(holds("x=sgbm", &json!("sgbm")) && holds("x=true", &json!(true)) && holds("x=~", &json!(null)));
        assert!(holds("x=[640,192]", &json!([640, 192])) && holds("x=[640, 192]", &json!([640, 192])));
        let folder = json!({ "name": "kitti" });
        assert!(holds("x=/data/kitti/", &folder) && holds("x=kitti", &folder));
        assert!(!holds("x!=/data/kitti", &folder) && holds("x!=/data/other", &folder));
        assert!(holds("x!=a", &json!("b")) && !holds("x<b", &json!("a")));
    }

    #[test]
    fn a_file_is_compared_by_its_content() {
        let folder = tempfile::tempdir().expect("a folder");
        let (same, other) = (folder.path().join("same.onnx"), folder.path().join("other.onnx"));
        std::fs::write(&same, "network").expect("written");
        std::fs::write(&other, "another network").expect("written");
        let key = Key::of_content(b"network").to_string();
        let stored = json!({ "content": key });
        let condition = |sign: &str, value: &str| format!("learn.net.with.file{sign}{value}");
        let [same, other] = [same, other].map(|file| file.display().to_string());
        assert!(holds(&condition("=", &same), &stored) && !holds(&condition("=", &other), &stored));
        assert!(holds(&condition("!=", &other), &stored) && !holds(&condition("!=", &same), &stored));
        assert!(holds(&condition("=", &key), &stored), "the hash itself");
        let missing = condition("=", "missing.onnx").parse::<Condition>().expect("a condition");
        let error = missing.is_true_of(&stored).expect_err("there is no such file");
        assert!(error.contains("learn.net.with.file is stored as the hash of a file, and missing.onnx cannot be read"));
    }
}
