//! Faults in recordings: checksums, truncation, damage.

use depthloom_graphs::plan::{FrameIndex, RunId};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;

use depthloom_recording::{Condition, Damage, DamagedContent, Recording};

use crate::support::{depthloom, full, succeed};

/// The recording of a small experiment that scores what it computes.
fn recorded(folder: &Path, frames: &str) -> PathBuf {
    let out = folder.join("run");
    let mut run = depthloom();
    run.args(["run", "--no-page", "experiments/first-look.yaml", "--quiet", "--out"]).arg(&out);
    run.args(["--set", "sources.street.with.width=160", "--set", "sources.street.with.height=48"]);
    run.arg("--set").arg(format!("sources.street.with.frames={frames}"));
    succeed(&mut run);
    out.join("recording.mcap")
}

/// Runs `report` on a recording of these bytes into a new folder. Returns its output and the files it wrote, except
/// the page, which must contain the printed notes on the recording.
fn report(folder: &Path, bytes: &[u8]) -> (Output, BTreeMap<String, Vec<u8>>) {
    let recording = folder.join("input.mcap");
    let out = folder.join("report");
    std::fs::write(&recording, bytes).expect("written");
    let _ = std::fs::remove_dir_all(&out);
    let output = depthloom().arg("report").arg(&recording).arg("--out").arg(&out).output().expect("the binary starts");
    let files = std::fs::read_dir(&out).map(|files| {
        let files = files.map(|file| file.expect("a file"));
        files
            .map(|file| (file.file_name().into_string().expect("a name"), std::fs::read(file.path()).expect("read")))
            .collect()
    });
    let mut files: BTreeMap<String, Vec<u8>> = files.unwrap_or_default();
    if let Some(page) = files.remove("report.html") {
        let (page, stdout) = (String::from_utf8_lossy(&page), String::from_utf8_lossy(&output.stdout));
        for note in stdout.lines().filter_map(|line| line.strip_prefix("note: the recording is ")) {
            assert!(page.contains(note), "the page lacks this note: {note}");
        }
    }
    (output, files)
}

/// The recording up to the end of its last frame, without the records that follow.
fn without_summary(bytes: &[u8]) -> &[u8] {
    let summary_start = bytes.len() - 28;
    let start = u64::from_le_bytes(bytes[summary_start..summary_start + 8].try_into().expect("eight bytes"));
    &bytes[..start as usize - 13]
}

#[test]
fn all_analyses_note_an_unfinished_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(recorded(folder.path(), "0..4")).expect("a recording");
    std::fs::write(folder.path().join("input.mcap"), without_summary(&bytes)).expect("written");
    for arguments in [
        &["table", "input.mcap", "--rows", "score"][..],
        &["table", "input.mcap", "--format", "csv"],
        &["analyse", "input.mcap"],
        // From the samples that the command before wrote.
        &["analyse", "input.mcap"],
        &["analyse", "input.mcap", "--format", "csv"],
        &["figure", "input.mcap", "cdf", "--out", "cdf.svg"],
    ] {
        let output = depthloom().current_dir(folder.path()).args(arguments).output().expect("the binary starts");
        let printed = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
        let note = "the recording is unfinished; all numbers cover its 4 complete frames";
        assert!(printed.contains(note), "{arguments:?}: {printed}");
    }
}

