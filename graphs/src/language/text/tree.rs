//! A YAML document as a tree with positions.

use std::sync::Arc;

use serde_json::{Number, Value as Json};

use super::diagnostics::Diagnostic;
use super::source_file::Place;
use super::word::Word;

/// A value of a YAML document.
#[derive(Clone, Debug)]
pub struct Node {
    /// The value.
    pub value: Tree,
    /// Where it is written.
    pub place: Place,
    /// The text before the environment was substituted.
    pub(crate) written: Option<Written>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Written {
    pub(crate) text: String,
    /// The text with the environment, before it was typed.
    pub(crate) value: String,
    /// Whether the text begins with a value of the environment: a path then does not start at the file's folder.
    pub(crate) leads: bool,
    /// Whether it has a variable; otherwise only `$${` was replaced.
    pub(crate) has_variable: bool,
}

/// What a value is.
#[derive(Clone, Debug)]
pub enum Tree {
    /// Nothing: `null`, `~`, or no text at all.
    Null,
    /// `true` or `false`.
    Bool(bool),
    /// A number.
    Number(Number),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Arc<Node>>),
    /// A map, in the order of the file.
    Map(Vec<Entry>),
}

/// A key of a map, and its value.
///
/// Values are shared: changing a copy of a document copies only the path to the change.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// Where the key is written.
    pub key_place: Place,
    /// The value.
    pub value: Arc<Node>,
}

impl Entry {
    pub(crate) fn key(&self) -> Word {
        Word { text: self.key.clone(), place: self.key_place.clone() }
    }

    /// The place of the value, or of the key if the value is empty.
    pub(crate) fn value_place(&self) -> &Place {
        if self.value.is_null() { &self.key_place } else { &self.value.place }
    }

    /// An error about a value of another type.
    pub(crate) fn not_a(&self, expected: &str) -> Diagnostic {
        let what = format!("`{}` must be {expected}, not {}", self.key, self.value.describe());
        Diagnostic::error(self.value_place(), what)
    }
}

impl Node {
    pub(crate) const fn new(value: Tree, place: Place) -> Self {
        Self { value, place, written: None }
    }

    /// The entries of a map; none of any other value.
    pub fn entries(&self) -> &[Entry] {
        match &self.value {
            Tree::Map(entries) => entries,
            _ => &[],
        }
    }

    /// The entry of a map with this key.
    pub fn entry(&self, key: &str) -> Option<&Entry> {
        self.entries().iter().find(|entry| entry.key == key)
    }

    /// The value of a map at this key.
    pub fn get(&self, key: &str) -> Option<&Arc<Self>> {
        self.entry(key).map(|entry| &entry.value)
    }

    /// The text with `${...}` as written, if it has a variable.
    pub(crate) fn text_with_variables(&self) -> Option<&str> {
        self.written.as_ref().filter(|written| written.has_variable).map(|written| written.text.as_str())
    }

