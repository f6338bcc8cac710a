//! Which frames are exported, and what their files are called.

use std::collections::BTreeSet;

use depthloom_analysis::FrameChoice;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::{RecordedFrame, Recording};
use depthloom_terminal::CliError;

use depthloom_runs::failed;
use depthloom_runs::file_name;

/// The frames of a stage run that are exported.
pub struct Frames {
    /// Their positions in the run, ascending.
    pub positions: Vec<FrameIndex>,
    /// By position, what a frame's files are called, whichever others are exported: its id, with its position behind it
    /// where an earlier frame of the run has the same.
    pub names: Vec<String>,
}

/// The frames of each stage run that `choice` takes among those of `runs`, all of them without one. A frame that none
/// of these runs has is an error.
///
/// # Errors
/// If `choice` names a frame that none of these runs has.
pub fn frames(
    recording: &Recording,
    runs: &BTreeSet<RunId>,
    choice: Option<&FrameChoice>,
) -> Result<Vec<Frames>, CliError> {
    let frames_of = |run: RunId| FrameIndex::all(recording.frames(run).len()).map(move |frame| (run, frame));
    let places: Vec<(RunId, FrameIndex)> = runs.iter().flat_map(|run| frames_of(*run)).collect();
    let all: Vec<&RecordedFrame> = places.iter().map(|&(run, at)| &recording.frames(run)[at]).collect();
    let chosen: BTreeSet<(RunId, FrameIndex)> = match choice {
        None => places.into_iter().collect(),
        Some(choice) => {
            let positions = choice.positions(&all).map_err(failed)?;
            positions.into_iter().map(|at| places[at]).collect()
        }
    };
    let chosen_of = |run| Frames {
        positions: frames_of(run).filter(|frame| chosen.contains(frame)).map(|(_, position)| position).collect(),
        names: names(recording.frames(run)),
    };
    Ok(RunId::all(recording.plan().runs.len()).map(chosen_of).collect())
}

fn names(frames: &[RecordedFrame]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let name = |(position, frame): (usize, &RecordedFrame)| {
        let mut name = file_name(&frame.id);
        while !taken.insert(name.clone()) {
            name = format!("{name}-{position}");
        }
        name
    };
    frames.iter().enumerate().map(name).collect()
}
