//! What the cases stand on: small experiments, what the undisturbed program makes of them, and its every shorter
//! answer.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use crate::answer::{Answer, files};
use crate::child;
use crate::records;

/// Two variants, three estimates, no learning.
pub(crate) const STREET: &str = "experiment: street
sources:
  street: { kind: synthetic/road, with: { frames: 0..5, width: 96, height: 48, seed: 1 } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 32 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
      weight: { kind: confidence/sobel, inputs: { image: source/left } }
      mono: { kind: mono/ground-plane, inputs: { image: source/left, calibration: source/calibration } }
      scaled: { kind: fusion/scale, inputs: { mono: mono/depth, stereo: depth/depth } }
      merged: { kind: fusion/confidence, inputs: { mono: scaled/depth, stereo: depth/depth, weight: weight/weight } }
    score:
      ground_truth: source/depth
      preset: martins2018
      estimates:
        stereo: { from: depth/depth, sets: [valid, all] }
        mono: scaled/depth
        fused: merged/depth
variants:
  full: {}
  average: { look.scaled.with.method: average }
";

/// A network learns on one street and is scored on another.
pub(crate) const LEARN: &str = "experiment: learn
sources:
  train: { kind: synthetic/road, with: { frames: 0..3, width: 96, height: 48, seed: 4 } }
  test: { kind: synthetic/road, with: { frames: 0..2, width: 96, height: 48, seed: 5 } }
stages:
  learn:
    source: train
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 32 } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples:
        kind: learn/samples
        inputs: { image: source/left, target: stereo/disparity, mask: edges/mask, calibration: source/calibration }
        with: { size: [32, 32] }
      train:
        kind: learn/ssl
        inputs: { samples: samples/samples }
        with: { steps: 12, batch: 1, curve_every: 2, checkpoint_every: 1 }
  compare:
    source: test
    nodes:
      mono:
        kind: mono/onnx
        inputs: { image: source/left, calibration: source/calibration, model: learn.train/model }
    score: { ground_truth: source/depth, estimates: { mono: mono/depth } }
";

/// Steps of [`LEARN`], each with a checkpoint.
pub(crate) const LEARN_STEPS: usize = 12;

/// The street's stereo on a data set on the disk.
pub(crate) const DATA: &str = "experiment: data
sources: { street: { kind: kitti/stereo2015, with: { root: data, split: training, ground_truth: occ } } }
stages:
  look:
    source: street
    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right }, with: { disparities: 32 } }
      depth: { kind: depth/from-disparity, inputs: { disparity: stereo/disparity, calibration: source/calibration } }
    score: { ground_truth: source/depth, estimates: { stereo: { from: depth/depth, sets: [valid, all] } } }
";

/// What is the same for all cases.
pub(crate) struct Ground {
    pub binary: PathBuf,
    /// Where the cases' folders lie.
    pub root: PathBuf,
    /// After this long a child hangs.
    pub patience: Duration,
    street: OnceLock<Reference>,
    learn: OnceLock<Reference>,
    checkpoints: OnceLock<PathBuf>,
    data: OnceLock<(PathBuf, Answer)>,
    least_memory: OnceLock<u64>,
    for_others: OnceLock<bool>,
}

/// An experiment, and what the undisturbed program makes of it.
pub(crate) struct Reference {
    pub experiment: &'static str,
    /// Of `run`: everything it printed and wrote.
    pub run: Answer,
    /// Of `report`: the same from the recording alone.
    pub report: Answer,
    pub recording: Vec<u8>,
    /// A recording whose writer was stopped within its last frame.
    pub unfinished: Vec<u8>,
    /// How long the run took here.
    pub took: Duration,
    shorter: Vec<Shorter>,
}

/// What a report gives of the recording's first bytes.
pub(crate) struct Shorter {
    pub bytes: usize,
    pub frames: usize,
    /// `None`: it is an error.
    pub answer: Option<Answer>,
}

impl Ground {
    pub(crate) fn new(binary: PathBuf, root: PathBuf, patience: Duration) -> Self {
        let (street, learn, checkpoints, data) = Default::default();
        let (least_memory, for_others) = Default::default();
        Self { binary, root, patience, street, learn, checkpoints, data, least_memory, for_others }
    }

