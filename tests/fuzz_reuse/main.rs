//! Whatever was run before and however the experiment was edited since: a run that reuses earlier results writes the
//! bytes of one with `--fresh`.
//!
//! ```sh
//! # 300 sequences
//! cargo test --release --test fuzz_reuse
//! # as many as you like, on all cores
//! DEPTHLOOM_FUZZ_REUSE=20000 cargo test --release --test fuzz_reuse
//! # one of them again
//! DEPTHLOOM_FUZZ_REUSE_SEED=17 DEPTHLOOM_FUZZ_REUSE=1 cargo test --release --test fuzz_reuse
//! ```
//!
//! A sequence is a function of its seed: a random experiment over all kinds that need no data set (`kinds.rs`,
//! `generate.rs`), and two to four runs of it with random edits in between (`edits.rs`): of parameters, inputs, names,
//! order, variants, sources, files, environment, record settings, arguments. Runs are also interrupted: a recording is
//! cut at any byte, or the process is killed, and the run is resumed, with and without further edits (`sequence.rs`).
//! Each run with reuse is compared with a fresh run of the same state (`running.rs`, `comparison.rs`): exit codes and
//! all files but `environment.json` and `timings.parquet`. A sequence that fails is made smaller (`minimise.rs`) and
//! printed with its seed, its edits and its experiment files; its folder is kept in `target/tmp/fuzz_reuse`.
//!
//! Where a run is killed depends on the machine; that is the only thing that does.

#[cfg(unix)]
mod audit;
#[cfg(unix)]
mod comparison;
#[cfg(unix)]
mod edits;
#[cfg(unix)]
mod experiment;
#[cfg(unix)]
mod files;
#[cfg(unix)]
mod generate;
#[cfg(unix)]
mod kinds;
#[cfg(unix)]
mod minimise;
#[cfg(unix)]
mod program;
#[cfg(unix)]
mod running;
#[cfg(unix)]
mod sequence;
#[cfg(unix)]
mod session;

#[cfg(unix)]
fn main() -> std::process::ExitCode {
    use std::process::ExitCode;

    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == "--process") {
        return match program::serve(&arguments[1..]) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    if std::env::var_os(audit::FACTOR).is_some() {
        return depthloom::main(depthloom::registry().node::<audit::Scale>());
    }
    if arguments.iter().any(|argument| argument == "--list") {
        println!("fuzz_reuse: test");
        return ExitCode::SUCCESS;
    }
    // What `cargo test NAME` passes to every test program.
    let mut filters = arguments.iter().filter(|argument| !argument.starts_with('-'));
    if filters.clone().next().is_some() && !filters.any(|filter| "fuzz_reuse".contains(filter.as_str())) {
        return ExitCode::SUCCESS;
    }
    depthloom_test_needs::signals::restore_defaults();
    let registry = depthloom::registry();
    let nodes = registry.nodes().map(|kind| kind.declaration.kind.to_owned()).collect();
    let sources = registry.sources().map(|kind| kind.declaration.kind.to_owned()).collect();
    kinds::check_complete(&nodes, &sources);
    let python = depthloom_test_needs::python_package("reuse, nodes in Python");
    audit::check(std::path::Path::new(env!("CARGO_BIN_EXE_depthloom")), python.as_deref());
    let number = |name: &str, default: u64| {
        std::env::var(name)
            .map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name} is not a number: {text}")))
    };
    session::run(&session::Options {
        first_seed: number("DEPTHLOOM_FUZZ_REUSE_SEED", 1),
        count: number("DEPTHLOOM_FUZZ_REUSE", 300),
        jobs: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
        binary: env!("CARGO_BIN_EXE_depthloom").into(),
        python,
    })
}

#[cfg(not(unix))]
fn main() {
    depthloom_test_needs::skipped("reuse", "programs as nodes and kills are those of Unix");
}
