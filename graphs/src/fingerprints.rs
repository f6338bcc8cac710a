//! Adds the fingerprints of this machine's engines to the node hashes of a plan.
//!
//! Planning opens no library, so what a fingerprint adds (see [`Node::fingerprint`](crate::Node::fingerprint)) is
//! known only when the plan is made ready. It enters the node hash of the node and of every node that reads it, in any
//! stage.

use std::collections::BTreeMap;

use crate::key::Key;
use crate::plan::{NodeId, NodeRef, Plan, RunId};

pub(crate) fn add(plan: &mut Plan, fingerprints: &BTreeMap<NodeRef, Key>) {
    let mut changed: BTreeMap<NodeRef, Key> = BTreeMap::new();
    // Every node comes after those it reads.
    for run in RunId::all(plan.runs.len()) {
        for node in NodeId::all(plan.runs[run].nodes.len()) {
            let planned = &plan.runs[run].nodes[node];
            let mut inputs: Vec<(&str, &Key)> = planned
                .inputs
                .iter()
                .filter_map(|input| Some((input.port.name, changed.get(&input.node_read(run)?)?)))
                .collect();
            inputs.sort_unstable();
            let own = fingerprints.get(&NodeRef { run, node });
            if own.is_none() && inputs.is_empty() {
                continue;
            }
            let node_hash = own.map_or_else(|| Key::build("on engines"), |own| Key::build("on an engine").key(own));
            let node_hash = node_hash.key(&planned.node_hash);
            let node_hash =
                inputs.into_iter().fold(node_hash, |node_hash, (port, read)| node_hash.text(port).key(read)).finish();
            plan.runs[run].nodes[node].node_hash = node_hash;
            changed.insert(NodeRef { run, node }, node_hash);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde_json::Value as Json;

    use super::add;
    use crate::ValueType;
    use crate::contracts::{Contract, Port, Slot};
    use crate::key::Key;
    use crate::plan::{
        NodeId, NodeRef, Origin, Plan, PlannedInput, PlannedNode, PlannedSource, PortId, Record, RunId, StageRun,
        VariantId,
    };

    fn node(name: &str, from: Option<Origin>) -> PlannedNode {
        PlannedNode {
            name: name.to_owned(),
            kind: "toy/any".to_owned(),
            version: 1,
            contract: Contract::Pure,
            params: Json::Null,
            shown: Json::Null,
            portable: Json::Null,
            auto: Vec::new(),
            inputs: vec![PlannedInput { port: Port::frame("depth", ValueType::Depth, "Any."), from, shown: None }],
            outputs: Vec::new(),
            observes: None,
            node_hash: Key::of_content(name.as_bytes()),
            variants: vec![VariantId(0)],
        }
    }

    fn run(nodes: Vec<PlannedNode>) -> StageRun {
        let source = PlannedSource { name: "any".to_owned(), parts: Vec::new(), outputs: Vec::new() };
        let (stage, prefix) = ("look".to_owned(), "/look".to_owned());
        StageRun { stage, prefix, source, nodes, estimates: Vec::new(), variants: vec![VariantId(0)] }
    }

    /// Two stages: of the first, `network` and what reads it; of the second, a reader of its aggregate value, and one
    /// of the source.
    fn plan() -> Plan {
        let here = |node| Some(Origin::Here(Slot::Node { node: NodeId(node), port: PortId(0) }));
        let source = || Some(Origin::Here(Slot::Source { port: PortId(0) }));
        let once = Some(Origin::Once { run: RunId(0), node: NodeId(1), port: PortId(0) });
        Plan {
            experiment: "any".to_owned(),
            description: String::new(),
            variants: vec![String::new()],
            factors: Vec::new(),
            labels: crate::plan::Labels::default(),
            runs: vec![
                run(vec![node("network", source()), node("reader", here(0)), node("beside", source())]),
                run(vec![node("later", once), node("alone", source())]),
            ],
            record: Record { every: 1, view: false, points: Vec::new() },
            written: Vec::new(),
            resolved: String::new(),
        }
    }

    fn node_hashes(fingerprint: Option<&[u8]>) -> Vec<Key> {
        let mut plan = plan();
        let of_network =
            fingerprint.map(|engine| (NodeRef { run: RunId(0), node: NodeId(0) }, Key::of_content(engine)));
        add(&mut plan, &of_network.into_iter().collect::<BTreeMap<_, _>>());
        plan.runs.iter().flat_map(|run| &run.nodes).map(|node| node.node_hash).collect()
    }

    #[test]
    fn an_engine_enters_the_recipes_of_its_nodes_and_of_what_reads_them_in_every_stage() {
        let (planned, one, other) = (node_hashes(None), node_hashes(Some(b"1.31")), node_hashes(Some(b"1.32")));
        let planned_by_name: Vec<Key> =
            ["network", "reader", "beside", "later", "alone"].map(|name| Key::of_content(name.as_bytes())).to_vec();
        assert_eq!(planned, planned_by_name, "without engines a node hash is the plan's");
        let differs = |a: &[Key], b: &[Key]| a.iter().zip(b).map(|(a, b)| a != b).collect::<Vec<_>>();
        assert_eq!(differs(&planned, &one), [true, true, false, true, false]);
        assert_eq!(differs(&one, &other), [true, true, false, true, false]);
        assert_eq!(one, node_hashes(Some(b"1.31")));
    }
}
