//! One parameter or one port in Markdown, for editors.

use serde_json::Value as Json;

use super::reference::{is_mandatory, meaning, plain, range_of, type_text};
use crate::contracts::{Port, Rate};
use crate::language::is_operational;

/// Type, range, default and meaning of a parameter.
pub fn parameter_details(schema: &Json) -> String {
    let mut facts = vec![type_text(schema)];
    facts.extend(range_of(schema));
    match schema.get("default") {
        _ if is_mandatory(schema) => facts.push("required".to_owned()),
        Some(Json::Null) | None => {}
        Some(Json::String(text)) if text.is_empty() => {}
        Some(default) => facts.push(format!("default `{}`", plain(default))),
    }
    let mut text = facts.join(", ");
    let meaning = meaning(schema);
    if !meaning.is_empty() {
        text = format!("{text}\n\n{meaning}");
    }
    if is_operational(schema) {
        text.push_str("\n\nIt does not change results.");
    }
    text
}

/// Type, rate and meaning of a port.
pub fn port_details(port: &Port) -> String {
    let rate = match port.rate {
        Rate::Frame => "each frame",
        Rate::Once => "once a stage",
    };
    let optional = if port.optional { ", optional" } else { "" };
    format!("{}, {rate}{optional}\n\n{}", port.value_type, port.doc)
}
