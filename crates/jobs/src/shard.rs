//! A shard: what one process computes of a plan.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use depthloom_graphs::Key;
use depthloom_graphs::contracts::{Contract, Slot};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::plan::{NodeId, NodeRef, Origin, Plan, RunId, VariantId};
use depthloom_recording::RecordedWindow;
use depthloom_runner::{Share, StageShare};
use serde::{Deserialize, Serialize};

/// What one process computes of a plan. Other processes compute the rest, and a last run reuses all of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shard {
    /// Pure nodes on a block of the frames of each stage run.
    Frames {
        /// Which block.
        part: Fraction,
        /// The stage runs; all if empty.
        runs: Vec<usize>,
    },
    /// All nodes of a block of the variants.
    Variants {
        /// Which block.
        part: Fraction,
    },
    /// The aggregate values of nodes, such as a trained network.
    Nodes {
        /// Stage run and node of each.
        nodes: Vec<(usize, usize)>,
        /// Their names.
        name: String,
    },
}

/// The K-th of N blocks of equal size: `K/N`, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Fraction {
    number: usize,
    count: usize,
}

/// The most shards of a run.
const MOST_SHARDS: usize = 100_000;

impl Fraction {
    /// The K-th of N blocks; `None` unless `1 <= number <= count <= 100000`.
    #[must_use]
    pub fn new(number: usize, count: usize) -> Option<Self> {
        ((1..=count).contains(&number) && count <= MOST_SHARDS).then_some(Self { number, count })
    }

    /// K, from 1.
    #[must_use]
    pub const fn number(self) -> usize {
        self.number
    }

    /// N.
    #[must_use]
    pub const fn count(self) -> usize {
        self.count
    }

    /// Its block of `length` things. Blocks begin at multiples of `step`.
    fn block(self, length: usize, step: usize) -> Range<usize> {
        let units = length.div_ceil(step);
        // No product of two large numbers: both are limited.
        let at = |number: usize| (units * number / self.count * step).min(length);
        at(self.number - 1)..at(self.number)
    }
}

impl std::str::FromStr for Fraction {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        numbers
            .and_then(|(number, count)| Self::new(number, count))
            .ok_or_else(|| format!("expected K/N with 1 <= K <= N <= {MOST_SHARDS}, e.g. 1/4"))
    }
}

impl std::fmt::Display for Fraction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

impl TryFrom<String> for Fraction {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Fraction> for String {
    fn from(fraction: Fraction) -> Self {
        fraction.to_string()
    }
}

impl Shard {
    /// The name of its folder, without the step of a submission: `frames-1-of-4`.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Frames { part, .. } => format!("frames-{}-of-{}", part.number, part.count),
            Self::Variants { part } => format!("variants-{}-of-{}", part.number, part.count),
            Self::Nodes { name, .. } => name.clone(),
        }
    }

    /// In words: `shard 1/4 of the frames`.
    #[must_use]
    pub fn text(&self) -> String {
        match self {
            Self::Frames { part, .. } => format!("shard {part} of the frames"),
            Self::Variants { part } => format!("shard {part} of the variants"),
            Self::Nodes { name, .. } => name.clone(),
        }
    }

    /// Whether the shard in another folder, by its name, is of the same split into blocks of frames.
    #[must_use]
    pub fn shares_no_frame(&self, other: &Path) -> bool {
        let Self::Frames { part, .. } = self else { return false };
        let name = other.file_name().and_then(std::ffi::OsStr::to_str).unwrap_or_default();
        let name = name.rsplit_once("frames-").map(|(_, block)| block.strip_suffix(".partial").unwrap_or(block));
        let other = name.and_then(|block| block.replacen("-of-", "/", 1).parse::<Fraction>().ok());
        other.is_some_and(|other| other.count == part.count && other.number != part.number)
    }

    /// Whether its recording has frames, and not only aggregate values.
    #[must_use]
    pub const fn records_frames(&self) -> bool {
        !matches!(self, Self::Nodes { .. })
    }

    /// What it computes of a plan whose stage runs have these numbers of frames. `aggregates` are the keys of aggregate
    /// values that other processes have computed.
    #[must_use]
    pub fn share(&self, plan: &Plan, frames: &[usize], aggregates: BTreeMap<NodeRef, Key>) -> Share {
        let step = usize::try_from(plan.record.every.max(1)).unwrap_or(usize::MAX);
        let nodes = self.nodes(plan, &aggregates);
        let stage = |run: RunId| {
            let all = frames.get(run.0).copied().unwrap_or_default();
            let own: BTreeSet<NodeId> = nodes.iter().filter(|node| node.run == run).map(|node| node.node).collect();
            let runs_on_frames = own.iter().any(|node| plan.runs[run].nodes[*node].contract != Contract::Once);
            let frames = match self {
                _ if !runs_on_frames => 0..0,
                Self::Frames { part, .. } => part.block(all, step),
                Self::Variants { .. } | Self::Nodes { .. } => 0..all,
            };
            StageShare { frames, nodes: own }
        };
        Share { runs: RunId::all(plan.runs.len()).map(stage).collect(), aggregates }
    }

    fn nodes(&self, plan: &Plan, aggregates: &BTreeMap<NodeRef, Key>) -> BTreeSet<NodeRef> {
        match self {
            Self::Frames { runs, .. } => {
                let is_wanted = |node: &NodeRef| runs.is_empty() || runs.contains(&node.run.0);
                let is_pure = |node: &NodeRef| node_of(plan, *node).contract == Contract::Pure;
                all_nodes(plan).filter(|node| is_wanted(node) && is_pure(node)).collect()
            }
            Self::Variants { part } => {
                let own: BTreeSet<VariantId> = part.block(plan.variants.len(), 1).map(VariantId).collect();
                let is_own = |node: &NodeRef| node_of(plan, *node).variants.iter().any(|variant| own.contains(variant));
                all_nodes(plan).filter(is_own).collect()
            }
            Self::Nodes { nodes, .. } => {
                let mut found = BTreeSet::new();
                let mut open: Vec<NodeRef> =
                    nodes.iter().map(|(run, node)| NodeRef { run: RunId(*run), node: NodeId(*node) }).collect();
                while let Some(node) = open.pop() {
                    if found.insert(node) {
                        open.extend(inputs(plan, node).filter(|input| !aggregates.contains_key(input)));
                    }
                }
                found
            }
        }
    }
}

