//! INT, TERM and HUP, once, twice or thrice, in every phase of a run.
//!
//! Exit 0 is the whole answer. Anything else is 130, or the signal itself before the program listens; then what is left
//! is readable and the same run begun again ends with the same bytes. A signal that was ignored when the program began
//! stays ignored.

use std::io::{Read, Write};
use std::time::Duration;

use crate::answer::{Answer, files};
use crate::case::Case;
use crate::child::{Ended, Running};
use crate::ground::{Changes, LEARN_STEPS, RUN, Reference};
use crate::left::{begin_again, look};
use crate::verdict::{Verdict, fault, judge};

/// Name and number.
const SIGNALS: [(&str, i32); 3] = [("INT", 2), ("TERM", 15), ("HUP", 1)];
/// What a pipe of Linux holds.
const PIPE: usize = 65_536;

/// Before the first frame: arguments, plan, sources.
pub(crate) fn at_the_start(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    during(case, reference, reference.took.mul_f64(0.3), || true)
}

pub(crate) fn among_frames(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    let partial = case.at("run.partial");
    during(case, reference, reference.took.mul_f64(0.5), move || size(&partial.join("recording.mcap")) > 0)
}

/// At least a third of the steps before the end: so a checkpoint must be left, and the training not be over.
pub(crate) fn while_learning(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.learn();
    case.write("experiment.yaml", reference.experiment);
    let mut running = case.start(&mut case.depthloom(&RUN));
    let (checkpoints, states) = (case.at("checkpoints"), 1 + case.random.below(LEARN_STEPS * 2 / 3));
    let mut seen = Changes::default();
    let came = running.until(|_| seen.look(&checkpoints) >= states);
    let number = send(case, &mut running);
    let ended = case.end(running);
    let verdict = interrupted(case, reference, &ended, number);
    let is_lost = came && ended.code == Some(130) && files(&checkpoints).is_empty();
    if is_lost && matches!(verdict, Verdict::Error | Verdict::Said) {
        return Verdict::different(format!("asked to stop at checkpoint {states}, it left none"));
    }
    begin_again(case, reference, verdict)
}

pub(crate) fn in_the_analysis(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    let partial = case.at("run.partial");
    during(case, reference, reference.took.mul_f64(0.3), move || partial.join("timings.parquet").exists())
}

fn size(path: &std::path::Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

/// Waits for a phase, then a random part of its length, and sends one kind of signal, once to thrice.
fn during(case: &mut Case<'_>, reference: &Reference, length: Duration, come: impl Fn() -> bool) -> Verdict {
    case.write("experiment.yaml", reference.experiment);
    let mut running = case.start(&mut case.depthloom(&RUN));
    running.until(|_| come());
    case.wait_within(&mut running, length);
    let number = send(case, &mut running);
    let ended = case.end(running);
    let verdict = interrupted(case, reference, &ended, number);
    begin_again(case, reference, verdict)
}

/// What a run that was asked to stop came to.
fn interrupted(case: &mut Case<'_>, reference: &Reference, ended: &Ended, number: i32) -> Verdict {
    match (fault(ended), ended.code) {
        (Some(fault), _) => fault,
        (None, Some(0 | 130) | None) => look(case, reference, ended, &[number]),
        (None, Some(_)) => Verdict::different(format!("an interrupted run ended with {}", ended.summary())),
    }
}

/// Sends a signal once to thrice; gives its number.
fn send(case: &mut Case<'_>, running: &mut Running) -> i32 {
    let (name, number) = case.random.pick(&SIGNALS);
    let times = 1 + case.random.below(3);
    case.note(format!("  {name}, {times} times"));
    for time in 0..times {
        if time > 0 {
            case.wait_within(running, Duration::from_millis(20));
        }
        running.signal(name);
    }
    number
}

/// While the program waits for a reader of what it prints.
pub(crate) fn while_printing(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    case.write("experiment.yaml", reference.experiment);
    let (mut reader, mut writer) = std::io::pipe().expect("a pipe");
    writer.write_all(&[b'-'; PIPE]).expect("a pipe holds as much");
    let mut running = case.start_into(&mut case.depthloom(&RUN), Some(writer.into()), None);
    let whole = case.at("run");
    running.until(|_| whole.join("recording.mcap").exists());
    case.wait_within(&mut running, Duration::from_millis(30));
    let number = send(case, &mut running);
    // Now the output is read: a program that received a signal to stop must not wait for more.
    let read = std::thread::spawn(move || reader.read_to_end(&mut Vec::new()).map(drop));
    let ended = case.end(running);
    read.join().expect("reading does not panic").expect("a pipe can be read");
    let verdict = interrupted(case, reference, &ended, number);
    begin_again(case, reference, verdict)
}

/// What `nohup` and a shell's background jobs ignore stays ignored.
pub(crate) fn ignored(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    case.write("experiment.yaml", reference.experiment);
    let (name, _) = case.random.pick(&SIGNALS);
    let ignoring = format!("trap '' {name}; exec \"$0\" \"$@\"");
    let mut running = case.start(&mut case.depthloom_by(&["sh", "-c", &ignoring], &RUN));
    running.until(|running| case.is_depthloom(running));
    case.wait_within(&mut running, reference.took.mul_f64(0.9));
    for _ in 0..1 + case.random.below(3) {
        running.signal(name);
    }
    case.note(format!("  {name}, which is ignored"));
    let ended = case.end(running);
    let answer = Answer::new(&ended, &case.at("run"));
    let verdict = judge(&ended, || match reference.run.difference(&answer) {
        None => Verdict::Equal,
        Some(difference) => Verdict::Different(difference),
    });
    match verdict {
        Verdict::Error => Verdict::different(format!("an ignored {name} ended the run: {}", ended.summary())),
        verdict => verdict,
    }
}
