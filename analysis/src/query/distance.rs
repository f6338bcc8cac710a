//! Absolute error against true distance, as a report writes it: the query of `analyse` by distance, out of the recorded maps.
//!
//! Per estimator, the samples are the scored pixels of all frames for which it is valid: the ground truth `t`, and `e = |y - t|` of the
//! estimate as it is scored (aligned, clamped). Per metre `floor(t)` of true distance: how many there are, and the percentiles 5, 25, 50, 75 and
//! 95 of `e`.
//!
//! An estimator that is valid on easy pixels only would win against one that is valid on all. So the same is computed once more over the **shared**
//! pixels: those for which every estimator with the same ground truth and settings is valid, on frames that all of them have.
//!
//! Errors are computed once, in any order of frames, and kept in a temporary file: percentiles take several passes over them, and to read and decode
//! the maps again for each would cost more. `samples.parquet` holds estimates as `f32`, which for an aligned estimate is one rounding more.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use depthloom_graphs::Value;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_scores::{PixelSet, ScoredPixels};
use depthloom_threads::{into_unlocked, locked};

use super::percentiles::{Memory, OUTSIDE, Percentiles, Tally, percentiles};
use super::scan::{scan, threads};
use crate::error::AnalysisError;
use crate::estimators::{Compared, Estimator, estimator_columns};
use crate::files::Output;
use crate::tables::{COMMON, Cells, Column, RowKey, RowKeys, Rows as TableRows, Table, key_columns};

/// The percentiles that are computed.
pub const PERCENTILES: [u32; 5] = [5, 25, 50, 75, 95];
/// True distances from here on are left out, metres: counting takes room for every metre up to the farthest.
pub(crate) const FARTHEST_M: u32 = 4096;

/// Counters of a thread, of 4 bytes, where samples do not fit into memory.
const COUNTERS: usize = 1 << 22;

/// Absolute errors of an estimator in one metre of true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistanceBin {
    /// Index of the estimator.
    pub estimator: usize,
    /// The bin holds true distances from this many metres up to, not including, one metre more.
    pub bin_m: u32,
    /// Over all pixels for which the estimator is valid.
    pub answered: Spread,
    /// Over those of them for which all that it is compared with are valid too; `None` if there is none.
    pub shared: Option<Spread>,
}

/// The distribution of absolute errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// The number of pixels, at least one.
    pub count: u64,
    /// The [`PERCENTILES`] of the absolute error, metres.
    pub percentiles_m: [f64; 5],
}

/// Error against distance, and how many true distances are in each metre.
pub(crate) struct Distances {
    /// Estimator by estimator, nearest bin first.
    pub(crate) bins: Vec<DistanceBin>,
    /// By estimator: how many pixels were left out, since they are beyond [`FARTHEST_M`].
    pub(crate) beyond: Vec<u64>,
    /// Scored pixels with ground truth by stage run and metre, over the frames whose values were recorded; each ground truth counted once.
    pub(crate) truth: BTreeMap<(RunId, u32), u64>,
}

