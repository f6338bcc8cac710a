//! What `live` prints, and writes beside the recording.

use std::fmt::Write as _;

use depthloom_graphs::counted;
use depthloom_runner::{Latency, LiveReport, Phase, StepLatency};
use depthloom_terminal::{CliError, aligned};
use schemars::JsonSchema;
use serde::Serialize;

use super::Finished;
use crate::output::diagnostics::Error;

/// Output of `live`: what was processed and dropped, and how late it was.
#[derive(JsonSchema, Serialize)]
pub(crate) struct LiveOutput {
    experiment: String,
    /// The stage that ran live.
    stage: String,
    /// Its folder; null with `--no-record`.
    run: Option<String>,
    /// Seconds from the first wait for a frame until the last frame was written.
    elapsed_s: f64,
    /// Frames captured: those processed and those dropped.
    offered: u64,
    /// Frames processed and written.
    processed: u64,
    dropped: Dropped,
    /// How many frames have a failure.
    failed_frames: u64,
    /// Milliseconds; null without `--deadline`.
    deadline_ms: Option<f64>,
    /// Frames later than the deadline; null without `--deadline`.
    deadline_misses: Option<u64>,
    /// The last number of frames that could be in flight.
    window: u64,
    /// The latency of the first frame, on which nodes build their networks, milliseconds. It is in no percentile.
    first_frame_ms: f64,
    /// From capture until the last estimate of the frame.
    frames: LatencyOutput,
    /// By part of the run, in the order of the plan.
    steps: Vec<Step>,
    /// The part that takes most of the time of all parts, if the nodes could not keep up.
    bottleneck: Option<Bottleneck>,
    warnings: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Error>,
}

/// Frames that were not processed, by cause.
#[derive(JsonSchema, Serialize)]
struct Dropped {
    /// The nodes could not keep up.
    graph: u64,
    /// The recording could not keep up.
    recording: u64,
    /// The source lost them.
    source: u64,
}

/// Percentiles of a latency, milliseconds.
#[derive(JsonSchema, Serialize)]
struct LatencyOutput {
    count: u64,
    p50_ms: f64,
    p95_ms: f64,
    p99_ms: f64,
    max_ms: f64,
    /// The mean absolute difference between the latencies of successive frames.
    jitter_ms: f64,
}

/// The latency of a part of the run: from the capture of a frame until the part had finished it.
#[derive(JsonSchema, Serialize)]
struct Step {
    /// The node, or `source`, `encode`, `write`.
    name: String,
    latency: LatencyOutput,
    /// The median time that the part itself takes, milliseconds.
    median_wall_ms: f64,
}

/// The part that limits the rate.
#[derive(JsonSchema, Serialize)]
struct Bottleneck {
    name: String,
    /// Its share of the time of all parts.
    share: f64,
}

impl LiveOutput {
    pub(super) fn new(experiment: &str, stage: &str, finished: &Finished, error: Option<&CliError>) -> Self {
        let live = &finished.live;
        Self {
            experiment: experiment.to_owned(),
            stage: stage.to_owned(),
            run: finished.out.as_ref().map(|out| out.to_string_lossy().into_owned()),
            elapsed_s: live.elapsed.as_secs_f64(),
            offered: live.offered,
            processed: live.processed,
            dropped: Dropped { graph: live.drops.graph, recording: live.drops.recording, source: live.drops.source },
            failed_frames: finished.failed,
            deadline_ms: live.deadline.map(|(deadline, _)| deadline.as_secs_f64() * 1e3),
            deadline_misses: live.deadline.map(|(_, misses)| misses),
            window: live.window as u64,
            first_frame_ms: ms(live.first_frame_ns),
            frames: LatencyOutput::new(&live.frames),
            steps: live.steps.iter().map(Step::new).collect(),
            bottleneck: live.bottleneck.as_ref().map(|(name, share)| Bottleneck { name: name.clone(), share: *share }),
            warnings: finished.warnings.clone(),
            error: error.map(Error::from),
        }
    }
}

