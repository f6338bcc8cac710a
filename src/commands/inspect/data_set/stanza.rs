//! The sources as YAML, to paste into an experiment.

use std::fmt::Write as _;

use serde_json::Value as Json;

use super::RecognisedSource;

/// What to paste into an experiment: the sources of which frames can be read; what else they may have, as comments.
/// `None` if there is no such.
pub(super) fn stanza(known: &[RecognisedSource<'_>]) -> Option<String> {
    let mut text = "sources:\n".to_owned();
    for one in known {
        if one.seen.frames == 0 {
            let _ = writeln!(text, "  # {} is left out: none of its frames can be read", one.name);
            continue;
        }
        let _ = writeln!(text, "  {}:\n    kind: {}\n    with:", one.name, one.entry.declaration.kind);
        for (key, value) in one.params.as_object().into_iter().flatten() {
            let _ = writeln!(text, "      {key}: {}", written(value));
        }
        for line in &one.alternatives {
            let _ = writeln!(text, "      # {line}");
        }
    }
    known.iter().any(|one| one.seen.frames > 0).then_some(text)
}

/// A value as YAML has it: JSON is YAML, but that words stand without quotes.
fn written(value: &Json) -> String {
    match value {
        Json::String(word)
            if word.starts_with(|c: char| c.is_ascii_alphabetic())
                && word.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')
                && !matches!(word.as_str(), "true" | "false" | "null" | "yes" | "no" | "on" | "off" | "y" | "n") =>
        {
            word.clone()
        }
        Json::Object(map) => {
            let parts: Vec<String> = map.iter().map(|(key, value)| format!("{key}: {}", written(value))).collect();
            format!("{{ {} }}", parts.join(", "))
        }
        Json::Array(items) => format!("[{}]", items.iter().map(written).collect::<Vec<_>>().join(", ")),
        // `${` would be a variable.
        other => other.to_string().replace("${", "$${"),
    }
}
