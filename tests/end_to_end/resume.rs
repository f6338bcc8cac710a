//! A run that was interrupted at any byte resumes, and ends with the same bytes as an uninterrupted one.

use depthloom_graphs::plan::RunId;
use depthloom_recording::{Condition, Recording};
use std::fs;
use std::path::{Path, PathBuf};

use depthloom_test_needs::is_full;

use crate::reuse::experiment;
use crate::support::{depthloom, full, succeed};

/// The number of truncated recordings, and of runs that are killed or fail: `DEPTHLOOM_KILLS`, or a small default.
pub(crate) fn kills() -> u64 {
    let default = if is_full() { 20 } else { 5 };
    std::env::var("DEPTHLOOM_KILLS").map_or(default, |kills| kills.parse().expect("DEPTHLOOM_KILLS is a number"))
}

/// A pseudo-random number below `end`.
pub(crate) fn below(seed: u64, end: u64) -> u64 {
    (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) % end
}

/// A complete run as reference.
struct Reference {
    folder: tempfile::TempDir,
    experiment: PathBuf,
    recording: Vec<u8>,
}

impl Reference {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let experiment = experiment(folder.path());
        let out = folder.path().join("complete/run");
        succeed(depthloom().args(["run", "--no-page", "--quiet", "--out"]).arg(&out).arg(&experiment));
        let recording = fs::read(out.join("recording.mcap")).expect("a recording");
        Self { folder, experiment, recording }
    }

    /// Runs the experiment into `out`, and asserts that the recording equals the reference. Returns standard error.
    fn resume(&self, out: &Path) -> String {
        let mut run = depthloom();
        // This folder has no `runs` whose values could be reused.
        run.current_dir(self.folder.path()).env_remove("DEPTHLOOM_FRESH").args([
            "run",
            "--no-page",
            "--workers",
            "2",
            "--out",
        ]);
        let output = succeed(run.arg(out).arg(&self.experiment));
        assert!(fs::read(out.join("recording.mcap")).expect("a recording") == self.recording);
        assert!(!out.with_extension("partial").exists());
        String::from_utf8(output.stderr).expect("text")
    }

    /// Writes the folder of a run that was killed when its recording had these bytes.
    fn write_interrupted(&self, out: &Path, bytes: &[u8]) {
        let partial = out.with_extension("partial");
        fs::create_dir_all(partial.join("experiment")).expect("a folder");
        for name in ["depthloom-run.json", "experiment.yaml", "experiment.resolved.yaml", "experiment/table1.yaml"] {
            fs::copy(self.folder.path().join("complete/run").join(name), partial.join(name)).expect("copied");
        }
        fs::write(partial.join("recording.mcap"), bytes).expect("written");
    }
}

