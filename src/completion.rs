//! What a shell offers when somebody presses Tab: its script runs this program, which answers from the grammar, the kinds of its
//! registry, and the files that are there.

use std::ffi::OsStr;
use std::path::Path;

use clap_complete::CompleteEnv;
use clap_complete::engine::{ArgValueCandidates, CompletionCandidate, PathCompleter, ValueCompleter as _};
use depthloom_graphs::Registry;

use crate::exit::{Exit, Stop};

/// The environment variable by which a shell's script asks; not `COMPLETE`, which somebody may have set for something else.
pub const VARIABLE: &str = "DEPTHLOOM_COMPLETE";

/// Answers a shell's script, if it is one that asks.
pub fn answer(command: impl Fn() -> clap::Command) -> Result<bool, Stop> {
    let here = std::env::current_dir().ok();
    let asked = CompleteEnv::with_factory(command).var(VARIABLE).try_complete(std::env::args_os(), here.as_deref());
    asked.map_err(|error| Stop::because(Exit::Engine, "failed to complete", &error))
}

/// Experiment files, and folders on the way to them.
pub fn experiments() -> PathCompleter {
    PathCompleter::any().filter(|path| has_ending(path, &["yaml", "yml"]))
}

/// Runs, by name where they lie in the folder of runs; folders, on the way to others; recordings.
pub fn runs(begun: &OsStr) -> Vec<CompletionCandidate> {
    let paths = PathCompleter::any().filter(|path| path.is_dir() || has_ending(path, &["mcap"])).complete(begun);
    let named = crate::runs::all(Path::new(crate::runs::FOLDER)).unwrap_or_default();
    let names = named.into_iter().rev().map(|run| run.name).chain(["@latest".to_owned()]);
    let begins = |name: &String| begun.to_str().is_some_and(|begun| name.starts_with(begun));
    names.filter(begins).map(CompletionCandidate::new).chain(paths).collect()
}

/// Folders alone.
pub fn folders() -> PathCompleter {
    PathCompleter::dir()
}

/// The kinds of a registry, with a sentence each.
pub fn kinds(registry: &Registry) -> ArgValueCandidates {
    let sources = registry.sources().map(|source| (source.declaration.kind, source.declaration.summary));
    let nodes = registry.nodes().map(|node| (node.declaration.kind, node.declaration.summary));
    words(sources.chain(nodes))
}

/// All scores, with their formulas.
pub fn metrics() -> Vec<CompletionCandidate> {
    let metrics = depthloom_analysis::metrics();
    metrics.map(|metric| CompletionCandidate::new(metric.name).help(Some(metric.formula.into()))).collect()
}

/// The columns that any table of variants may have.
pub fn columns() -> Vec<CompletionCandidate> {
    let others = [("ms", "core-milliseconds a frame"), ("density", "share of true pixels that were answered")];
    let others = others.map(|(name, about)| CompletionCandidate::new(name).help(Some(about.into())));
    metrics().into_iter().chain(others).collect()
}

/// Words with a sentence each.
pub fn words<'a>(words: impl Iterator<Item = (&'a str, &'a str)>) -> ArgValueCandidates {
    let words: Vec<(String, String)> = words.map(|(word, about)| (word.to_owned(), about.to_owned())).collect();
    let candidate = |(word, about): &(String, String)| CompletionCandidate::new(word).help(Some(about.into()));
    ArgValueCandidates::new(move || words.iter().map(candidate).collect())
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.is_file() && path.extension().is_some_and(|ending| endings.iter().any(|wanted| ending == *wanted))
}
