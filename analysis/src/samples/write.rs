//! Samples out of a recording.

use std::collections::HashMap;
use std::io::BufWriter;
use std::num::NonZero;
use std::path::Path;
use std::sync::Mutex;
use std::thread;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::values::Raster;
use depthloom_recording::{FrameReader, Recording};
use depthloom_scores::{ScoredPixels, Settings};
use depthloom_threads::{Budget, Tiles as _, into_unlocked, locked};
use polars::frame::DataFrame;
use polars::prelude::{
    ChunkFull, Column, NamedFrom, ParquetCompression, ParquetWriter, PolarsResult, Series, StringChunked,
};

use super::described::Described;
use super::read::METADATA;
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::input::maps::{not_recorded, sparsely_kept};
use crate::tables::plan_key;
use crate::tables::{file_metadata, with_arrow_schema};

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SamplesWritten {
    /// The rows.
    pub samples: u64,
    /// The frames they are of.
    pub frames: u64,
    /// The columns of estimates.
    pub estimates: usize,
    /// What is to be said of them.
    pub notes: Vec<String>,
}

/// Pixels of a stage run that are scored in one way.
struct Group<'a> {
    scoring: String,
    settings: &'a Settings,
    /// The place of the truth among the topics.
    truth: usize,
    /// Estimates, and the places of their maps.
    estimates: Vec<(usize, usize)>,
}

/// What is read of a stage run.
struct OfRun<'a> {
    run: RunId,
    topics: Vec<String>,
    groups: Vec<Group<'a>>,
    /// Weights, and the places of their maps.
    weights: Vec<(usize, usize)>,
}

impl<'a> OfRun<'a> {
    fn new(run: RunId, described: &Described, estimates: &'a [Estimate], weights: &[(String, usize)]) -> Self {
        let mut of_run = Self { run, topics: Vec::new(), groups: Vec::new(), weights: Vec::new() };
        for (index, estimate) in estimates.iter().enumerate().filter(|(_, estimate)| estimate.run == run) {
            let maps = (&estimate.truth_topic, &estimate.estimate_topic, &estimate.settings);
            let (Some(truth), Some(estimate), Some(settings)) = maps else { continue };
            let (truth, estimate) = (of_run.place(truth), of_run.place(estimate));
            let scoring = &described.estimates[index].scoring;
            match of_run.groups.iter_mut().find(|group| group.truth == truth && group.scoring == *scoring) {
                Some(group) => group.estimates.push((index, estimate)),
                None => of_run.groups.push(Group {
                    scoring: scoring.clone(),
                    settings,
                    truth,
                    estimates: vec![(index, estimate)],
                }),
            }
        }
        if !of_run.groups.is_empty() {
            for (topic, weight) in weights {
                let place = of_run.place(topic);
                of_run.weights.push((*weight, place));
            }
        }
        of_run
    }

    fn place(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }
}

