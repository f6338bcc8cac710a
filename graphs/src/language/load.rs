//! From a file to a plan.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::blame;
use super::change::apply::{self, Change};
use super::change::outlasted::Outlasted;
use super::change::overrides::{self, Argument};
use super::change::parameter::Parameters;
use super::change::path::Scope;
use super::change::variant::Variant;
use super::change::variants;
use super::check::params::Resolver;
use super::check::spec;
use super::check::sweeps::Sweeps;
use super::labels;
use super::plan::assemble;
use super::plan::link;
use super::plan::linked::Linked;
use super::plan::record;
use super::plan::share::{self, Overruled, Shared};
use super::plan::upstream;
use super::text::diagnostics::{Diagnostic, Diagnostics, Report, Severity};
use super::text::environment;
use super::text::files::Files;
use super::text::resolved;
use super::text::run_files;
use super::text::tree::Node;
use super::unused::{Declared, MOST_VALUES};
use crate::plan::{Plan, VariantId};
use crate::registry::Registry;

/// Checking stops after errors in this number of variants.
const ENOUGH_VARIANTS: usize = 200;

/// What decides an experiment besides the file.
pub struct Options<'a> {
    /// `--set path=value`, in order: path and value.
    pub set: Vec<(String, String)>,
    /// `--matrix path=[values]`, in order, after `--set`: an axis (name or path) and its values.
    pub matrix: Vec<(String, String)>,
    /// `--variant`: patterns of variants' names (`*` for any characters); all variants if empty.
    pub only: Vec<String>,
    /// The text of an experiment without a file; relative paths start at the working directory.
    pub text: Option<String>,
    /// Texts that replace files on disk, by path: an editor has not saved them yet.
    pub open_texts: Vec<(PathBuf, String)>,
    /// Looks up an environment variable.
    pub env: Environment<'a>,
}

/// Looks up an environment variable.
pub type Environment<'a> = Box<dyn Fn(&str) -> Option<String> + 'a>;

impl Default for Options<'_> {
    fn default() -> Self {
        // A value that is not UTF-8 keeps a replacement character, and is refused where it is used.
        let env = |name: &str| std::env::var_os(name).map(|value| value.to_string_lossy().into_owned());
        let (set, matrix, only, open_texts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { set, matrix, only, text: None, open_texts, env: Box::new(env) }
    }
}

/// An experiment that can be run.
#[derive(Debug)]
pub struct Loaded {
    /// The plan to run.
    pub plan: Plan,
    /// Probable mistakes.
    pub warnings: Diagnostics,
    /// The files that a run stores, by name (`experiment.yaml`, `experiment/base.yaml`, `experiment.resolved.yaml`) and
    /// text. They can be checked and run from any folder.
    pub stored: Vec<(String, String)>,
    /// The files it was read from, and the files and folders that it names, from the working directory.
    pub read: Vec<PathBuf>,
}

/// Reads an experiment, checks it against the kinds of a registry, and plans it.
///
/// `--set` changes the experiment before its variants do. A variant that sets the same path keeps its value, with a
/// warning; if all of them do, `--set` is an error.
///
/// # Errors
/// Everything that is wrong with it. Invalid YAML and unreadable files end the check early.
pub fn load(path: &Path, registry: &Registry, options: &Options<'_>) -> Result<Loaded, Diagnostics> {
    let arguments = Argument::all(&options.set, &options.matrix);
    let looked_at = |arguments: &[Argument]| look_at(path, registry, options, arguments);
    looked_at(&arguments).map_err(|found| {
        blame::pointed(found, &arguments, |argument| {
            let rest = [&arguments[..argument], &arguments[argument + 1..]].concat();
            looked_at(&rest).map_or_else(|wrong| wrong, |loaded| loaded.warnings)
        })
    })
}

struct Arguments<'a> {
    typed: &'a [Argument],
    changes: &'a [Change],
    only: Option<Node>,
}

fn look_at(path: &Path, registry: &Registry, options: &Options<'_>, typed: &[Argument]) -> Result<Loaded, Diagnostics> {
    let env = &*options.env;
    let mut report = Report::default();
    let mut files = Files::new(env);
    if let Some(text) = &options.text {
        files.add_text(path, text);
    }
    options.open_texts.iter().for_each(|(path, text)| files.add_text(path, text));
    let (changes, set_files) = overrides::changes(typed, &mut report);
    let (only, only_files) = overrides::only(&options.only);
    let arguments = Arguments { typed, changes: &changes, only };
    let planned = planned(path, registry, env, arguments, &mut files, &mut report);
    let mut order = files.sources();
    order.extend(set_files.into_iter().chain(only_files));
    let mut diagnostics = report.finish(&order);
    for diagnostic in &mut diagnostics.0 {
        if !diagnostic.place.span.is_empty() {
            diagnostic.key_path = files.key_path(&diagnostic.place).unwrap_or_default();
        }
    }
    match planned {
        Some(loaded) if !diagnostics.has_errors() => Ok(Loaded { warnings: diagnostics, ..loaded }),
        _ => Err(diagnostics),
    }
}

