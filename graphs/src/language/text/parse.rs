//! YAML text to a tree with positions, within limits that make foreign files safe.

use std::fmt;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Number;
use serde_saphyr::budget::BudgetBreach;
use serde_saphyr::options::DuplicateKeyPolicy;
use serde_saphyr::{Error, Location, NonFiniteFloatPolicy, Spanned};

use super::diagnostics::{Diagnostic, Report};
use super::source_file::{Place, SourceFile};
use super::tree::{Entry, Node, Tree, has_leading_zero};

pub(crate) const MOST_BYTES: u64 = 4 * 1024 * 1024;
/// With aliases expanded.
const MOST_VALUES: usize = 100_000;
/// The most events of the parser that aliases may expand to.
const MOST_REPLAYED: usize = 50_000;
const DEEPEST: usize = 48;

const MOST_DUPLICATES: usize = 50;

/// `None` if it is not YAML at all. Duplicate keys are reported, and the first of each is kept.
pub(crate) fn document(file: &Arc<SourceFile>, report: &mut Report) -> Option<Node> {
    let read = |text: &str, policy| serde_saphyr::from_str_with_options::<Spanned<Raw>>(text, options(policy));
    let mut text = file.text.clone();
    let mut duplicates = Vec::new();
    loop {
        match read(&text, DuplicateKeyPolicy::Error) {
            Ok(raw) if duplicates.is_empty() => return Some(placed(raw, file)),
            Ok(_) => break,
            Err(error) => {
                let cause = cause(&error);
                let place = place_of(cause.location().unwrap_or(Location::UNKNOWN), file);
                if !matches!(cause, Error::DuplicateMappingKey { .. }) {
                    report.push(syntax_error(cause, &place));
                    return None;
                }
                // The parser stops at the first: hide it under another name of equal length, and look for the next.
                let hidden = format!("{:x<1$.1$}", format!("_{}_", duplicates.len()), place.span.len());
                let known = duplicates.contains(&place) || place.span.is_empty();
                text.replace_range(place.span.clone(), &hidden);
                duplicates.push(place);
                if known || duplicates.len() >= MOST_DUPLICATES {
                    break;
                }
            }
        }
    }
    let document = read(&file.text, DuplicateKeyPolicy::FirstWins).ok().map(|raw| placed(raw, file));
    for place in duplicates {
        let key = place.text().trim_matches(['"', '\'']);
        let error = Diagnostic::error(&place, format!("the key `{key}` is given twice")).label("again");
        let first = document.as_ref().and_then(|document| first_of(document, key, &place));
        report.push(match first {
            Some(first) => error.help("keep one of the two").related(&first, "first here"),
            None => error.help("keep one of the two"),
        });
    }
    document
}

/// The entry that a duplicate repeats: in the innermost map around it with such a key.
fn first_of(node: &Node, key: &str, again: &Place) -> Option<Place> {
    if again.span.start < node.place.span.start {
        return None;
    }
    let inner = match &node.value {
        Tree::Map(entries) => {
            let last = entries.iter().rev().find(|entry| entry.value.place.span.start <= again.span.start);
            last.and_then(|entry| first_of(&entry.value, key, again))
        }
        Tree::List(items) => {
            let last = items.iter().rev().find(|item| item.place.span.start <= again.span.start);
            last.and_then(|item| first_of(item, key, again))
        }
        Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => None,
    };
    // In a block, duplicate keys have the same column; in `{ }`, they are between the same braces.
    let column = |place: &Place| place.line_column().1;
    let flow = node.place.text().starts_with('{') && {
        let between = again.file.text.get(node.place.span.end..again.span.start).unwrap_or_default();
        let mut open = 0_i32;
        between.chars().all(|c| {
            open += i32::from(c == '{') - i32::from(c == '}');
            open >= 0
        })
    };
    inner.or_else(|| {
        let entry = node.entry(key)?;
        (flow || column(&entry.key_place) == column(again)).then(|| entry.key_place.clone())
    })
}

/// Without the errors that the library wraps around it.
fn cause(error: &Error) -> &Error {
    match error.without_snippet() {
        Error::AliasError { error, .. } => cause(error),
        error => error,
    }
}

fn options(duplicate_keys: DuplicateKeyPolicy) -> serde_saphyr::Options {
    serde_saphyr::options! {
        budget: serde_saphyr::budget! {
            max_events: 4 * MOST_VALUES,
            max_nodes: MOST_VALUES,
            max_depth: DEEPEST,
            flow_nesting_limit: DEEPEST,
            max_aliases: 10_000,
            max_anchors: 10_000,
            max_recorded_anchor_events: 2 * MOST_VALUES,
            max_documents: 1,
            // A few anchors may be used often, e.g. a shared `with`.
            enforce_alias_anchor_ratio: false,
        },
        alias_limits: serde_saphyr::alias_limits! {
            max_total_replayed_events: MOST_REPLAYED,
            max_replay_stack_depth: 16,
        },
        duplicate_keys: duplicate_keys,
        strict_booleans: true,
        reject_unsupported_tags: true,
        non_finite_float_policy: NonFiniteFloatPolicy::AsString,
        emit_comments: false,
        with_snippet: false,
    }
}

