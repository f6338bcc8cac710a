//! What a run learned, as files with readable names: `models/<stage>.<node>[.<variant>].onnx`, or `.json` for a
//! reliability.

use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use depthloom_recording::{RecordedAggregate, RecordedContent, RecordedPlan, Recording};
use depthloom_terminal::{CliError, ExitCode};

use crate::files::MODELS;
use crate::opening::read_failed;

/// Writes the models of a recording into `<folder>/models`.
///
/// # Errors
/// If a model cannot be read or its file cannot be written.
pub fn write(recording: &Recording, folder: &Path) -> Result<(), CliError> {
    let folder = folder.join(MODELS);
    let failed = |error: &io::Error| {
        CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", folder.display()), error)
    };
    for (value, name) in names(recording) {
        let RecordedContent::Attachment { name: attachment, .. } = &value.content else { continue };
        let bytes = recording.attachment(attachment);
        let bytes = bytes.map_err(|error| read_failed("failed to read a trained model", &error))?;
        depthloom_durable::create_folder(&folder).map_err(|error| failed(&error))?;
        depthloom_durable::write(&folder.join(&name), &bytes).map_err(|error| failed(&error))?;
    }
    Ok(())
}

/// The models of a recording, and the names of their files.
pub fn names<'a>(recording: &'a Recording) -> Vec<(&'a RecordedAggregate, String)> {
    let mut taken = BTreeSet::new();
    let named = |value: &'a RecordedAggregate| {
        let ending = match (&*value.value_type, &value.content) {
            ("model", RecordedContent::Attachment { .. }) => "onnx",
            ("reliability", RecordedContent::Attachment { .. }) => "json",
            _ => return None,
        };
        let stem = stem(recording.plan(), value);
        let names = (1..).map(|n| if n == 1 { format!("{stem}.{ending}") } else { format!("{stem}-{n}.{ending}") });
        let name = names.into_iter().find(|name| !taken.contains(name)).unwrap_or_default();
        taken.insert(name.clone());
        Some((value, name))
    };
    recording.aggregate_values().iter().filter_map(named).collect()
}

/// `<stage>.<node>`, with the first of its variants where it does not serve them all, and its port unless that is
/// the value's type.
fn stem(plan: &RecordedPlan, value: &RecordedAggregate) -> String {
    let Some(run) = plan.runs.get(value.run.0) else { return "model".to_owned() };
    let Some(node) = run.nodes.get(value.node.0) else { return run.stage.clone() };
    let variant = node.variants.first().filter(|_| node.variants.len() < plan.variants.len());
    let variant = variant.and_then(|&variant| plan.variants.get(variant.0)).map(String::as_str);
    let port =
        node.outputs.get(value.port.0).map(|output| output.port.as_str()).filter(|port| *port != value.value_type);
    let parts: Vec<&str> = [run.stage.as_str(), node.name.as_str()].into_iter().chain(port).chain(variant).collect();
    crate::file_name(&parts.join("."))
}
