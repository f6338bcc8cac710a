//! The connection to dora: a process in Python with dora's own library, which passes messages on.
//!
//! dora's library for Rust has about 450 crates and a network stack, and its protocol for nodes is not stable. A copy
//! over a pipe is cheap compared with what a node computes.

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, OnceLock, mpsc};
use std::thread;
use std::time::Duration;

use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Fault, Frame};
use depthloom_terminal::{CliError, ExitCode};
use depthloom_threads::{locked, look_for_room};
use serde_json::{Map, Value as Json, json};

use crate::mailbox::{Arrived, Mailbox};

const PROGRAM: &str = include_str!("bridge.py");
/// dora refuses messages of more than 64 MiB.
const MOST: usize = 24 << 20;
const LONGEST_HEAD: u32 = 16 << 20;

/// How to reach dora.
pub struct BridgeStart<'a> {
    /// A Python with dora's library.
    pub python: &'a str,
    /// The name of the node in the dataflow.
    pub part: &'a str,
    /// How long dora may wait for the other nodes of the dataflow.
    pub limit: Duration,
}

/// A process with dora's library.
pub struct Bridge {
    /// Received messages.
    pub mailbox: Arc<Mailbox>,
    /// The frames of the part's stage, once they are known.
    pub frames: OnceLock<Vec<Frame>>,
    /// `None` once closed.
    out: Mutex<Option<BufWriter<ChildStdin>>>,
    child: Child,
}

