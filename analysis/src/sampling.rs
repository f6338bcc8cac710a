//! Samples taken while their maps are at hand: what a run records, its report need not read back.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Slot, Store, StoredValue, Tap};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key, Value};
use depthloom_recording::RecordedPlan;
use depthloom_threads::{into_unlocked, locked};

use crate::distance::Samples;
use crate::error::{AnalysisError, caught};
use crate::estimators::{Estimator, estimators};
use crate::files::Output;
use crate::reading::{Maps, Taken};
use crate::report::ReportOptions;

/// Hands all values on to a tap, and takes the samples of those maps that the error against distance is made of.
///
/// A frame whose maps do not all come as values, since an earlier run has them, is left to be read.
pub struct SamplingTap<'t, 'a, T> {
    tap: &'t T,
    estimators: Vec<Estimator>,
    /// By stage run.
    runs: Vec<SampledRun>,
    /// By stage run and position: frames of which parts are missing.
    pending: Mutex<HashMap<(RunId, FrameIndex), Pending>>,
    taken: Mutex<Taken<'a>>,
    /// Whether something went wrong: then the report reads everything, and says what.
    is_broken: AtomicBool,
}

/// The samples of frames that were recorded; what [`report_with`](crate::report_with) need not read.
pub struct Sampled<'a>(pub(crate) Taken<'a>);

struct SampledRun {
    maps: Maps,
    /// The places of the maps' topics.
    places: BTreeMap<Slot, usize>,
}

/// A frame on its way.
struct Pending {
    /// By topic.
    values: Vec<Option<Value>>,
    parts_left: usize,
    /// Whether a value is in the store alone.
    is_partial: bool,
}

impl<'t, 'a, T: Tap> SamplingTap<'t, 'a, T> {
    /// Takes samples of what a run of this plan hands to a tap. What does not fit in memory lies on the disk of `folder`.
    ///
    /// # Errors
    /// As [`report`](crate::report) of its recording.
    pub fn new(
        tap: &'t T,
        plan: &Plan,
        folder: &'a Path,
        options: &ReportOptions,
        stop: &'a (dyn Fn() -> bool + Sync),
    ) -> Result<Self, AnalysisError> {
        let plan = RecordedPlan::read_back(plan).map_err(AnalysisError::content)?;
        let estimators = estimators(&plan)?;
        let runs = RunId::all(plan.runs.len()).map(|run| {
            let maps = Maps::new(run, &estimators);
            let place = |topic: &str| maps.topics.iter().position(|known| known == topic);
            let places = plan.outputs(run).filter_map(|(slot, output)| Some((slot, place(&output.topic)?))).collect();
            SampledRun { maps, places }
        });
        let runs = runs.collect();
        let samples = Samples::new(estimators.len(), options.samples_in_memory, Output { folder, stop });
        let taken = Mutex::new(Taken::none_yet(samples));
        let (pending, is_broken) = (Mutex::default(), AtomicBool::new(false));
        Ok(Self { tap, estimators, runs, pending, taken, is_broken })
    }

    /// The samples; `None` if something went wrong.
    #[must_use]
    pub fn finish(self) -> Option<Sampled<'a>> {
        let taken = into_unlocked(self.taken);
        (!self.is_broken.into_inner()).then_some(Sampled(taken))
    }

    /// Takes note of a part's values; with the last part, of the frame's samples.
    fn note<'v>(&self, run: RunId, position: FrameIndex, values: impl Iterator<Item = (Slot, Option<&'v Value>)>) {
        let of_run = &self.runs[run];
        if of_run.places.is_empty() || self.is_broken.load(Ordering::Relaxed) {
            return;
        }
        let complete = {
            let mut pending = locked(&self.pending);
            let frame = pending.entry((run, position)).or_insert_with(|| Pending {
                values: vec![None; of_run.maps.topics.len()],
                parts_left: self.tap.parts(run),
                is_partial: false,
            });
            for (slot, value) in values.filter(|(slot, _)| self.tap.keeps(run, *slot, position)) {
                if let Some(place) = of_run.places.get(&slot) {
                    frame.values[*place] = value.cloned();
                    frame.is_partial |= value.is_none();
                }
            }
            frame.parts_left -= 1;
            (frame.parts_left == 0).then(|| pending.remove(&(run, position))).flatten()
        };
        let Some(Pending { values, is_partial: false, .. }) = complete else { return };
        let took = caught(|| {
            let mut truth = BTreeMap::new();
            let samples = of_run.maps.samples(&self.estimators, &values, &mut truth)?;
            let mut taken = locked(&self.taken);
            taken.samples.take(samples)?;
            truth.into_iter().for_each(|(metre, count)| *taken.truth.entry(metre).or_default() += count);
            taken.frames.insert((run, position));
            Ok(())
        });
        if took.is_err() {
            self.is_broken.store(true, Ordering::Relaxed);
        }
    }
}

impl<T: Tap> Tap for SamplingTap<'_, '_, T> {
    type Part = T::Part;

    fn parts(&self, run: RunId) -> usize {
        self.tap.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        self.tap.part(run, slot)
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage> {
        let encoded = self.tap.encode(run, frame, part, values)?;
        self.note(run, frame.0, values.iter().map(|(slot, value)| (*slot, Some(value))));
        Ok(encoded)
    }

    fn encode_stored(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
        stored: &[StoredValue<'_>],
    ) -> Result<Self::Part, ErrorMessage> {
        let encoded = self.tap.encode_stored(run, frame, part, values, stored)?;
        let stored = stored.iter().map(|stored| (stored.slot, stored.value.as_ref()));
        self.note(run, frame.0, values.iter().map(|(slot, value)| (*slot, Some(value))).chain(stored));
        Ok(encoded)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        self.tap.write(commit, parts)
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        self.tap.once(run, slot, key, value, warnings)
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        self.tap.keeps(run, slot, position)
    }

    fn store(&self) -> Option<&dyn Store> {
        self.tap.store()
    }

    fn written(&self, run: RunId) -> usize {
        self.tap.written(run)
    }

    fn recorded_warnings(&self, run: RunId) -> Vec<Vec<NodeWarning>> {
        self.tap.recorded_warnings(run)
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        self.tap.written_aggregate(run, slot)
    }
}