/// Computes the error against distance of all recorded maps, on all cores. Each core holds the maps of one frame, and all together at most
/// so many samples; the errors are in a temporary file in the folder of the output.
pub(crate) fn distances(
    recording: &Recording,
    estimators: &[Estimator],
    most_in_memory: usize,
    output: Output<'_>,
) -> Result<Distances, AnalysisError> {
    let runs: Vec<RunMaps<'_>> =
        RunId::all(recording.plan().runs.len()).map(|run| RunMaps::new(run, estimators)).collect();
    let frames: Vec<(&RunMaps<'_>, FrameIndex)> = runs
        .iter()
        .filter(|maps| !maps.groups.is_empty())
        .flat_map(|maps| FrameIndex::all(recording.frames(maps.run).len()).map(move |position| (maps, position)))
        .collect();
    let farthest_m = estimators.iter().filter_map(|estimator| estimator.settings.as_ref());
    let farthest_m = farthest_m.fold(0.0_f64, |farthest, settings| farthest.max(settings.max_m));
    let metres = (farthest_m.ceil() as usize).min(FARTHEST_M as usize);
    let errors = ErrorFile::new(output.folder)?;
    let (parts, truth) = (Mutex::new(Vec::new()), Mutex::new(BTreeMap::new()));
    let mut beyond = vec![0; estimators.len()];
    let reader_of_run = || None;
    scan(frames.len(), output.stop, reader_of_run, |reader, frame| {
        let (maps, position) = frames[frame];
        let of_run = match reader.take() {
            Some((run, reader)) if run == maps.run => reader,
            _ => recording.reader(maps.run, &maps.topics)?,
        };
        let (_, of_run) = reader.insert((maps.run, of_run));
        let (rows, counts) = maps.rows(&of_run.read(position)?, metres);
        for rows in rows {
            let part = errors.append(&rows)?;
            locked(&parts).push(part);
        }
        let mut truth = locked(&truth);
        let counts = (0..).zip(counts).filter(|(_, count)| *count > 0);
        counts.for_each(|(metre, count)| *truth.entry((maps.run, metre)).or_default() += count);
        Ok(())
    })?;
    let parts = into_unlocked(parts);
    for (estimator, count) in parts.iter().flat_map(|part: &Part| part.estimators.iter().zip(&part.beyond)) {
        beyond[*estimator] += count;
    }
    // Each core takes an estimator, so that memory does not depend on how many there are.
    let memory = Memory::shared(most_in_memory, COUNTERS * threads(), threads());
    let found = scan(estimators.len(), output.stop, Vec::new, |found, estimator| {
        let column = |part: &Part| Some(2 + part.estimators.iter().position(|of_part| *of_part == estimator)?);
        let parts: Vec<(&Part, usize)> = parts.iter().filter_map(|part| Some((part, column(part)?))).collect();
        // Groups are in pairs: of a metre's valid pixels, then of its shared ones.
        let groups = percentiles(2 * metres, &PERCENTILES.map(f64::from), memory, |pass| {
            let mut tally = Tally::new(pass);
            for (part, column) in &parts {
                output.go_on()?;
                let errors_m: Vec<f32> = errors.read(part, *column)?;
                tally.add(pass, |metre| 2 * metre, &errors.read(part, 0)?, &errors_m);
                tally.add(pass, |metre| 2 * metre + 1, &errors.read(part, 1)?, &errors_m);
            }
            Ok(vec![tally])
        })?;
        let bin = |(bin_m, [answered, shared]): (u32, &[Percentiles; 2])| {
            Some(DistanceBin { estimator, bin_m, answered: spread(answered)?, shared: spread(shared) })
        };
        found.extend((0..).zip(groups.as_chunks().0).filter_map(bin));
        Ok(())
    })?;
    let mut bins = found.concat();
    bins.sort_by_key(|bin: &DistanceBin| (bin.estimator, bin.bin_m));
    Ok(Distances { bins, beyond, truth: into_unlocked(truth) })
}

fn spread(Percentiles { count, values }: &Percentiles) -> Option<Spread> {
    Some(Spread { count: *count, percentiles_m: values.as_slice().try_into().ok()? })
}

/// The maps of a stage run that are compared.
struct RunMaps<'a> {
    run: RunId,
    topics: Vec<String>,
    groups: Vec<Group<'a>>,
}

/// Estimates that are scored against one ground truth in one way.
struct Group<'a> {
    compared: Compared<'a>,
    /// The place of the ground truth among the topics.
    truth: usize,
    /// Estimators, and the places of their maps.
    estimates: Vec<(usize, usize)>,
}

impl<'a> RunMaps<'a> {
    fn new(run: RunId, estimators: &'a [Estimator]) -> Self {
        let mut maps = Self { run, topics: Vec::new(), groups: Vec::new() };
        for (index, estimator) in estimators.iter().enumerate().filter(|(_, estimator)| estimator.run == run) {
            let Some(compared) = estimator.compared() else { continue };
            let (truth, estimate) = (maps.place(compared.truth_topic), maps.place(compared.estimate_topic));
            let is_alike =
                |group: &&mut Group<'_>| group.truth == truth && group.compared.settings == compared.settings;
            match maps.groups.iter_mut().find(is_alike) {
                Some(group) => group.estimates.push((index, estimate)),
                None => maps.groups.push(Group { compared, truth, estimates: vec![(index, estimate)] }),
            }
        }
        maps
    }

