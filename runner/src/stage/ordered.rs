//! Ordered nodes: frames run in order, whatever order their inputs become ready in.

use std::sync::{Arc, Mutex};

use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Key, OrderedNode};
use depthloom_threads::{into_unlocked, locked};

use crate::stage::in_flight::InFlight;

/// An ordered node and the frames that wait for it.
pub(crate) struct Ordered<P> {
    line: Mutex<Line<P>>,
    /// Locked by the one task of the node that runs.
    pub(crate) state: Mutex<State>,
}

pub(crate) struct State {
    /// `None` once it has failed.
    pub(crate) node: Option<Box<dyn OrderedNode>>,
    /// Its key on the last frame it ran on.
    pub(crate) last_key: Option<Key>,
}

struct Line<P> {
    next: FrameIndex,
    /// Frames whose inputs are ready, by position modulo the window.
    arrived: Vec<Option<Arc<InFlight<P>>>>,
}

impl<P> Ordered<P> {
    pub(crate) fn new(node: Box<dyn OrderedNode>, window: usize) -> Self {
        let line = Line { next: FrameIndex(0), arrived: (0..window).map(|_| None).collect() };
        Self { line: Mutex::new(line), state: Mutex::new(State { node: Some(node), last_key: None }) }
    }

    pub(crate) fn start_at(&self, position: FrameIndex) {
        locked(&self.line).next = position;
    }

    /// A frame's inputs are ready: returns whether it is its turn.
    pub(crate) fn arrive(&self, frame: &Arc<InFlight<P>>) -> bool {
        let mut line = locked(&self.line);
        if frame.position == line.next {
            return true;
        }
        let place = frame.position.0 % line.arrived.len();
        line.arrived[place] = Some(Arc::clone(frame));
        false
    }

    /// The node has finished a frame: returns the next one, if its inputs are ready.
    pub(crate) fn advance(&self) -> Option<Arc<InFlight<P>>> {
        let mut line = locked(&self.line);
        line.next.0 += 1;
        let place = line.next.0 % line.arrived.len();
        line.arrived[place].take()
    }

    pub(crate) fn into_state(self) -> (Option<Box<dyn OrderedNode>>, Option<Key>) {
        let State { node, last_key } = into_unlocked(self.state);
        (node, last_key)
    }
}
