//! A session: the areas, their cases on some threads, and what they came to.

use std::collections::BTreeMap;
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::arguments::Arguments;
use crate::case::{Case, copy_folder};
use crate::ground::Ground;
use crate::verdict::Verdict;
use crate::{bits, images, kills, limits, onnx, signals, streams, truncations, yaml};
use depthloom_test_needs::random::Random;

/// Cases of one kind.
struct Kind {
    name: &'static str,
    /// How many in the shortened run, and in the full one.
    counts: [usize; 2],
    run: fn(&mut Case<'_>) -> Verdict,
}

const fn kind(name: &'static str, short: usize, full: usize, run: fn(&mut Case<'_>) -> Verdict) -> Kind {
    Kind { name, counts: [short, full], run }
}

const KINDS: [Kind; 42] = [
    kind("bits/whole", 15, 2000, bits::whole),
    kind("bits/whole-head", 15, 2000, bits::whole_head),
    kind("bits/unfinished", 15, 2000, bits::unfinished),
    kind("bits/unfinished-head", 15, 2000, bits::unfinished_head),
    kind("bits/checkpoint", 10, 2000, bits::checkpoint),
    kind("truncations/anywhere", 15, 500, truncations::anywhere),
    kind("truncations/near-a-record", 15, 500, truncations::near_a_record),
    kind("truncations/zeros", 8, 200, truncations::zeros),
    kind("kills/street", 8, 150, kills::street),
    kind("kills/learning", 4, 75, kills::learning),
    kind("kills/report", 6, 100, kills::report),
    kind("signals/start", 4, 75, signals::at_the_start),
    kind("signals/frames", 4, 75, signals::among_frames),
    kind("signals/learning", 4, 75, signals::while_learning),
    kind("signals/analysis", 4, 75, signals::in_the_analysis),
    kind("signals/printing", 4, 75, signals::while_printing),
    kind("signals/ignored", 4, 50, signals::ignored),
    kind("limits/memory", 6, 150, limits::memory),
    kind("limits/descriptors", 6, 100, limits::descriptors),
    kind("limits/threads", 6, 100, limits::threads),
    kind("limits/file-size", 6, 100, limits::file_size),
    kind("limits/disk", 6, 100, limits::disk),
    kind("yaml/neutral", 8, 150, yaml::neutral),
    kind("yaml/broken", 6, 100, yaml::broken),
    kind("yaml/hostile", 15, 500, yaml::hostile),
    kind("yaml/values", 8, 200, yaml::values),
    kind("images/bits", 8, 200, images::bits),
    kind("images/cuts", 4, 100, images::cuts),
    kind("images/others", 8, 200, images::others),
    kind("images/jpegs", 4, 100, images::jpegs),
    kind("images/bombs", 4, 100, images::bombs),
    kind("images/calibrations", 4, 150, images::calibrations),
    kind("onnx/bits", 8, 200, onnx::bits),
    kind("onnx/cuts", 4, 100, onnx::cuts),
    kind("onnx/garbage", 4, 100, onnx::garbage),
    kind("onnx/shapes", 8, 200, onnx::shapes),
    kind("onnx/not-finite", 4, 50, onnx::not_finite),
    kind("streams/run", 6, 100, streams::run),
    kind("streams/report", 6, 50, streams::report),
    kind("streams/others", 6, 100, streams::others),
    kind("streams/no-files", 8, 100, streams::no_files),
    kind("streams/names", 4, 50, streams::names),
];

/// The time between two progress messages.
const PROGRESS_EVERY: Duration = Duration::from_secs(20);
/// At most this many folders of failed cases are stored: disks are finite.
const MOST_STORED: usize = 40;
static STORED: AtomicUsize = AtomicUsize::new(0);

/// How many cases of a kind came to what.
#[derive(Clone, Copy, Default)]
struct Tally {
    cases: u64,
    errors: u64,
    equal: u64,
    said: u64,
    different: u64,
    panics: u64,
    hangs: u64,
    skipped: u64,
}

