//! Faults of numbers, tables and figures.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_analysis::{ReportOptions, report};
use depthloom_recording::Recording;

use crate::golden::valid_bins;
use crate::support::{Row, depthloom, full, label, number, read_csv, shared, succeed, workspace};

/// `experiments/first-look.yaml`, small: its source, its `record:`, and what the program said.
fn first_look(folder: &Path, source: &str, record: &str) -> (PathBuf, String) {
    let experiment = folder.join("experiment.yaml");
    let look = workspace().join("experiments/first-look.yaml");
    let text = format!("extends: {}\nsources:\n  street: {source}\nrecord: {record}\n", look.display());
    std::fs::write(&experiment, text).expect("written");
    let out = folder.join("run");
    let output =
        succeed(depthloom().args(["run", "--no-page"]).arg(&experiment).args(["--workers", "2", "--out"]).arg(&out));
    (out, String::from_utf8(output.stdout).expect("text"))
}

fn street(frames: &str, seed: u32) -> String {
    format!("{{ kind: synthetic/road, with: {{ frames: {frames}, seed: {seed}, width: 320, height: 96 }} }}")
}

fn report_again(run: &Path) -> String {
    String::from_utf8(succeed(depthloom().arg("report").arg(run)).stdout).expect("text")
}

#[test]
fn fault_01_a_spill_that_a_killed_report_left_reaches_no_percentile() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, _) = first_look(folder.path(), &street("0..2", 1), "{}");
    let file = |name: &str| std::fs::read(out.join(name)).expect("read");
    let before = file("error_vs_distance.csv");
    // One sample more: 5 m away, wrong by 20 m; then a stretch that promises 4 thousand million.
    let left = out.join(".error_vs_distance.spill");
    for torn in [&b"\x05\0\0\0\x01\0\0\0\0\0\xa0B"[..], b"\x05\0\0\0\xff\xff\xff\xff\0\0"] {
        std::fs::create_dir_all(&left).expect("created");
        std::fs::write(left.join("0"), torn).expect("written");
        std::fs::write(out.join("error_vs_distance.csv.partial"), "half of").expect("written");
        report_again(&out);
        assert!(file("error_vs_distance.csv") == before, "what a killed report left is in the percentiles");
    }
    // The samples of more than memory holds give the same.
    let again = folder.path().join("again");
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    std::fs::create_dir(&again).expect("created");
    let options = ReportOptions { samples_in_memory: 100, ..ReportOptions::default() };
    report(&recording, &again, &options, &|| false).expect("a report");
    assert!(std::fs::read(again.join("error_vs_distance.csv")).expect("read") == before);
}

#[test]
fn fault_02_frames_that_share_an_id_count_as_they_were_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let again = format!("{{ join: [{}, {}] }}", street("0..2", 1), street("1..2", 1));
    let (out, said) = first_look(folder.path(), &again, "{}");
    assert!(said.contains("mean over 3 frames"), "{said}");
    mean_of_three(&out);

    let folder = tempfile::tempdir().expect("a folder");
    let joined = format!("{{ join: [{}, {}] }}", street("0..2", 1), street("0..1", 2));
    let (out, said) = first_look(folder.path(), &joined, "{}");
    assert!(said.contains("mean over 3 frames"), "two streets whose frames have one name: {said}");
    mean_of_three(&out);
}

/// The table is the mean of the three rows in `scores.csv`.
fn mean_of_three(run: &Path) {
    let (scores, table) = (read_csv(&run.join("scores.csv")), read_csv(&run.join("table.csv")));
    for row in &table {
        let same = |score: &&Row| ["estimate", "set"].iter().all(|of| score[*of] == row[*of]);
        let rmse: Vec<f64> = scores.iter().filter(same).map(|score| number(score, "rmse")).collect();
        assert_eq!((rmse.len(), &*row["frames"]), (3, "3"));
        assert!((number(row, "rmse") - rmse.iter().sum::<f64>() / 3.0).abs() < 1e-12);
    }
    assert_eq!(table.len(), 2);
    // Every row has a key of its own, whatever the frames are called.
    let key = |row: &Row| ["stage", "position", "estimate", "set"].map(|column| row[column].clone());
    let keys: BTreeSet<[String; 4]> = scores.iter().map(key).collect();
    assert_eq!((keys.len(), scores.len()), (6, 6));
    assert!(scores.iter().all(|row| row["stage"] == "look" && ["0", "1", "2"].contains(&&*row["position"])));
    let names: BTreeSet<&String> = scores.iter().map(|row| &row["frame"]).collect();
    assert!(names.len() < 3, "two frames have one name");
}

