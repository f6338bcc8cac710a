//! Parameters that follow others unless they are given a value of their own: what they became, and where one stays behind.
//!
//! A node's penalties follow its block. Who sweeps the block and holds the penalties compares blocks at penalties that fit one of them
//! alone, which the numbers do not show: it is said.

use std::collections::{BTreeMap, HashSet};

use serde_json::Value as Json;

use super::params::Parameters;
use super::spec::Spec;
use crate::language::ids::{StageId, StageNode, StageNodeId};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::source_file::Place;
use crate::registry::ParamError;

/// A parameter that can follow others; see [`Auto`](crate::contracts::Auto).
#[derive(Debug, PartialEq)]
pub(crate) struct Following {
    pub(crate) name: String,
    /// Whether it does.
    pub(crate) is_auto: bool,
    /// The parameters that it follows, with the values they have.
    follows: Vec<(String, Json)>,
    /// What it would be if it followed them.
    auto: Json,
}

/// The attribute of a parameter's schema that names those it follows.
const FOLLOWS: &str = "follows";
const AUTO: &str = "auto";

/// Of parameters as given and as resolved, those that can follow others.
pub(super) fn of(
    schema: &Json,
    given: &Json,
    resolved: &Json,
    resolve: &dyn Fn(&Json) -> Result<Json, ParamError>,
) -> Vec<Following> {
    let properties = schema.get("properties").and_then(Json::as_object).into_iter().flatten();
    let all: Vec<(&String, &Vec<Json>)> =
        properties.filter_map(|(name, schema)| Some((name, schema.get(FOLLOWS)?.as_array()?))).collect();
    if all.is_empty() {
        return Vec::new();
    }
    let mut all_auto = given.clone();
    all.iter().for_each(|(name, _)| all_auto[name.as_str()] = AUTO.into());
    let Ok(followed) = resolve(&all_auto) else { return Vec::new() };
    let value = |name: &Json| {
        let name = name.as_str()?;
        Some((name.to_owned(), resolved.get(name)?.clone()))
    };
    let following = |(name, follows): (&String, &Vec<Json>)| Following {
        name: name.clone(),
        is_auto: given.get(name).is_none_or(|given| given == AUTO),
        follows: follows.iter().filter_map(value).collect(),
        auto: followed[name.as_str()].clone(),
    };
    all.into_iter().map(following).collect()
}

/// What is to be said of a parameter that is wrong and was not given: whence its value comes.
pub(super) fn cause(schema: &Json, given: &Json, path: &[String]) -> Option<String> {
    let [name] = path else { return None };
    let follows = schema.get("properties")?.get(name)?.get(FOLLOWS)?.as_array()?;
    let follows: Vec<String> = follows.iter().filter_map(|name| Some(format!("`{}`", name.as_str()?))).collect();
    let is_auto = given.get(name).is_none_or(|given| given == AUTO);
    is_auto.then(|| {
        format!(
            "`{name}` is `auto`: it follows {}; give it a value of its own, or leave the others to it",
            follows.join(", ")
        )
    })
}

/// What is to be said where a parameter that was given does not go with others which are `auto`: what those are without it.
pub(super) fn others(
    schema: &Json,
    given: &Json,
    path: &[String],
    what: &str,
    resolve: &dyn Fn(&Json) -> Result<Json, ParamError>,
) -> Option<String> {
    let [name] = path else { return None };
    let mut rest = given.clone();
    rest.as_object_mut()?.shift_remove(name)?;
    let rest = resolve(&rest).ok()?;
    let properties = schema.get("properties")?.as_object()?;
    let is_named = |other: &str| what.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == other);
    let others = properties.iter().filter_map(|(other, schema)| {
        let follows = schema.get(FOLLOWS)?.as_array()?;
        let is_auto = other != name && given.get(other).is_none_or(|given| given == AUTO);
        (is_auto && is_named(other)).then_some(())?;
        let follows = follows.iter().filter_map(Json::as_str).map(|name| match rest.get(name) {
            Some(value) => format!("`{name}` {value}"),
            None => format!("`{name}`"),
        });
        let follows: Vec<String> = follows.collect();
        Some(format!("`{other}` is `auto`, {} at {}", rest.get(other)?, follows.join(", ")))
    });
    let others: Vec<String> = others.collect();
    (!others.is_empty()).then(|| format!("{}; give it a value of its own, too", others.join(", ")))
}

