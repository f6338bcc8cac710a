//! Checks of open documents while they are edited, on a thread of their own.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use crossbeam::channel::{Receiver, Sender};
use depthloom_graphs::Registry;
use depthloom_graphs::language::{self, Diagnostics, Loaded, Options, Place, Severity};
use depthloom_threads::{caught, locked};
use gen_lsp_types::{
    Diagnostic, DiagnosticRelatedInformation, DiagnosticSeverity, Location, LogMessageParams, Message as Text,
    MessageType, PublishDiagnosticsParams,
};
use lsp_server::{Message, Notification};

use crate::documents::Documents;
use crate::{positions, view};

/// What is known of each document.
#[derive(Default)]
pub(crate) struct Results {
    /// Its last plan.
    pub(crate) plans: Mutex<BTreeMap<PathBuf, Arc<Loaded>>>,
    /// Its last text that was YAML.
    pub(crate) readable: Mutex<BTreeMap<PathBuf, String>>,
}

/// Checks every state of the documents that is sent, or only the newest of several.
#[expect(clippy::needless_pass_by_value, reason = "the client's stream ends when no thread can send to it")]
pub(crate) fn run(states: Receiver<Documents>, registry: &Registry, results: &Results, client: Sender<Message>) {
    let mut published = BTreeSet::new();
    while let Ok(mut documents) = states.recv() {
        while let Ok(newer) = states.try_recv() {
            documents = newer;
        }
        let found = match caught(|| by_file(&documents, registry, results)) {
            Ok(found) => found,
            Err(panic) => {
                let message = format!("the check failed, which is an error of depthloom: {}", panic.0);
                let params = LogMessageParams { kind: MessageType::Error, message };
                let _ = client.send(Notification::new("window/logMessage".to_owned(), params).into());
                continue;
            }
        };
        let mut now = BTreeSet::new();
        for (path, diagnostics) in &found {
            now.insert(path.clone());
            publish(&documents, path, diagnostics.clone(), &client);
        }
        // Files that no document names any more.
        for path in published.difference(&now) {
            publish(&documents, path, Vec::new(), &client);
        }
        published = now;
    }
}

fn publish(documents: &Documents, path: &Path, diagnostics: Vec<Diagnostic>, client: &Sender<Message>) {
    let (uri, version) = (documents.uri(path), documents.version(path));
    let params = PublishDiagnosticsParams { uri, version, diagnostics };
    // If the client is gone, the server ends.
    let _ = client.send(Notification::new("textDocument/publishDiagnostics".to_owned(), params).into());
}

/// The diagnostics of every open document and of every other file that has some.
fn by_file(documents: &Documents, registry: &Registry, results: &Results) -> BTreeMap<PathBuf, Vec<Diagnostic>> {
    let texts = documents.texts();
    let mut found: BTreeMap<PathBuf, Vec<Diagnostic>> = BTreeMap::new();
    // Closed documents are forgotten.
    locked(&results.plans).retain(|path, _| documents.get(path).is_some());
    locked(&results.readable).retain(|path, _| documents.get(path).is_some());
    for (path, text) in &texts {
        found.entry(path.clone()).or_default();
        let document = view::read(path, &texts);
        if document.own().is_some() {
            locked(&results.readable).insert(path.clone(), text.clone());
        }
        let diagnostics = match checked(path, &texts, &document, registry) {
            Ok(loaded) => {
                let warnings = loaded.warnings.clone();
                locked(&results.plans).insert(path.clone(), Arc::new(loaded));
                warnings
            }
            Err(diagnostics) => diagnostics,
        };
        for diagnostic in &diagnostics {
            let file = PathBuf::from(&diagnostic.place.file.name);
            let list = found.entry(file).or_default();
            let converted = convert(documents, diagnostic);
            // Two documents may lead to the same error of a file that both extend.
            if !list.contains(&converted) {
                list.push(converted);
            }
        }
    }
    found
}

/// Checks a document as `depthloom check` does. A graph file is checked by the experiments that use it; by itself only
/// whether it is YAML.
fn checked(
    path: &Path,
    texts: &[(PathBuf, String)],
    document: &language::Document,
    registry: &Registry,
) -> Result<Loaded, Diagnostics> {
    let open_texts = texts.to_vec();
    let options = Options { open_texts, env: Box::new(view::variable), ..Options::default() };
    let checked = caught(|| language::load(path, registry, &options));
    let found = match checked {
        Ok(Ok(loaded)) => return Ok(loaded),
        Ok(Err(found)) => found,
        Err(panic) => {
            let file = Arc::new(language::SourceFile::new(path.to_string_lossy(), "", ""));
            let what = format!("the check failed, which is an error of depthloom: {}", panic.0);
            Diagnostics(vec![language::Diagnostic::error(&Place::start_of(&file), what)])
        }
    };
    let is_graph_file = document.own().is_some_and(|own| own.get("nodes").is_some() && own.get("stages").is_none());
    Err(if is_graph_file { Diagnostics::default() } else { found })
}

fn convert(documents: &Documents, found: &language::Diagnostic) -> Diagnostic {
    let severity = match found.severity {
        Severity::Error => DiagnosticSeverity::Error,
        Severity::Warning => DiagnosticSeverity::Warning,
    };
    let message = match &found.help {
        Some(help) => format!("{}\nhelp: {help}", found.message),
        None => found.message.clone(),
    };
    let related = found.related.as_ref().map(|related| DiagnosticRelatedInformation {
        location: location(documents, &related.place),
        message: related.label.clone(),
    });
    Diagnostic {
        range: positions::range(&found.place.file.text, &found.place.span),
        severity: Some(severity),
        source: Some("depthloom".to_owned()),
        message: Text::String(message),
        related_information: related.map(|related| vec![related]),
        ..Diagnostic::default()
    }
}

fn location(documents: &Documents, place: &Place) -> Location {
    let uri = documents.uri(Path::new(&place.file.name));
    Location { uri, range: positions::range(&place.file.text, &place.span) }
}
