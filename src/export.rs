//! Values of a recording as files that other programs read: `<out>/<topic>/<frame>.<ending>`, and what there is once a stage, or a row a
//! frame, as `<out>/<topic>.<ending>`.

mod folder;
mod form;
mod frames;
mod maps;
mod once;
mod topics;

pub use folder::Folder;
pub use form::Form;
pub use frames::{Frames, frames};
pub use maps::Maps;
pub use once::{write_model, write_rows};
pub use topics::{Chosen, chosen};

use std::path::PathBuf;

use serde_json::{Value as Json, json};

/// What a topic was exported to.
pub struct Exported {
    /// The name under which it was asked for.
    pub name: String,
    /// What it carries.
    pub value_type: &'static str,
    /// The format.
    pub format: &'static str,
    /// Where its files lie in the folder: `look/depth/depth/<frame>.png`.
    pub path: PathBuf,
    /// How many there are.
    pub files: u64,
    /// Pixels whose answer the format does not hold.
    pub clipped: u64,
}

impl Exported {
    /// For programs.
    pub fn json(&self) -> Json {
        json!({
            "topic": self.name,
            "type": self.value_type,
            "format": self.format,
            "path": self.path.to_string_lossy(),
            "files": self.files,
            "clipped_pixels": self.clipped,
        })
    }
}
