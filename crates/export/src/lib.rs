//! Values of a recording as files that other programs read: `<out>/<topic>/<frame>.<ending>`, and values once per
//! stage, or rows per frame, as `<out>/<topic>.<ending>`.

#![forbid(unsafe_code)]

mod aggregates;
mod folder;
mod form;
mod format;
mod frames;
mod maps;
mod topics;

pub use aggregates::{write_learned, write_rows};
pub use folder::Folder;
pub use form::Form;
pub use format::ExportFormat;
pub use frames::{Frames, frames};
pub use maps::Maps;
pub use topics::{Chosen, chosen};

use schemars::JsonSchema;
use serde::Serialize;

/// The files of a topic in a format.
#[derive(JsonSchema, Serialize)]
pub struct Exported {
    /// The name under which it was requested.
    pub topic: String,
    /// What its values are.
    #[serde(rename = "type")]
    pub value_type: &'static str,
    /// The format of the files.
    pub format: &'static str,
    /// Their path in the folder.
    pub path: String,
    /// How many files.
    pub files: u64,
    /// Valid pixels whose number the format cannot store.
    pub clipped_pixels: u64,
}
