//! Writes the samples of a recording.

use std::collections::HashMap;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Mutex;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, Plan, RunId};
use depthloom_graphs::values::Raster;
use depthloom_recording::{FrameReader, RecordedPlan, Recording};
use depthloom_scores::{ScoredPixels, Settings};
use depthloom_threads::{Budget, Tiles as _, core_count, into_unlocked, locked};
use polars::frame::DataFrame;
use polars::prelude::{
    ChunkFull, Column, NamedFrom, ParquetCompression, ParquetWriter, PolarsResult, Series, StringChunked,
};

use super::described::Described;
use super::read::METADATA;
use crate::ablation::{FrameSet, Selection, selected_frames};
use crate::error::{AnalysisError, caught};
use crate::estimates::{Estimate, estimates};
use crate::input::frame_choice::FrameChoice;
use crate::input::maps::{not_recorded, not_to_be_recorded, sparsely_kept};
use crate::tables::plan_key;
use crate::tables::{file_metadata, with_arrow_schema};

/// Describes the written samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SamplesWritten {
    /// The number of rows.
    pub samples: u64,
    /// The number of frames.
    pub frames: u64,
    /// The number of estimate columns.
    pub estimates: usize,
    /// Notes on missing samples.
    pub notes: Vec<String>,
}

/// The pixels of a stage run with one scoring.
struct Group<'a> {
    scoring: String,
    settings: &'a Settings,
    /// The index of the ground truth among the topics.
    truth: usize,
    /// Estimates, and the indices of their maps.
    estimates: Vec<(usize, usize)>,
}

/// The maps of a stage run that are read.
struct StageMaps<'a> {
    run: RunId,
    topics: Vec<String>,
    groups: Vec<Group<'a>>,
    /// Confidences, and the indices of their maps.
    weights: Vec<(usize, usize)>,
}

impl<'a> StageMaps<'a> {
    fn new(run: RunId, described: &Described, estimates: &'a [Estimate], weights: &[(String, usize)]) -> Self {
        let mut stage = Self { run, topics: Vec::new(), groups: Vec::new(), weights: Vec::new() };
        for (index, estimate) in estimates.iter().enumerate().filter(|(_, estimate)| estimate.run == run) {
            let maps = (&estimate.truth_topic, &estimate.estimate_topic, &estimate.settings);
            let (Some(truth), Some(estimate), Some(settings)) = maps else { continue };
            let (truth, estimate) = (stage.place(truth), stage.place(estimate));
            let scoring = &described.estimates[index].scoring;
            match stage.groups.iter_mut().find(|group| group.truth == truth && group.scoring == *scoring) {
                Some(group) => group.estimates.push((index, estimate)),
                None => stage.groups.push(Group {
                    scoring: scoring.clone(),
                    settings,
                    truth,
                    estimates: vec![(index, estimate)],
                }),
            }
        }
        if !stage.groups.is_empty() {
            for (topic, weight) in weights {
                let place = stage.place(topic);
                stage.weights.push((*weight, place));
            }
        }
        stage
    }

    fn place(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }
}

const SCORE_A_DEPTH: &str = "score a depth (`depth/from-disparity` converts a disparity), and run again";

/// The estimates of a plan that can have samples.
fn depth_estimates(plan: &RecordedPlan) -> Result<Vec<Estimate>, AnalysisError> {
    let all = estimates(plan)?;
    if all.is_empty() {
        let help = "add a `score:` to a stage, and run again";
        return Err(AnalysisError::request("no samples: no stage has a `score:`".to_owned(), help.to_owned()));
    }
    // Disparities have no distances in metres.
    Ok(all.into_iter().filter(|estimate| estimate.settings.is_some()).collect())
}

