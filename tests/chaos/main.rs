//! A day of breaking, kept: the program under kills, flipped bits, cuts, limits, signals, hostile files and broken
//! streams.
//!
//! ```sh
//! cargo test --release --test chaos                                 # shortened: some hundred cases, as CI runs it
//! cargo test --release --test chaos -- --full                       # more than ten thousand
//! # One area, or one kind of it (bits/checkpoint); a number of cases per kind
//! cargo test --release --test chaos -- bits --cases 2000 --seed 7
//! cargo test --release --test chaos -- --seed 7 --case bits/whole/123
//! ```
//! Further options: `--jobs N` (children side by side; one a core by default), `--seconds N` (a child that takes longer
//! hangs; 120), `--binary FILE` (another build of the program), `--folder DIR` (where the cases work; by default in
//! memory where the system has /dev/shm), `--list`. It ends with exit code 1 if a case was silently different, panicked
//! or hung.
//!
//! A case starts the program as a person does (`depthloom report`, `run`, ...) in a private folder and looks at its
//! exit code, what it printed and every file it wrote. What it does is decided by the seed and the case's name, so that
//! a case that failed can be run again by itself; its folder is kept under `target/tmp/chaos`. Moments of kills and
//! signals depend on the machine, too: there the name decides the share of the run's time at which they come. Each case
//! is bounded in time and in what it may use; nothing leaves the machine.
//!
//! What a case can come to:
//! - **equal**: exit 0, and printed text and files are those of the undisturbed program;
//! - **error**: a non-zero exit code and a message;
//! - **said**: exit 0 with an answer of fewer frames, equal to that of a recording cut there, and a word that the
//!   recording is not whole;
//! - **silently different**: exit 0, another answer, and no word; or a promise that was not kept: an error without a
//!   message, an exit code that `--help` does not list, whole frames that cannot be read, a run that begun again ends
//!   otherwise;
//! - **panic**: a panic's text, exit code 101 or 134, an end by SIGABRT, SIGSEGV or their like, an allocation that
//!   failed (an end for want of memory in a thread's start, before any code of ours, is an error);
//! - **hang**: it took longer than `--seconds`.
//!
//! The heads of the areas' files say which answers are right there. What the answers are compared with is made at the
//! beginning by the same program, undisturbed, twice; where frames end in a recording is read by the MCAP specification
//! (`records.rs`), not by the program.

#[cfg(unix)]
mod answer;
#[cfg(unix)]
mod arguments;
#[cfg(unix)]
mod bits;
#[cfg(unix)]
mod case;
#[cfg(unix)]
mod child;
#[cfg(unix)]
mod ground;
#[cfg(unix)]
mod images;
#[cfg(unix)]
mod kills;
#[cfg(unix)]
mod left;
#[cfg(unix)]
mod limits;
#[cfg(unix)]
mod onnx;
#[cfg(unix)]
mod records;
#[cfg(unix)]
mod session;
#[cfg(unix)]
mod signals;
#[cfg(unix)]
mod streams;
#[cfg(unix)]
mod truncations;
#[cfg(unix)]
mod verdict;
#[cfg(unix)]
mod yaml;

#[cfg(unix)]
fn main() -> std::process::ExitCode {
    depthloom_test_needs::signals::restore_defaults();
    match arguments::parse(std::env::args().skip(1)) {
        Ok(arguments) => session::run(&arguments),
        Err(what) => {
            eprintln!("chaos: {what}");
            std::process::ExitCode::from(2)
        }
    }
}

#[cfg(not(unix))]
fn main() {
    depthloom_test_needs::skipped("chaos", "kills, signals and limits are those of Unix");
}
