//! What differs between machines and moments: kept beside the recording, never in it.

use depthloom_nodes::onnx_engine::{self, Engine};
use depthloom_nodes::onnx_provider::Provider;
use serde_json::{Value as Json, json};

/// The engine's version, the machine, the run's size and time, as `environment.json` holds them.
pub fn describe(workers: usize, window: Option<usize>, wall_seconds: f64) -> Json {
    json!({
        "depthloom": env!("CARGO_PKG_VERSION"),
        "arguments": std::env::args().collect::<Vec<_>>(),
        "os": std::env::consts::OS,
        "architecture": std::env::consts::ARCH,
        "cores": cores(),
        "simd": simd(),
        "networks": onnx_engine::in_use().map(networks),
        "workers": workers,
        "window": window,
        "finished_utc": utc_stamp(),
        "wall_s": wall_seconds,
        "peak_resident_bytes": peak_resident_bytes(),
    })
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
        "path": engine.library,
        "found_by": engine.found_by,
        "instead_of": engine.instead_of,
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

/// The instruction sets that kernels choose from, as far as this machine has them.
pub fn simd() -> Vec<&'static str> {
    #[cfg(target_arch = "x86_64")]
    {
        let found = [
            ("sse4.1", std::arch::is_x86_feature_detected!("sse4.1")),
            ("avx2", std::arch::is_x86_feature_detected!("avx2")),
            ("avx512bw", std::arch::is_x86_feature_detected!("avx512bw")),
        ];
        found.iter().filter(|(_, there)| *there).map(|(name, _)| *name).collect()
    }
    #[cfg(not(target_arch = "x86_64"))]
    Vec::new()
}

/// The most memory this process has held at once; `None` where the system does not tell.
fn peak_resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// The time now as `2026-11-21T08-30-05Z`: UTC, sortable, and a file name everywhere.
pub fn utc_stamp() -> String {
    chrono::Utc::now().format("%Y-%m-%dT%H-%M-%SZ").to_string()
}