#[test]
fn a_run_interrupted_at_any_byte_resumes() {
    if !full("a_run_interrupted_at_any_byte_resumes") {
        return;
    }
    let reference = Reference::new();
    let length = reference.recording.len() as u64;
    let mut resumed = 0;
    for place in 0..kills() {
        let out = reference.folder.path().join(format!("cut-{place}/run"));
        let cut = below(place + 1, length) as usize;
        reference.write_interrupted(&out, &reference.recording[..cut]);
        resumed += u64::from(reference.resume(&out).contains("resuming "));
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
    // Except for interruptions before the end of the first frame.
    assert!(resumed * 10 >= kills() * 8, "{resumed} of {} resumed", kills());
}

#[test]
fn bytes_lost_in_a_power_cut_are_written_again() {
    let reference = Reference::new();
    for place in 0..kills().div_ceil(4) {
        let out = reference.folder.path().join(format!("torn-{place}/run"));
        let cut = below(place + 77, reference.recording.len() as u64) as usize;
        // The file has its full length, but its last bytes were not stored.
        let mut bytes = reference.recording[..cut].to_vec();
        let lost = cut.saturating_sub(10_000 + below(place, 100_000) as usize);
        bytes[lost..].fill(0);
        reference.write_interrupted(&out, &bytes);
        reference.resume(&out);
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
}

#[test]
fn a_recording_that_lost_all_its_bytes_in_a_power_cut_is_written_again() {
    let reference = Reference::new();
    for length in [0, 1, 8, 5000, reference.recording.len() / 2] {
        let out = reference.folder.path().join(format!("zeros-{length}/run"));
        reference.write_interrupted(&out, &vec![0; length]);
        reference.resume(&out);
    }
}

#[test]
fn a_repeatedly_killed_run_ends_with_the_same_bytes() {
    let reference = Reference::new();
    let mut killed = 0;
    let mut round = 0;
    while killed < kills() {
        let out = reference.folder.path().join(format!("killed-{round}/run"));
        round += 1;
        for moment in 0..6 {
            let mut run = depthloom();
            run.current_dir(reference.folder.path()).env_remove("DEPTHLOOM_FRESH").args([
                "run",
                "--no-page",
                "--quiet",
                "--out",
            ]);
            run.arg(&out)
                .arg(&reference.experiment)
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null());
            let mut child = run.spawn().expect("the binary starts");
            std::thread::sleep(std::time::Duration::from_millis(below(round * 6 + moment, 600)));
            let has_finished = child.try_wait().expect("a child").is_some();
            child.kill().expect("killed");
            child.wait().expect("ended");
            if has_finished {
                break;
            }
            killed += 1;
        }
        if out.exists() {
            assert!(fs::read(out.join("recording.mcap")).expect("a recording") == reference.recording);
        } else {
            reference.resume(&out);
        }
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
    println!("{killed} kills in {round} runs: all ended with the same bytes");
}

/// An intact summary hides the damage, and the values are found undamaged in a run beside it.
#[test]
fn a_damaged_recording_is_set_aside_although_another_run_has_its_values() {
    let reference = Reference::new();
    let (mut set_aside, length) = (0, reference.recording.len() as u64);
    for place in 0..kills() {
        let out = reference.folder.path().join(format!("complete/damaged-{place}"));
        let mut bytes = reference.recording.clone();
        bytes[below(place + 5, length) as usize] ^= 1;
        reference.write_interrupted(&out, &bytes);
        let partial = out.with_extension("partial");
        let has_summary = Recording::open(partial.join("recording.mcap"))
            .is_ok_and(|opened| *opened.condition() == Condition::Complete);
        // Otherwise the plan is damaged, or the frames before the damage are resumed.
        if has_summary {
            let stderr = reference.resume(&out);
            assert!(stderr.contains("cannot resume") && stderr.contains("is damaged at byte"), "{stderr}");
            assert!(!out.join("recording.outdated.mcap").exists());
            set_aside += 1;
        }
    }
    assert!(set_aside * 2 > kills(), "{set_aside} of {} recordings were set aside", kills());
}

/// Frames that were set aside before are not replaced.
#[test]
fn a_second_damaged_recording_is_set_aside_beside_the_first() {
    let reference = Reference::new();
    let out = reference.folder.path().join("complete/damaged");
    let mut bytes = reference.recording.clone();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    reference.write_interrupted(&out, &bytes);
    let partial = out.with_extension("partial");
    fs::write(partial.join("recording.outdated.mcap"), &reference.recording).expect("written");
    // The folder of programs' output cannot be written: the run fails after the decision.
    let at = |name: &str| partial.join(name);
    fs::create_dir(at("timings.parquet")).expect("a folder");
    let mut run = depthloom();
    run.current_dir(reference.folder.path()).env_remove("DEPTHLOOM_FRESH").args(["run", "--no-page", "--out"]);
    let failed = run.arg(&out).arg(&reference.experiment).output().expect("the binary starts");
    assert!(!failed.status.success(), "{}", String::from_utf8_lossy(&failed.stderr));
    assert!(fs::read(at("recording.outdated.mcap")).expect("kept") == reference.recording);
    assert!(fs::read(at("recording.outdated-2.mcap")).expect("kept") == bytes);
    fs::remove_dir(at("timings.parquet")).expect("removed");
    reference.resume(&out);
    assert!(!out.join("recording.outdated.mcap").exists() && !out.join("recording.outdated-2.mcap").exists());
}

#[test]
fn a_run_of_another_experiment_does_not_resume() {
    let reference = Reference::new();
    let out = reference.folder.path().join("other/run");
    reference.write_interrupted(&out, &reference.recording[..reference.recording.len() / 2]);
    let mut run = depthloom();
    run.env_remove("DEPTHLOOM_FRESH").args(["run", "--set", "compare.fused.with.size=3", "--out"]).arg(&out);
    let refused = run.arg(&reference.experiment).output().expect("the binary starts");
    let stderr = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("of another experiment") && stderr.contains("--overwrite"), "{stderr}");
    reference.resume(&out);
}

#[test]
fn a_recovered_recording_contains_the_committed_frames() {
    let reference = Reference::new();
    let at = |name: &str| reference.folder.path().join(name);
    let (cut, recovered) = (at("cut.mcap"), at("recovered.mcap"));
    for share in 1..8 {
        fs::write(&cut, &reference.recording[..reference.recording.len() / 8 * share]).expect("written");
        let open = |path: &Path| Recording::open(path).expect("a recording");
        let mut recover = depthloom();
        recover.args(["runs", "recover", "--out"]).arg(&recovered).arg(&cut);
        if open(&cut).is_empty() {
            assert_eq!(recover.output().expect("the binary starts").status.code(), Some(2));
            assert!(!recovered.exists());
            continue;
        }
        succeed(&mut recover);
        let (before, after) = (open(&cut), open(&recovered));
        for run in 0..2 {
            assert_eq!(before.frames(RunId(run)), after.frames(RunId(run)));
        }
        assert_eq!(before.aggregate_values(), after.aggregate_values());
        assert!(after.damage(&|| false).is_empty());
        // Other readers find the summary and all messages.
        let bytes = fs::read(&recovered).expect("the file");
        let summary = mcap::Summary::read(&bytes).expect("sound").expect("a summary");
        let message_count = summary.stats.expect("statistics").message_count;
        assert_eq!(
            mcap::MessageStream::new(&bytes).expect("sound").filter_map(Result::ok).count() as u64,
            message_count
        );
        let refused =
            depthloom().args(["runs", "recover", "--out"]).arg(&recovered).arg(&cut).output().expect("it starts");
        assert_eq!(refused.status.code(), Some(2), "an existing file is kept");
        fs::remove_file(&recovered).expect("removed");
    }
}

#[test]
fn durable_runs_write_the_same_bytes() {
    let reference = Reference::new();
    let out = reference.folder.path().join("durable/run");
    succeed(
        depthloom().args(["run", "--no-page", "--quiet", "--durable", "--out"]).arg(&out).arg(&reference.experiment),
    );
    assert!(fs::read(out.join("recording.mcap")).expect("a recording") == reference.recording);
}
