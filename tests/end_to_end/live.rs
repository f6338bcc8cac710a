//! `live`: what is processed live is what a batch run computes, drops are counted, and every end is clean.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use crate::support::{depthloom, full, succeed};

/// Stereo and a plane, fused, on a small street.
const STREET: &str = "\
experiment: street
sources: { street: { kind: synthetic/road, with: { frames: 0..12, seed: 2, width: 320, height: 96 } } }
stages:
  fly:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 48 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      plane: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      fused: { kind: fusion/confidence, inputs: { mono: plane/depth, stereo: depth/depth, weight: weight/weight } }
    score: { ground_truth: source/depth, estimates: { stereo: { from: depth/depth, sets: [valid] }, fused: fused/depth } }
";

fn street(folder: &Path) -> std::path::PathBuf {
    let path = folder.join("street.yaml");
    std::fs::write(&path, STREET).expect("it is written");
    path
}

fn live(folder: &Path, options: &[&str]) -> Command {
    let mut command = depthloom();
    command.arg("live").arg(street(folder)).arg("--runs").arg(folder.join("runs")).args(options);
    command
}

fn json(command: &mut Command, code: i32) -> Json {
    let output = command.arg("--json").output().expect("the binary starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"))
}

fn count(output: &Json, key: &str) -> u64 {
    output[key].as_u64().unwrap_or_else(|| panic!("`{key}` of {output}"))
}

fn drops(output: &Json) -> u64 {
    ["graph", "recording", "source"].iter().map(|cause| count(&output["dropped"], cause)).sum()
}

#[test]
fn frames_that_were_processed_live_are_recomputed_to_the_same_bits() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("live");
    let output = json(live(folder.path(), &["--rate", "500", "--no-drop", "--scores"]).arg("--out").arg(&out), 0);
    assert_eq!((count(&output, "offered"), count(&output, "processed"), drops(&output)), (12, 12, 0));
    let batch = folder.path().join("batch");
    succeed(depthloom().arg("run").arg(street(folder.path())).args(["--quiet", "--no-page", "--out"]).arg(&batch));
    let table = |run: &Path| std::fs::read_to_string(run.join("table.csv")).expect("it was written");
    assert_eq!(table(&out), table(&batch));
    succeed(depthloom().arg("verify").arg(&out));
    // The recording as the source of a batch run: the same maps, to the bit.
    let again = folder.path().join("again");
    let source = format!("sources.street={{kind: mcap, with: {{path: {}}}}}", out.display());
    succeed(
        depthloom()
            .arg("run")
            .arg(street(folder.path()))
            .args(["--quiet", "--no-page", "--set", &source, "--out"])
            .arg(&again),
    );
    assert_eq!(table(&again), table(&batch));
    let differences = depthloom().args(["runs", "diff"]).args([&again, &out]).output().expect("the binary starts");
    let text = String::from_utf8_lossy(&differences.stdout);
    assert!(text.contains("equal"), "{text}");
}

#[test]
fn a_batch_run_after_a_live_one_finds_the_ground_truth_that_was_hidden() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    succeed(depthloom().arg("synth").arg(&data).args(["--frames", "3", "--width", "320", "--height", "96", "--quiet"]));
    // Its ground truth is optional, as it is in all data sets on disk.
    let kitti =
        format!("kind: kitti/stereo2015, with: {{ root: {}, split: training, ground_truth: occ }}", data.display());
    let road = "kind: synthetic/road, with: { frames: 0..12, seed: 2, width: 320, height: 96 }";
    let path = street(folder.path());
    std::fs::write(&path, STREET.replace(road, &kitti)).expect("it is written");
    let reusing = |command: &str, out: &str, options: &[&str]| {
        let out = folder.path().join("runs").join(out);
        let mut run = depthloom();
        run.env_remove("DEPTHLOOM_FRESH").arg(command).arg(&path).arg("--runs").arg(folder.path().join("runs"));
        succeed(run.arg("--out").arg(&out).args(options));
        out
    };
    reusing("live", "live", &["--rate", "50", "--no-drop"]);
    let after = reusing("run", "after", &["--quiet", "--no-page"]);
    let fresh = reusing("run", "fresh", &["--quiet", "--no-page", "--fresh"]);
    for file in ["table.csv", "recording.mcap"] {
        let bytes = |run: &Path| std::fs::read(run.join(file)).expect("it was written");
        assert!(bytes(&after) == bytes(&fresh), "{file}");
    }
}

