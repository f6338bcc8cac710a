//! Plans in Graphviz' DOT.

use std::fmt::Write as _;

use super::diagram::{self, Shape};
use crate::contracts::Contract;
use crate::plan::Plan;

impl Plan {
    /// The plan as a Graphviz digraph, with dashed arrows for aggregate values.
    pub fn dot(&self) -> String {
        let diagram = diagram::from_plan(self);
        let mut text = String::from("digraph plan {\n  rankdir=LR;\n  node [fontname=\"sans-serif\"];\n");
        for group in &diagram.groups {
            let _ = writeln!(text, "  subgraph cluster_{} {{\n    label={};", group.id, quoted(&group.title));
            for node in &group.boxes {
                let _ = writeln!(text, "    {}", shown(node));
            }
            text.push_str("  }\n");
        }
        for file in &diagram.files {
            let _ = writeln!(text, "  {}", shown(file));
        }
        for arrow in diagram.arrows() {
            let style = if arrow.once { ", style=dashed" } else { "" };
            let label = quoted(&arrow.ports.join(", "));
            let _ = writeln!(text, "  {} -> {} [label={label}{style}];", arrow.from, arrow.to);
        }
        text.push_str("}\n");
        text
    }
}

fn shown(node: &diagram::Box) -> String {
    let shape = match node.shape {
        Shape::Source => "cylinder",
        Shape::File => "note",
        Shape::Node(Contract::Pure) => "box",
        Shape::Node(Contract::Ordered) => "component",
        Shape::Node(Contract::Once) => "hexagon",
    };
    format!("{} [label={}, shape={shape}];", node.id, quoted(&node.lines.join("\n")))
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n"))
}
