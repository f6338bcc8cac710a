//! Files as read, and places in them.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file as read, or an argument of the command line treated like one.
#[derive(Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// The path as it was given.
    pub name: String,
    /// The whole text.
    pub text: String,
    folder: PathBuf,
}

impl SourceFile {
    /// A file of that name and text; relative paths written in it start at `folder`.
    pub fn new(name: impl Into<String>, text: impl Into<String>, folder: impl Into<PathBuf>) -> Self {
        Self { name: name.into(), text: text.into(), folder: folder.into() }
    }

    /// Where relative paths written in this file start.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The line and column of a byte offset, both counted from 1, columns in characters.
    pub fn line_column(&self, offset: usize) -> (usize, usize) {
        let before = &self.text[..self.boundary(offset)];
        let start = before.rfind('\n').map_or(0, |at| at + 1);
        (before.matches('\n').count() + 1, before[start..].chars().count() + 1)
    }

    /// The largest character boundary at or before an offset.
    pub(crate) fn boundary(&self, offset: usize) -> usize {
        let mut offset = offset.min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        offset
    }
}

/// A stretch of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file.
    pub file: Arc<SourceFile>,
    /// Byte offsets of the words meant.
    pub span: Range<usize>,
}

impl Place {
    /// A stretch of a file, cut to the file's size and to whole characters.
    pub fn new(file: &Arc<SourceFile>, span: &Range<usize>) -> Self {
        let start = file.boundary(span.start);
        Self { file: Arc::clone(file), span: start..file.boundary(span.end.max(start)) }
    }

    /// The beginning of a file, for what a file lacks as a whole.
    pub fn start_of(file: &Arc<SourceFile>) -> Self {
        Self::new(file, &(0..0))
    }

    /// All of a file.
    pub fn whole(file: &Arc<SourceFile>) -> Self {
        Self::new(file, &(0..file.text.len()))
    }

    /// Whether it is in this file.
    pub fn is_in(&self, file: &Arc<SourceFile>) -> bool {
        Arc::ptr_eq(&self.file, file)
    }

    /// Whether another place is within this one.
    pub fn contains(&self, inner: &Self) -> bool {
        self.is_in(&inner.file) && self.span.start <= inner.span.start && inner.span.end <= self.span.end
    }

    /// The line and column of its first character, as in [`SourceFile::line_column`].
    pub fn line_column(&self) -> (usize, usize) {
        self.file.line_column(self.span.start)
    }

    /// The line and column after its last character.
    pub fn end(&self) -> (usize, usize) {
        self.file.line_column(self.span.end.max(self.span.start))
    }

    /// The words meant.
    pub fn text(&self) -> &str {
        self.file.text.get(self.span.clone()).unwrap_or_default()
    }

    /// A part of the words, if they are `whole` or its end (`--matrix` adds `matrix.` in front); otherwise all of
    /// them, e.g. of an aliased scalar.
    pub fn part(&self, whole: &str, part: Range<usize>) -> Self {
        let inner = match self.text() {
            text if text == whole => self.span.start,
            text if !text.is_empty() && whole.ends_with(text) => {
                let ahead = whole.len() - text.len();
                let inner = part.start.saturating_sub(ahead)..part.end.saturating_sub(ahead);
                return if inner.is_empty() { self.clone() } else { self.part(text, inner) };
            }
            // Quoted without escapes: the same words one byte further on.
            text if text.len() == whole.len() + 2 && text.get(1..=whole.len()) == Some(whole) => self.span.start + 1,
            _ => return self.clone(),
        };
        Self::new(&self.file, &(inner + part.start..inner + part.end))
    }
}

/// `file:line:column`.
impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (line, column) = self.line_column();
        write!(f, "{}:{line}:{column}", self.file.name)
    }
}