#[test]
fn at_more_than_the_possible_rate_the_newest_frame_wins_and_every_drop_is_counted() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = ["--rate", "2000", "--for", "2s", "--preload", "12", "--repeat", "--deadline", "0.01ms"];
    let output = json(live(folder.path(), &options).args(["--out"]).arg(folder.path().join("one")), 3);
    assert!(drops(&output) > 0, "{output}");
    assert_eq!(count(&output, "offered"), count(&output, "processed") + drops(&output));
    assert!(output["error"]["message"].as_str().is_some_and(|message| message.ends_with("were dropped")), "{output}");
    assert!(output["bottleneck"]["name"].is_string(), "{output}");
    assert_eq!(count(&output, "deadline_misses"), count(&output, "processed") - 1, "the first frame is not counted");
    let steps = output["steps"].as_array().expect("a list");
    let at = |name: &str| {
        let step = steps.iter().find(|step| step["name"] == name).unwrap_or_else(|| panic!("`{name}` of {output}"));
        step["latency"]["p50_ms"].as_f64().expect("a number")
    };
    assert!(at("source") < at("stereo") && at("stereo") < at("fused") && at("fused") < at("write"), "{output}");
    // With --allow-drops the exit code is 0; the folder is replaced.
    let out = folder.path().join("one");
    let output = json(live(folder.path(), &options).args(["--allow-drops", "--overwrite", "--out"]).arg(&out), 0);
    assert!(drops(&output) > 0, "{output}");
    let timings = succeed(depthloom().args(["runs", "timings"]).arg(&out));
    let timings = String::from_utf8_lossy(&timings.stdout);
    assert!(timings.contains("latency since capture, ms") && timings.contains("fly.fused"), "{timings}");
    let stored: Json = serde_json::from_str(&std::fs::read_to_string(out.join("live.json")).expect("it was written"))
        .expect("it is JSON");
    assert_eq!(stored["offered"], output["offered"]);
}