#[test]
fn fault_49_report_notes_that_a_recording_is_unfinished_or_truncated() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(recorded(folder.path(), "0..4")).expect("a recording");
    let text = |output: &Output| String::from_utf8_lossy(&output.stdout).into_owned();

    let (finished, files) = report(folder.path(), &bytes);
    assert_eq!(finished.status.code(), Some(0));
    assert!(!text(&finished).contains("the recording is"), "{}", text(&finished));

    let (unfinished, same) = report(folder.path(), without_summary(&bytes));
    assert_eq!(unfinished.status.code(), Some(0));
    assert!(text(&unfinished).contains("note: the recording is unfinished; all numbers cover its 4 complete frames"));
    assert!(files == same, "all frames are complete");

    let cut = &bytes[..without_summary(&bytes).len() * 5 / 8];
    let (cut, _) = report(folder.path(), cut);
    assert_eq!(cut.status.code(), Some(0));
    assert!(text(&cut).contains("the recording is unfinished: its last"), "{}", text(&cut));
    assert!(text(&cut).contains("all numbers cover its 2 complete frames"), "{}", text(&cut));

    let mut damaged = without_summary(&bytes).to_vec();
    let middle = damaged.len() * 5 / 8;
    damaged[middle..middle + 64].fill(0);
    let (damaged, _) = report(folder.path(), &damaged);
    assert_eq!(damaged.status.code(), Some(3));
    assert!(text(&damaged).contains("note: the recording is damaged at byte"), "{}", text(&damaged));
    assert!(text(&damaged).contains("what follows was left out; all numbers cover its 2 complete frames"));

    let path = folder.path().join("input.mcap");
    let json = succeed(
        depthloom().arg("report").arg(path.with_file_name("run")).arg("--json").arg("--out").arg(folder.path()),
    );
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    let stages = [serde_json::json!({ "stage": "look", "variant": null, "frames": 4 })];
    assert_eq!(json["recording"], serde_json::json!({ "condition": "complete", "frames": 4, "stages": stages }));
}

/// Recovers a recording of these bytes. Returns the exit code, standard error, and the new file.
fn recover(folder: &Path, bytes: &[u8]) -> (Option<i32>, String, Option<PathBuf>) {
    let (input, out) = (folder.join("input.mcap"), folder.join("recovered.mcap"));
    std::fs::write(&input, bytes).expect("written");
    let _ = std::fs::remove_file(&out);
    let output =
        depthloom().args(["runs", "recover"]).arg(&input).arg("--out").arg(&out).output().expect("the binary starts");
    assert!(!folder.join("recovered.mcap.partial").exists());
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned(), out.exists().then_some(out))
}

#[test]
fn recover_keeps_the_frames_before_the_damage_and_reports_its_position() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let bytes = std::fs::read(recorded(folder, "0..4")).expect("a recording");
    let (mut recovered_count, mut refused) = (0, 0);
    for share in 1..24 {
        let mut flipped = bytes.clone();
        flipped[bytes.len() * share / 24] ^= 4;
        std::fs::write(folder.join("flipped.mcap"), &flipped).expect("written");
        let damage = Recording::open(folder.join("flipped.mcap")).expect("its summary is intact").damage(&|| false);
        let [Damage { offset, content: DamagedContent::Frame { position, .. }, .. }] = &damage[..] else { continue };
        let (code, stderr, out) = recover(folder, &flipped);
        assert_eq!(code, Some(3), "{stderr}");
        assert!(
            stderr.contains(&format!("input.mcap is damaged at byte {offset}")) && !stderr.contains("partial"),
            "{stderr}"
        );
        let Some(out) = out else {
            assert_eq!(*position, FrameIndex(0), "{stderr}");
            assert!(stderr.contains("no complete frame comes before it"), "{stderr}");
            refused += 1;
            continue;
        };
        let (frames, lost) = (position.0, 4 - position.0);
        let lost = if lost == 1 { "1 frame left out".to_owned() } else { format!("{lost} frames left out") };
        assert!(stderr.contains(&format!("recovered {frames} frame")) && stderr.contains(&lost), "{stderr}");
        let recovered = Recording::open(&out).expect("a recording");
        assert_eq!(recovered.frames(RunId(0)).len(), frames);
        assert!(recovered.damage(&|| false).is_empty());
        assert_eq!(*recovered.condition(), Condition::Recovered);
        let info = succeed(depthloom().arg("inspect").arg(&out));
        assert!(String::from_utf8_lossy(&info.stdout).contains(": recovered from an unfinished or damaged recording"));
        recovered_count += 1;
    }
    assert!(recovered_count > 4 && refused > 1, "{recovered_count} {refused}");
    // An undamaged recording is copied unchanged.
    let (code, _, out) = recover(folder, &bytes);
    assert_eq!((code, out.map(|out| std::fs::read(out).expect("read") == bytes)), (Some(0), Some(true)));
}

