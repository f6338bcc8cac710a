//! Definitions, uses, and renaming of names.

use std::collections::HashMap;

use depthloom_graphs::language::{Place, check_name};
use gen_lsp_types::{Location, PrepareRenamePlaceholder, TextEdit, Uri, WorkspaceEdit};

use crate::positions;
use crate::symbols::{self, Symbol};
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
    let (symbol, place) = renamed(view, offset)?;
    let range = positions::range(view.text, &place.span);
    Ok(PrepareRenamePlaceholder { range, placeholder: symbol.name().to_owned() })
}

/// Renames a stage, node, source, variant or estimate, and all its uses in the document.
///
/// # Errors
/// Why it cannot be renamed.
pub(crate) fn rename(view: &View<'_>, offset: usize, new_name: &str, uri: Uri) -> Result<WorkspaceEdit, String> {
    let (symbol, _) = renamed(view, offset)?;
    if new_name == symbol.name() {
        return Ok(WorkspaceEdit::default());
    }
    check_name(new_name, symbol.describe())?;
    let keys = symbol.keys();
    let siblings = keys.split_last().and_then(|(_, above)| {
        let map = above.iter().try_fold(view.root()?, |node, key| node.get(key));
        Some(names(map))
    });
    if siblings.is_some_and(|siblings| siblings.contains(&new_name)) {
        return Err(format!(
            "cannot rename `{}` to `{new_name}`: {} of that name exists",
            symbol.name(),
            symbol.describe()
        ));
    }
    let uses = symbols::occurrences(view).into_iter().filter(|found| found.symbol == symbol && !found.is_alias);
    let mut edits = Vec::new();
    for found in uses {
        if found.place.text() != symbol.name() {
            let (line, _) = found.place.line_column();
            let what = "it is not written as plain text there (a variable, an alias or an escape)";
            return Err(format!("cannot rename `{}`, which line {line} uses: {what}", symbol.name()));
        }
        let range = positions::range(view.text, &found.place.span);
        edits.push(TextEdit { range, new_text: new_name.to_owned() });
    }
    let changes = Some(HashMap::from([(uri, edits)]));
    Ok(WorkspaceEdit { changes, ..WorkspaceEdit::default() })
}

/// The name at an offset, if this document defines it.
fn renamed(view: &View<'_>, offset: usize) -> Result<(Symbol, Place), String> {
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
    Ok((symbol, occurrence.place))
}

fn bare(symbol: &Symbol) -> &str {
    symbol.describe().split_once(' ').map_or("name", |(_, word)| word)
}
