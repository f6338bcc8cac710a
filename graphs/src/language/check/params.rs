//! Checks parameters: the schema of their kind first, then the type itself.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Value as Json, json};

use super::following::{self, Following};
use super::free_numbers;
use super::schema_check::{Violation, violations};
use super::spec::Instance;
use super::variables;
use super::with_schema::{self, PathOf};
use crate::contracts::{CodePath, Fault, Port, Signature};
use crate::key::Key;
use crate::language::change::overrides;
use crate::language::text::diagnostics::{Diagnostic, Report};
use crate::language::text::paths::Anywhere;
use crate::language::text::source_file::Place;
use crate::language::text::tree::{Node, Tree};
use crate::registry::{KindInfo, NodeKind, SourceEntry};
use crate::render::parameter_help;

#[derive(Debug, PartialEq)]
pub(crate) struct Parameters {
    /// With every default.
    pub(crate) resolved: Json,
    /// `resolved` with `${NAME}` for values of environment variables: may be shown.
    pub(crate) shown: Json,
    /// `resolved` without operational parameters and locations of files: part of the node hash.
    pub(crate) portable: Json,
    /// `portable` with `${NAME}` for values of environment variables: may be recorded.
    pub(crate) recorded: Json,
    /// As `portable`, but with the path of what has no content: distinguishes the nodes of a plan.
    pub(crate) identity: String,
    pub(crate) operational: Json,
    pub(crate) following: Vec<Following>,
}

/// The contents of files, hashed once.
#[derive(Default)]
pub(crate) struct Contents {
    files: HashMap<PathBuf, Option<Key>>,
    code: HashMap<PathBuf, Option<Key>>,
}

impl Contents {
    /// `None` if it is not a file.
    pub(crate) fn hash_of(&mut self, path: &Path) -> Option<Key> {
        *self.files.entry(path.to_owned()).or_insert_with(|| hash(path))
    }

    fn hash_of_path(&mut self, path: &Path, of: PathOf) -> Option<Key> {
        match of {
            PathOf::Data => self.hash_of(path),
            PathOf::Code => {
                let hash = || CodePath(path.to_owned()).content().ok();
                *self.code.entry(path.to_owned()).or_insert_with(hash)
            }
        }
    }

    /// A path's content, or else what `other` makes of the path.
    fn content_or(&mut self, path: &Path, of: PathOf, other: impl FnOnce(&Path) -> Json) -> Json {
        match self.hash_of_path(path, of) {
            Some(key) => json!({ "content": key.to_string() }),
            None => other(path),
        }
    }

    /// A path in a node hash, without its location.
    fn portable_path(&mut self, path: &Path, of: PathOf) -> Json {
        self.content_or(path, of, |path| json!({ "name": path.file_name().map(|name| name.to_string_lossy()) }))
    }

    pub(crate) fn named(&self) -> impl Iterator<Item = &Path> {
        self.files.keys().chain(self.code.keys()).map(PathBuf::as_path)
    }
}

/// The parameter whose file changed since the parameters were resolved.
pub(crate) fn changed_since(portable: &Json, resolved: &Json, schema: &Json) -> Option<String> {
    let mut contents = Contents::default();
    let now = with_schema::with_paths(resolved, schema, &mut |path, of| contents.portable_path(path, of));
    let parameters = now.as_object()?.iter();
    let mut changed = parameters.filter(|(name, now)| portable.get(name).is_some_and(|then| differs(then, now)));
    changed.next().map(|(name, _)| name.clone())
}

fn differs(then: &Json, now: &Json) -> bool {
    match (then, now) {
        _ if is_content(then) && is_content(now) => then != now,
        (Json::Object(a), Json::Object(b)) => a.iter().any(|(key, a)| b.get(key).is_some_and(|b| differs(a, b))),
        (Json::Array(a), Json::Array(b)) => a.iter().zip(b).any(|(a, b)| differs(a, b)),
        _ => false,
    }
}

/// Whether a value replaces a path with content.
fn is_content(value: &Json) -> bool {
    let content = value.get("content").and_then(Json::as_str);
    content.and_then(Key::parse).is_some() && value.as_object().is_some_and(|map| map.len() == 1)
}

fn hash(path: &Path) -> Option<Key> {
    if !path.metadata().ok()?.is_file() {
        return None;
    }
    Key::of_reader(std::fs::File::open(path).ok()?).ok()
}

type Outputs = Result<Vec<Port>, Fault>;