impl LatencyOutput {
    fn new(latency: &Latency) -> Self {
        let Latency { count, p50_ns, p95_ns, p99_ns, max_ns, jitter_ns } = *latency;
        let [p50_ms, p95_ms, p99_ms, max_ms, jitter_ms] = [p50_ns, p95_ns, p99_ns, max_ns, jitter_ns].map(ms);
        Self { count, p50_ms, p95_ms, p99_ms, max_ms, jitter_ms }
    }
}

impl Step {
    fn new(step: &StepLatency) -> Self {
        let latency = LatencyOutput::new(&step.latency);
        Self { name: step.label.clone(), latency, median_wall_ms: ms(step.median_wall_ns) }
    }
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

/// What a live run did, for a person.
pub(super) fn text(stage: &str, live: &LiveReport) -> String {
    let seconds = live.elapsed.as_secs_f64().max(f64::MIN_POSITIVE);
    let (frames, rate) = (counted(live.offered, "frame"), live.processed as f64 / seconds);
    let mut text = format!(
        "{stage}: {} of {frames} processed in {seconds:.1} s, {rate:.1} per second; {}\n",
        live.processed,
        dropped(live)
    );
    if let Some((deadline, misses)) = live.deadline {
        let deadline = deadline.as_secs_f64() * 1e3;
        let _ = writeln!(text, "deadline {deadline:.0} ms: missed by {} of {}", misses, live.frames.count);
    }
    if let Some((name, share)) = &live.bottleneck {
        let share = share * 100.0;
        let _ = writeln!(text, "bottleneck: `{name}` takes {share:.0} % of the time of all parts");
    }
    let first = ms(live.first_frame_ns);
    let _ = writeln!(
        text,
        "\nlatency since capture, ms; without the first frame, which took {first:.0} ms and on which nodes start\n"
    );
    text.push_str(&table(live));
    text
}

fn dropped(live: &LiveReport) -> String {
    let causes = live.drops.by_cause();
    let causes: Vec<String> =
        causes.iter().filter(|(_, count)| *count > 0).map(|(cause, count)| format!("{cause} {count}")).collect();
    match live.drops.total() {
        0 => "none dropped".to_owned(),
        total => format!("{total} dropped ({})", causes.join(", ")),
    }
}

/// By percentile, the largest latency of several steps.
fn slowest(steps: &[&StepLatency]) -> Latency {
    steps.iter().fold(Latency::default(), |most, step| {
        let Latency { count, p50_ns, p95_ns, p99_ns, max_ns, jitter_ns } = step.latency;
        Latency {
            count: most.count.max(count),
            p50_ns: most.p50_ns.max(p50_ns),
            p95_ns: most.p95_ns.max(p95_ns),
            p99_ns: most.p99_ns.max(p99_ns),
            max_ns: most.max_ns.max(max_ns),
            jitter_ns: most.jitter_ns.max(jitter_ns),
        }
    })
}

fn table(live: &LiveReport) -> String {
    let number = |ns: u64| format!("{:.1}", ms(ns));
    let row = |name: &str, latency: &Latency, wall: String| {
        let Latency { p50_ns, p95_ns, p99_ns, max_ns, jitter_ns, .. } = *latency;
        let [p50, p95, p99, max, jitter] = [p50_ns, p95_ns, p99_ns, max_ns, jitter_ns].map(number);
        [name.to_owned(), p50, p95, p99, max, jitter, wall]
    };
    let mut rows = vec![["", "p50", "p95", "p99", "max", "jitter", "own time"].map(str::to_owned)];
    rows.push(row("estimates", &live.frames, String::new()));
    // The recording has several parts: the latency is that of the slowest one, the own time that of all.
    let parts: Vec<&StepLatency> = live.steps.iter().filter(|step| matches!(step.phase, Phase::Encode(_))).collect();
    let mut is_encoded = false;
    for step in &live.steps {
        if !matches!(step.phase, Phase::Encode(_)) {
            rows.push(row(&step.label, &step.latency, number(step.median_wall_ns)));
        } else if !std::mem::replace(&mut is_encoded, true) {
            let own = parts.iter().map(|part| part.median_wall_ns).sum();
            rows.push(row(&step.label, &slowest(&parts), number(own)));
        }
    }
    aligned(&rows, &[1, 2, 3, 4, 5, 6])
}
