//! Warns of a parameter that stays fixed while others that it could follow are swept.
//!
//! A node's penalties follow its block size. A sweep of the block size with fixed penalties compares blocks with
//! penalties that fit only one of them.

use std::collections::{BTreeMap, HashSet};

use serde_json::Value as Json;

use super::params::Parameters;
use super::spec::Spec;
use crate::language::ids::{StageId, StageNode, StageNodeId};
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::source_file::Place;

/// A parameter that could follow others but has its own value.
struct OwnValue {
    node: String,
    place: Place,
    own: Vec<Json>,
    /// Its values if it followed the others, each once.
    auto: Vec<Json>,
    follows: Vec<(String, Vec<Json>)>,
}

#[derive(Default)]
pub(crate) struct Sweeps {
    own_values: BTreeMap<(StageNode, String), OwnValue>,
    followed: HashSet<(StageNode, String)>,
}

impl Sweeps {
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
                    let value = self.own_values.entry((id, name.clone())).or_insert_with(|| OwnValue {
                        node: node.name.text.clone(),
                        place: written.key_place.clone(),
                        own: Vec::new(),
                        auto: Vec::new(),
                        follows: following.follows.iter().map(|(name, _)| (name.clone(), Vec::new())).collect(),
                    });
                    once(&mut value.own, &parameters.resolved[name.as_str()]);
                    once(&mut value.auto, &following.auto);
                    for ((_, values), (_, followed)) in value.follows.iter_mut().zip(&following.follows) {
                        once(values, followed);
                    }
                }
            }
        }
    }

    /// A parameter with several values of its own is swept deliberately.
    pub(crate) fn report(self, report: &mut Report) {
        let Self { own_values, followed } = self;
        for (key, value) in own_values.into_iter().filter(|(_, value)| value.own.len() == 1 && value.auto.len() > 1) {
            let label = match followed.contains(&key) {
                true => "the same in all variants that set it",
                false => "the same in all variants",
            };
            let (_, name) = key;
            let swept = value.follows.iter().filter(|(_, values)| values.len() > 1);
            let swept: Vec<String> =
                swept.map(|(name, values)| format!("`{name}`, which it would follow, is {}", listed(values))).collect();
            let what =
                format!("`{name}` of node `{}` stays {} while {}", value.node, value.own[0], swept.join(" and "));
            let help = format!("`{name}: auto`, its default, would be {}", listed(&value.auto));
            report.push(Diagnostic::warning(&value.place, what).label(label).help(help));
        }
    }
}

fn once(values: &mut Vec<Json>, value: &Json) {
    if !values.contains(value) {
        values.push(value.clone());
    }
}

fn listed(values: &[Json]) -> String {
    const MOST: usize = 8;
    let shown: Vec<String> = values.iter().take(MOST).map(ToString::to_string).collect();
    let more = if values.len() > MOST { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
