//! What differs between machines and moments: kept beside the recording, never in it.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::Instant;

use depthloom_graphs::regular_file;
use depthloom_kernels::simd::Level;
use depthloom_nodes::onnx::Provider;
use depthloom_nodes::onnx::{self, Engine};
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value as Json, json};

use crate::outputs;

/// The name of the file that says where and when a run was made.
pub const ENVIRONMENT: &str = "environment.json";

/// How it writes a time, for `chrono`: see [`utc_stamp`].
pub const STAMP: &str = "%Y-%m-%dT%H-%M-%SZ";

/// How much of it is read, bytes.
const LARGEST: u64 = 16 << 20;

/// Where and when a run was made: `environment.json`.
#[derive(JsonSchema, Serialize)]
pub struct Environment {
    /// The version of the program.
    depthloom: &'static str,
    arguments: Vec<String>,
    os: &'static str,
    architecture: &'static str,
    cores: u64,
    simd: Vec<&'static str>,
    #[schemars(with = "Option<outputs::Engine>")]
    networks: Option<Json>,
    /// The files and folders that it read.
    reads: Vec<String>,
    workers: u64,
    window: Option<u64>,
    finished_utc: String,
    /// Seconds from the start of the process to its last file.
    wall_s: f64,
    peak_resident_bytes: Option<u64>,
}

/// When this process started.
static STARTED: LazyLock<Instant> = LazyLock::new(Instant::now);

/// Marks the start of the process: the first call counts.
pub fn mark_start() {
    LazyLock::force(&STARTED);
}

/// What a run's folder says of where and when it was made; nothing where it says nothing.
pub fn of(run: &Path) -> Json {
    let bytes = regular_file::read(&run.join(ENVIRONMENT), LARGEST).unwrap_or_default();
    serde_json::from_slice(&bytes).unwrap_or_default()
}

/// The files and folders that a run reads, as `environment.json` holds them: where they lie, whatever variables and links led there.
pub fn reads(read: &[PathBuf]) -> Vec<String> {
    let mut lie: Vec<PathBuf> = read.iter().filter_map(|path| std::fs::canonicalize(path).ok()).collect();
    lie.sort();
    lie.dedup();
    lie.iter().map(|path| path.to_string_lossy().into_owned()).collect()
}

/// The engine's version, the machine, the run's size and time.
pub fn describe(workers: usize, window: Option<usize>, read: &[PathBuf]) -> Environment {
    // JSON holds text: of an argument that is none, what can be read of it.
    let arguments = std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect();
    Environment {
        depthloom: env!("CARGO_PKG_VERSION"),
        arguments,
        os: std::env::consts::OS,
        architecture: std::env::consts::ARCH,
        cores: cores() as u64,
        simd: simd(),
        networks: onnx::in_use().map(networks),
        reads: reads(read),
        workers: workers as u64,
        window: window.map(|window| window as u64),
        finished_utc: utc_stamp(),
        wall_s: wall_seconds(),
        peak_resident_bytes: peak_resident_bytes(),
    }
}

/// The seconds since this process started.
fn wall_seconds() -> f64 {
    STARTED.elapsed().as_secs_f64()
}

impl Environment {
    /// Measures time and memory again, when more was done since.
    pub fn measure_again(&mut self) {
        self.wall_s = wall_seconds();
        self.peak_resident_bytes = peak_resident_bytes();
    }

    /// The content of `environment.json`.
    pub fn text(&self) -> String {
        let json = serde_json::to_value(self).expect("texts, numbers and lists have JSON");
        format!("{json:#}\n")
    }
}

/// The engine that runs networks, and the providers that they ran on.
fn networks(engine: &Engine) -> Json {
    let mut described = self::engine(engine);
    described["ran_on"] = names(&engine.used()).into();
    described
}

/// An engine that runs networks: what it is, and where it comes from.
pub fn engine(engine: &Engine) -> Json {
    json!({
        "engine": engine.name,
        "version": engine.version,
        "build": engine.build,
        "path": engine.library.as_ref().map(|path| path.to_string_lossy()),
        "found_by": engine.found_by,
        "instead_of": engine.instead_of,
        "refused": engine.refused,
    })
}

/// Providers by name.
pub fn names(providers: &[Provider]) -> Vec<&'static str> {
    providers.iter().map(|provider| provider.name()).collect()
}

/// How many threads can run at once here.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// The instruction sets that kernels choose from on this machine.
pub fn simd() -> Vec<&'static str> {
    Level::available().into_iter().filter(|level| *level != Level::PORTABLE).map(Level::name).collect()
}

/// The most memory this process has held at once; `None` where the system does not tell.
fn peak_resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The time now as `2026-11-21T08-30-05Z`: UTC, sortable, and a file name everywhere.
pub fn utc_stamp() -> String {
    chrono::Utc::now().format(STAMP).to_string()
}
