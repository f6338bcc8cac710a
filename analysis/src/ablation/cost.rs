//! What an estimate costs: the processor time of all that it is computed from.

use std::collections::{HashMap, HashSet};

use depthloom_recording::{RecordedPlan, RecordedRun};

use crate::estimates::Estimate;
use crate::input::timings::Timing;
use crate::tables::RowKeys;

/// The processor time of a run's nodes.
///
/// An estimate's core-milliseconds a frame are the sum, over all nodes of its stage that it is computed from, of their
/// mean processor time a frame: what it would cost had it been run alone. A node that several share counts for each of
/// them whole. Reading, scoring and recording are not in it, nor what is done once (learning).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Costs {
    /// Core-milliseconds a frame by stage, variant and node, as timings have them.
    ms: HashMap<(String, Option<String>, String), f64>,
}

impl Costs {
    /// The costs that a run's timings tell.
    #[must_use]
    pub fn new(timings: &[Timing]) -> Self {
        let per_frame = timings.iter().filter(|timing| timing.phase == "process" && timing.frames > 0);
        let ms = per_frame.map(|timing| {
            let ms = timing.cpu_ns as f64 / 1e6 / timing.frames as f64;
            ((timing.lead.stage.clone(), timing.lead.variant.clone(), timing.node.clone()), ms)
        });
        Self { ms: ms.collect() }
    }

    /// By estimate; `None` where it is not known what was scored, or a node it comes from has no time: its values were
    /// there before.
    pub(crate) fn core_ms(&self, plan: &RecordedPlan, estimates: &[Estimate]) -> Vec<Option<f64>> {
        let (leads, graphs) = (RowKeys::new(plan), plan.runs.iter().map(Graph::new).collect::<Vec<Graph<'_>>>());
        estimates.iter().map(|estimate| self.of(&leads, &graphs, estimate)).collect()
    }

    fn of(&self, leads: &RowKeys<'_>, graphs: &[Graph<'_>], estimate: &Estimate) -> Option<f64> {
        let graph = &graphs[estimate.run];
        let mut sum = 0.0;
        let mut nodes: Vec<usize> = graph.upstream(estimate.estimate.as_deref()?).into_iter().collect();
        // In one order, so that equal costs are equal numbers.
        nodes.sort_unstable();
        for node in nodes {
            let planned = &graph.run.nodes[node];
            if planned.contract == "once" {
                continue;
            }
            let lead = leads.of_those(&graph.run.stage, &planned.variants);
            sum += self.ms.get(&(lead.stage, lead.variant, planned.name.clone()))?;
        }
        Some(sum)
    }
}

/// Which node of a stage run gives a topic.
struct Graph<'a> {
    run: &'a RecordedRun,
    by_topic: HashMap<&'a str, usize>,
}

impl<'a> Graph<'a> {
    fn new(run: &'a RecordedRun) -> Self {
        let nodes = run.nodes.iter().enumerate();
        let topics = nodes.flat_map(|(node, of)| of.outputs.iter().map(move |output| (output.topic.as_str(), node)));
        Self { run, by_topic: topics.collect() }
    }

    /// The nodes that a topic's value is computed from; of the source's, none.
    fn upstream(&self, topic: &str) -> HashSet<usize> {
        let mut found = HashSet::new();
        let mut left: Vec<usize> = self.by_topic.get(topic).copied().into_iter().collect();
        while let Some(node) = left.pop() {
            if found.insert(node) {
                let inputs = self.run.nodes[node].inputs.iter().filter_map(|input| input.from.as_deref());
                left.extend(inputs.filter_map(|from| self.by_topic.get(from)));
            }
        }
        found
    }
}
