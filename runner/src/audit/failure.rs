//! A failed audit: the value that differs, the likely cause, and how to proceed.

/// A reused value that differs from the recomputed one.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a reused value is not what {producer} computes now{}: {what}{}", on_frame(.frame), in_recording(.stored_in))]
pub struct AuditFailure {
    /// The node or source, as named in the experiment.
    pub producer: String,
    /// The output port.
    pub port: String,
    /// The frame's id; `None` for an aggregate value.
    pub frame: Option<String>,
    /// The first difference.
    pub what: String,
    /// What may have changed although the cache key has not.
    pub cause: Cause,
    /// The recording with the value.
    pub stored_in: Option<String>,
}

/// What a cache key did not include.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The node is not deterministic.
    NotDeterministic,
    /// The node is a program, which may read what it does not declare.
    Program,
    /// The implementation of a kind, or the machine.
    Implementation,
    /// The data of a source.
    Data,
}

impl AuditFailure {
    /// How to proceed.
    pub fn remedy(&self) -> String {
        let cause = match self.cause {
            Cause::NotDeterministic => {
                "the node gives different values from equal inputs: make it deterministic (fix the seeds of its random numbers)"
            }
            Cause::Program => {
                "its cache key does not include what changed: declare the modules and files that the program reads (`code:`, `reads:`), pass \
                 environment variables in `env:`, or raise `version:`"
            }
            Cause::Implementation => {
                "its implementation changed without a new version of its kind, the machine computes differently, or the recording is damaged \
                 (`depthloom inspect --verify-bytes`)"
            }
            Cause::Data => {
                "the data changed in a way that the cache key of a frame does not include, or the recording is damaged (`depthloom inspect --verify-bytes`)"
            }
        };
        let stale = self.stored_in.as_ref().map_or_else(String::new, |path| {
            format!("; remove the run of {path}, and runs that reused its values, so that no other run reuses them")
        });
        format!("{cause}; `--fresh` recomputes all values{stale}")
    }
}

/// ` on frame 000150_10`, or nothing.
pub(crate) fn on_frame(frame: &Option<String>) -> String {
    frame.as_ref().map_or_else(String::new, |frame| format!(" on frame {frame}"))
}

fn in_recording(path: &Option<String>) -> String {
    path.as_ref().map_or_else(String::new, |path| format!(" (stored in {path})"))
}
