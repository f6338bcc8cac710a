//! Runs a sequence step by step: with reuse into `runs/`, with `--fresh` into `fresh/`, and compares the two.

use std::fs::{self, File};
use std::ops::AddAssign;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value as Json;

use crate::comparison::{self, Equality};
use crate::files::{self, Files};
use crate::sequence::{RunEnd, Sequence, State, Step};

/// A run that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(120);
/// The name of this test program for nodes, and the folder where it is found.
pub(crate) const PROGRAM: &str = "random-program";
const PROGRAMS: &str = "bin";
/// The experiment file.
const EXPERIMENT: &str = "experiment.yaml";
/// The exit code of what is refused before the first frame.
const REFUSED: i32 = 2;
/// The exit code of a run with failed frames.
const FRAMES_FAILED: i32 = 3;

/// What the runs of sequences did, to see that they test something.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Statistics {
    pub sequences: u64,
    /// Comparisons of two completed runs.
    pub compared: u64,
    /// Comparisons of two runs that failed with the same exit code.
    pub failed: u64,
    /// Partial runs that were resumed, and those that were refused after an edit.
    pub resumed: u64,
    pub refused: u64,
    /// Values that were reused.
    pub reused: u64,
}

impl AddAssign for Statistics {
    fn add_assign(&mut self, other: Self) {
        self.sequences += other.sequences;
        self.compared += other.compared;
        self.failed += other.failed;
        self.resumed += other.resumed;
        self.refused += other.refused;
        self.reused += other.reused;
    }
}

/// A difference between a run and the fresh run of the same state.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    /// The step, by its place.
    pub step: usize,
    pub what: String,
}

/// The programs, and the folder that a sequence is run in.
pub(crate) struct Runner {
    /// The program under test.
    pub binary: PathBuf,
    /// This test program.
    pub program: PathBuf,
    /// Where `python3` has the package `depthloom`.
    pub python: Option<PathBuf>,
    pub folder: PathBuf,
}

/// A run that ended.
struct Ended {
    status: ExitStatus,
    stdout: String,
    stderr: String,
}

impl Ended {
    fn code(&self) -> Option<i32> {
        self.status.code()
    }

    fn described(&self) -> String {
        let lines: Vec<&str> = self.stderr.lines().rev().take(12).collect();
        let end: Vec<&str> = lines.into_iter().rev().collect();
        format!("{}\n      {}", self.status, end.join("\n      "))
    }
}

impl Runner {
    /// Runs all steps.
    pub(crate) fn run(&self, sequence: &Sequence) -> Result<Statistics, Failure> {
        let _ = fs::remove_dir_all(&self.folder);
        fs::create_dir_all(&self.folder).expect("a folder for the sequence can be made");
        // Found by its name in the PATH: the file of a program that is named by its path is part of keys, and this one
        // is large.
        fs::create_dir(self.folder.join(PROGRAMS)).expect("a folder can be made");
        std::os::unix::fs::symlink(&self.program, self.folder.join(PROGRAMS).join(PROGRAM))
            .expect("a link can be made");
        let mut statistics = Statistics { sequences: 1, ..Statistics::default() };
        let mut files = Files::new();
        let mut is_edited = false;
        for (place, step) in sequence.steps.iter().enumerate() {
            files::write(&self.folder, &files, &step.state.files).expect("input files can be written");
            files.clone_from(&step.state.files);
            let yaml = step.state.experiment.yaml(PROGRAM);
            // All steps run the same file; the files beside it help to find the cause.
            for name in [EXPERIMENT, &yaml_name(place)] {
                fs::write(self.folder.join(name), &yaml).expect("an experiment can be written");
            }
            is_edited |= !step.edits.is_empty();
            let failure = |what| Failure { step: place, what };
            match step.ending {
                RunEnd::Complete => {
                    self.complete(step, is_edited, &mut statistics).map_err(failure)?;
                    is_edited = false;
                }
                RunEnd::Cut(share) => self.cut(step, share).map_err(failure)?,
                RunEnd::Killed(share) => self.kill(place, step, share).map_err(failure)?,
            }
        }
        Ok(statistics)
    }

