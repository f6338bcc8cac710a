//! `${NAME}` and `${NAME:-default}` in scalars; `$${` stands for `${`.
//!
//! Keys, anchors and structure never change with the environment. A scalar is typed after substitution: `cap:
//! ${CAP:-80}` is a number.

use std::ops::Range;
use std::sync::Arc;

use super::diagnostics::{Diagnostic, Report};
use super::tree::{Entry, Node, Tree, Written, typed};

pub(crate) type Lookup<'a> = dyn Fn(&str) -> Option<String> + 'a;

/// Replaces every variable; the original text is kept in `written`.
pub(crate) fn substitute(node: &Arc<Node>, env: &Lookup<'_>, report: &mut Report) -> Arc<Node> {
    match &node.value {
        Tree::Text(text) => match scalar(text, node, env, report) {
            Some(new) => Arc::new(new),
            None => Arc::clone(node),
        },
        Tree::List(items) => {
            let new: Vec<_> = items.iter().map(|item| substitute(item, env, report)).collect();
            if items.iter().zip(&new).all(|(old, new)| Arc::ptr_eq(old, new)) {
                return Arc::clone(node);
            }
            Arc::new(Node { value: Tree::List(new), ..(**node).clone() })
        }
        Tree::Map(entries) => {
            let new: Vec<Entry> = entries
                .iter()
                .map(|entry| Entry { value: substitute(&entry.value, env, report), ..entry.clone() })
                .collect();
            if entries.iter().zip(&new).all(|(old, new)| Arc::ptr_eq(&old.value, &new.value)) {
                return Arc::clone(node);
            }
            Arc::new(Node { value: Tree::Map(new), ..(**node).clone() })
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) => Arc::clone(node),
    }
}

fn scalar(text: &str, node: &Node, env: &Lookup<'_>, report: &mut Report) -> Option<Node> {
    let pieces = match pieces(text) {
        Ok(pieces) => pieces,
        Err((range, what)) => {
            let place = node.place.part(text, range);
            let help = "write `${NAME}` or `${NAME:-default}`; `$${` stands for a plain `${`";
            report.push_unknown(Diagnostic::error(&place, what).help(help), &node.place);
            return None;
        }
    };
    if pieces.iter().all(|piece| matches!(piece, Piece::Plain(_))) {
        let plain: String =
            pieces.iter().map(|piece| if let Piece::Plain(text) = piece { *text } else { "" }).collect();
        // Only `$${` makes a difference here.
        return (plain != text).then(|| Node {
            value: Tree::Text(plain.clone()),
            written: Some(Written { text: text.to_owned(), value: plain, leads: false, has_variable: false }),
            place: node.place.clone(),
        });
    }
    let (mut new, mut leads) = (String::new(), false);
    for piece in &pieces {
        match piece {
            Piece::Plain(text) => new.push_str(text),
            Piece::Variable { name, default, range } => match (env(name), default) {
                (Some(value), _) if value.contains(['\u{fffd}', '\0']) => {
                    let place = node.place.part(text, range.clone());
                    let what = format!("the environment variable `{name}` is not UTF-8 text");
                    let error = Diagnostic::error(&place, what).label("needed here");
                    report.push_unknown(error.help("set it to UTF-8 text"), &node.place);
                    new.push_str("unset");
                }
                (Some(value), _) if !value.is_empty() => {
                    leads |= new.is_empty();
                    new.push_str(&value);
                }
                (_, Some(default)) => new.push_str(default),
                (value, None) => {
                    let place = node.place.part(text, range.clone());
                    let is = if value.is_some() { "empty" } else { "not set" };
                    let error = Diagnostic::error(&place, format!("the environment variable `{name}` is {is}"));
                    let help = format!("set it (`export {name}=...`) or give a default: `${{{name}:-...}}`");
                    report.push_unknown(error.label("needed here").help(help), &node.place);
                    new.push_str("unset");
                }
            },
        }
    }
    let value = typed(&new);
    let written = Some(Written { text: text.to_owned(), value: new, leads, has_variable: true });
    Some(Node { value, written, place: node.place.clone() })
}

enum Piece<'a> {
    Plain(&'a str),
    Variable { name: &'a str, default: Option<&'a str>, range: Range<usize> },
}

fn pieces(text: &str) -> Result<Vec<Piece<'_>>, (Range<usize>, String)> {
    let (mut pieces, mut at) = (Vec::new(), 0);
    while let Some(found) = text[at..].find("${") {
        let start = at + found;
        if text[at..start].ends_with('$') {
            pieces.push(Piece::Plain(&text[at..start - 1]));
            pieces.push(Piece::Plain("${"));
            at = start + 2;
            continue;
        }
        pieces.push(Piece::Plain(&text[at..start]));
        let Some(length) = text[start..].find('}') else {
            return Err((start..text.len(), "this `${` has no `}`".to_owned()));
        };
        let (range, inner) = (start..start + length + 1, &text[start + 2..start + length]);
        let (name, default) = match inner.split_once(":-") {
            Some((name, default)) => (name, Some(default)),
            None => (inner, None),
        };
        let first = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
        if !first || !name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') {
            return Err((range, format!("`{name}` is not a name of an environment variable")));
        }
        if default.is_some_and(|default| default.contains("${")) {
            return Err((range, "a default cannot hold another variable".to_owned()));
        }
        at = range.end;
        pieces.push(Piece::Variable { name, default, range });
    }
    pieces.push(Piece::Plain(&text[at..]));
    Ok(pieces)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::substitute;
    use crate::language::text::diagnostics::Report;
    use crate::language::text::source_file::{Place, SourceFile};
    use crate::language::text::tree::{Node, Tree};

    fn read(text: &str) -> (serde_json::Value, usize) {
        let file = Arc::new(SourceFile::new("test.yaml", text, "."));
        let place = Place::new(&file, &(0..text.len()));
        let node = Arc::new(Node::new(Tree::Text(text.to_owned()), place));
        let mut report = Report::default();
        let env = |name: &str| match name {
            "ROOT" => Some("/data".to_owned()),
            "EMPTY" => Some(String::new()),
            _ => None,
        };
        let new = substitute(&node, &env, &mut report);
        (new.to_json(), report.len())
    }

    #[test]
    fn variables_defaults_and_escapes() {
        assert_eq!(read("${ROOT}/kitti"), ("/data/kitti".into(), 0));
        assert_eq!(read("${CAP:-80}"), (80.into(), 0));
        assert_eq!(read("${CAP:--0.5}"), ((-0.5).into(), 0));
        assert_eq!(read("${EMPTY:-x}"), ("x".into(), 0));
        assert_eq!(read("0..${LAST:-48}"), ("0..48".into(), 0));
        assert_eq!(read("$${ROOT}"), ("${ROOT}".into(), 0));
        assert_eq!(read("$5"), ("$5".into(), 0));
    }

    #[test]
    fn unset_and_malformed_variables_are_reported() {
        for text in ["${NOT_SET}", "${ROOT", "${1X}", "${}", "${A:-${B}}"] {
            assert_eq!(read(text).1, 1, "{text}");
        }
    }
}
