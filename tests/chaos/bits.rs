//! Bits flipped one at a time, reported or resumed by the program.
//!
//! A bit of a whole recording: an error, or the very same answer. Where the bit makes the file look unfinished, the
//! same tables with a word about it are the same answer, too. A bit of an unfinished recording: an error, the answer of
//! the recording as it was, or that of one cut earlier: what follows a damaged record cannot be distinguished from what
//! a kill left. The last must be reported. Tables that come with an error are those of the recording or of a cut one,
//! too. A bit of a checkpoint: the training begun again ends with the same bytes, or in an error.

use std::fs;

use crate::answer::{Answer, files};
use crate::case::{Case, copy_folder};
use crate::ground::{REPORT, RUN, Reference};
use crate::verdict::{Verdict, judge, says_it_is_not_whole};

/// The beginning of a recording holds its plan, its settings and the first frame.
const HEAD: usize = 40_000;

pub(crate) fn whole(case: &mut Case<'_>) -> Verdict {
    let reference = of_any(case);
    in_whole(case, reference, reference.recording.len())
}

pub(crate) fn whole_head(case: &mut Case<'_>) -> Verdict {
    let reference = of_any(case);
    in_whole(case, reference, HEAD)
}

pub(crate) fn unfinished(case: &mut Case<'_>) -> Verdict {
    let reference = of_any(case);
    in_unfinished(case, reference, reference.unfinished.len())
}

pub(crate) fn unfinished_head(case: &mut Case<'_>) -> Verdict {
    let reference = of_any(case);
    in_unfinished(case, reference, HEAD)
}

/// The recording of the street, or that of the learning.
fn of_any<'a>(case: &mut Case<'a>) -> &'a Reference {
    if case.random.chance(3) { case.ground.learn() } else { case.ground.street() }
}

/// An error, unless the tables beside it are of no part of the recording.
fn without_other_tables(reference: &Reference, answer: &Answer, verdict: Verdict) -> Verdict {
    match verdict {
        Verdict::Error if !reference.has_part_of_a_cut(answer) => {
            Verdict::different("an error, and tables of no part of the recording")
        }
        verdict => verdict,
    }
}

fn in_whole(case: &mut Case<'_>, reference: &Reference, within: usize) -> Verdict {
    let (ended, answer) = reported(case, &reference.recording, within);
    let verdict =
        judge(&ended, || match (reference.report.difference(&answer), reference.report.difference_in_files(&answer)) {
            (None, _) => Verdict::Equal,
            (_, None) if says_it_is_not_whole(&ended) => Verdict::Said,
            (Some(difference), _) => Verdict::Different(difference),
        });
    without_other_tables(reference, &answer, verdict)
}

fn in_unfinished(case: &mut Case<'_>, reference: &Reference, within: usize) -> Verdict {
    let (ended, answer) = reported(case, &reference.unfinished, within);
    let undamaged = reference.up_to(reference.unfinished.len()).answer.as_ref().expect("it holds frames");
    let verdict = judge(&ended, || match undamaged.difference(&answer) {
        None => Verdict::Equal,
        Some(difference) => match reference.of_a_cut(&answer) {
            Some(_) if says_it_is_not_whole(&ended) => Verdict::Said,
            Some(frames) => Verdict::different(format!("an answer of {frames} frames, and no word about it")),
            None => Verdict::Different(difference),
        },
    });
    without_other_tables(reference, &answer, verdict)
}

fn reported(case: &mut Case<'_>, recording: &[u8], within: usize) -> (crate::child::Ended, Answer) {
    let mut bytes = recording.to_vec();
    let within = within.min(bytes.len());
    let what = case.random.flip(&mut bytes[..within]);
    case.note(what);
    case.write("recording.mcap", bytes);
    let ended = case.run(&mut case.depthloom(&REPORT));
    let answer = Answer::new(&ended, &case.at("out"));
    (ended, answer)
}

pub(crate) fn checkpoint(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.learn();
    copy_folder(case.ground.checkpoints(), &case.at("checkpoints"));
    let found = files(&case.at("checkpoints"));
    let names: Vec<&String> = found.keys().filter(|name| !found[*name].is_empty()).collect();
    let name = names[case.random.below(names.len())];
    let mut bytes = found[name].clone();
    // The header is a small part of the file and decides most.
    let within = if case.random.chance(4) { bytes.len().min(8192) } else { bytes.len() };
    let what = case.random.flip(&mut bytes[..within]);
    case.note(format!("{name}: {what}"));
    fs::write(case.at("checkpoints").join(name), bytes).expect("written");
    case.write("experiment.yaml", reference.experiment);
    let ended = case.run(&mut case.depthloom(&RUN));
    let answer = Answer::new(&ended, &case.at("run"));
    judge(&ended, || match reference.run.difference(&answer) {
        None => Verdict::Equal,
        Some(difference) => Verdict::Different(difference),
    })
}
