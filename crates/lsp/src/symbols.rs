//! Names of stages, nodes, sources, variants and estimates, and every place that uses one.

use std::ops::Range;

use depthloom_graphs::language::{Entry, Node, Place, Reference, Tree};

use crate::view::View;

/// Keys of scores and estimates that are references.
pub(crate) const SCORE_REFERENCES: [&str; 8] =
    ["from", "ground_truth", "image", "occluded", "obj_map", "calibration", "deviation", "confidence"];

/// A name of the experiment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Symbol {
    Source(String),
    Stage(String),
    Node { stage: String, node: String },
    Estimate { stage: String, estimate: String },
    Variant(String),
}

impl Symbol {
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::Source(name) | Self::Stage(name) | Self::Variant(name) => name,
            Self::Node { node: name, .. } | Self::Estimate { estimate: name, .. } => name,
        }
    }

    /// What it is, with its article.
    pub(crate) const fn describe(&self) -> &'static str {
        match self {
            Self::Source(_) => "a source",
            Self::Stage(_) => "a stage",
            Self::Node { .. } => "a node",
            Self::Estimate { .. } => "an estimate",
            Self::Variant(_) => "a variant",
        }
    }

    /// The keys from the root of the merged experiment to its entry.
    pub(crate) fn keys(&self) -> Vec<&str> {
        match self {
            Self::Source(name) => vec!["sources", name],
            Self::Stage(name) => vec!["stages", name],
            Self::Variant(name) => vec!["variants", name],
            // The nodes of a graph file have no stage.
            Self::Node { stage, node } if stage.is_empty() => vec!["nodes", node],
            Self::Node { stage, node } => vec!["stages", stage, "nodes", node],
            Self::Estimate { stage, estimate } => vec!["stages", stage, "score", "estimates", estimate],
        }
    }
}

/// A place that uses a name.
#[derive(Clone, Debug)]
pub(crate) struct Occurrence {
    pub(crate) symbol: Symbol,
    pub(crate) place: Place,
    /// `source` in a reference: another word for the stage's source.
    pub(crate) is_alias: bool,
}

/// Every use of a name in the document's own file.
pub(crate) fn occurrences(view: &View<'_>) -> Vec<Occurrence> {
    let mut collector = Collector { view, found: Vec::new() };
    if let Some(own) = view.document.own() {
        if view.is_graph_file() {
            collector.visit(&["stages", ""], own);
        } else {
            collector.visit(&[], own);
        }
    }
    collector.found
}

/// The use of a name at an offset of the document's own file.
pub(crate) fn at(view: &View<'_>, offset: usize) -> Option<Occurrence> {
    let is_here = |found: &Occurrence| found.place.span.start <= offset && offset <= found.place.span.end;
    occurrences(view).into_iter().filter(is_here).min_by_key(|found| found.place.span.len())
}

struct Collector<'v, 's> {
    view: &'v View<'s>,
    found: Vec<Occurrence>,
}

impl Collector<'_, '_> {
    fn push(&mut self, symbol: Symbol, place: Place) {
        self.add(symbol, place, false);
    }

    /// An alias of YAML leads to the same place again.
    fn add(&mut self, symbol: Symbol, place: Place, is_alias: bool) {
        let is_same = |known: &Occurrence| known.place.span == place.span && known.symbol == symbol;
        if !self.found.iter().any(is_same) {
            self.found.push(Occurrence { symbol, place, is_alias });
        }
    }

    fn has(&self, symbol: &Symbol) -> bool {
        let mut keys = symbol.keys().into_iter();
        let root = self.view.root();
        root.and_then(|root| keys.try_fold(root, |node, key| node.get(key))).is_some()
    }

    fn known(&mut self, symbol: Symbol, place: Place) {
        if self.has(&symbol) {
            self.push(symbol, place);
        }
    }

    /// Visits a value that belongs at these keys of the experiment; also a value that a variant sets there.
    fn visit(&mut self, keys: &[&str], node: &Node) {
        match keys {
            ["stages", _, "source"] => self.source(node),
            ["stages", stage, "nodes", _, "inputs", _] => self.reference(stage, node),
            ["stages", stage, "score", key] if SCORE_REFERENCES.contains(key) => self.reference(stage, node),
            ["stages", stage, "score", "estimates", _] if node.text().is_some() => self.reference(stage, node),
            ["stages", stage, "score", "estimates", _, key] if SCORE_REFERENCES.contains(key) => {
                self.reference(stage, node);
            }
            ["variants", _] => node.entries().iter().for_each(|entry| self.change(entry)),
            ["matrix"] => match &node.value {
                Tree::List(matrices) => matrices.iter().for_each(|matrix| self.matrix(matrix)),
                _ => self.matrix(node),
            },
            ["only"] => scalars(node).for_each(|name| self.selected(name)),
            ["labels", section] => node.entries().iter().for_each(|entry| self.labelled(section, entry)),
            ["record"] => self.patterns(node),
            ["record", "topics" | "points"] => self.patterns(node),
            _ => {
                for entry in node.entries() {
                    self.defined(keys, entry);
                    let keys: Vec<&str> = keys.iter().copied().chain([entry.key.as_str()]).collect();
                    self.visit(&keys, &entry.value);
                }
            }
        }
    }

