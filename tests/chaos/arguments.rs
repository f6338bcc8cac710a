//! The arguments: our own, and those that `cargo test` hands to every test program.

use std::path::PathBuf;
use std::time::Duration;

/// The arguments of the program.
pub(crate) struct Arguments {
    pub seed: u64,
    /// Ten thousand cases, not some hundred.
    pub full: bool,
    /// The number of cases of each kind.
    pub cases: Option<usize>,
    /// Only areas and kinds whose name holds one of these.
    pub only: Vec<String>,
    /// This case alone.
    pub case: Option<String>,
    pub jobs: usize,
    pub patience: Duration,
    pub binary: PathBuf,
    pub folder: Option<PathBuf>,
    pub list: bool,
}

/// Reads the arguments.
pub(crate) fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Arguments, String> {
    let mut found = Arguments {
        seed: 1,
        full: false,
        cases: None,
        only: Vec::new(),
        case: None,
        jobs: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
        patience: Duration::from_secs(120),
        binary: PathBuf::from(env!("CARGO_BIN_EXE_depthloom")),
        folder: None,
        list: false,
    };
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or_else(|| format!("{argument} needs a value"));
        let number = |text: String| text.parse().map_err(|_| format!("{argument} takes a number, not `{text}`"));
        match argument.as_str() {
            "--seed" => found.seed = number(value()?)?,
            "--full" => found.full = true,
            "--cases" => found.cases = Some(number(value()?)? as usize),
            "--only" => found.only.push(value()?),
            "--case" => found.case = Some(value()?),
            "--jobs" => found.jobs = (number(value()?)? as usize).max(1),
            "--seconds" => found.patience = Duration::from_secs(number(value()?)?),
            "--binary" => found.binary = PathBuf::from(value()?).canonicalize().map_err(|error| error.to_string())?,
            "--folder" => found.folder = Some(PathBuf::from(value()?)),
            "--list" => found.list = true,
            // What `cargo test -- ...` gives all test programs and has no meaning here.
            "--test-threads" | "--skip" | "--format" | "--color" => drop(value()?),
            known if known.starts_with('-') => {}
            filter => found.only.push(filter.to_owned()),
        }
    }
    Ok(found)
}
