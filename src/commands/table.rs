//! `depthloom table`: the scores of a run, asked.

use std::fs;
use std::io::{self, IsTerminal as _};
use std::path::Path;

use depthloom_analysis::{
    Answer, BoardRun, Costs, Mean, PixelSet, Question, Ranking, Resampling, Selection, TableOutput, Typesetting,
    plan_key,
};
use depthloom_durable::remedy_of_writing;
use depthloom_graphs::Key;
use depthloom_runs::{TIMINGS, end, failed, open, recording_of, run_folder};
use depthloom_terminal::{Exit, Stop, chain, print, print_bytes, print_quoted, say};

use crate::args::{MeanOption, RowsOption, ScoresArgs, SetOption, TableArgs, TableFormat, TypesettingArgs};
use crate::outputs::{self, CommandOutput, Output};
use crate::signals;

/// Columns of text of a terminal's table.
const TERMINAL_WIDTH: usize = 110;

impl CommandOutput for TableOutput {
    const OUTPUT: Output = Output::Table;
}

/// Prints a table of a run's scores, or writes it to a file.
pub fn table(args: &TableArgs) -> Result<Exit, Stop> {
    let delivery = Delivery::of(args.format, args.json, args.out.as_deref())?;
    let [run] = &args.runs[..] else { return leaderboard(args, &delivery) };
    let path = recording_of(run, "table")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open(&path)?;
    let costs = costs(&path)?;
    let selection = Selection { estimators: args.estimators.clone(), ..selection(&args.scores) };
    let (resamples, seed) = (args.resamples, args.seed);
    let intervals = args.ci.map(|confidence| Resampling { confidence, resamples, seed, ..Resampling::default() });
    let question = match (&args.effects, &args.best_per_zone, args.rows) {
        (Some(score), ..) => Question::Effects(score.clone()),
        (None, Some(score), _) => Question::BestPerZone(score.clone()),
        (None, None, RowsOption::Score) => Question::Scores(intervals),
        (None, None, RowsOption::Variant) => Question::Ranking(ranking(args, intervals)),
    };
    let answer =
        depthloom_analysis::answer(&recording, costs.as_ref(), &selection, &question, &|| interrupt.stops_admission());
    let mut answer = answer.map_err(|error| failed(&error))?;
    answer.typeset(&typesetting(&args.typesetting));
    delivery.answer::<TableOutput>(&answer, &plan_key(recording.plan()), &[&path])?;
    Ok(end([&recording]))
}

fn ranking(args: &TableArgs, intervals: Option<Resampling>) -> Ranking {
    Ranking {
        sort: args.sort.clone(),
        top: args.top.map(|top| top as usize),
        columns: args.columns.clone(),
        pareto: args.pareto.clone(),
        intervals,
    }
}

/// One table of several runs.
fn leaderboard(args: &TableArgs, delivery: &Delivery<'_>) -> Result<Exit, Stop> {
    if args.effects.is_some() || args.best_per_zone.is_some() || args.rows == RowsOption::Score || args.ci.is_some() {
        let what = "of several runs there is a table with estimates in rows alone";
        return Err(Stop::new(Exit::Before, what).remedy("leave out --effects, --best-per-zone, --rows and --ci"));
    }
    let paths = args.runs.iter().map(|run| recording_of(run, "table")).collect::<Result<Vec<_>, _>>()?;
    let interrupt = signals::listen("stopping")?;
    let recordings = paths.iter().map(|path| open(path)).collect::<Result<Vec<_>, _>>()?;
    let costs = paths.iter().map(|path| costs(path)).collect::<Result<Vec<_>, _>>()?;
    let called: Vec<String> = args.runs.iter().map(|run| run.display().to_string()).collect();
    let runs: Vec<BoardRun<'_>> = (called.iter().zip(&recordings).zip(&costs))
        .map(|((called, recording), costs)| BoardRun { called, recording, costs: costs.as_ref() })
        .collect();
    let selection = Selection { estimators: args.estimators.clone(), ..selection(&args.scores) };
    let stop = || interrupt.stops_admission();
    let board = depthloom_analysis::leaderboard(&runs, &selection, &ranking(args, None), &stop);
    let mut answer = Answer::Grid(board.map_err(|error| failed(&error))?);
    answer.typeset(&typesetting(&args.typesetting));
    let recording_paths: Vec<&Path> = paths.iter().map(std::path::PathBuf::as_path).collect();
    delivery.answer::<TableOutput>(&answer, &plan_key(recordings[0].plan()), &recording_paths)?;
    Ok(end(&recordings))
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

    /// Prints an answer, or writes it to the file, as JSON of type `T`; `run` is the key of the plan it is of, `recordings` are those.
    pub(super) fn answer<T: CommandOutput + From<TableOutput>>(
        &self,
        answer: &Answer,
        run: &Key,
        recordings: &[&Path],
    ) -> Result<(), Stop> {
        let bytes = match self.format {
            TableFormat::Terminal => answer.terminal(TERMINAL_WIDTH).into_bytes(),
            TableFormat::Md => answer.markdown().into_bytes(),
            TableFormat::Csv => answer.csv(),
            TableFormat::Parquet => answer.parquet(run).map_err(|error| failed(&error))?,
            TableFormat::Latex => answer.latex().into_bytes(),
            TableFormat::Json => outputs::text(&T::from(answer.output())).into_bytes(),
        };
        self.deliver(&bytes, recordings)
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

/// Refuses to replace a file of a run or a recording.
pub(super) fn replaces_no_run(out: &Path) -> Result<(), Stop> {
    let is_of_a_run = || run_folder::around(out.parent().unwrap_or(Path::new("."))).is_some();
    let what = match out.is_file() {
        true if is_of_a_run() => "it is a file of a run",
        true if depthloom_runs::is_recording(out) => "it is a recording",
        _ => return Ok(()),
    };
    Err(Stop::new(Exit::Before, format!("cannot write {}: {what}", out.display())).remedy("choose another file"))
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
    replaces_no_run(out)?;
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

/// What the run's nodes cost, if its timings lie beside the recording.
fn costs(recording: &Path) -> Result<Option<Costs>, Stop> {
    let timings = recording.with_file_name(TIMINGS);
    if !timings.is_file() {
        return Ok(None);
    }
    match depthloom_analysis::read_timings(&timings) {
        Ok(timings) => Ok(Some(Costs::new(&timings))),
        Err(error) => {
            let why = chain(&error);
            say(format_args!("warning: no `ms`: {why}; {} is damaged, and may be removed", timings.display()));
            Ok(None)
        }
    }
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

/// How a table is set.
pub(super) fn typesetting(args: &TypesettingArgs) -> Typesetting {
    let TypesettingArgs { caption, label, digits } = args.clone();
    Typesetting { caption, label, decimals: digits.map(usize::from) }
}

/// The scores that arguments select.
pub(super) fn selection(args: &ScoresArgs) -> Selection {
    let ScoredSet { set, common } = ScoredSet::of(args.set);
    let mean = args.mean.map(|mean| match mean {
        MeanOption::Frames => Mean::Frames,
        MeanOption::Pixels => Mean::Pixels,
    });
    let (zone, frames) = (args.zone.clone(), args.frames.clone());
    Selection { common, set, zone, frames, mean, ..Selection::default() }
}
