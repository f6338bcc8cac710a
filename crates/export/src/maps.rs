//! Images, maps and point clouds: one file per frame.

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use depthloom_codecs::files::Colours;
use depthloom_graphs::plan::{FrameIndex, RunId};
use depthloom_graphs::{Value, ValueType};
use depthloom_recording::{RecordedOutput, RecordedRun, Recording, RecordingError};
use depthloom_terminal::{CliError, ExitCode};
use depthloom_threads::{Budget, Tiles as _, caught, into_unlocked, locked};

use crate::{Chosen, Exported, Folder, Form, Frames};

/// How many topics are read at once: what a thread holds in memory.
const TOPICS_AT_ONCE: usize = 16;

/// The files of a topic in one form.
struct Series<'a> {
    chosen: &'a Chosen<'a>,
    form: Form,
    folder: PathBuf,
    /// Depths at which there are no points: caps, beyond which everything is seen as a wall.
    caps_m: Vec<f32>,
    files: AtomicU64,
    /// How many of the files have another ending than the form's: JPEG files of images, which are written as they were
    /// recorded.
    jpegs: AtomicU64,
    clipped: AtomicU64,
}

/// Some series of a stage run that are read together.
struct Group<'a> {
    run: RunId,
    topics: Vec<&'a str>,
    series: Vec<(usize, Series<'a>)>,
    /// The places of what point clouds are made with.
    calibration: Option<usize>,
    image: Option<usize>,
}

/// All files to be written of images and maps.
pub struct Maps<'a> {
    recording: &'a Recording,
    frames: &'a [Frames],
    groups: Vec<Group<'a>>,
}

#[derive(Default)]
struct Trouble {
    /// What ended it, at the first place in the order of the work.
    failed: Option<(usize, CliError)>,
    /// What is damaged, by place, and was left out.
    damaged: Vec<(usize, RecordingError)>,
}

enum Failed {
    Damage(RecordingError),
    CliError(CliError),
}

impl<'a> Maps<'a> {
    /// Plans the files of the selected topics; `colours` and `range` are the requested ones.
    ///
    /// # Errors
    /// If points are requested but no calibration was recorded.
    pub fn new(
        recording: &'a Recording,
        frames: &'a [Frames],
        chosen: &'a [Chosen<'a>],
        colours: Option<Colours>,
        range: Option<(f64, f64)>,
    ) -> Result<Self, CliError> {
        let mut groups = Vec::new();
        for run in RunId::all(recording.plan().runs.len()) {
            let of_run: Vec<&Chosen<'_>> = chosen.iter().filter(|chosen| chosen.run == run).collect();
            for chosen in of_run.chunks(TOPICS_AT_ONCE) {
                let group = Group::new(recording, run, chosen, colours, range)?;
                if !group.series.is_empty() {
                    groups.push(group);
                }
            }
        }
        Ok(Self { recording, frames, groups })
    }

    /// Every file that may be written, in its folder.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let series =
            self.groups.iter().flat_map(|group| group.series.iter().map(move |(_, series)| (group.run, series)));
        series.flat_map(|(run, series)| {
            let jpeg = (series.chosen.value_type == ValueType::Image && series.form == Form::Png).then_some("jpg");
            let endings = std::iter::once(series.form.ending()).chain(jpeg);
            let Frames { positions, names } = &self.frames[run];
            positions.iter().flat_map(move |&position| {
                let path = move |ending| series.folder.join(format!("{}.{ending}", names[position]));
                endings.clone().map(path)
            })
        })
    }

    /// Over how many frames [`Maps::write`] goes, each once for some topics.
    pub fn work(&self) -> u64 {
        self.groups.iter().map(|group| self.frames[group.run].positions.len() as u64).sum()
    }

    /// Writes them, on `threads` threads, until `stop`; calls `done` after each of the [work](Maps::work). What is
    /// damaged is left out, and returned.
    ///
    /// # Errors
    /// If a file cannot be written or a value has another type than its topic. Written files are complete.
    pub fn write(
        &self,
        folder: &Folder,
        threads: usize,
        stop: &(dyn Fn() -> bool + Sync),
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<RecordingError>, CliError> {
        let jobs =
            self.groups.iter().flat_map(|group| self.frames[group.run].positions.iter().map(move |at| (group, *at)));
        let jobs: Vec<(&Group<'_>, FrameIndex)> = jobs.collect();
        let trouble = Mutex::new(Trouble::default());
        let budget = Budget::new(threads);
        let _own = budget.permit();
        budget.run(jobs.len(), &|job| {
            if stop() || locked(&trouble).failed.is_some() {
                return;
            }
            let (group, position) = jobs[job];
            let written = caught(|| self.write_frame(group, position, folder));
            let written = written.unwrap_or_else(|panic| {
                let what = format!("the export panicked: {}", panic.0);
                Err(Failed::CliError(
                    CliError::new(ExitCode::Engine, what).remedy("this is an error in the engine: please report it"),
                ))
            });
            match written {
                Ok(()) => {}
                Err(Failed::Damage(error)) => locked(&trouble).damaged.push((job, error)),
                Err(Failed::CliError(stop)) => {
                    let mut trouble = locked(&trouble);
                    if trouble.failed.as_ref().is_none_or(|(earlier, _)| job < *earlier) {
                        trouble.failed = Some((job, stop));
                    }
                }
            }
            done();
        });
        let Trouble { failed, mut damaged } = into_unlocked(trouble);
        if let Some((_, stop)) = failed {
            return Err(stop);
        }
        damaged.sort_by_key(|(job, _)| *job);
        Ok(damaged.into_iter().map(|(_, error)| error).collect())
    }

    fn write_frame(&self, group: &Group<'_>, position: FrameIndex, folder: &Folder) -> Result<(), Failed> {
        let read = self.recording.reader(group.run, &group.topics).and_then(|mut reader| reader.read(position));
        let values = read.map_err(|error| {
            if error.is_damage() {
                Failed::Damage(error)
            } else {
                Failed::CliError(CliError::remedied(ExitCode::Engine, "failed to read the recording", &error))
            }
        })?;
        let calibration = group.calibration.and_then(|place| match &values[place] {
            Some(Value::Calibration(calibration)) => Some(&**calibration),
            _ => None,
        });
        let image = group.image.and_then(|place| match &values[place] {
            Some(Value::Image(image)) => Some(&**image),
            _ => None,
        });
        for (place, series) in &group.series {
            let Some(value) = &values[*place] else { continue };
            let name = &self.frames[group.run].names[position];
            let file = series.form.file(value, calibration, image, &series.caps_m).map_err(|what| {
                let frame = &self.recording.frames(group.run)[position].id;
                Failed::CliError(CliError::new(
                    ExitCode::Engine,
                    format!("frame {frame}, topic {}: {what}", series.chosen.topic),
                ))
            })?;
            folder
                .write(&series.folder.join(format!("{name}.{}", file.ending)), &file.bytes)
                .map_err(Failed::CliError)?;
            series.files.fetch_add(1, Ordering::Relaxed);
            series.jpegs.fetch_add(u64::from(file.ending != series.form.ending()), Ordering::Relaxed);
            series.clipped.fetch_add(file.clipped, Ordering::Relaxed);
        }
        Ok(())
    }

    /// What was written until now.
    pub fn exported(&self) -> impl Iterator<Item = Exported> {
        self.groups.iter().flat_map(|group| &group.series).map(|(_, series)| {
            let (files, jpegs) = (series.files.load(Ordering::Relaxed), series.jpegs.load(Ordering::Relaxed));
            let own = series.form.ending();
            let (format, endings) = match jpegs {
                0 => (own, own.to_owned()),
                all if all == files => ("jpg", "jpg".to_owned()),
                _ => (own, format!("{{{own},jpg}}")),
            };
            Exported {
                topic: series.chosen.name.to_owned(),
                value_type: series.chosen.value_type.name(),
                format,
                path: series.folder.join(format!("<frame>.{endings}")).to_string_lossy().into_owned(),
                files,
                clipped_pixels: series.clipped.load(Ordering::Relaxed),
            }
        })
    }
}

/// The caps of depth that the values of a topic went through: the parameter `cap` of its node, and of the nodes before
/// it.
fn caps<'a>(run: &'a RecordedRun, topic: &'a str, seen: &mut HashSet<&'a str>, found: &mut Vec<f32>) {
    if !seen.insert(topic) {
        return;
    }
    for node in run.nodes.iter().filter(|node| node.outputs.iter().any(|output| output.topic == topic)) {
        found.extend(node.params.get("cap").and_then(serde_json::Value::as_f64).map(|cap| cap as f32));
        node.inputs.iter().filter_map(|input| input.from.as_deref()).for_each(|from| caps(run, from, seen, found));
    }
}

