//! What a run left that was ended before its end: readable to its last whole frame, and the same run begun again ends
//! as if nothing had been.

use std::fs;
use std::path::{Path, PathBuf};

use crate::answer::Answer;
use crate::case::Case;
use crate::child::Ended;
use crate::ground::{RUN, Reference};
use crate::records;
use crate::verdict::{Verdict, fault, says_it_is_not_whole};

/// Looks at what an ended run of the reference's experiment left in the folder `run` or beside it.
///
/// `by`: the signals it may have died of. A run that ended whole must have the reference's answer.
pub(crate) fn look(case: &mut Case<'_>, reference: &Reference, ended: &Ended, by: &[i32]) -> Verdict {
    if let Some(fault) = fault(ended) {
        return fault;
    }
    let whole = case.at("run");
    let answer = Answer::new(ended, &whole);
    if ended.succeeded() {
        return match reference.run.difference_in_files(&answer) {
            None => Verdict::Equal,
            Some(difference) => Verdict::different(format!("exit 0, and {difference}")),
        };
    }
    if ended.signal.is_some_and(|signal| !by.contains(&signal)) {
        return Verdict::different(format!("ended by {}", ended.summary()));
    }
    if whole.exists() {
        // The folder has its final name when everything in it is whole: what came too late cost nothing.
        return match reference.run.difference_in_files(&answer) {
            None => Verdict::Error,
            Some(difference) => Verdict::different(format!("a final folder that is not whole: {difference}")),
        };
    }
    match recording_in(&case.folder) {
        Some(path) => look_at_recording(case, reference, &path, ended.signal == Some(9)),
        None => Verdict::Error,
    }
}

fn look_at_recording(case: &mut Case<'_>, reference: &Reference, path: &Path, killed: bool) -> Verdict {
    let bytes = fs::read(path).expect("the recording can be read");
    let frames = records::commits(&bytes).len();
    case.note(format!("  left {} bytes, {frames} whole frames", bytes.len()));
    if killed && !reference.recording.starts_with(&bytes) {
        return Verdict::different("the rest after a kill is not a beginning of the complete recording");
    }
    let left = case.home.join("left");
    let ended = case.run(case.depthloom(&["report", "--out"]).arg(&left).arg(path));
    if let Some(fault) = fault(&ended) {
        return fault;
    }
    if !ended.succeeded() {
        return match frames {
            0 => Verdict::Error,
            _ => Verdict::different(format!("{frames} whole frames cannot be read: {}", ended.summary())),
        };
    }
    let answer = Answer::new(&ended, &left);
    let _ = fs::remove_dir_all(&left);
    let is_right = |files: &Answer| files.difference_in_files(&answer).is_none();
    let right = reference.of_frames(frames).filter_map(|shorter| shorter.answer.as_ref()).any(is_right);
    match (right, says_it_is_not_whole(&ended)) {
        // Ended after its last frame: nothing is missing that a word would be about.
        (true, false) if reference.recording == bytes => Verdict::Error,
        (true, true) => Verdict::Said,
        (true, false) => Verdict::different(format!("a table of {frames} frames, and no word that the run was ended")),
        (false, _) => Verdict::different(format!("a table that is not that of the {frames} whole frames")),
    }
}

/// Repeats the same run in its place, which must give the undisturbed answer; otherwise returns the previous verdict.
pub(crate) fn begin_again(case: &mut Case<'_>, reference: &Reference, before: Verdict) -> Verdict {
    if !matches!(before, Verdict::Error | Verdict::Said) {
        return before;
    }
    let ended = case.run(case.depthloom(&RUN).arg("--overwrite"));
    if let Some(fault) = fault(&ended) {
        return fault;
    }
    if !ended.succeeded() {
        return Verdict::different(format!("the run begun again ended with {}", ended.summary()));
    }
    match reference.run.difference(&Answer::new(&ended, &case.at("run"))) {
        None => before,
        Some(difference) => Verdict::different(format!("the run begun again: {difference}")),
    }
}

/// The recording below a folder.
pub(crate) fn recording_in(folder: &Path) -> Option<PathBuf> {
    fs::read_dir(folder).ok()?.flatten().find_map(|entry| {
        let path = entry.path();
        if path.is_dir() { recording_in(&path) } else { path.ends_with("recording.mcap").then_some(path) }
    })
}
