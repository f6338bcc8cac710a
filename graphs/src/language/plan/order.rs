//! An order in which every node comes after those it reads; circles are reported.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::linked::LinkedNode;
use crate::language::ids::{StageId, StageNode, StageNodeId};
use crate::language::text::diagnostics::{Diagnostic, Report};

/// Otherwise in the order of the file. Nodes in or after a circle are left out.
pub(crate) fn sorted(stage: StageId, nodes: &[LinkedNode<'_>], report: &mut Report) -> Vec<StageNodeId> {
    let mut waiting_for: Vec<usize> = vec![0; nodes.len()];
    let mut readers: Vec<Vec<StageNodeId>> = vec![Vec::new(); nodes.len()];
    for (index, node) in StageNodeId::enumerate(nodes) {
        for (read, _) in node.reads.iter().filter(|(read, _)| read.stage == stage) {
            waiting_for[index] += 1;
            readers[read.node].push(index);
        }
    }
    let mut ready: BinaryHeap<Reverse<StageNodeId>> =
        StageNodeId::all(nodes.len()).filter(|&node| waiting_for[node] == 0).map(Reverse).collect();
    let mut order = Vec::with_capacity(nodes.len());
    while let Some(Reverse(node)) = ready.pop() {
        order.push(node);
        for &reader in &readers[node] {
            waiting_for[reader] -= 1;
            if waiting_for[reader] == 0 {
                ready.push(Reverse(reader));
            }
        }
    }
    if order.len() < nodes.len() {
        circles(stage, nodes, &waiting_for, report);
    }
    order
}

const LONGEST: usize = 12;

/// Each circle once, at the wire that closes it.
fn circles(stage: StageId, nodes: &[LinkedNode<'_>], waiting_for: &[usize], report: &mut Report) {
    let mut visited = vec![false; nodes.len()];
    for start in StageNodeId::all(nodes.len()).filter(|&node| waiting_for[node] > 0) {
        // Every node that waits reads another that waits: following those comes back to one seen before.
        let mut path: Vec<StageNodeId> = Vec::new();
        let mut node = start;
        while !visited[node] {
            visited[node] = true;
            path.push(node);
            let waits = |read: &StageNode| read.stage == stage && waiting_for[read.node] > 0;
            let Some((StageNode { node: next, .. }, place)) = nodes[node].reads.iter().find(|(read, _)| waits(read))
            else {
                break;
            };
            if let Some(first) = path.iter().position(|seen| seen == next) {
                let mut names: Vec<String> =
                    path[first..].iter().map(|&n| format!("`{}`", nodes[n].name.text)).collect();
                names.push(names[0].clone());
                if names.len() > LONGEST {
                    let left_out = names.len() - LONGEST;
                    names.splice(LONGEST / 2..LONGEST / 2 + left_out, [format!("{left_out} more, of which the last")]);
                }
                let what = if names.len() == 2 {
                    format!("node {} reads itself", names[0])
                } else {
                    format!("nodes read each other in a circle: {}", names.join(" reads "))
                };
                let help = "a node cannot depend on its own outputs: connect one of these inputs to another output";
                report.push(Diagnostic::error(place, what).label("closes the circle").help(help));
            }
            node = *next;
        }
    }
}
