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
    /// It was asked to stop: what it has not written yet is what it was.
    #[error("stopped before it was done")]
    Stopped,
    /// The recording cannot be read.
    #[error("failed to read the recording")]
    Recording {
        /// Why.
        source: RecordingError,
        /// What was written before, and is whole.
        whole: Option<String>,
    },
    /// The recording holds something an analysis cannot use.
    #[error("{what}")]
    Content {
        /// What, and where.
        what: String,
    },
    /// The request names what does not exist, or what cannot be computed.
    #[error(transparent)]
    Request(ErrorMessage),
    /// A file cannot be written.
    #[error("failed to write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// A file cannot be read.
    #[error("failed to read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: io::Error,
    },
    /// A table cannot be put together or read.
    #[error("failed to compute {what}")]
    Compute {
        /// What was being computed.
        what: String,
        /// What polars said.
        #[source]
        source: Box<PolarsError>,
    },
    /// An error in the analysis itself, or in a library of its.
    #[error("the analysis panicked: {what}; this is an error in the engine: please report it")]
    Panicked {
        /// What the panic said.
        what: String,
    },
}

impl From<RecordingError> for AnalysisError {
    fn from(source: RecordingError) -> Self {
        Self::Recording { source, whole: None }
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
        let (source, whole) = match self {
            Self::Recording { source, whole } => (source, whole),
            Self::Request(message) => return message.remedy.clone(),
            Self::Write { source, .. } => return remedy_of_writing(source).map(ToOwned::to_owned),
            _ => return None,
        };
        let whole = whole.as_ref().map(|whole| format!("what is whole all the same: {whole}"));
        let remedies: Vec<String> = source.remedy().into_iter().chain(whole).collect();
        (!remedies.is_empty()).then(|| remedies.join("; "))
    }
}

impl AnalysisError {
    /// Whether it is that the recording is damaged.
    #[must_use]
    pub const fn is_damage(&self) -> bool {
        matches!(self, Self::Recording { source, .. } if source.is_damage())
    }

    /// Where the recording cannot be read: these files are whole.
    pub(crate) fn but_whole(self, files: &[&str], folder: &Path) -> Self {
        match self {
            Self::Recording { source, .. } if !files.is_empty() => {
                let whole = Some(format!("{} in {}", files.join(", "), folder.display()));
                Self::Recording { source, whole }
            }
            other => other,
        }
    }

    /// For `map_err`: what was being computed.
    pub(crate) fn compute(what: impl Into<String>) -> impl FnOnce(PolarsError) -> Self {
        move |source| Self::Compute { what: what.into(), source: Box::new(source) }
    }

    /// For `map_err`: what was being written.
    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source }
    }

    /// For `map_err`: what was being read.
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read { path: path.to_owned(), source }
    }

    /// Something in a recording that an analysis cannot use.
    pub(crate) fn content(what: impl Into<String>) -> Self {
        Self::Content { what: what.into() }
    }

    /// The request names what does not exist; `help` says what does.
    pub(crate) fn asked(what: String, help: String) -> Self {
        Self::Request(ErrorMessage::new(what).remedy(help))
    }
}

/// That something is not there, with the nearest that is.
pub(crate) fn unknown<'a>(
    what: &str,
    wanted: &str,
    known: impl IntoIterator<Item = &'a str, IntoIter: Clone>,
) -> AnalysisError {
    let known = known.into_iter();
    let help = nearest_of(wanted, known.clone()).unwrap_or_else(|| format!("there are {}", listed(known)));
    AnalysisError::asked(format!("there is no {what} `{wanted}`"), help)
}

/// The nearest of what there is, as a question.
pub(crate) fn nearest_of<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(wanted, known).map(|near| format!("did you mean `{near}`?"))
}

/// Names in a row, the first few of many.
pub(crate) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let names: Vec<String> = names.into_iter().map(|name| format!("`{name}`")).collect();
    match names.len() {
        0 => "none".to_owned(),
        1..=SHOWN => names.join(", "),
        all => format!("{} and {} more", names[..SHOWN].join(", "), all - SHOWN),
    }
}

/// Runs `f`; a panic in it is an error as any other.
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