    fn place(&mut self, topic: &str) -> usize {
        self.topics.iter().position(|known| known == topic).unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        })
    }

    /// The errors of a frame, by the values of its topics; and how many pixels with ground truth there are by metre.
    fn rows(&self, values: &[Option<Value>], metres: usize) -> (Vec<Rows>, Vec<u64>) {
        let mut all = Vec::new();
        let mut counts = vec![0; metres];
        // By ground truth, the pixels that are counted: estimates with several settings share one.
        let mut counted: BTreeMap<usize, Vec<bool>> = BTreeMap::new();
        let depth = |place: usize| values[place].as_ref().filter(|value| value.metres().is_some());
        for Group { compared: Compared { settings, .. }, truth: place, estimates } in &self.groups {
            let Some(truth) = depth(*place).and_then(Value::metres) else { continue };
            let (width, height) = truth.dimensions();
            let pixels = ScoredPixels::new(truth, width as usize, height as usize, settings);
            // A map of another size than its ground truth was not scored either: the frame failed there, which the run reported.
            let is_of_size = |value: &&Value| value.metres().is_some_and(|map| map.dimensions() == (width, height));
            let errors = |(estimator, place): &(usize, usize)| {
                let estimate = depth(*place).filter(is_of_size)?.depth_estimate()?;
                Some((*estimator, pixels.absolute_errors(estimate, settings)))
            };
            let errors: Vec<(usize, Vec<f32>)> = estimates.iter().filter_map(errors).collect();
            if errors.is_empty() {
                continue;
            }
            let bin = |truth_m: &f32| if (*truth_m as usize) < metres { *truth_m as u32 } else { OUTSIDE };
            let bins: Vec<u32> = pixels.truth_m().iter().map(bin).collect();
            let counted = counted.entry(*place).or_insert_with(|| vec![false; (width * height) as usize]);
            for (at, bin) in pixels.positions().iter().zip(&bins).filter(|(_, bin)| **bin != OUTSIDE) {
                let is_new = !std::mem::replace(&mut counted[*at as usize], true);
                counts[*bin as usize] += u64::from(is_new);
            }
            let mut shared = if errors.len() == estimates.len() { bins.clone() } else { vec![OUTSIDE; bins.len()] };
            for (_, errors) in &errors {
                shared.iter_mut().zip(errors).filter(|(_, error)| error.is_nan()).for_each(|(bin, _)| *bin = OUTSIDE);
            }
            all.push(Rows { bins, shared, errors });
        }
        (all, counts)
    }
}

/// The pixels of a frame that are scored in one way.
struct Rows {
    /// By pixel: its metre, or [`OUTSIDE`].
    bins: Vec<u32>,
    /// The same of shared pixels; [`OUTSIDE`] of others.
    shared: Vec<u32>,
    /// By estimator: the absolute errors, NaN where it is invalid.
    errors: Vec<(usize, Vec<f32>)>,
}

/// Rows in a temporary file without a name: it goes with its process, and no other process writes to it.
struct ErrorFile {
    /// The file, and its length.
    file: Mutex<(File, u64)>,
    /// The name of the file in messages.
    path: PathBuf,
}

/// Where rows are in the file.
struct Part {
    start: u64,
    pixels: usize,
    estimators: Vec<usize>,
    /// By estimator: how many of its valid pixels are beyond all metres.
    beyond: Vec<u64>,
}

impl ErrorFile {
    fn new(folder: &Path) -> Result<Self, AnalysisError> {
        let path = folder.join("(a temporary file for the error against distance)");
        let file = tempfile::tempfile_in(folder).map_err(AnalysisError::write(&path))?;
        Ok(Self { file: Mutex::new((file, 0)), path })
    }

