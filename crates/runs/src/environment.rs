//! What differs between machines and times: stored beside the recording, never in it.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

use depthloom_graphs::regular_file;
use depthloom_kernels::simd::Level;
use depthloom_nodes::onnx;
use depthloom_nodes::onnx::Provider;
use rustix::time::{ClockId, clock_gettime};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::git::GitState;

/// The file with place and time of a run.
pub const ENVIRONMENT: &str = "environment.json";

/// How it writes a time, for `chrono`: see [`utc_stamp`].
pub const STAMP: &str = "%Y-%m-%dT%H-%M-%SZ";

/// The most bytes of it that are read.
const LARGEST: u64 = 16 << 20;

/// Place and time of a run: `environment.json`.
#[derive(JsonSchema, Serialize)]
pub struct Environment {
    /// The version of the program.
    depthloom: &'static str,
    arguments: Vec<String>,
    /// The git repository of the experiment; null outside of one.
    git: Option<GitState>,
    os: &'static str,
    architecture: &'static str,
    cores: u64,
    simd: Vec<&'static str>,
    networks: Option<Engine>,
    /// The files and folders that it read.
    reads: Vec<String>,
    workers: u64,
    window: Option<u64>,
    finished_utc: String,
    /// Seconds from the start of the process to its last file.
    wall_s: f64,
    /// CPU seconds of the process, and of the programs that it waited for, until its last file.
    cpu_s: f64,
    /// Until the first frame; null for a live run.
    start: Option<Work>,
    /// The analysis, with its tables and figures; null for a live run.
    pub report: Option<Work>,
    /// The page; null without one.
    pub page: Option<Work>,
    peak_resident_bytes: Option<u64>,
}

/// The time of a part of a run.
#[derive(Clone, Copy, Debug, PartialEq, JsonSchema, Serialize, Deserialize)]
pub struct Work {
    /// CPU seconds of all threads, and of the programs that the process waited for.
    pub cpu_s: f64,
    /// Seconds of wall-clock time.
    pub wall_s: f64,
}

impl Work {
    /// The time since the start of the process.
    pub fn since_start() -> Self {
        Self { cpu_s: cpu_seconds(), wall_s: wall_seconds() }
    }

    /// The time since `earlier`, which [`Work::since_start`] returned.
    #[must_use]
    pub fn since(earlier: Self) -> Self {
        let now = Self::since_start();
        Self { cpu_s: now.cpu_s - earlier.cpu_s, wall_s: now.wall_s - earlier.wall_s }
    }
}

static STARTED: LazyLock<Instant> = LazyLock::new(Instant::now);

/// Marks the start of the process: the first call counts.
pub fn mark_start() {
    LazyLock::force(&STARTED);
}

/// The content of `environment.json` in a run's folder, or null.
pub fn read(run: &Path) -> Json {
    let bytes = regular_file::read(&run.join(ENVIRONMENT), LARGEST).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// The files and folders that a run reads, as stored in `environment.json`: absolute paths, with variables and links
/// resolved.
pub fn reads(read: &[PathBuf]) -> Vec<String> {
    let mut lie: Vec<PathBuf> = read.iter().filter_map(|path| std::fs::canonicalize(path).ok()).collect();
    lie.sort();
    lie.dedup();
    lie.iter().map(|path| path.to_string_lossy().into_owned()).collect()
}

/// The engine's version, the machine, the run's size and time.
pub fn describe(workers: usize, window: Option<usize>, read: &[PathBuf], git: Option<GitState>) -> Environment {
    // JSON strings are UTF-8: other bytes of an argument are replaced.
    let arguments = std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect();
    Environment {
        depthloom: env!("CARGO_PKG_VERSION"),
        arguments,
        git,
        os: std::env::consts::OS,
        architecture: std::env::consts::ARCH,
        cores: depthloom_threads::core_count() as u64,
        simd: simd(),
        networks: onnx::in_use().map(networks),
        reads: reads(read),
        workers: workers as u64,
        window: window.map(|window| window as u64),
        finished_utc: utc_stamp(),
        wall_s: wall_seconds(),
        cpu_s: cpu_seconds(),
        start: None,
        report: None,
        page: None,
        peak_resident_bytes: peak_resident_bytes(),
    }
}

fn wall_seconds() -> f64 {
    STARTED.elapsed().as_secs_f64()
}

fn cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9 + programs_cpu_seconds().unwrap_or(0.0)
}

