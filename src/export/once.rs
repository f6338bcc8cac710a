//! What there is once a stage: learnt models.

use depthloom_graphs::contracts::Slot;
use depthloom_recording::Recording;

use super::{Chosen, Exported, Folder};
use crate::args::ExportFormat;
use crate::exit::{Exit, Stop};

/// Writes the learnt model of a topic.
pub fn write_model(recording: &Recording, chosen: &Chosen<'_>, folder: &Folder) -> Result<Exported, Stop> {
    let path = chosen.path_with(ExportFormat::Onnx.name());
    let mut files = 0;
    let is_it = |run, node, port| run == chosen.run && Slot::Node { node, port } == chosen.slot;
    if let Some(once) = recording.once_values().iter().find(|once| is_it(once.run, once.node, once.port)) {
        let value = recording.once_value(once).map_err(|error| {
            let exit = if error.is_damage() { Exit::Frames } else { Exit::Engine };
            Stop::of_recording(exit, "failed to read a learnt model", &error)
        })?;
        if let Some(model) = value.artifact() {
            folder.write(&path, &model.bytes)?;
            files = 1;
        }
    }
    Ok(Exported {
        name: chosen.name.to_owned(),
        value_type: chosen.value_type.name(),
        format: ExportFormat::Onnx.name(),
        path,
        files,
        clipped: 0,
    })
}