    fn append(&self, Rows { bins, shared, errors }: &Rows) -> Result<Part, AnalysisError> {
        let mut file = locked(&self.file);
        let (file, end) = &mut *file;
        let mut part = Part { start: *end, pixels: bins.len(), estimators: Vec::new(), beyond: Vec::new() };
        let mut write = |bytes: &[u8]| {
            *end += bytes.len() as u64;
            file.write_all(bytes).map_err(AnalysisError::write(&self.path))
        };
        write(bytemuck::cast_slice(bins))?;
        write(bytemuck::cast_slice(shared))?;
        for (estimator, errors) in errors {
            write(bytemuck::cast_slice(errors))?;
            let is_beyond = |(bin, error): &(&u32, &f32)| **bin == OUTSIDE && !error.is_nan();
            part.estimators.push(*estimator);
            part.beyond.push(bins.iter().zip(errors).filter(is_beyond).count() as u64);
        }
        Ok(part)
    }

    /// A column of rows: their bins, those of shared pixels, or the errors of an estimator.
    fn read<T: bytemuck::Pod>(&self, part: &Part, column: usize) -> Result<Vec<T>, AnalysisError> {
        let mut values = vec![T::zeroed(); part.pixels];
        let bytes = bytemuck::cast_slice_mut(&mut values);
        let start = part.start + (column * bytes.len()) as u64;
        let (file, _) = &mut *locked(&self.file);
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(bytes));
        read.map_err(AnalysisError::read(&self.path))?;
        Ok(values)
    }
}

impl Distances {
    /// By metre, over all stages.
    pub(crate) fn truth_of_all(&self) -> BTreeMap<u32, u64> {
        let mut all = BTreeMap::new();
        self.truth.iter().for_each(|((_, metre), count)| *all.entry(*metre).or_default() += count);
        all
    }

    /// The table `true_distances.csv`: the stage, its variant where that has a source of its own, `bin_from_m, bin_to_m, count`.
    pub(crate) fn table_of_truth(&self, plan: &RecordedPlan) -> Table {
        let keys = RowKeys::new(plan);
        let key = |run: RunId| keys.of_those(&plan.runs[run].stage, &plan.runs[run].variants);
        let rows: Vec<(RowKey, u64)> = self.truth.iter().map(|((run, _), count)| (key(*run), *count)).collect();
        let mut columns = key_columns(&rows, |(key, _)| key, Vec::new());
        columns.extend(bin_columns(self.truth.keys().map(|(_, metre)| *metre)));
        columns.push(TableRows(&rows).count("count", |(_, count)| *count).unit("pixels"));
        Table::new(columns)
    }

    /// The table `error_vs_distance`: the estimator and pixel set, `bin_from_m, bin_to_m, count, error_p5_m ... error_p95_m`; estimator by
    /// estimator, first on the pixels for which each is valid (`set` is `answered`), then on those for which all are (`common`).
    pub(crate) fn table(&self, estimators: &[Estimator]) -> Table {
        let mut rows: Vec<(&Estimator, &str, u32, Spread)> = Vec::new();
        for bins in self.bins.chunk_by(|a, b| a.estimator == b.estimator) {
            let row = |bin: &DistanceBin, set, spread| (&estimators[bin.estimator], set, bin.bin_m, spread);
            rows.extend(bins.iter().map(|bin| row(bin, PixelSet::Answered.name(), bin.answered)));
            rows.extend(bins.iter().filter_map(|bin| Some(row(bin, COMMON, bin.shared?))));
        }
        let cells = TableRows(&rows);
        let mut columns = estimator_columns(&rows, |(estimator, set, ..)| (*estimator, *set), None);
        columns.extend(bin_columns(rows.iter().map(|(_, _, metre, _)| *metre)));
        columns.push(cells.count("count", |(.., spread)| spread.count).unit("pixels"));
        columns.extend(PERCENTILES.into_iter().enumerate().map(|(i, percentile)| {
            cells.number(format!("error_p{percentile}_m"), |(.., spread)| spread.percentiles_m[i]).unit("m")
        }));
        Table::new(columns)
    }
}

/// The edges of bins of a metre of true distance: from the first up to, not including, the second.
fn bin_columns(metres: impl Iterator<Item = u32> + Clone) -> [Column; 2] {
    let column = |name: &str, metres| Column::new(name, Cells::Metres(metres)).unit("m");
    [column("bin_from_m", metres.clone().collect()), column("bin_to_m", metres.map(|metre| metre + 1).collect())]
}