/// Waits until a live run has written frames.
fn wait_for_frames(folder: &Path) {
    let recording = folder.join("one.partial/recording.mcap");
    let start = Instant::now();
    while std::fs::metadata(&recording).map_or(0, |file| file.len()) < 200_000 {
        assert!(start.elapsed() < Duration::from_secs(60), "no frame was written");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn endless(folder: &Path, options: &[&str]) -> Child {
    let mut command = live(folder, &["--rate", "50", "--repeat", "--allow-drops"]);
    command.args(options).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().expect("the binary starts")
}

#[cfg(unix)]
fn signal(child: &Child, signal: &str) {
    succeed(Command::new("kill").arg(signal).arg(child.id().to_string()));
}

#[cfg(unix)]
#[test]
fn a_signal_ends_the_stream_and_the_recording_is_complete() {
    for name in ["-INT", "-TERM"] {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("one");
        let child = endless(folder.path(), &["--out", out.to_str().expect("UTF-8")]);
        wait_for_frames(folder.path());
        signal(&child, name);
        let output = child.wait_with_output().expect("it ends");
        let (printed, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        assert!(stderr.contains("stopping: the stream ends"), "{stderr}");
        assert!(printed.contains("frames processed in") && printed.contains("latency since capture"), "{printed}");
        let inspected = succeed(depthloom().arg("inspect").arg(&out));
        assert!(String::from_utf8_lossy(&inspected.stdout).contains("complete"));
        succeed(depthloom().arg("verify").arg(&out));
    }
}

#[cfg(unix)]
#[test]
fn a_killed_live_run_leaves_the_frames_before() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("one");
    let mut child = endless(folder.path(), &["--out", out.to_str().expect("UTF-8")]);
    wait_for_frames(folder.path());
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    let partial = folder.path().join("one.partial");
    let inspected = depthloom().arg("inspect").arg(&partial).output().expect("the binary starts");
    let text = String::from_utf8_lossy(&inspected.stdout);
    assert!(text.contains("fly"), "{text}");
    // Nothing of the killed run is replaced unless it is requested.
    let out = out.to_str().expect("UTF-8");
    let again =
        live(folder.path(), &["--rate", "50", "--for", "1s", "--out", out]).output().expect("the binary starts");
    assert_eq!(again.status.code(), Some(2), "{}", String::from_utf8_lossy(&again.stderr));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_run_with_the_file_and_keeps_what_was_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let command = live(folder.path(), &["--rate", "100", "--repeat", "--allow-drops", "--for", "60s", "--out"]);
    let arguments: Vec<String> = command.get_args().map(|argument| argument.to_string_lossy().into_owned()).collect();
    let mut limited = Command::new("bash");
    limited.arg("-c").arg("ulimit -f 2000; exec \"$0\" \"$@\"").arg(env!("CARGO_BIN_EXE_depthloom")).args(arguments);
    let output = limited.arg(folder.path().join("one")).output().expect("bash starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("recording.mcap") && stderr.contains("can be read from"), "{stderr}");
    succeed(depthloom().arg("inspect").arg(folder.path().join("one.partial")));
}

#[test]
fn wrong_requests_name_the_option_and_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |options: &[&str], parts: &[&str]| {
        let output = live(folder.path(), options).output().expect("the binary starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {stderr}");
        parts.iter().for_each(|part| assert!(stderr.contains(part), "{options:?}: {stderr}"));
    };
    refused(&["--stage", "flyy"], &["--stage `flyy`", "did you mean `fly`?"]);
    refused(&["--rate", "0"], &["frames per second"]);
    refused(&["--for", "20"], &["expected a time such as 20s"]);
    refused(&["--no-drop", "--allow-drops"], &["cannot be used with"]);
    refused(&["--no-record", "--scores"], &["cannot be used with"]);
    refused(&["--cores", "9-2"], &["expected numbers of cores"]);
    #[cfg(target_os = "linux")]
    refused(&["--cores", "1023"], &["failed to run on --cores 1023", "nproc"]);
    assert!(!folder.path().join("runs").exists());
}

#[test]
fn nothing_is_written_without_a_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = json(&mut live(folder.path(), &["--rate", "50", "--no-record", "--no-drop"]), 0);
    assert_eq!((count(&output, "processed"), &output["run"]), (12, &Json::Null));
    assert!(!folder.path().join("runs").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_live_run_takes_no_more_of_the_machine_than_it_may() {
    let folder = tempfile::tempdir().expect("a folder");
    let options = ["--nice", "7", "--cores", "0", "--memory", "8GB"];
    let mut child = endless(
        folder.path(),
        &[&options[..], &["--out", folder.path().join("one").to_str().expect("UTF-8")]].concat(),
    );
    wait_for_frames(folder.path());
    let process = format!("/proc/{}", child.id());
    let nice = |process: &str| {
        let stat = std::fs::read_to_string(format!("{process}/stat")).expect("it runs");
        let fields: Vec<&str> = stat.rsplit(") ").next().expect("fields").split(' ').collect();
        fields[16].parse::<i32>().expect("a number")
    };
    assert_eq!(nice(&process), (nice("/proc/self") + 7).min(19));
    let status = std::fs::read_to_string(format!("{process}/status")).expect("it runs");
    assert!(status.contains("Cpus_allowed_list:\t0\n"), "{status}");
    let limits = std::fs::read_to_string(format!("{process}/limits")).expect("it runs");
    assert!(
        limits.lines().any(|line| line.starts_with("Max address space") && line.contains("8000000000")),
        "{limits}"
    );
    child.kill().expect("it runs");
    child.wait().expect("it ends");
}

/// An hour at 10 frames per second with `DEPTHLOOM_SOAK_S=3600`; two minutes otherwise.
#[cfg(target_os = "linux")]
#[test]
fn memory_and_open_files_stay_flat() {
    if !full("memory_and_open_files_stay_flat") {
        return;
    }
    let seconds: u64 = std::env::var("DEPTHLOOM_SOAK_S").ok().and_then(|text| text.parse().ok()).unwrap_or(120);
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("one");
    let time = format!("{seconds}s");
    let mut command = live(
        folder.path(),
        &["--rate", "10", "--preload", "12", "--repeat", "--allow-drops", "--plain", "--for", &time, "--out"],
    );
    let mut child = command.arg(&out).stdout(Stdio::null()).spawn().expect("the binary starts");
    let process = format!("/proc/{}", child.id());
    let resident = || {
        let status = std::fs::read_to_string(format!("{process}/status")).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
        line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()
    };
    let files = || Some(std::fs::read_dir(format!("{process}/fd")).ok()?.count());
    let start = Instant::now();
    let mut samples = Vec::new();
    while child.try_wait().expect("it can be asked").is_none() {
        if let (Some(kib), Some(files), true) = (resident(), files(), start.elapsed() > Duration::from_secs(15)) {
            samples.push((kib, files));
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    assert!(child.wait().expect("it ends").success());
    // The end writes the summary of the recording.
    samples.truncate(samples.len().saturating_sub(10));
    let (first, last) = samples.split_at(samples.len() / 2);
    let most = |part: &[(u64, usize)]| (part.iter().map(|s| s.0).max(), part.iter().map(|s| s.1).max());
    let (before, after) = (most(first), most(last));
    eprintln!("resident kB and open files: {before:?}, then {after:?}, over {seconds} s");
    assert!(after.0 <= before.0.map(|kib| kib + 4096 + seconds), "{before:?}, then {after:?}");
    assert!(after.1 <= before.1.map(|files| files + 1), "{before:?}, then {after:?}");
}
