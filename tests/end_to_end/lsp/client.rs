//! A client of the language server that sends and receives messages one by one.

use std::io::{BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use serde_json::{Value as Json, json};

use crate::support::depthloom;

/// Longer than any response takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A conversation with the server.
pub(super) struct Client {
    child: Child,
    input: Option<ChildStdin>,
    messages: Receiver<Json>,
    /// Notifications that were not waited for yet.
    notifications: Vec<Json>,
    next: i64,
}

impl Client {
    /// Starts the server in a folder, without a word.
    pub(super) fn start(folder: &Path) -> Self {
        let mut command = depthloom();
        command.arg("lsp").current_dir(folder).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().expect("the server starts");
        let mut output = BufReader::new(child.stdout.take().expect("piped"));
        let (sender, messages) = channel();
        std::thread::spawn(move || {
            while let Some(message) = read(&mut output) {
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        Self { input: child.stdin.take(), child, messages, notifications: Vec::new(), next: 1 }
    }

    /// Starts the server and initializes it.
    pub(super) fn initialized(folder: &Path) -> Self {
        let mut client = Self::start(folder);
        let result = client.request("initialize", &json!({ "processId": null, "rootUri": null, "capabilities": {} }));
        assert_eq!(result["result"]["serverInfo"]["name"], "depthloom", "{result}");
        client.notify("initialized", &json!({}));
        client
    }

    /// Sends bytes as they are.
    pub(super) fn send_bytes(&mut self, bytes: &[u8]) {
        let input = self.input.as_mut().expect("open");
        input.write_all(bytes).and_then(|()| input.flush()).expect("the server reads");
    }

    fn send(&mut self, message: &Json) {
        let body = message.to_string();
        self.send_bytes(format!("Content-Length: {}\r\n\r\n{body}", body.len()).as_bytes());
    }

    pub(super) fn notify(&mut self, method: &str, params: &Json) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": params }));
    }

    /// Sends a request, and returns the response.
    pub(super) fn request(&mut self, method: &str, params: &Json) -> Json {
        let id = self.next;
        self.next += 1;
        self.send(&json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }));
        loop {
            let message = self.messages.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no response to {method}"));
            if message["id"] == id {
                return message;
            }
            self.notifications.push(message);
        }
    }

    /// The result of a request at a position of a document.
    pub(super) fn at(&mut self, method: &str, uri: &str, (line, character): (usize, usize)) -> Json {
        let position = json!({ "line": line, "character": character });
        let params = json!({ "textDocument": { "uri": uri }, "position": position });
        let response = self.request(&format!("textDocument/{method}"), &params);
        assert!(response.get("error").is_none(), "{method} at {line}:{character}: {response}");
        response["result"].clone()
    }

    /// The next notification of this method that matches.
    pub(super) fn notification(&mut self, method: &str, matches: impl Fn(&Json) -> bool) -> Json {
        let is_it = |message: &Json| message["method"] == method && matches(&message["params"]);
        if let Some(index) = self.notifications.iter().position(is_it) {
            return self.notifications.remove(index)["params"].clone();
        }
        loop {
            let message = self.messages.recv_timeout(PATIENCE).unwrap_or_else(|_| panic!("no {method}"));
            if is_it(&message) {
                return message["params"].clone();
            }
            self.notifications.push(message);
        }
    }

    /// Opens a document with its first version, and returns its diagnostics.
    pub(super) fn open(&mut self, uri: &str, text: &str) -> Vec<Json> {
        let document = json!({ "uri": uri, "languageId": "yaml", "version": 1, "text": text });
        self.notify("textDocument/didOpen", &json!({ "textDocument": document }));
        self.diagnostics(uri, 1)
    }

    /// Replaces the whole text of a document, and returns the diagnostics of that version.
    pub(super) fn replace(&mut self, uri: &str, version: i32, text: &str) -> Vec<Json> {
        let document = json!({ "uri": uri, "version": version });
        let changes = json!([{ "text": text }]);
        self.notify("textDocument/didChange", &json!({ "textDocument": document, "contentChanges": changes }));
        self.diagnostics(uri, version)
    }

    /// The diagnostics of a version of a document.
    pub(super) fn diagnostics(&mut self, uri: &str, version: i32) -> Vec<Json> {
        let is_it = |params: &Json| params["uri"] == uri && params["version"] == version;
        let params = self.notification("textDocument/publishDiagnostics", is_it);
        params["diagnostics"].as_array().expect("a list").clone()
    }

    /// Ends the conversation, and returns the exit code.
    pub(super) fn finish(mut self) -> i32 {
        let response = self.request("shutdown", &Json::Null);
        assert_eq!(response.get("result"), Some(&Json::Null), "{response}");
        self.notify("exit", &Json::Null);
        self.exit_code()
    }

    /// Closes the stream, and waits for the end of the server.
    pub(super) fn exit_code(mut self) -> i32 {
        drop(self.input.take());
        self.child.wait().expect("it ends").code().expect("an exit code")
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        // Only if a test failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn read(output: &mut impl std::io::BufRead) -> Option<Json> {
    let mut length = 0;
    loop {
        let mut line = String::new();
        if output.read_line(&mut line).ok()? == 0 {
            return None;
        }
        let line = line.trim();
        if line.is_empty() {
            break;
        }
        if let Some(value) = line.strip_prefix("Content-Length: ") {
            length = value.parse().expect("a number");
        }
    }
    let mut body = vec![0; length];
    output.read_exact(&mut body).ok()?;
    Some(serde_json::from_slice(&body).expect("JSON"))
}

/// The address of a file.
pub(super) fn uri(path: &Path) -> String {
    format!("file://{}", path.display())
}

/// Line and UTF-16 column of an offset.
pub(super) fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..offset];
    let start = before.rfind('\n').map_or(0, |at| at + 1);
    (before.matches('\n').count(), before[start..].encode_utf16().count())
}

/// The position of the first place where `words` are, `within` bytes further on.
pub(super) fn find(text: &str, words: &str, within: usize) -> (usize, usize) {
    position(text, text.find(words).unwrap_or_else(|| panic!("no {words}")) + within)
}

/// The byte offset of a position.
pub(super) fn offset(text: &str, position: &Json) -> usize {
    let (line, character) =
        (position["line"].as_u64().expect("a line"), position["character"].as_u64().expect("a column"));
    let start: usize = text.split_inclusive('\n').take(line as usize).map(str::len).sum();
    let mut units = 0;
    let rest = text[start..].char_indices();
    let before = rest.take_while(|(_, c)| {
        units += c.len_utf16() as u64;
        units <= character
    });
    start + before.map(|(_, c)| c.len_utf8()).sum::<usize>()
}

/// The words of a range.
pub(super) fn words<'t>(text: &'t str, range: &Json) -> &'t str {
    &text[offset(text, &range["start"])..offset(text, &range["end"])]
}

/// A text with the edits of one document applied.
pub(super) fn edited(text: &str, edits: &Json) -> String {
    let mut edits: Vec<&Json> = edits.as_array().expect("a list").iter().collect();
    edits.sort_by_key(|edit| std::cmp::Reverse(offset(text, &edit["range"]["start"])));
    let mut text = text.to_owned();
    for edit in edits {
        let range = offset(&text, &edit["range"]["start"])..offset(&text, &edit["range"]["end"]);
        text.replace_range(range, edit["newText"].as_str().expect("text"));
    }
    text
}