impl Tally {
    fn add(&mut self, verdict: &Verdict) {
        self.cases += 1;
        *match verdict {
            Verdict::Equal => &mut self.equal,
            Verdict::Error => &mut self.errors,
            Verdict::Said => &mut self.said,
            Verdict::Skipped(_) => &mut self.skipped,
            Verdict::Different(_) => &mut self.different,
            Verdict::Panic(_) => &mut self.panics,
            Verdict::Hang(_) => &mut self.hangs,
        } += 1;
    }

    fn sum(self, other: Self) -> Self {
        Self {
            cases: self.cases + other.cases,
            errors: self.errors + other.errors,
            equal: self.equal + other.equal,
            said: self.said + other.said,
            different: self.different + other.different,
            panics: self.panics + other.panics,
            hangs: self.hangs + other.hangs,
            skipped: self.skipped + other.skipped,
        }
    }

    fn line(self, name: &str) -> String {
        let Self { cases, errors, equal, said, different, panics, hangs, skipped } = self;
        format!("{name:28}{cases:>7}{errors:>8}{equal:>8}{said:>8}{different:>11}{panics:>8}{hangs:>7}{skipped:>9}")
    }

    const fn faults(self) -> u64 {
        self.different + self.panics + self.hangs
    }
}

/// Runs the selected cases.
pub(crate) fn run(arguments: &Arguments) -> ExitCode {
    let cases = cases(arguments);
    if arguments.list {
        KINDS.iter().for_each(|kind| println!("{}: test", kind.name));
        return ExitCode::SUCCESS;
    }
    let root = folder(arguments);
    fs::create_dir_all(&root).expect("a folder for the cases can be made");
    let began = Instant::now();
    let ground = Ground::new(arguments.binary.clone(), root.clone(), arguments.patience);
    println!("chaos: {} cases with seed {} in {}", cases.len(), arguments.seed, root.display());
    let (next, found) = (AtomicUsize::new(0), Mutex::new(BTreeMap::<&str, Tally>::new()));
    let skips = Mutex::new(BTreeMap::<(&str, String), u64>::new());
    let reported = Mutex::new(began);
    let work = || {
        loop {
            let started = next.fetch_add(1, Ordering::Relaxed);
            let Some((kind, name)) = cases.get(started) else { break };
            report_progress(&reported, began, started, cases.len(), name);
            let verdict = one(arguments, &ground, kind, name);
            found.lock().unwrap_or_else(PoisonError::into_inner).entry(kind.name).or_default().add(&verdict);
            if let Verdict::Skipped(why) = verdict {
                *skips.lock().unwrap_or_else(PoisonError::into_inner).entry((kind.name, why)).or_default() += 1;
            }
        }
    };
    std::thread::scope(|scope| (0..arguments.jobs).for_each(|_| drop(scope.spawn(work))));
    let _ = fs::remove_dir_all(&root);

    for ((kind, why), count) in skips.into_inner().unwrap_or_else(PoisonError::into_inner) {
        depthloom_test_needs::skipped(&format!("chaos {kind}, {count} cases"), &why);
    }
    let found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    println!("\n{:28}  cases  errors   equal    said  different  panics  hangs  skipped", "");
    KINDS
        .iter()
        .filter_map(|kind| found.get_key_value(kind.name))
        .for_each(|(name, tally)| println!("{}", tally.line(name)));
    let all = found.values().copied().fold(Tally::default(), Tally::sum);
    println!("{}\n{:.0} s", all.line("all"), began.elapsed().as_secs_f64());
    ExitCode::from(u8::from(all.faults() > 0))
}

