//! The steps of a submission: jobs that can run at the same time, after those of the step before.

use std::collections::{BTreeMap, BTreeSet};

use depthloom_graphs::Rate;
use depthloom_graphs::contracts::Contract;
use depthloom_graphs::plan::{NodeRef, Plan, RunId};
use depthloom_runs::file_name;
use serde::{Deserialize, Serialize};

use crate::shard::{Fraction, Shard, all_nodes, inputs, node_of};

/// Jobs that can run at the same time, after those of the step before.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Step {
    /// Its name: `frames`, `variants`, `training`, `run`.
    pub name: String,
    /// One for each job; empty in the last step, whose only job is the run that reuses all shards.
    pub shards: Vec<Shard>,
}

/// The most characters of a variant in the name of a job.
const MOST_CHARACTERS: usize = 60;

/// What the work is split by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// This number of blocks of frames.
    Frames(usize),
    /// This number of blocks of variants.
    Variants(usize),
}

impl Step {
    /// The number of its jobs.
    #[must_use]
    pub fn jobs(&self) -> usize {
        self.shards.len().max(1)
    }

    /// Whether it is the run that reuses all shards.
    #[must_use]
    pub fn is_run(&self) -> bool {
        self.shards.is_empty()
    }
}

/// The steps in which a plan is computed: frames as far as they do not need an aggregate value, the aggregate values
/// that the next frames need (one job for each network), these frames, and so on; the run is the last step.
#[must_use]
pub fn steps(plan: &Plan, split: Split) -> Vec<Step> {
    let levels = Levels::new(plan);
    let mut steps = Vec::new();
    match split {
        Split::Frames(count) => {
            for level in 0..=levels.highest() {
                let runs: Vec<usize> = levels.runs_at(plan, level).map(|run| run.0).collect();
                if !runs.is_empty() {
                    let shard = |part| Shard::Frames { part, runs: runs.clone() };
                    steps.push(Step { name: "frames".to_owned(), shards: parts(count).map(shard).collect() });
                }
                let targets = levels.targets(plan, level);
                add_aggregates(plan, &levels, &targets, &mut steps);
            }
        }
        Split::Variants(count) => {
            // What several shards need is computed once, before them.
            let is_shared = |node: &NodeRef| shares_of(plan, *node, count) > 1;
            for level in 0..=levels.highest() {
                let targets: BTreeSet<NodeRef> = levels.targets(plan, level).into_iter().filter(is_shared).collect();
                add_aggregates(plan, &levels, &targets, &mut steps);
            }
            let shard = |part| Shard::Variants { part };
            steps.push(Step { name: "variants".to_owned(), shards: parts(count).map(shard).collect() });
        }
    }
    steps.push(Step { name: "run".to_owned(), shards: Vec::new() });
    steps
}

fn parts(count: usize) -> impl Iterator<Item = Fraction> {
    (1..=count).filter_map(move |number| Fraction::new(number, count))
}

/// How many of `count` shards of variants compute a node.
fn shares_of(plan: &Plan, node: NodeRef, count: usize) -> usize {
    let variants = &node_of(plan, node).variants;
    let (all, mut last, mut shares) = (plan.variants.len(), None, 0);
    for variant in variants {
        // The inverse of the blocks of `Fraction`: the first block that ends after the variant.
        let block = (0..count).find(|block| all * (block + 1) / count > variant.0);
        if block != last {
            shares += 1;
            last = block;
        }
    }
    shares
}

/// Adds one job for each target. Targets and other aggregate values that several of them need come in a step before.
fn add_aggregates(plan: &Plan, levels: &Levels, targets: &BTreeSet<NodeRef>, steps: &mut Vec<Step>) {
    let mut needed: BTreeMap<NodeRef, usize> = BTreeMap::new();
    for target in targets {
        for before in levels.aggregates_before(plan, *target) {
            *needed.entry(before).or_default() += 1;
        }
    }
    let is_early = |node: &NodeRef, count: usize| count > 1 || targets.contains(node);
    let early: BTreeSet<NodeRef> =
        needed.iter().filter(|(node, count)| is_early(node, **count)).map(|(node, _)| *node).collect();
    let late: BTreeSet<NodeRef> = targets.difference(&early).copied().collect();
    // One that another early one needs is computed with it.
    let before: BTreeSet<NodeRef> = early.iter().flat_map(|node| levels.aggregates_before(plan, *node)).collect();
    for nodes in [early.difference(&before).copied().collect(), late] {
        let shards = aggregate_shards(plan, &nodes);
        if !shards.is_empty() {
            let is_training = |node: &NodeRef| {
                let planned = node_of(plan, *node);
                planned.contract == Contract::Once && planned.kind.starts_with("learn/")
            };
            let is_training = nodes.iter().any(is_training);
            let name = if is_training { "training" } else { "aggregates" };
            steps.push(Step { name: name.to_owned(), shards });
        }
    }
}

fn aggregate_shards(plan: &Plan, nodes: &BTreeSet<NodeRef>) -> Vec<Shard> {
    let plain = |node: NodeRef| format!("{}.{}", plan.runs[node.run].stage, node_of(plan, node).name);
    let mut names = BTreeMap::<String, usize>::new();
    nodes.iter().for_each(|node| *names.entry(plain(*node)).or_default() += 1);
    let name = |node: NodeRef| {
        let name = plain(node);
        if names[&name] == 1 {
            return name;
        }
        let variants = node_of(plan, node).variant_names(plan);
        let [variant] = variants.as_slice() else { return format!("{name}-{}-{}", node.run, node.node) };
        let variant: String = variant.chars().take(MOST_CHARACTERS).collect();
        // Two variants may have one name here.
        format!("{name}-{}-{}", node.node, file_name(&variant))
    };
    let shard = |node: &NodeRef| Shard::Nodes { nodes: vec![(node.run.0, node.node.0)], name: name(*node) };
    nodes.iter().map(shard).collect()
}

