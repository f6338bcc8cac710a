//! Definitions, uses, and renaming of names.

use std::collections::HashMap;
use std::sync::Arc;

use depthloom_graphs::language::{Node, Place, check_name};
use gen_lsp_types::{Location, PrepareRenamePlaceholder, TextEdit, Uri, WorkspaceEdit};

use crate::positions;
use crate::symbols::{self, Occurrence, Symbol};
use crate::view::{View, names};

/// Where the name at an offset is defined.
pub(crate) fn definition(view: &View<'_>, offset: usize) -> Option<Place> {
    let occurrence = symbols::at(view, offset)?;
    view.definition(&occurrence.symbol.keys())
}

/// Every use of the name at an offset in the document's own file.
pub(crate) fn uses(view: &View<'_>, offset: usize) -> Vec<Place> {
    let Some(occurrence) = symbols::at(view, offset) else { return Vec::new() };
    let same = symbols::occurrences(view).into_iter().filter(|other| other.symbol == occurrence.symbol);
    same.map(|occurrence| occurrence.place).collect()
}

/// The location of a place.
pub(crate) fn location(place: &Place, uri: Uri) -> Location {
    Location { uri, range: positions::range(&place.file.text, &place.span) }
}

/// The name that would be renamed.
///
/// # Errors
/// Why it cannot be renamed.
pub(crate) fn prepare_rename(view: &View<'_>, offset: usize) -> Result<PrepareRenamePlaceholder, String> {
    let (symbol, place, _) = renamed(view, offset)?;
    let range = positions::range(view.text, &place.span);
    Ok(PrepareRenamePlaceholder { range, placeholder: symbol.name().to_owned() })
}

/// Renames a stage, node, source, variant or estimate, and all its uses in the document and in other open documents.
///
/// # Errors
/// Why it cannot be renamed.
pub(crate) fn rename(
    view: &View<'_>,
    others: &[View<'_>],
    offset: usize,
    new_name: &str,
) -> Result<WorkspaceEdit, String> {
    let (symbol, _, definition) = renamed(view, offset)?;
    if new_name == symbol.name() {
        return Ok(WorkspaceEdit::default());
    }
    check_name(new_name, symbol.describe())?;
    let mut changes = HashMap::new();
    let own = symbols::occurrences(view).into_iter().filter(|found| found.symbol == symbol);
    changes.insert(view.uri.clone(), edits(view, own, &symbol, new_name)?);
    for other in others {
        // In an experiment that extends this document, or uses it as a graph file.
        let is_same = |found: &Occurrence| {
            found.symbol.describe() == symbol.describe()
                && found.symbol.name() == symbol.name()
                && other.definition(&found.symbol.keys()).is_some_and(|place| is_equal(&place, &definition))
        };
        let uses: Vec<Occurrence> = symbols::occurrences(other).into_iter().filter(is_same).collect();
        if let Some(first) = uses.first() {
            is_free(other, &first.symbol, new_name)?;
            changes.insert(other.uri.clone(), edits(other, uses.into_iter(), &symbol, new_name)?);
        }
    }
    is_free(view, &symbol, new_name)?;
    Ok(WorkspaceEdit { changes: Some(changes), ..WorkspaceEdit::default() })
}

/// The same stretch of the same file, which two documents may have read.
fn is_equal(one: &Place, other: &Place) -> bool {
    one.file.name == other.file.name && one.span == other.span
}

fn is_free(view: &View<'_>, symbol: &Symbol, new_name: &str) -> Result<(), String> {
    let keys = symbol.keys();
    let siblings = keys.split_last().and_then(|(_, above)| {
        let map = above.iter().try_fold(view.root()?, |node, key| node.get(key));
        Some(names(map))
    });
    match siblings.is_some_and(|siblings| siblings.contains(&new_name)) {
        true => {
            let (name, what) = (symbol.name(), symbol.describe());
            Err(format!(
                "cannot rename `{name}` to `{new_name}`: {what} of that name exists in {}",
                view.path.display()
            ))
        }
        false => Ok(()),
    }
}

fn edits(
    view: &View<'_>,
    uses: impl Iterator<Item = Occurrence>,
    symbol: &Symbol,
    new_name: &str,
) -> Result<Vec<TextEdit>, String> {
    let edit = |found: Occurrence| {
        if found.place.text() != symbol.name() {
            let what = "it is not written as plain text there (a variable, an alias or an escape)";
            return Err(format!("cannot rename `{}`, which {} uses: {what}", symbol.name(), found.place));
        }
        Ok(TextEdit { range: positions::range(view.text, &found.place.span), new_text: new_name.to_owned() })
    };
    uses.filter(|found| !found.is_alias).map(edit).collect()
}

/// The name at an offset, if this document defines it.
fn renamed(view: &View<'_>, offset: usize) -> Result<(Symbol, Place, Place), String> {
    if view.document.own().is_none() {
        return Err("cannot rename: the file is not valid YAML; correct it first".to_owned());
    }
    let occurrence = symbols::at(view, offset).ok_or_else(|| {
        "cannot rename this: only stages, nodes, sources, variants and estimates can be renamed".to_owned()
    })?;
    let symbol = occurrence.symbol;
    if occurrence.is_alias {
        return Err(format!("cannot rename `source`: it stands for the stage's source `{}`", symbol.name()));
    }
    let definition = view.definition(&symbol.keys());
    let Some(definition) = definition else {
        return Err(format!("cannot rename `{}`: there is no such {}", symbol.name(), bare(&symbol)));
    };
    let own = view.document.files.first().map(|(file, _)| file);
    if !own.is_some_and(|own| definition.is_in(own)) {
        let what = format!("cannot rename `{}` here: it is defined in {definition}", symbol.name());
        return Err(format!("{what}; rename it there, and then in the files that extend it"));
    }
    let has_it = |tree: &Arc<Node>| symbol.keys().into_iter().try_fold(tree, |node, key| node.get(key)).is_some();
    let other = view.document.files.iter().skip(1).find(|(_, tree)| tree.as_ref().is_some_and(has_it));
    if let Some((file, _)) = other {
        let what = format!(
            "cannot rename `{}` here: {} has {} of that name, too",
            symbol.name(),
            file.name,
            symbol.describe()
        );
        return Err(format!("{what}, which this file changes"));
    }
    Ok((symbol, occurrence.place, definition))
}

fn bare(symbol: &Symbol) -> &str {
    symbol.describe().split_once(' ').map_or("name", |(_, word)| word)
}
