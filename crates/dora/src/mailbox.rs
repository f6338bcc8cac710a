//! Received messages, by input and frame; a thread that needs a missing one waits.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Fault, Value, ValueType};
use depthloom_runner::Interrupt;
use depthloom_threads::locked;
use serde_json::{Map, Value as Json};

use crate::channel;
use crate::message::Row;

/// The interval of checks for an abandoned run.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug)]
pub struct Arrived {
    pub input: String,
    pub metadata: Map<String, Json>,
    /// The stream of its row; empty if there is no value.
    pub body: Vec<u8>,
    /// Why it is malformed, as a lower-case fragment.
    pub wrong: Option<String>,
    /// Whether another message of the same frame came before this one was used.
    pub is_repeated: bool,
}

impl Arrived {
    /// A message or a piece of one.
    pub const fn new(input: String, metadata: Map<String, Json>, body: Vec<u8>) -> Self {
        Self { input, metadata, body, wrong: None, is_repeated: false }
    }

    /// Fails if it is malformed.
    pub fn check(&self) -> Result<(), Fault> {
        let wrong = |what: &String| Fault::new(format!("what came at `{}` is not a valid message: {what}", self.input));
        self.wrong.as_ref().map_or(Ok(()), |what| Err(wrong(what)))
    }

    /// `None` if it has no value.
    pub fn value(&self, value_type: ValueType) -> Result<Option<Value>, Fault> {
        self.check()?;
        if self.body.is_empty() {
            return Ok(None);
        }
        let read = Row::read(&self.body).and_then(|row| row.value(value_type));
        read.map(Some)
            .map_err(|what| Fault::new(format!("what came at `{}` is not a valid {value_type}: {what}", self.input)))
    }

    pub fn json(&self) -> Result<Json, Fault> {
        self.check()?;
        let wrong = |what: String| Fault::new(format!("what came at `{}` is not a report: {what}", self.input));
        let row = Row::read(&self.body).map_err(wrong)?;
        serde_json::from_str(row.text().map_err(wrong)?).map_err(|error| wrong(error.to_string()))
    }

    fn number(&self, name: &str) -> Option<u64> {
        self.metadata.get(name)?.as_u64()
    }
}

#[derive(Debug)]
pub enum Gone {
    /// The wait was cancelled.
    Cancelled,
    /// It will not come; why, as a lower-case fragment.
    Ended(String),
}

impl From<Gone> for Fault {
    fn from(gone: Gone) -> Self {
        match gone {
            Gone::Cancelled => Self::Cancelled,
            Gone::Ended(what) => Self::new(what),
        }
    }
}

type Messages = BTreeMap<Option<u64>, Arrived>;

#[derive(Default)]
struct State {
    /// By input and frame; `None` for messages without a frame.
    there: HashMap<String, Messages>,
    /// Incomplete messages, by input and frame.
    pieces: HashMap<(String, Option<u64>), Pieces>,
    closed: HashSet<String>,
    /// Why no more messages come.
    over: Option<String>,
}

#[derive(Default)]
struct Pieces {
    count: u64,
    by_place: BTreeMap<u64, Vec<u8>>,
}

impl Pieces {
    /// Adds a piece; returns the message if it is complete. Pieces come in any order, each once.
    fn add(&mut self, place: u64, count: u64, body: Vec<u8>) -> Result<Option<Vec<u8>>, String> {
        if self.by_place.is_empty() {
            self.count = count;
        }
        if count != self.count {
            return Err(format!("a piece states {count} pieces, but the first stated {}", self.count));
        }
        if place >= count {
            return Err(format!("piece {place} came of {count}, which are numbered from 0"));
        }
        if self.by_place.insert(place, body).is_some() {
            return Err(format!("piece {place} of {count} came twice"));
        }
        let is_whole = self.by_place.len() as u64 == count;
        Ok(is_whole.then(|| std::mem::take(&mut self.by_place).into_values().collect::<Vec<_>>().concat()))
    }
}

/// Messages that were not used yet.
pub struct Mailbox {
    state: Mutex<State>,
    changed: Condvar,
    /// Raised when the run must end.
    interrupt: Interrupt,
    /// Whether this part ends the run: then dora's request to stop is a first interrupt. Other parts ignore it.
    is_recorder: bool,
}

