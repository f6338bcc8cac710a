//! MCAP recordings.

use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Registry, ValueType};
use depthloom_recording::{Mcap, Recording};
use serde_json::json;

use crate::Target;
use crate::sources::read_all;

/// A recording: opened, every topic of every frame read, recovered where it is cut, and read as a source.
pub(crate) fn target() -> Target {
    let seeds = vec![include_bytes!("../seeds/recording.mcap").to_vec()];
    Target::new("recording", seeds, |bytes, folder| {
        let path = folder.join("recording.mcap");
        std::fs::write(&path, bytes).expect("the folder takes a file");
        let recording = Recording::open(&path).map_err(|error| error.to_string())?;
        for run in RunId::all(recording.plan().runs.len()) {
            let outputs = recording.plan().outputs(run).filter(|(_, output)| output.recorded && !output.once);
            let topics: Vec<String> = outputs
                .filter(|(_, output)| output.value_type() != Some(ValueType::Curve))
                .map(|(_, output)| output.topic.clone())
                .collect();
            let mut reader = recording.reader(run, &topics).map_err(|error| error.to_string())?;
            for position in FrameIndex::all(recording.frames(run).len()) {
                reader.read(position).map_err(|error| error.to_string())?;
            }
        }
        read_all(&Registry::default().source::<Mcap>(), "mcap", &json!({ "path": path }))
    })
}
