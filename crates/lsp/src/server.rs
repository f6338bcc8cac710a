//! Receives messages and answers them.

use std::io::{self, BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, unbounded};
use depthloom_graphs::{Registry, language};
use depthloom_threads::{caught, locked};
use gen_lsp_types::{
    CompletionList, CompletionOptions, CompletionParams, Contents, DefinitionParams, DefinitionProvider,
    DidChangeTextDocumentParams, DidCloseTextDocumentParams, DidOpenTextDocumentParams, DocumentHighlight,
    DocumentHighlightParams, DocumentHighlightProvider, DocumentSymbolParams, DocumentSymbolProvider, Hover,
    HoverParams, HoverProvider, InitializeResult, LogMessageParams, MarkupContent, MarkupKind, MessageType,
    PositionEncodingKind, PrepareRenameParams, ReferenceParams, ReferencesProvider, RenameOptions, RenameParams,
    RenameProvider, Save, ServerCapabilities, ServerInfo, TextDocumentPositionParams, TextDocumentSync,
    TextDocumentSyncKind, TextDocumentSyncOptions, Uri,
};
use lsp_server::{ErrorCode, Message, Notification, Request, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use crate::checks::{self, Results};
use crate::completion;
use crate::cursor::{Cursor, cursor};
use crate::documents::Documents;
use crate::navigation;
use crate::outline;
use crate::positions;
use crate::reuse::{self, Lookups, Reuse};
use crate::symbols::Symbol;
use crate::transport::{self, Incoming};
use crate::uris;
use crate::view::{self, View};
use crate::{hover, symbols};

/// Serves one client until it says `exit` or closes its stream. Returns whether it said `shutdown` before, or never
/// began.
///
/// `reuse` is called on a hover over a node. If it is still busy at the end, the process ends with it.
pub fn serve(
    registry: &Registry,
    input: impl BufRead + Send + 'static,
    output: impl Write + Send,
    reuse: &Reuse<'_>,
) -> bool {
    let results = Results::default();
    let (incoming_sender, incoming) = unbounded();
    let (client, outgoing) = unbounded();
    let (states, changed) = unbounded();
    let (lookups, worker) = reuse::lookups();
    // It may wait for the client without end, so the server does not wait for it.
    std::thread::spawn(move || receive(input, &incoming_sender));
    std::thread::scope(|scope| {
        let writer = scope.spawn(move || send(&outgoing, output));
        let checker = client.clone();
        scope.spawn(|| checks::run(changed, registry, &results, checker));
        scope.spawn(move || worker.run(reuse));
        let mut server = Server {
            registry,
            schema: language::schema(registry),
            documents: Documents::default(),
            results: &results,
            client,
            states,
            lookups,
            phase: Phase::New,
        };
        server.run(&incoming);
        let (is_orderly, is_busy) = (server.phase != Phase::Ready, server.lookups.is_busy());
        drop(server);
        if is_busy {
            // Opening sources may take long, and the result is not needed.
            std::process::exit(i32::from(!is_orderly));
        }
        // Only once all senders are gone: also the thread that checks.
        let _ = writer.join();
        is_orderly
    })
}

fn receive(mut input: impl BufRead, messages: &Sender<Incoming>) {
    while let Ok(Some(message)) = transport::read(&mut input) {
        if messages.send(message).is_err() {
            return;
        }
    }
}

/// Ends at the first message that cannot be written; the server then ends as well.
fn send(messages: &Receiver<Message>, mut output: impl Write) -> io::Result<()> {
    messages.iter().try_for_each(|message| message.write(&mut output))
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    New,
    Ready,
    ShutDown,
}

struct Server<'a> {
    registry: &'a Registry,
    schema: Json,
    documents: Documents,
    results: &'a Results,
    client: Sender<Message>,
    states: Sender<Documents>,
    lookups: Lookups,
    phase: Phase,
}

/// Why a request has no result.
struct Failure {
    code: ErrorCode,
    message: String,
}

