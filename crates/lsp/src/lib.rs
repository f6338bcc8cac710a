//! The language server of experiment files, on two streams.
//!
//! Open documents are checked while they are edited, with the messages of `depthloom check`. The server completes keys,
//! kinds, ports, parameters, references and paths of variants; shows documentation and resolved values on hover; finds
//! definitions and uses; and renames. An error in one request is the response to that request.

mod checks;
mod completion;
mod cursor;
mod documents;
mod hover;
mod navigation;
mod outline;
mod positions;
mod reuse;
mod server;
mod symbols;
mod transport;
mod uris;
mod view;

pub use reuse::{Reuse, ReusedNode};
pub use server::serve;