/// Checks that a run of this plan will record what [`write_samples`] needs.
///
/// # Errors
/// If no scored depth has its maps recorded ([`AnalysisError::Request`], with the outputs to add to `record:`).
pub fn check_samples(plan: &Plan) -> Result<(), AnalysisError> {
    let plan = RecordedPlan::read_back(plan).map_err(AnalysisError::content)?;
    let estimates = depth_estimates(&plan)?;
    if estimates.iter().any(|estimate| estimate.truth_topic.is_some() && estimate.estimate_topic.is_some()) {
        return Ok(());
    }
    let (what, help) = match not_to_be_recorded(&plan, &estimates.iter().collect::<Vec<_>>(), "no samples") {
        Some(missing) => (missing, "or run without --samples"),
        None => ("no samples: no depth is scored".to_owned(), SCORE_A_DEPTH),
    };
    Err(AnalysisError::request(what, help.to_owned()))
}

/// Writes the samples of the recorded maps of all frames, or of the selected ones, to a file atomically. `progress` is
/// called with the number of finished frames, and their total; `stop` is polled between frames.
///
/// Only a few frames are in memory at a time. Equal recordings give equal files. A file of selected frames
/// [matches](crate::samples_match) no recording, so that no command takes it for the samples of a run.
///
/// # Errors
/// If the recording cannot be read, a selected frame does not exist, or no scored estimate has recorded maps
/// ([`AnalysisError::Request`], with the outputs to add to `record:`); if the file cannot be written;
/// [`AnalysisError::Stopped`] once `stop` returns true.
pub fn write_samples(
    recording: &Recording,
    file: &Path,
    choice: Option<&FrameChoice>,
    progress: &dyn Fn(usize, usize),
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<SamplesWritten, AnalysisError> {
    caught(|| {
        let estimates = depth_estimates(recording.plan())?;
        let selection = Selection { frames: choice.cloned(), ..Selection::default() };
        let selected = selected_frames(recording, &selection)?;
        let (mut described, topics) = Described::new(recording, &estimates);
        if selected.is_some() {
            described.set_incomplete();
        }
        let stage_maps = |run: RunId| {
            let name = recording.plan().runs[run].name();
            let weights = described.weights.iter().enumerate().filter(|(_, weight)| weight.stage == name);
            let weights: Vec<(String, usize)> = weights.map(|(at, _)| (topics[at].clone(), at)).collect();
            StageMaps::new(run, &described, &estimates, &weights)
        };
        let runs: Vec<StageMaps<'_>> =
            RunId::all(recording.plan().runs.len()).map(stage_maps).filter(|run| !run.groups.is_empty()).collect();
        let depths: Vec<&Estimate> = estimates.iter().collect();
        let missing = not_recorded(recording.plan(), &depths, "no samples");
        if runs.is_empty() {
            let (what, help) = match missing {
                Some(missing) => (missing, "then run again, which reuses the unchanged values of this run"),
                None => ("no samples: no depth was scored".to_owned(), SCORE_A_DEPTH),
            };
            return Err(AnalysisError::request(what, help.to_owned()));
        }
        let mut written = SamplesWritten { samples: 0, frames: 0, estimates: estimates.len(), notes: Vec::new() };
        let mut failed = None;
        let result = depthloom_durable::write_with(file, |out| {
            let all = Frames { recording, described: &described, selected: selected.as_ref() };
            match all.write(&runs, BufWriter::with_capacity(1 << 20, out), &mut written, progress, stop) {
                Ok(()) => Ok(()),
                Err(AnalysisError::Write { source, .. }) => Err(source),
                Err(error) => {
                    failed = Some(error);
                    Err(std::io::Error::other("failed to collect samples"))
                }
            }
        });
        if let Some(error) = failed {
            return Err(error);
        }
        result.map_err(AnalysisError::write(file))?;
        written.notes.extend(missing);
        written.notes.extend(sparsely_kept(recording, &depths, written.samples == 0));
        Ok(written)
    })
}

/// The rows of a frame, one table per scoring.
type FrameTables = Result<Vec<DataFrame>, AnalysisError>;

/// The frames of a recording, which are converted to rows.
struct Frames<'a> {
    recording: &'a Recording,
    described: &'a Described,
    /// The frames that are written; `None`: all.
    selected: Option<&'a FrameSet>,
}