/// CPU seconds of the ended programs that the process started; `None` if the system does not report them.
fn programs_cpu_seconds() -> Option<f64> {
    /// Linux counts this time in hundredths of a second, whatever its kernel's clock.
    const TICKS_PER_S: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second entry is the name of the program in parentheses, which may contain spaces.
    let (_, entries) = stat.rsplit_once(')')?;
    let mut ticks = entries.split_whitespace().skip(13).map(str::parse::<u64>);
    let (user, system) = (ticks.next()?.ok()?, ticks.next()?.ok()?);
    Some((user + system) as f64 / TICKS_PER_S)
}

impl Environment {
    /// The same, with the time until the first frame.
    #[must_use]
    pub const fn with_start(mut self, start: Work) -> Self {
        self.start = Some(start);
        self
    }

    /// Measures time and memory again, after more work.
    pub fn measure_again(&mut self) {
        self.wall_s = wall_seconds();
        self.cpu_s = cpu_seconds();
        self.peak_resident_bytes = peak_resident_bytes();
    }

    /// The content of `environment.json`.
    ///
    /// # Panics
    /// Never: texts, numbers and lists have JSON.
    #[must_use]
    pub fn text(&self) -> String {
        let json = serde_json::to_value(self).expect("texts, numbers and lists have JSON");
        format!("{json:#}\n")
    }
}

/// The engine that runs networks, and the providers that they ran on.
fn networks(engine: &onnx::Engine) -> Engine {
    Engine { ran_on: Some(names(&engine.used())), ..Engine::from(engine) }
}

/// The engine of networks.
#[derive(JsonSchema, Serialize)]
pub struct Engine {
    engine: String,
    version: String,
    build: Option<String>,
    path: Option<String>,
    found_by: String,
    /// Why it is not the preferred one.
    instead_of: Option<String>,
    refused: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    providers: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    looked_at: Option<Vec<String>>,
    /// The providers that networks ran on.
    #[serde(skip_serializing_if = "Option::is_none")]
    ran_on: Option<Vec<String>>,
}

impl Engine {
    /// The engine with what it offers, and the places where it was looked for.
    pub fn found(engine: &onnx::Engine, looked_at: Vec<String>) -> Self {
        Self { providers: Some(names(&engine.providers())), looked_at: Some(looked_at), ..Self::from(engine) }
    }
}

impl From<&onnx::Engine> for Engine {
    /// What it is, and where it comes from.
    fn from(engine: &onnx::Engine) -> Self {
        Self {
            engine: engine.name.to_owned(),
            version: engine.version.clone(),
            build: Some(engine.build.to_owned()),
            path: engine.library.as_ref().map(|path| path.to_string_lossy().into_owned()),
            found_by: engine.found_by.to_owned(),
            instead_of: engine.instead_of.clone(),
            refused: engine.refused.clone(),
            providers: None,
            looked_at: None,
            ran_on: None,
        }
    }
}

/// The names of providers.
pub fn names(providers: &[Provider]) -> Vec<String> {
    providers.iter().map(|provider| provider.name().to_owned()).collect()
}

/// The instruction sets that kernels choose from on this machine.
pub fn simd() -> Vec<&'static str> {
    Level::available().into_iter().filter(|level| *level != Level::PORTABLE).map(Level::name).collect()
}

/// The most memory of this process so far; `None` if the system does not report it.
fn peak_resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The time now as `2026-11-21T08-30-05Z`: UTC, sortable, and a file name everywhere.
pub fn utc_stamp() -> String {
    chrono::Utc::now().format(STAMP).to_string()
}

#[cfg(test)]
mod tests {
    use super::{Work, programs_cpu_seconds};

    #[test]
    fn the_time_of_the_process_grows_while_it_works() {
        let start = Work::since_start();
        let mut x = 1_u64;
        while Work::since(start).cpu_s < 0.01 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
        let spent = Work::since(start);
        assert!(spent.cpu_s < 10.0 && spent.wall_s > 0.0, "{spent:?}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn programs_that_ended_count() {
        let before = programs_cpu_seconds().unwrap();
        let program = "i=0; while [ $i -lt 100000 ]; do i=$((i+1)); done";
        assert!(std::process::Command::new("sh").args(["-c", program]).status().unwrap().success());
        assert!(programs_cpu_seconds().unwrap() > before);
    }
}