    /// An entry whose key is a name.
    fn defined(&mut self, keys: &[&str], entry: &Entry) {
        let name = entry.key.clone();
        let symbol = match keys {
            ["sources"] => Symbol::Source(name),
            ["stages"] => Symbol::Stage(name),
            ["stages", _, "nodes"] if name == "graph" => return,
            ["stages", stage, "nodes"] => Symbol::Node { stage: (*stage).to_owned(), node: name },
            ["stages", stage, "score", "estimates"] => Symbol::Estimate { stage: (*stage).to_owned(), estimate: name },
            ["variants"] => Symbol::Variant(name),
            _ => return,
        };
        self.push(symbol, entry.key_place.clone());
    }

    fn source(&mut self, node: &Node) {
        if let Some(name) = node.scalar_text() {
            self.push(Symbol::Source(name.clone()), node.place.part(&name, 0..name.len()));
        }
    }

    fn reference(&mut self, stage: &str, node: &Node) {
        let Some(Ok(reference)) = node.text().map(|text| Reference::parse(text, &node.place)) else { return };
        let other = reference.stage.as_ref().map_or(stage, |word| word.text.as_str()).to_owned();
        if let Some(word) = &reference.stage {
            self.push(Symbol::Stage(word.text.clone()), word.place.clone());
        }
        if reference.node.text == "source" {
            let source = self.view.stage(&other).and_then(|stage| stage.get("source")?.scalar_text());
            if let Some(source) = source {
                self.add(Symbol::Source(source), reference.node.place, true);
            }
            return;
        }
        self.push(Symbol::Node { stage: other, node: reference.node.text }, reference.node.place);
    }

    /// A path, and the value that it sets.
    fn change(&mut self, entry: &Entry) {
        self.path(&entry.key, &entry.key_place);
        if let Some(keys) = self.view.document.keys_of_change(&entry.key) {
            let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
            self.visit(&keys, &entry.value);
        }
    }

    /// The names in `stage.node.with.x`, `sources.name.with.x` or `stage.score.estimates.name.x`.
    fn path(&mut self, path: &str, place: &Place) {
        let mut start = 0;
        let words: Vec<(&str, Range<usize>)> = path
            .split('.')
            .map(|word| {
                let range = start..start + word.len();
                start = range.end + 1;
                (word, range)
            })
            .collect();
        let at = |index: usize| place.part(path, words[index].1.clone());
        let texts: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        match texts.as_slice() {
            ["sources", source, ..] => self.known(Symbol::Source((*source).to_owned()), at(1)),
            [stage, rest @ ..] => {
                let stage = (*stage).to_owned();
                self.known(Symbol::Stage(stage.clone()), at(0));
                match rest {
                    ["score", "estimates", name, ..] => {
                        self.known(Symbol::Estimate { stage, estimate: (*name).to_owned() }, at(3));
                    }
                    [node, ..] => self.known(Symbol::Node { stage, node: (*node).to_owned() }, at(1)),
                    [] => {}
                }
            }
            [] => {}
        }
    }

    fn matrix(&mut self, matrix: &Node) {
        for entry in matrix.entries() {
            match (entry.key.as_str(), &entry.value.value) {
                ("include" | "exclude", Tree::List(choices)) => {
                    choices.iter().for_each(|choice| self.condition(choice));
                }
                ("sample", _) => {}
                _ => self.axis(entry),
            }
        }
    }

    fn axis(&mut self, entry: &Entry) {
        let mut paths = vec![(entry.key.clone(), entry.key_place.clone())];
        if let Some(named) = entry.value.get("paths") {
            paths.extend(scalars(named).filter_map(|path| Some((path.scalar_text()?, path.place.clone()))));
        }
        for (path, place) in &paths {
            self.path(path, place);
        }
        if let Some(when) = entry.value.get("when") {
            self.condition(when);
        }
        let values = entry.value.get("values").unwrap_or(&entry.value);
        let located = paths.iter().find_map(|(path, _)| self.view.document.keys_of_change(path));
        match (&values.value, located) {
            (Tree::List(items), Some(keys)) => {
                let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
                items.iter().for_each(|item| self.visit(&keys, item));
            }
            (Tree::Map(named), Some(keys)) if entry.value.get("values").is_some() => {
                let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
                named.iter().for_each(|value| self.visit(&keys, &value.value));
            }
            (Tree::Map(named), None) => {
                named.iter().for_each(|changes| changes.value.entries().iter().for_each(|entry| self.change(entry)));
            }
            _ => {}
        }
    }

