//! Faults in numbers, tables and figures.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use depthloom_analysis::{ReportOptions, report};
use depthloom_recording::Recording;

use crate::golden::valid_bins;
use crate::support::{Row, depthloom, full, label, number, read_csv, shared, succeed, workspace};

/// Runs `experiments/first-look.yaml` with this source and `record:`. Returns the run folder and standard output.
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

fn recreate_report(run: &Path) -> String {
    String::from_utf8(succeed(depthloom().arg("report").arg(run)).stdout).expect("text")
}

#[test]
fn fault_01_leftovers_of_a_killed_report_do_not_change_percentiles() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, _) = first_look(folder.path(), &street("0..2", 1), "{}");
    let file = |name: &str| std::fs::read(out.join(name)).expect("read");
    let before = file("error_vs_distance.csv");
    // One more sample: 5 m away, with an error of 20 m; then a block that declares 4 thousand million samples.
    let leftover = out.join(".error_vs_distance.spill");
    for torn in [&b"\x05\0\0\0\x01\0\0\0\0\0\xa0B"[..], b"\x05\0\0\0\xff\xff\xff\xff\0\0"] {
        std::fs::create_dir_all(&leftover).expect("created");
        std::fs::write(leftover.join("0"), torn).expect("written");
        std::fs::write(out.join("error_vs_distance.csv.partial"), "half of").expect("written");
        recreate_report(&out);
        assert!(file("error_vs_distance.csv") == before, "leftovers of a killed report are in the percentiles");
    }
    // Samples that do not fit into memory yield the same percentiles.
    let again = folder.path().join("again");
    let recording = Recording::open(out.join("recording.mcap")).expect("a recording");
    std::fs::create_dir(&again).expect("created");
    let options = ReportOptions { samples_in_memory: 100, ..ReportOptions::default() };
    report(&recording, &again, &options, &|| false).expect("a report");
    assert!(std::fs::read(again.join("error_vs_distance.csv")).expect("read") == before);
}

#[test]
fn fault_02_frames_that_share_an_id_are_counted_separately() {
    let folder = tempfile::tempdir().expect("a folder");
    let again = format!("{{ concat: [{}, {}] }}", street("0..2", 1), street("1..2", 1));
    let (out, printed) = first_look(folder.path(), &again, "{}");
    assert!(printed.contains("mean over 3 frames"), "{printed}");
    assert_mean_of_three(&out);

    let folder = tempfile::tempdir().expect("a folder");
    let joined = format!("{{ concat: [{}, {}] }}", street("0..2", 1), street("0..1", 2));
    let (out, printed) = first_look(folder.path(), &joined, "{}");
    assert!(printed.contains("mean over 3 frames"), "two streets whose frames share a name: {printed}");
    assert_mean_of_three(&out);
}

/// Asserts that the table is the mean over the three rows in `scores.csv`.
fn assert_mean_of_three(run: &Path) {
    let (scores, table) = (read_csv(&run.join("scores.csv")), read_csv(&run.join("table.csv")));
    for row in &table {
        let same = |score: &&Row| ["estimate", "set"].iter().all(|column| score[*column] == row[*column]);
        let rmse: Vec<f64> = scores.iter().filter(same).map(|score| number(score, "rmse")).collect();
        assert_eq!((rmse.len(), &*row["frames"]), (3, "3"));
        assert!((number(row, "rmse") - rmse.iter().sum::<f64>() / 3.0).abs() < 1e-12);
    }
    assert_eq!(table.len(), 2);
    // Every row has a unique key, independent of the frames' names.
    let key = |row: &Row| ["stage", "position", "estimate", "set"].map(|column| row[column].clone());
    let keys: BTreeSet<[String; 4]> = scores.iter().map(key).collect();
    assert_eq!((keys.len(), scores.len()), (6, 6));
    assert!(scores.iter().all(|row| row["stage"] == "look" && ["0", "1", "2"].contains(&&*row["position"])));
    let names: BTreeSet<&String> = scores.iter().map(|row| &row["frame"]).collect();
    assert!(names.len() < 3, "no two frames share a name");
}

#[test]
fn fault_29_record_every_100_keeps_the_first_frame_and_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, printed) = first_look(folder.path(), &street("150..=152", 1), "{ every: 100 }");
    assert!(
        printed.contains("error against distance covers only every 100th frame, because only their maps were recorded"),
        "{printed}"
    );
    assert!(out.join("error_vs_distance.svg").exists());
    assert!(out.join("table.csv").exists());
}