    /// Runs a step to its end, and compares it with a fresh run.
    fn complete(&self, step: &Step, is_edited: bool, statistics: &mut Statistics) -> Result<(), String> {
        let out = format!("runs/{}", step.out);
        let had_partial = self.partial(step).exists();
        let reusing = self.run_to(step, &out, is_edited)?;
        let fresh_out = format!("fresh/{}", step.out);
        let fresh = self.wait(self.start(&step.state, &fresh_out, &["--fresh"], "fresh"), "fresh")?;
        if had_partial {
            let is_refused = reusing.1;
            statistics.refused += u64::from(is_refused);
            statistics.resumed += u64::from(!is_refused);
        }
        let reusing = reusing.0;
        if reusing.code() != fresh.code() || reusing.code().is_none_or(|code| code > 100) {
            return Err(format!(
                "exit codes differ\n    with reuse: {}\n    with --fresh: {}",
                reusing.described(),
                fresh.described()
            ));
        }
        // With --keep-going a run with failed frames is complete, too.
        let is_complete =
            reusing.code() == Some(0) || reusing.code() == Some(FRAMES_FAILED) && self.folder.join(&out).exists();
        if !is_complete {
            statistics.failed += 1;
            return Ok(());
        }
        statistics.compared += 1;
        let report: Json = serde_json::from_str(&reusing.stdout).unwrap_or_default();
        for node in report["reused"]["nodes"].as_array().into_iter().flatten() {
            statistics.reused += node["reused"].as_u64().unwrap_or_default();
        }
        let has_made_up_keys = step.state.experiment.yaml("").contains(files::NEVER_REUSED);
        let equality = if has_made_up_keys { Equality::Values } else { Equality::Bytes };
        comparison::difference(&self.folder.join(out), &self.folder.join(fresh_out), equality).map_or(Ok(()), Err)
    }

    /// Runs a step; if a partial run of another state is refused, again with `--overwrite`. Also returns whether it
    /// was.
    fn run_to(&self, step: &Step, out: &str, is_edited: bool) -> Result<(Ended, bool), String> {
        let had_partial = self.partial(step).exists();
        let ended = self.wait(self.start(&step.state, out, &[], "reuse"), "reuse")?;
        let is_refused = had_partial && ended.code() == Some(REFUSED) && is_edited;
        if !is_refused {
            return Ok((ended, false));
        }
        self.wait(self.start(&step.state, out, &["--overwrite"], "reuse"), "reuse").map(|ended| (ended, true))
    }

    fn partial(&self, step: &Step) -> PathBuf {
        self.folder.join(format!("runs/{}.partial", step.out))
    }

    /// Leaves a partial run as a killed process does: the recording ends at a byte, and there is no report.
    fn cut(&self, step: &Step, share: f64) -> Result<(), String> {
        let out = format!("runs/{}", step.out);
        self.run_to(step, &out, true)?;
        if self.folder.join(&out).exists() {
            self.shorten(step, share);
        }
        Ok(())
    }

    fn shorten(&self, step: &Step, share: f64) {
        let (complete, partial) = (self.folder.join(format!("runs/{}", step.out)), self.partial(step));
        fs::rename(&complete, &partial).expect("a run can be renamed");
        for file in fs::read_dir(&partial).expect("a run is a folder").flatten() {
            let name = file.file_name().to_string_lossy().into_owned();
            let is_report = ["csv", "parquet", "svg", "md", "tex", "html"].iter().any(|ending| name.ends_with(ending));
            if is_report {
                fs::remove_file(file.path()).expect("a report can be removed");
            }
        }
        let _ = fs::remove_dir_all(partial.join("models"));
        let recording = File::options().write(true).open(partial.join("recording.mcap")).expect("a recording");
        let length = recording.metadata().expect("a file has a length").len();
        recording.set_len((length as f64 * share) as u64).expect("a recording can be cut");
    }

