//! Topics: `/<stage>/<node>/<port>`, and `/<stage>/<variant>/<node>/<port>` where variants differ.

use std::collections::HashMap;

use super::linked::Linked;
use super::record::Recorded;
use super::share::{Shared, SharedRun};
use crate::contracts::Port;
use crate::plan::{NodeRef, PlannedOutput, VariantId};

#[derive(Default)]
struct Uses<'a> {
    names: Vec<(&'a str, Vec<VariantId>)>,
    is_score: bool,
}

pub(crate) struct Topics<'a> {
    variants: &'a [String],
    recorded: &'a Recorded,
    uses: HashMap<NodeRef, Uses<'a>>,
}

impl<'a> Topics<'a> {
    pub(crate) fn new(
        shared: &Shared<'_>,
        variants: &'a [String],
        linked: &'a [Linked<'_>],
        recorded: &'a Recorded,
    ) -> Self {
        let mut uses: HashMap<NodeRef, Uses<'a>> = HashMap::new();
        for (variant, (linked, placed)) in VariantId::enumerate(linked.iter().zip(&shared.placed)) {
            for (stage, placed) in linked.stages.iter().zip(placed) {
                for (node, id) in stage.nodes.iter().zip(&placed.nodes) {
                    let Some(id) = *id else { continue };
                    let uses = uses.entry(NodeRef { run: placed.run, node: id }).or_default();
                    uses.is_score |= node.is_score;
                    match uses.names.iter_mut().find(|(name, _)| *name == node.name.text) {
                        Some((_, variants)) => variants.push(variant),
                        None => uses.names.push((&node.name.text, vec![variant])),
                    }
                }
            }
        }
        Self { variants, recorded, uses }
    }

    pub(crate) fn prefix(&self, run: &SharedRun<'_>) -> String {
        match run.variants.first() {
            Some(&first) if run.variants.len() < self.variants.len() => {
                format!("/{}/{}", run.stage, self.variants[first])
            }
            _ => format!("/{}", run.stage),
        }
    }

    pub(crate) fn of_source(&self, run: &SharedRun<'_>) -> Vec<PlannedOutput> {
        let uses = [("source", run.variants.clone())];
        run.source.outputs.iter().map(|port| self.output(run, &uses, port, false)).collect()
    }

    pub(crate) fn of_node(&self, shared: &Shared<'_>, node: NodeRef) -> Vec<PlannedOutput> {
        let stage_run = &shared.runs[node.run];
        let (names, is_score) = self.uses.get(&node).map_or((&[][..], false), |u| (&u.names, u.is_score));
        let ports = &stage_run.nodes[node.node].signature.outputs;
        ports.iter().map(|port| self.output(stage_run, names, port, is_score)).collect()
    }

    fn output(
        &self,
        run: &SharedRun<'_>,
        uses: &[(&str, Vec<VariantId>)],
        port: &Port,
        always_recorded: bool,
    ) -> PlannedOutput {
        let stage = run.stage;
        let mut topics = Vec::new();
        for (node, variants) in uses {
            if variants.len() == self.variants.len() {
                topics.push(format!("/{stage}/{node}/{}", port.name));
            } else {
                topics.extend(variants.iter().map(|&v| format!("/{stage}/{}/{node}/{}", self.variants[v], port.name)));
            }
        }
        let mut topics = topics.into_iter();
        let topic = topics.next().unwrap_or_default();
        let recorded = always_recorded || uses.iter().any(|(node, _)| self.recorded.keeps(stage, node, port));
        PlannedOutput { port: port.clone(), topic, aliases: topics.collect(), recorded }
    }
}