    /// Paths and axes with their values: of `when`, `include` and `exclude`.
    fn condition(&mut self, condition: &Node) {
        for entry in condition.entries() {
            self.path(&entry.key, &entry.key_place);
        }
    }

    /// The name of a variant, or of a combination that begins with it.
    fn selected(&mut self, name: &Node) {
        let Some(text) = name.scalar_text() else { return };
        let variant = text.split('+').next().unwrap_or_default().to_owned();
        let place = name.place.part(&text, 0..variant.len());
        self.known(Symbol::Variant(variant), place);
    }

    /// A key of `labels`: a variant, or an estimate. An estimate that several stages have stays.
    fn labelled(&mut self, section: &str, entry: &Entry) {
        let name = entry.key.as_str();
        match section {
            "variants" => {
                let variant = name.split('+').next().unwrap_or_default();
                let place = entry.key_place.part(name, 0..variant.len());
                self.known(Symbol::Variant(variant.to_owned()), place);
            }
            "estimates" => {
                let has_it = |stage: &&Entry| {
                    let estimates = stage.value.get("score").and_then(|score| score.get("estimates"));
                    estimates.is_some_and(|estimates| estimates.get(name).is_some())
                };
                let stages = self.view.root().and_then(|root| root.get("stages")).map_or(&[][..], |all| all.entries());
                let stages: Vec<&str> = stages.iter().filter(has_it).map(|stage| stage.key.as_str()).collect();
                if let [stage] = stages.as_slice() {
                    let symbol = Symbol::Estimate { stage: (*stage).to_owned(), estimate: name.to_owned() };
                    self.push(symbol, entry.key_place.clone());
                }
            }
            _ => {}
        }
    }

    fn patterns(&mut self, node: &Node) {
        if node.entries().is_empty() {
            scalars(node).for_each(|pattern| self.pattern(pattern));
        } else {
            for entry in node.entries().iter().filter(|entry| matches!(entry.key.as_str(), "topics" | "points")) {
                scalars(&entry.value).for_each(|pattern| self.pattern(pattern));
            }
        }
    }

    /// `[stage.]node[/port]` or `/stage[/node[/port]]`. A node that several stages have stays.
    fn pattern(&mut self, pattern: &Node) {
        let Some(text) = pattern.text() else { return };
        let from = text.len() - text.trim_start_matches('!').len();
        let word = |start: usize, ends: &[char]| {
            let length = text[start..].find(ends).unwrap_or(text.len() - start);
            (text[start..start + length].to_owned(), pattern.place.part(text, start..start + length), start + length)
        };
        if text[from..].starts_with('/') {
            let (stage, place, end) = word(from + 1, &['/']);
            self.known(Symbol::Stage(stage.clone()), place);
            if end < text.len() {
                let (node, place, _) = word(end + 1, &['/']);
                self.known(Symbol::Node { stage, node }, place);
            }
            return;
        }
        let (first, place, end) = word(from, &['.', '/']);
        if text[end..].starts_with('.') {
            self.known(Symbol::Stage(first.clone()), place);
            let (node, place, _) = word(end + 1, &['/']);
            self.known(Symbol::Node { stage: first, node }, place);
            return;
        }
        let stages = self.view.root().and_then(|root| root.get("stages"));
        let has_it = |stage: &&Entry| stage.value.get("nodes").is_some_and(|nodes| nodes.get(&first).is_some());
        let stages: Vec<&str> = stages
            .map(|stages| stages.entries().iter().filter(has_it).map(|stage| stage.key.as_str()).collect())
            .unwrap_or_default();
        if let [stage] = stages.as_slice() {
            let stage = (*stage).to_owned();
            self.push(Symbol::Node { stage, node: first }, place);
        }
    }
}

/// A scalar, or the scalars of a list.
fn scalars(node: &Node) -> impl Iterator<Item = &Node> {
    let (one, items) = match &node.value {
        Tree::List(items) => (None, items.as_slice()),
        _ => (Some(node), &[][..]),
    };
    one.into_iter().chain(items.iter().map(|item| &**item))
}
