//! What is wrong with an experiment, and where.

use std::collections::HashSet;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::source_file::{Place, SourceFile};

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Severity {
    /// The experiment cannot be run.
    Error,
    /// It can, but probably does not say what was meant.
    Warning,
}

/// Equal diagnostics are reported once.
pub(crate) type Identity = (Severity, String, Range<usize>, String);

/// Another place that belongs to a diagnostic.
#[derive(Clone, Debug)]
pub struct Related {
    /// Where it is.
    pub place: Place,
    /// What is there.
    pub label: String,
}

/// One thing that is wrong.
#[derive(Clone, Debug)]
pub struct Diagnostic {
    /// How bad it is.
    pub severity: Severity,
    /// The words at fault.
    pub place: Place,
    /// What to show at those words.
    pub label: String,
    /// What is wrong: a lower-case fragment.
    pub message: String,
    /// What to do about it.
    pub help: Option<String>,
    /// Another place that belongs to it.
    pub related: Option<Related>,
    /// The keys that lead to the words, joined by dots: `stages.compare.nodes.depth.with.cap`.
    pub key_path: String,
}

impl Diagnostic {
    /// The label of the words at fault if there is no other.
    pub(crate) const UNLABELLED: &'static str = "here";

    /// An error at some words.
    pub fn error(place: &Place, message: impl Into<String>) -> Self {
        Self {
            severity: Severity::Error,
            place: place.clone(),
            label: Self::UNLABELLED.to_owned(),
            message: message.into(),
            help: None,
            related: None,
            key_path: String::new(),
        }
    }

    /// A warning at some words.
    pub fn warning(place: &Place, message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::error(place, message) }
    }

    /// Sets the text at the words at fault.
    #[must_use]
    pub fn label(self, label: impl Into<String>) -> Self {
        Self { label: label.into(), ..self }
    }

    /// Adds the remedy.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }

    /// Adds the remedy, if one is known.
    #[must_use]
    pub fn maybe_help(self, help: Option<String>) -> Self {
        Self { help, ..self }
    }

    /// Points at another place as well.
    #[must_use]
    pub fn related(self, place: &Place, label: impl Into<String>) -> Self {
        Self { related: Some(Related { place: place.clone(), label: label.into() }), ..self }
    }

    pub(crate) fn identity(&self) -> Identity {
        (self.severity, self.place.file.name.clone(), self.place.span.clone(), self.message.clone())
    }
}

/// Place and message, the line with its words underlined, and the help.
impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        writeln!(f, "{}: {severity}: {}", self.place, self.message)?;
        f.write_str(&excerpt(&self.place, &self.label))?;
        if let Some(related) = &self.related {
            writeln!(f, "  {}:", related.place)?;
            f.write_str(&excerpt(&related.place, &related.label))?;
        }
        if !self.key_path.is_empty() {
            writeln!(f, "  key: {}", self.key_path)?;
        }
        if let Some(help) = &self.help {
            writeln!(f, "  help: {help}")?;
        }
        Ok(())
    }
}

const WIDEST: usize = 200;

/// The line in which a span starts, underlined; only a part of a very long line.
fn excerpt(place: &Place, label: &str) -> String {
    let Place { file, span } = place;
    let (number, column) = file.line_column(span.start);
    let start = file.boundary(span.start);
    let line_start = file.text[..start].rfind('\n').map_or(0, |at| at + 1);
    let line = file.text[line_start..].lines().next().unwrap_or_default();
    let end = file.boundary(span.end.min(line_start + line.len()).max(start));
    let mut underlined = file.text[start..end].chars().count().max(1);
    let mut indent = column - 1;
    // Tabs are shown as one column, so that the underline stands under its words.
    let mut shown: String = line.replace('\t', " ");
    if shown.chars().count() > WIDEST {
        let first = indent.saturating_sub(WIDEST / 2);
        shown = shown.chars().skip(first).take(WIDEST).collect();
        indent -= first;
        if first > 0 {
            shown.insert_str(0, "...");
            indent += 3;
        }
        underlined = underlined.min(WIDEST + 3 - indent);
    }
    let gutter = number.to_string().len();
    let (space, line) = (" ".repeat(indent), "^".repeat(underlined));
    format!("  {number} | {shown}\n  {:gutter$} | {space}{line} {label}\n", "")
}

/// Everything that is wrong, in the order of files and lines.
#[derive(Clone, Debug, Default)]
pub struct Diagnostics(pub Vec<Diagnostic>);

impl Diagnostics {
    /// Whether nothing at all is wrong.
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether any of it is an error.
    pub fn has_errors(&self) -> bool {
        self.0.iter().any(|d| d.severity == Severity::Error)
    }

    /// The diagnostics one by one.
    pub fn iter(&self) -> std::slice::Iter<'_, Diagnostic> {
        self.0.iter()
    }
}

impl<'a> IntoIterator for &'a Diagnostics {
    type Item = &'a Diagnostic;
    type IntoIter = std::slice::Iter<'a, Diagnostic>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, diagnostic) in self.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            fmt::Display::fmt(diagnostic, f)?;
        }
        Ok(())
    }
}

impl std::error::Error for Diagnostics {}

/// Collects diagnostics; equal ones once, however many variants they concern.
#[derive(Debug, Default)]
pub(crate) struct Report {
    list: Vec<Diagnostic>,
    seen: HashSet<Identity>,
    /// Places with unknown values, which have been reported.
    unknown: Vec<Place>,
}

const MOST: usize = 100;

impl Report {
    /// Ignores duplicates and diagnostics about unknown values.
    pub(crate) fn push(&mut self, diagnostic: Diagnostic) {
        let is_same = |words: &Place| words.span == diagnostic.place.span && words.is_in(&diagnostic.place.file);
        if self.unknown.iter().any(is_same) {
            return;
        }
        if !self.is_full() && self.seen.insert(diagnostic.identity()) {
            self.list.push(diagnostic);
        }
    }

    /// Reports an unknown value: nothing else is reported about it.
    pub(crate) fn push_unknown(&mut self, diagnostic: Diagnostic, words: &Place) {
        self.push(diagnostic);
        self.unknown.push(words.clone());
    }

    pub(crate) const fn is_full(&self) -> bool {
        self.list.len() >= MOST
    }

    pub(crate) const fn len(&self) -> usize {
        self.list.len()
    }

    pub(crate) fn has_errors(&self) -> bool {
        self.list.iter().any(|d| d.severity == Severity::Error)
    }

    pub(crate) fn since(&mut self, first: usize) -> std::slice::IterMut<'_, Diagnostic> {
        self.list[first..].iter_mut()
    }

    /// Sorted by file (in the order of `files`) and line.
    pub(crate) fn finish(mut self, files: &[Arc<SourceFile>]) -> Diagnostics {
        let rank = |d: &Diagnostic| files.iter().position(|f| d.place.is_in(f)).unwrap_or(files.len());
        self.list.sort_by_key(|d| (rank(d), d.place.span.start, d.place.span.end));
        Diagnostics(self.list)
    }
}
