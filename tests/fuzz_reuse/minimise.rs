//! Makes a failing sequence smaller, as long as it still fails.

use std::time::{Duration, Instant};

use crate::running::{Failure, Runner};
use crate::sequence::Sequence;

/// How long a sequence is made smaller.
const AT_MOST: Duration = Duration::from_secs(90);

/// A smaller sequence that fails, and how.
pub(crate) fn minimise(runner: &Runner, mut sequence: Sequence, mut failure: Failure) -> (Sequence, Failure) {
    let began = Instant::now();
    sequence.steps.truncate(failure.step + 1);
    let mut attempt = |sequence: &mut Sequence, smaller: Sequence| {
        if began.elapsed() > AT_MOST {
            return false;
        }
        let Err(found) = runner.run(&smaller) else { return false };
        let last = found.step;
        failure = found;
        *sequence = smaller;
        sequence.steps.truncate(last + 1);
        true
    };
    // Steps, late ones first.
    let mut place = sequence.steps.len().saturating_sub(1);
    while place > 0 {
        place -= 1;
        let mut smaller = sequence.clone();
        let dropped = smaller.steps.remove(place);
        if let Some(next) = smaller.steps.get_mut(place) {
            next.edits = [dropped.edits, std::mem::take(&mut next.edits)].concat();
        }
        attempt(&mut sequence, smaller);
        place = place.min(sequence.steps.len());
    }
    // Parts of the experiment, in all steps at once.
    loop {
        let mut ids: Vec<_> = sequence.steps.iter().flat_map(|step| step.state.experiment.ids()).collect();
        ids.sort_unstable();
        ids.dedup();
        let mut is_smaller = false;
        for id in ids {
            let mut smaller = sequence.clone();
            smaller.steps.iter_mut().for_each(|step| step.state.experiment.remove(id));
            if smaller.steps.iter().all(|step| !step.state.experiment.stages.is_empty()) {
                is_smaller |= attempt(&mut sequence, smaller);
            }
        }
        if !is_smaller {
            break;
        }
    }
    // Settings beside the experiment, and files that changed.
    let mut simplify = |change: &dyn Fn(&mut Sequence)| {
        let mut smaller = sequence.clone();
        change(&mut smaller);
        attempt(&mut sequence, smaller);
    };
    let steps = |sequence: &mut Sequence, change: &dyn Fn(&mut crate::sequence::State)| {
        sequence.steps.iter_mut().for_each(|step| change(&mut step.state));
    };
    simplify(&|sequence| steps(sequence, &|state| state.set = None));
    simplify(&|sequence| steps(sequence, &|state| state.selected = None));
    simplify(&|sequence| steps(sequence, &|state| state.workers = 1));
    simplify(&|sequence| steps(sequence, &|state| state.keeps_going = false));
    simplify(&|sequence| steps(sequence, &|state| state.experiment.axis = None));
    simplify(&|sequence| steps(sequence, &|state| state.environment.clear()));
    simplify(&|sequence| steps(sequence, &|state| state.experiment.labels.clear()));
    simplify(&|sequence| steps(sequence, &|state| state.experiment.record = crate::experiment::Record::default()));
    simplify(&|sequence| {
        let files = sequence.steps[0].state.files.clone();
        steps(sequence, &|state| state.files.clone_from(&files));
    });
    // The folder holds the runs of the last attempt: those of the result are wanted.
    if let Err(found) = runner.run(&sequence) {
        failure = found;
    }
    (sequence, failure)
}
