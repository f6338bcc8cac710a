//! Problems as JSON, for programs. Lines and columns count from 1, columns in characters; an end is the place behind the last one.

use std::ops::Range;

use depthloom_graphs::language::{Diagnostic, Severity, SourceFile};
use serde_json::{Value as Json, json};

use crate::exit::{Problem, Stop, help_of};

/// What a command prints that fails: `{ message, help, exit_code, diagnostics }`.
pub fn error_json(stop: &Stop) -> Json {
    let problem = |problem: &Problem| match problem {
        Problem::Placed(diagnostic) => diagnostic_json(diagnostic),
        Problem::Here(message, help) => {
            json!({ "severity": "error", "message": message, "help": help_of(message, help.as_deref()) })
        }
    };
    json!({
        "message": stop.message,
        "help": help_of(&stop.message, stop.remedy.as_deref()),
        "exit_code": stop.exit as u8,
        "diagnostics": stop.problems.iter().map(problem).collect::<Vec<_>>(),
    })
}

/// Diagnostics in the order of files and lines.
pub fn list_json<'a>(diagnostics: impl IntoIterator<Item = &'a Diagnostic>) -> Json {
    diagnostics.into_iter().map(diagnostic_json).collect()
}

fn diagnostic_json(diagnostic: &Diagnostic) -> Json {
    let mut json = json!({
        "severity": severity(diagnostic.severity),
        "message": diagnostic.message,
        "label": diagnostic.label,
        "help": diagnostic.help,
    });
    add_place(&mut json, &diagnostic.file, &diagnostic.span);
    json["key"] = diagnostic.key_path.as_str().into();
    let related = diagnostic.related.iter().map(|related| {
        let mut json = json!({ "message": related.label });
        add_place(&mut json, &related.file, &related.span);
        json
    });
    json["related"] = related.collect();
    json
}

fn add_place(json: &mut Json, file: &SourceFile, span: &Range<usize>) {
    let (line, column) = file.line_column(span.start);
    let (end_line, end_column) = file.line_column(span.end.max(span.start));
    json["file"] = file.name.as_str().into();
    json["line"] = line.into();
    json["column"] = column.into();
    json["end"] = json!({ "line": end_line, "column": end_column });
}

/// The name of a severity, the same in SARIF.
pub(super) const fn severity(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
    }
}