/// A parameter of a node with a value of its own, in all variants.
struct Held {
    node: String,
    place: Place,
    /// Its values, each once.
    own: Vec<Json>,
    /// What it would be, each once.
    auto: Vec<Json>,
    /// The values of those it could follow, each once.
    follows: Vec<(String, Vec<Json>)>,
}

/// What is held while what it could follow is swept, by node and name.
#[derive(Default)]
pub(crate) struct Sweeps {
    held: BTreeMap<(StageNode, String), Held>,
    /// What follows in one variant or another.
    followed: HashSet<(StageNode, String)>,
}

impl Sweeps {
    /// Looks at a variant; `parameters` finds those of a node.
    pub(crate) fn look<'p>(&mut self, spec: &Spec, parameters: impl Fn(StageNode) -> Option<&'p Parameters>) {
        for (stage_id, stage) in StageId::enumerate(&spec.stages) {
            for (id, node) in StageNodeId::enumerate(&stage.nodes) {
                let id = StageNode { stage: stage_id, node: id };
                let Some(parameters) = parameters(id) else { continue };
                let with = node.instance.as_ref().and_then(|instance| instance.with.as_ref());
                for following in &parameters.following {
                    let name = &following.name;
                    if following.is_auto {
                        self.followed.insert((id, name.clone()));
                        continue;
                    }
                    let Some(written) = with.and_then(|with| with.entry(name)) else { continue };
                    let held = self.held.entry((id, name.clone())).or_insert_with(|| Held {
                        node: node.name.text.clone(),
                        place: written.key_place.clone(),
                        own: Vec::new(),
                        auto: Vec::new(),
                        follows: following.follows.iter().map(|(name, _)| (name.clone(), Vec::new())).collect(),
                    });
                    once(&mut held.own, &parameters.resolved[name.as_str()]);
                    once(&mut held.auto, &following.auto);
                    for ((_, values), (_, value)) in held.follows.iter_mut().zip(&following.follows) {
                        once(values, value);
                    }
                }
            }
        }
    }

    /// Says what is held. What takes several values of its own is swept too, and meant so.
    pub(crate) fn report(self, report: &mut Report) {
        let Self { held, followed } = self;
        for (key, held) in held.into_iter().filter(|(_, held)| held.own.len() == 1 && held.auto.len() > 1) {
            let label = match followed.contains(&key) {
                true => "the same in all variants that set it",
                false => "the same in all variants",
            };
            let (_, name) = key;
            let swept = held.follows.iter().filter(|(_, values)| values.len() > 1);
            let swept: Vec<String> =
                swept.map(|(name, values)| format!("`{name}`, which it would follow, is {}", listed(values))).collect();
            let what = format!("`{name}` of node `{}` stays {} while {}", held.node, held.own[0], swept.join(" and "));
            let help = format!("`{name}: auto`, its default, would be {}", listed(&held.auto));
            report.push(Diagnostic::warning(&held.place, what).label(label).help(help));
        }
    }
}

fn once(values: &mut Vec<Json>, value: &Json) {
    if !values.contains(value) {
        values.push(value.clone());
    }
}

/// Values in a sentence; long lists are cut.
fn listed(values: &[Json]) -> String {
    const MOST: usize = 8;
    let shown: Vec<String> = values.iter().take(MOST).map(ToString::to_string).collect();
    let more = if values.len() > MOST { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
