//! Reports of equal recordings are equal. They do not depend on the number of cores, on concurrent reports, on the
//! order of samples, or on whether the samples fit into memory.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use depthloom_test_needs::is_full;

use crate::support::{depthloom, number, read_csv, skipped, succeed};

/// With 20 frames, more samples than are kept in memory (2^20, `analysis/src/report.rs`): every pixel of the road has
/// ground truth, which is the ground plane.
const DENSE: &str = "experiment: dense
sources: { street: { kind: synthetic/road, with: { frames: 0..20, width: 320, height: 96 } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      plane: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      scaled: { kind: fusion/scale, inputs: { mono: plane/depth, stereo: depth/depth } }
      merged: { kind: fusion/confidence, inputs: { mono: plane/depth, stereo: depth/depth, weight: weight/weight } }
      fused: { kind: filter/median, inputs: { depth: merged/depth } }
    score:
      ground_truth: plane/depth
      estimates: { stereo: depth/depth, scaled: scaled/depth, merged: merged/depth, fused: fused/depth }
";

/// A run of a few frames; in the full suite, one whose samples do not fit into memory.
fn run(folder: &Path) -> PathBuf {
    if is_full() { run_beyond_memory(folder) } else { run_frames(folder, 4) }
}

fn run_frames(folder: &Path, frames: u32) -> PathBuf {
    let (experiment, run) = (folder.join("dense.yaml"), folder.join("run"));
    std::fs::write(&experiment, DENSE.replace("0..20", &format!("0..{frames}"))).expect("written");
    succeed(depthloom().arg("run").arg(&experiment).args(["--quiet", "--out"]).arg(&run));
    run
}

/// A run whose samples do not fit into memory.
fn run_beyond_memory(folder: &Path) -> PathBuf {
    let run = run_frames(folder, 20);
    let bins = read_csv(&run.join("error_vs_distance.csv"));
    let samples: f64 = bins.iter().filter(|row| row["set"] == "valid").map(|row| number(row, "count")).sum();
    assert!(samples > f64::from(1 << 20), "{samples} samples fit into memory");
    run
}

fn report(run: &Path, out: &Path) -> Command {
    let mut report = depthloom();
    report.arg("report").arg(run).arg("--out").arg(out);
    report
}

fn files(folder: &Path) -> BTreeMap<OsString, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
    entries.map(|entry| (entry.file_name(), std::fs::read(entry.path()).expect("a file"))).collect()
}

fn assert_equal(ours: &BTreeMap<OsString, Vec<u8>>, theirs: &BTreeMap<OsString, Vec<u8>>, what: &str) {
    assert_eq!(ours.keys().collect::<Vec<_>>(), theirs.keys().collect::<Vec<_>>(), "{what}");
    for (file, bytes) in ours {
        assert!(theirs[file] == *bytes, "{what}: {} differs", file.display());
    }
}

/// A run samples while it records; a report of the recording must yield the same samples, also if some maps were not
/// recorded or some values were reused.
#[test]
fn a_run_and_a_report_of_its_recording_write_the_same_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = run(folder.path());
    let experiment = folder.path().join("dense.yaml");
    let again = |name: &str, set: &str| {
        let out = folder.path().join(name);
        let mut command = depthloom();
        // In the folder of the first run, which it reuses.
        command.env_remove("DEPTHLOOM_FRESH").current_dir(folder.path()).arg("run").arg(&experiment);
        succeed(command.args(["--quiet", "--set", set, "--out"]).arg(&out));
        out
    };
    let every = again("every", "record.every=3");
    let some_reused = again("some", "look.scaled.with.method=average");
    let frames = if is_full() { 18 } else { 3 };
    let other_frames = again("other", &format!("sources.street.with.frames=0..{frames}"));
    for run in [first, every, some_reused, other_frames] {
        let out = folder.path().join("report");
        succeed(&mut report(&run, &out));
        let ours = files(&run);
        for (file, bytes) in files(&out).into_iter().filter(|(file, _)| *file != ".depthloom-report") {
            assert!(ours[&file] == bytes, "{}: {} differs", run.display(), file.display());
        }
        std::fs::remove_dir_all(&out).expect("removed");
    }
}

#[test]
fn reports_on_one_core_and_on_all_are_equal_with_samples_on_disk() {
    const TEST: &str = "reports_on_one_core_and_on_all_are_equal_with_samples_on_disk";
    if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
        return skipped(TEST, "this machine has one core");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let run = run_beyond_memory(folder.path());
    let [all, one] = ["all", "one"].map(|name| folder.path().join(name));
    let mut on_all = report(&run, &all);
    succeed(&mut on_all);
    let mut on_one = Command::new("taskset");
    on_one.args(["--cpu-list", &first_core()]).arg(on_all.get_program());
    succeed(on_one.arg("report").arg(&run).arg("--out").arg(&one));
    assert_equal(&files(&all), &files(&one), "on one core");
}

/// A core that this process may use.
fn first_core() -> String {
    let status = std::fs::read_to_string("/proc/self/status").expect("a status of Linux");
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")).expect("a status of Linux");
    list.trim().split([',', '-']).next().expect("a core").to_owned()
}

#[test]
fn concurrent_reports_and_reports_after_a_kill_equal_a_single_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = run(folder.path());
    let [alone, together] = ["alone", "together"].map(|name| folder.path().join(name));
    succeed(&mut report(&run, &alone));
    let alone = files(&alone);

    let quiet = |mut command: Command| command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("started");
    let children = [(); 3].map(|()| quiet(report(&run, &together)));
    for mut child in children {
        assert!(child.wait().expect("ended").success(), "one of three reports at once failed");
    }
    assert_equal(&alone, &files(&together), "three reports at once");

    // The table is written before the samples are collected; a kill may still be too late.
    let killed = (0..20).map(|attempt| folder.path().join(format!("killed-{attempt}"))).find(|out| {
        let mut child = quiet(report(&run, out));
        while !out.join("table.csv").exists() && child.try_wait().expect("a child").is_none() {
            std::thread::yield_now();
        }
        child.kill().expect("killed");
        child.wait().expect("ended");
        !out.join("error_vs_distance.csv").exists()
    });
    let killed = killed.expect("one of twenty kills comes before the percentiles");
    succeed(&mut report(&run, &killed));
    assert_equal(&alone, &files(&killed), "after a killed report");
}
