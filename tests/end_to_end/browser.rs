//! Headless Chromium, controlled over its DevTools protocol: JSON through two pipes, with a zero after each message.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::Duration;

use serde_json::{Value as Json, json};

/// Longest time for a reply, on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// A browser with one page.
pub(crate) struct Browser {
    child: Child,
    to: ChildStdin,
    from: Receiver<Json>,
    session: Option<String>,
    number: u64,
    events: Vec<Json>,
    _profile: tempfile::TempDir,
}

impl Browser {
    /// Starts the browser with a new profile.
    pub(crate) fn start(program: &Path) -> Self {
        let profile = tempfile::tempdir().expect("a folder");
        // Chromium reads from descriptor 3 and writes to 4.
        let mut command = Command::new("sh");
        command.args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1"]).arg(program);
        command.args(["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"]);
        command.args(["--disable-background-networking", "--remote-debugging-pipe", "--window-size=1300,1000"]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg("about:blank");
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the browser starts");
        let (to, out) = (child.stdin.take().expect("piped"), child.stdout.take().expect("piped"));
        let (send, from) = channel();
        thread::spawn(move || {
            for message in BufReader::new(out).split(0) {
                let Ok(message) = message else { break };
                let Ok(message) = serde_json::from_slice(&message) else { continue };
                if send.send(message).is_err() {
                    break;
                }
            }
        });
        let mut browser = Self { child, to, from, session: None, number: 0, events: Vec::new(), _profile: profile };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let attached = json!({ "targetId": target["targetId"], "flatten": true });
        browser.session = browser.call("Target.attachToTarget", &attached)["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), &json!({}));
        }
        browser
    }

    fn next(&mut self) -> Json {
        self.from.recv_timeout(PATIENCE).expect("the browser replies")
    }

    /// Calls a method of the protocol.
    pub(crate) fn call(&mut self, method: &str, params: &Json) -> Json {
        self.number += 1;
        let number = self.number;
        let mut message = json!({ "id": number, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = session.as_str().into();
        }
        let mut bytes = serde_json::to_vec(&message).expect("JSON");
        bytes.push(0);
        self.to.write_all(&bytes).and_then(|()| self.to.flush()).expect("the browser reads");
        loop {
            let mut reply = self.next();
            if reply["id"] == number {
                assert!(reply.get("error").is_none(), "{method}: {}", reply["error"]);
                return reply["result"].take();
            }
            self.events.push(reply);
        }
    }

    /// Opens a file, and waits until it is loaded.
    pub(crate) fn open(&mut self, file: &Path) {
        self.events.clear();
        self.call("Page.navigate", &json!({ "url": format!("file://{}", file.display()) }));
        while !self.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            let event = self.next();
            self.events.push(event);
        }
    }

    /// Evaluates an expression; awaits it if it is a promise.
    pub(crate) fn eval(&mut self, expression: &str) -> Json {
        let params = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let mut reply = self.call("Runtime.evaluate", &params);
        assert!(reply.get("exceptionDetails").is_none(), "{expression}: {}", reply["exceptionDetails"]);
        reply["result"]["value"].take()
    }

    /// Waits until an expression is true.
    pub(crate) fn until(&mut self, expression: &str) {
        let waits = format!(
            "new Promise((done, failed) => {{ const start = Date.now(), look = () => {{ if ({expression}) done(true); else if (Date.now() - start > 60000) failed(new Error('never')); else setTimeout(look, 20); }}; look(); }})"
        );
        assert_eq!(self.eval(&waits), true, "{expression}");
    }

    /// Moves the pointer to the middle of an element, or to a share of it.
    pub(crate) fn point_at(&mut self, selector: &str, (across, down): (f64, f64)) {
        // Scrolling must be finished, because the pointer hits what is drawn.
        let place = format!(
            "(async () => {{ const element = document.querySelector({selector:?}); element.scrollIntoView({{ block: 'center', behavior: 'instant' }}); for (let i = 0; i < 3; i++) await new Promise(requestAnimationFrame); const box = element.getBoundingClientRect(); return [box.left + {across} * box.width, box.top + {down} * box.height]; }})()"
        );
        let place = self.eval(&place);
        for more in [0.0, 1.0] {
            let (x, y) = (place[0].as_f64().expect("a number") + more, place[1].as_f64().expect("a number") + more);
            self.call("Input.dispatchMouseEvent", &json!({ "type": "mouseMoved", "x": x, "y": y }));
        }
    }

    /// Errors of the page until now, and its network requests.
    pub(crate) fn complaints(&mut self) -> Vec<String> {
        // Events from before this call arrive before its reply.
        self.eval("new Promise((done) => setTimeout(done, 100))");
        let complaints = self.events.iter().filter_map(|event| {
            let params = &event["params"];
            let wrong = match event["method"].as_str()? {
                "Runtime.exceptionThrown" => true,
                "Log.entryAdded" => params["entry"]["level"] != "info" && params["entry"]["level"] != "verbose",
                "Runtime.consoleAPICalled" => params["type"] != "log",
                "Network.requestWillBeSent" => {
                    let url = params["request"]["url"].as_str().unwrap_or_default();
                    !["file:", "data:", "blob:", "about:"].iter().any(|own| url.starts_with(own))
                }
                "Page.javascriptDialogOpening" => true,
                _ => false,
            };
            wrong.then(|| event.to_string())
        });
        complaints.collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
