//! Shows the values of a run while it runs: a server for Foxglove and other clients of its WebSocket protocol.
//!
//! [`ViewerSink`] forwards everything to another sink, and passes the values of selected topics to a [`Viewer`]. The
//! viewer encodes them on a thread of its own, as the messages that a recording would have. A slow viewer never slows
//! the run: the queue between both is bounded, and its oldest frames are dropped.
//!
//! The server is behind the feature `serve`. Without it, [`Viewer::start`] returns an error that says how to build it.
#![forbid(unsafe_code)]

mod address;
mod queue;
#[cfg_attr(not(feature = "serve"), path = "server_absent.rs")]
mod server;
mod sink;
mod topics;
mod viewer;

pub use address::ServeAddress;
pub use sink::ViewerSink;
pub use viewer::{Viewer, ViewerCounts};
