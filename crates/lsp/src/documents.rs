//! The documents that are open in the editor.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gen_lsp_types::{TextDocumentContentChangeEvent, Uri};

use crate::{positions, uris};

/// Open documents by path.
#[derive(Clone, Debug, Default)]
pub(crate) struct Documents(BTreeMap<PathBuf, Arc<Document>>);

/// An open document.
#[derive(Clone, Debug)]
pub(crate) struct Document {
    pub(crate) uri: Uri,
    pub(crate) version: i32,
    pub(crate) text: String,
}

impl Documents {
    pub(crate) fn open(&mut self, uri: Uri, version: i32, text: String) {
        self.0.insert(uris::path(&uri), Arc::new(Document { uri, version, text }));
    }

    pub(crate) fn close(&mut self, uri: &Uri) {
        self.0.remove(&uris::path(uri));
    }

    /// Applies changes in order; each is of the text after those before it.
    pub(crate) fn change(&mut self, uri: &Uri, version: i32, changes: Vec<TextDocumentContentChangeEvent>) {
        let Some(document) = self.0.get_mut(&uris::path(uri)) else { return };
        let document = Arc::make_mut(document);
        document.version = version;
        for change in changes {
            match change {
                TextDocumentContentChangeEvent::TextDocumentContentChangePartial(change) => {
                    let span = positions::span(&document.text, change.range);
                    document.text.replace_range(span, &change.text);
                }
                TextDocumentContentChangeEvent::TextDocumentContentChangeWholeDocument(change) => {
                    document.text = change.text;
                }
            }
        }
    }

    pub(crate) fn get(&self, path: &Path) -> Option<&Document> {
        self.0.get(path).map(|document| &**document)
    }

    pub(crate) fn paths(&self) -> impl Iterator<Item = &Path> {
        self.0.keys().map(PathBuf::as_path)
    }

    /// A document with its own path.
    pub(crate) fn entry(&self, path: &Path) -> Option<(&PathBuf, &Document)> {
        self.0.get_key_value(path).map(|(path, document)| (path, &**document))
    }

    pub(crate) fn texts(&self) -> Vec<(PathBuf, String)> {
        self.0.iter().map(|(path, document)| (path.clone(), document.text.clone())).collect()
    }

    /// The address of a file: as the editor writes it, if the file is open.
    pub(crate) fn uri(&self, path: &Path) -> Uri {
        self.get(path).map_or_else(|| uris::uri(path), |document| document.uri.clone())
    }

    pub(crate) fn version(&self, path: &Path) -> Option<i32> {
        self.get(path).map(|document| document.version)
    }
}

#[cfg(test)]
mod tests {
    use gen_lsp_types::{
        Position, Range, TextDocumentContentChangeEvent as Change, TextDocumentContentChangePartial, Uri,
    };

    use super::Documents;
    use crate::uris;

    #[test]
    fn changes_are_applied_in_order() {
        let uri = Uri("file:///a.yaml".to_owned());
        let mut documents = Documents::default();
        documents.open(uri.clone(), 1, "a: ä𝄞\nb: 2\n".to_owned());
        let at = |line, character| Position { line, character };
        let partial = |start, end, text: &str| {
            let (range, text) = (Range { start, end }, text.to_owned());
            Change::TextDocumentContentChangePartial(TextDocumentContentChangePartial {
                range,
                text,
                ..Default::default()
            })
        };
        let changes = vec![
            partial(at(0, 4), at(0, 6), "x"),
            partial(at(0, 5), at(0, 5), "y\n"),
            partial(at(2, 3), at(2, 4), "3"),
        ];
        documents.change(&uri, 2, changes);
        let document = documents.get(&uris::path(&uri)).expect("it is open");
        assert_eq!((document.text.as_str(), document.version), ("a: äxy\n\nb: 3\n", 2));
    }
}
