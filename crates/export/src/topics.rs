//! Which topics are exported, and as what.

use std::collections::BTreeSet;
use std::path::PathBuf;

use depthloom_graphs::ValueType;
use depthloom_graphs::contracts::Slot;
use depthloom_graphs::language::{glob, nearest};
use depthloom_graphs::plan::RunId;
use depthloom_recording::Recording;
use depthloom_terminal::{CliError, ExitCode};

use crate::ExportFormat;
use crate::form::formats_of;
use depthloom_runs::file_name;

/// Number of topics that a message lists.
const MOST_LISTED: usize = 8;

/// A topic that is exported.
pub struct Chosen<'a> {
    /// The stage run.
    pub run: RunId,
    /// The output port.
    pub slot: Slot,
    /// The topic.
    pub topic: &'a str,
    /// The requested name: the topic's own, or that of a variant that shares it.
    pub name: &'a str,
    /// Its unique path in the folder, from the parts of its name.
    pub path: PathBuf,
    /// What it carries.
    pub value_type: ValueType,
    /// As what.
    pub formats: Vec<ExportFormat>,
}

impl Chosen<'_> {
    /// The file that it is, where it is one: its path with that ending.
    pub fn path_with(&self, ending: &str) -> PathBuf {
        let mut path = self.path.clone().into_os_string();
        path.push(".");
        path.push(ending);
        path.into()
    }
}

/// The topics that match `patterns` (all topics without patterns), in those of `formats` that they support, or in their
/// usual one.
///
/// A pattern names a topic (`/look/depth/depth`), or by its end the topic or its node: `depth/depth`, `depth`; `*`
/// stands for any run of characters. An output of the source is named by itself, too (`calibration`), where no node has
/// that name.
///
/// # Errors
/// If a pattern names nothing, or nothing that was recorded and has one of the formats.
pub fn chosen<'a>(
    recording: &'a Recording,
    patterns: &[String],
    formats: &[ExportFormat],
) -> Result<Vec<Chosen<'a>>, CliError> {
    let outputs: Vec<Output<'a>> = outputs(recording);
    let patterns: &Vec<String> = &patterns.iter().map(|pattern| of_source(pattern, &outputs)).collect();
    patterns.iter().try_for_each(|pattern| check(pattern, &outputs, formats))?;
    let mut paths = BTreeSet::new();
    let mut chosen = Vec::new();
    for output in outputs.iter().filter(|output| output.recorded) {
        let Some(value_type) = output.value_type else { continue };
        let formats = output.formats(formats);
        if formats.is_empty() {
            continue;
        }
        for name in output.names_by(patterns) {
            let path = own_path(name, &mut paths);
            let Output { run, slot, .. } = *output;
            let topic = output.names[0];
            chosen.push(Chosen { run, slot, topic, name, path, value_type, formats: formats.clone() });
        }
    }
    if chosen.is_empty() {
        let requested = if formats.is_empty() { String::new() } else { format!(" as {}", named(formats)) };
        return Err(CliError::usage(
            format!("nothing that was recorded can be exported{requested}"),
            "`depthloom inspect RUN` lists what was recorded",
        ));
    }
    Ok(chosen)
}

struct Output<'a> {
    run: RunId,
    slot: Slot,
    /// Its topic, then the aliases.
    names: Vec<&'a str>,
    recorded: bool,
    /// Whether the recording can have values of it: that of an interrupted run lacks those of later stages.
    has_values: bool,
    value_type: Option<ValueType>,
}

fn outputs(recording: &Recording) -> Vec<Output<'_>> {
    let plan = recording.plan();
    let has_aggregate = |run, slot| {
        let mut values = recording.aggregate_values().iter();
        values.any(|value| value.run == run && slot == Slot::Node { node: value.node, port: value.port })
    };
    let of_run = |run| {
        plan.outputs(run).map(move |(slot, output)| {
            let aliases = output.aliases.iter().map(String::as_str).filter(|alias| *alias != output.topic);
            let names = std::iter::once(output.topic.as_str()).chain(aliases).collect();
            let has_values = output.recorded
                && if output.once { has_aggregate(run, slot) } else { !recording.frames(run).is_empty() };
            Output { run, slot, names, recorded: output.recorded, has_values, value_type: output.value_type() }
        })
    };
    RunId::all(plan.runs.len()).flat_map(of_run).collect()
}

impl<'a> Output<'a> {
    /// Those of the formats that it has, or its usual one.
    fn formats(&self, requested: &[ExportFormat]) -> Vec<ExportFormat> {
        let has = self.value_type.map_or(&[][..], formats_of);
        match requested {
            [] => has.first().copied().into_iter().collect(),
            requested => has.iter().filter(|format| requested.contains(format)).copied().collect(),
        }
    }

    fn name_by(&self, pattern: &str) -> Option<&'a str> {
        self.names.iter().copied().find(|name| is_of(pattern, name))
    }

    /// The names by which patterns ask for it, each once: of what a pattern means by several names the first.
    fn names_by(&self, patterns: &[String]) -> Vec<&'a str> {
        let mut names: Vec<&str> = Vec::new();
        if patterns.is_empty() {
            names.extend(self.names.first());
        }
        for name in patterns.iter().filter_map(|pattern| self.name_by(pattern)) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }
}

