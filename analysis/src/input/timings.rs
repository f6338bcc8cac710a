//! The timings of a run: `timings.parquet` and its table.

use std::path::Path;

use depthloom_graphs::{Key, regular_file};
use polars::prelude::{ParallelStrategy, ParquetReader, PolarsResult, SerReader};

use crate::error::{AnalysisError, caught};
use crate::tables::{RowKey, Rows, Table, key_columns};

/// The cost of one part of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Timing {
    /// The stage (empty if the part belongs to none), and the variant if not all variants share the node.
    pub row_key: RowKey,
    /// The node, the source, or another part of the program.
    pub node: String,
    /// The phase: `read`, `process`, `encode`, `compress`, `write`, ...
    pub phase: String,
    /// The number of frames.
    pub frames: u64,
    /// Total CPU time, nanoseconds.
    pub cpu_ns: u64,
    /// Total wall-clock time, nanoseconds.
    pub wall_ns: u64,
    /// The median CPU time of frames, nanoseconds; `None` if it was not measured frame by frame.
    pub median_cpu_ns: Option<u64>,
    /// Of a live run, from the capture of a frame until this part had finished it.
    pub latency: Option<TimingLatency>,
}

/// Percentiles of a latency over frames, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimingLatency {
    /// The median.
    pub p50_ns: u64,
    /// The 95th percentile.
    pub p95_ns: u64,
    /// The 99th percentile.
    pub p99_ns: u64,
    /// The maximum.
    pub max_ns: u64,
    /// The mean absolute difference between successive frames.
    pub jitter_ns: u64,
}

