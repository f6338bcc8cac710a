//! Plans as Mermaid flowcharts, which GitHub and many editors draw.

use std::fmt::Write as _;

use super::diagram::{self, Shape};
use crate::contracts::Contract;
use crate::plan::Plan;

impl Plan {
    /// The plan as a Mermaid flowchart, with dotted arrows for aggregate values.
    pub fn mermaid(&self) -> String {
        let diagram = diagram::from_plan(self);
        let mut text = String::from("flowchart LR\n");
        for group in &diagram.groups {
            let _ = writeln!(text, "  subgraph {}[\"{}\"]", group.id, escaped(&group.title));
            for node in &group.boxes {
                let _ = writeln!(text, "    {}", shown(node));
            }
            text.push_str("  end\n");
        }
        for file in &diagram.files {
            let _ = writeln!(text, "  {}", shown(file));
        }
        for arrow in diagram.arrows() {
            let line = if arrow.once { "-.->" } else { "-->" };
            let _ = writeln!(text, "  {} {line}|{}| {}", arrow.from, arrow.ports.join(", "), arrow.to);
        }
        text
    }
}

fn shown(node: &diagram::Box) -> String {
    let (open, close) = match node.shape {
        Shape::Source => ("([", "])"),
        Shape::File => ("[/", "/]"),
        Shape::Node(Contract::Pure) => ("[", "]"),
        Shape::Node(Contract::Ordered) => ("[[", "]]"),
        Shape::Node(Contract::Once) => ("{{", "}}"),
    };
    let lines: Vec<String> = node.lines.iter().map(|line| escaped(line)).collect();
    format!("{}{open}\"{}\"{close}", node.id, lines.join("<br/>"))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;").replace('>', "&gt;")
}
