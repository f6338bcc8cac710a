//! `depthloom table`: queries the metrics of a run.

use std::path::Path;

use depthloom_analysis::{BoardRun, Costs, Question, Ranking, Resampling, Selection, TableOutput, plan_key};
use depthloom_graphs::chain;
use depthloom_runs::{TIMINGS, end, failed, open_frames};
use depthloom_terminal::{CliError, ExitCode, say};

use crate::args::{PixelsOption, RowsOption, TableArgs};
use crate::output::delivery::Delivery;
use crate::results::frames::note_frames_beyond;
use crate::signals;

/// Prints a table of a run's metrics, or writes it to a file.
pub(crate) fn table(args: &TableArgs) -> Result<ExitCode, CliError> {
    let delivery = Delivery::new(&args.output)?;
    let [run] = &args.runs[..] else { return leaderboard(args, &delivery) };
    let path = args.folder.recording(run, "table")?;
    let interrupt = signals::listen("stopping")?;
    let recording = open_frames(&path)?;
    let costs = costs(&path)?;
    let (estimates, grouping) = (args.estimates.clone(), args.group.clone());
    let selection = Selection { estimates, grouping, ..args.scores.selection() };
    let (resamples, seed) = (args.resamples, args.seed);
    let intervals = args.ci.map(|confidence| Resampling { confidence, resamples, seed, ..Resampling::default() });
    if args.rows == RowsOption::Score {
        let options = [
            ("--sort", args.sort.is_some()),
            ("--top", args.top.is_some()),
            ("--columns", !args.columns.is_empty()),
            ("--pareto", !args.pareto.is_empty()),
        ];
        if let Some((option, _)) = options.iter().find(|(_, is_given)| *is_given) {
            let what = format!("{option} needs variants in rows, and `--rows score` has scores in rows");
            return Err(CliError::usage(what, format!("leave out {option} or `--rows score`")));
        }
    }
    let question = match (&args.effects, &args.best_per_zone, args.rows) {
        (Some(score), ..) => Question::Effects(score.clone()),
        (None, Some(score), _) => Question::BestPerZone(score.clone()),
        (None, None, RowsOption::Score) => Question::Scores(intervals),
        (None, None, RowsOption::Variant) => Question::Ranking(ranking(args, intervals)),
    };
    let stop = || interrupt.stops_admission();
    let table = depthloom_analysis::answer(&recording, costs.as_ref(), &selection, &question, &stop);
    let mut table = table.map_err(failed)?;
    table.typeset(&args.typesetting.typesetting());
    delivery.warn_of_condition([&recording]);
    note_frames_beyond([&recording], args.scores.frames.as_ref());
    delivery.answer::<TableOutput>(&table, &plan_key(recording.plan()), &[&path])?;
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

fn leaderboard(args: &TableArgs, delivery: &Delivery<'_>) -> Result<ExitCode, CliError> {
    if args.effects.is_some() || args.best_per_zone.is_some() || args.rows == RowsOption::Score || args.ci.is_some() {
        let what = "a table of several runs supports neither --effects, --best-per-zone, `--rows score` nor --ci";
        return Err(CliError::usage(what, "leave them out, or name one run"));
    }
    if args.scores.pixels == Some(PixelsOption::Common) {
        let what = "`--pixels common` needs estimates of a single run: each run has common pixels of its own";
        return Err(CliError::usage(what, "name one run, or choose another `--pixels`"));
    }
    let paths = args.runs.iter().map(|run| args.folder.recording(run, "table")).collect::<Result<Vec<_>, _>>()?;
    let interrupt = signals::listen("stopping")?;
    let recordings = paths.iter().map(|path| open_frames(path)).collect::<Result<Vec<_>, _>>()?;
    let costs = paths.iter().map(|path| costs(path)).collect::<Result<Vec<_>, _>>()?;
    let called: Vec<String> = args.runs.iter().map(|run| run.display().to_string()).collect();
    let runs: Vec<BoardRun<'_>> = (called.iter().zip(&recordings).zip(&costs))
        .map(|((called, recording), costs)| BoardRun { called, recording, costs: costs.as_ref() })
        .collect();
    let selection = Selection { estimates: args.estimates.clone(), ..args.scores.selection() };
    let stop = || interrupt.stops_admission();
    let board = depthloom_analysis::leaderboard(&runs, &selection, &ranking(args, None), &stop);
    let mut table = board.map_err(failed)?;
    table.typeset(&args.typesetting.typesetting());
    let recording_paths: Vec<&Path> = paths.iter().map(std::path::PathBuf::as_path).collect();
    delivery.warn_of_condition(&recordings);
    note_frames_beyond(&recordings, args.scores.frames.as_ref());
    delivery.answer::<TableOutput>(&table, &plan_key(recordings[0].plan()), &recording_paths)?;
    Ok(end(&recordings))
}

/// The CPU time of the run's nodes, if its timings are next to the recording.
fn costs(recording: &Path) -> Result<Option<Costs>, CliError> {
    let timings = recording.with_file_name(TIMINGS);
    if !timings.is_file() {
        return Ok(None);
    }
    match depthloom_analysis::read_timings(&timings) {
        Ok(timings) => Ok(Some(Costs::new(&timings))),
        Err(error) => {
            let why = chain(&error);
            say(format_args!(
                "warning: `ms` is not available: {why}; {} is damaged and can be removed",
                timings.display()
            ));
            Ok(None)
        }
    }
}