    /// Kills a run when its recording has reached a share of the bytes that the fresh run has.
    fn kill(&self, place: usize, step: &Step, share: f64) -> Result<(), String> {
        let fresh_out = format!("fresh/{}-killed-{place}", step.out);
        self.wait(self.start(&step.state, &fresh_out, &["--fresh"], "fresh"), "fresh")?;
        let recording = self.folder.join(fresh_out).join("recording.mcap");
        let bytes = fs::metadata(recording).map_or(0.0, |file| file.len() as f64 * share);
        let out = format!("runs/{}", step.out);
        let more: &[&str] = if self.partial(step).exists() { &["--overwrite"] } else { &[] };
        let mut child = self.start(&step.state, &out, more, "reuse");
        let growing = self.partial(step).join("recording.mcap");
        while child.try_wait().expect("a child can be waited for").is_none() {
            if fs::metadata(&growing).is_ok_and(|file| file.len() as f64 >= bytes) {
                break;
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        child.kill().expect("a child can be killed");
        child.wait().expect("a child ends");
        if self.folder.join(&out).exists() {
            self.shorten(step, share);
        }
        Ok(())
    }

    fn command(&self, state: &State, out: &str, more: &[&str]) -> Command {
        let mut command = Command::new(&self.binary);
        command.current_dir(&self.folder).env_clear();
        command.envs(["LD_LIBRARY_PATH", "TMPDIR"].iter().filter_map(|name| Some((name, std::env::var_os(name)?))));
        let own = std::iter::once(self.folder.join(PROGRAMS));
        let own = own.chain(self.python.iter().filter_map(|python| python.parent()).map(Path::to_owned));
        let others = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::join_paths(own.chain(std::env::split_paths(&others))).expect("folders of a PATH");
        // Times of modules are so coarse that Python takes compiled ones of a file that was replaced within a second.
        command.env("PATH", path).env("PYTHONDONTWRITEBYTECODE", "1");
        command.env("HOME", &self.folder).env("NO_COLOR", "1").env("DEPTHLOOM_ONNX_ENGINE", "tract");
        command.envs(&state.environment);
        command.args(["run", EXPERIMENT, "--out", out, "--json", "--no-page", "--allow-exec"]);
        command.args(["--workers", &state.workers.to_string()]).args(arguments(state)).args(more);
        command
    }

    fn start(&self, state: &State, out: &str, more: &[&str], name: &str) -> Child {
        let file =
            |ending: &str| File::create(self.folder.join(format!("{name}.{ending}"))).expect("a file can be made");
        let mut command = self.command(state, out, more);
        command.stdin(Stdio::null()).stdout(file("stdout")).stderr(file("stderr"));
        command.spawn().expect("the program starts")
    }

    fn wait(&self, mut child: Child, name: &str) -> Result<Ended, String> {
        let began = Instant::now();
        let mut pause = Duration::from_micros(500);
        let status = loop {
            if let Some(status) = child.try_wait().expect("a child can be waited for") {
                break status;
            }
            if began.elapsed() > PATIENCE {
                child.kill().expect("a child can be killed");
                let _ = child.wait();
                return Err(format!("the run ({name}) did not end within {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(Duration::from_millis(4));
        };
        let text = |ending: &str| {
            let bytes = fs::read(self.folder.join(format!("{name}.{ending}"))).unwrap_or_default();
            String::from_utf8_lossy(&bytes).into_owned()
        };
        Ok(Ended { status, stdout: text("stdout"), stderr: text("stderr") })
    }
}

/// The arguments of a state that select and change.
pub(crate) fn arguments(state: &State) -> Vec<String> {
    let selected = state.experiment.variants.iter().find(|variant| Some(variant.id) == state.selected);
    let mut arguments: Vec<String> =
        selected.into_iter().flat_map(|of| ["--variant".to_owned(), of.name.clone()]).collect();
    let set = state.set.as_ref().and_then(|change| state.experiment.change(change, PROGRAM));
    arguments.extend(state.keeps_going.then(|| "--keep-going".to_owned()));
    arguments.extend(set.into_iter().flat_map(|(path, value)| ["--set".to_owned(), format!("{path}={value}")]));
    arguments
}

/// The name of a step's experiment file.
pub(crate) fn yaml_name(place: usize) -> String {
    format!("step-{place}.yaml")
}

/// The command of a step, as a person types it.
pub(crate) fn typed(place: usize, step: &Step) -> String {
    let environment: String = step.state.environment.iter().map(|(name, value)| format!("{name}={value} ")).collect();
    let arguments = arguments(&step.state).join(" ");
    let out = Path::new("runs").join(&step.out);
    let workers = step.state.workers;
    format!(
        "{environment}cp {} {EXPERIMENT} && depthloom run {EXPERIMENT} --out {} --no-page --allow-exec --workers {workers} {arguments}",
        yaml_name(place),
        out.display()
    )
}
