//! What a shell offers when somebody presses Tab: its script runs this program, which answers from the grammar, the
//! kinds of its registry, and the files that are there.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::Path;
use std::sync::OnceLock;

use clap_complete::CompleteEnv;
use clap_complete::engine::{ArgValueCandidates, CompletionCandidate, PathCompleter, ValueCompleter as _};
use depthloom_graphs::plan::{Plan, RunId};
use depthloom_graphs::{Registry, language};
use depthloom_recording::{RecordedPlan, Recording};
use depthloom_runs::recording_of;
use depthloom_terminal::{CliError, ExitCode};

/// The environment variable by which a shell's script asks; not `COMPLETE`, which somebody may have set for something
/// else.
pub(crate) const VARIABLE: &str = "DEPTHLOOM_COMPLETE";

/// Set if a shell's script asks: clap removes the variable before it builds the command.
static IS_SHELL: OnceLock<()> = OnceLock::new();

/// Answers a shell's script, if it is one that asks.
pub(crate) fn answer(command: impl Fn() -> clap::Command) -> Result<bool, CliError> {
    if std::env::var_os(VARIABLE).is_some() {
        IS_SHELL.get_or_init(|| ());
    }
    let here = std::env::current_dir().ok();
    let asked = CompleteEnv::with_factory(command).var(VARIABLE).try_complete(std::env::args_os(), here.as_deref());
    asked.map_err(|error| CliError::because(ExitCode::Engine, "failed to complete", &error))
}

/// Experiment files, and folders on the way to them.
pub(crate) fn experiments() -> PathCompleter {
    PathCompleter::any().filter(|path| has_ending(path, &["yaml", "yml"]))
}

/// Runs, by name where they lie in the folder of runs; folders, on the way to others; recordings.
pub(crate) fn runs(begun: &OsStr) -> Vec<CompletionCandidate> {
    let paths = PathCompleter::any().filter(|path| path.is_dir() || has_ending(path, &["mcap"])).complete(begun);
    let named = depthloom_runs::all(Path::new(depthloom_runs::FOLDER)).unwrap_or_default();
    let names = named.into_iter().rev().map(|run| run.name).chain(["@latest".to_owned()]);
    let begins = |name: &String| begun.to_str().is_some_and(|begun| name.starts_with(begun));
    names.filter(begins).map(CompletionCandidate::new).chain(paths).collect()
}

/// Folders alone.
pub(crate) fn folders() -> PathCompleter {
    PathCompleter::dir()
}

/// The kinds of a registry, with a sentence each.
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
    let others = [("ms", "core-milliseconds a frame"), ("density", "share of pixels with ground truth that are valid")];
    let others = others.map(|(name, about)| CompletionCandidate::new(name).help(Some(about.into())));
    metrics().into_iter().chain(others).collect()
}

const OF_EXPERIMENTS: [&str; 5] = ["run", "check", "plan", "graph", "dora"];

/// Adds what the experiment or the run on the command line has, where a shell's script asks for it: `--set` paths,
/// variants, topics.
pub(crate) fn with_contents(command: clap::Command, registry: &Registry) -> clap::Command {
    if IS_SHELL.get().is_none() {
        return command;
    }
    // The words of the command line follow `--`: the program, the command, and what is given to it.
    let words: Vec<String> = std::env::args_os()
        .skip_while(|word| word != "--")
        .skip(2)
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    let Some((name, given)) = words.split_first() else { return command };
    if OF_EXPERIMENTS.contains(&name.as_str()) {
        let is_experiment = |word: &&String| has_ending(Path::new(word), &["yaml", "yml"]);
        let experiment = given.iter().find(is_experiment);
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
        "figure" | "analyse" => "variant",
        _ => return command,
    };
    let run = given.iter().find(|word| !word.starts_with('-') && !word.is_empty());
    let recording =
        run.and_then(|run| recording_of(Path::new(run), name).ok()).and_then(|path| Recording::open(path).ok());
    let Some(recording) = recording else { return command };
    let plan = recording.plan();
    let of_run = if added == "topics" { topics(plan) } else { named_variants(&plan.variants) };
    command.mut_subcommand(name, |command| command.mut_arg(added, |arg| arg.add(candidates(of_run))))
}

/// The parameters that `--set` and `--matrix` can name, each with its `=`.
fn set_paths(plan: &Plan) -> Vec<String> {
    let mut paths = BTreeSet::new();
    let mut add = |owner: &str, params: &serde_json::Value| {
        let names = params.as_object().into_iter().flat_map(|params| params.keys());
        paths.extend(names.map(|name| format!("{owner}.{name}=")));
    };
    for run in &plan.runs {
        // Parameters of sources that are joined are those of other sources.
        if let [part] = run.source.parts.as_slice() {
            add(&format!("sources.{}.with", run.source.name), &part.params);
        }
        for node in &run.nodes {
            // What a stage scores is set under `score`, for all its estimates.
            match node.kind.starts_with("score/") {
                true => add(&format!("{}.score", run.stage), &node.params),
                false => add(&format!("{}.{}.with", run.stage, node.name), &node.params),
            }
        }
    }
    paths.into_iter().collect()
}

/// The variants' names; none where there is only the one without a name.
fn named_variants(variants: &[String]) -> Vec<String> {
    variants.iter().filter(|name| !name.is_empty()).cloned().collect()
}

/// The recorded topics: by node and port, with the folder before these where several topics end alike, and in whole.
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
    path.is_file() && path.extension().is_some_and(|ending| endings.iter().any(|wanted| ending == *wanted))
}