fn planned(
    path: &Path,
    registry: &Registry,
    env: &environment::Lookup<'_>,
    Arguments { typed, changes, only }: Arguments<'_>,
    files: &mut Files<'_>,
    report: &mut Report,
) -> Option<Loaded> {
    let root = files.experiment(path, report)?;
    if files.is_broken() {
        return None;
    }
    let mut root = apply::apply(&root, changes, Scope::CommandLine, report);
    if let Some(only) = &only {
        overrides::choose(&mut root, only);
    }
    let root = environment::substitute(&root, env, report);
    let (experiment, description) = spec::title(&root, report);
    let recording = record::read(&root, report);
    let labels = labels::read(&root, report);
    let (variants, left_out) = variants::read(&Parameters { root: &root, registry }, report);
    if root.size().saturating_mul(variants.len()) > MOST_VALUES {
        let what = format!("{} variants of an experiment this large are too many", variants.len());
        let help = "reduce the values of `matrix`, or split the experiment";
        report.push(Diagnostic::error(&variants[0].place, what).help(help));
        return None;
    }
    let mut outlasted = Outlasted::new(&root, changes);
    let mut sweeps = Sweeps::default();
    let mut resolver = Resolver::default();
    let mut linked: Vec<Linked<'_>> = Vec::with_capacity(variants.len());
    for (id, variant) in VariantId::enumerate(&variants) {
        let before = report.len();
        let changed = apply::apply(&root, &variant.changes, Scope::Variant, report);
        outlasted.look(id, &root, &changed);
        resolver.changed = variant.changes.iter().map(|change| change.value.place.clone()).collect();
        let spec = spec::read(&changed, registry, report);
        let link = link::link(&spec, registry, &mut resolver, report);
        sweeps.look(&spec, |id| link.stages[id.stage].nodes[id.node].types.parameters.as_deref());
        linked.push(link);
        if id.0 > 0 {
            report.in_variant(before, variant);
        }
        // The other variants are likely to have the same errors.
        if report.is_full() || id.0 >= ENOUGH_VARIANTS && report.has_errors() {
            return None;
        }
    }
    outlasted.report(&root, &variants, report);
    let declared = Declared { root: &root, left_out: &left_out, recording: &recording, registry };
    let live = declared.report(&mut linked, report);
    if report.has_errors() {
        return None;
    }
    sweeps.report(report);
    let names: Vec<String> = variants.iter().map(|variant| variant.name.clone()).collect();
    let shared = share::share(&linked, &live);
    let runs = assemble::stage_runs(&shared, &names, &linked, &recording);
    upstream::check(&runs, &shared.runs, &names, registry, report);
    equal_variants(&variants, &shared, report);
    let named = labels::Named { labels: &labels, runs: &runs, chosen: &variants, left_out: &left_out };
    labels::check(&root, named, report);
    overruled(&names, &shared, report);
    let stored = run_files::texts(files, &root, &overrides::typed(typed, only.as_ref()), &resolver.anywhere);
    let has_factors = variants.iter().any(|variant| !variant.factors.is_empty());
    let plan = Plan {
        experiment,
        description,
        variants: names,
        factors: if has_factors {
            variants.iter().map(|variant| variant.factors.clone()).collect()
        } else {
            Vec::new()
        },
        labels,
        runs,
        record: recording.record,
        written: files.written(),
        resolved: resolved::yaml(&root, None),
    };
    let read = files.paths().chain(resolver.contents.named()).map(Path::to_owned).collect();
    Some(Loaded { plan, warnings: Diagnostics::default(), stored, read })
}

fn equal_variants(variants: &[Variant], shared: &Shared<'_>, report: &mut Report) {
    let mut seen: HashMap<&Vec<share::PlacedStage>, &Variant> = HashMap::new();
    for (variant, placed) in variants.iter().zip(&shared.placed) {
        match seen.get(placed) {
            Some(first) => {
                let what = format!("variant `{}` is the same experiment as `{}`", variant.name, first.name);
                let warning = Diagnostic::warning(&variant.place, what).label("computes nothing of its own");
                report.push(warning.help("remove it, or change what it was meant to change"));
            }
            None => {
                seen.insert(placed, variant);
            }
        }
    }
}

fn overruled(names: &[String], shared: &Shared<'_>, report: &mut Report) {
    for overruled in &shared.overruled {
        let Overruled { node, place, variant, first } = overruled;
        let what = format!("node `{node}` differs from `{first}` in parameters alone that decide no result");
        let variant =
            if names[*variant].is_empty() { String::new() } else { format!(" of variant `{}`", names[*variant]) };
        let help = format!("they are one node, run with the parameters of `{first}`{variant}; give both the same");
        report.push(Diagnostic::warning(place, what).label("its own are not used").help(help));
    }
}

impl Report {
    /// Names the variant of each diagnostic from `first` on, unless its place does.
    fn in_variant(&mut self, first: usize, variant: &Variant) {
        let own = |diagnostic: &Diagnostic| {
            let place = &diagnostic.place;
            variant.changes.iter().any(|own| own.place.contains(place) || own.value.place.contains(place))
        };
        for diagnostic in self.since(first).filter(|d| d.severity == Severity::Error && !own(d)) {
            diagnostic.message = format!("{} (in variant `{}`)", diagnostic.message, variant.name);
        }
    }
}
