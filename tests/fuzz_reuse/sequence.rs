//! A sequence: states of an experiment, its files and its environment, and how each is run. A function of its seed.

use std::collections::BTreeMap;

use crate::edits::edit;
use crate::experiment::{Change, Experiment, Id};
use crate::files::{self, Files};
use crate::generate;
use crate::kinds::{PYTHON, kind};
use depthloom_test_needs::random::Random;

/// Everything that a run depends on.
#[derive(Clone, Debug)]
pub(crate) struct State {
    pub experiment: Experiment,
    pub files: Files,
    /// Variables of the environment.
    pub environment: BTreeMap<&'static str, &'static str>,
    /// The variant of `--variant`.
    pub selected: Option<Id>,
    /// The change of `--set`.
    pub set: Option<Change>,
    /// `--workers`.
    pub workers: usize,
    /// `--keep-going`.
    pub keeps_going: bool,
}

/// How a run ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RunEnd {
    /// It completes, and is compared with a fresh run.
    Complete,
    /// It is left as a killed run leaves it whose recording has this share of its bytes. The next step resumes it.
    Cut(f64),
    /// It is killed when its recording has this share of its bytes. The next step resumes it.
    Killed(f64),
}

/// A state and how it is run.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// What changed since the step before.
    pub edits: Vec<String>,
    pub state: State,
    pub ending: RunEnd,
    /// The folder to write, `r0`; steps that a killed run takes have the same.
    pub out: String,
}

/// The steps of a seed.
#[derive(Clone, Debug)]
pub(crate) struct Sequence {
    pub seed: u64,
    pub steps: Vec<Step>,
}

/// A completed run of the sequence, which later steps may read as a source.
pub(crate) struct EarlierRun {
    pub folder: String,
    pub experiment: Experiment,
}

impl Sequence {
    /// The sequence of a seed. Where there is a Python, one in fifty has a node in Python.
    pub(crate) fn new(seed: u64, has_python: bool) -> Self {
        let random = &mut Random::new(seed, "reuse");
        let has_python = has_python && seed.is_multiple_of(50);
        let mut state = State {
            experiment: generate::experiment(random, &[]),
            files: files::first(random, has_python),
            environment: BTreeMap::new(),
            selected: None,
            set: None,
            workers: random.pick(&[1, 2]),
            keeps_going: random.chance(2),
        };
        while state.experiment.stages.is_empty() {
            state.experiment = generate::experiment(random, &[]);
        }
        if has_python {
            generate::add_node_of(random, &mut state.experiment, 0, kind(PYTHON));
        }
        let mut steps: Vec<Step> = Vec::new();
        let mut earlier: Vec<EarlierRun> = Vec::new();
        let runs = 2 + random.below(3);
        for run in 0..runs {
            let out = format!("r{run}");
            let mut edits = Vec::new();
            if run > 0 {
                // Now and then nothing changes, or everything is as it was before the last edits.
                match random.below(12) {
                    0 => {}
                    1 => {
                        let place = random.below(steps.len());
                        state = steps[place].state.clone();
                        edits.push(format!("back to the state of step {place}"));
                    }
                    _ => edits = make_edits(&mut state, random, &earlier),
                }
            }
            for _ in 0..random.pick(&[0, 0, 0, 0, 1, 1, 2]) {
                let share = random.below(1000) as f64 / 1000.0;
                let ending = if random.chance(4) { RunEnd::Killed(share) } else { RunEnd::Cut(share) };
                steps.push(Step { edits: std::mem::take(&mut edits), state: state.clone(), ending, out: out.clone() });
                if random.chance(2) {
                    edits = make_edits(&mut state, random, &earlier);
                }
            }
            steps.push(Step { edits, state: state.clone(), ending: RunEnd::Complete, out: out.clone() });
            earlier.push(EarlierRun { folder: format!("runs/{out}"), experiment: state.experiment.clone() });
        }
        Self { seed, steps }
    }
}

fn make_edits(state: &mut State, random: &mut Random, earlier: &[EarlierRun]) -> Vec<String> {
    (0..random.pick(&[1, 1, 1, 2, 2, 3])).map(|_| edit(state, random, earlier)).collect()
}