/// In which order the stage runs and aggregate values of a plan can be computed: level 0 first.
struct Levels {
    runs: Vec<usize>,
    /// Of nodes with aggregate values.
    nodes: BTreeMap<NodeRef, usize>,
}

impl Levels {
    fn new(plan: &Plan) -> Self {
        let mut levels = Self { runs: vec![0; plan.runs.len()], nodes: BTreeMap::new() };
        // Every pass settles at least the first ones that wait for settled ones.
        loop {
            let before = (levels.runs.clone(), levels.nodes.clone());
            for run in RunId::all(plan.runs.len()) {
                levels.runs[run] = frame_nodes(plan, run)
                    .flat_map(|node| inputs(plan, node))
                    .filter(|from| has_aggregates(plan, *from) && is_read_before_frames(plan, *from, run))
                    .map(|from| levels.nodes.get(&from).map_or(0, |level| level + 1))
                    .max()
                    .unwrap_or(0);
            }
            for node in all_nodes(plan).filter(|node| has_aggregates(plan, *node)) {
                let level = match node_of(plan, node).contract {
                    Contract::Once => {
                        let from = inputs(plan, node).filter_map(|from| levels.nodes.get(&from));
                        from.max().copied().unwrap_or(0)
                    }
                    Contract::Ordered | Contract::Pure => levels.runs[node.run],
                };
                levels.nodes.insert(node, level);
            }
            if before == (levels.runs.clone(), levels.nodes.clone()) {
                return levels;
            }
        }
    }

    fn highest(&self) -> usize {
        self.runs.iter().chain(self.nodes.values()).max().copied().unwrap_or(0)
    }

    /// The stage runs of a level that have pure nodes.
    fn runs_at<'p>(&'p self, plan: &'p Plan, level: usize) -> impl Iterator<Item = RunId> + 'p {
        let has_pure = |run: &RunId| plan.runs[*run].nodes.iter().any(|node| node.contract == Contract::Pure);
        RunId::all(plan.runs.len()).filter(move |run| self.runs[*run] == level).filter(has_pure)
    }

    /// The nodes of a level with a job of their own: frames of a later level read their values, or no other aggregate
    /// node does. The last run computes the others.
    fn targets(&self, plan: &Plan, level: usize) -> BTreeSet<NodeRef> {
        let (mut read_by_frames, mut read_by_aggregates) = (BTreeSet::new(), BTreeSet::new());
        for node in all_nodes(plan) {
            let is_once = node_of(plan, node).contract == Contract::Once;
            let aggregates = inputs(plan, node).filter(|from| has_aggregates(plan, *from));
            if is_once {
                read_by_aggregates.extend(aggregates);
            } else {
                read_by_frames.extend(aggregates.filter(|from| is_read_before_frames(plan, *from, node.run)));
            }
        }
        let is_target = |node: &NodeRef| {
            let is_end = node_of(plan, *node).contract == Contract::Once && !read_by_aggregates.contains(node);
            read_by_frames.contains(node) || is_end
        };
        let of_level = self.nodes.iter().filter(|(_, at)| **at == level).map(|(node, _)| *node);
        of_level.filter(is_target).collect()
    }

    /// The nodes of the same level whose aggregate values a node needs.
    fn aggregates_before(&self, plan: &Plan, node: NodeRef) -> BTreeSet<NodeRef> {
        let (mut found, mut open) = (BTreeSet::new(), vec![node]);
        while let Some(next) = open.pop() {
            if node_of(plan, next).contract != Contract::Once {
                continue;
            }
            let from = inputs(plan, next).filter(|from| self.nodes.get(from) == self.nodes.get(&node));
            open.extend(from.filter(|from| found.insert(*from)));
        }
        found
    }
}

fn has_aggregates(plan: &Plan, node: NodeRef) -> bool {
    let planned = node_of(plan, node);
    planned.contract == Contract::Once || planned.outputs.iter().any(|output| output.port.rate == Rate::Once)
}

/// Whether a node's aggregate values are there before the frames of a stage run: not those that its own ordered nodes
/// compute from its frames, whose per-frame values its nodes read.
fn is_read_before_frames(plan: &Plan, from: NodeRef, run: RunId) -> bool {
    from.run != run || node_of(plan, from).contract == Contract::Once
}

fn frame_nodes(plan: &Plan, run: RunId) -> impl Iterator<Item = NodeRef> + '_ {
    all_nodes(plan).filter(move |node| node.run == run && node_of(plan, *node).contract != Contract::Once)
}

#[cfg(test)]
mod tests {
    use super::{Split, Step, steps};
    use depthloom_graphs::plan::Plan;

    fn names(steps: &[Step]) -> Vec<(&str, usize)> {
        steps.iter().map(|step| (step.name.as_str(), step.jobs())).collect()
    }

    #[test]
    fn an_empty_plan_has_only_the_run() {
        let plan = Plan {
            experiment: "empty".to_owned(),
            description: String::new(),
            variants: Vec::new(),
            factors: Vec::new(),
            labels: depthloom_graphs::plan::Labels::default(),
            runs: Vec::new(),
            record: depthloom_graphs::plan::Record { every: 1, view: false, points: Vec::new() },
            written: Vec::new(),
            resolved: String::new(),
        };
        assert_eq!(names(&steps(&plan, Split::Frames(4))), [("run", 1)]);
    }
}
