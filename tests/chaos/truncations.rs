//! Recordings that are cut.
//!
//! The rest of a cut file is reported up to its last complete frame, with a warning that the file is cut. An error is
//! right only if the plan is missing too, or if a program that reads whole files of that length also refuses it.

use crate::answer::Answer;
use crate::case::Case;
use crate::ground::REPORT;
use crate::records;
use crate::verdict::{Verdict, judge, says_it_is_not_whole};

pub(crate) fn anywhere(case: &mut Case<'_>) -> Verdict {
    let length = case.ground.street().recording.len();
    let at = case.random.below(length);
    cut(case, at)
}

/// A few bytes before or behind the end of a record.
pub(crate) fn near_a_record(case: &mut Case<'_>) -> Verdict {
    let recording = &case.ground.street().recording;
    let ends: Vec<usize> = records::records(recording).iter().map(|record| record.end).collect();
    let end = case.random.pick(&ends) + case.random.below(25);
    cut(case, end.saturating_sub(12).min(recording.len() - 1))
}

fn cut(case: &mut Case<'_>, at: usize) -> Verdict {
    let reference = case.ground.street();
    case.note(format!("cut to {at} of {} bytes", reference.recording.len()));
    case.write("recording.mcap", &reference.recording[..at]);
    let ended = case.run(&mut case.depthloom(&REPORT));
    let answer = Answer::new(&ended, &case.at("out"));
    let left = reference.up_to(at);
    let verdict = judge(&ended, || match left.answer.as_ref().map(|left| left.difference_in_files(&answer)) {
        Some(None) if says_it_is_not_whole(&ended) => Verdict::Said,
        Some(None) => Verdict::different(format!("the answer of {} frames, and no word about it", left.frames)),
        Some(Some(difference)) => Verdict::different(format!("{} frames are whole: {difference}", left.frames)),
        None => Verdict::different("an answer from a recording without a whole frame"),
    });
    match verdict {
        Verdict::Error if left.frames > 0 => Verdict::different(format!(
            "{} whole frames are left, and it cannot be read: {}",
            left.frames,
            ended.summary()
        )),
        verdict => verdict,
    }
}

/// Zeros behind the cut: what a file system may leave after a power cut.
pub(crate) fn zeros(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    let mut bytes = reference.recording.clone();
    let at = case.random.below(bytes.len());
    bytes[at..].fill(0);
    case.note(format!("zeros from byte {at} of {}", bytes.len()));
    case.write("recording.mcap", bytes);
    let ended = case.run(&mut case.depthloom(&REPORT));
    let answer = Answer::new(&ended, &case.at("out"));
    judge(&ended, || match reference.of_a_cut(&answer) {
        Some(_) if reference.report == answer => Verdict::Equal,
        Some(_) if says_it_is_not_whole(&ended) => Verdict::Said,
        Some(frames) => Verdict::different(format!("the answer of {frames} frames, and no word about it")),
        None => Verdict::different("the answer of no part of the recording"),
    })
}