/// Writes the samples of all recorded maps to a file, which is whole or not there. `progress` is called with frames
/// done and all there are; `stop` is asked between frames.
///
/// A few frames are held in memory at a time, whatever their number. Equal recordings give equal files.
///
/// # Errors
/// If the recording cannot be read, or nothing in it was scored with its maps kept ([`AnalysisError::Request`], with
/// what `record:` would have to name); if the file cannot be written; [`AnalysisError::Stopped`] once `stop` says so.
pub fn write_samples(
    recording: &Recording,
    file: &Path,
    progress: &dyn Fn(usize, usize),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<SamplesWritten, AnalysisError> {
    caught(|| {
        let all = estimates(recording.plan())?;
        let nothing_scored = all.is_empty();
        // Disparities have no metres.
        let estimates: Vec<Estimate> = all.into_iter().filter(|estimate| estimate.settings.is_some()).collect();
        let (described, topics) = Described::of(recording, &estimates);
        let of_run = |run: RunId| {
            let name = recording.plan().runs[run].name();
            let weights = described.weights.iter().enumerate().filter(|(_, weight)| weight.stage == name);
            let weights: Vec<(String, usize)> = weights.map(|(at, _)| (topics[at].clone(), at)).collect();
            OfRun::new(run, &described, &estimates, &weights)
        };
        let runs: Vec<OfRun<'_>> =
            RunId::all(recording.plan().runs.len()).map(of_run).filter(|run| !run.groups.is_empty()).collect();
        let of_depths: Vec<&Estimate> = estimates.iter().collect();
        let missing = not_recorded(recording.plan(), &of_depths, "no samples");
        if runs.is_empty() {
            let (what, help) = match (nothing_scored, missing) {
                (true, _) => ("no samples: no stage has a `score:`".to_owned(), "give a stage one, and run again"),
                (_, Some(missing)) => (missing, "run again; what is not to be recorded again is taken from this run"),
                (_, None) => (
                    "no samples: no depth was scored".to_owned(),
                    "score a depth (`depth/from-disparity` makes one of a disparity), and run again",
                ),
            };
            return Err(AnalysisError::asked(what, help.to_owned()));
        }
        let mut written = SamplesWritten { samples: 0, frames: 0, estimates: estimates.len(), notes: Vec::new() };
        let mut failed = None;
        let result = depthloom_durable::write_with(file, |out| {
            let all = Frames { recording, described: &described };
            match all.write(&runs, BufWriter::with_capacity(1 << 20, out), &mut written, progress, stop) {
                Ok(()) => Ok(()),
                Err(AnalysisError::Write { source, .. }) => Err(source),
                Err(error) => {
                    failed = Some(error);
                    Err(std::io::Error::other("the samples could not be taken"))
                }
            }
        });
        if let Some(error) = failed {
            return Err(error);
        }
        result.map_err(AnalysisError::write(file))?;
        written.notes.extend(missing);
        written.notes.extend(sparsely_kept(recording, &of_depths, written.samples == 0));
        Ok(written)
    })
}

/// The rows of a frame, a table for each way it is scored.
type OfFrame = Result<Vec<DataFrame>, AnalysisError>;

/// A recording's frames, to become rows.
struct Frames<'a> {
    recording: &'a Recording,
    described: &'a Described,
}