impl Failure {
    fn new(code: ErrorCode, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}

fn parsed<P: DeserializeOwned>(params: Json) -> Result<P, Failure> {
    serde_json::from_value(params)
        .map_err(|error| Failure::new(ErrorCode::InvalidParams, format!("invalid parameters: {error}")))
}

fn json(value: impl Serialize) -> Result<Json, Failure> {
    serde_json::to_value(value).map_err(|error| Failure::new(ErrorCode::InternalError, error.to_string()))
}

impl Server<'_> {
    fn run(&mut self, incoming: &Receiver<Incoming>) {
        for message in incoming {
            let is_sent = match message {
                Incoming::Message(Message::Notification(notification)) if notification.method == "exit" => return,
                Incoming::Message(Message::Request(request)) => {
                    let response = self.respond(request);
                    self.client.send(response.into()).is_ok()
                }
                Incoming::Message(Message::Notification(notification)) => {
                    let method = notification.method.clone();
                    let handled = caught(|| self.notified(notification));
                    match handled {
                        Ok(Ok(())) => true,
                        Ok(Err(failure)) => self.log(format!("{method}: {}", failure.message)),
                        Err(panic) => self.log(format!("{method}: an error of depthloom: {}", panic.0)),
                    }
                }
                // The server sends no requests.
                Incoming::Message(Message::Response(_)) => true,
                Incoming::Broken(what) => self.log(format!("the client sent {what}")),
            };
            if !is_sent {
                return;
            }
        }
    }

    fn log(&self, message: String) -> bool {
        let params = LogMessageParams { kind: MessageType::Error, message };
        self.client.send(Notification::new("window/logMessage".to_owned(), params).into()).is_ok()
    }

    fn respond(&mut self, request: Request) -> Response {
        let Request { id, method, params } = request;
        let outcome = caught(|| self.result(&method, params)).unwrap_or_else(|panic| {
            let what = format!("`{method}` failed, which is an error of depthloom: {}", panic.0);
            Err(Failure::new(ErrorCode::InternalError, what))
        });
        match outcome {
            Ok(result) => Response { id, response_result: Ok(result) },
            Err(failure) => Response::new_err(id, failure.code as i32, failure.message),
        }
    }

    fn notified(&mut self, notification: Notification) -> Result<(), Failure> {
        if self.phase != Phase::Ready {
            return Ok(());
        }
        match notification.method.as_str() {
            "textDocument/didOpen" => {
                let opened = parsed::<DidOpenTextDocumentParams>(notification.params)?.text_document;
                self.documents.open(opened.uri, opened.version, opened.text);
            }
            "textDocument/didChange" => {
                let changed: DidChangeTextDocumentParams = parsed(notification.params)?;
                let uri = changed.text_document.text_document_identifier.uri;
                self.documents.change(&uri, changed.text_document.version, changed.content_changes);
            }
            "textDocument/didClose" => {
                let closed: DidCloseTextDocumentParams = parsed(notification.params)?;
                self.documents.close(&closed.text_document.uri);
            }
            // Another file that documents read may have changed.
            "textDocument/didSave" | "workspace/didChangeWatchedFiles" => {}
            _ => return Ok(()),
        }
        // The thread ends after the server only.
        let _ = self.states.send(self.documents.clone());
        Ok(())
    }