/// Reports the progress of the session, from time to time.
fn report_progress(reported: &Mutex<Instant>, began: Instant, started: usize, all: usize, name: &str) {
    let mut reported = reported.lock().unwrap_or_else(PoisonError::into_inner);
    if reported.elapsed() >= PROGRESS_EVERY {
        *reported = Instant::now();
        eprintln!("chaos: {started} of {all} cases started in {:.0} s, now {name}", began.elapsed().as_secs_f64());
    }
}

/// The selected cases, kind by kind.
fn cases(arguments: &Arguments) -> Vec<(&'static Kind, String)> {
    if let Some(case) = &arguments.case {
        let kind = KINDS.iter().find(|kind| case.strip_prefix(kind.name).is_some_and(|rest| rest.starts_with('/')));
        return kind.map(|kind| (kind, case.clone())).into_iter().collect();
    }
    let wanted = |kind: &&Kind| {
        arguments.only.is_empty() || arguments.only.iter().any(|only| kind.name.contains(only) || only == "chaos")
    };
    // The hermetic suite takes a quarter of the shortened run.
    let divisor = if arguments.full || depthloom_test_needs::is_full() { 1 } else { 4 };
    let default = |kind: &Kind| kind.counts[usize::from(arguments.full)].div_ceil(divisor);
    let count = |kind: &Kind| arguments.cases.unwrap_or(default(kind));
    let of_kind = |kind: &'static Kind| (0..count(kind)).map(move |index| (kind, format!("{}/{index}", kind.name)));
    KINDS.iter().filter(wanted).flat_map(of_kind).collect()
}

/// Runs a case; if it fails, reports it and stores its folder.
fn one(arguments: &Arguments, ground: &Ground, kind: &Kind, name: &str) -> Verdict {
    let home = ground.root.join(name.replace('/', "-"));
    let _ = fs::remove_dir_all(&home);
    let folder = home.join("in");
    fs::create_dir_all(&folder).expect("a folder for the case can be made");
    let mut case =
        Case { random: Random::new(arguments.seed, name), folder, home: home.clone(), ground, notes: Vec::new() };
    let verdict = catch_unwind(AssertUnwindSafe(|| (kind.run)(&mut case)))
        .unwrap_or_else(|_| Verdict::different("the case itself failed; see above"));
    let (what, why) = match &verdict {
        Verdict::Different(why) => ("SILENTLY DIFFERENT", why),
        Verdict::Panic(why) => ("PANIC", why),
        Verdict::Hang(why) => ("HANG", why),
        Verdict::Equal | Verdict::Error | Verdict::Said | Verdict::Skipped(_) if arguments.case.is_none() => {
            let _ = fs::remove_dir_all(&home);
            return verdict;
        }
        other => ("fine", &format!("{other:?}")),
    };
    let before = STORED.fetch_add(1, Ordering::Relaxed);
    let folder = if before < MOST_STORED || arguments.case.is_some() {
        store_folder(&home, name).display().to_string()
    } else {
        "no more".to_owned()
    };
    let notes = case.notes.join("\n    ");
    println!(
        "{what} {name}: {why}\n    {notes}\n    stored in: {folder}; repeat with: --seed {} --case {name}",
        arguments.seed
    );
    let _ = fs::remove_dir_all(&home);
    verdict
}

/// Copies a case's folder to a permanent place.
fn store_folder(home: &Path, name: &str) -> PathBuf {
    let copy = Path::new(env!("CARGO_TARGET_TMPDIR")).join("chaos").join(name.replace('/', "-"));
    let _ = fs::remove_dir_all(&copy);
    let _ = catch_unwind(|| copy_folder(home, &copy));
    copy
}

fn folder(arguments: &Arguments) -> PathBuf {
    let memory = Path::new("/dev/shm");
    let parent = match &arguments.folder {
        Some(folder) => folder.clone(),
        None if fs::metadata(memory).is_ok_and(|folder| folder.is_dir()) => memory.to_owned(),
        None => std::env::temp_dir(),
    };
    parent.join(format!("depthloom-chaos-{}", std::process::id()))
}
