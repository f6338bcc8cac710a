//! `depthloom table`: the scores of a run, asked.

use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::Path;

use depthloom_analysis::{
    AnalysisError, Answer, Costs, Mean, PixelSet, Question, Ranking, Resampling, Selection, plan_key,
};
use depthloom_graphs::Key;
use depthloom_recording::Recording;

use super::report::{TIMINGS, recording_of};
use crate::args::{MeanOption, RowsOption, ScoresArgs, SetOption, TableArgs, TableFormat};
use crate::exit::{Exit, Stop, remedy_of_writing};
use crate::outputs::Output;
use crate::signals;
use crate::streams::{print, print_bytes, print_quoted};

/// Columns of text of a terminal's table.
const TERMINAL_WIDTH: usize = 110;

/// Prints a table of a run's scores, or writes it to a file.
pub fn table(args: &TableArgs) -> Result<Exit, Stop> {
    let delivery = Delivery::of(args.format, args.json, args.out.as_deref())?;
    let path = recording_of(&args.run, "table")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open(&path)?;
    let costs = costs(&path)?;
    let selection = Selection { estimators: args.estimators.clone(), ..selection(&args.scores) };
    let intervals = args.ci.map(|confidence| Resampling { confidence, ..Resampling::default() });
    let question = match (&args.effects, &args.best_per_zone, args.rows) {
        (Some(score), ..) => Question::Effects(score.clone()),
        (None, Some(score), _) => Question::BestPerZone(score.clone()),
        (None, None, RowsOption::Score) => Question::Scores(intervals),
        (None, None, RowsOption::Variant) => Question::Ranking(Ranking {
            sort: args.sort.clone(),
            top: args.top.map(|top| top as usize),
            columns: args.columns.clone(),
            pareto: args.pareto.clone(),
            intervals,
        }),
    };
    let answer =
        depthloom_analysis::answer(&recording, costs.as_ref(), &selection, &question, &|| interrupt.stops_admission());
    let answer = answer.map_err(|error| failed(&error))?;
    delivery.answer(Output::Table, &answer, &plan_key(recording.plan()), &[&path])
}

/// What a table is written as, and where.
pub(super) struct Delivery<'a> {
    pub(super) format: TableFormat,
    out: Option<&'a Path>,
}

impl<'a> Delivery<'a> {
    /// As it is asked for.
    pub(super) fn of(format: Option<TableFormat>, json: bool, out: Option<&'a Path>) -> Result<Self, Stop> {
        let format = match format {
            Some(format) => format,
            None if json => TableFormat::Json,
            None => TableFormat::Terminal,
        };
        if format == TableFormat::Parquet && out.is_none() && io::stdout().is_terminal() {
            return Err(Stop::new(Exit::Before, "Parquet is no text").remedy("name a file with --out, or pipe it on"));
        }
        if let Some(out) = out {
            can_be_written(out)?;
        }
        Ok(Self { format, out })
    }

    /// Prints an answer, or writes it to the file; `run` is the key of the plan it is of, `recordings` are those.
    pub(super) fn answer(
        &self,
        output: Output,
        answer: &Answer,
        run: &Key,
        recordings: &[&Path],
    ) -> Result<Exit, Stop> {
        let bytes = match self.format {
            TableFormat::Terminal => answer.terminal(TERMINAL_WIDTH).into_bytes(),
            TableFormat::Md => answer.markdown().into_bytes(),
            TableFormat::Csv => answer.csv(),
            TableFormat::Parquet => answer.parquet(run).map_err(|error| failed(&error))?,
            TableFormat::Latex => answer.latex().into_bytes(),
            TableFormat::Json => format!("{:#}\n", output.stamped(answer.json())).into_bytes(),
        };
        self.deliver(&bytes, recordings)?;
        Ok(Exit::Whole)
    }

    /// Whether it is text for a terminal.
    pub(super) fn is_shown(&self) -> bool {
        self.format == TableFormat::Terminal && self.out.is_none()
    }

    /// Prints it, or writes it to the file; `recordings` are those that it is of.
    pub(super) fn deliver(&self, bytes: &[u8], recordings: &[&Path]) -> Result<(), Stop> {
        match (self.out, self.format) {
            (Some(out), _) => write_named(out, bytes, recordings),
            (None, TableFormat::Parquet) => print_bytes(bytes),
            (None, TableFormat::Json) => print_quoted(&String::from_utf8_lossy(bytes)),
            (None, _) => print(String::from_utf8_lossy(bytes)),
        }
    }
}

