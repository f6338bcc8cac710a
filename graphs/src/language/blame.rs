//! Moves errors caused by an argument of `--set` or `--matrix` to the argument.
//!
//! A new kind or size is valid itself, but other nodes may not fit. The experiment is checked again without each
//! argument: an error that disappears is due to it.

use std::collections::HashSet;
use std::sync::Arc;

use super::change::overrides::{Argument, is_argument};
use super::text::diagnostics::{Diagnostic, Diagnostics, Identity, Severity};
use super::text::source_file::Place;

const MOST: usize = 32;

/// An error that disappears without an argument is moved to that argument. `without` reports what is wrong without
/// the argument at an index.
pub(crate) fn pointed(
    mut found: Diagnostics,
    arguments: &[Argument],
    without: impl Fn(usize) -> Diagnostics,
) -> Diagnostics {
    if arguments.len() > MOST {
        return found;
    }
    let before = errors(&found);
    for (index, argument) in arguments.iter().enumerate().rev() {
        if !found.iter().any(shows_elsewhere) {
            break;
        }
        let rest = errors(&without(index));
        // Without an argument that the experiment needs there are other errors: it is not the cause.
        if !rest.is_subset(&before) {
            continue;
        }
        let argument = Place::whole(&Arc::new(argument.file()));
        for diagnostic in found.0.iter_mut().filter(|d| shows_elsewhere(d) && !rest.contains(&d.identity())) {
            let shown = std::mem::replace(&mut diagnostic.place, argument.clone());
            let label = match std::mem::replace(&mut diagnostic.label, "leads to this".to_owned()) {
                label if label == Diagnostic::UNLABELLED => "shows here".to_owned(),
                label => label,
            };
            *diagnostic = diagnostic.clone().related(&shown, label);
        }
    }
    found
}

fn errors(diagnostics: &Diagnostics) -> HashSet<Identity> {
    diagnostics.iter().filter(|d| d.severity == Severity::Error).map(Diagnostic::identity).collect()
}

fn shows_elsewhere(diagnostic: &Diagnostic) -> bool {
    diagnostic.severity == Severity::Error && !is_argument(&diagnostic.place.file)
}
