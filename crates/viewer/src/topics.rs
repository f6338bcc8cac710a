//! The topics that a viewer is offered.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_graphs::contracts::{ErrorMessage, Slot};
use depthloom_graphs::language::glob;
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_recording::MessageEncoder;

/// The selected topics of a slot's values.
#[derive(Debug, Default)]
pub(crate) struct SlotTopics {
    pub(crate) channels: Vec<u16>,
    /// The other slots that its messages are computed from.
    pub(crate) inputs: Vec<Slot>,
    /// Whether a value was seen. Only then it is known which of its channels are used.
    is_advertised: AtomicBool,
}

impl SlotTopics {
    pub(crate) fn is_advertised(&self) -> bool {
        self.is_advertised.load(Ordering::Relaxed)
    }

    pub(crate) fn set_advertised(&self) {
        self.is_advertised.store(true, Ordering::Relaxed);
    }
}

/// By stage run and slot.
pub(crate) type Topics = BTreeMap<(RunId, Slot), SlotTopics>;

/// The topics that match one of the patterns: as a recording names them, or as the plan does. A value's topic stands
/// for its preview and its camera's topics too. Without patterns, all topics match.
///
/// # Errors
/// If a pattern matches no topic.
pub(crate) fn select(plan: &Plan, encoder: &MessageEncoder, patterns: &[String]) -> Result<Topics, ErrorMessage> {
    let names: BTreeMap<u16, &str> = encoder.channels().map(|(id, channel)| (id, channel.topic)).collect();
    let mut topics = Topics::new();
    let (mut matched, mut known) = (BTreeSet::new(), BTreeSet::new());
    for (run, stage_run) in RunId::enumerate(&plan.runs) {
        for slot in stage_run.slots() {
            let Some(topic) = encoder.topic(run, slot) else { continue };
            let mut channels = encoder.slot_channels(run, slot);
            channels.retain(|channel| {
                let name = names.get(channel).copied().unwrap_or_default();
                known.insert(name.to_owned());
                let matching = patterns.iter().filter(|pattern| glob(pattern, name) || glob(pattern, topic));
                let matching: Vec<&str> = matching.map(String::as_str).collect();
                let is_selected = patterns.is_empty() || !matching.is_empty();
                matched.extend(matching);
                is_selected
            });
            if !channels.is_empty() {
                let inputs = encoder.inputs(run, slot);
                topics.insert((run, slot), SlotTopics { channels, inputs, is_advertised: AtomicBool::new(false) });
            }
        }
    }
    match patterns.iter().find(|pattern| !matched.contains(pattern.as_str())) {
        Some(pattern) => {
            let known = known.into_iter().collect::<Vec<_>>().join(", ");
            Err(ErrorMessage::new(format!("no topic matches `{pattern}`")).remedy(format!("there are {known}")))
        }
        None => Ok(topics),
    }
}
