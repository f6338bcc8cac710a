//! Where the newest captured frame waits for admission.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};
use depthloom_graphs::Fault;
use depthloom_graphs::contracts::{Drops, StreamFrame};
use depthloom_threads::locked;

/// How long a thread waits before it looks whether the run has ended.
const PATIENCE: Duration = Duration::from_millis(50);

/// Holds at most one frame. A newer frame replaces it.
pub(crate) struct Mailbox {
    state: Mutex<State>,
    /// Wakes the capturing thread: a frame was taken or written.
    taken: Condvar,
    /// Has a message when a frame was put in, or the stream has ended.
    arrivals: (Sender<()>, Receiver<()>),
    /// The number of frames in the nodes. While it is 0, only the writer holds frames up.
    processing: Arc<AtomicUsize>,
    closed: AtomicBool,
}

#[derive(Default)]
struct State {
    waiting: Option<Box<StreamFrame>>,
    /// Frames captured, and lost by the source.
    offered: u64,
    /// Frames dropped since the last one was taken.
    dropped: Drops,
    warnings: Vec<String>,
    is_warm: bool,
    ended: bool,
    fault: Option<Fault>,
}

/// What [`Mailbox::take`] found.
pub(crate) enum Arrival {
    /// A frame, and the drops before it.
    Frame(Box<StreamFrame>, Drops),
    Nothing,
    /// No more frames will come; with the drops after the last one.
    Ended(Drops),
}

/// Closes a mailbox when dropped, so that the capturing thread ends.
pub(crate) struct CloseOnDrop<'a>(pub(crate) &'a Mailbox);

impl Drop for CloseOnDrop<'_> {
    fn drop(&mut self) {
        self.0.closed.store(true, Ordering::SeqCst);
        self.0.taken.notify_all();
    }
}

impl Mailbox {
    /// `processing` is the number of frames in the nodes.
    pub(crate) fn new(processing: Arc<AtomicUsize>) -> Self {
        Self {
            state: Mutex::default(),
            taken: Condvar::new(),
            arrivals: bounded(1),
            processing,
            closed: AtomicBool::new(false),
        }
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::SeqCst)
    }

    /// Puts a frame in, in place of one that is still there.
    pub(crate) fn put(&self, frame: Box<StreamFrame>) {
        let mut state = locked(&self.state);
        state.offered += 1 + frame.missed;
        state.dropped.source += frame.missed;
        if state.waiting.replace(frame).is_some() {
            if self.processing.load(Ordering::Relaxed) == 0 {
                state.dropped.recording += 1;
            } else {
                state.dropped.graph += 1;
            }
        }
        drop(state);
        self.signal();
    }

    /// Waits until the frame has been taken, or the run has ended, or `stops` returns true.
    pub(crate) fn wait_until_taken(&self, stops: impl Fn() -> bool) {
        self.wait(|state| state.waiting.is_none(), stops);
    }

    /// Waits until a first frame has been written: nodes build their networks on it.
    pub(crate) fn wait_until_warm(&self, stops: impl Fn() -> bool) {
        self.wait(|state| state.is_warm, stops);
    }

    fn wait(&self, until: impl Fn(&State) -> bool, stops: impl Fn() -> bool) {
        let mut state = locked(&self.state);
        while !until(&state) && !self.is_closed() && !stops() {
            state = self.taken.wait_timeout(state, PATIENCE).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub(crate) fn set_warm(&self) {
        locked(&self.state).is_warm = true;
        self.taken.notify_all();
    }

    pub(crate) fn warn(&self, warnings: Vec<String>) {
        if !warnings.is_empty() {
            locked(&self.state).warnings.extend(warnings);
            self.signal();
        }
    }

    pub(crate) fn end(&self, fault: Option<Fault>) {
        let mut state = locked(&self.state);
        (state.ended, state.fault) = (true, fault);
        drop(state);
        self.signal();
    }

    fn signal(&self) {
        // A message that waits already serves for this one.
        if let Err(TrySendError::Disconnected(())) = self.arrivals.0.try_send(()) {
            unreachable!("the mailbox has both ends");
        }
    }

    pub(crate) const fn arrivals(&self) -> &Receiver<()> {
        &self.arrivals.1
    }

    pub(crate) fn take(&self) -> Arrival {
        let mut state = locked(&self.state);
        let arrival = match state.waiting.take() {
            Some(frame) => Arrival::Frame(frame, std::mem::take(&mut state.dropped)),
            None if state.ended => Arrival::Ended(std::mem::take(&mut state.dropped)),
            None => Arrival::Nothing,
        };
        drop(state);
        self.taken.notify_all();
        arrival
    }

    pub(crate) fn offered(&self) -> u64 {
        locked(&self.state).offered
    }

    pub(crate) fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut locked(&self.state).warnings)
    }

    pub(crate) fn take_fault(&self) -> Option<Fault> {
        locked(&self.state).fault.take()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Instant;

    use depthloom_graphs::contracts::{Drops, Frame, StreamFrame};
    use depthloom_graphs::{Key, Outputs, SourceOutputs};

    use super::{Arrival, Mailbox};

    pub(crate) fn captured(index: u64, missed: u64) -> Box<StreamFrame> {
        let read = SourceOutputs { outputs: Outputs::none(), key: Key::of_content(&index.to_le_bytes()) };
        let frame = Frame::at_10_hz(index.to_string(), index);
        Box::new(StreamFrame { frame, read, captured: Instant::now(), missed })
    }

    #[test]
    fn the_newest_frame_wins_and_every_other_one_is_counted_by_its_cause() {
        let processing = Arc::new(AtomicUsize::new(1));
        let mailbox = Mailbox::new(Arc::clone(&processing));
        mailbox.put(captured(0, 0));
        mailbox.put(captured(3, 2));
        processing.store(0, Ordering::Relaxed);
        mailbox.put(captured(4, 0));
        let Arrival::Frame(frame, drops) = mailbox.take() else { panic!("a frame waits") };
        assert_eq!((frame.frame.index, drops), (4, Drops { graph: 1, recording: 1, source: 2 }));
        assert!(matches!(mailbox.take(), Arrival::Nothing));
        mailbox.put(captured(5, 0));
        mailbox.end(None);
        let Arrival::Frame(_, drops) = mailbox.take() else { panic!("a frame waits") };
        assert_eq!(drops, Drops::default());
        assert!(matches!(mailbox.take(), Arrival::Ended(drops) if drops == Drops::default()));
        assert_eq!(mailbox.offered(), 6);
    }
}