fn syntax_error(error: &Error, place: &Place) -> Diagnostic {
    let text = error.to_string();
    // The parser appends the place, which a diagnostic shows by itself.
    let what = text.split(" at line ").next().unwrap_or(&text);
    let fewer_levels = || Some("write the maps and lists with fewer levels".to_owned());
    let deep = || format!("maps and lists are nested deeper than {DEEPEST} levels");
    let split = |remedy: &str| Some(format!("if a program writes this file: {remedy}"));
    let (message, help) = match error {
        Error::AliasReplayLimitExceeded { .. }
        | Error::AliasExpansionLimitExceeded { .. }
        | Error::AliasReplayStackDepthExceeded { .. }
        | Error::AliasReplayCounterOverflow { .. } => {
            let help = split("write the values out instead of nesting aliases, or split the experiment");
            (format!("the file's aliases expand to more than {MOST_REPLAYED} values"), help)
        }
        Error::Budget { breach: BudgetBreach::Documents { .. }, .. } | Error::MultipleDocuments { .. } => {
            let help = "one file is one experiment: remove the `---`".to_owned();
            ("the file holds several YAML documents".to_owned(), Some(help))
        }
        Error::Budget { breach: BudgetBreach::Depth { .. }, .. } => (deep(), fewer_levels()),
        Error::Budget { .. } => {
            let help = split("split the experiment, or describe the values with `matrix`");
            (format!("the file has more than {MOST_VALUES} values or 10000 aliases"), help)
        }
        Error::NullIntoString { .. } => ("a key is empty".to_owned(), Some("put a name before the `:`".to_owned())),
        Error::UnknownAnchor { .. } => {
            let help = "name a value with `&NAME` first; `*NAME` repeats it below";
            ("this alias has no anchor before it".to_owned(), Some(help.to_owned()))
        }
        Error::RecursiveReferencesRequireWeakTypes { .. } => {
            let help = "move the anchor (`&NAME`) to a value that does not contain this alias";
            ("this alias is inside the value that it repeats".to_owned(), Some(help.to_owned()))
        }
        _ if what.contains("unsupported tag") => {
            let help = "remove the tag; quote the value if it is text that begins with `!`";
            (format!("not valid YAML: {}", lower_first(what)), Some(help.to_owned()))
        }
        _ if what.contains("recursion limit") => (deep(), fewer_levels()),
        _ if what.contains("a tab") || what.contains("tabs") => (
            format!("not valid YAML: {}", lower_first(what)),
            Some("indent with spaces: YAML does not allow tabs".to_owned()),
        ),
        _ if what.contains("expected string scalar") => {
            let help = braces_help(place).unwrap_or_else(|| "write a name before the `:`".to_owned());
            ("a key must be a name, not a list or a map".to_owned(), Some(help))
        }
        _ => {
            let help = braces_help(place).or_else(|| syntax_help(what).map(str::to_owned));
            (format!("not valid YAML: {}", lower_first(what)), help)
        }
    };
    // The place may reach to the end of the file; its beginning is what matters.
    let text = place.text();
    let short = text.char_indices().nth(24).map_or(text.len(), |(at, _)| at);
    Diagnostic::error(&place.part(text, 0..short), message).maybe_help(help)
}

/// `{ root: ${NAME} }` is the likeliest way to break a flow map.
fn braces_help(place: &Place) -> Option<String> {
    let file = &place.file;
    let start = file.text[..place.span.start].rfind('\n').map_or(0, |at| at + 1);
    let line = file.text[start..].lines().next().unwrap_or_default();
    let quoted = line.contains("\"${") || line.contains("'${");
    (line.contains("${") && line.contains('{') && !quoted)
        .then(|| "inside `{ }` and `[ ]`, quote what holds `${...}`: `\"${NAME}\"`".to_owned())
}

/// What helps against the parser's message.
fn syntax_help(message: &str) -> Option<&'static str> {
    let message = message.to_lowercase();
    let has = |words: &str| message.contains(words);
    Some(match () {
        () if has("mapping values are not allowed") => {
            "indent keys of one map equally, and quote a text that contains `: `"
        }
        () if has("unclosed bracket") => "close every `{` and `[`, or quote the text if it is part of one",
        () if has("quoted scalar") => "close the quote on its line, or indent the lines of the text below it",
        () if has("indent") => "indent keys of one map equally, and deeper than the key above them",
        () if has("simple key") || has("expected ':'") => "write `KEY: VALUE`, with a space after the colon",
        () if has("flow") => "separate entries with `,`, and close every `{` and `[`",
        () => return None,
    })
}