#[test]
fn fault_30_missing_recorded_values_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let (_, printed) = first_look(folder.path(), &street("0..1", 1), "[depth]");
    let note = "no error against distance: the ground truth `look.source/depth` was not recorded: add it to `record:`";
    assert!(printed.contains(note), "{printed}");
    assert!(!printed.contains("error_vs_distance"), "{printed}");
    let folder = tempfile::tempdir().expect("a folder");
    let (_, printed) = first_look(folder.path(), &street("0..1", 1), "[source]");
    assert!(printed.contains("the estimate `look.depth/depth` was not recorded: add it"), "{printed}");
    // The remedy works as printed.
    let folder = tempfile::tempdir().expect("a folder");
    let (out, printed) = first_look(folder.path(), &street("0..1", 1), "[look.source/depth, look.depth/depth]");
    assert!(!printed.contains("no error against distance") && out.join("error_vs_distance.svg").exists(), "{printed}");
    // A report in another folder does not list the recording as one of its files.
    let other_folder = folder.path().join("elsewhere");
    let report = succeed(depthloom().arg("report").arg(&out).arg("--out").arg(&other_folder));
    assert!(printed.contains("recording.mcap") && !String::from_utf8_lossy(&report.stdout).contains("recording.mcap"));
}

#[test]
fn fault_37_help_lists_kinds_without_truncation() {
    let folder = tempfile::tempdir().expect("a folder");
    let experiment = folder.path().join("experiment.yaml");
    let node = "sources: { s: { kind: synthetic/road } }\nstages: { a: { source: s, nodes: { d: { kind: nothing/like-it } } } }\n";
    std::fs::write(&experiment, format!("experiment: x\n{node}")).expect("written");
    let output = depthloom().arg("check").arg(&experiment).output().expect("the binary starts");
    let printed = String::from_utf8(output.stderr).expect("text");
    // This kind is at the end of the list's first line.
    assert!(printed.contains("`disparity/left-right`"), "{printed}");
}

/// A report on a system that allows the process only its main thread and the one that listens for signals.
#[test]
#[cfg(target_os = "linux")]
fn fault_43_a_report_works_without_additional_threads() {
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
    // The limit counts the threads of a user and does not apply to root, so use an otherwise unused user.
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
fn percentiles_match_numpy_in_memory_and_on_disk() {
    if !full("percentiles_match_numpy_in_memory_and_on_disk") {
        return;
    }
    let Some(shared) = shared("percentiles_match_numpy_in_memory_and_on_disk") else { return };
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
    assert!(bins[0] == bins[1], "samples on disk change the numbers");
    let golden = read_csv(&shared.join("oracle/golden/ground_plane/percentiles.csv"));
    let ours = valid_bins(&folder.path().join("10000/error_vs_distance.csv"));
    assert_eq!(ours.len(), golden.len());
    for theirs in &golden {
        let same = |row: &&Row| label(row) == label(theirs) && row["bin_m"] == theirs["bin_m"];
        let row = ours.iter().find(same).unwrap_or_else(|| panic!("no bin {theirs:?}"));
        assert_eq!(row["count"], theirs["count"], "{theirs:?}");
        for percentile in ["p5", "p25", "p50", "p75", "p95"] {
            let (a, b) = (number(row, percentile), number(theirs, percentile));
            assert!((a - b).abs() <= 1e-4 * b.abs().max(1.0), "{percentile} of {theirs:?}: {a} differs from {b}");
        }
    }
}

#[test]
fn ground_truth_outside_the_distance_limits_exits_with_3() {
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
        let printed = String::from_utf8(output.stdout).expect("text");
        assert_eq!(output.status.code(), Some(3), "{printed}");
        assert!(
            printed.contains("note: not one pixel was scored: the ground truth `look/source/depth` is between "),
            "{printed}"
        );
        assert!(printed.contains("outside of min_m..max_m of the score (9000..9500 m)"), "{printed}");
    }
}

#[test]
fn a_frame_without_a_pixel_to_score_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    succeed(depthloom().args(["synth", "--frames", "3", "--width", "320", "--height", "96"]).arg(&data));
    for ground_truth in ["disp_occ_0", "disp_noc_0"] {
        let file = data.join("training").join(ground_truth).join("000001_10.png");
        if file.exists() {
            image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(320, 96).save(&file).expect("written");
        }
    }
    let kitti = format!("{{ kind: kitti/stereo2015, with: {{ root: {}, frames: 0..3 }} }}", data.display());
    let (out, printed) = first_look(folder.path(), &kitti, "{}");
    let note = "note: 1 frame has no pixel to score and is excluded from all means: 000001_10; the ground truth `look/source/depth` has no distance there";
    assert!(printed.contains(note), "{printed}");
    assert!(printed.contains("mean over 2 frames"), "{printed}");
    assert!(recreate_report(&out).contains(note));
}
