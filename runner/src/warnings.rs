//! Warnings of nodes: duplicates are counted, and reported once.

use std::collections::BTreeMap;
use std::sync::Mutex;

use depthloom_graphs::Rate;
use depthloom_graphs::plan::{NodeId, Plan, RunId};
use depthloom_threads::{into_unlocked, locked};

/// A warning of a node.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Warning {
    /// The stage run.
    pub run: RunId,
    /// The node; `None` for the source.
    pub node: Option<NodeId>,
    /// A lower-case fragment; for counted things their name in the plural.
    pub what: String,
    /// How many things there were; 0 if they are not counted.
    pub count: u64,
    /// How often it was reported: on how many frames, for a node that sees frames.
    pub times: u64,
}

impl Warning {
    /// Stage run, node, message, and how often.
    pub fn text(&self, plan: &Plan) -> String {
        let run = &plan.runs[self.run];
        let node = self.node.map(|node| &run.nodes[node]);
        let name = node.map_or(&run.source.name, |node| &node.name);
        let stage = run.prefix.trim_start_matches('/');
        let variants = node.map(|node| node.variant_names(plan)).filter(|names| !names.is_empty());
        let variants = variants.map(|names| format!(" (of {})", names.join(", "))).unwrap_or_default();
        let count = if self.count > 0 { format!("{} ", self.count) } else { String::new() };
        let sees_frames = node.is_none_or(|node| node.outputs.iter().any(|output| output.port.rate == Rate::Frame));
        let often = match (self.times, sees_frames) {
            (1, true) => ", on 1 frame".to_owned(),
            (times, true) => format!(", on {times} frames"),
            (1, false) => String::new(),
            (times, false) => format!(", {times} times"),
        };
        format!("{stage}.{name}{variants}: {count}{}{often}", self.what)
    }
}

/// Stage run, node and message.
type WarningKey = (RunId, Option<NodeId>, String);

/// The warnings of a run so far: count and times.
#[derive(Default)]
pub(crate) struct Warnings(Mutex<BTreeMap<WarningKey, (u64, u64)>>);

impl Warnings {
    /// Adds a warning; `is_new` if its frame did not have it yet. Returns whether it is the first of its kind.
    pub(crate) fn add(&self, run: RunId, node: Option<NodeId>, what: &str, count: u64, is_new: bool) -> bool {
        let mut warnings = locked(&self.0);
        let (counted, times) = warnings.entry((run, node, what.to_owned())).or_default();
        *counted = counted.saturating_add(count);
        *times += u64::from(is_new);
        *times == 1 && is_new
    }

    /// In plan order.
    pub(crate) fn into_list(self) -> Vec<Warning> {
        let warnings = into_unlocked(self.0);
        let warning = |((run, node, what), (count, times))| Warning { run, node, what, count, times };
        warnings.into_iter().map(warning).collect()
    }
}