impl<'a> Group<'a> {
    fn new(
        recording: &'a Recording,
        run: RunId,
        chosen: &[&'a Chosen<'a>],
        colours: Option<Colours>,
        range: Option<(f64, f64)>,
    ) -> Result<Self, CliError> {
        let mut group = Self { run, topics: Vec::new(), series: Vec::new(), calibration: None, image: None };
        for &chosen in chosen {
            for &format in &chosen.formats {
                let Some(form) = Form::for_maps(format, chosen.value_type, colours, range) else { continue };
                let mut folder = chosen.path.clone().into_os_string();
                folder.push(form.suffix());
                let (files, jpegs, clipped) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU64::new(0));
                let place = group.place(chosen.topic);
                let mut caps_m = Vec::new();
                // Who names a range gets all that is in it.
                if form.is_cloud() && range.is_none() {
                    caps(&recording.plan().runs[run], chosen.topic, &mut HashSet::new(), &mut caps_m);
                }
                let folder = folder.into();
                group.series.push((place, Series { chosen, form, folder, caps_m, files, jpegs, clipped }));
            }
        }
        if group.series.iter().any(|(_, series)| series.form.is_cloud()) {
            let outputs = &recording.plan().runs[run].source.outputs;
            let first = |value_type| outputs.iter().find(|output| output.value_type() == Some(value_type));
            let recorded = |output: &&RecordedOutput| output.recorded;
            let Some(calibration) = first(ValueType::Calibration).filter(recorded) else {
                let stage = recording.plan().runs[run].name();
                let what = format!("there are no points without a calibration, and stage `{stage}` recorded none");
                return Err(CliError::usage(
                    what,
                    "let `record:` keep `source/calibration`, and run the experiment again",
                ));
            };
            group.calibration = Some(group.place(&calibration.topic));
            // The source's first image is of the camera that all maps are of.
            group.image = first(ValueType::Image).filter(recorded).map(|image| group.place(&image.topic));
        }
        Ok(group)
    }

    /// The place of a topic among those that are read.
    fn place(&mut self, topic: &'a str) -> usize {
        self.topics.iter().position(|known| *known == topic).unwrap_or_else(|| {
            self.topics.push(topic);
            self.topics.len() - 1
        })
    }
}