/// Where the frames of a share begin, for its recording.
#[must_use]
pub fn windows(share: &Share) -> Vec<RecordedWindow> {
    let stages = RunId::enumerate(&share.runs).filter(|(_, stage)| !stage.frames.is_empty());
    stages.map(|(run, stage)| RecordedWindow { run, first: FrameIndex(stage.frames.start) }).collect()
}

pub(crate) fn all_nodes(plan: &Plan) -> impl Iterator<Item = NodeRef> + '_ {
    RunId::enumerate(&plan.runs)
        .flat_map(|(run, stage)| NodeId::all(stage.nodes.len()).map(move |node| NodeRef { run, node }))
}

pub(crate) fn node_of(plan: &Plan, node: NodeRef) -> &depthloom_graphs::plan::PlannedNode {
    &plan.runs[node.run].nodes[node.node]
}

/// The nodes whose values a node reads.
pub(crate) fn inputs(plan: &Plan, node: NodeRef) -> impl Iterator<Item = NodeRef> + '_ {
    node_of(plan, node).inputs.iter().filter_map(move |input| match &input.from {
        Some(Origin::Here(Slot::Node { node: from, .. })) => Some(NodeRef { run: node.run, node: *from }),
        Some(Origin::Once { run, node, .. }) => Some(NodeRef { run: *run, node: *node }),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{Fraction, Shard};

    #[test]
    fn blocks_cover_everything_once_and_begin_at_multiples() {
        for (length, count, step) in [(10, 3, 1), (3, 5, 1), (100, 7, 10), (0, 2, 1), (42_000, 64, 5)] {
            let blocks: Vec<_> = (1..=count).map(|k| Fraction::new(k, count).unwrap().block(length, step)).collect();
            assert_eq!(blocks.iter().flat_map(Clone::clone).collect::<Vec<_>>(), (0..length).collect::<Vec<_>>());
            assert!(blocks.iter().all(|block| block.start.is_multiple_of(step) || block.is_empty()), "{blocks:?}");
            let sizes: Vec<usize> = blocks.iter().map(|block| block.len().div_ceil(step)).collect();
            assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1, "{sizes:?}");
        }
    }

    #[test]
    fn shards_of_one_split_share_no_frame() {
        let part = Fraction::new(2, 4).unwrap();
        let shard = Shard::Frames { part, runs: Vec::new() };
        for name in ["frames-1-of-4", "3-frames-4-of-4.partial"] {
            assert!(shard.shares_no_frame(Path::new(name)), "{name}");
        }
        for name in ["frames-2-of-4", "frames-1-of-3", "2-learn.train", "variants-1-of-4", "frames-x-of-4"] {
            assert!(!shard.shares_no_frame(Path::new(name)), "{name}");
        }
        assert!(!Shard::Variants { part }.shares_no_frame(Path::new("variants-1-of-4")));
    }

    #[test]
    fn fractions_are_written_as_two_numbers() {
        assert_eq!("2/4".parse(), Ok(Fraction::new(2, 4).unwrap()));
        for text in ["0/4", "5/4", "1", "1/0", "-1/2", "1/100001", "a/b"] {
            assert!(text.parse::<Fraction>().is_err(), "{text}");
        }
    }
}
