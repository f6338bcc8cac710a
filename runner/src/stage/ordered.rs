//! Ordered nodes: one frame after the other, whatever order their inputs come in.

use std::sync::{Arc, Mutex};

use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Key, OrderedNode};
use depthloom_threads::{into_unlocked, locked};

use crate::stage::in_flight::InFlight;

/// An ordered node and the line of frames that wait for it.
pub(crate) struct Ordered<P> {
    line: Mutex<Line<P>>,
    /// Locked by the one task of the node that may run.
    pub(crate) state: Mutex<State>,
}

/// The node with what it remembers.
pub(crate) struct State {
    /// The node; gone once it has failed.
    pub(crate) node: Option<Box<dyn OrderedNode>>,
    /// Its key on the last frame it fired on.
    pub(crate) last_key: Option<Key>,
}

struct Line<P> {
    /// The frame whose turn it is.
    next: FrameIndex,
    /// Frames whose inputs are there, by position modulo the window.
    arrived: Vec<Option<Arc<InFlight<P>>>>,
}

impl<P> Ordered<P> {
    pub(crate) fn new(node: Box<dyn OrderedNode>, window: usize) -> Self {
        let line = Line { next: FrameIndex(0), arrived: (0..window).map(|_| None).collect() };
        Self { line: Mutex::new(line), state: Mutex::new(State { node: Some(node), last_key: None }) }
    }

    /// Says which frame is the first.
    pub(crate) fn start_at(&self, position: FrameIndex) {
        locked(&self.line).next = position;
    }

    /// A frame's inputs are there: gives it back if it is its turn.
    pub(crate) fn arrive(&self, frame: &Arc<InFlight<P>>) -> bool {
        let mut line = locked(&self.line);
        if frame.position == line.next {
            return true;
        }
        let place = frame.position.0 % line.arrived.len();
        line.arrived[place] = Some(Arc::clone(frame));
        false
    }

    /// The node is done with a frame: the next one, if its inputs are there.
    pub(crate) fn advance(&self) -> Option<Arc<InFlight<P>>> {
        let mut line = locked(&self.line);
        line.next.0 += 1;
        let place = line.next.0 % line.arrived.len();
        line.arrived[place].take()
    }

    /// What is left after the last frame: the node, unless it failed, and its last key.
    pub(crate) fn into_state(self) -> (Option<Box<dyn OrderedNode>>, Option<Key>) {
        let State { node, last_key } = into_unlocked(self.state);
        (node, last_key)
    }
}
