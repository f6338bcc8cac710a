//! Which frames are exported, and what their files are called.

use std::collections::BTreeSet;

use depthloom_graphs::contracts::FrameSelection;
use depthloom_recording::{RecordedFrame, Recording};

use crate::exit::{Exit, Stop, chain};
use crate::plain;

/// The frames of a stage run that are exported.
pub struct Frames {
    /// Their positions in the run, ascending.
    pub positions: Vec<usize>,
    /// By position, what a frame's files are called, whichever others are exported: its id, with its position behind it where an
    /// earlier frame of the run has the same.
    pub names: Vec<String>,
}

/// The frames of each stage run that `selection` selects among those of `runs`, all of them without one. A frame that none of these runs
/// has is an error.
pub fn frames(
    recording: &Recording,
    runs: &BTreeSet<usize>,
    selection: Option<&FrameSelection>,
) -> Result<Vec<Frames>, Stop> {
    let all: Vec<&RecordedFrame> = runs.iter().flat_map(|run| recording.frames(*run)).collect();
    let selected: Box<dyn Fn(&RecordedFrame) -> bool> = match selection {
        None => Box::new(|_| true),
        Some(selection @ FrameSelection::File(_)) => {
            let ids: BTreeSet<String> = select(selection, &all)?.into_iter().map(|(_, id)| id.to_owned()).collect();
            Box::new(move |frame| ids.contains(&*frame.id))
        }
        Some(selection) => {
            let indices: BTreeSet<u64> = select(selection, &all)?.into_iter().map(|(index, _)| index).collect();
            Box::new(move |frame| indices.contains(&frame.index))
        }
    };
    let of_run = |run| {
        let frames = recording.frames(run);
        let is_one = |(_, frame): &(usize, &RecordedFrame)| runs.contains(&run) && selected(frame);
        Frames { positions: frames.iter().enumerate().filter(is_one).map(|(at, _)| at).collect(), names: names(frames) }
    };
    Ok((0..recording.plan().runs.len()).map(of_run).collect())
}

/// Index and id of the frames that a selection takes of these; of several with one index any.
fn select<'a>(selection: &FrameSelection, frames: &[&'a RecordedFrame]) -> Result<Vec<(u64, &'a str)>, Stop> {
    let mut there: Vec<(u64, &str)> = frames.iter().map(|frame| (frame.index, &*frame.id)).collect();
    there.sort_unstable();
    if matches!(selection, FrameSelection::File(_)) {
        there.dedup();
    } else {
        there.dedup_by_key(|(index, _)| *index);
    }
    let selected = selection.select(&there).map_err(|fault| {
        let stop = Stop::new(Exit::Before, format!("failed to select frames: {}", chain(&fault)));
        match fault.remedy_text() {
            Some(remedy) => stop.remedy(remedy),
            None => stop,
        }
    })?;
    Ok(selected.into_iter().map(|at| there[at]).collect())
}

fn names(frames: &[RecordedFrame]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let name = |(position, frame): (usize, &RecordedFrame)| {
        let mut name = plain::file_name(&frame.id);
        while !taken.insert(name.clone()) {
            name = format!("{name}-{position}");
        }
        name
    };
    frames.iter().enumerate().map(name).collect()
}
