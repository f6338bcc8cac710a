//! `kill -9` at a random moment.
//!
//! What is left is the beginning of the recording that the whole run writes, byte for byte; a report of it gives the
//! table of its whole frames and says that it is unfinished; the same run begun again ends with the same bytes.

use crate::answer::{Answer, files};
use crate::case::Case;
use crate::ground::{REPORT, RUN, Reference};
use crate::left::{begin_again, look};
use crate::verdict::{Verdict, fault, judge};

const KILL: i32 = 9;

pub(crate) fn street(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    killed(case, reference, 1)
}

/// A training killed one to three times.
pub(crate) fn learning(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.learn();
    let times = 1 + case.random.below(3);
    killed(case, reference, times)
}

fn killed(case: &mut Case<'_>, reference: &Reference, times: usize) -> Verdict {
    case.write("experiment.yaml", reference.experiment);
    let mut verdict = Verdict::Equal;
    for attempt in 0..times {
        let mut command = case.depthloom(&RUN);
        if attempt > 0 {
            command.arg("--overwrite");
        }
        let mut running = case.start(&mut command);
        case.wait_within(&mut running, reference.took.mul_f64(1.1));
        running.signal("KILL");
        let ended = case.end(running);
        verdict = look(case, reference, &ended, &[KILL]);
        if !matches!(verdict, Verdict::Error | Verdict::Said) {
            return verdict;
        }
    }
    begin_again(case, reference, verdict)
}

/// A killed report leaves files that are whole or not there, and the next report is right.
pub(crate) fn report(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    case.write("recording.mcap", &reference.recording);
    let mut running = case.start(&mut case.depthloom(&REPORT));
    case.wait_within(&mut running, reference.took.mul_f64(0.5));
    running.signal("KILL");
    let ended = case.end(running);
    if let Some(fault) = fault(&ended) {
        return fault;
    }
    let left = files(&case.at("out"));
    let damaged =
        left.iter().find(|(name, bytes)| reference.report.files.get(*name).is_some_and(|whole| whole != *bytes));
    if let Some((name, _)) = damaged {
        return Verdict::different(format!("a killed report left a {name} that is not whole"));
    }
    let ended = case.run(&mut case.depthloom(&REPORT));
    let mut answer = Answer::new(&ended, &case.at("out"));
    // A file under another name than its final one may stay.
    answer.files.retain(|name, _| !name.ends_with(".partial"));
    judge(&ended, || match reference.report.difference(&answer) {
        None => Verdict::Equal,
        Some(difference) => Verdict::different(format!("the report after a killed one: {difference}")),
    })
}
