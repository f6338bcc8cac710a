//! Problems as JSON, for programs. Lines and columns count from 1, columns in characters; an end is the place behind
//! the last one.

use depthloom_graphs::language;
use depthloom_terminal::{CliError, Problem, help_of};
use schemars::JsonSchema;
use serde::Serialize;

/// Of a command that ended before it had anything else to print.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Failed {
    error: Error,
}

impl From<&CliError> for Failed {
    fn from(stop: &CliError) -> Self {
        Self { error: Error::from(stop) }
    }
}

/// How a command ended that did not do all it was asked to.
#[derive(JsonSchema, Serialize)]
pub(crate) struct Error {
    /// What went wrong.
    message: String,
    /// What helps.
    help: Option<String>,
    /// The exit code: 1 engine or disk, 2 found before any frame, 3 frames failed or are damaged, 130 interrupted.
    exit_code: u8,
    /// The places.
    diagnostics: Vec<Diagnostic>,
}

impl From<&CliError> for Error {
    fn from(stop: &CliError) -> Self {
        Self {
            message: stop.message.what.clone(),
            help: help_of(&stop.message),
            exit_code: stop.exit as u8,
            diagnostics: stop.problems.iter().map(Diagnostic::from).collect(),
        }
    }
}

/// A problem, and where it is if it is in a file. Lines and columns count from 1, columns in characters.
#[derive(Default, JsonSchema, Serialize)]
pub(crate) struct Diagnostic {
    severity: Severity,
    message: String,
    help: Option<String>,
    /// The label of the place.
    #[serde(skip_serializing_if = "Option::is_none")]
    label: Option<Option<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    column: Option<u64>,
    /// The place behind the last character.
    #[serde(skip_serializing_if = "Option::is_none")]
    end: Option<End>,
    /// The path of keys in the experiment.
    #[serde(skip_serializing_if = "Option::is_none")]
    key: Option<String>,
    /// Other places that have to do with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    related: Option<Vec<Related>>,
}

impl From<&language::Diagnostic> for Diagnostic {
    fn from(of: &language::Diagnostic) -> Self {
        let Place { file, line, column, end } = Place::from(&of.place);
        Self {
            severity: of.severity.into(),
            message: of.message.clone(),
            help: of.help.clone(),
            label: Some(Some(of.label.clone())),
            file: Some(file),
            line: Some(line),
            column: Some(column),
            end: Some(end),
            key: Some(of.key_path.clone()),
            related: Some(of.related.iter().map(Related::from).collect()),
        }
    }
}

impl From<&Problem> for Diagnostic {
    fn from(problem: &Problem) -> Self {
        match problem {
            Problem::Placed(diagnostic) => diagnostic.into(),
            Problem::Here(message) => Self {
                severity: Severity::Error,
                message: message.what.clone(),
                help: help_of(message),
                ..Self::default()
            },
        }
    }
}

/// How bad a problem is.
#[derive(Default, JsonSchema, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Severity {
    #[default]
    Error,
    Warning,
}

impl From<language::Severity> for Severity {
    fn from(severity: language::Severity) -> Self {
        match severity {
            language::Severity::Error => Self::Error,
            language::Severity::Warning => Self::Warning,
        }
    }
}

/// A place.
#[derive(JsonSchema, Serialize)]
pub(super) struct End {
    line: u64,
    column: u64,
}

/// Another place that has to do with a problem.
#[derive(JsonSchema, Serialize)]
pub(super) struct Related {
    message: String,
    file: String,
    line: u64,
    column: u64,
    end: End,
}

impl From<&language::Related> for Related {
    fn from(of: &language::Related) -> Self {
        let Place { file, line, column, end } = Place::from(&of.place);
        Self { message: of.label.clone(), file, line, column, end }
    }
}

/// A span in a file, as lines and columns.
struct Place {
    file: String,
    line: u64,
    column: u64,
    end: End,
}

impl From<&language::Place> for Place {
    fn from(place: &language::Place) -> Self {
        let ((line, column), (end_line, end_column)) = (place.line_column(), place.end());
        Self {
            file: place.file.name.clone(),
            line: line as u64,
            column: column as u64,
            end: End { line: end_line as u64, column: end_column as u64 },
        }
    }
}
