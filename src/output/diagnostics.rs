//! How problems are shown: miette's underlined source for a file's errors, two lines for everything else; to programs
//! as JSON.

mod json;
mod sarif;

pub(crate) use json::{Diagnostic as DiagnosticJson, Error, Failed};
pub(crate) use sarif::sarif;

use std::io::IsTerminal;
use std::sync::OnceLock;

use depthloom_graphs::ErrorMessage;
use depthloom_graphs::language::{Diagnostic, Severity};
use depthloom_terminal::{CliError, Problem, help_of, on_one_line, same_length, say, tell_styled, visible};
use miette::{GraphicalReportHandler, GraphicalTheme, LabeledSpan, MietteDiagnostic, NamedSource};

use crate::args::Colour;

/// A line this long would bury the message.
const LONG_LINE: usize = 300;

static COLOUR: OnceLock<bool> = OnceLock::new();

pub(crate) fn set_colour(colour: Colour) {
    let coloured = match colour {
        Colour::Always => true,
        Colour::Never => false,
        Colour::Auto => std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty()),
    };
    let _ = COLOUR.set(coloured);
}

fn handler() -> GraphicalReportHandler {
    let coloured = *COLOUR.get_or_init(|| false);
    let theme = if coloured { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
    let width = if std::io::stderr().is_terminal() { 100 } else { 120 };
    GraphicalReportHandler::new_themed(theme)
        .with_width(width)
        .with_links(false)
        // Between words alone: a kind's name (`disparity/left-right`) has hyphens and slashes, and is copied as a
        // whole.
        .with_word_separator(textwrap::WordSeparator::AsciiSpace)
        .with_word_splitter(textwrap::WordSplitter::NoHyphenation)
}

/// Prints diagnostics to standard error, and how many errors there were.
pub(crate) fn print<'a>(diagnostics: impl IntoIterator<Item = &'a Diagnostic>) {
    let mut errors = 0;
    for (index, diagnostic) in diagnostics.into_iter().enumerate() {
        if index > 0 {
            say("");
        }
        tell_styled(render(diagnostic));
        errors += usize::from(diagnostic.severity == Severity::Error);
    }
    if errors > 1 {
        say(format_args!("{errors} errors"));
    }
}

fn render(diagnostic: &Diagnostic) -> String {
    let place = &diagnostic.place;
    let line = place.file.text.lines().nth(place.line_column().0 - 1).unwrap_or_default();
    if line.len() > LONG_LINE {
        // The plain form shows only the part of the line that matters.
        return visible(&diagnostic.to_string()).into_owned();
    }
    let severity = match diagnostic.severity {
        Severity::Error => miette::Severity::Error,
        Severity::Warning => miette::Severity::Warning,
    };
    let span = place.span.start..place.span.end.max(place.span.start);
    let mut shown = MietteDiagnostic::new(visible(&diagnostic.message))
        .with_severity(severity)
        .with_label(LabeledSpan::new_with_span(Some(visible(&diagnostic.label).into_owned()), span));
    let (here, elsewhere): (Vec<_>, Vec<_>) =
        diagnostic.related.iter().partition(|related| related.place.file.name == place.file.name);
    for related in here {
        let label = visible(&related.label).into_owned();
        shown = shown.and_label(LabeledSpan::new_with_span(Some(label), related.place.span.clone()));
    }
    let mut help: Vec<String> = diagnostic.help.iter().cloned().collect();
    help.extend(elsewhere.iter().map(|related| format!("{}: {}", related.place, related.label)));
    if !help.is_empty() {
        shown = shown.with_help(visible(&help.join("\n")));
    }
    let name = on_one_line(&place.file.name);
    let source = NamedSource::new(&name, same_length(&place.file.text).into_owned());
    let report = miette::Report::new(shown).with_source_code(source);
    let mut text = String::new();
    if handler().render_report(&mut text, report.as_ref()).is_err() {
        // The place alone is better than nothing: rendering only fails on spans outside the file.
        let (line, column) = place.line_column();
        text = format!("{name}:{line}:{column}: {}\n", visible(&diagnostic.message));
    }
    text
}

/// Prints a warning to standard error.
pub(crate) fn print_warning(message: &str) {
    let (yellow, plain) = if *COLOUR.get_or_init(|| false) { ("\x1b[33m", "\x1b[0m") } else { ("", "") };
    tell_styled(format!("{yellow}warning{plain}: {}\n", visible_lines(message)));
}

/// Prints an error and its remedy to standard error; one that counts problems, as these.
pub(crate) fn print_stop(stop: &CliError) {
    if stop.problems.is_empty() {
        return print_error(&stop.message);
    }
    print(placed(stop));
    for problem in &stop.problems {
        if let Problem::Here(message) = problem {
            print_error(message);
        }
    }
}

/// The problems of an error that are in the experiment.
pub(crate) fn placed(stop: &CliError) -> impl Iterator<Item = &Diagnostic> {
    stop.problems.iter().filter_map(|problem| match problem {
        Problem::Placed(diagnostic) => Some(diagnostic),
        Problem::Here(_) => None,
    })
}

fn print_error(message: &ErrorMessage) {
    let (red, cyan, plain) =
        if *COLOUR.get_or_init(|| false) { ("\x1b[31m", "\x1b[36m", "\x1b[0m") } else { ("", "", "") };
    tell_styled(format!("{red}error{plain}: {}\n", visible_lines(&message.what)));
    if let Some(help) = help_of(message) {
        tell_styled(format!("  {cyan}help{plain}: {}\n", visible_lines(&help)));
    }
}

/// A message of several lines in which none begins as a message of its own.
fn visible_lines(message: &str) -> String {
    let mut lines = visible(message).lines().map(str::to_owned).collect::<Vec<_>>();
    for line in lines.iter_mut().skip(1).filter(|line| !line.starts_with(' ')) {
        line.insert_str(0, "  ");
    }
    lines.join("\n")
}
