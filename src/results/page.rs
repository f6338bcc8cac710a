//! `report.html`: written, and opened in a browser.

use std::io::IsTerminal as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use depthloom_analysis::{AnalysisError, PAGE, PageOptions, Summary, Surroundings, read_timings, write_page};
use depthloom_recording::Recording;
use depthloom_runner::Interrupt;
use depthloom_runs::{TIMINGS, environment};
use depthloom_terminal::{CliError, ExitCode, say};
use indicatif::ProgressBar;

/// How long a browser that cannot be started has to say so.
const STARTED: Duration = Duration::from_secs(2);

/// Writes the page of a report into a folder. A terminal shows a spinner meanwhile, except if `is_quiet`.
pub(crate) fn write(
    recording: &Recording,
    folder: &Path,
    summary: &Summary,
    surroundings: &Surroundings,
    options: PageOptions,
    is_quiet: bool,
    interrupt: &Interrupt,
) -> Result<(), CliError> {
    let spinner = (!is_quiet && std::io::stderr().is_terminal()).then(|| {
        let spinner = ProgressBar::new_spinner().with_message(format!("writing {PAGE}"));
        spinner.enable_steady_tick(Duration::from_millis(200));
        spinner
    });
    let written = write_page(recording, folder, summary, surroundings, options, &|| interrupt.stops_admission());
    spinner.iter().for_each(ProgressBar::finish_and_clear);
    written.map(|_| ()).map_err(|error| match error {
        AnalysisError::Stopped => CliError::new(ExitCode::Interrupted, format!("interrupted while writing {PAGE}")),
        error => {
            let exit = if error.is_damage() { ExitCode::FrameFailures } else { ExitCode::Engine };
            CliError::remedied(exit, format!("failed to make {PAGE}"), &error).also("`--no-page` leaves it out")
        }
    })
}

/// The environment and the timings next to a recording, without values that change after the page is written.
pub(crate) fn surroundings(folder: &Path) -> Surroundings {
    let mut environment = environment::read(folder);
    if let Some(entries) = environment.as_object_mut() {
        // A page does not list other files of this machine. The memory of a run is not known yet when its page is
        // written.
        entries.remove("reads");
        entries.remove("peak_resident_bytes");
        // Measured again after the page.
        for time in ["wall_s", "cpu_s", "start", "report", "page"] {
            entries.remove(time);
        }
    }
    let timings = folder.join(TIMINGS);
    let timings = timings.is_file().then(|| read_timings(&timings).ok()).flatten().unwrap_or_default();
    Surroundings { environment, timings }
}

/// Opens the page of a folder in a browser. A failure is a warning only.
pub(crate) fn open(folder: &Path) {
    let page = folder.join(PAGE);
    // A browser has a folder of its own to start from.
    let page = std::fs::canonicalize(&page).unwrap_or(page);
    let entries = std::env::var_os("BROWSER").filter(|browser| !browser.is_empty());
    let mut command = match entries {
        Some(browser) => Command::new(browser),
        None if cfg!(target_os = "macos") => Command::new("open"),
        None if cfg!(windows) => Command::new("explorer"),
        None => Command::new("xdg-open"),
    };
    let started = command.arg(&page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let program = command.get_program().to_string_lossy().into_owned();
    let failed = match started {
        Err(error) => Some(error.to_string()),
        // One that stays is a browser; what ends at once says how it went. Explorer ends with 1 however it went.
        Ok(mut child) => {
            let start = Instant::now();
            loop {
                match child.try_wait() {
                    Ok(Some(status)) if !status.success() && !cfg!(windows) => {
                        break Some(format!("it ended with {status}"));
                    }
                    Ok(None) if start.elapsed() < STARTED => sleep(Duration::from_millis(20)),
                    _ => break None,
                }
            }
        }
    };
    if let Some(why) = failed {
        say(format_args!(
            "failed to open {} with {program}: {why}; open it yourself, or name a browser in $BROWSER",
            page.display()
        ));
    }
}
