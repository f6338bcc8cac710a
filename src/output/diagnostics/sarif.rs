//! Diagnostics as SARIF 2.1.0 (<https://docs.oasis-open.org/sarif/sarif/v2.1.0/sarif-v2.1.0.html>), which code review
//! tools show at their lines.

use std::fmt::Write as _;
use std::path::{Component, Path};

use depthloom_graphs::language::{Diagnostic, Place, Severity, SourceFile};
use serde_json::{Value as Json, json};

const SCHEMA: &str = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json";

/// The rules: one for each severity, because the message of a diagnostic has the details.
const RULES: [(Severity, &str, &str); 2] = [
    (Severity::Error, "experiment-error", "The experiment cannot be run."),
    (Severity::Warning, "experiment-warning", "The experiment can be run, but probably does not do what was intended."),
];

/// A log of one run of `depthloom check` on `experiment`.
///
/// Files are named as on the command line, relative to the working directory. Run it in the root of a repository, where
/// code review tools look for them.
pub(crate) fn sarif<'a>(experiment: &Path, diagnostics: impl IntoIterator<Item = &'a Diagnostic>) -> Json {
    let rules = RULES.map(|(level, id, about)| {
        json!({
            "id": id,
            "shortDescription": { "text": about },
            "defaultConfiguration": { "level": level_of(level) },
        })
    });
    let results: Vec<Json> = diagnostics.into_iter().map(|diagnostic| result(experiment, diagnostic)).collect();
    json!({
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [{
            "tool": { "driver": {
                "name": "depthloom",
                "version": env!("CARGO_PKG_VERSION"),
                "informationUri": env!("CARGO_PKG_REPOSITORY"),
                "rules": rules,
            } },
            "columnKind": "unicodeCodePoints",
            "results": results,
        }],
    })
}

fn result(experiment: &Path, diagnostic: &Diagnostic) -> Json {
    let index = RULES.iter().position(|(severity, ..)| *severity == diagnostic.severity).unwrap_or_default();
    let mut text = diagnostic.message.clone();
    let mut location = location(experiment, &diagnostic.place);
    let file = &diagnostic.place.file;
    if is_argument(file) {
        let _ = write!(text, " (`{} {}`)", file.name, file.text);
    }
    if let Some(help) = &diagnostic.help {
        let _ = write!(text, "\nhelp: {help}");
    }
    if !diagnostic.key_path.is_empty() {
        location["logicalLocations"] = json!([{ "fullyQualifiedName": diagnostic.key_path }]);
    }
    let mut result = json!({
        "ruleId": RULES[index].1,
        "ruleIndex": index,
        "level": level_of(diagnostic.severity),
        "message": { "text": text },
        "locations": [location],
    });
    if let Some(related) = &diagnostic.related {
        let mut location = self::location(experiment, &related.place);
        location["message"] = json!({ "text": related.label });
        result["relatedLocations"] = json!([location]);
    }
    result
}

/// Whether it is a piece of the command line (`--set`), not a file.
fn is_argument(file: &SourceFile) -> bool {
    file.name.starts_with("--")
}

/// A region of a file. A place on the command line belongs to the experiment as a whole.
fn location(experiment: &Path, place: &Place) -> Json {
    if is_argument(&place.file) {
        return json!({ "physicalLocation": { "artifactLocation": { "uri": uri(experiment) } } });
    }
    let ((line, column), (end_line, end_column)) = (place.line_column(), place.end());
    json!({ "physicalLocation": {
        "artifactLocation": { "uri": uri(Path::new(&place.file.name)) },
        "region": { "startLine": line, "startColumn": column, "endLine": end_line, "endColumn": end_column },
    } })
}

/// A path as a URI: relative where it stays below the working directory, as SARIF asks (3.4.4), else absolute.
fn uri(path: &Path) -> String {
    let is_below = path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let absolute = if is_below { None } else { std::path::absolute(path).ok() };
    let mut names: Vec<String> = Vec::new();
    for part in absolute.as_deref().unwrap_or(path).components() {
        match part {
            Component::Normal(name) => names.push(escaped(name.as_encoded_bytes())),
            Component::ParentDir => drop(names.pop()),
            Component::Prefix(prefix) => names.push(escaped(prefix.as_os_str().as_encoded_bytes())),
            Component::CurDir | Component::RootDir => {}
        }
    }
    let names = names.join("/");
    if absolute.is_some() { format!("file:///{names}") } else { names }
}

/// Percent-encodes all characters except the unreserved ones of RFC 3986.
fn escaped(name: &[u8]) -> String {
    name.iter().fold(String::new(), |mut text, byte| {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(byte) {
            text.push(char::from(*byte));
        } else {
            let _ = write!(text, "%{byte:02X}");
        }
        text
    })
}

const fn level_of(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_uris() {
        assert_eq!(uri(Path::new("./experiments/a b#ü.yaml")), "experiments/a%20b%23%C3%BC.yaml");
        if cfg!(unix) {
            assert_eq!(uri(Path::new("/data/./runs/../a.yaml")), "file:///data/a.yaml");
            let above = uri(Path::new("../a.yaml"));
            assert!(above.starts_with("file:///") && above.ends_with("/a.yaml") && !above.contains(".."), "{above}");
        }
    }
}
