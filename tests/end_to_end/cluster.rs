//! Shards and submissions: whatever happens to a job, the last run has the bytes of a single run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use crate::support::slurm::Cluster;
use crate::support::{depthloom, full, skipped, succeed, workspace};

/// Longest wait, on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(300);

/// An experiment in a folder of its own.
struct Case {
    folder: tempfile::TempDir,
    options: Vec<String>,
    /// The recording and the table of a single run.
    expected: [Vec<u8>; 2],
}

impl Case {
    fn new(experiment: &str, set: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::copy(workspace().join("experiments").join(experiment), folder.path().join("experiment.yaml"))
            .expect("copied");
        let options = set.iter().flat_map(|set| ["--set".to_owned(), (*set).to_owned()]).collect();
        let mut case = Self { folder, options, expected: [Vec::new(), Vec::new()] };
        succeed(case.command("run").args(["--runs", "single", "--out", "single/run", "--no-page", "--quiet"]));
        case.expected = case.results(&case.at("single/run"));
        case
    }

    /// Training, two stages and four variants.
    fn of_table1() -> Self {
        let mut set = vec!["sources.train.with.frames=0..5", "sources.test.with.frames=0..7"];
        set.extend(["sources.train.with.width=320", "sources.train.with.height=96"]);
        set.extend(["sources.test.with.width=320", "sources.test.with.height=96"]);
        set.extend(["learn.samples.with.size=[160, 64]", "learn.train.with.network=unet-tiny"]);
        set.push("learn.train.with.steps=2");
        Self::new("table1.yaml", &set)
    }

    /// One stage of many frames, so that jobs can be caught while they run.
    fn of_many_frames() -> Self {
        let mut set = vec!["sources.street.with.frames=0..300"];
        set.extend(["sources.street.with.width=320", "sources.street.with.height=96"]);
        Self::new("first-look.yaml", &set)
    }

    fn at(&self, path: &str) -> PathBuf {
        self.folder.path().join(path)
    }

    fn plain(&self, command: &str) -> Command {
        let mut depthloom = depthloom();
        depthloom.env_remove("DEPTHLOOM_FRESH").current_dir(self.folder.path()).arg(command);
        depthloom
    }

    /// A command that reads the experiment.
    fn command(&self, command: &str) -> Command {
        let mut depthloom = self.plain(command);
        depthloom.arg("experiment.yaml").args(&self.options);
        depthloom
    }

    fn results(&self, run: &Path) -> [Vec<u8>; 2] {
        ["recording.mcap", "scores.csv"].map(|file| {
            fs::read(run.join(file)).unwrap_or_else(|error| panic!("{}: {error}", run.join(file).display()))
        })
    }

    fn assert_equal(&self, run: &Path) {
        let [recording, scores] = self.results(run);
        assert!(recording == self.expected[0], "{}: the recording differs from that of a single run", run.display());
        assert!(scores == self.expected[1], "{}: the scores differ from those of a single run", run.display());
    }

    /// The folder of the shards of the only plan in a folder of runs.
    fn shards(&self, runs: &str) -> PathBuf {
        let folder = self.at(runs).join(self.experiment()).join("shards");
        let plans = names(&folder);
        let [plan] = plans.as_slice() else { panic!("{plans:?}") };
        folder.join(plan)
    }

    fn jobs(&self, runs: &str, cluster: Option<&Cluster>) -> Json {
        let mut command = self.plain("jobs");
        cluster.into_iter().for_each(|cluster| cluster.set_environment(&mut command));
        let output = command.args(["--runs", runs, "--json"]).output().expect("the binary starts");
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", errors(&output)))
    }

    fn state(&self, runs: &str, cluster: Option<&Cluster>, job: &str) -> String {
        let jobs = self.jobs(runs, cluster);
        let jobs = jobs["jobs"].as_array().expect("jobs");
        let found = jobs.iter().find(|found| found["name"] == job).unwrap_or_else(|| panic!("no {job} in {jobs:?}"));
        found["state"].as_str().expect("text").to_owned()
    }

