//! Random graphs of toys.

use std::collections::BTreeSet;

use depthloom_graphs::contracts::{Contract, Slot};
use depthloom_graphs::plan::{NodeId, Origin, PortId, RunId};
use proptest::collection::{btree_set, vec};
use proptest::prelude::*;

use super::{Bench, Numbers, Toy};

/// A random node: indices are taken modulo what there is to choose from.
#[derive(Clone, Debug)]
pub(crate) struct AnyNode {
    contract: u8,
    a: usize,
    b: Option<usize>,
    once: Option<usize>,
    tiles: usize,
    fails_at: BTreeSet<u64>,
    panics_at: BTreeSet<u64>,
    absent_at: BTreeSet<u64>,
}

#[derive(Clone, Debug)]
pub(crate) struct AnyGraph {
    pub frames: u64,
    pub stages: Vec<Vec<AnyNode>>,
    pub source_fails_at: BTreeSet<u64>,
    pub source_absent_at: BTreeSet<u64>,
    pub parts: usize,
    pub window: usize,
    pub keep_going: bool,
}

fn any_node(mishaps: usize) -> impl Strategy<Value = AnyNode> {
    let few = |most: usize| btree_set(1..25_u64, 0..=most);
    (
        0..6_u8,
        any::<usize>(),
        prop::option::of(any::<usize>()),
        prop::option::of(any::<usize>()),
        0..5_usize,
        few(mishaps),
        prop_oneof![9 => Just(BTreeSet::new()), 1 => few(mishaps)],
        few(6),
    )
        .prop_map(|(contract, a, b, once, tiles, fails_at, panics_at, absent_at)| {
            let tiles = if tiles < 4 { 0 } else { 6 };
            AnyNode { contract, a, b, once, tiles, fails_at, panics_at, absent_at }
        })
}

pub(crate) fn any_graph() -> impl Strategy<Value = AnyGraph> {
    (0..2_usize).prop_flat_map(|mishaps| {
        let few = |most: usize| btree_set(1..25_u64, 0..=most);
        let stages = vec(vec(any_node(mishaps), 0..9), 1..3);
        (0..24_u64, stages, few(mishaps), few(4), 0..4_usize, 1..7_usize, any::<bool>()).prop_map(
            |(frames, stages, source_fails_at, source_absent_at, parts, window, keep_going)| AnyGraph {
                frames,
                stages,
                source_fails_at,
                source_absent_at,
                parts,
                window,
                keep_going,
            },
        )
    })
}

pub(crate) fn bench(graph: &AnyGraph) -> Bench {
    let mut bench = Bench::new(&["one"]);
    let mut aggregate_values: Vec<Origin> = Vec::new();
    for (run, nodes) in RunId::enumerate(&graph.stages) {
        let mut source = Numbers::new(graph.frames);
        (source.toy.fails_at, source.toy.absent_at) = (graph.source_fails_at.clone(), graph.source_absent_at.clone());
        bench.stage(&format!("stage{run}"), source);
        let mut slots = vec![Slot::Source { port: PortId(0) }, Slot::Source { port: PortId(1) }];
        // Frames may read aggregate values of earlier stages, aggregate nodes those of their own stage too.
        let earlier = aggregate_values.len();
        for (id, node) in NodeId::enumerate(nodes) {
            let contract = match node.contract {
                0 => Contract::Ordered,
                1 if !aggregate_values.is_empty() => Contract::Once,
                _ => Contract::Pure,
            };
            let slot = |i: usize| Some(Origin::Here(slots[i % slots.len()]));
            let pick = |i: usize, of: usize| (of > 0).then(|| aggregate_values[i % of].clone());
            let from = match contract {
                Contract::Once => {
                    let all = aggregate_values.len();
                    [pick(node.a, all), node.once.and_then(|i| pick(i, all)), None]
                }
                Contract::Pure | Contract::Ordered => {
                    [slot(node.a), node.b.and_then(slot), node.once.and_then(|i| pick(i, earlier))]
                }
            };
            let toy = Toy {
                salt: 100 * run.0 as u64 + id.0 as u64,
                tiles: node.tiles,
                fails_at: node.fails_at.clone(),
                panics_at: node.panics_at.clone(),
                absent_at: node.absent_at.clone(),
                ..Toy::default()
            };
            bench.toy(&format!("n{run}_{id}"), contract, from, toy);
            if contract != Contract::Once {
                slots.extend([0, 1].map(|port| Slot::Node { node: id, port: PortId(port) }));
            }
            match contract {
                Contract::Ordered => aggregate_values.push(Origin::Once { run, node: id, port: PortId(2) }),
                Contract::Once => aggregate_values.push(Origin::Once { run, node: id, port: PortId(0) }),
                Contract::Pure => {}
            }
        }
    }
    bench
}
