//! The thread that encodes values for viewers, and its server.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use depthloom_graphs::contracts::{ErrorMessage, Slot};
use depthloom_graphs::plan::{FrameIndex, Plan, RunId};
use depthloom_graphs::{Frame, Value};
use depthloom_recording::MessageEncoder;
use depthloom_threads::{Caught, caught, locked, look_for_room};

use crate::address::ServeAddress;
use crate::queue::{PartValues, Queue};
use crate::server::Server;
use crate::topics::{Topics, select};

/// The thread looks at its queue at least so often.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// What a viewer did so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewerCounts {
    /// The messages that were passed to the clients. The server drops the oldest messages of a client that does not
    /// read them; these are not known.
    pub messages: u64,
    /// The frames of which at least one value was not encoded, because the thread could not keep up.
    pub dropped_frames: u64,
}

/// Serves the values of a run to viewers. Dropping it ends the server, without waiting for its clients.
pub struct Viewer {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    encoder: MessageEncoder,
    topics: Topics,
    queue: Queue,
    server: Server,
    messages: AtomicU64,
    error: Mutex<Option<ErrorMessage>>,
    is_stopping: AtomicBool,
}

impl Viewer {
    /// Starts the server and its thread. `topics` are patterns with `*` of the topics that are offered; without
    /// patterns, all are. `name` is what viewers show as the name of the server.
    ///
    /// # Errors
    /// If the build has no server, a pattern matches no topic, the address is in use, or the plan cannot be recorded.
    pub fn start(plan: &Plan, address: ServeAddress, topics: &[String], name: &str) -> Result<Self, ErrorMessage> {
        let encoder = MessageEncoder::new(plan)?;
        let topics = select(plan, &encoder, topics)?;
        let parts = RunId::all(plan.runs.len()).map(|run| encoder.parts(run)).max().unwrap_or(0);
        let server = Server::start(address.socket(), name, encoder.channels().count())?;
        let shared = Arc::new(Shared {
            encoder,
            topics,
            queue: Queue::new(parts),
            server,
            messages: AtomicU64::new(0),
            error: Mutex::new(None),
            is_stopping: AtomicBool::new(false),
        });
        let of_thread = Arc::clone(&shared);
        let thread = thread::Builder::new().name("depthloom-viewer".to_owned());
        let thread = look_for_room().and_then(|()| thread.spawn(move || of_thread.encode_all()));
        let thread =
            thread.map_err(|error| ErrorMessage::new("failed to start a thread for viewers").because(error))?;
        shared.queue.set_reader(thread.thread().clone());
        Ok(Self { shared, thread: Some(thread) })
    }

    /// The address of the server.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.shared.server.address()
    }

    /// What it did so far.
    #[must_use]
    pub fn counts(&self) -> ViewerCounts {
        let messages = self.shared.messages.load(Ordering::Relaxed);
        ViewerCounts { messages, dropped_frames: self.shared.queue.dropped_frames() }
    }

    /// The first error since the last call: a value that could not be shown.
    #[must_use]
    pub fn take_error(&self) -> Option<ErrorMessage> {
        locked(&self.shared.error).take()
    }

    /// Encodes the values that wait. Then the values that come are not shown any more. Clients stay connected until the
    /// viewer is dropped.
    pub fn finish(&mut self) {
        self.shared.is_stopping.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // It catches panics of its own work.
            let _ = thread.join();
        }
    }

    /// Offers values of a part of a frame. Never waits. Nothing is copied if no client has subscribed to them.
    pub(crate) fn offer<'v>(
        &self,
        run: RunId,
        (position, frame): (FrameIndex, &Frame),
        values: impl Iterator<Item = (Slot, &'v Value)>,
    ) {
        let values: Vec<(Slot, &Value)> = values.collect();
        let shared = &*self.shared;
        let wanted = values.iter().map(|(slot, _)| *slot).filter(|slot| shared.is_wanted(run, *slot));
        let wanted: Vec<Slot> = wanted.collect();
        if wanted.is_empty() {
            return;
        }
        let inputs: Vec<Slot> = wanted.iter().flat_map(|slot| &shared.topics[&(run, *slot)].inputs).copied().collect();
        let is_needed = |slot: &Slot| wanted.contains(slot) || inputs.contains(slot);
        let values = values.into_iter().filter(|(slot, _)| is_needed(slot));
        let values = values.map(|(slot, value)| (slot, value.clone())).collect();
        shared.queue.push(PartValues { run, position, frame: frame.clone(), values });
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.finish();
    }
}

impl Shared {
    /// Whether values of a slot are encoded: if a client has subscribed, or none has been seen yet.
    fn is_wanted(&self, run: RunId, slot: Slot) -> bool {
        self.topics.get(&(run, slot)).is_some_and(|topics| {
            !topics.is_advertised() || topics.channels.iter().any(|channel| self.server.is_subscribed(*channel))
        })
    }

    /// Encodes values until the viewer stops.
    fn encode_all(&self) {
        loop {
            let is_stopping = self.is_stopping.load(Ordering::Acquire);
            while let Some(part) = self.queue.pop() {
                self.encode(&part);
            }
            if is_stopping {
                return;
            }
            thread::park_timeout(LONGEST_SLEEP);
        }
    }

    fn encode(&self, part: &PartValues) {
        for (slot, value) in &part.values {
            let encoded = caught(|| self.encode_value(part, *slot, value));
            let encoded = encoded.unwrap_or_else(|Caught(message)| {
                Err(ErrorMessage::new(format!("the encoder of a viewer panicked {message}")))
            });
            if let Err(error) = encoded {
                locked(&self.error).get_or_insert(error);
            }
        }
    }

    fn encode_value(&self, part: &PartValues, slot: Slot, value: &Value) -> Result<(), ErrorMessage> {
        let Some(topics) = self.topics.get(&(part.run, slot)) else { return Ok(()) };
        let is_advertised = topics.is_advertised();
        // The first value shows which channels are used.
        topics.set_advertised();
        let is_wanted =
            |channel: u16| topics.channels.contains(&channel) && (!is_advertised || self.server.is_subscribed(channel));
        let mut published = Ok(());
        let put = |channel: u16, time_ns: u64, message: &[u8]| {
            // A value that is encoded for one of its two channels may get the other one.
            if published.is_ok() && topics.channels.contains(&channel) {
                published = self.server.publish(&self.encoder, channel, time_ns, message).map(|has_clients| {
                    self.messages.fetch_add(u64::from(has_clients), Ordering::Relaxed);
                });
            }
        };
        let frame = (part.position, &part.frame);
        self.encoder.encode(part.run, frame, (slot, value), &part.values, is_wanted, put)?;
        published
    }
}
