//! The cost of an estimate: the CPU time of all nodes that it is computed from.

use std::collections::{HashMap, HashSet};

use depthloom_recording::{RecordedPlan, RecordedRun};

use crate::estimates::Estimate;
use crate::input::timings::Timing;
use crate::tables::RowKeys;

/// The CPU time of the nodes of a run.
///
/// The core-milliseconds of an estimate are a sum over all nodes of its stage that it is computed from: their mean CPU
/// time per frame. This is the cost of the estimate if it ran alone. A shared node counts fully for each estimate.
/// Reading, scoring, recording and aggregate nodes (training) are not included.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Costs {
    /// Core-milliseconds per frame by stage, variant and node, as in the timings.
    ms: HashMap<(String, Option<String>, String), f64>,
}

impl Costs {
    /// Computes the costs from the timings of a run.
    #[must_use]
    pub fn new(timings: &[Timing]) -> Self {
        let per_frame = timings.iter().filter(|timing| timing.phase == "process" && timing.frames > 0);
        let ms = per_frame.map(|timing| {
            let ms = timing.cpu_ns as f64 / 1e6 / timing.frames as f64;
            ((timing.row_key.stage.clone(), timing.row_key.variant.clone(), timing.node.clone()), ms)
        });
        Self { ms: ms.collect() }
    }

    /// The cost of each estimate. `None` if the recording does not name the scored output, or if a node has no timing
    /// because its values were reused.
    pub(crate) fn core_ms(&self, plan: &RecordedPlan, estimates: &[Estimate]) -> Vec<Option<f64>> {
        let (row_keys, graphs) = (RowKeys::new(plan), plan.runs.iter().map(Graph::new).collect::<Vec<Graph<'_>>>());
        estimates.iter().map(|estimate| self.estimate_ms(&row_keys, &graphs, estimate)).collect()
    }

    fn estimate_ms(&self, row_keys: &RowKeys<'_>, graphs: &[Graph<'_>], estimate: &Estimate) -> Option<f64> {
        let graph = &graphs[estimate.run];
        let mut sum = 0.0;
        let mut nodes: Vec<usize> = graph.upstream(estimate.scored_output.as_deref()?).into_iter().collect();
        // A fixed order, so that equal costs are equal numbers.
        nodes.sort_unstable();
        for node in nodes {
            let planned = &graph.run.nodes[node];
            if planned.contract == "once" {
                continue;
            }
            let row_key = row_keys.for_variants(&graph.run.stage, &planned.variants);
            sum += self.ms.get(&(row_key.stage, row_key.variant, planned.name.clone()))?;
        }
        Some(sum)
    }
}

/// Maps each topic of a stage run to the node that computes it.
struct Graph<'a> {
    run: &'a RecordedRun,
    by_topic: HashMap<&'a str, usize>,
}

impl<'a> Graph<'a> {
    fn new(run: &'a RecordedRun) -> Self {
        let nodes = run.nodes.iter().enumerate();
        let topics =
            nodes.flat_map(|(place, node)| node.outputs.iter().map(move |output| (output.topic.as_str(), place)));
        Self { run, by_topic: topics.collect() }
    }

    /// The nodes that a topic is computed from; none for a topic of the source.
    fn upstream(&self, topic: &str) -> HashSet<usize> {
        let mut upstream = HashSet::new();
        let mut pending: Vec<usize> = self.by_topic.get(topic).copied().into_iter().collect();
        while let Some(node) = pending.pop() {
            if upstream.insert(node) {
                let inputs = self.run.nodes[node].inputs.iter().filter_map(|input| input.from.as_deref());
                pending.extend(inputs.filter_map(|from| self.by_topic.get(from)));
            }
        }
        upstream
    }
}
