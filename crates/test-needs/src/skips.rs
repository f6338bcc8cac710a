//! Records of skipped tests, from all test programs of one `cargo test`.
//!
//! A record is a file `target/skipped/<run>/<test>`. A run is the process that started the test program: one cargo
//! starts all of them. Process numbers repeat, so a run is identified by number and start time.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Reports that a test did not run, and leaves a record of it.
///
/// # Panics
/// If the record cannot be written: a skip must not go unseen.
pub fn skipped(test: &str, why: &str) {
    // Not `eprintln!`, because the test harness captures it.
    let line = format!("SKIPPED {test}: {why}\n");
    io::stderr().write_all(line.as_bytes()).expect("standard error is open");
    Records::of_this_run().add(test, why).expect("a skipped test leaves a record under target/skipped");
}

/// The folder of a run's records.
pub struct Records {
    folder: PathBuf,
    run: String,
}

impl Records {
    /// The records of the run that started this test program.
    #[must_use]
    pub fn of_this_run() -> Self {
        let parent = parent();
        Self::new(&crate::target().join("skipped"), &run_of(parent).unwrap_or_else(|| parent.to_string()))
    }

    fn new(folder: &Path, run: &str) -> Self {
        Self { folder: folder.to_owned(), run: run.to_owned() }
    }

    fn add(&self, test: &str, why: &str) -> io::Result<()> {
        let run = self.folder.join(&self.run);
        fs::create_dir_all(&run)?;
        let name = test.replace(|c: char| !c.is_alphanumeric(), "_");
        fs::write(run.join(name), format!("{test}: {why}"))
    }

    /// The skipped tests of this run, sorted, each `test: why`. Removes their records, and records of other runs that
    /// have ended (runs of a single package, or stopped by a failure).
    ///
    /// # Errors
    /// If a record cannot be read or removed.
    pub fn take(&self) -> io::Result<Vec<String>> {
        let mut skipped = Vec::new();
        for run in entries(&self.folder)? {
            let name = run.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name == self.run {
                for record in entries(&run)? {
                    skipped.push(fs::read_to_string(record)?);
                }
            } else if is_running(&name) {
                continue;
            }
            match fs::remove_dir_all(&run) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        skipped.sort_unstable();
        Ok(skipped)
    }
}

fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| entry.map(|entry| entry.path())).collect(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

#[cfg(unix)]
fn parent() -> u32 {
    std::os::unix::process::parent_id()
}

#[cfg(not(unix))]
fn parent() -> u32 {
    0
}

/// A process as number and start time; `None` if it has ended or the system does not report it.
fn run_of(process: u32) -> Option<String> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The second field, the program's name in brackets, may contain anything; the start time is the 22nd.
    let started = stat.rsplit_once(')')?.1.split_whitespace().nth(19)?;
    Some(format!("{process}-{started}"))
}

fn is_running(run: &str) -> bool {
    let process = run.split('-').next().and_then(|number| number.parse().ok());
    process.and_then(run_of).is_some_and(|now| now == run)
}

#[cfg(test)]
mod tests {
    use super::{Records, parent, run_of};

    #[test]
    fn a_run_counts_its_own_skips_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let ours = Records::new(folder.path(), "1-1");
        ours.add("the digest of mono/onnx", "no engine").expect("written");
        ours.add("another", "no data").expect("written");
        ours.add("another", "no data").expect("written");
        assert_eq!(ours.take().expect("read"), ["another: no data", "the digest of mono/onnx: no engine"]);
        assert_eq!(ours.take().expect("read"), [""; 0]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn records_of_ended_runs_are_removed_without_being_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let running = run_of(parent()).expect("cargo runs");
        // A running process has this number, but another start time than the one that wrote the record.
        let reused_number = format!("{}-1", parent());
        for run in [&running, &reused_number, "4194305-7", "no number"] {
            Records::new(folder.path(), run).add("theirs", "no data").expect("written");
        }
        assert_eq!(Records::new(folder.path(), "1-1").take().expect("read"), [""; 0]);
        let remaining: Vec<_> =
            std::fs::read_dir(folder.path()).expect("read").flatten().map(|run| run.file_name()).collect();
        assert_eq!(remaining, [running.as_str()]);
    }
}