    /// The program in a folder.
    pub(crate) fn command(&self, folder: &Path) -> Command {
        let mut command = Command::new(&self.binary);
        self.surroundings(&mut command, folder);
        command
    }

    /// The folder and the environment every child has.
    pub(crate) fn surroundings(&self, command: &mut Command, folder: &Path) {
        for name in ["ORT_DYLIB_PATH", "KITTI_STEREO_2015", "MONO_MODEL", "VIRTUAL_ENV", "CONDA_PREFIX"] {
            command.env_remove(name);
        }
        command.current_dir(folder).env("NO_COLOR", "1").env("RUST_BACKTRACE", "0");
        command.env("DEPTHLOOM_ONNX_ENGINE", "tract");
    }

    pub(crate) fn street(&self) -> &Reference {
        self.street.get_or_init(|| self.reference(STREET, "street"))
    }

    pub(crate) fn learn(&self) -> &Reference {
        self.learn.get_or_init(|| self.reference(LEARN, "learn"))
    }

    /// The folder of checkpoints that a training killed half-way left.
    pub(crate) fn checkpoints(&self) -> &Path {
        self.checkpoints.get_or_init(|| {
            // Where the kill comes too late, the checkpoint is gone already.
            (0..20).find_map(|attempt| self.half_learned(attempt)).expect("a training can be killed half-way")
        })
    }

    fn half_learned(&self, attempt: u32) -> Option<PathBuf> {
        let folder = self.fresh(&format!("half-learned-{attempt}"));
        fs::write(folder.join("experiment.yaml"), LEARN).expect("written");
        let mut command = self.command(&folder);
        command.args(["run", "experiment.yaml", "--quiet", "--workers", "2", "--out", "run"]);
        let mut running = child::start(&mut command, None, None, self.patience);
        let checkpoints = folder.join("checkpoints");
        let mut seen = Changes::default();
        // Half of the steps: far enough that what was learned matters.
        running.until(|_| seen.look(&checkpoints) >= LEARN_STEPS / 2);
        running.signal("KILL");
        running.end();
        files(&checkpoints).keys().any(|name| name.ends_with(".checkpoint")).then_some(checkpoints)
    }

    /// A small data set on the disk, and the answer of [`DATA`] on it.
    pub(crate) fn data(&self) -> &(PathBuf, Answer) {
        self.data.get_or_init(|| {
            let folder = self.fresh("data-set");
            let synth = ["synth", "data", "--width", "96", "--height", "48", "--frames", "2", "--quiet"];
            self.succeed(&folder, &synth);
            fs::write(folder.join("experiment.yaml"), DATA).expect("written");
            let (_, answer) = self.succeed(&folder, &RUN);
            (folder.join("data"), answer)
        })
    }

    /// The address space in which the program can say its version: its own code and the libraries', bytes.
    pub(crate) fn least_memory(&self) -> u64 {
        *self.least_memory.get_or_init(|| {
            let fits = |limit: u64| self.version_under(&["prlimit".to_owned(), format!("--as={limit}")]);
            let (mut too_little, mut enough) = (0, 1 << 32);
            while enough - too_little > 1 << 18 {
                let middle = u64::midpoint(too_little, enough);
                if fits(middle) { enough = middle } else { too_little = middle }
            }
            enough
        })
    }

    /// Whether a user who owns nothing can start the program.
    pub(crate) fn can_be_started_by_others(&self) -> bool {
        *self.for_others.get_or_init(|| {
            self.version_under(&["setpriv", "--clear-groups", "--reuid=61000", "--regid=61000"].map(str::to_owned))
        })
    }

    fn version_under(&self, by: &[String]) -> bool {
        let mut command = Command::new(&by[0]);
        self.surroundings(&mut command, &self.root);
        command.args(&by[1..]).arg(&self.binary).arg("--version");
        child::start(&mut command, None, None, self.patience).end().succeeded()
    }