fn lower_first(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_lowercase().chain(chars).collect())
}

fn place_of(location: Location, file: &Arc<SourceFile>) -> Place {
    let span = location.span();
    match (span.byte_offset(), span.byte_len()) {
        (Some(start), Some(len)) => {
            let start = usize::try_from(start).unwrap_or(usize::MAX);
            Place::new(file, &(start..start.saturating_add(usize::try_from(len).unwrap_or(0))))
        }
        _ => {
            // Line and column only: from there to the end of the word.
            let line = usize::try_from(location.line()).unwrap_or(0);
            let column = usize::try_from(location.column()).unwrap_or(0);
            let Some(text) = line.checked_sub(1).and_then(|line| file.text.lines().nth(line)) else {
                return Place::start_of(file);
            };
            let start = text.as_ptr() as usize - file.text.as_ptr() as usize;
            let at: usize = text.chars().take(column.saturating_sub(1)).map(char::len_utf8).sum();
            let word = text[at..].find(char::is_whitespace).unwrap_or(text.len() - at);
            Place::new(file, &(start + at..start + at + word))
        }
    }
}

/// The document before its places know their file.
enum Raw {
    Null,
    Bool(bool),
    Number(Number),
    Text(String),
    List(Vec<Spanned<Self>>),
    Map(Vec<(Spanned<String>, Spanned<Self>)>),
}

impl<'de> Deserialize<'de> for Raw {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(RawVisitor)
    }
}

struct RawVisitor;

impl<'de> Visitor<'de> for RawVisitor {
    type Value = Raw;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a YAML value")
    }

    fn visit_unit<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_none<E>(self) -> Result<Raw, E> {
        Ok(Raw::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Raw, D::Error> {
        deserializer.deserialize_any(self)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Raw, E> {
        Ok(Raw::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Raw, E> {
        Ok(Raw::Number(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Raw, E> {
        Ok(Raw::Number(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Raw, E> {
        Ok(Number::from_f64(value).map_or_else(|| Raw::Text(value.to_string()), Raw::Number))
    }

    fn visit_str<E>(self, value: &str) -> Result<Raw, E> {
        Ok(Raw::Text(value.to_owned()))
    }

    fn visit_string<E>(self, value: String) -> Result<Raw, E> {
        Ok(Raw::Text(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Raw, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Raw::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Raw, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = map.next_entry()? {
            entries.push(entry);
        }
        Ok(Raw::Map(entries))
    }
}

fn placed(raw: Spanned<Raw>, file: &Arc<SourceFile>) -> Node {
    let mut place = place_of(raw.defined, file);
    let value = match raw.value {
        Raw::Null => Tree::Null,
        Raw::Bool(value) => Tree::Bool(value),
        // Ambiguous: octal or decimal. Kept as text.
        Raw::Number(_) if has_leading_zero(place.text()) => Tree::Text(place.text().to_owned()),
        Raw::Number(value) => Tree::Number(value),
        Raw::Text(value) => Tree::Text(value),
        Raw::List(items) => {
            let items: Vec<_> = items.into_iter().map(|item| Arc::new(placed(item, file))).collect();
            for item in &items {
                cover(&mut place, &item.place);
            }
            close(&mut place);
            Tree::List(items)
        }
        Raw::Map(entries) => {
            let mut list = Vec::with_capacity(entries.len());
            for (key, value) in entries {
                let key_place = place_of(key.defined, file);
                let value = placed(value, file);
                cover(&mut place, &key_place);
                cover(&mut place, &value.place);
                list.push(Entry { key: key.value, key_place, value: Arc::new(value) });
            }
            close(&mut place);
            Tree::Map(list)
        }
    };
    Node::new(value, place)
}

/// Maps and lists reach as far as their contents. (Merged-in entries are elsewhere and do not count.)
fn cover(place: &mut Place, inner: &Place) {
    if inner.span.start >= place.span.start {
        place.span.end = place.span.end.max(inner.span.end);
    }
}

/// `[ ]` and `{ }` reach to their closing bracket.
fn close(place: &mut Place) {
    let text = &place.file.text;
    let closing = match text[place.span.start..].chars().next() {
        Some('[') => ']',
        Some('{') => '}',
        _ => return,
    };
    let rest = text[place.span.end..].trim_start_matches(|c: char| c.is_whitespace() || c == ',');
    if rest.starts_with(closing) {
        place.span.end = text.len() - rest.len() + 1;
    }
}
