//! Why a recording could not be analysed.

use std::io;
use std::path::{Path, PathBuf};

use depthloom_durable::remedy_of_writing;
use depthloom_figures::page::PageError;
use depthloom_graphs::language::nearest;
use depthloom_graphs::{ErrorMessage, Remedied};
use depthloom_recording::RecordingError;
use depthloom_threads::Caught;
use polars::error::PolarsError;

/// Why a recording could not be analysed.
#[derive(Debug, thiserror::Error)]
pub enum AnalysisError {
    /// The analysis was stopped; files that it had not written yet are unchanged.
    #[error("stopped before it was finished")]
    Stopped,
    /// The recording cannot be read.
    #[error("failed to read the recording")]
    Recording {
        /// Why.
        source: RecordingError,
        /// The files that were written before the error and are complete.
        complete: Option<String>,
    },
    /// The recording contains something that an analysis cannot use.
    #[error("{what}")]
    Content {
        /// The content, and its location.
        what: String,
    },
    /// The request names something that does not exist or cannot be computed.
    #[error(transparent)]
    Request(ErrorMessage),
    /// A file cannot be written.
    #[error("failed to write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        #[source]
        source: io::Error,
    },
    /// A file cannot be read.
    #[error("failed to read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        #[source]
        source: io::Error,
    },
    /// A table cannot be computed or read.
    #[error("failed to compute {what}")]
    Compute {
        /// What was being computed.
        what: String,
        /// The error of polars.
        #[source]
        source: Box<PolarsError>,
    },
    /// A panic in the analysis or in one of its libraries.
    #[error("the analysis panicked: {what}; this is a bug in depthloom: please report it")]
    Panicked {
        /// The message of the panic.
        what: String,
    },
}

impl From<RecordingError> for AnalysisError {
    fn from(source: RecordingError) -> Self {
        Self::Recording { source, complete: None }
    }
}

impl From<PageError> for AnalysisError {
    fn from(error: PageError) -> Self {
        match error {
            PageError::Stopped => Self::Stopped,
            PageError::Recording(source) => source.into(),
            PageError::Content(what) => Self::Content { what },
            PageError::Write { path, source } => Self::Write { path, source },
            PageError::Panicked(what) => Self::Panicked { what },
        }
    }
}

impl Remedied for AnalysisError {
    fn remedy(&self) -> Option<String> {
        let (source, complete) = match self {
            Self::Recording { source, complete } => (source, complete),
            Self::Request(message) => return message.remedy.clone(),
            Self::Write { source, .. } => return remedy_of_writing(source).map(ToOwned::to_owned),
            _ => return None,
        };
        let complete = complete.as_ref().map(|files| format!("these files are complete: {files}"));
        let remedies: Vec<String> = source.remedy().into_iter().chain(complete).collect();
        (!remedies.is_empty()).then(|| remedies.join("; "))
    }
}

impl AnalysisError {
    /// Whether the recording is damaged.
    #[must_use]
    pub const fn is_damage(&self) -> bool {
        matches!(self, Self::Recording { source, .. } if source.is_damage())
    }

    /// Adds the complete files to an error of reading the recording.
    pub(crate) fn with_complete_files(self, files: &[&str], folder: &Path) -> Self {
        match self {
            Self::Recording { source, .. } if !files.is_empty() => {
                let complete = Some(format!("{} in {}", files.join(", "), folder.display()));
                Self::Recording { source, complete }
            }
            other => other,
        }
    }

    /// For `map_err`: an error of computing `what`.
    pub(crate) fn compute(what: impl Into<String>) -> impl FnOnce(PolarsError) -> Self {
        move |source| Self::Compute { what: what.into(), source: Box::new(source) }
    }

    /// For `map_err`: an error of writing `path`.
    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    /// For `map_err`: an error of reading `path`.
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read { path: path.to_owned(), source }
    }

    /// Recorded content that an analysis cannot use.
    pub(crate) fn content(what: impl Into<String>) -> Self {
        Self::Content { what: what.into() }
    }

    /// A request that cannot be fulfilled; `help` is the remedy.
    pub(crate) fn request(what: String, help: String) -> Self {
        Self::Request(ErrorMessage::new(what).remedy(help))
    }
}

/// The error for an unknown name, with the nearest known name.
pub(crate) fn unknown<'a>(
    what: &str,
    name: &str,
    known: impl IntoIterator<Item = &'a str, IntoIter: Clone>,
) -> AnalysisError {
    let known = known.into_iter();
    let help = nearest_of(name, known.clone()).unwrap_or_else(|| format!("available: {}", listed(known)));
    AnalysisError::request(format!("there is no {what} `{name}`"), help)
}

/// The nearest known name, as a question.
pub(crate) fn nearest_of<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(name, known).map(|near| format!("did you mean `{near}`?"))
}

/// A list of names, shortened if it is long.
pub(crate) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let names: Vec<String> = names.into_iter().map(|name| format!("`{name}`")).collect();
    match names.len() {
        0 => "none".to_owned(),
        1..=SHOWN => names.join(", "),
        all => format!("{} and {} more", names[..SHOWN].join(", "), all - SHOWN),
    }
}

/// Runs `f`; a panic becomes an error.
pub(crate) fn caught<R>(f: impl FnOnce() -> Result<R, AnalysisError>) -> Result<R, AnalysisError> {
    depthloom_threads::caught(f).unwrap_or_else(|Caught(what)| Err(AnalysisError::Panicked { what }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_43_a_panic_is_an_error() {
        let error = caught::<()>(|| panic!("{} is not {}", 2, 3)).unwrap_err();
        assert!(error.to_string().contains("2 is not 3"), "{error}");
    }
}