#[test]
fn fault_29_of_every_hundredth_frame_the_first_keeps_its_maps_and_that_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, said) = first_look(folder.path(), &street("150..=152", 1), "{ every: 100 }");
    assert!(said.contains("error against distance is of every 100th frame: only their maps were recorded"), "{said}");
    assert!(out.join("error_vs_distance.svg").exists());
    assert!(out.join("table.csv").exists());
}

#[test]
fn fault_30_what_is_missing_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let (_, said) = first_look(folder.path(), &street("0..1", 1), "[depth]");
    let note = "no error against distance: the truth `look.source/depth` was not recorded: add it to `record:`";
    assert!(said.contains(note), "{said}");
    assert!(!said.contains("error_vs_distance"), "{said}");
    let folder = tempfile::tempdir().expect("a folder");
    let (_, said) = first_look(folder.path(), &street("0..1", 1), "[source]");
    assert!(said.contains("the estimate `look.depth/depth` was not recorded: add it"), "{said}");
    // What it says can be done as it is said.
    let folder = tempfile::tempdir().expect("a folder");
    let (out, said) = first_look(folder.path(), &street("0..1", 1), "[look.source/depth, look.depth/depth]");
    assert!(!said.contains("no error against distance") && out.join("error_vs_distance.svg").exists(), "{said}");
    // A report elsewhere does not say that the recording is there.
    let elsewhere = folder.path().join("elsewhere");
    let report = succeed(depthloom().arg("report").arg(&out).arg("--out").arg(&elsewhere));
    assert!(said.contains("recording.mcap") && !String::from_utf8_lossy(&report.stdout).contains("recording.mcap"));
}

#[test]
fn fault_37_help_names_kinds_as_a_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("experiment.yaml");
    let node = "sources: { s: { kind: synthetic/road } }\nstages: { a: { source: s, nodes: { d: { kind: nothing/like-it } } } }\n";
    std::fs::write(&experiment, format!("experiment: x\n{node}")).expect("written");
    let output = depthloom().arg("check").arg(&experiment).output().expect("the binary starts");
    let said = String::from_utf8(output.stderr).expect("text");
    // It stands where the first line of the list ends.
    assert!(said.contains("`disparity/left-right`"), "{said}");
}

/// A report on a system that gives the process no thread beside its own and the one that listens for signals.
#[test]
#[cfg(target_os = "linux")]
fn fault_43_a_report_goes_on_where_the_system_gives_no_more_threads() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;

    let folder = tempfile::tempdir().expect("a folder");
    let (out, _) = first_look(folder.path(), &street("0..2", 1), "{}");
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("created");
    for path in [folder.path(), &alone] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o777)).expect("allowed");
    }
    let binary = folder.path().join("depthloom");
    std::fs::copy(env!("CARGO_BIN_EXE_depthloom"), &binary).expect("copied");
    let mut command = Command::new("timeout");
    // `timeout` counts too.
    command.args(["120", "prlimit", "--nproc=3"]).arg(&binary).arg("report").arg(&out).arg("--out").arg(&alone);
    // The limit is one of a user, and root has none: a user that nobody else is.
    if std::fs::metadata("/proc/self").expect("a process").uid() == 0 {
        command.uid(61_043).gid(61_043);
    }
    command.current_dir(folder.path());
    succeed(&mut command);
    for file in ["scores.csv", "table.csv", "table.parquet", "error_vs_distance.csv", "error_vs_distance.svg"] {
        let read = |folder: &Path| std::fs::read(folder.join(file)).expect("read");
        assert!(read(&out) == read(&alone), "{file} differs");
    }
}