#[test]
fn every_analysis_of_a_recording_damaged_before_its_first_frame_exits_with_3() {
    let folder = tempfile::tempdir().expect("a folder");
    let recording = recorded(folder.path(), "0..2");
    let bytes = std::fs::read(&recording).expect("a recording");
    // Without a summary, nothing after the damage can be found.
    let mut damaged = without_summary(&bytes).to_vec();
    let first = Recording::open(&recording).expect("a recording").committed_bytes() as usize / 6;
    damaged[first..first + 64].fill(0);
    let path = folder.path().join("input.mcap");
    std::fs::write(&path, &damaged).expect("written");
    for arguments in [
        &["table"][..],
        &["explain", "RUN", "abs_rel", "stereo"],
        &["analyse", "RUN", "--samples-only"],
        &["analyse"],
        &["figure", "RUN", "cdf", "--out", "cdf.svg"],
        &["compare", "RUN", "RUN"],
        &["runs", "recover", "RUN", "--out", "out.mcap"],
    ] {
        let mut command = depthloom();
        command.current_dir(folder.path()).arg(arguments[0]);
        if arguments.len() == 1 {
            command.arg(&path);
        }
        command.args(arguments[1..].iter().map(|argument| if *argument == "RUN" { "input.mcap" } else { argument }));
        let output = command.output().expect("the binary starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {stderr}");
        assert!(stderr.contains("input.mcap is damaged at byte"), "{arguments:?}: {stderr}");
        assert!(stderr.contains("no complete frame comes before it"), "{arguments:?}: {stderr}");
    }
}

/// The first records of a file are its plan: without it nothing can be read.
#[test]
fn damage_ends_every_command_with_3_and_a_message() {
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(recorded(folder.path(), "0..2")).expect("a recording");
    let end = bytes.len() - 20;
    for (place, message) in [(1115, "error"), (end, "warning")] {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1;
        std::fs::write(folder.path().join("damaged.mcap"), damaged).expect("written");
        for arguments in [
            &["report", "damaged.mcap", "--out", "report"][..],
            &["runs", "diff", "run/recording.mcap", "damaged.mcap"],
            &["runs", "diff", "damaged.mcap", "run/recording.mcap"],
            &["table", "damaged.mcap"],
            &["inspect", "damaged.mcap"],
        ] {
            let mut command = depthloom();
            let output = command.current_dir(folder.path()).args(arguments).output().expect("the binary starts");
            let stderr = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(3), "byte {place}, {arguments:?}: {stderr}");
            // `inspect` describes the damage in its output.
            let texts = format!("{stderr}{}", String::from_utf8_lossy(&output.stdout));
            let is_named = arguments[0] == "inspect" || stderr.contains(message);
            assert!(is_named && texts.contains("damaged"), "byte {place}, {arguments:?}: {texts}");
        }
    }
}

