//! Folders whose names are not UTF-8: runs and data in them and next to them can be used, or are refused with a reason.
#![cfg(unix)]

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt as _;

use super::{Case, stderr_of};

const STREET: &str = "experiment: names
sources: { street: { kind: synthetic/road, with: { frames: 0..2, seed: 2, width: 64, height: 32 } } }
stages:
  look:
    source: street
    nodes: { mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } } }
    score: { ground_truth: source/depth, estimates: { mono: mono/depth } }
";

#[test]
fn an_earlier_run_in_a_folder_without_a_utf8_name_is_reused_and_listed() {
    let case = Case::new();
    case.write("street.yaml", STREET);
    case.run("street.yaml", "runs/one", &[]);
    let renamed = case.path("runs").join(OsStr::from_bytes(b"caf\xe9"));
    fs::rename(case.path("runs/one"), renamed).expect("renamed");
    case.run_as_fresh("street.yaml", "runs/two", &[]);
    for arguments in [
        &["runs"][..],
        &["runs", "--json"],
        &["plan", "street.yaml", "--reuse"],
        &["run", "--no-page", "street.yaml", "--json"],
    ] {
        let output = case.depthloom(arguments).output().expect("the program starts");
        assert!(output.status.success(), "{arguments:?}: {}", stderr_of(&output));
    }
}

#[test]
fn data_in_a_folder_without_a_utf8_name_is_described_or_refused() {
    let case = Case::new();
    let folder = case.path("").join(OsStr::from_bytes(b"caf\xe9"));
    fs::create_dir(&folder).expect("made");
    for arguments in [&["inspect"][..], &["inspect", "--json"]] {
        let output = case.depthloom(arguments).arg(&folder).output().expect("the program starts");
        let code = output.status.code().expect("it ends by itself");
        assert!((1..=3).contains(&code), "{arguments:?}: {code} {}", stderr_of(&output));
        assert!(!stderr_of(&output).contains("panicked"), "{arguments:?}: {}", stderr_of(&output));
    }
}