impl Mailbox {
    /// An empty mailbox.
    pub fn new(interrupt: Interrupt, is_recorder: bool) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), interrupt, is_recorder }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        locked(&self.state)
    }

    /// Adds a message.
    pub fn put(&self, mut arrived: Arrived) {
        if arrived.input == channel::END {
            return self.end("the run has ended");
        }
        let mut state = self.state();
        let at = arrived.number("frame");
        if let (Some(place), Some(count)) = (arrived.number("chunk"), arrived.number("chunks")) {
            let id = (arrived.input.clone(), at);
            let pieces = state.pieces.entry(id.clone()).or_default();
            match pieces.add(place, count, std::mem::take(&mut arrived.body)) {
                Ok(None) => return,
                Ok(Some(whole)) => arrived.body = whole,
                Err(what) => arrived.wrong = Some(what),
            }
            state.pieces.remove(&id);
        }
        match (state.there.entry(arrived.input.clone()).or_default().entry(at), at) {
            // The first one counts, and is marked.
            (Entry::Occupied(mut first), Some(_)) => first.get_mut().is_repeated = true,
            (Entry::Occupied(mut before), None) => {
                before.insert(arrived);
            }
            (Entry::Vacant(place), _) => {
                place.insert(arrived);
            }
        }
        self.changed.notify_all();
    }

    /// The part of an input has ended.
    pub fn close(&self, input: String) {
        if input == channel::END {
            return self.end("the recorder has ended");
        }
        self.state().closed.insert(input);
        self.changed.notify_all();
    }

    /// No more messages come.
    pub fn end(&self, why: &str) {
        // A recorder that stops receives no more frames, since the other parts stop too.
        if !self.is_recorder || self.interrupt.stops_admission() {
            while self.interrupt.raise() < 2 {}
        }
        self.state().over.get_or_insert_with(|| why.to_owned());
        self.changed.notify_all();
    }

    /// dora requests to stop.
    pub fn stop(&self) {
        if self.is_recorder {
            self.interrupt.raise();
        }
    }

    /// Waits for the message of a frame (or without one) at an input.
    ///
    /// # Errors
    /// If the run ends or is cancelled first.
    pub fn take(&self, input: &str, at: Option<FrameIndex>, cancelled: &dyn Fn() -> bool) -> Result<Arrived, Gone> {
        let at = at.map(|at| at.0 as u64);
        self.wait(input, cancelled, |there| there.remove(&at))
    }

    /// Waits until `until` for a message at each input that is not closed. Returns the inputs without one.
    pub fn without_message<'i>(
        &self,
        inputs: &'i [String],
        until: Instant,
        cancelled: &dyn Fn() -> bool,
    ) -> Vec<&'i str> {
        let mut state = self.state();
        loop {
            let is_missing = |input: &&String| {
                state.there.get(*input).is_none_or(BTreeMap::is_empty) && !state.closed.contains(*input)
            };
            let missing: Vec<&str> = inputs.iter().filter(is_missing).map(String::as_str).collect();
            if missing.is_empty() || cancelled() || state.over.is_some() {
                return Vec::new();
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return missing;
            }
            state = self.changed.wait_timeout(state, LOOK.min(left)).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits for any message at an input.
    ///
    /// # Errors
    /// As [`Mailbox::take`].
    pub fn take_any(&self, input: &str, cancelled: &dyn Fn() -> bool) -> Result<Arrived, Gone> {
        self.wait(input, cancelled, |there| Some(there.pop_first()?.1))
    }

    /// Whether the message of a frame is there.
    pub fn holds(&self, input: &str, position: FrameIndex) -> bool {
        self.state().there.get(input).is_some_and(|there| there.contains_key(&Some(position.0 as u64)))
    }

    /// Wakes all waiting threads.
    pub fn wake(&self) {
        let _state = self.state();
        self.changed.notify_all();
    }

    fn wait(
        &self,
        input: &str,
        cancelled: &dyn Fn() -> bool,
        take: impl Fn(&mut Messages) -> Option<Arrived>,
    ) -> Result<Arrived, Gone> {
        let mut state = self.state();
        loop {
            if let Some(arrived) = state.there.get_mut(input).and_then(&take) {
                return Ok(arrived);
            }
            if state.closed.contains(input) {
                return Err(Gone::Ended(format!("`{}` ended before it sent more", part_of(input))));
            }
            if cancelled() {
                return Err(Gone::Cancelled);
            }
            if let Some(why) = &state.over {
                return Err(Gone::Ended(why.clone()));
            }
            state = self.changed.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits until the run has ended.
    pub fn wait_for_the_end(&self) {
        let mut state = self.state();
        while state.over.is_none() {
            state = self.changed.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Drops messages of frames up to this one.
    pub fn forget(&self, inputs: &[String], position: FrameIndex) {
        let mut state = self.state();
        for input in inputs {
            if let Some(there) = state.there.get_mut(input) {
                there.retain(|at, _| at.is_none_or(|at| at > position.0 as u64));
            }
        }
    }
}

/// `compare.stereo` for the recorder's input `compare.stereo/node.report`.
fn part_of(input: &str) -> &str {
    input.split_once('/').map_or(input, |(part, _)| part)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    use depthloom_graphs::ValueType;
    use depthloom_graphs::plan::FrameIndex;
    use depthloom_runner::Interrupt;
    use serde_json::{Map, json};

    use super::{Arrived, Gone, Mailbox};
    use crate::channel;

    fn mailbox(is_recorder: bool) -> (Mailbox, Interrupt) {
        let interrupt = Interrupt::default();
        (Mailbox::new(interrupt.clone(), is_recorder), interrupt)
    }

    fn message(input: &str, metadata: &serde_json::Value, body: &[u8]) -> Arrived {
        let metadata = metadata.as_object().cloned().unwrap_or_else(Map::new);
        Arrived::new(input.to_owned(), metadata, body.to_vec())
    }

    const NEVER: &dyn Fn() -> bool = &|| false;

    #[test]
    fn a_thread_waits_for_its_frame_and_gets_no_other() {
        let mailbox = Arc::new(mailbox(false).0);
        mailbox.put(message("left", &json!({ "frame": 1 }), b"one"));
        let other = Arc::clone(&mailbox);
        let late = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            other.put(message("left", &json!({ "frame": 0 }), b"zero"));
        });
        assert_eq!(mailbox.take("left", Some(FrameIndex(0)), NEVER).unwrap().body, b"zero");
        assert_eq!(mailbox.take("left", Some(FrameIndex(1)), NEVER).unwrap().body, b"one");
        late.join().unwrap();
        mailbox.put(message("left", &json!({ "frame": 7 }), b""));
        mailbox.forget(&["left".to_owned()], FrameIndex(7));
        assert!(matches!(mailbox.take("left", Some(FrameIndex(7)), &|| true), Err(Gone::Cancelled)));
    }

    #[test]
    fn pieces_form_one_message_despite_others_between_them() {
        let (mailbox, _) = mailbox(false);
        mailbox.put(message("left", &json!({ "frame": 3, "chunk": 0, "chunks": 3 }), b"a"));
        mailbox.put(message("left", &json!({ "frame": 4, "chunk": 0, "chunks": 2 }), b"x"));
        mailbox.put(message("left", &json!({ "frame": 3, "chunk": 1, "chunks": 3 }), b"b"));
        mailbox.put(message("left", &json!({ "frame": 4, "chunk": 1, "chunks": 2 }), b"y"));
        assert!(matches!(mailbox.take("left", Some(FrameIndex(3)), &|| true), Err(Gone::Cancelled)));
        mailbox.put(message("left", &json!({ "frame": 3, "chunk": 2, "chunks": 3 }), b"c"));
        assert_eq!(mailbox.take("left", Some(FrameIndex(3)), NEVER).unwrap().body, b"abc");
        assert_eq!(mailbox.take_any("left", NEVER).unwrap().body, b"xy");
    }

    fn piece(place: u64, count: u64, body: &[u8]) -> Arrived {
        message("left", &json!({ "frame": 3, "chunk": place, "chunks": count }), body)
    }

    #[test]
    fn pieces_are_joined_by_their_numbers_whatever_their_order() {
        for order in [[0, 1, 2], [2, 1, 0], [1, 2, 0], [2, 0, 1]] {
            let (mailbox, _) = mailbox(false);
            for place in order {
                assert!(matches!(mailbox.take("left", Some(FrameIndex(3)), &|| true), Err(Gone::Cancelled)));
                mailbox.put(piece(place as u64, 3, &b"abc"[place..=place]));
            }
            assert_eq!(mailbox.take("left", Some(FrameIndex(3)), NEVER).unwrap().body, b"abc", "{order:?}");
        }
    }

    #[test]
    fn pieces_that_make_no_message_are_an_error_and_no_value() {
        let cases = [
            (vec![piece(0, 3, b"a"), piece(0, 3, b"b")], "piece 0 of 3 came twice"),
            (vec![piece(0, 3, b"a"), piece(1, 2, b"b")], "a piece states 2 pieces, but the first stated 3"),
            (vec![piece(3, 3, b"a")], "piece 3 came of 3, which are numbered from 0"),
            (vec![piece(0, 0, b"a")], "piece 0 came of 0"),
        ];
        for (pieces, expected) in cases {
            let (mailbox, _) = mailbox(false);
            pieces.into_iter().for_each(|piece| mailbox.put(piece));
            let arrived = mailbox.take("left", Some(FrameIndex(3)), NEVER).unwrap();
            let what = arrived.value(ValueType::Depth).expect_err("no message").chain();
            assert!(what.contains(expected), "{what}");
        }
    }

    #[test]
    fn the_first_of_two_messages_of_a_frame_is_used_with_a_warning() {
        let (mailbox, _) = mailbox(false);
        mailbox.put(message("left", &json!({ "frame": 1 }), b"first"));
        mailbox.put(message("left", &json!({ "frame": 1 }), b"second"));
        mailbox.put(message("left", &json!({ "frame": 2 }), b"other"));
        let (first, other) = (
            mailbox.take("left", Some(FrameIndex(1)), NEVER).unwrap(),
            mailbox.take("left", Some(FrameIndex(2)), NEVER).unwrap(),
        );
        assert_eq!((first.body.as_slice(), first.is_repeated), (&b"first"[..], true));
        assert_eq!((other.body.as_slice(), other.is_repeated), (&b"other"[..], false));
    }

    #[test]
    fn inputs_that_stay_empty_are_named_when_their_time_is_up() {
        let (mailbox, _) = mailbox(true);
        let inputs = ["a/node.ready", "b/node.ready", "c/node.ready"].map(str::to_owned);
        let until = || Instant::now() + Duration::from_millis(20);
        mailbox.put(message("a/node.ready", &json!({}), b"a"));
        mailbox.close("c/node.ready".to_owned());
        assert_eq!(mailbox.without_message(&inputs, until(), NEVER), ["b/node.ready"]);
        assert_eq!(mailbox.without_message(&inputs, until(), &|| true), [""; 0]);
        mailbox.put(message("b/node.ready", &json!({}), b"b"));
        assert_eq!(mailbox.without_message(&inputs, until(), NEVER), [""; 0]);
        assert_eq!(mailbox.take("a/node.ready", None, NEVER).unwrap().body, b"a");
    }

    #[test]
    fn messages_before_the_end_remain_available() {
        let (mailbox, interrupt) = mailbox(true);
        mailbox.put(message("look.stereo/node.report", &json!({ "frame": 0 }), b"said"));
        mailbox.close("look.stereo/node.report".to_owned());
        assert_eq!(mailbox.take("look.stereo/node.report", Some(FrameIndex(0)), NEVER).unwrap().body, b"said");
        let Err(Gone::Ended(what)) = mailbox.take("look.stereo/node.report", Some(FrameIndex(1)), NEVER) else {
            panic!()
        };
        assert_eq!(what, "`look.stereo` ended before it sent more");
        assert!(!interrupt.stops_admission());
    }

    #[test]
    fn the_end_abandons_parts_and_a_wish_to_stop_is_the_recorder_s() {
        let (part, of_part) = mailbox(false);
        part.stop();
        assert!(!of_part.stops_admission());
        part.put(message(channel::END, &json!({}), b""));
        assert!(of_part.aborts());
        part.wait_for_the_end();
        let (recorder, of_recorder) = mailbox(true);
        recorder.stop();
        assert!(of_recorder.stops_admission() && !of_recorder.aborts());
        recorder.end("dora has ended the dataflow");
        assert!(of_recorder.aborts());
    }
}