/// A pattern, with `source/` before it where it is an output of the source and names nothing otherwise: `calibration`
/// is `source/calibration`.
fn of_source(pattern: &str, outputs: &[Output<'_>]) -> String {
    let names_any = |pattern: &str| outputs.iter().any(|output| output.name_by(pattern).is_some());
    let in_source = format!("source/{pattern}");
    if !pattern.starts_with('/') && !names_any(pattern) && names_any(&in_source) {
        in_source
    } else {
        pattern.to_owned()
    }
}

fn is_of(pattern: &str, topic: &str) -> bool {
    if pattern.starts_with('/') {
        return glob(pattern, topic);
    }
    let node = topic.rsplit_once('/').map_or(topic, |(node, _)| node);
    let ends = |name: &str, parts| {
        let mut ends = name.match_indices('/').map(|(at, _)| &name[at + 1..]);
        ends.any(|end| end.split('/').count() >= parts && glob(pattern, end))
    };
    // The name of a port alone does not match: `depth` is the node, not every output of depths.
    ends(topic, 2) || ends(node, 1)
}

/// That a pattern names something that can be exported so.
fn check(pattern: &str, outputs: &[Output<'_>], formats: &[ExportFormat]) -> Result<(), CliError> {
    let named_by: Vec<&Output<'_>> = outputs.iter().filter(|output| output.name_by(pattern).is_some()).collect();
    let Some(any) = named_by.first() else { return Err(unknown(pattern, outputs)) };
    let recorded: Vec<&Output<'_>> = named_by.iter().copied().filter(|output| output.recorded).collect();
    let Some(first) = recorded.first() else {
        return Err(CliError::usage(
            format!("topic {} was not recorded", any.names[0]),
            "let `record:` keep it, and run the experiment again",
        ));
    };
    if recorded.iter().any(|output| !output.formats(formats).is_empty()) {
        return Ok(());
    }
    let carries = first.value_type.map_or("what this version does not know", ValueType::name);
    let owner = format!("topic {} carries {carries}", first.names[0]);
    Err(match first.value_type.map_or(&[][..], formats_of) {
        [] => CliError::new(ExitCode::Usage, format!("{owner}, which is not exported")),
        has => CliError::usage(
            format!("{owner}, which is not exported as {}", named(formats)),
            format!("it can be {}", named(has)),
        ),
    })
}

/// The error for a pattern without a match: suggests a topic that the recording has, or lists them.
fn unknown(pattern: &str, outputs: &[Output<'_>]) -> CliError {
    let available = || outputs.iter().filter(|output| output.has_values);
    let ends = available().flat_map(|output| &output.names).flat_map(|name| ends_of(name));
    let topics: Vec<&str> = available().map(|output| output.names[0]).collect();
    if topics.is_empty() {
        return CliError::usage(format!("the run has no topic `{pattern}`"), "the recording has no topic with values");
    }
    let others = if topics.len() > MOST_LISTED { ", ... (`depthloom inspect RUN` has all)" } else { "" };
    let has = format!("it has {}{others}", topics[..topics.len().min(MOST_LISTED)].join(", "));
    CliError::unknown(format!("the run has no topic `{pattern}`"), nearest(pattern, ends), has)
}

/// A topic, its ends, and its node: what a pattern without `*` may be.
fn ends_of(topic: &str) -> impl Iterator<Item = &str> {
    let ends = topic.match_indices('/').map(|(at, _)| &topic[at + 1..]).filter(|end| end.contains('/'));
    let node = topic.rsplit('/').nth(1);
    std::iter::once(topic).chain(ends).chain(node)
}

fn named(formats: &[ExportFormat]) -> String {
    formats.iter().map(|format| format.name()).collect::<Vec<_>>().join(", ")
}

/// The parts of a topic's name as a path, which gets a number if another has the same.
fn own_path(name: &str, taken: &mut BTreeSet<PathBuf>) -> PathBuf {
    let path: PathBuf = name.split('/').filter(|part| !part.is_empty()).map(file_name).collect();
    let mut number: u32 = 1;
    let mut own = path.clone();
    while !taken.insert(own.clone()) {
        number += 1;
        let mut last = path.file_name().unwrap_or_default().to_owned();
        last.push(format!("-{number}"));
        own = path.with_file_name(last);
    }
    own
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use depthloom_graphs::ValueType;
    use depthloom_graphs::contracts::Slot;
    use depthloom_graphs::plan::{PortId, RunId};

    use super::{Output, is_of, own_path, unknown};

    #[test]
    fn only_topics_with_values_are_suggested_and_listed() {
        let output = |topic, has_values| {
            let slot = Slot::Source { port: PortId(0) };
            let value_type = Some(ValueType::Depth);
            Output { run: RunId(0), slot, names: vec![topic], recorded: true, has_values, value_type }
        };
        let help = |pattern, outputs: &[Output<'_>]| unknown(pattern, outputs).message.remedy.unwrap();
        let one = [output("/look/near/depth", true), output("/later/far/depth", false)];
        assert_eq!(help("nea", &one), "did you mean `near`?");
        assert_eq!(help("far", &one), "it has /look/near/depth");
        assert_eq!(help("far", &one[1..]), "the recording has no topic with values");
    }

    #[test]
    fn a_topic_is_named_by_itself_its_end_or_its_node() {
        let topic = "/compare/full/fused/depth";
        let names = ["compare/full/fused/depth", "fused/depth", "fused", "full/fused", "f*/depth", "/compare/*", "*"];
        for pattern in names.into_iter().chain([topic]) {
            assert!(is_of(pattern, topic), "{pattern}");
        }
        for pattern in ["depth", "/fused/depth", "full", "used/depth", "/compare", ""] {
            assert!(!is_of(pattern, topic), "{pattern}");
        }
    }

    #[test]
    fn invented_topics_stay_inside_the_folder() {
        let mut taken = BTreeSet::new();
        let mut owner = |name| own_path(name, &mut taken).to_string_lossy().into_owned();
        assert_eq!(owner("/../../etc/passwd"), "__/__/etc/passwd");
        assert_eq!(owner("/a b/c"), "a_b/c");
        assert_eq!(owner("/a?b/c"), "a_b/c-2");
    }
}
