//! YAML text to a tree with places, within limits that hold for a stranger's file.

use std::fmt;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Number;
use serde_saphyr::options::DuplicateKeyPolicy;
use serde_saphyr::{Error, Location, NonFiniteFloatPolicy, Spanned};

use super::diagnostics::{Diagnostic, Report};
use super::source_file::{Place, SourceFile};
use super::tree::{Entry, Node, Tree};

/// The largest file read.
pub(super) const MOST_BYTES: u64 = 4 * 1024 * 1024;
/// The most values a document may hold, aliases expanded.
const MOST_VALUES: usize = 400_000;
/// How deep maps and lists may be nested.
const DEEPEST: usize = 48;

/// The document of a file; `None` if it is not YAML at all. Duplicate keys are reported, and the first of each is kept.
pub(super) fn document(file: &Arc<SourceFile>, report: &mut Report) -> Option<Node> {
    let text = file.text.as_str();
    match serde_saphyr::from_str_with_options::<Spanned<Raw>>(text, options(DuplicateKeyPolicy::Error)) {
        Ok(raw) => Some(placed(raw, file)),
        Err(error) => {
            let duplicate = matches!(error.without_snippet(), Error::DuplicateMappingKey { .. });
            report.push(syntax_error(&error, file));
            if !duplicate {
                return None;
            }
            let first = serde_saphyr::from_str_with_options(text, options(DuplicateKeyPolicy::FirstWins));
            first.ok().map(|raw| placed(raw, file))
        }
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
            // A few anchors used often (a shared `with`, say) are what anchors are for.
            enforce_alias_anchor_ratio: false,
        },
        alias_limits: serde_saphyr::alias_limits! {
            max_total_replayed_events: MOST_VALUES,
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

fn syntax_error(error: &Error, file: &Arc<SourceFile>) -> Diagnostic {
    let error = error.without_snippet();
    let place = place_of(error.location().unwrap_or(Location::UNKNOWN), file);
    let text = error.to_string();
    // The parser appends the place, which a diagnostic shows by itself.
    let what = text.split(" at line ").next().unwrap_or(&text);
    let bomb = "an experiment needs no such file; was it written by a person?";
    let (message, help) = match error {
        Error::DuplicateMappingKey { key, .. } => (
            key.as_ref()
                .map_or_else(|| "a key is given twice".to_owned(), |key| format!("the key `{key}` is given twice")),
            Some("keep one of the two".to_owned()),
        ),
        Error::AliasReplayLimitExceeded { .. }
        | Error::AliasExpansionLimitExceeded { .. }
        | Error::AliasReplayStackDepthExceeded { .. }
        | Error::AliasReplayCounterOverflow { .. } => {
            ("the file's aliases expand to more than an experiment can hold".to_owned(), Some(bomb.to_owned()))
        }
        Error::Budget { .. } => {
            (format!("the file is larger or deeper than an experiment can be: {what}"), Some(bomb.to_owned()))
        }
        Error::MultipleDocuments { .. } => (
            "the file holds several YAML documents".to_owned(),
            Some("one file is one experiment: remove the `---`".to_owned()),
        ),
        Error::UnknownAnchor { .. } => ("this alias has no anchor before it".to_owned(), None),
        _ => (format!("not valid YAML: {}", lower_first(what)), braces_help(file, &place)),
    };
    Diagnostic::error(&place, message).maybe_help(help)
}

/// `{ root: ${NAME} }` is the likeliest way to break a flow map.
fn braces_help(file: &SourceFile, place: &Place) -> Option<String> {
    let start = file.text[..place.span.start].rfind('\n').map_or(0, |at| at + 1);
    let line = file.text[start..].lines().next().unwrap_or_default();
    let quoted = line.contains("\"${") || line.contains("'${");
    (line.contains("${") && line.contains('{') && !quoted)
        .then(|| "inside `{ }` and `[ ]`, quote what holds `${...}`: `\"${NAME}\"`".to_owned())
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

/// The document as the parser hands it over, before its places know their file.
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
        Raw::Number(value) => Tree::Number(value),
        Raw::Text(value) => Tree::Text(value),
        Raw::List(items) => {
            let items: Vec<_> = items.into_iter().map(|item| Arc::new(placed(item, file))).collect();
            for item in &items {
                cover(&mut place, &item.place);
            }
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
            Tree::Map(list)
        }
    };
    Node::new(value, place)
}

/// Maps and lists reach as far as what they hold. (Merged-in entries stand elsewhere and do not count.)
fn cover(place: &mut Place, inner: &Place) {
    if inner.span.start >= place.span.start {
        place.span.end = place.span.end.max(inner.span.end);
    }
}
