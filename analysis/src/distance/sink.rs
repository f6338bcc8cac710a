//! A sink that collects samples during a run, while their maps are in memory, so that the report need not read them.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use depthloom_graphs::contracts::{Commit, ErrorMessage, NodeWarning, Sink, Slot, Store, StoredValue};
use depthloom_graphs::plan::{FrameIndex, PartId, Plan, RunId};
use depthloom_graphs::{Frame, Key, Value};
use depthloom_recording::RecordedPlan;
use depthloom_threads::{into_unlocked, locked};

use super::maps::{CollectedSamples, Maps};
use super::samples::Samples;
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::files::Output;

/// Forwards all values to another sink, and collects samples of the maps for the error against distance.
///
/// Frames with reused maps that are not decoded are not collected; the report reads them.
pub struct SampleSink<'t, 'a, T> {
    sink: &'t T,
    estimates: Vec<Estimate>,
    /// By stage run.
    runs: Vec<StageSlots>,
    /// By stage run and position: frames with missing parts.
    pending: Mutex<HashMap<(RunId, FrameIndex), Pending>>,
    collected: Mutex<CollectedSamples<'a>>,
    /// Whether something failed. The report then reads everything, and reports the error.
    is_broken: AtomicBool,
}

/// The samples of recorded frames, whose maps a report need not read.
pub struct RecordedSamples<'a>(pub(super) CollectedSamples<'a>);

struct StageSlots {
    maps: Maps,
    /// The place of each slot's topic among the topics of the maps.
    places: BTreeMap<Slot, usize>,
}

/// A frame whose parts are not all encoded yet.
struct Pending {
    /// By topic.
    values: Vec<Option<Value>>,
    parts_left: usize,
    /// Whether a value is stored and not decoded.
    is_partial: bool,
}

impl<'t, 'a, T: Sink> SampleSink<'t, 'a, T> {
    /// Samples that exceed the memory limit are stored in a temporary file in `folder`.
    ///
    /// # Errors
    /// As [`report`](crate::report) of the recording.
    pub fn new(
        sink: &'t T,
        plan: &Plan,
        folder: &'a Path,
        samples_in_memory: usize,
        stop: &'a (dyn Fn() -> bool + Sync),
    ) -> Result<Self, AnalysisError> {
        let plan = RecordedPlan::read_back(plan).map_err(AnalysisError::content)?;
        let estimates = estimates(&plan)?;
        let runs = RunId::all(plan.runs.len()).map(|run| {
            let maps = Maps::new(run, &estimates, |_| true);
            let place = |topic: &str| maps.topics.iter().position(|known| known == topic);
            let places = plan.outputs(run).filter_map(|(slot, output)| Some((slot, place(&output.topic)?))).collect();
            StageSlots { maps, places }
        });
        let runs = runs.collect();
        let samples = Samples::new(estimates.len(), samples_in_memory, Output { folder, stop });
        let collected = Mutex::new(CollectedSamples::empty(samples));
        Ok(Self { sink, estimates, runs, pending: Mutex::default(), collected, is_broken: AtomicBool::new(false) })
    }

    /// The samples; `None` if something failed.
    #[must_use]
    pub fn finish(self) -> Option<RecordedSamples<'a>> {
        let collected = into_unlocked(self.collected);
        (!self.is_broken.into_inner()).then_some(RecordedSamples(collected))
    }

    /// Stores the values of a part. After the last part of a frame, collects its samples.
    fn keep<'v>(&self, run: RunId, position: FrameIndex, values: impl Iterator<Item = (Slot, Option<&'v Value>)>) {
        let StageSlots { maps, places } = &self.runs[run];
        if places.is_empty() || self.is_broken.load(Ordering::Relaxed) {
            return;
        }
        let complete = {
            let mut pending = locked(&self.pending);
            let frame = pending.entry((run, position)).or_insert_with(|| Pending {
                values: vec![None; maps.topics.len()],
                parts_left: self.sink.parts(run),
                is_partial: false,
            });
            for (slot, value) in values.filter(|(slot, _)| self.sink.keeps(run, *slot, position)) {
                if let Some(place) = places.get(&slot) {
                    frame.values[*place] = value.cloned();
                    frame.is_partial |= value.is_none();
                }
            }
            frame.parts_left -= 1;
            (frame.parts_left == 0).then(|| pending.remove(&(run, position))).flatten()
        };
        let Some(Pending { values, is_partial: false, .. }) = complete else { return };
        let result = caught(|| {
            let mut truth = BTreeMap::new();
            let samples = maps.samples(&self.estimates, &values, &mut truth)?;
            let mut collected = locked(&self.collected);
            collected.samples.take(samples)?;
            truth.into_iter().for_each(|(metre, count)| *collected.truth.entry(metre).or_default() += count);
            collected.frames.insert((run, position));
            Ok(())
        });
        if result.is_err() {
            self.is_broken.store(true, Ordering::Relaxed);
        }
    }
}

impl<T: Sink> Sink for SampleSink<'_, '_, T> {
    type Part = T::Part;

    fn parts(&self, run: RunId) -> usize {
        self.sink.parts(run)
    }

    fn part(&self, run: RunId, slot: Slot) -> Option<PartId> {
        self.sink.part(run, slot)
    }

    fn encode(
        &self,
        run: RunId,
        frame: (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<Self::Part, ErrorMessage> {
        let encoded = self.sink.encode(run, frame, part, values)?;
        self.keep(run, frame.0, values.iter().map(|(slot, value)| (*slot, Some(value))));
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
        let encoded = self.sink.encode_stored(run, frame, part, values, stored)?;
        let stored = stored.iter().map(|stored| (stored.slot, stored.value.as_ref()));
        self.keep(run, frame.0, values.iter().map(|(slot, value)| (*slot, Some(value))).chain(stored));
        Ok(encoded)
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<Self::Part>) -> Result<(), ErrorMessage> {
        self.sink.write(commit, parts)
    }

    fn once(
        &self,
        run: RunId,
        slot: Slot,
        key: &Key,
        value: &Value,
        warnings: &[NodeWarning],
    ) -> Result<(), ErrorMessage> {
        self.sink.once(run, slot, key, value, warnings)
    }

    fn keeps(&self, run: RunId, slot: Slot, position: FrameIndex) -> bool {
        self.sink.keeps(run, slot, position)
    }

    fn store(&self) -> Option<&dyn Store> {
        self.sink.store()
    }

    fn written(&self, run: RunId) -> usize {
        self.sink.written(run)
    }

    fn recorded_warnings(&self, run: RunId) -> Vec<Vec<NodeWarning>> {
        self.sink.recorded_warnings(run)
    }

    fn written_aggregate(&self, run: RunId, slot: Slot) -> Option<Key> {
        self.sink.written_aggregate(run, slot)
    }
}
