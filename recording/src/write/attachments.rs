//! The files inside a recording: the experiment, the artefacts of aggregate nodes, and what a run adds.

use std::path::Path;

use depthloom_graphs::plan::Plan;
use depthloom_graphs::values::Artifact;

/// A file inside a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Its name, with `/` between folders.
    pub name: String,
    /// Its media type, e.g. `text/csv`.
    pub media_type: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

pub(crate) fn artifact_name(artifact: &Artifact) -> String {
    format!("artifacts/{}", artifact.hash)
}

/// The experiment's files, as written and as resolved, with the names of their attachments: without folders, which
/// differ between machines.
pub(crate) fn experiment_files(plan: &Plan) -> Vec<(String, &str)> {
    let mut files: Vec<(String, &str)> = Vec::new();
    for (path, text) in &plan.written {
        let name = Path::new(path).file_name().map_or_else(|| path.clone(), |name| name.to_string_lossy().into_owned());
        let mut attachment = format!("experiment/{name}");
        if files.iter().any(|(taken, _)| *taken == attachment) {
            attachment = format!("experiment/{}-{name}", files.len());
        }
        files.push((attachment, text));
    }
    files.push(("experiment.resolved.yaml".to_owned(), &plan.resolved));
    files
}
