//! `depthloom report`: tables, plots and page of a run, from its recording alone.

use std::path::Path;

use depthloom_analysis::{Prepared, ReportOptions, Resampling};
use depthloom_runs::{models, open, run_folder};
use depthloom_terminal::{CliError, ExitCode, print, say};

use crate::args::ReportArgs;
use crate::output;
use crate::output::diagnostics::Error;
use crate::results::page;
use crate::results::report::{Report, analyse, no_pixel_counted, summary};
use crate::signals;

/// Recreates tables, plots and models from the recording alone.
pub(crate) fn report(args: &ReportArgs) -> Result<ExitCode, CliError> {
    let path = args.run.recording("report")?;
    let out = match &args.out {
        Some(out) => out.clone(),
        None => path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned(),
    };
    if let Some(run) = run_folder::around(&out) {
        // A report may be written to the run's own folder.
        let of_recording = std::fs::canonicalize(&path).ok().and_then(|path| path.parent().map(Path::to_owned));
        let is_its_own = [of_recording, std::fs::canonicalize(&out).ok()].iter().all(|of| of.as_ref() == Some(&run));
        if !is_its_own {
            let what = format!("--out is the folder of another run: {}", run.display());
            return Err(CliError::usage(what, "choose another --out"));
        }
    } else if let Some(name) = run_folder::in_the_way_of_a_report(&out) {
        let what = format!("--out has a file that no report wrote: {}", out.join(name).display());
        return Err(CliError::usage(what, "choose another --out, or move the file away"));
    }
    let interrupt = signals::listen("stopping: what is not written yet stays as it was")?;
    std::fs::create_dir_all(&out).map_err(|error| {
        CliError::of_writing(ExitCode::Usage, format_args!("failed to create {}", out.display()), &error)
    })?;
    let lock = run_folder::lock_if_run(&out)?;
    let recording = open(&path)?;
    if lock.is_none() {
        depthloom_durable::remove_abandoned(&out);
        run_folder::mark_for_reports(&out).map_err(|error| {
            CliError::of_writing(ExitCode::Usage, format_args!("failed to write to {}", out.display()), &error)
        })?;
    }
    let intervals = args.ci.map(|confidence| Resampling { confidence, ..Resampling::default() });
    let options = ReportOptions { paper: args.paper, intervals, check_every_byte: true, ..ReportOptions::default() };
    // What an earlier report of the same maps computed is reused, as a run reuses that of earlier runs. Every byte is
    // still checked.
    let of_run = path.parent().unwrap_or(Path::new("."));
    let prepared = Prepared { reports: vec![of_run.to_owned()], ..Prepared::default() };
    let report = analyse(&recording, &out, &options, prepared, &interrupt)?;
    let tables_written = |stop: CliError| stop.also(format!("tables and plots were written to {}", out.display()));
    models::write(&recording, &out).map_err(tables_written)?;
    if !args.page.no_page {
        let surroundings = page::surroundings(of_run);
        page::write(&recording, &out, &report, &surroundings, args.page.options(), args.output.json, &interrupt)
            .map_err(tables_written)?;
    }
    // A report of an unfinished recording is a success, that of a damaged one is not.
    let damaged = || CliError::new(ExitCode::FrameFailures, format!("{} is damaged", path.display()));
    let faulty = report.is_damaged.then(damaged);
    let faulty = faulty.or_else(|| no_pixel_counted(&report));
    let printed = if args.output.json {
        output::print(&Report::new(&report, faulty.as_ref().map(Error::from)))
    } else {
        if report.is_damaged {
            say(format_args!("warning: {} is damaged", path.display()));
        }
        print(summary(&report, &out))
    };
    printed.map_err(tables_written)?;
    if args.page.open {
        page::open(&out);
    }
    Ok(faulty.map_or(ExitCode::Success, |stop| stop.exit))
}
