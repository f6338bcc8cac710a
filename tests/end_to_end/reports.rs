//! Equal recordings are equal reports, whatever the number of cores: analysis reads frames on all of them, and samples come in any order.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::process::Command;

use crate::support::{depthloom, number, read_csv, skipped, succeed};

/// More samples of the error against distance than memory holds (2^19, `analysis/src/report.rs`): of every pixel of the road, whose plane is the truth.
const DENSE: &str = "experiment: dense
sources: { street: { kind: synthetic/road, with: { frames: 0..16, width: 320, height: 96 } } }
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
      truth: plane/depth
      estimates: { stereo: depth/depth, scaled: scaled/depth, merged: merged/depth, fused: fused/depth }
";

#[test]
fn reports_on_one_core_and_on_all_are_equal_with_samples_beyond_memory() {
    const TEST: &str = "reports_on_one_core_and_on_all_are_equal_with_samples_beyond_memory";
    if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
        return skipped(TEST, "this machine has one core");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let (experiment, run) = (folder.path().join("dense.yaml"), folder.path().join("run"));
    std::fs::write(&experiment, DENSE).expect("written");
    succeed(depthloom().arg("run").arg(&experiment).args(["--quiet", "--out"]).arg(&run));
    let reported = |name: &str, launcher: &[&str]| -> BTreeMap<OsString, Vec<u8>> {
        let out = folder.path().join(name);
        let ours = depthloom();
        let mut report = match launcher {
            [] => Command::new(ours.get_program()),
            [program, arguments @ ..] => {
                let mut launcher = Command::new(program);
                launcher.args(arguments).arg(ours.get_program());
                launcher
            }
        };
        succeed(report.arg("report").arg(&run).arg("--out").arg(&out));
        let files = std::fs::read_dir(&out).expect("a folder").map(|entry| entry.expect("an entry"));
        files.map(|entry| (entry.file_name(), std::fs::read(entry.path()).expect("a file"))).collect()
    };
    let all = reported("all", &[]);
    let core = first_core();
    let one = reported("one", &["taskset", "--cpu-list", &core]);
    let samples: f64 =
        read_csv(&folder.path().join("all/error_vs_distance.csv")).iter().map(|row| number(row, "count")).sum();
    assert!(samples > f64::from(1 << 19), "{samples} samples fit into memory");
    assert_eq!(all.keys().collect::<Vec<_>>(), one.keys().collect::<Vec<_>>());
    for (file, bytes) in &all {
        assert!(one[file] == *bytes, "{} differs", file.display());
    }
}

/// A core that this process may use.
fn first_core() -> String {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells");
    let list = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:")).expect("Linux tells");
    list.trim().split([',', '-']).next().expect("a core").to_owned()
}