    /// Waits until a job, `STEP/INDEX`, runs; returns its process.
    fn process_of(&self, runs: &str, job: &str) -> u32 {
        let started = Instant::now();
        loop {
            let read = |name: &str| -> Option<Json> {
                let folder = self.at(runs).join(self.experiment()).join("shards");
                let file = folder.join(names(&folder).first()?).join("progress").join(name);
                serde_json::from_slice(&fs::read(file).ok()?).ok()
            };
            let (step, job) = job.split_once('/').expect("STEP/JOB");
            if let Some(progress) =
                read(&format!("{step}-{job}.json")).filter(|progress| progress["ending"] == "running")
            {
                return u32::try_from(progress["process"].as_u64().expect("a number")).expect("a process");
            }
            assert!(started.elapsed() < PATIENCE, "job {job} does not start");
            sleep(Duration::from_millis(5));
        }
    }

    fn experiment(&self) -> String {
        let text = fs::read_to_string(self.at("experiment.yaml")).expect("the experiment");
        text.lines().find_map(|line| line.strip_prefix("experiment: ")).expect("a name").trim().to_owned()
    }

    /// The only run in a folder of runs.
    fn run_in(&self, runs: &str) -> PathBuf {
        let folder = self.at(runs).join(self.experiment());
        let runs: Vec<String> = names(&folder).into_iter().filter(|name| name != "shards").collect();
        let [run] = runs.as_slice() else { panic!("{}: {runs:?}", folder.display()) };
        folder.join(run)
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn kill(process: u32) {
    succeed(Command::new("kill").args(["-KILL", &process.to_string()]));
}

#[test]
fn shards_of_frames_and_of_variants_join_to_the_bytes_of_one_run() {
    let case = Case::of_table1();
    let shard = |runs: &str, part: &str, by: &str| {
        case.command("run").args(["--runs", runs, "--shard", part, "--by", by]).output().expect("the binary starts")
    };
    let join = |runs: &str, more: &[&str]| {
        let out = format!("{runs}/joined");
        case.command("run").args(["--runs", runs, "--out", &out, "--no-page"]).args(more).output().expect("it starts")
    };
    for (runs, by, count) in [("by-frames", "frames", 3), ("by-variants", "variants", 2), ("many", "frames", 9)] {
        for number in 1..=count {
            let output = shard(runs, &format!("{number}/{count}"), by);
            assert!(output.status.success(), "{}", errors(&output));
        }
        let output = join(runs, &["--require-shards"]);
        assert!(output.status.success(), "{}", errors(&output));
        assert!(errors(&output).contains("reused from earlier runs"), "{}", errors(&output));
        case.assert_equal(&case.at(&format!("{runs}/joined")));
    }
    // Shards are not listed as runs.
    let listed = succeed(case.plain("runs").args(["--runs", "by-frames", "--json"]));
    let listed: Json = serde_json::from_slice(&listed.stdout).expect("JSON");
    assert_eq!(listed["runs"].as_array().map(Vec::len), Some(1), "{listed}");

    // A complete shard is left as it is; a damaged one is computed again; a missing one is named with its command.
    let folder = case.shards("by-frames");
    let recording = folder.join("frames-2-of-3/recording.mcap");
    let before = fs::read(&recording).expect("a recording");
    let again = shard("by-frames", "2/3", "frames");
    assert!(again.status.success() && errors(&again).contains("is complete"), "{}", errors(&again));
    let mut damaged = before.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0xff;
    fs::write(&recording, &damaged).expect("written");
    fs::remove_dir_all(folder.join("frames-1-of-3")).expect("removed");
    fs::remove_dir_all(case.at("by-frames/joined")).expect("removed");
    let refused = join("by-frames", &["--require-shards"]);
    assert_eq!(refused.status.code(), Some(2));
    let text = errors(&refused);
    assert!(text.contains("frames-1-of-3 cannot be used: it is not there") && text.contains("`--shard 1/3`"), "{text}");
    let joined = join("by-frames", &[]);
    assert!(errors(&joined).contains("the first is frames-1-of-3"), "{}", errors(&joined));
    case.assert_equal(&case.at("by-frames/joined"));
    fs::remove_dir_all(case.at("by-frames/joined")).expect("removed");
    for part in ["1/3", "2/3"] {
        let output = shard("by-frames", part, "frames");
        assert!(output.status.success(), "{}", errors(&output));
    }
    assert!(fs::read(&recording).expect("a recording") == before, "the shard that was computed again differs");
    let joined = join("by-frames", &["--require-shards"]);
    assert!(joined.status.success(), "{}", errors(&joined));
    case.assert_equal(&case.at("by-frames/joined"));
}

#[test]
fn a_submission_on_this_machine_writes_the_bytes_of_one_run() {
    let case = Case::of_table1();
    let submit = |runs: &str, more: &[&str]| {
        let mut submit = case.command("submit");
        succeed(submit.args(["--to", "local", "--runs", runs, "--no-page"]).args(more))
    };
    submit("frames", &["--shards", "3"]);
    case.assert_equal(&case.run_in("frames"));
    let jobs = case.jobs("frames", None);
    let steps: Vec<&str> =
        jobs["jobs"].as_array().expect("jobs").iter().map(|job| job["name"].as_str().expect("text")).collect();
    let frames = |step: u32| (1..=3).map(move |number| format!("{step}-frames-{number}-of-3"));
    let expected: Vec<String> =
        frames(1).chain(["2-learn.train".to_owned()]).chain(frames(3)).chain(["4-run".to_owned()]).collect();
    assert_eq!(steps, expected);
    assert!(jobs["jobs"].as_array().expect("jobs").iter().all(|job| job["state"] == "finished"), "{jobs}");

    submit("variants", &["--shards", "2", "--by", "variants"]);
    case.assert_equal(&case.run_in("variants"));

    let scratch = case.at("scratch");
    submit("scratched", &["--shards", "2", "--scratch", scratch.to_str().expect("UTF-8")]);
    case.assert_equal(&case.run_in("scratched"));
    let left: Vec<String> = names(&scratch).iter().flat_map(|name| names(&scratch.join(name))).collect();
    assert_eq!(left, [] as [&str; 0], "nothing is left in the scratch folder");
}

#[test]
fn a_changed_experiment_does_not_change_jobs_that_were_submitted() {
    let case = Case::of_table1();
    let mut submit = case.command("submit");
    let output = succeed(submit.args(["--to", "script", "--runs", "runs", "--no-page", "--shards", "2"]));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(text.contains("qsub -J 0-1") && text.contains("bsub -J"), "{text}");
    let experiment = fs::read_to_string(case.at("experiment.yaml")).expect("the experiment");
    fs::write(case.at("experiment.yaml"), experiment.replace("size: 5", "size: 3")).expect("written");
    let folder = case.shards("runs");
    for (step, jobs) in [(1, 2), (2, 1), (3, 2), (4, 1)] {
        for job in 0..jobs {
            let script = folder.join(format!("step-{step}.sh"));
            succeed(Command::new("sh").arg(script).arg(job.to_string()).env_remove("DEPTHLOOM_FRESH"));
        }
    }
    case.assert_equal(&case.run_in("runs"));
}

#[test]
fn jobs_that_are_killed_or_lose_their_result_are_retried_to_the_same_bytes() {
    let case = Case::of_many_frames();
    let submit = || {
        let mut submit = case.command("submit");
        submit.args(["--to", "local", "--runs", "runs", "--no-page", "--shards", "3", "--parallel", "1"]);
        submit
    };
    let retry =
        || case.plain("jobs").args(["retry", "--parallel", "2"]).args(["--runs", "runs"]).output().expect("it starts");
    let running = submit().stderr(std::process::Stdio::piped()).spawn().expect("the binary starts");
    kill(case.process_of("runs", "1/0"));
    // A second submission is refused meanwhile, or finds the jobs that stopped.
    let ended = running.wait_with_output().expect("ended");
    assert!(!ended.status.success());
    assert!(errors(&ended).contains("jobs retry"), "{}", errors(&ended));
    assert_eq!(case.state("runs", None, "1-frames-1-of-3"), "stopped");
    assert_eq!(case.state("runs", None, "2-run"), "waiting");

    let retried = retry();
    assert!(retried.status.success(), "{}", errors(&retried));
    case.assert_equal(&case.run_in("runs"));

    // The file of a shard is removed, and the run with it.
    fs::remove_dir_all(case.run_in("runs")).expect("removed");
    let recording = case.shards("runs").join("1-frames-2-of-3/recording.mcap");
    let before = fs::read(&recording).expect("a recording");
    fs::remove_file(&recording).expect("removed");
    let retried = retry();
    assert!(retried.status.success(), "{}", errors(&retried));
    case.assert_equal(&case.run_in("runs"));
    assert!(fs::read(&recording).expect("a recording") == before);
    let done = retry();
    assert!(errors(&done).contains("all jobs are finished"), "{}", errors(&done));
}

#[test]
fn what_would_mislead_is_refused_by_submit() {
    let case = Case::of_table1();
    let submit = |more: &[&str]| {
        case.command("submit")
            .args(["--runs", "runs", "--no-page", "--shards", "2"])
            .args(more)
            .output()
            .expect("starts")
    };
    let refused = |more: &[&str], what: &str| {
        let output = submit(more);
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", errors(&output));
        assert!(errors(&output).contains(what), "{more:?}: {}", errors(&output));
    };
    // A foreign folder, the run of another experiment, and the folder of runs are not results of this submission.
    fs::create_dir(case.at("photos")).expect("made");
    for out in ["photos", "single/run", "single", "experiment.yaml"] {
        refused(&["--to", "local", "--out", out], "exists already");
    }
    refused(&["--to", "local", "--", "--time=5"], "options after `--`");
    for option in ["--array=0-5", "--output=x", "-o", "--chdir=/"] {
        refused(&["--dry-run", "--", option], "is set by depthloom");
    }
    let dry = submit(&["--dry-run", "--", "--export=NONE", "--dependency=afterok:7"]);
    let text = String::from_utf8_lossy(&dry.stdout).into_owned();
    assert!(text.contains("--array=0-1 --dependency=afterok:7 "), "{text}");
    assert!(text.contains("--dependency=afterok:JOB-OF-STEP-1 "), "{text}");
    assert!(!case.at("runs").exists(), "a dry run writes nothing");

    // The folder appears later: the last job does not take it for its result.
    succeed(case.command("submit").args(["--runs", "late", "--to", "script", "--shards", "1", "--out", "out"]));
    let shards = case.shards("late");
    for step in 1..=3 {
        succeed(Command::new("sh").arg(shards.join(format!("step-{step}.sh"))).arg("0").env_remove("DEPTHLOOM_FRESH"));
    }
    fs::create_dir(case.at("out")).expect("made");
    fs::write(case.at("out/mine"), "mine").expect("written");
    let last = Command::new("sh").arg(shards.join("step-4.sh")).arg("0").env_remove("DEPTHLOOM_FRESH").output();
    let last = last.expect("sh starts");
    assert!(errors(&last).contains("is not the run of this submission"), "{}", errors(&last));
    assert_eq!(case.state("late", None, "4-run"), "failed");
    assert_eq!(fs::read_to_string(case.at("out/mine")).expect("kept"), "mine");

    let retry = case.plain("jobs").args(["retry", "--runs", "late", "--", "--time=9"]).output().expect("starts");
    assert!(errors(&retry).contains("options after `--`"), "{}", errors(&retry));

    // A script without a job does not choose one.
    let none =
        Command::new("sh").arg(shards.join("step-1.sh")).env_remove("DEPTHLOOM_FRESH").output().expect("sh starts");
    assert_eq!(none.status.code(), Some(2), "{}", errors(&none));
}

/// A file system of a limited size, until it is dropped. `None` without the permission to mount one.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(test: &str, at: PathBuf, size: &str) -> Option<Self> {
        fs::create_dir(&at).expect("made");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", size, "tmpfs"]).arg(&at).output();
        if mounted.is_ok_and(|output| output.status.success()) {
            return Some(Self(at));
        }
        skipped(test, "this process may not mount a file system");
        None
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).output();
    }
}

