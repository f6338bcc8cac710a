//! Tags and a note that a person gives a run: `notes.json` in its folder.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;

use depthloom_graphs::regular_file;
use depthloom_terminal::{CliError, ExitCode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::files::NOTES;

/// The most bytes of it that are read.
const LARGEST: u64 = 1 << 20;
const LONGEST_TAG: usize = 64;
const LONGEST_NOTE: usize = 10_000;

/// Tags and a note of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, JsonSchema, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Notes {
    /// Its tags, sorted.
    pub tags: BTreeSet<String>,
    /// Its note, if it has one.
    pub note: Option<String>,
}

impl Notes {
    /// Whether the run has neither a tag nor a note.
    pub fn is_empty(&self) -> bool {
        self.tags.is_empty() && self.note.is_none()
    }

    /// Reads the notes in a run's folder; without the file, returns empty notes.
    ///
    /// # Errors
    /// If the file cannot be read, or has other content.
    pub fn read(folder: &Path) -> Result<Self, CliError> {
        let path = folder.join(NOTES);
        let remedy =
            format!("remove it, or write it as {{\"tags\": [\"NAME\"], \"note\": \"TEXT\"}}: {}", path.display());
        let failed = || format!("failed to read {}", path.display());
        match regular_file::read(&path, LARGEST) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map_err(|error| CliError::because(ExitCode::Usage, failed(), &error).remedy(remedy)),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(CliError::because(ExitCode::Usage, failed(), &error).remedy(remedy)),
        }
    }

    /// Changes the notes in a run's folder. Another process that does so at the same time waits.
    ///
    /// # Errors
    /// As [`read`](Self::read) and [`write`](Self::write), or that of `change`.
    pub fn change(folder: &Path, change: impl FnOnce(&mut Self) -> Result<(), CliError>) -> Result<Self, CliError> {
        // The lock of the folder itself: the marker's is that of the process that writes the run.
        let locked = File::open(folder).and_then(|folder| folder.lock().map(|()| folder));
        let _locked = locked.map_err(|error| {
            CliError::because(ExitCode::Usage, format_args!("failed to lock {}", folder.display()), &error)
        })?;
        let before = Self::read(folder)?;
        let mut notes = before.clone();
        change(&mut notes)?;
        if notes != before {
            notes.write(folder)?;
        }
        Ok(notes)
    }

    /// Writes them into a run's folder, or removes the file if they are empty.
    ///
    /// # Errors
    /// If the file cannot be written.
    ///
    /// # Panics
    /// Never: texts have JSON.
    pub fn write(&self, folder: &Path) -> Result<(), CliError> {
        let path = folder.join(NOTES);
        let written = match self.is_empty() {
            true => match std::fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
                _ => Ok(()),
            },
            false => {
                let json = serde_json::to_value(self).expect("texts have JSON");
                depthloom_durable::write(&path, format!("{json:#}\n").as_bytes())
            }
        };
        written.map_err(|error| {
            CliError::of_writing(ExitCode::Usage, format_args!("failed to write {}", path.display()), &error)
                .remedy("check the permissions of the run's folder, and the space on the disk")
        })
    }
}

/// Why a run is kept: its tag or note. A run whose notes cannot be read is kept as well.
#[must_use]
pub fn mark(folder: &Path) -> Option<String> {
    match Notes::read(folder) {
        Ok(Notes { tags, note }) => {
            let tag = tags.first().map(|tag| format!("it has the tag `{tag}`"));
            tag.or_else(|| note.map(|_| "it has a note".to_owned()))
        }
        Err(_) => Some(format!("its {NOTES} cannot be read")),
    }
}

/// Checks a note: at most 10,000 characters.
///
/// # Errors
/// What is wrong with it.
pub fn parse_note(text: &str) -> Result<String, String> {
    let count = text.chars().count();
    match count <= LONGEST_NOTE {
        true => Ok(text.to_owned()),
        false => Err(format!("a note has at most {LONGEST_NOTE} characters, and this has {count}")),
    }
}

/// Checks a tag: 1 to 64 letters, digits and `-_.:/+`.
///
/// # Errors
/// What is wrong with it.
pub fn parse_tag(text: &str) -> Result<String, String> {
    let is_allowed = |c: char| c.is_alphanumeric() || "-_.:/+".contains(c);
    match text.chars().all(is_allowed)
        && !text.is_empty()
        && text.chars().count() <= LONGEST_TAG
        && !text.starts_with('-')
    {
        true => Ok(text.to_owned()),
        false => Err(format!("a tag has 1 to {LONGEST_TAG} letters, digits and `-_.:/+`, and does not begin with `-`")),
    }
}

#[cfg(test)]
mod tests {
    use super::{Notes, parse_tag};

    #[test]
    fn notes_are_stored_in_a_file_that_disappears_with_them() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(Notes::read(folder.path()).expect("empty"), Notes::default());
        let notes = Notes { tags: ["b".to_owned(), "a".to_owned()].into(), note: Some("ü\n2".to_owned()) };
        notes.write(folder.path()).expect("written");
        assert_eq!(Notes::read(folder.path()).expect("read"), notes);
        Notes::default().write(folder.path()).expect("removed");
        assert!(!folder.path().join("notes.json").exists());
        std::fs::write(folder.path().join("notes.json"), "{\"tag\": []}").expect("written");
        let error = Notes::read(folder.path()).expect_err("another content");
        assert!(error.message.what.contains("notes.json: unknown field `tag`"), "{}", error.message.what);
    }

    #[test]
    fn tags_have_no_spaces_and_no_control_characters() {
        assert!(parse_tag("camera-ready").is_ok() && parse_tag("table:2/ü+1.0").is_ok());
        for wrong in ["", "a b", "a\u{1b}[31m", "-x", "a,b", &"a".repeat(65)] {
            assert!(parse_tag(wrong).is_err(), "{wrong:?}");
        }
    }
}
