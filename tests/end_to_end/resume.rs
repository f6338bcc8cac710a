//! A run that was ended at any byte goes on where it was, and ends with the bytes of one that was not.

use depthloom_graphs::plan::RunId;
use std::fs;
use std::path::{Path, PathBuf};

use depthloom_test_needs::is_full;

use crate::reuse::experiment;
use crate::support::{depthloom, full, succeed};

/// At how many places a recording is cut, and how many runs are killed or fail: `DEPTHLOOM_KILLS`, or few enough for
/// every day.
pub(crate) fn kills() -> u64 {
    let default = if is_full() { 20 } else { 5 };
    std::env::var("DEPTHLOOM_KILLS").map_or(default, |kills| kills.parse().expect("DEPTHLOOM_KILLS is a number"))
}

/// A number that the seed decides, below `end`.
pub(crate) fn below(seed: u64, end: u64) -> u64 {
    (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) % end
}

/// The whole run, once.
struct Whole {
    folder: tempfile::TempDir,
    experiment: PathBuf,
    recording: Vec<u8>,
}

impl Whole {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let experiment = experiment(folder.path());
        let out = folder.path().join("whole/run");
        succeed(depthloom().args(["run", "--no-page", "--quiet", "--out"]).arg(&out).arg(&experiment));
        let recording = fs::read(out.join("recording.mcap")).expect("a recording");
        Self { folder, experiment, recording }
    }

    /// The run, begun again in a folder; what it says.
    fn again(&self, out: &Path) -> String {
        let mut run = depthloom();
        // There is no `runs` folder there.
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

    /// A folder as a run leaves it that was ended when its recording had these bytes.
    fn ended_with(&self, out: &Path, bytes: &[u8]) {
        let partial = out.with_extension("partial");
        fs::create_dir_all(partial.join("experiment")).expect("a folder");
        for name in ["depthloom-run.json", "experiment.yaml", "experiment.resolved.yaml", "experiment/table1.yaml"] {
            fs::copy(self.folder.path().join("whole/run").join(name), partial.join(name)).expect("copied");
        }
        fs::write(partial.join("recording.mcap"), bytes).expect("written");
    }
}

#[test]
fn a_run_ended_at_any_byte_goes_on() {
    if !full("a_run_ended_at_any_byte_goes_on") {
        return;
    }
    let whole = Whole::new();
    let length = whole.recording.len() as u64;
    let mut went_on = 0;
    for place in 0..kills() {
        let out = whole.folder.path().join(format!("cut-{place}/run"));
        let cut = below(place + 1, length) as usize;
        whole.ended_with(&out, &whole.recording[..cut]);
        went_on += u64::from(whole.again(&out).contains("resuming "));
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
    // But where the first frame was not yet whole.
    assert!(went_on * 10 >= kills() * 8, "{went_on} of {} went on", kills());
}

#[test]
fn what_a_power_cut_leaves_behind_the_last_commit_is_written_again() {
    let whole = Whole::new();
    for place in 0..kills().div_ceil(4) {
        let out = whole.folder.path().join(format!("torn-{place}/run"));
        let cut = below(place + 77, whole.recording.len() as u64) as usize;
        // The file has its length, its last bytes never came to the disk.
        let mut bytes = whole.recording[..cut].to_vec();
        let lost = cut.saturating_sub(10_000 + below(place, 100_000) as usize);
        bytes[lost..].fill(0);
        whole.ended_with(&out, &bytes);
        whole.again(&out);
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
}

#[test]
fn a_run_killed_again_and_again_ends_with_the_same_bytes() {
    let whole = Whole::new();
    let mut killed = 0;
    let mut round = 0;
    while killed < kills() {
        let out = whole.folder.path().join(format!("killed-{round}/run"));
        round += 1;
        for moment in 0..6 {
            let mut run = depthloom();
            run.current_dir(whole.folder.path()).env_remove("DEPTHLOOM_FRESH").args([
                "run",
                "--no-page",
                "--quiet",
                "--out",
            ]);
            run.arg(&out)
                .arg(&whole.experiment)
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null());
            let mut child = run.spawn().expect("the binary starts");
            std::thread::sleep(std::time::Duration::from_millis(below(round * 6 + moment, 600)));
            let is_over = child.try_wait().expect("a child").is_some();
            child.kill().expect("killed");
            child.wait().expect("ended");
            if is_over {
                break;
            }
            killed += 1;
        }
        if out.exists() {
            assert!(fs::read(out.join("recording.mcap")).expect("a recording") == whole.recording);
        } else {
            whole.again(&out);
        }
        fs::remove_dir_all(out.parent().expect("a folder")).expect("removed");
    }
    println!("{killed} kills in {round} runs: all ended with the same bytes");
}

#[test]
fn a_run_of_another_experiment_does_not_go_on_with_it() {
    let whole = Whole::new();
    let out = whole.folder.path().join("other/run");
    whole.ended_with(&out, &whole.recording[..whole.recording.len() / 2]);
    let mut run = depthloom();
    run.env_remove("DEPTHLOOM_FRESH").args(["run", "--set", "compare.fused.with.size=3", "--out"]).arg(&out);
    let refused = run.arg(&whole.experiment).output().expect("the binary starts");
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("of another experiment") && said.contains("--overwrite"), "{said}");
    whole.again(&out);
}

#[test]
fn a_recovered_recording_holds_what_was_committed() {
    let whole = Whole::new();
    let at = |name: &str| whole.folder.path().join(name);
    let (cut, recovered) = (at("cut.mcap"), at("recovered.mcap"));
    for share in 1..8 {
        fs::write(&cut, &whole.recording[..whole.recording.len() / 8 * share]).expect("written");
        let open = |path: &Path| depthloom_recording::Recording::open(path).expect("a recording");
        let mut recover = depthloom();
        recover.args(["recover", "--out"]).arg(&recovered).arg(&cut);
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
        assert_eq!(before.once_values(), after.once_values());
        assert!(after.damage(&|| false).is_empty());
        // Any reader finds its summary, and every message by it.
        let bytes = fs::read(&recovered).expect("the file");
        let summary = mcap::Summary::read(&bytes).expect("sound").expect("a summary");
        let told = summary.stats.expect("statistics").message_count;
        assert_eq!(mcap::MessageStream::new(&bytes).expect("sound").filter_map(Result::ok).count() as u64, told);
        let refused = depthloom().args(["recover", "--out"]).arg(&recovered).arg(&cut).output().expect("it starts");
        assert_eq!(refused.status.code(), Some(2), "what is there stays");
        fs::remove_file(&recovered).expect("removed");
    }
}

#[test]
fn waiting_for_the_disk_changes_no_byte() {
    let whole = Whole::new();
    let out = whole.folder.path().join("durable/run");
    succeed(depthloom().args(["run", "--no-page", "--quiet", "--durable", "--out"]).arg(&out).arg(&whole.experiment));
    assert!(fs::read(out.join("recording.mcap")).expect("a recording") == whole.recording);
}