#[test]
fn damage_before_the_first_frame_of_the_evaluated_stage_is_reported_although_an_earlier_stage_is_complete() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let experiment = std::fs::read_to_string("experiments/first-look.yaml").expect("an experiment");
    let earlier = "stages:\n  earlier:\n    source: street\n    nodes:\n      stereo:\n        kind: stereo/sgbm\n        \
                   inputs: { left: source/left, right: source/right }\n";
    let (sources, stages) = experiment.split_once("stages:").expect("stages");
    let stages = stages.split_once('\n').expect("lines").1;
    std::fs::write(folder.join("two.yaml"), format!("{sources}{earlier}{stages}")).expect("written");
    let mut run = depthloom();
    run.current_dir(folder).args(["run", "--no-page", "two.yaml", "--quiet", "--out", "run"]);
    run.args(["--set", "sources.street.with.width=160", "--set", "sources.street.with.height=48"]);
    succeed(run.args(["--set", "sources.street.with.frames=0..2"]));
    let bytes = std::fs::read(folder.join("run/recording.mcap")).expect("a recording");
    let bytes = without_summary(&bytes);
    let path = folder.join("given.mcap");
    let is_damaged_between = (0..bytes.len() - 64).step_by(997).any(|place| {
        let mut damaged = bytes.to_vec();
        damaged[place..place + 64].fill(0);
        std::fs::write(&path, &damaged).expect("written");
        Recording::open(&path).is_ok_and(|recording| {
            let counts = [RunId(0), RunId(1)].map(|run| recording.frames(run).len());
            counts == [2, 0] && matches!(recording.condition(), Condition::Damaged { .. })
        })
    });
    assert!(is_damaged_between);
    for arguments in [&["table", "given.mcap"][..], &["explain", "given.mcap", "abs_rel", "stereo"]] {
        let output = depthloom().current_dir(folder).args(arguments).output().expect("the binary starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {stderr}");
        assert!(stderr.contains("given.mcap is damaged at byte"), "{arguments:?}: {stderr}");
        assert!(stderr.contains("no complete frame of stage `look` comes before it"), "{arguments:?}: {stderr}");
    }
}

/// Flips a bit of the third frame's values of a topic.
fn flipped_in(folder: &Path, bytes: &[u8], topic: &str) -> Vec<u8> {
    let path = folder.join("flipped.mcap");
    let mut flipped = bytes.to_vec();
    for place in (0..bytes.len()).step_by(61) {
        flipped[place] ^= 4;
        std::fs::write(&path, &flipped).expect("written");
        let damage = Recording::open(&path).map_or_else(|_| Vec::new(), |recording| recording.damage(&|| false));
        if let [Damage { content: DamagedContent::Frame { position: FrameIndex(2), topics, .. }, .. }] = &damage[..]
            && topics.iter().any(|damaged| damaged == topic)
        {
            return flipped;
        }
        flipped[place] ^= 4;
    }
    panic!("no chunk holds {topic}");
}

#[test]
fn damage_in_unused_values_is_noted_and_numbers_are_unchanged() {
    if !full("damage_in_unused_values_is_noted_and_numbers_are_unchanged") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(recorded(folder.path(), "0..4")).expect("a recording");
    let (finished, files) = report(folder.path(), &bytes);
    assert_eq!(finished.status.code(), Some(0));
    let flipped = flipped_in(folder.path(), &bytes, "/look/source/left");
    let (damaged, same) = report(folder.path(), &flipped);
    assert_eq!(damaged.status.code(), Some(3));
    let text = String::from_utf8_lossy(&damaged.stdout);
    let note = text.lines().find(|line| line.starts_with("note: the recording is damaged at byte")).expect("a note");
    assert!(
        note.contains("/look/source/left") && note.contains("of frame `000002_10` (position 2 of stage `look`)"),
        "{note}"
    );
    assert!(note.ends_with("; no number here depends on it"), "{note}");
    assert!(files == same, "the numbers equal those of the intact recording");

    let out = folder.path().join("report");
    let mut json = depthloom();
    json.arg("report").arg(folder.path().join("input.mcap")).arg("--json").arg("--out").arg(&out);
    let json = json.output().expect("the binary starts");
    assert_eq!(json.status.code(), Some(3));
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!(json["recording"]["condition"], "damaged");
    let [place] = &json["recording"]["damage"].as_array().expect("places")[..] else { panic!("{json:#}") };
    assert_eq!(
        (&place["stage"], &place["position"], &place["frame"]),
        (&"look".into(), &2.into(), &"000002_10".into())
    );
}