    fn result(&mut self, method: &str, params: Json) -> Result<Json, Failure> {
        match (method, self.phase) {
            ("initialize", Phase::New) => {
                self.phase = Phase::Ready;
                return json(initialized());
            }
            (_, Phase::New) => {
                return Err(Failure::new(ErrorCode::ServerNotInitialized, "the first request must be `initialize`"));
            }
            ("initialize", _) => {
                return Err(Failure::new(ErrorCode::InvalidRequest, "`initialize` was already sent"));
            }
            (_, Phase::ShutDown) => {
                return Err(Failure::new(ErrorCode::InvalidRequest, "the server was shut down"));
            }
            (_, Phase::Ready) => {}
        }
        match method {
            "shutdown" => {
                self.phase = Phase::ShutDown;
                Ok(Json::Null)
            }
            "textDocument/completion" => {
                self.complete(&parsed::<CompletionParams>(params)?.text_document_position_params)
            }
            "textDocument/hover" => self.hover(&parsed::<HoverParams>(params)?.text_document_position_params),
            "textDocument/definition" => {
                self.define(&parsed::<DefinitionParams>(params)?.text_document_position_params)
            }
            "textDocument/references" => {
                let place = parsed::<ReferenceParams>(params)?.text_document_position_params;
                let uri = place.text_document.uri.clone();
                let (view, offset) = self.view_at(&place)?;
                let uses = navigation::uses(&view, offset);
                json(uses.iter().map(|place| navigation::location(place, uri.clone())).collect::<Vec<_>>())
            }
            "textDocument/documentHighlight" => {
                let place = parsed::<DocumentHighlightParams>(params)?.text_document_position_params;
                let (view, offset) = self.view_at(&place)?;
                let range = |place: &language::Place| positions::range(view.text, &place.span);
                let uses = navigation::uses(&view, offset);
                json(uses.iter().map(|use_| DocumentHighlight { range: range(use_), kind: None }).collect::<Vec<_>>())
            }
            "textDocument/prepareRename" => {
                let place = parsed::<PrepareRenameParams>(params)?.text_document_position_params;
                let (view, offset) = self.view_at(&place)?;
                let refused = |what| Failure::new(ErrorCode::RequestFailed, what);
                json(navigation::prepare_rename(&view, offset).map_err(refused)?)
            }
            "textDocument/rename" => {
                let RenameParams { new_name, text_document_position_params: place, .. } = parsed(params)?;
                let (view, offset) = self.view_at(&place)?;
                let refused = |what| Failure::new(ErrorCode::RequestFailed, what);
                let texts = self.documents.texts();
                let others = self.documents.paths().filter(|path| *path != view.path);
                let others = others.map(|path| self.view(path, view::read(path, &texts)));
                let others = others.collect::<Result<Vec<_>, _>>()?;
                json(navigation::rename(&view, &others, offset, &new_name).map_err(refused)?)
            }
            "textDocument/documentSymbol" => {
                let uri = parsed::<DocumentSymbolParams>(params)?.text_document.uri;
                let (path, texts) = self.texts(&uri)?;
                let view = self.view(&path, view::read(&path, &texts))?;
                json(outline::symbols(&view))
            }
            other => Err(Failure::new(ErrorCode::MethodNotFound, format!("the server does not know `{other}`"))),
        }
    }

    /// The path of an open document, and the texts of all.
    fn texts(&self, uri: &Uri) -> Result<(PathBuf, Vec<(PathBuf, String)>), Failure> {
        let path = uris::path(uri);
        match self.documents.get(&path) {
            Some(_) => Ok((path, self.documents.texts())),
            None => Err(Failure::new(ErrorCode::InvalidParams, format!("the document {} is not open", uri.0))),
        }
    }

    fn view<'v>(&'v self, path: &'v Path, document: language::Document) -> Result<View<'v>, Failure> {
        let open = self.documents.get(path);
        let open = open.ok_or_else(|| Failure::new(ErrorCode::InvalidParams, "the document is not open"))?;
        let loaded = locked(&self.results.plans).get(path).cloned();
        let (registry, schema) = (self.registry, &self.schema);
        Ok(View { registry, schema, path, uri: &open.uri, text: &open.text, document, loaded })
    }