/// Writes a file that a person named; never one of a run, which `recordings` are those of.
pub(super) fn write_named(out: &Path, bytes: &[u8], recordings: &[&Path]) -> Result<(), Stop> {
    if recordings.iter().any(|recording| is_of_the_run(out, recording)) {
        let what = format!("{} is the run's own", out.display());
        return Err(Stop::new(Exit::Before, what).remedy("choose another file"));
    }
    write(out, bytes).map_err(|error| {
        let stop = Stop::because(Exit::Engine, format_args!("failed to write {}", out.display()), &error);
        match remedy_of_writing(&error) {
            Some(remedy) => stop.remedy(remedy),
            None => stop,
        }
    })
}

/// That a file may stand there: in a folder, and no folder itself.
pub(super) fn can_be_written(out: &Path) -> Result<(), Stop> {
    let cannot = |what: String| Stop::new(Exit::Before, format!("cannot write {}: {what}", out.display()));
    if out.is_dir() {
        let file = out.join("table.csv");
        return Err(cannot("it is a folder".to_owned()).remedy(format!("name a file in it, e.g. {}", file.display())));
    }
    if out.is_symlink() && !is_stream(out) {
        // In a folder that is a stranger's, it may lead to any file of the person's.
        return Err(cannot("it is a symbolic link".to_owned()).remedy("name the file that it leads to"));
    }
    match out.parent().filter(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
        None => Ok(()),
        Some(folder) => {
            let stop = cannot(format!("there is no folder {}", folder.display()));
            Err(stop.remedy(format!("make it (`mkdir -p {}`), or choose another --out", folder.display())))
        }
    }
}

/// Writes a file that a person named, or into the pipe or device of that name (`/dev/stdout`).
fn write(out: &Path, bytes: &[u8]) -> io::Result<()> {
    if is_stream(out) { fs::write(out, bytes) } else { depthloom_durable::write(out, bytes) }
}

/// Whether a path leads to a pipe or device, or to where the system names this process' own streams (`/dev/stdout`, `/dev/fd/3`).
fn is_stream(out: &Path) -> bool {
    ["/dev", "/proc"].iter().any(|folder| out.starts_with(folder))
        || fs::metadata(out).is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// Whether a file is there already beside the recording, or is the recording.
fn is_of_the_run(out: &Path, recording: &Path) -> bool {
    let folder = |path: &Path| path.canonicalize().ok()?.parent().map(Path::to_owned);
    out.exists() && folder(out).is_some_and(|of_out| Some(of_out) == folder(recording))
}

/// Opens a recording to ask it something.
pub(super) fn open(path: &Path) -> Result<Recording, Stop> {
    Recording::open(path).map_err(|error| Stop::of_recording(Exit::Before, "failed to read the recording", &error))
}

/// What the run's nodes cost, if its timings lie beside the recording.
fn costs(recording: &Path) -> Result<Option<Costs>, Stop> {
    let timings = recording.with_file_name(TIMINGS);
    if !timings.is_file() {
        return Ok(None);
    }
    let timings = depthloom_analysis::read_timings(&timings)
        .map_err(|error| Stop::because(Exit::Before, "failed to read the timings", &error))?;
    Ok(Some(Costs::new(&timings)))
}

/// The pixels that scores are asked for.
pub(super) struct ScoredSet {
    /// Those that were scored so.
    pub(super) set: Option<PixelSet>,
    /// Whether scores are to be taken again, of what all answered.
    pub(super) common: bool,
}

impl ScoredSet {
    pub(super) fn of(set: Option<SetOption>) -> Self {
        let common = set == Some(SetOption::Common);
        let set = match set {
            Some(SetOption::All) => Some(PixelSet::All),
            Some(SetOption::Answered) => Some(PixelSet::Answered),
            Some(SetOption::Filled) => Some(PixelSet::Filled),
            Some(SetOption::Common) | None => None,
        };
        Self { set, common }
    }
}

/// The scores that arguments select.
pub(super) fn selection(args: &ScoresArgs) -> Selection {
    let ScoredSet { set, common } = ScoredSet::of(args.set);
    let mean = args.mean.map(|mean| match mean {
        MeanOption::Frames => Mean::Frames,
        MeanOption::Pixels => Mean::Pixels,
    });
    Selection { common, set, zone: args.zone.clone(), mean, estimators: None }
}

/// Why a question has no answer: it was wrong, or the recording is, or the analysis.
pub(super) fn failed(error: &AnalysisError) -> Stop {
    let exit = match error {
        AnalysisError::Stopped => return Stop::new(Exit::Interrupted, "interrupted while analysing"),
        AnalysisError::Asked { .. } => Exit::Before,
        error if error.is_damage() => Exit::Frames,
        _ => Exit::Engine,
    };
    match error {
        AnalysisError::Asked { what, help } => Stop::new(exit, what.as_str()).remedy(help.as_str()),
        error => Stop::of_analysis(exit, "failed to analyse the recording", error),
    }
}
