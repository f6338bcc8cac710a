//! A live run that keeps its last frames in memory, and writes them on a signal.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, Weak};
use std::time::Duration;

use depthloom_graphs::counted;
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::Ready;
use depthloom_recording::{RingEvent, RingOptions, RingSink};
use depthloom_runner::{Interrupt, Live};
use depthloom_runs::{LIVE, environment, reuse};
use depthloom_terminal::{CliError, ExitCode, size};
use depthloom_threads::locked;

use super::{Finished, LiveOutput, Storage, execute, finished, print_warnings};
use crate::args::{LiveArgs, TriggerSignal};
use crate::output::live::Messages;
use crate::signals;

/// The signal that writes the kept frames. It is ignored until there is a ring.
pub(crate) struct RingTrigger(Arc<Mutex<Weak<RingSink>>>);

impl RingTrigger {
    /// Listens for the signal from now on; before, it ends the process.
    pub(crate) fn listen(signal: TriggerSignal) -> Result<Self, CliError> {
        let ring = Arc::new(Mutex::new(Weak::new()));
        let triggered = Arc::clone(&ring);
        signals::on(signal, move || {
            let ring: Option<Arc<RingSink>> = locked(&triggered).upgrade();
            ring.iter().for_each(|ring| ring.trigger());
        })?;
        Ok(Self(ring))
    }
}

/// Runs with a ring in memory.
pub(super) fn run_ring(
    args: &LiveArgs,
    (window, trigger): (Duration, &RingTrigger),
    plan: &Plan,
    ready: Ready,
    live: Live,
    interrupt: &Interrupt,
) -> Result<Finished, CliError> {
    let folder = folder(args, plan);
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent).map_err(|error| {
            CliError::of_writing(ExitCode::Usage, format_args!("failed to create {}", parent.display()), &error)
        })?;
    }
    let runs = args.folder.path();
    let earlier = Arc::new(reuse::beside(Some(&folder), &runs, plan));
    print_warnings(args, &reuse::unreadable(&earlier));
    let (messages, failures) = (Messages::default(), Arc::new(Mutex::new(Vec::new())));
    let options = RingOptions { folder: folder.clone(), window, max_bytes: RingOptions::MAX_BYTES };
    let report = {
        let (messages, failures) = (messages.clone(), Arc::clone(&failures));
        move |event: RingEvent| {
            let text = message(&event, window);
            if let RingEvent::Failed(_) = event {
                locked(&failures).push(text.clone());
            }
            messages.push(text);
        }
    };
    let ring = RingSink::new(plan, live.run, options, report);
    let ring = ring.map_err(|error| CliError::remedied(ExitCode::Engine, "failed to keep frames", &error))?;
    let ring = Arc::new(ring.with_earlier(earlier));
    *locked(&trigger.0) = Arc::downgrade(&ring);
    let stage = plan.runs[live.run].stage.clone();
    let ran = execute(args, plan, ready, live, (Storage::Sink(&*ring), None), &messages, interrupt);
    // Waits for the recordings that were requested.
    drop(ring);
    messages.print_rest(super::is_silent(args));
    let mut finished = finished(args, plan, ran?, Vec::new())?;
    finished.out = Some(folder.clone());
    write_output(plan, &stage, &finished, &folder)?;
    let failures = std::mem::take(&mut *locked(&failures));
    match failures.first() {
        None => Ok(finished),
        Some(first) => Err(CliError::new(ExitCode::Engine, first.clone()).remedy(format!(
            "{} requested; the others are in {}",
            counted(failures.len() as u64, "recording"),
            folder.display()
        ))),
    }
}

/// The folder of `--out`, or a new one beside the runs of the experiment.
fn folder(args: &LiveArgs, plan: &Plan) -> PathBuf {
    let default = || args.folder.path().join(&plan.experiment).join(format!("{}-kept", environment::utc_stamp()));
    args.out.clone().unwrap_or_else(default)
}

fn write_output(plan: &Plan, stage: &str, finished: &Finished, folder: &Path) -> Result<(), CliError> {
    let path = folder.join(LIVE);
    let text = crate::output::text(&LiveOutput::new(&plan.experiment, stage, finished, None));
    depthloom_durable::write(&path, text.as_bytes()).map_err(|error| {
        CliError::of_writing(ExitCode::Engine, format_args!("failed to write {}", path.display()), &error)
    })
}

fn message(event: &RingEvent, window: Duration) -> String {
    match event {
        RingEvent::Written(file) => {
            let (frames, seconds, bytes) =
                (counted(file.frames, "frame"), file.duration.as_secs_f64(), size(file.bytes));
            let limit = if file.is_limited_by_bytes {
                format!(
                    "; less than {:.0} s, because of the limit of {}",
                    window.as_secs_f64(),
                    size(RingOptions::MAX_BYTES)
                )
            } else {
                String::new()
            };
            format!("kept {frames} of the last {seconds:.1} s in {} ({bytes}){limit}", file.path.display())
        }
        RingEvent::Empty => "nothing to keep: no frame was processed yet".to_owned(),
        RingEvent::Busy => "a signal was ignored: the recording of an earlier one is being written".to_owned(),
        RingEvent::Failed(error) => format!("failed to keep frames: {}", depthloom_graphs::chain(error)),
    }
}