#[test]
fn damage_in_needed_values_is_an_error_that_lists_intact_files() {
    if !full("damage_in_needed_values_is_an_error_that_lists_intact_files") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let bytes = std::fs::read(recorded(folder.path(), "0..4")).expect("a recording");
    let (_, files) = report(folder.path(), &bytes);
    let (damaged, written) = report(folder.path(), &flipped_in(folder.path(), &bytes, "/look/depth/depth"));
    assert_eq!(damaged.status.code(), Some(3));
    // Independent of line breaks.
    let words = |text: &[u8]| String::from_utf8_lossy(text).split_whitespace().collect::<Vec<_>>().join(" ");
    let stderr = words(&damaged.stderr);
    assert!(stderr.contains("input.mcap is damaged at byte"), "{stderr}");
    assert!(
        stderr.contains("it contained /look/depth/depth of frame `000002_10` (position 2 of stage `look`)"),
        "{stderr}"
    );
    assert!(
        stderr.contains(
            "copy the file again, or run the experiment again; these files are complete: scores.*, table.* in"
        ),
        "{stderr}"
    );
    assert!(
        written.keys().any(|name| name == "scores.csv") && written.keys().any(|name| name == "table.csv"),
        "{written:?}"
    );
    let mut tables = written.iter().filter(|(name, _)| *name != ".depthloom-report");
    assert!(tables.all(|(name, bytes)| files[name] == *bytes), "the written files equal those of the intact recording");

    let recording = Recording::open(folder.path().join("run/recording.mcap")).expect("a recording");
    let scores = recording.plan().runs[0].estimates[0].score_topic.as_deref().expect("scores are recorded");
    let (damaged, written) = report(folder.path(), &flipped_in(folder.path(), &bytes, scores));
    let stderr = words(&damaged.stderr);
    assert!(stderr.contains(&format!("{scores} of frame `000002_10`")), "{stderr}");
    assert!(!stderr.contains("are complete"), "{stderr}");
    // The marker of a report's folder is written before its tables.
    assert!(written.keys().all(|name| name == ".depthloom-report"), "{written:?}");
}

/// Number of bits flipped in each of four cases: `DEPTHLOOM_FLIPS`, or a small default.
fn flips() -> u64 {
    std::env::var("DEPTHLOOM_FLIPS").map_or(25, |flips| flips.parse().expect("DEPTHLOOM_FLIPS is a number"))
}

#[test]
fn fault_48_a_flipped_bit_yields_an_error_or_the_same_report() {
    if !full("fault_48_a_flipped_bit_yields_an_error_or_the_same_report") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let finished = std::fs::read(recorded(folder.path(), "0..3")).expect("a recording");
    let unfinished = without_summary(&finished).to_vec();
    for (case, bytes, reach) in [
        ("a finished recording", &finished, finished.len()),
        ("an unfinished recording", &unfinished, unfinished.len()),
        ("the first 40 kB of a finished recording", &finished, 40_000),
        ("the first 40 kB of an unfinished recording", &unfinished, 40_000),
    ] {
        let (expected, files) = report(folder.path(), bytes);
        assert_eq!(expected.status.code(), Some(0));
        let (mut state, mut bytes) = (reach as u64, bytes.clone());
        let (mut errors, mut same) = (0, 0);
        for _ in 0..flips() {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let place = (state >> 20) as usize % reach.min(bytes.len());
            let bit = state >> 61;
            bytes[place] ^= 1 << bit;
            let (output, found) = report(folder.path(), &bytes);
            bytes[place] ^= 1 << bit;
            let stderr = String::from_utf8_lossy(&output.stderr);
            match output.status.code() {
                Some(0) => {
                    assert_eq!(output.stdout, expected.stdout, "{case}: bit {bit} of byte {place}");
                    assert!(found == files, "{case}: bit {bit} of byte {place} silently changes a file");
                    same += 1;
                }
                Some(1..=3) => {
                    assert!(!stderr.contains("panicked"), "{case}: bit {bit} of byte {place}: {stderr}");
                    errors += 1;
                }
                code => panic!("{case}: bit {bit} of byte {place}: {code:?} {stderr}"),
            }
        }
        println!(
            "{case} ({} bytes): {} bits flipped, {errors} errors, {same} times the same report",
            bytes.len(),
            flips()
        );
    }
}