#[test]
fn a_full_scratch_folder_fails_the_job_which_resumes_with_room() {
    const TEST: &str = "cluster::a_full_scratch_folder_fails_the_job_which_resumes_with_room";
    let case = Case::of_table1();
    let Some(disk) = SmallDisk::mount(TEST, case.at("scratch"), "size=600k") else { return };
    let mut submit = case.command("submit");
    submit.args(["--to", "local", "--runs", "runs", "--no-page", "--shards", "2", "--scratch", "scratch"]);
    let output = submit.output().expect("the binary starts");
    assert!(!output.status.success(), "600 kB are enough");
    assert!(errors(&output).contains("No space left"), "{}", errors(&output));
    assert_eq!(case.state("runs", None, "1-frames-1-of-2"), "failed");
    drop(disk);
    succeed(case.plain("jobs").args(["retry", "--runs", "runs"]));
    case.assert_equal(&case.run_in("runs"));
}

#[test]
fn failed_frames_end_no_chain_of_jobs_with_keep_going() {
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path();
    let size = ["--width", "160", "--height", "64", "--frames", "4", "--quiet"];
    succeed(depthloom().arg("synth").arg(here.join("data")).args(size));
    fs::write(here.join("data/training/image_2/000001_10.png"), "damaged").expect("written");
    let experiment = "experiment: damaged
sources: { street: { kind: kitti/stereo2015, with: { root: data, split: training, ground_truth: occ } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, with: { disparities: 32 }, inputs: { left: source/left, right: source/right } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { depth: depth/depth } }
";
    fs::write(here.join("damaged.yaml"), experiment).expect("written");
    let command = |arguments: &[&str]| {
        let mut command = depthloom();
        command.env_remove("DEPTHLOOM_FRESH").current_dir(here).args(arguments).output().expect("the binary starts")
    };
    let single = command(&["run", "damaged.yaml", "--keep-going", "--no-page", "--out", "single", "--runs", "a", "-q"]);
    assert_eq!(single.status.code(), Some(3), "{}", errors(&single));
    let joined = command(&[
        "submit",
        "damaged.yaml",
        "--to",
        "local",
        "--shards",
        "2",
        "--keep-going",
        "--no-page",
        "--out",
        "joined",
        "--runs",
        "b",
    ]);
    assert_eq!(joined.status.code(), Some(3), "{}", errors(&joined));
    let read = |run: &str| fs::read(here.join(run).join("recording.mcap")).expect("a recording");
    assert!(read("single") == read("joined"), "the recordings differ");
}

#[test]
fn a_job_that_still_writes_its_report_runs() {
    let case = Case::of_many_frames();
    // Slurm's commands, as far as a submission needs them.
    let programs = case.at("programs");
    fs::create_dir(&programs).expect("made");
    for (name, script) in [
        ("sbatch", "echo x >> submitted; wc -l < submitted"),
        ("squeue", "echo '2|0|RUNNING|None'"),
        ("scontrol", "echo MaxArraySize = 1001"),
    ] {
        use std::os::unix::fs::PermissionsExt as _;
        let file = programs.join(name);
        fs::write(&file, format!("#!/bin/sh\n{script}\n")).expect("written");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("an owner may do that");
    }
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").expect("a PATH"));
    succeed(case.command("submit").args(["--runs", "runs", "--no-page", "--shards", "1"]).env("PATH", &path));
    let folder = case.shards("runs");
    for step in 1..=2 {
        succeed(Command::new("sh").arg(folder.join(format!("step-{step}.sh"))).arg("0").env_remove("DEPTHLOOM_FRESH"));
    }
    let state = || {
        let output = succeed(case.plain("jobs").args(["--runs", "runs", "--json"]).env("PATH", &path));
        let jobs: Json = serde_json::from_slice(&output.stdout).expect("JSON");
        jobs["jobs"][1]["state"].as_str().expect("text").to_owned()
    };
    assert_eq!(state(), "finished");
    // The recording is in its place before the process ends.
    let file = folder.join("progress/2-0.json");
    let text = fs::read_to_string(&file).expect("progress");
    assert!(text.contains("\"finished\""), "{text}");
    fs::write(&file, text.replace("\"finished\"", "\"running\"")).expect("written");
    assert_eq!(state(), "running");
}

#[test]
fn slurm_runs_job_arrays_to_the_bytes_of_one_run() {
    const TEST: &str = "cluster::slurm_runs_job_arrays_to_the_bytes_of_one_run";
    let Some(cluster) = Cluster::start(TEST) else { return };
    let case = Case::of_table1();
    for (runs, by, shards) in [("frames", "frames", "4"), ("variants", "variants", "2")] {
        let mut submit = case.command("submit");
        cluster.set_environment(&mut submit);
        submit.args(["--runs", runs, "--no-page", "--shards", shards, "--by", by, "--workers", "1"]);
        let output = succeed(submit.args(["--", "--time=10", "--mem=2G"]));
        assert!(errors(&output).contains("`depthloom jobs "), "{}", errors(&output));
        // A second submission is refused.
        let mut second = case.command("submit");
        cluster.set_environment(&mut second);
        let second =
            second.args(["--runs", runs, "--no-page", "--shards", shards, "--by", by]).output().expect("starts");
        assert_eq!(second.status.code(), Some(2), "{}", errors(&second));
        assert!(errors(&second).contains("was submitted before"), "{}", errors(&second));
        wait(&case, runs, &cluster);
        case.assert_equal(&case.run_in(runs));
    }
}

/// Waits until no job runs or waits; all must have finished.
fn wait(case: &Case, runs: &str, cluster: &Cluster) {
    let started = Instant::now();
    loop {
        let jobs = case.jobs(runs, Some(cluster));
        let states: Vec<&str> =
            jobs["jobs"].as_array().expect("jobs").iter().map(|job| job["state"].as_str().expect("text")).collect();
        if states.iter().all(|state| *state == "finished") {
            return;
        }
        let is_active = states.iter().any(|state| ["waiting", "running"].contains(state));
        assert!(is_active && started.elapsed() < PATIENCE, "{jobs:#}\n{}", cluster.logs());
        sleep(Duration::from_millis(300));
    }
}

#[test]
fn slurm_jobs_that_fail_are_retried_to_the_same_bytes() {
    const TEST: &str = "cluster::slurm_jobs_that_fail_are_retried_to_the_same_bytes";
    if !full(TEST) {
        return;
    }
    let Some(cluster) = Cluster::start(TEST) else { return };
    let case = Case::of_many_frames();
    let submit = |runs: &str, more: &[&str]| {
        let mut submit = case.command("submit");
        cluster.set_environment(&mut submit);
        succeed(submit.args(["--runs", runs, "--no-page", "--shards", "2", "--workers", "1"]).args(more));
    };
    let retry = |runs: &str, more: &[&str]| {
        let mut retry = case.plain("jobs");
        cluster.set_environment(&mut retry);
        succeed(retry.args(["retry", "--runs", runs]).args(more));
        wait(&case, runs, &cluster);
        case.assert_equal(&case.run_in(runs));
    };
    let until = |runs: &str, job: &str, states: &[&str]| {
        let started = Instant::now();
        while !states.contains(&case.state(runs, Some(&cluster), job).as_str()) {
            assert!(
                started.elapsed() < PATIENCE,
                "{job} is never one of {states:?}: {:#}",
                case.jobs(runs, Some(&cluster))
            );
            sleep(Duration::from_millis(100));
        }
    };
    let array = |runs: &str| -> u64 {
        let jobs: Json =
            serde_json::from_slice(&fs::read(case.shards(runs).join("jobs.json")).expect("jobs")).expect("JSON");
        jobs["slurm"][0]["id"].as_u64().expect("a number")
    };

    // Killed: the others finish, the last run is cancelled by Slurm, and a retry submits both again.
    submit("killed", &[]);
    kill(case.process_of("killed", "1/0"));
    until("killed", "1-frames-1-of-2", &["failed", "stopped"]);
    until("killed", "1-frames-2-of-2", &["finished"]);
    until("killed", "2-run", &["stopped", "waiting"]);
    retry("killed", &[]);

    // Requeued: it resumes by itself.
    submit("requeued", &[]);
    case.process_of("requeued", "1/1");
    cluster.scontrol(&["requeue", &format!("{}_1", array("requeued"))]);
    wait(&case, "requeued", &cluster);
    case.assert_equal(&case.run_in("requeued"));

    // It exceeds its time limit.
    submit("late", &["--", "--time=1"]);
    case.process_of("late", "1/0");
    cluster.end_time(&format!("{}_0", array("late")));
    until("late", "1-frames-1-of-2", &["failed", "stopped", "finished"]);
    until("late", "1-frames-2-of-2", &["failed", "stopped", "finished"]);
    // A shard that ended in time has exceeded its limit for Slurm, too, which then cancels the last run.
    until("late", "2-run", &["failed", "stopped", "finished"]);
    if case.state("late", Some(&cluster), "2-run") != "finished" {
        retry("late", &["--", "--time=10"]);
    }
    case.assert_equal(&case.run_in("late"));

    // Cancelled.
    submit("cancelled", &[]);
    case.process_of("cancelled", "1/0");
    let mut cancel = case.plain("jobs");
    cluster.set_environment(&mut cancel);
    succeed(cancel.args(["cancel", "--runs", "cancelled"]));
    until("cancelled", "1-frames-1-of-2", &["failed", "stopped", "finished"]);
    until("cancelled", "1-frames-2-of-2", &["failed", "stopped", "finished"]);
    until("cancelled", "2-run", &["failed", "stopped", "finished"]);
    retry("cancelled", &[]);
}