impl Frames<'_> {
    fn write(
        &self,
        runs: &[StageMaps<'_>],
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
        let empty = empty.expect("`even_if_empty` gives a table");
        let writer = ParquetWriter::new(out)
            .with_compression(ParquetCompression::Zstd(None))
            .with_key_value_metadata(Some(with_arrow_schema(metadata, empty.schema())));
        let mut writer = writer.batched(empty.schema()).map_err(computed())?;
        let positions = |run: RunId| -> Vec<FrameIndex> {
            let all = FrameIndex::all(self.recording.frames(run).len());
            all.filter(|at| self.selected.is_none_or(|selected| selected.contains(&(run, *at)))).collect()
        };
        let all = runs.iter().map(|run| positions(run.run).len()).sum();
        let (mut done, threads) = (0, core_count());
        let budget = Budget::new(threads);
        let _own = budget.permit();
        for stage in runs {
            let idle: Mutex<Vec<FrameReader<'_>>> = Mutex::new(Vec::new());
            // Enough frames per chunk that threads rarely wait for the writer.
            for positions in positions(stage.run).chunks(2 * threads) {
                let tables: Vec<Mutex<Option<FrameTables>>> = positions.iter().map(|_| Mutex::new(None)).collect();
                budget.run(positions.len(), &|tile| {
                    let table = caught(|| {
                        if stop() {
                            return Err(AnalysisError::Stopped);
                        }
                        let reader = locked(&idle).pop();
                        let mut reader = match reader {
                            Some(reader) => reader,
                            None => self.recording.reader(stage.run, &stage.topics)?,
                        };
                        let maps = reader.read(positions[tile])?;
                        locked(&idle).push(reader);
                        let rows = |group| self.rows(stage, group, positions[tile], &maps, false).transpose();
                        stage.groups.iter().filter_map(rows).collect()
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

    /// The rows of a frame with one scoring. Without rows: `None`, or an empty table if `even_if_empty`.
    fn rows(
        &self,
        stage: &StageMaps<'_>,
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
        for &(weight, place) in &stage.weights {
            match &maps[place] {
                // A confidence of another size does not belong to these pixels.
                Some(Value::Weight(confidence)) if !is_other(&confidence.share) => {
                    let share = |at: &u32| confidence.share.as_raw()[*at as usize];
                    weights.insert(weight, pixels.positions().iter().map(share).collect());
                }
                _ => {}
            }
        }
        let frame = self.recording.frames(stage.run).get(position.0);
        let rows = pixels.len();
        let text = |name: &str, text: &str| Column::from(Series::from(StringChunked::full(name.into(), text, rows)));
        let place = |name: &str, coordinate: &dyn Fn(usize) -> usize| {
            let places = pixels.positions().iter().map(|at| coordinate(*at as usize) as u32);
            Column::from(Series::new(name.into(), places.collect::<Vec<u32>>()))
        };
        let metres = |name: &str, values: Option<Vec<f32>>| {
            let values = values.unwrap_or_else(|| vec![f32::NAN; rows]);
            let valid = |value: &f32| value.is_finite().then_some(*value);
            Column::from(Series::new(name.into(), values.iter().map(valid).collect::<Vec<Option<f32>>>()))
        };
        let mut table = vec![
            text("stage", self.recording.plan().runs[stage.run].name()),
            text("scoring", &group.scoring),
            Column::from(Series::new("position".into(), vec![position.0 as u32; rows])),
            text("frame", frame.map_or("", |frame| &frame.id)),
            place("x", &|at| at % width),
            place("y", &|at| at / width),
            Column::from(Series::new("ground_truth_m".into(), pixels.ground_truth_m())),
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