impl Frames<'_> {
    fn write(
        &self,
        runs: &[OfRun<'_>],
        out: impl std::io::Write,
        written: &mut SamplesWritten,
        progress: &dyn Fn(usize, usize),
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), AnalysisError> {
        let computed = || AnalysisError::compute("samples");
        let run = plan_key(self.recording.plan());
        let mut metadata = file_metadata("samples", &run, self.described.units());
        metadata.push((METADATA.to_owned(), serde_json::to_string(self.described).expect("names are JSON")));
        let empty = self.rows(&runs[0], &runs[0].groups[0], FrameIndex(0), &vec![None; runs[0].topics.len()], true)?;
        let empty = empty.expect("a table without rows where they are asked for");
        let writer = ParquetWriter::new(out)
            .with_compression(ParquetCompression::Zstd(None))
            .with_key_value_metadata(Some(with_arrow_schema(metadata, empty.schema())));
        let mut writer = writer.batched(empty.schema()).map_err(computed())?;
        let all = runs.iter().map(|run| self.recording.frames(run.run).len()).sum();
        let (mut done, threads) = (0, thread::available_parallelism().map_or(1, NonZero::get));
        let budget = Budget::new(threads);
        let _own = budget.permit();
        for of_run in runs {
            let idle: Mutex<Vec<FrameReader<'_>>> = Mutex::new(Vec::new());
            let positions: Vec<FrameIndex> = FrameIndex::all(self.recording.frames(of_run.run).len()).collect();
            // So many at a time that no thread waits long for the writing.
            for positions in positions.chunks(2 * threads) {
                let tables: Vec<Mutex<Option<OfFrame>>> = positions.iter().map(|_| Mutex::new(None)).collect();
                budget.run(positions.len(), &|tile| {
                    let table = caught(|| {
                        if stop() {
                            return Err(AnalysisError::Stopped);
                        }
                        let reader = locked(&idle).pop();
                        let mut reader = match reader {
                            Some(reader) => reader,
                            None => self.recording.reader(of_run.run, &of_run.topics)?,
                        };
                        let maps = reader.read(positions[tile])?;
                        locked(&idle).push(reader);
                        let rows = |group| self.rows(of_run, group, positions[tile], &maps, false).transpose();
                        of_run.groups.iter().filter_map(rows).collect()
                    });
                    *locked(&tables[tile]) = Some(table);
                });
                for table in tables {
                    let table = into_unlocked(table);
                    let groups = table.expect("every tile was run")?;
                    written.frames += u64::from(!groups.is_empty());
                    for rows in groups {
                        written.samples += rows.height() as u64;
                        writer.write_batch(&rows).map_err(computed())?;
                    }
                    done += 1;
                    progress(done, all);
                }
            }
        }
        writer.finish().map_err(computed())?;
        Ok(())
    }

    /// The rows of a frame that is scored in one way; `None` if it has none, unless a table `even_if_empty` is asked
    /// for.
    fn rows(
        &self,
        of_run: &OfRun<'_>,
        group: &Group<'_>,
        position: FrameIndex,
        maps: &[Option<Value>],
        even_if_empty: bool,
    ) -> Result<Option<DataFrame>, AnalysisError> {
        let depth = |place: usize| maps[place].as_ref().and_then(Value::metres);
        let truth = depth(group.truth);
        let (width, height) = truth.map_or((0, 0), Raster::dimensions);
        let (width, height) = (width as usize, height as usize);
        let pixels =
            truth.map_or_else(ScoredPixels::default, |truth| ScoredPixels::new(truth, width, height, group.settings));
        if pixels.is_empty() && !even_if_empty {
            return Ok(None);
        }
        let is_other = |map: &Raster<f32>| truth.is_some_and(|truth| truth.dimensions() != map.dimensions());
        let mut columns: HashMap<usize, Vec<f32>> = HashMap::new();
        for &(index, place) in &group.estimates {
            let (Some(map), Some(estimate)) = (depth(place), maps[place].as_ref().and_then(Value::depth_estimate))
            else {
                continue;
            };
            if is_other(map) {
                continue;
            }
            columns.insert(index, pixels.scored_estimate(estimate, group.settings));
        }
        let mut weights: HashMap<usize, Vec<f32>> = HashMap::new();
        for &(weight, place) in &of_run.weights {
            match &maps[place] {
                // A weight of another raster says nothing of these pixels.
                Some(Value::Weight(of)) if !is_other(&of.share) => {
                    let share = |at: &u32| of.share.as_raw()[*at as usize];
                    weights.insert(weight, pixels.positions().iter().map(share).collect());
                }
                _ => {}
            }
        }
        let frame = self.recording.frames(of_run.run).get(position.0);
        let rows = pixels.len();
        let text = |name: &str, text: &str| Column::from(Series::from(StringChunked::full(name.into(), text, rows)));
        let place = |name: &str, of: &dyn Fn(usize) -> usize| {
            let places = pixels.positions().iter().map(|at| of(*at as usize) as u32);
            Column::from(Series::new(name.into(), places.collect::<Vec<u32>>()))
        };
        let metres = |name: &str, values: Option<Vec<f32>>| {
            let values = values.unwrap_or_else(|| vec![f32::NAN; rows]);
            let answer = |value: &f32| value.is_finite().then_some(*value);
            Column::from(Series::new(name.into(), values.iter().map(answer).collect::<Vec<Option<f32>>>()))
        };
        let mut table = vec![
            text("stage", self.recording.plan().runs[of_run.run].name()),
            text("scoring", &group.scoring),
            Column::from(Series::new("position".into(), vec![position.0 as u32; rows])),
            text("frame", frame.map_or("", |frame| &frame.id)),
            place("x", &|at| at % width),
            place("y", &|at| at / width),
            Column::from(Series::new("truth_m".into(), pixels.truth_m())),
        ];
        for (at, estimate) in self.described.estimates.iter().enumerate() {
            table.push(metres(&estimate.column, columns.remove(&at)));
        }
        for (at, weight) in self.described.weights.iter().enumerate() {
            table.push(metres(&weight.column, weights.remove(&at)));
        }
        let table: PolarsResult<DataFrame> = DataFrame::new(rows, table);
        table.map(Some).map_err(AnalysisError::compute("samples"))
    }
}
