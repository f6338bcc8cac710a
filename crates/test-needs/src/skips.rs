//! Records of skipped tests, from all test programs of one `cargo test`, whichever run at once.
//!
//! A record is a file `target/skipped/<run>/<test>`. A run is the process that started the test program: one cargo
//! starts them all. Its
//! number alone would come again one day, so that the moment it started goes with it.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Says that a test did not run, and leaves a record of it.
///
/// # Panics
/// If the record cannot be written: a skip must not go unseen.
pub fn skipped(test: &str, why: &str) {
    // Not `eprintln!`: the test harness captures that alone.
    let line = format!("SKIPPED {test}: {why}\n");
    io::stderr().write_all(line.as_bytes()).expect("standard error is open");
    Records::of_this_run().add(test, why).expect("a skipped test leaves a record under target/skipped");
}

/// Where a run's records lie.
pub struct Records {
    folder: PathBuf,
    run: String,
}

impl Records {
    /// Those of the run that started this test program.
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

    /// What this run has skipped, by name, each `test: why`. Takes the records away, and those that runs left which are
    /// over: of one package alone, or stopped by a failure.
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
            } else if is_going_on(&name) {
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
    // The second field, the program's name in brackets, may hold anything; the moment is the 22nd.
    let started = stat.rsplit_once(')')?.1.split_whitespace().nth(19)?;
    Some(format!("{process}-{started}"))
}

fn is_going_on(run: &str) -> bool {
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
    fn what_other_runs_left_is_not_counted_and_goes_when_they_are_over() {
        let folder = tempfile::tempdir().expect("a folder");
        let going_on = run_of(parent()).expect("cargo runs");
        // A process of that number runs, but it is not the one that wrote the record.
        let number_came_again = format!("{}-1", parent());
        for run in [&going_on, &number_came_again, "4194305-7", "no number"] {
            Records::new(folder.path(), run).add("theirs", "no data").expect("written");
        }
        assert_eq!(Records::new(folder.path(), "1-1").take().expect("read"), [""; 0]);
        let left: Vec<_> =
            std::fs::read_dir(folder.path()).expect("read").flatten().map(|run| run.file_name()).collect();
        assert_eq!(left, [going_on.as_str()]);
    }
}
