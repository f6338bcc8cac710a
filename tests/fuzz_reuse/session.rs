//! Runs many sequences on all cores, and reports those that fail.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::files::{Files, differences};
use crate::minimise::minimise;
use crate::running::{Failure, PROGRAM, Runner, Statistics, typed, yaml_name};
use crate::sequence::{RunEnd, Sequence};

/// How often progress is printed.
const PROGRESS: Duration = Duration::from_secs(20);
/// At most this many failing sequences are minimised and stored; further ones are counted.
const MOST_STORED: usize = 12;

/// What is run.
pub(crate) struct Options {
    pub first_seed: u64,
    pub count: u64,
    pub jobs: usize,
    pub binary: PathBuf,
    /// A Python with the package `depthloom`.
    pub python: Option<PathBuf>,
}

/// Runs all sequences; fails if one does.
pub(crate) fn run(options: &Options) -> ExitCode {
    let root = root();
    let (next, failures) = (AtomicU64::new(0), AtomicUsize::new(0));
    let statistics = Mutex::new(Statistics::default());
    let (began, printed) = (Instant::now(), Mutex::new(Instant::now()));
    let Options { first_seed, count, .. } = *options;
    println!("reuse: {count} sequences with the seeds {first_seed} to {}", first_seed + count.max(1) - 1);
    let work = || {
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            if place >= count {
                return;
            }
            let runner = Runner {
                binary: options.binary.clone(),
                program: std::env::current_exe().expect("a test program has a path"),
                python: options.python.clone(),
                folder: root.join((first_seed + place).to_string()),
            };
            let sequence = Sequence::new(first_seed + place, options.python.is_some());
            match runner.run(&sequence) {
                Ok(of_sequence) => *statistics.lock().expect("no thread panicked") += of_sequence,
                Err(failure) => {
                    let before = failures.fetch_add(1, Ordering::Relaxed);
                    report(&runner, sequence, failure, before < MOST_STORED);
                }
            }
            let _ = fs::remove_dir_all(&runner.folder);
            let mut printed = printed.lock().expect("no thread panicked");
            if printed.elapsed() > PROGRESS {
                *printed = Instant::now();
                let (seconds, failures) = (began.elapsed().as_secs(), failures.load(Ordering::Relaxed));
                eprintln!("reuse: {place} of {count} sequences in {seconds} s, {failures} failed");
            }
        }
    };
    std::thread::scope(|scope| (0..options.jobs).for_each(|_| drop(scope.spawn(work))));
    let _ = fs::remove_dir_all(&root);
    let Statistics { sequences, compared, failed, resumed, refused, reused, .. } =
        statistics.into_inner().expect("no thread panicked");
    let failures = failures.into_inner();
    println!(
        "reuse: {sequences} sequences equal, {failures} failed; {compared} pairs of runs equal, {failed} pairs failed alike; \
         {resumed} partial runs resumed, {refused} refused after an edit; {reused} values reused; {} s",
        began.elapsed().as_secs()
    );
    // A test of nothing succeeds, too.
    let is_vacuous = failures == 0 && count >= 40 && (compared < count || failed > compared / 2 || reused < 10 * count);
    if is_vacuous {
        println!("reuse: too few runs completed or reused anything: the generator makes too many invalid experiments");
    }
    ExitCode::from(u8::from(failures > 0 || is_vacuous))
}

/// The folder that sequences are run in: in memory where there is such a file system.
fn root() -> PathBuf {
    let memory = Path::new("/dev/shm");
    let parent = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    parent.join(format!("depthloom-reuse-{}", std::process::id()))
}

/// Prints a failing sequence, as small as it can be made, and keeps its folder.
fn report(runner: &Runner, sequence: Sequence, failure: Failure, is_kept: bool) {
    let seed = sequence.seed;
    if !is_kept {
        println!("reuse: seed {seed} fails: {}", failure.what);
        return;
    }
    let (small, failure) = minimise(runner, sequence, failure);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz_reuse").join(seed.to_string());
    let _ = fs::remove_dir_all(&folder);
    let is_copied = copy_folder(&runner.folder, &folder).is_ok();
    let mut text = format!("\nreuse: seed {seed} fails in step {}: {}\n", failure.step, failure.what);
    let mut files = small.steps.first().map_or_else(Files::new, |step| step.state.files.clone());
    for (place, step) in small.steps.iter().enumerate() {
        let ending = match step.ending {
            RunEnd::Complete => String::new(),
            RunEnd::Cut(share) => {
                format!("  (then its recording is cut to {share} of its bytes, and the run is made partial)")
            }
            RunEnd::Killed(share) => format!("  (killed at {share} of the bytes of its recording)"),
        };
        text.push_str(&format!("  step {place}: {}\n    {}{ending}\n", step.edits.join("; "), typed(place, step)));
        differences(&files, &step.state.files).iter().for_each(|line| text.push_str(&format!("    file {line}\n")));
        files.clone_from(&step.state.files);
        text.push_str(&format!("    {}:\n", yaml_name(place)));
        step.state.experiment.yaml(PROGRAM).lines().for_each(|line| text.push_str(&format!("      {line}\n")));
    }
    if is_copied {
        text.push_str(&format!("  stored in {}\n", folder.display()));
    }
    text.push_str(&format!(
        "  run it again: DEPTHLOOM_FUZZ_REUSE_SEED={seed} DEPTHLOOM_FUZZ_REUSE=1 cargo test --release --test fuzz_reuse\n"
    ));
    println!("{text}");
}

fn copy_folder(from: &Path, to: &Path) -> std::io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copy_folder(&entry.path(), &target)?;
        } else if entry.file_type()?.is_file() {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}