#[test]
fn percentiles_are_numpys_in_memory_and_from_a_spill() {
    if !full("percentiles_are_numpys_in_memory_and_from_a_spill") {
        return;
    }
    let Some(shared) = shared("percentiles_are_numpys_in_memory_and_from_a_spill") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("run");
    succeed(
        depthloom()
            .args(["run", "--no-page", "tests/experiments/golden-ground-plane.yaml", "--out"])
            .arg(&out)
            .env("KITTI_STEREO_2015", shared.join("data/kitti_stereo_2015")),
    );
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    let bins = [usize::MAX, 10_000].map(|samples_in_memory| {
        let folder = folder.path().join(samples_in_memory.to_string());
        std::fs::create_dir(&folder).expect("created");
        let options = ReportOptions { samples_in_memory, ..ReportOptions::default() };
        report(&recording, &folder, &options, &|| false).expect("a report");
        std::fs::read_to_string(folder.join("error_vs_distance.csv")).expect("read")
    });
    assert!(bins[0] == bins[1], "a spill changes numbers");
    let golden = read_csv(&shared.join("oracle/golden/ground_plane/percentiles.csv"));
    let ours = valid_bins(&folder.path().join("10000/error_vs_distance.csv"));
    assert_eq!(ours.len(), golden.len());
    for theirs in &golden {
        let same = |row: &&Row| label(row) == label(theirs) && row["bin_m"] == theirs["bin_m"];
        let row = ours.iter().find(same).unwrap_or_else(|| panic!("no bin {theirs:?}"));
        assert_eq!(row["count"], theirs["count"], "{theirs:?}");
        for percentile in ["p5", "p25", "p50", "p75", "p95"] {
            let (a, b) = (number(row, percentile), number(theirs, percentile));
            assert!((a - b).abs() <= 1e-4 * b.abs().max(1.0), "{percentile} of {theirs:?}: {a} is not {b}");
        }
    }
}

#[test]
fn truth_beyond_the_scores_limits_is_no_answer_and_the_exit_code_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("experiment.yaml");
    let look = workspace().join("experiments/first-look.yaml");
    let source = street("0..2", 1);
    let limits = "stages: { look: { score: { min_m: 9000, max_m: 9500 } } }";
    let text = format!("extends: {}\nsources:\n  street: {source}\n{limits}\n", look.display());
    std::fs::write(&experiment, text).expect("written");
    let out = folder.path().join("run");
    let run = depthloom().args(["run", "--no-page"]).arg(&experiment).arg("--out").arg(&out).output().expect("run");
    let report = depthloom().arg("report").arg(&out).output().expect("report");
    for output in [run, report] {
        let said = String::from_utf8(output.stdout).expect("text");
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains("note: not one pixel was scored: the truth `look/source/depth` lies between "), "{said}");
        assert!(said.contains("outside of the score's min_m..max_m (9000..9500 m)"), "{said}");
    }
}

#[test]
fn a_frame_without_a_pixel_to_score_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    succeed(depthloom().args(["synth", "--frames", "3", "--width", "320", "--height", "96"]).arg(&data));
    for truth in ["disp_occ_0", "disp_noc_0"] {
        let file = data.join("training").join(truth).join("000001_10.png");
        if file.exists() {
            image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(320, 96).save(&file).expect("written");
        }
    }
    let kitti = format!("{{ kind: kitti/stereo2015, with: {{ root: {}, frames: 0..3 }} }}", data.display());
    let (out, said) = first_look(folder.path(), &kitti, "{}");
    let told = "note: 1 frame has no pixel to score and is in no mean: 000001_10; the truth `look/source/depth` knows no distance there";
    assert!(said.contains(told), "{said}");
    assert!(said.contains("mean over 2 frames"), "{said}");
    assert!(report_again(&out).contains(told));
}