    /// A document, and the offset of a position in it.
    fn view_at<'v>(&'v self, place: &TextDocumentPositionParams) -> Result<(View<'v>, usize), Failure> {
        let (path, texts) = self.texts(&place.text_document.uri)?;
        let document = view::read(&path, &texts);
        let (path, open) =
            self.documents.entry(&path).ok_or_else(|| Failure::new(ErrorCode::InvalidParams, "not open"))?;
        let offset = positions::offset(&open.text, place.position);
        Ok((self.view(path, document)?, offset))
    }

    /// The document, also if it is incomplete at the cursor. `None` where nothing is expected.
    fn view_at_cursor<'v>(
        &'v self,
        place: &TextDocumentPositionParams,
    ) -> Result<Option<(View<'v>, Cursor, usize)>, Failure> {
        let (path, texts) = self.texts(&place.text_document.uri)?;
        let (path, open) =
            self.documents.entry(&path).ok_or_else(|| Failure::new(ErrorCode::InvalidParams, "not open"))?;
        let offset = positions::offset(&open.text, place.position);
        let Some(cursor) = cursor(&open.text, offset) else { return Ok(None) };
        let last_good = locked(&self.results.readable).get(path).cloned();
        let document = view::read_incomplete(path, &texts, &cursor, last_good.as_deref());
        Ok(Some((self.view(path, document)?, cursor, offset)))
    }

    fn complete(&self, place: &TextDocumentPositionParams) -> Result<Json, Failure> {
        match self.view_at_cursor(place)? {
            Some((view, cursor, _)) => json(completion::complete(&view, &cursor)),
            None => json(CompletionList::default()),
        }
    }

    fn hover(&self, place: &TextDocumentPositionParams) -> Result<Json, Failure> {
        let Some((view, cursor, offset)) = self.view_at_cursor(place)? else { return Ok(Json::Null) };
        let Some((mut value, node)) = hover::text(&view, &cursor, offset) else { return Ok(Json::Null) };
        if let (Some(Symbol::Node { stage, node }), Some(loaded)) = (node, &view.loaded) {
            value.push_str("\n\n");
            value.push_str(&self.lookups.text(view.path.to_owned(), Arc::clone(loaded), &stage, &node));
        }
        let at = symbols::at(&view, offset).map_or(cursor.word, |occurrence| occurrence.place.span);
        let contents = Contents::MarkupContent(MarkupContent { kind: MarkupKind::Markdown, value });
        json(Hover { contents, range: Some(positions::range(view.text, &at)) })
    }

    fn define(&self, place: &TextDocumentPositionParams) -> Result<Json, Failure> {
        let (view, offset) = self.view_at(place)?;
        let Some(place) = navigation::definition(&view, offset) else { return Ok(Json::Null) };
        let uri = self.documents.uri(Path::new(&place.file.name));
        json(navigation::location(&place, uri))
    }
}

/// What the server offers.
fn initialized() -> InitializeResult {
    let sync = TextDocumentSyncOptions {
        open_close: Some(true),
        change: Some(TextDocumentSyncKind::Incremental),
        save: Some(Save::Bool(true)),
        ..TextDocumentSyncOptions::default()
    };
    let triggers = [" ", "/", ".", "{", "[", ","].map(ToOwned::to_owned);
    InitializeResult {
        capabilities: ServerCapabilities {
            position_encoding: Some(PositionEncodingKind::UTF16),
            text_document_sync: Some(TextDocumentSync::Options(sync)),
            completion_provider: Some(CompletionOptions {
                trigger_characters: Some(triggers.into()),
                ..CompletionOptions::default()
            }),
            hover_provider: Some(HoverProvider::Bool(true)),
            definition_provider: Some(DefinitionProvider::Bool(true)),
            references_provider: Some(ReferencesProvider::Bool(true)),
            document_highlight_provider: Some(DocumentHighlightProvider::Bool(true)),
            document_symbol_provider: Some(DocumentSymbolProvider::Bool(true)),
            rename_provider: Some(RenameProvider::RenameOptions(RenameOptions {
                prepare_provider: Some(true),
                ..RenameOptions::default()
            })),
            ..ServerCapabilities::default()
        },
        server_info: Some(ServerInfo {
            name: "depthloom".to_owned(),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        }),
    }
}

#[cfg(test)]
mod tests;
