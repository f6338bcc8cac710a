//! The output of `depthloom plan`.

use std::fmt::Write as _;

use super::diagram::variants;
use crate::contracts::Slot;
use crate::plan::{Origin, Plan, PlannedInput, PlannedNode, StageRun};

impl Plan {
    /// The plan as text: a table of nodes for each stage run, then what is scored.
    pub fn summary_text(&self) -> String {
        let mut text = format!("experiment {}", self.experiment);
        if !self.description.trim().is_empty() {
            let _ = write!(text, ": {}", self.description.trim());
        }
        text.push('\n');
        if self.variants != [""] {
            let _ = writeln!(text, "{} variants: {}", self.variants.len(), self.variants.join(", "));
        }
        for run in &self.runs {
            let kinds: Vec<&str> = run.source.parts.iter().map(|part| part.kind.as_str()).collect();
            let _ = write!(text, "\nstage {} on {} ({})", run.stage, run.source.name, kinds.join(", then "));
            if let Some(variants) = variants(self, &run.variants) {
                let _ = write!(text, ", for {variants}");
            }
            text.push('\n');
            text.push_str(&self.node_table(run));
            text.push_str(&followed(run));
            for estimate in &run.estimates {
                let what = self.slot_text(run, estimate.estimate);
                let truth = self.slot_text(run, estimate.truth);
                let _ = writeln!(text, "  scored: {} = {what} against {truth}", estimate.label);
            }
        }
        text
    }

    fn node_table(&self, run: &StageRun) -> String {
        let mut rows = vec![["node", "kind", "contract", "does", "for", "node hash", "reads"].map(str::to_owned)];
        for node in &run.nodes {
            let reads: Vec<String> = node
                .inputs
                .iter()
                .filter_map(|input| Some(format!("{}={}", input.port.name, self.input_text(run, input)?)))
                .collect();
            rows.push([
                node.name.clone(),
                node.kind.clone(),
                node.contract.name().to_owned(),
                if self.is_shared(node) { "run, shared".to_owned() } else { "run".to_owned() },
                self.served(node),
                node.node_hash.to_string()[..12].to_owned(),
                reads.join(" "),
            ]);
        }
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: [usize; 7] = std::array::from_fn(width);
        let mut text = String::new();
        for row in &rows {
            let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}")).collect();
            let _ = writeln!(text, "  {}", cells.join("  ").trim_end());
        }
        text
    }

    pub(super) fn is_shared(&self, node: &PlannedNode) -> bool {
        node.variants.len() > 1
    }

    fn served(&self, node: &PlannedNode) -> String {
        let all = self.variants.len();
        match variants(self, &node.variants) {
            None if all == 1 => "-".to_owned(),
            None => format!("all {all}"),
            Some(names) => names,
        }
    }

    pub(super) fn slot_text(&self, run: &StageRun, slot: Slot) -> String {
        self.wire_text(run, &Origin::Here(slot))
    }

    pub(super) fn input_text(&self, run: &StageRun, input: &PlannedInput) -> Option<String> {
        Some(match input.from.as_ref()? {
            Origin::File(path) => input.shown_path(path),
            from => self.wire_text(run, from),
        })
    }

    fn wire_text(&self, run: &StageRun, from: &Origin) -> String {
        match from {
            Origin::Here(Slot::Source { port }) => format!("source/{}", run.source.outputs[*port].port.name),
            Origin::Here(Slot::Node { node, port }) => {
                let node = &run.nodes[*node];
                format!("{}/{}", node.name, node.outputs[*port].port.name)
            }
            Origin::Once { run, node, port } => {
                let run = &self.runs[*run];
                let node = &run.nodes[*node];
                format!("{}.{}/{}", run.stage, node.name, node.outputs[*port].port.name)
            }
            Origin::File(path) => path.display().to_string(),
        }
    }
}

/// `auto: p1 = 72, p2 = 288 of stereo`.
fn followed(run: &StageRun) -> String {
    let mut lines: Vec<(String, Vec<&str>)> = Vec::new();
    for node in run.nodes.iter().filter(|node| !node.auto.is_empty()) {
        let values = node.auto.iter().map(|name| format!("{name} = {}", node.params[name.as_str()]));
        let values = values.collect::<Vec<_>>().join(", ");
        match lines.iter_mut().find(|(known, _)| *known == values) {
            Some((_, nodes)) if nodes.contains(&node.name.as_str()) => {}
            Some((_, nodes)) => nodes.push(&node.name),
            None => lines.push((values, vec![&node.name])),
        }
    }
    lines.iter().map(|(values, nodes)| format!("  auto: {values} of {}\n", nodes.join(", "))).collect()
}