#[derive(Default)]
pub(crate) struct Resolver {
    known: HashMap<(&'static str, String), Arc<Parameters>>,
    outputs: HashMap<(&'static str, String), Outputs>,
    /// By kind; and by parameters where it follows from them.
    signatures: HashMap<(&'static str, Option<String>), Arc<Signature>>,
    pub(crate) contents: Contents,
    pub(crate) anywhere: Anywhere,
    /// Where the current variant writes its changes.
    pub(crate) changed: Vec<Place>,
}

impl Resolver {
    /// `None` if its inputs follow from invalid parameters.
    pub(crate) fn signature(&mut self, kind: &NodeKind, parameters: Option<&Parameters>) -> Option<Arc<Signature>> {
        let resolved = parameters.filter(|_| kind.own_ports).map(|parameters| &parameters.resolved);
        let known = (kind.declaration.kind, resolved.map(Json::to_string));
        if let Some(known) = self.signatures.get(&known) {
            return Some(Arc::clone(known));
        }
        let signature = match resolved {
            Some(resolved) => kind.signature(resolved).ok()?,
            None if kind.own_inputs => return None,
            // All outputs that it may have.
            None => Signature::from(&kind.declaration),
        };
        Some(Arc::clone(self.signatures.entry(known).or_insert(Arc::new(signature))))
    }

    pub(crate) fn outputs(
        &mut self,
        kind: &SourceEntry,
        parameters: &Parameters,
        instance: &Instance,
        report: &mut Report,
    ) -> Option<Vec<Port>> {
        let known = (kind.declaration.kind, parameters.resolved.to_string());
        let outputs = self.outputs.entry(known);
        let outputs = outputs.or_insert_with(|| kind.outputs(&parameters.resolved));
        match outputs {
            Ok(outputs) => Some(outputs.clone()),
            Err(fault) => {
                let what = format!("the outputs of this `{}` are not known: {}", instance.kind.text, fault.chain());
                let error = Diagnostic::error(&instance.kind.place, what).label("looked for here");
                report.push(error.maybe_help(fault.remedy_text().map(str::to_owned)));
                None
            }
        }
    }

    pub(crate) fn parameters(
        &mut self,
        kind: &KindInfo<'_>,
        instance: &Instance,
        report: &mut Report,
    ) -> Option<Arc<Parameters>> {
        let with = instance.with.as_deref().filter(|with| with.is_map());
        let json = with.map_or_else(
            || Json::Object(serde_json::Map::new()),
            |with| with_schema::parameters(with, kind.schema, &mut self.anywhere),
        );
        if let Some(with) = with {
            free_numbers::check(with, kind.schema, report);
        }
        let hidden = with.map_or_else(Vec::new, |with| variables::hidden(with, kind.schema));
        let known = (kind.kind, format!("{json} {hidden:?}"));
        if let Some(known) = self.known.get(&known) {
            return Some(Arc::clone(known));
        }
        let given = json.clone();
        let resolved = checked(kind, json, with, &instance.kind.place, &self.changed, report)?;
        let decisive = with_schema::chosen(&resolved, kind.schema, false);
        let contents = &mut self.contents;
        let portable =
            with_schema::with_paths(&decisive, kind.schema, &mut |path, of| contents.portable_path(path, of));
        let identity = with_schema::with_paths(&decisive, kind.schema, &mut |path, of| {
            contents.content_or(path, of, |path| json!({ "path": path.to_string_lossy() }))
        });
        let identity = canonical(&identity);
        let operational = with_schema::chosen(&resolved, kind.schema, true);
        let following = following::parameters(kind.schema, &given, &resolved, &kind.resolve);
        let (shown, mut recorded) = (variables::without(&resolved, &hidden), variables::without(&portable, &hidden));
        if kind.contract.is_none() && !hidden.is_empty() {
            // A source has no node hash that would tell two recorded plans apart.
            recorded["variables"] = Key::build("variables").text(&canonical(&portable)).finish().to_string().into();
        }
        let parameters = Arc::new(Parameters { resolved, shown, portable, recorded, identity, operational, following });
        self.known.insert(known, Arc::clone(&parameters));
        Some(parameters)
    }
}

/// Reports everything wrong with parameters. Invalid ones are removed, so that the rest is checked too.
fn checked(
    kind: &KindInfo<'_>,
    mut json: Json,
    with: Option<&Node>,
    at: &Place,
    changed: &[Place],
    report: &mut Report,
) -> Option<Json> {
    let (mut sound, mut is_conflict) = (true, false);
    let mut taken_out: Vec<Vec<String>> = Vec::new();
    for violation in violations(&json.clone(), kind.schema) {
        sound = false;
        let place = place_of(with, &violation.path, violation.at_key).unwrap_or_else(|| at.clone());
        let help = as_input(kind, &violation, &json).or_else(|| as_axis(&violation, &json, &place)).or(violation.help);
        let help = help.or_else(|| parameter_help(kind.kind, kind.schema, &violation.path));
        report.push(
            Diagnostic::error(&place, format!("{} (of `{}`)", violation.what, kind.kind))
                .label(violation.label)
                .maybe_help(help),
        );
        remove(&mut json, &violation.path);
        taken_out.push(violation.path);
    }
    loop {
        match (kind.resolve)(&json) {
            Ok(resolved) => return sound.then_some(resolved),
            Err(error) => {
                // An error that is due to a removed parameter (a missing field, a conflicting default) was reported
                // before.
                let is_above_taken =
                    !error.path.is_empty() && taken_out.iter().any(|taken| taken.starts_with(&error.path));
                // With one of two conflicting parameters removed, the other may be incomplete.
                let is_rest_of_conflict = is_conflict && error.what.contains("is missing");
                if is_above_taken || is_rest_of_conflict || !sound && error.what.starts_with("missing field") {
                    return None;
                }
                let place = place_of(with, &error.path, false);
                let place = culprit(with, &error.what, changed).or(place);
                let place = place.or_else(|| named(with, &error.what).next());
                let place = place.or_else(|| Some(with?.place.clone())).unwrap_or_else(|| at.clone());
                let (what, suggestion) = parted(&error.what);
                let what = match error.path.last() {
                    // Many messages name their parameter.
                    Some(name) if !error.what.contains(name) => {
                        format!("`{}`: {what} (of `{}`)", error.path.join("."), kind.kind)
                    }
                    _ => format!("{what} (of `{}`)", kind.kind),
                };
                let help = following::cause(kind.schema, &json, &error.path)
                    .or_else(|| following::others(kind.schema, &json, &error.path, &error.what, &kind.resolve))
                    .or_else(|| suggestion.map(str::to_owned))
                    .or_else(|| parameter_help(kind.kind, kind.schema, &error.path));
                report.push(Diagnostic::error(&place, what).maybe_help(help));
                is_conflict |= error.what.contains("cannot be combined");
                sound = false;
                if !remove(&mut json, &error.path) {
                    return None;
                }
                taken_out.push(error.path);
            }
        }
    }
}

/// A message without the suggestion at its end, and that suggestion.
fn parted(message: &str) -> (&str, Option<&str>) {
    let starts = [": did you mean ", ": frames are ", ": `a..b` ends "];
    match starts.iter().find_map(|start| message.find(start)) {
        Some(at) => (&message[..at], Some(&message[at + 2..])),
        None => (message, None),
    }
}

/// Suggests an axis for a list where one value is expected.
fn as_axis(violation: &Violation, json: &Json, place: &Place) -> Option<String> {
    let pointer: String = violation.path.iter().map(|key| format!("/{key}")).collect();
    let is_list = json.pointer(&pointer)?.as_array().is_some_and(|items| !items.is_empty());
    if !is_list || violation.at_key {
        return None;
    }
    let name = violation.path.join(".");
    Some(if place.file.name == overrides::SET {
        format!("it takes one value; `--matrix '{}'` runs a variant of each", place.file.text)
    } else {
        format!("it takes one value; `matrix: {{ STAGE.NODE.with.{name}: {} }}` runs a variant of each", place.text())
    })
}

/// Suggests an input for a parameter with the name of one.
fn as_input(kind: &KindInfo<'_>, violation: &Violation, json: &Json) -> Option<String> {
    let [name] = violation.path.as_slice() else { return None };
    if !violation.at_key {
        return None;
    }
    let port = kind.inputs.iter().find(|port| port.name == name.as_str())?;
    let value = match json.get(name).and_then(Json::as_str) {
        Some(text) if port.takes_file() && !text.is_empty() => format!("{{ file: {text} }}"),
        Some(text) if text.contains('/') && !port.takes_file() => text.to_owned(),
        _ => "NODE/OUTPUT".to_owned(),
    };
    Some(format!("`{name}` is an input: write `inputs: {{ {name}: {value} }}`"))
}

/// Of the parameters named in a message, the one that the variant changed.
fn culprit(with: Option<&Node>, message: &str, changed: &[Place]) -> Option<Place> {
    named(with, message).find(|place| changed.iter().any(|change| change.contains(place)))
}

fn named(with: Option<&Node>, message: &str) -> impl Iterator<Item = Place> {
    let words = |text: &str, word: &str| {
        text.split(|c: char| !c.is_alphanumeric() && !matches!(c, '_' | '-')).any(|found| found == word)
    };
    let entries = with.map_or(&[][..], Node::entries);
    entries.iter().filter(move |entry| words(message, &entry.key)).map(|entry| entry.value_place().clone())
}

/// The place of the longest part of a path that is written.
fn place_of(with: Option<&Node>, path: &[String], at_key: bool) -> Option<Place> {
    let mut node = with?;
    let mut place = None;
    for (i, step) in path.iter().enumerate() {
        let last = i + 1 == path.len();
        match &node.value {
            Tree::Map(_) => {
                let Some(entry) = node.entry(step) else { break };
                let empty = entry.value.is_null();
                place =
                    Some(if last && (at_key || empty) { entry.key_place.clone() } else { entry.value.place.clone() });
                node = &entry.value;
            }
            Tree::List(items) => {
                let Some(item) = step.parse::<usize>().ok().and_then(|index| items.get(index)) else { break };
                place = Some(item.place.clone());
                node = item;
            }
            Tree::Null | Tree::Bool(_) | Tree::Number(_) | Tree::Text(_) => break,
        }
    }
    place
}

/// Removes a parameter; for an item of a list the whole list, so that other items keep their places.
fn remove(json: &mut Json, path: &[String]) -> bool {
    let Some((first, rest)) = path.split_first() else { return false };
    match json {
        Json::Object(map) => {
            if let Some(inner) = map.get_mut(first)
                && !rest.is_empty()
                && remove(inner, rest)
            {
                return true;
            }
            map.shift_remove(first).is_some()
        }
        Json::Array(items) => match first.parse::<usize>().ok().and_then(|index| items.get_mut(index)) {
            Some(item @ Json::Object(_)) => !rest.is_empty() && remove(item, rest),
            _ => false,
        },
        Json::Null | Json::Bool(_) | Json::Number(_) | Json::String(_) => false,
    }
}

/// JSON with sorted keys: equal values give equal text.
pub(crate) fn canonical(value: &Json) -> String {
    fn sorted(value: &Json) -> Json {
        match value {
            Json::Object(map) => {
                let mut entries: Vec<_> = map.iter().collect();
                entries.sort_unstable_by(|a, b| a.0.cmp(b.0));
                Json::Object(entries.into_iter().map(|(key, value)| (key.clone(), sorted(value))).collect())
            }
            Json::Array(items) => Json::Array(items.iter().map(sorted).collect()),
            Json::Null | Json::Bool(_) | Json::Number(_) | Json::String(_) => value.clone(),
        }
    }
    sorted(value).to_string()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::{Contents, PathOf, changed_since, with_schema};

    #[test]
    fn a_file_that_changed_after_the_parameters_were_resolved_is_found_by_its_parameter() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("node.py");
        std::fs::write(&file, "1").expect("written");
        let schema = json!({ "properties": {
            "code": { "type": "array", "items": { "type": "string", "format": "code" } },
            "root": { "type": "string", "format": "path" },
            "params": { "type": "object" },
        } });
        let resolved = json!({ "code": [file, folder.path()], "root": folder.path(), "params": { "content": "x" } });
        let mut contents = Contents::default();
        let mut name = |path: &std::path::Path, of: PathOf| contents.portable_path(path, of);
        let portable = with_schema::with_paths(&resolved, &schema, &mut name);
        assert!(portable["code"][1]["content"].is_string() && portable["root"]["name"].is_string(), "{portable}");
        assert_eq!(changed_since(&portable, &resolved, &schema), None);
        std::fs::write(&file, "2").expect("written");
        assert_eq!(changed_since(&portable, &resolved, &schema).as_deref(), Some("code"));
        std::fs::write(&file, "1").expect("written");
        assert_eq!(changed_since(&portable, &resolved, &schema), None);
        std::fs::write(folder.path().join("more.py"), "1").expect("written");
        assert_eq!(changed_since(&portable, &resolved, &schema).as_deref(), Some("code"));
    }
}
