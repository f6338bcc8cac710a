//! Completion on Tab: the script of a shell runs this program, which completes from the grammar, the kinds of its
//! registry, and existing files.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap_complete::CompleteEnv;
use clap_complete::engine::{ArgValueCandidates, CompletionCandidate, PathCompleter, ValueCompleter as _};
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_graphs::{Registry, language};
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_terminal::{CliError, ExitCode};

use crate::args::RunsFolder;

/// The environment variable that a shell's script sets. It is not `COMPLETE`, which other programs may use.
pub(crate) const VARIABLE: &str = "DEPTHLOOM_COMPLETE";

/// Set if a shell's script runs the program: clap removes the variable before it builds the command.
static IS_SHELL: OnceLock<()> = OnceLock::new();

/// Completes a command line, if a shell's script runs the program.
pub(crate) fn answer(command: impl Fn() -> clap::Command) -> Result<bool, CliError> {
    if std::env::var_os(VARIABLE).is_some() {
        IS_SHELL.get_or_init(|| ());
    }
    let here = std::env::current_dir().ok();
    let completed = CompleteEnv::with_factory(command).var(VARIABLE).try_complete(std::env::args_os(), here.as_deref());
    completed.map_err(|error| CliError::because(ExitCode::Engine, "failed to complete", &error))
}

/// Experiment files, and folders on the way to them.
pub(crate) fn experiments() -> PathCompleter {
    PathCompleter::any().filter(|path| has_ending(path, &["yaml", "yml"]))
}

/// Runs in the folder of runs by name, folders, and recordings.
pub(crate) fn runs(prefix: &OsStr) -> Vec<CompletionCandidate> {
    let paths = PathCompleter::any().filter(|path| path.is_dir() || has_ending(path, &["mcap"])).complete(prefix);
    let named = depthloom_runs::all(&runs_folder()).unwrap_or_default();
    let names = named.into_iter().rev().map(|run| run.name).chain(["@latest".to_owned()]);
    let begins = |name: &String| prefix.to_str().is_some_and(|prefix| name.starts_with(prefix));
    names.filter(begins).map(CompletionCandidate::new).chain(paths).collect()
}

/// Runs, and ONNX files.
pub(crate) fn inspectable(prefix: &OsStr) -> Vec<CompletionCandidate> {
    let networks = PathCompleter::any().filter(|path| has_ending(path, &["onnx", "db3"])).complete(prefix);
    runs(prefix).into_iter().chain(networks).collect()
}

/// The folder of runs: that of `--runs` on the command line that is being completed, or the default.
fn runs_folder() -> PathBuf {
    let words: Vec<_> = std::env::args_os().collect();
    let value = |at: usize| match words[at].to_str()?.strip_prefix("--runs")? {
        "" => words.get(at + 1).map(PathBuf::from),
        value => value.strip_prefix('=').map(PathBuf::from),
    };
    (0..words.len()).find_map(value).unwrap_or_else(RunsFolder::default_path)
}

/// Folders alone.
pub(crate) fn folders() -> PathCompleter {
    PathCompleter::dir()
}

/// The kinds of a registry, with one sentence each.
pub(crate) fn kinds(registry: &Registry) -> ArgValueCandidates {
    let sources = registry.sources().map(|source| (source.declaration.kind, source.declaration.summary));
    let nodes = registry.nodes().map(|node| (node.declaration.kind, node.declaration.summary));
    words(sources.chain(nodes))
}

/// All scores, with their formulas.
pub(crate) fn metrics() -> Vec<CompletionCandidate> {
    let metrics = depthloom_analysis::metrics();
    metrics.map(|metric| CompletionCandidate::new(metric.name).help(Some(metric.formula.into()))).collect()
}

/// The columns that any table of variants may have.
pub(crate) fn columns() -> Vec<CompletionCandidate> {
    let others =
        [("ms", "core-milliseconds per frame"), ("density", "share of pixels with ground truth that are valid")];
    let others = others.map(|(name, about)| CompletionCandidate::new(name).help(Some(about.into())));
    metrics().into_iter().chain(others).collect()
}

const OF_EXPERIMENTS: [&str; 5] = ["run", "check", "plan", "graph", "dora"];