type LatencyColumn = (&'static str, fn(&TimingLatency) -> u64);

/// The columns of latencies, and their numbers.
const LATENCIES: [LatencyColumn; 5] = [
    ("latency_p50_ns", |latency| latency.p50_ns),
    ("latency_p95_ns", |latency| latency.p95_ns),
    ("latency_p99_ns", |latency| latency.p99_ns),
    ("latency_max_ns", |latency| latency.max_ns),
    ("jitter_ns", |latency| latency.jitter_ns),
];

/// Writes the timings of a run to a Parquet file, one row each: key columns, `node`, `phase`, `frames, cpu_ns, wall_ns,
/// median_cpu_ns`, and of a live run the latencies. `run` is the key of the run's plan.
///
/// # Errors
/// If the file cannot be written.
pub fn write_timings(timings: &[Timing], run: &Key, path: &Path) -> Result<(), AnalysisError> {
    let rows = Rows(timings);
    let own = vec![rows.key("node", |timing| &timing.node), rows.key("phase", |timing| &timing.phase)];
    let mut columns = key_columns(timings, |timing| &timing.row_key, own);
    columns.extend([
        rows.count("frames", |timing| timing.frames).unit("frames"),
        rows.count("cpu_ns", |timing| timing.cpu_ns).unit("ns"),
        rows.count("wall_ns", |timing| timing.wall_ns).unit("ns"),
        rows.count("median_cpu_ns", |timing| timing.median_cpu_ns).unit("ns"),
    ]);
    if timings.iter().any(|timing| timing.latency.is_some()) {
        let latencies = LATENCIES.iter();
        columns.extend(
            latencies.map(|(name, number)| rows.count(*name, |timing| timing.latency.as_ref().map(number)).unit("ns")),
        );
    }
    let bytes = Table::new(columns).parquet("timings", run)?;
    depthloom_durable::write(path, &bytes).map_err(AnalysisError::write(path))
}

/// Reads timings, without the axes of their variants.
///
/// # Errors
/// If the file cannot be read or is not a timings file.
pub fn read_timings(path: &Path) -> Result<Vec<Timing>, AnalysisError> {
    let file = regular_file::open(path).map_err(AnalysisError::read(path))?;
    let read = || -> PolarsResult<Vec<Timing>> {
        let table = ParquetReader::new(file).read_parallel(ParallelStrategy::None).finish()?;
        let texts = |name: &str| table.column(name).and_then(|column| column.str());
        let numbers = |name: &str| table.column(name).and_then(|column| column.u64());
        // Version 0.1.0 stored the variant in the name of the node.
        let (stages, variants) = (texts("stage")?, texts("variant").ok());
        let (nodes, phases) = (texts("node")?, texts("phase")?);
        let (frames, cpu, wall, median) =
            (numbers("frames")?, numbers("cpu_ns")?, numbers("wall_ns")?, numbers("median_cpu_ns")?);
        let latencies = LATENCIES.map(|(name, _)| numbers(name).ok());
        let latency = |i: usize| {
            let [p50_ns, p95_ns, p99_ns, max_ns, jitter_ns] =
                latencies.map(|column| column.and_then(|column| column.get(i)));
            Some(TimingLatency {
                p50_ns: p50_ns?,
                p95_ns: p95_ns?,
                p99_ns: p99_ns?,
                max_ns: max_ns?,
                jitter_ns: jitter_ns?,
            })
        };
        let named = |i: usize| {
            let (stage, node) = (stages.get(i).unwrap_or_default(), nodes.get(i).unwrap_or_default());
            match (variants, node.rsplit_once('/')) {
                (Some(variants), _) => (stage, variants.get(i), node),
                (None, Some((variant, node))) => (stage, Some(variant), node),
                (None, None) => (stage, None, node),
            }
        };
        let row = |i: usize| Timing {
            row_key: RowKey {
                stage: named(i).0.to_owned(),
                variant: named(i).1.map(str::to_owned),
                factors: Vec::new(),
            },
            node: named(i).2.to_owned(),
            phase: phases.get(i).unwrap_or_default().to_owned(),
            frames: frames.get(i).unwrap_or(0),
            cpu_ns: cpu.get(i).unwrap_or(0),
            wall_ns: wall.get(i).unwrap_or(0),
            median_cpu_ns: median.get(i),
            latency: latency(i),
        };
        Ok((0..table.height()).map(row).collect())
    };
    caught(|| read().map_err(AnalysisError::compute(format!("timings from {}", path.display()))))
}

/// The timings of a run as aligned text: core-milliseconds per frame by node and phase with their share of the total;
/// then the aggregate nodes.
///
/// # Errors
/// If the file cannot be read or is not a timings file.
pub fn timings_table(path: &Path) -> Result<String, AnalysisError> {
    Ok(render(&read_timings(path)?))
}

/// The phase of aggregate nodes, which run once after all frames.
const ONCE: &str = "once";

fn render(timings: &[Timing]) -> String {
    let total_ns = timings.iter().map(|timing| timing.cpu_ns).sum::<u64>().max(1) as f64;
    let per_frame_ms = |ns: u64, frames: u64| ns as f64 / 1e6 / frames.max(1) as f64;
    let names: Vec<String> = timings.iter().map(name).collect();
    let wide = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max("node".len());
    let phases = timings.iter().map(|timing| timing.phase.chars().count()).max().unwrap_or(0).max("phase".len());
    let row = |(timing, name): (&Timing, &String)| {
        let median = timing.median_cpu_ns.map_or_else(|| "-".to_owned(), |ns| format!("{:.3}", ns as f64 / 1e6));
        format!(
            "{name:wide$}  {:phases$}  {:>7}  {:>9.3}  {median:>9}  {:>9.3}  {:>5.1}%\n",
            timing.phase,
            timing.frames,
            per_frame_ms(timing.cpu_ns, timing.frames),
            per_frame_ms(timing.wall_ns, timing.frames),
            100.0 * timing.cpu_ns as f64 / total_ns,
        )
    };
    let rows = |once: bool| timings.iter().zip(&names).filter(move |(timing, _)| (timing.phase == ONCE) == once);
    let head = |frames: &str| {
        let (node, phase, core, median, wall, share) = ("node", "phase", "core-ms", "median", "wall-ms", "share");
        format!("{node:wide$}  {phase:phases$}  {frames:>7}  {core:>9}  {median:>9}  {wall:>9}  {share:>6}\n")
    };
    let mut text = String::from(
        "per frame; core-ms: mean CPU time of all threads; median: median CPU time; wall-ms: mean wall-clock time;\n\
         share: share of the run's CPU time\n\n",
    );
    text.push_str(&head("frames"));
    text.extend(rows(false).map(row));
    let frames = rows(false).map(|(timing, _)| timing.frames).max().unwrap_or(0);
    let sum = per_frame_ms(rows(false).map(|(timing, _)| timing.cpu_ns).sum(), frames);
    text.push_str(&format!("{:wide$}  {:phases$}  {frames:>7}  {sum:>9.3}\n", "in all", ""));
    if rows(true).next().is_some() {
        text.push_str(&format!("\nonce, after the last frame of its stage\n\n{}", head("times")));
        text.extend(rows(true).map(row));
    }
    text.push_str(&latencies(timings, &names, wide));
    text
}

/// The latencies of a live run, if it was one.
fn latencies(timings: &[Timing], names: &[String], wide: usize) -> String {
    let rows: Vec<(&String, TimingLatency)> = timings
        .iter()
        .zip(names)
        // Compression is a part of encoding.
        .filter(|(timing, _)| timing.phase != "compress")
        .filter_map(|(timing, name)| Some((name, timing.latency?)))
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let mut text = format!(
        "\nlatency since capture, ms; jitter: mean absolute difference between successive frames\n\n{:wide$}  {:>9}  {:>9}  {:>9}  {:>9}  {:>9}\n",
        "node", "p50", "p95", "p99", "max", "jitter"
    );
    for (name, latency) in rows {
        let [p50, p95, p99, max, jitter] = LATENCIES.map(|(_, number)| number(&latency) as f64 / 1e6);
        text.push_str(&format!("{name:wide$}  {p50:>9.3}  {p95:>9.3}  {p99:>9.3}  {max:>9.3}  {jitter:>9.3}\n"));
    }
    text
}

fn name(timing: &Timing) -> String {
    let stage = if timing.row_key.stage.is_empty() { String::new() } else { format!("{}.", timing.row_key.stage) };
    let variant = timing.row_key.variant.as_ref().map_or_else(String::new, |variant| format!("{variant}/"));
    format!("{stage}{variant}{}", timing.node)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timings() -> Vec<Timing> {
        let timing = |stage: &str, variant: Option<&str>, node: &str, phase: &str, cpu_ns, median_cpu_ns| Timing {
            row_key: RowKey { stage: stage.to_owned(), variant: variant.map(str::to_owned), factors: Vec::new() },
            node: node.to_owned(),
            phase: phase.to_owned(),
            frames: 4,
            cpu_ns,
            wall_ns: cpu_ns + 1_000_000,
            median_cpu_ns,
            latency: None,
        };
        vec![
            timing("compare", None, "stereo", "process", 300_000_000, Some(74_500_000)),
            timing("compare", Some("a"), "fused", "process", 60_000_000, Some(15_000_000)),
            timing("", None, "recording", "write", 40_000_000, None),
        ]
    }

    #[test]
    fn timings_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("timings.parquet");
        write_timings(&timings(), &Key::of_content(b"a plan"), &path).unwrap();
        assert_eq!(read_timings(&path).unwrap(), timings());
        assert_eq!(timings_table(&path).unwrap(), render(&timings()));
    }

    #[test]
    fn core_milliseconds_are_per_frame() {
        let lines = render(&timings());
        let lines: Vec<&str> = lines.lines().collect();
        assert_eq!(
            lines,
            [
                "per frame; core-ms: mean CPU time of all threads; median: median CPU time; wall-ms: mean wall-clock time;",
                "share: share of the run's CPU time",
                "",
                "node             phase     frames    core-ms     median    wall-ms   share",
                "compare.stereo   process        4     75.000     74.500     75.250   75.0%",
                "compare.a/fused  process        4     15.000     15.000     15.250   15.0%",
                "recording        write          4     10.000          -     10.250   10.0%",
                "in all                          4    100.000",
            ]
        );
    }

    #[test]
    fn aggregate_nodes_have_their_own_table() {
        let once = Timing {
            row_key: RowKey { stage: "learn".to_owned(), ..RowKey::default() },
            node: "train".to_owned(),
            phase: "once".to_owned(),
            frames: 1,
            cpu_ns: 1_600_000_000,
            wall_ns: 900_000_000,
            median_cpu_ns: None,
            latency: None,
        };
        let lines = render(&[timings(), vec![once]].concat());
        let lines: Vec<&str> = lines.lines().collect();
        assert_eq!(
            lines[3..],
            [
                "node             phase     frames    core-ms     median    wall-ms   share",
                "compare.stereo   process        4     75.000     74.500     75.250   15.0%",
                "compare.a/fused  process        4     15.000     15.000     15.250    3.0%",
                "recording        write          4     10.000          -     10.250    2.0%",
                "in all                          4    100.000",
                "",
                "once, after the last frame of its stage",
                "",
                "node             phase      times    core-ms     median    wall-ms   share",
                "learn.train      once           1   1600.000          -    900.000   80.0%",
            ]
        );
    }

    #[test]
    fn latencies_of_a_live_run_are_written_and_printed() {
        let latency = |ms: u64| TimingLatency {
            p50_ns: ms * 1_000_000,
            p95_ns: 2 * ms * 1_000_000,
            p99_ns: 3 * ms * 1_000_000,
            max_ns: 4 * ms * 1_000_000,
            jitter_ns: 500_000,
        };
        let mut timings = timings();
        timings[1].latency = Some(latency(20));
        timings[2].latency = Some(latency(30));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("timings.parquet");
        write_timings(&timings, &Key::of_content(b"a plan"), &path).unwrap();
        assert_eq!(read_timings(&path).unwrap(), timings);
        let text = render(&timings);
        let (_, latencies) = text.split_once("latency since capture, ms").unwrap();
        let lines: Vec<&str> = latencies.lines().skip(2).collect();
        assert_eq!(
            lines,
            [
                "node                   p50        p95        p99        max     jitter",
                "compare.a/fused     20.000     40.000     60.000     80.000      0.500",
                "recording           30.000     60.000     90.000    120.000      0.500",
            ]
        );
    }

    #[test]
    fn a_missing_file_is_named() {
        let error = timings_table(Path::new("nowhere/timings.parquet")).unwrap_err();
        assert_eq!(error.to_string(), "failed to read nowhere/timings.parquet");
    }
}
