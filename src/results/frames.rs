//! The frames of `--frames`.

use depthloom_analysis::{FrameChoice, frames_beyond};
use depthloom_recording::Recording;
use depthloom_terminal::say;

/// Notes on standard error that a range of frames is longer than a run.
pub(crate) fn note_frames_beyond<'r>(
    recordings: impl IntoIterator<Item = &'r Recording>,
    choice: Option<&FrameChoice>,
) {
    let Some(choice) = choice else { return };
    for recording in recordings {
        if let Some(what) = frames_beyond(recording, choice) {
            say(format_args!("note: --frames is longer than {}: {what}", recording.path().display()));
        }
    }
}