impl Bridge {
    /// Starts the process, and waits until dora knows the node.
    ///
    /// # Errors
    /// If `python` cannot be started, lacks dora's package, or does not reach dora within `limit`.
    pub fn start(&BridgeStart { python, part, limit }: &BridgeStart<'_>, mailbox: Mailbox) -> Result<Self, CliError> {
        let wrong = |intent: &str, error: &dyn std::error::Error| {
            CliError::because(ExitCode::Usage, format!("{intent} `{python}`, which dora is reached by"), error)
                .remedy("name a Python that has `dora-rs` with --python, where the dataflow is written: `depthloom dora --python PATH`")
        };
        let mut command = Command::new(python);
        command.args(["-c", PROGRAM]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn().map_err(|error| wrong("failed to start", &error))?;
        let (Some(out), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(CliError::new(ExitCode::Engine, "a process was started without streams"));
        };
        let mailbox = Arc::new(mailbox);
        let out = Mutex::new(Some(BufWriter::new(out)));
        let mut bridge = Self { mailbox: Arc::clone(&mailbox), frames: OnceLock::new(), out, child };
        let mut from = BufReader::with_capacity(1 << 16, from);
        let (send, first) = mpsc::channel();
        let listening = move || {
            let is_ready = read(&mut from).and_then(|first| {
                let is_ready = !first.head.contains_key("lacks");
                send.send(Ok(first)).map(|()| is_ready).map_err(io::Error::other)
            });
            match is_ready {
                Ok(true) => listen(from, &mailbox),
                Ok(false) => {}
                Err(error) => drop(send.send(Err(error))),
            }
        };
        let started =
            look_for_room().and_then(|()| thread::Builder::new().name("depthloom-dora".to_owned()).spawn(listening));
        started.map_err(|error| CliError::because(ExitCode::Engine, "failed to start a thread", &error))?;
        let Ok(first) = first.recv_timeout(limit) else {
            // It waits inside dora's library, and does not notice the end of its input.
            let _ = bridge.child.kill();
            let what = format!("dora did not let node `{part}` begin within {} s", limit.as_secs());
            return Err(CliError::new(ExitCode::Engine, what).remedy(
                "another node of the dataflow may not have started, see its log (`dora logs`); run it again, or allow it more time: `depthloom dora --start-timeout SECONDS`",
            ));
        };
        let first = first.map_err(|error| {
            CliError::because(
                ExitCode::Usage,
                format!("`{python}`, which dora is reached by, ended before dora knew the node"),
                &error,
            )
        })?;
        if let Some(lacks) = first.head.get("lacks").and_then(Json::as_str) {
            let stop = CliError::new(ExitCode::Usage, format!("dora cannot be reached: {lacks}"));
            return Err(stop.remedy(if first.head.contains_key("outside") {
                "dora starts this command: `depthloom dora EXPERIMENT > dataflow.yml`, then `dora run dataflow.yml`"
            } else {
                "install dora's library there (`pip install dora-rs pyarrow`), or name another Python where the dataflow is written: `depthloom dora --python PATH`"
            }));
        }
        Ok(bridge)
    }

    /// Sends the stream of a row, with its frame and position if it has one. An empty stream means that there is no
    /// value.
    ///
    /// # Errors
    /// If the process has ended.
    pub fn send(&self, output: &str, frame: Option<(FrameIndex, &Frame)>, stream: &[u8]) -> Result<(), Fault> {
        let metadata = frame.map(|(position, frame)| metadata_of(position, frame)).unwrap_or_default();
        self.send_with(output, metadata, stream, false)
    }

    /// As [`Bridge::send`], with metadata; `flat`: only the numbers of the column `data`.
    ///
    /// # Errors
    /// As [`Bridge::send`].
    pub fn send_with(
        &self,
        output: &str,
        mut metadata: Map<String, Json>,
        stream: &[u8],
        flat: bool,
    ) -> Result<(), Fault> {
        if stream.is_empty() {
            metadata.insert("nothing".to_owned(), true.into());
        }
        if stream.len() <= MOST || flat {
            return self.write(&json!({ "output": output, "metadata": metadata, "flat": flat }), stream);
        }
        let pieces = stream.chunks(MOST);
        let count = pieces.len();
        for (at, piece) in pieces.enumerate() {
            metadata.insert("chunk".to_owned(), at.into());
            metadata.insert("chunks".to_owned(), count.into());
            self.write(&json!({ "output": output, "metadata": metadata }), piece)?;
        }
        Ok(())
    }

    fn write(&self, head: &Json, body: &[u8]) -> Result<(), Fault> {
        let head = head.to_string();
        let mut out = locked(&self.out);
        let Some(out) = out.as_mut() else { return Err(Fault::new("the connection is closed")) };
        let mut write = || -> io::Result<()> {
            out.write_all(&(head.len() as u32).to_le_bytes())?;
            out.write_all(&(body.len() as u64).to_le_bytes())?;
            out.write_all(head.as_bytes())?;
            out.write_all(body)?;
            out.flush()
        };
        write().map_err(|error| Fault::new("dora cannot be reached any more").because(error))
    }
}

pub(crate) fn metadata_of(position: FrameIndex, frame: &Frame) -> Map<String, Json> {
    Map::from_iter([
        ("frame".to_owned(), position.0.into()),
        ("frame_id".to_owned(), (&*frame.id).into()),
        ("time_ns".to_owned(), frame.time_ns.into()),
    ])
}

impl Drop for Bridge {
    /// Lets the last messages be delivered.
    fn drop(&mut self) {
        locked(&self.out).take();
        let _ = self.child.wait();
    }
}

struct Message {
    head: Map<String, Json>,
    body: Vec<u8>,
}

fn read(from: &mut impl Read) -> io::Result<Message> {
    let malformed = || io::Error::new(io::ErrorKind::InvalidData, "the message is malformed");
    let (mut head_size, mut body_size) = ([0; 4], [0; 8]);
    from.read_exact(&mut head_size)?;
    from.read_exact(&mut body_size)?;
    let head_size = u32::from_le_bytes(head_size);
    if head_size > LONGEST_HEAD {
        return Err(malformed());
    }
    let mut head = vec![0; head_size as usize];
    from.read_exact(&mut head)?;
    let body_size = u64::from_le_bytes(body_size);
    let mut body = Vec::new();
    from.take(body_size).read_to_end(&mut body)?;
    if body.len() as u64 != body_size {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(Message { head: serde_json::from_slice(&head).map_err(|_| malformed())?, body })
}

/// Puts messages into the mailbox until the stream ends.
fn listen(mut from: BufReader<ChildStdout>, mailbox: &Mailbox) {
    while let Ok(Message { head, body }) = read(&mut from) {
        let text = |name: &str| head.get(name).and_then(Json::as_str).map(str::to_owned);
        if let Some(input) = text("input") {
            let metadata = head.get("metadata").and_then(Json::as_object).cloned().unwrap_or_default();
            mailbox.put(Arrived::new(input, metadata, body));
        } else if let Some(input) = text("closed") {
            mailbox.close(input);
        } else if head.contains_key("stop") {
            mailbox.stop();
        } else if let Some(trouble) = text("trouble") {
            mailbox.end(&format!("dora reports: {trouble}"));
        } else if head.contains_key("over") {
            mailbox.end("dora has ended the dataflow");
        }
    }
    mailbox.end("the connection to dora has ended");
}
