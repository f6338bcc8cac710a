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
struct Held {
    node: String,
    place: Place,
    own: Vec<Json>,
    /// Its values if it followed the others, each once.
    auto: Vec<Json>,
    follows: Vec<(String, Vec<Json>)>,
}

#[derive(Default)]
pub(crate) struct Sweeps {
    held: BTreeMap<(StageNode, String), Held>,
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

    /// A parameter with several values of its own is swept deliberately.
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

fn listed(values: &[Json]) -> String {
    const MOST: usize = 8;
    let shown: Vec<String> = values.iter().take(MOST).map(ToString::to_string).collect();
    let more = if values.len() > MOST { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
