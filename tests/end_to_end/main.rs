//! Tests of the binary as a user runs it: on real frames, against reference implementations, and with faults.
//!
//! Tests that need `../shared` (real frames, golden results) or a Python environment print `SKIPPED <test>: why` if it
//! is missing.

mod analyse;
mod architecture;
mod axes;
mod benchmarks;
mod broken_data;
mod broken_files;
mod browser;
#[cfg(target_os = "linux")]
mod cluster;
mod commands;
mod compare;
mod cost;
mod data;
mod determinism;
mod disparity_scores;
#[cfg(target_os = "linux")]
mod dora;
mod evaluate;
mod experiments;
mod export;
mod failing_disk;
mod faults;
mod figures;
mod fixtures;
mod from_recording;
mod golden;
mod guide;
mod help;
mod killed;
mod learning;
mod live;
mod looking;
mod lsp;
mod networks;
mod outputs;
mod packaging;
mod page;
mod plain_language;
#[cfg(target_os = "linux")]
mod process;
mod python_package;
mod python_reads;
#[path = "../../recording/tests/recording/digest.rs"]
mod recording_digest;
mod replay;
#[cfg(target_os = "linux")]
mod reports;
#[cfg(target_os = "linux")]
mod reproducers;
mod resume;
mod reuse;
mod runs;
mod samples;
#[cfg(target_os = "linux")]
mod slurm;
#[cfg(unix)]
mod strangers;
mod support;
mod tables;