    fn reference(&self, experiment: &'static str, name: &str) -> Reference {
        let folder = self.fresh(name);
        fs::write(folder.join("experiment.yaml"), experiment).expect("written");
        let (took, run) = self.succeed(&folder, &RUN);
        let again = self.fresh(&format!("{name}-again"));
        fs::write(again.join("experiment.yaml"), experiment).expect("written");
        let (_, second) = self.succeed(&again, &RUN);
        if let Some(difference) = run.difference(&second) {
            panic!("two undisturbed runs are not equal: {difference}");
        }
        let recording = run.files["recording.mcap"].clone();
        let report = self.report(&folder, &recording).expect("a whole recording can be reported");
        let commits = records::commits(&recording);
        let &[.., before, last] = &commits[..] else { panic!("the recording has too few frames") };
        let unfinished = recording[..usize::midpoint(before, last)].to_vec();
        let mut shorter = vec![Shorter { bytes: 0, frames: 0, answer: None }];
        for bytes in records::steps(&recording) {
            let frames = commits.iter().filter(|&&end| end <= bytes).count();
            shorter.push(Shorter { bytes, frames, answer: self.report(&folder, &recording[..bytes]) });
        }
        Reference { experiment, run, report, recording, unfinished, took, shorter }
    }

    fn report(&self, folder: &Path, recording: &[u8]) -> Option<Answer> {
        let folder = folder.join("reported");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(folder.join("recording.mcap"), recording).expect("written");
        let mut command = self.command(&folder);
        command.args(REPORT);
        let ended = child::start(&mut command, None, None, self.patience).end();
        ended.succeeded().then(|| Answer::new(&ended, &folder.join("out")))
    }

    fn succeed(&self, folder: &Path, arguments: &[&str]) -> (Duration, Answer) {
        let mut command = self.command(folder);
        command.args(arguments);
        let began = Instant::now();
        let ended = child::start(&mut command, None, None, self.patience).end();
        assert!(ended.succeeded(), "the undisturbed program fails: {command:?}: {}\n{}", ended.summary(), ended.stderr);
        (began.elapsed(), Answer::new(&ended, &folder.join("run")))
    }

    fn fresh(&self, name: &str) -> PathBuf {
        let folder = self.root.join("ground").join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder can be made");
        folder
    }
}

/// Counts how often the files of a folder were replaced.
#[derive(Default)]
pub(crate) struct Changes(BTreeSet<u64>);

impl Changes {
    /// Looks again; how many files there were so far.
    pub(crate) fn look(&mut self, folder: &Path) -> usize {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let is_file =
            |entry: &fs::DirEntry| entry.path().extension().is_some_and(|extension| extension == "checkpoint");
        self.0.extend(entries.filter(is_file).filter_map(|entry| Some(entry.metadata().ok()?.ino())));
        self.0.len()
    }
}

/// The arguments of a run.
pub(crate) const RUN: [&str; 6] = ["run", "experiment.yaml", "--workers", "2", "--out", "run"];
/// The arguments of a report.
pub(crate) const REPORT: [&str; 4] = ["report", "recording.mcap", "--out", "out"];

impl Reference {
    /// What a report of the first bytes must give.
    pub(crate) fn up_to(&self, bytes: usize) -> &Shorter {
        let before = self.shorter.iter().rev().find(|shorter| shorter.bytes <= bytes);
        before.expect("the first is of no byte")
    }

    /// Whether an answer is that of a recording that was cut somewhere; how many frames it is of.
    pub(crate) fn of_a_cut(&self, answer: &Answer) -> Option<usize> {
        let equal = |shorter: &&Shorter| {
            shorter.answer.as_ref().is_some_and(|shorter| shorter.difference_in_files(answer).is_none())
        };
        self.shorter.iter().rev().find(equal).map(|shorter| shorter.frames)
    }

    /// Whether every file of an answer is one of the recording that was cut at one place.
    pub(crate) fn has_part_of_a_cut(&self, answer: &Answer) -> bool {
        let whole = || answer.files.iter().filter(|(name, _)| !name.ends_with(".partial"));
        let answers = self.shorter.iter().filter_map(|shorter| shorter.answer.as_ref());
        whole().next().is_none()
            || answers.into_iter().any(|cut| whole().all(|(name, bytes)| cut.files.get(name) == Some(bytes)))
    }

    /// The answer of a recording with this many frames.
    pub(crate) fn of_frames(&self, frames: usize) -> impl Iterator<Item = &Shorter> {
        self.shorter.iter().filter(move |shorter| shorter.frames == frames)
    }
}
