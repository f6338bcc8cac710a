//! Closed, full and abandoned streams; files of other formats; names that are not text.
//!
//! Files are complete whatever happens to standard output and error. Only output that could not be printed to a full
//! standard output may change the exit code from 0. A message to a broken standard error cannot be read, so none is
//! required.

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::os::unix::ffi::OsStrExt;
use std::process::{Command, Stdio};

use crate::answer::Answer;
use crate::case::Case;
use crate::ground::{REPORT, RUN};
use crate::verdict::{Verdict, fault, judge};

/// What is wrong with a stream.
const WRONG: [&str; 3] = ["closed", "full", "forsaken"];

pub(crate) fn run(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    case.write("experiment.yaml", reference.experiment);
    broken(case, &RUN, |case| {
        reference
            .run
            .difference_in_files(&Answer { files: crate::answer::files(&case.at("run")), ..reference.run.clone() })
    })
}

pub(crate) fn report(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    case.write("recording.mcap", &reference.recording);
    broken(case, &REPORT, |case| {
        let files = crate::answer::files(&case.at("out"));
        reference.report.difference_in_files(&Answer { files, ..reference.report.clone() })
    })
}

pub(crate) fn others(case: &mut Case<'_>) -> Verdict {
    case.write("experiment.yaml", case.ground.street().experiment);
    let commands: [&[&str]; 9] = [
        &["check", "experiment.yaml"],
        &["plan", "experiment.yaml"],
        &["plan", "experiment.yaml", "--json"],
        &["graph", "experiment.yaml"],
        &["nodes"],
        &["nodes", "stereo/sgbm"],
        &["schema"],
        &["doctor"],
        &["check", "none.yaml"],
    ];
    let arguments = case.random.pick(&commands);
    broken(case, arguments, |_| None)
}

/// Runs a command with one or both of its streams broken; `difference` looks at its files.
fn broken(case: &mut Case<'_>, arguments: &[&str], difference: impl FnOnce(&Case<'_>) -> Option<String>) -> Verdict {
    let streams = case.random.pick(&[[true, false], [false, true], [true, true]]);
    let wrong = streams.map(|broken| broken.then(|| case.random.pick(&WRONG)));
    let [stdout, stderr] = wrong;
    case.note(format!("standard output {stdout:?}, standard error {stderr:?}"));
    let closing = [("1>&- ", stdout), ("2>&- ", stderr)].map(|(closing, wrong)| match wrong {
        Some("closed") => closing,
        _ => "",
    });
    let script = format!("exec \"$0\" \"$@\" {}", closing.concat());
    let mut command = case.depthloom_by(&["sh", "-c", &script], arguments);
    let mut readers = Vec::new();
    let mut into = |wrong: Option<&str>, bytes: u64| -> Option<Stdio> {
        match wrong? {
            "full" => Some(fs::OpenOptions::new().write(true).open("/dev/full").ok()?.into()),
            "forsaken" => {
                let (reader, writer) = std::io::pipe().expect("a pipe");
                // The reader reads a little and ends.
                readers.push(std::thread::spawn(move || drop(reader.take(bytes).read_to_end(&mut Vec::new()))));
                Some(writer.into())
            }
            _ => None,
        }
    };
    let bytes = [case.random.within(0..400), case.random.within(0..400)];
    let (out, err) = (into(stdout, bytes[0]), into(stderr, bytes[1]));
    let running = case.start_into(&mut command, out, err);
    drop(command);
    let ended = case.end(running);
    readers.into_iter().for_each(|reader| reader.join().expect("reading does not panic"));

    let is_wrong_file = arguments.contains(&"none.yaml");
    match (fault(&ended), ended.code) {
        // The message cannot be read.
        (Some(Verdict::Different(_)), Some(_)) if stderr.is_some() => {}
        (Some(fault), _) => return fault,
        _ => {}
    }
    if let Some(difference) = difference(case) {
        return Verdict::different(format!("{}: {difference}", ended.summary()));
    }
    match (ended.code, stdout) {
        (Some(0), Some("full")) if !arguments.contains(&"none.yaml") => {
            Verdict::different("exit 0, although the output could not be printed")
        }
        (Some(2), _) if is_wrong_file => Verdict::Error,
        (Some(0), _) if !is_wrong_file => Verdict::Equal,
        (Some(1), Some("full")) if !is_wrong_file => Verdict::Error,
        _ => Verdict::different(format!("only a stream was broken: {}", ended.summary())),
    }
}

/// Files that are neither a recording nor an experiment.
pub(crate) fn no_files(case: &mut Case<'_>) -> Verdict {
    case.write("folder/file", "");
    case.write("empty", "");
    case.write("text", "experiment");
    case.write("bytes", [0xff; 64]);
    let _ = Command::new("mkfifo").arg(case.at("pipe")).status();
    let _ = std::os::unix::fs::symlink("nowhere", case.at("dangling"));
    let _ = std::os::unix::fs::symlink("round", case.at("round"));
    let files = [
        "folder",
        "empty",
        "text",
        "bytes",
        "pipe",
        "dangling",
        "round",
        "none",
        "/dev/null",
        "/dev/zero",
        "/dev/full",
        "/",
        ".",
    ];
    let file = case.random.pick(&files);
    let command = case.random.pick(&["report", "check", "plan", "graph", "run", "timings"]);
    let ended = case.run(&mut case.depthloom(&[command, file]));
    judge(&ended, || Verdict::different(format!("{command} {file}: exit 0")))
}

/// Names that are not UTF-8, long, or empty.
pub(crate) fn names(case: &mut Case<'_>) -> Verdict {
    let reference = case.ground.street();
    let long = "n".repeat(case.random.within(100..400) as usize);
    let names: [&[u8]; 8] =
        [b"\xff\xfe", b"a\nb", b" ", b"-", "\u{202e}\u{1f600}".as_bytes(), long.as_bytes(), b"deep/er/still", b"a\\b"];
    let name = OsStr::from_bytes(case.random.pick(&names)).to_owned();
    case.note(format!("named {name:?}"));
    case.write("experiment.yaml", reference.experiment);
    let ended = if case.random.chance(2) {
        let path = case.folder.join(&name);
        let moved = path.parent().is_some_and(|parent| fs::create_dir_all(parent).is_ok());
        if !moved || fs::rename(case.at("experiment.yaml"), &path).is_err() {
            return Verdict::Skipped("the file system takes no such name".to_owned());
        }
        case.run(case.depthloom(&["run", "--quiet", "--out", "run"]).arg("--").arg(&name))
    } else {
        let out = case.folder.join(&name);
        let ended = case.run(case.depthloom(&["run", "experiment.yaml", "--quiet"]).arg("--out").arg(&out));
        if ended.succeeded() && fs::rename(&out, case.at("run")).is_err() {
            return Verdict::different("exit 0, and there is no such folder");
        }
        ended
    };
    // The experiment is kept in the recording under its file's name.
    let [whole, answer] = [reference.run.clone(), Answer::new(&ended, &case.at("run"))].map(Answer::without_recording);
    judge(&ended, || match whole.difference_in_files(&answer) {
        None => Verdict::Equal,
        Some(difference) => Verdict::Different(difference),
    })
}