/// Adds the contents of the experiment or the run on the command line, if a shell's script runs the program: `--set`
/// paths, variants, topics.
pub(crate) fn with_contents(command: clap::Command, registry: &Registry) -> clap::Command {
    if IS_SHELL.get().is_none() {
        return command;
    }
    // The words of the command line follow `--`: the program, the command, its arguments.
    let words: Vec<String> = std::env::args_os()
        .skip_while(|word| word != "--")
        .skip(2)
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    let Some((name, arguments)) = words.split_first() else { return command };
    if OF_EXPERIMENTS.contains(&name.as_str()) {
        let is_experiment = |word: &&String| has_ending(Path::new(word), &["yaml", "yml"]);
        let experiment = arguments.iter().find(is_experiment);
        let loaded =
            experiment.and_then(|path| language::load(Path::new(path), registry, &language::Options::default()).ok());
        let Some(plan) = loaded.map(|loaded| loaded.plan) else { return command };
        let (paths, variants) = (set_paths(&plan), named_variants(&plan.variants));
        return command.mut_subcommand(name, |command| {
            let command = command.mut_arg("set", |set| set.add(candidates(paths.clone())));
            let command = command.mut_arg("matrix", |matrix| matrix.add(candidates(paths)));
            command.mut_arg("variants", |variant| variant.add(candidates(variants)))
        });
    }
    let added = match name.as_str() {
        "export" => "topics",
        "figure" | "analyse" | "analyze" => "variant",
        _ => return command,
    };
    let run = arguments.iter().find(|word| !word.starts_with('-') && !word.is_empty());
    let recording = run
        .and_then(|run| depthloom_runs::recording_in(&runs_folder(), Path::new(run), name).ok())
        .and_then(|path| Recording::open(path).ok());
    let Some(recording) = recording else { return command };
    let plan = recording.plan();
    let values = if added == "topics" { topics(plan) } else { named_variants(&plan.variants) };
    command.mut_subcommand(name, |command| command.mut_arg(added, |arg| arg.add(candidates(values))))
}

/// The parameters that `--set` and `--matrix` can name, each with its `=`.
fn set_paths(plan: &Plan) -> Vec<String> {
    let mut paths = BTreeSet::new();
    let mut add = |owner: &str, params: &serde_json::Value| {
        let names = params.as_object().into_iter().flat_map(|params| params.keys());
        paths.extend(names.map(|name| format!("{owner}.{name}=")));
    };
    for run in &plan.runs {
        // Concatenated sources have the parameters of other sources.
        if let [part] = run.source.parts.as_slice() {
            add(&format!("sources.{}.with", run.source.name), &part.params);
        }
        for node in &run.nodes {
            // Parameters of metrics are set under `score` of the stage, for all its estimates.
            match node.kind.starts_with("score/") {
                true => add(&format!("{}.score", run.stage), &node.params),
                false => add(&format!("{}.{}.with", run.stage, node.name), &node.params),
            }
        }
    }
    paths.into_iter().collect()
}

/// The variants' names; empty if the only variant has no name.
fn named_variants(variants: &[String]) -> Vec<String> {
    variants.iter().filter(|name| !name.is_empty()).cloned().collect()
}

/// The recorded topics: by node and port, with one more part if several topics end alike, and in full.
fn topics(plan: &RecordedPlan) -> Vec<String> {
    let outputs = RunId::all(plan.runs.len()).flat_map(|run| plan.outputs(run)).map(|(_, output)| output);
    let all: Vec<&str> = outputs.filter(|output| output.recorded).map(|output| output.topic.as_str()).collect();
    let end = |topic: &str, parts: usize| {
        let starts: Vec<usize> = topic.match_indices('/').map(|(at, _)| at + 1).collect();
        topic[starts.len().checked_sub(parts).map_or(0, |first| starts[first])..].to_owned()
    };
    let is_shared = |topic: &str| all.iter().filter(|other| end(other, 2) == end(topic, 2)).count() > 1;
    let short = all.iter().map(|topic| end(topic, if is_shared(topic) { 3 } else { 2 }));
    short.chain(all.iter().map(|topic| (*topic).to_owned())).collect()
}

fn candidates(words: Vec<String>) -> ArgValueCandidates {
    ArgValueCandidates::new(move || words.iter().map(CompletionCandidate::new).collect())
}

pub(crate) fn words<'a>(words: impl Iterator<Item = (&'a str, &'a str)>) -> ArgValueCandidates {
    let words: Vec<(String, String)> = words.map(|(word, about)| (word.to_owned(), about.to_owned())).collect();
    let candidate = |(word, about): &(String, String)| CompletionCandidate::new(word).help(Some(about.into()));
    ArgValueCandidates::new(move || words.iter().map(candidate).collect())
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.is_file() && path.extension().is_some_and(|ending| endings.iter().any(|known| ending == *known))
}