    /// The text, if it is one.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Tree::Text(text) => Some(text),
            _ => None,
        }
    }

    /// A text, number or truth value as text.
    pub fn scalar_text(&self) -> Option<String> {
        match &self.value {
            Tree::Text(text) => Some(text.clone()),
            Tree::Number(number) => Some(number.to_string()),
            Tree::Bool(bool) => Some(bool.to_string()),
            Tree::Null | Tree::List(_) | Tree::Map(_) => None,
        }
    }

    pub(crate) const fn is_null(&self) -> bool {
        matches!(self.value, Tree::Null)
    }

    pub(crate) const fn is_map(&self) -> bool {
        matches!(self.value, Tree::Map(_))
    }

    /// With the environment substituted.
    pub fn to_json(&self) -> Json {
        match &self.value {
            Tree::Null => Json::Null,
            Tree::Bool(bool) => Json::Bool(*bool),
            Tree::Number(number) => Json::Number(number.clone()),
            Tree::Text(text) => Json::String(text.clone()),
            Tree::List(items) => Json::Array(items.iter().map(|item| item.to_json()).collect()),
            Tree::Map(entries) => {
                Json::Object(entries.iter().map(|entry| (entry.key.clone(), entry.value.to_json())).collect())
            }
        }
    }

    pub(crate) const fn describe(&self) -> &'static str {
        match self.value {
            Tree::Null => "nothing",
            Tree::Bool(_) => "a truth value",
            Tree::Number(_) => "a number",
            Tree::Text(_) => "text",
            Tree::List(_) => "a list",
            Tree::Map(_) => "a map",
        }
    }

    /// An error about a value of another type.
    pub(crate) fn not_a(&self, subject: &str, expected: &str) -> Diagnostic {
        Diagnostic::error(&self.place, format!("{subject} must be {expected}, not {}", self.describe()))
    }

    /// How many values it holds, itself included.
    pub(crate) fn size(&self) -> usize {
        1 + match &self.value {
            Tree::List(items) => items.iter().map(|item| item.size()).sum(),
            Tree::Map(entries) => entries.iter().map(|entry| entry.value.size()).sum::<usize>(),
            Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => 0,
        }
    }

    pub(crate) fn key_path(&self, place: &Place) -> Option<String> {
        fn walk(node: &Node, place: &Place, keys: &mut Vec<String>) -> bool {
            match &node.value {
                Tree::Map(entries) => {
                    for entry in entries {
                        keys.push(entry.key.clone());
                        let is_here = entry.key_place.contains(place) || entry.value.place.contains(place);
                        if walk(&entry.value, place, keys) || is_here {
                            return true;
                        }
                        keys.pop();
                    }
                    false
                }
                Tree::List(items) => {
                    for (i, item) in items.iter().enumerate() {
                        keys.push(i.to_string());
                        if walk(item, place, keys) || item.place.contains(place) {
                            return true;
                        }
                        keys.pop();
                    }
                    false
                }
                Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => false,
            }
        }
        let mut keys = Vec::new();
        walk(self, place, &mut keys).then(|| keys.join("."))
    }
}

/// The value under a key, to be changed; shared parts are copied first.
pub(crate) fn entry_mut<'n>(node: &'n mut Arc<Node>, key: &str) -> Option<&'n mut Arc<Node>> {
    match &mut Arc::make_mut(node).value {
        Tree::Map(entries) => {
            entries.iter_mut().find(|entry: &&mut Entry| entry.key == key).map(|entry| &mut entry.value)
        }
        _ => None,
    }
}

/// A scalar's text, typed as YAML types plain text.
pub(crate) fn typed(text: &str) -> Tree {
    match text {
        "" | "~" | "null" => Tree::Null,
        "true" => Tree::Bool(true),
        "false" => Tree::Bool(false),
        _ => number(text).map_or_else(|| Tree::Text(text.to_owned()), Tree::Number),
    }
}

/// Whether a text is digits that begin with a zero, as `017`.
pub(crate) fn has_leading_zero(text: &str) -> bool {
    let digits = text.strip_prefix(['+', '-']).unwrap_or(text);
    digits.len() > 1 && digits.starts_with('0') && digits.bytes().all(|byte| byte.is_ascii_digit())
}

fn number(text: &str) -> Option<Number> {
    if has_leading_zero(text) {
        return None;
    }
    // Rust also reads `inf`, `nan` and `infinity` as numbers; YAML does not.
    if !text.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.')) || text.ends_with('.') {
        return None;
    }
    let whole = text.strip_prefix('+').unwrap_or(text);
    if let Ok(unsigned) = whole.parse::<u64>() {
        return Some(unsigned.into());
    }
    if let Ok(signed) = whole.parse::<i64>() {
        return Some(signed.into());
    }
    let digits = |c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.' | 'e' | 'E');
    if whole.chars().all(digits) { whole.parse::<f64>().ok().and_then(Number::from_f64) } else { None }
}
