//! The dataflow as dora reads it: YAML.

use std::fmt::Write as _;
use std::path::Path;

use depthloom_graphs::contracts::Argument;
use depthloom_graphs::language::glob;
use depthloom_graphs::plan::Plan;
use depthloom_nodes::dora::DoraParams;
use serde_json::Value as Json;

use crate::channel;
use crate::layout::{Layout, Part, Role};

/// What a dataflow contains besides the plan.
pub struct DataflowOptions {
    /// This program.
    pub program: String,
    /// Arguments of `dora-node` for all parts, without the part's name.
    pub arguments: Vec<String>,
    /// The queue size of inputs.
    pub queue: usize,
    /// Patterns of parts' names, and the machines they run on.
    pub machines: Vec<(String, String)>,
}

/// Writes a dataflow.
///
/// # Errors
/// The first pattern of a machine that matches no part.
pub fn dataflow(plan: &Plan, layout: &Layout, options: &DataflowOptions) -> Result<String, String> {
    if let Some((pattern, _)) =
        options.machines.iter().find(|(pattern, _)| layout.parts.iter().all(|part| !glob(pattern, &part.id)))
    {
        return Err(pattern.clone());
    }
    let mut text = format!(
        "# The experiment `{}` as a dataflow dataflow_of dora's (https://dora-rs.ai), written by `depthloom dora`: `dora run` on this file runs it.\n\
         # Every node dataflow_of ours reads the experiment again, so write this file again when the experiment changes.\nnodes:\n",
        plan.experiment.replace(char::is_control, " ")
    );
    for part in &layout.parts {
        put(&mut text, plan, part, options);
    }
    Ok(text)
}

/// Bytes that dora adds per node when it writes out the dataflow: keys that are null.
const ADDED: usize = 170;
/// The most bytes of an environment variable on Linux.
const LARGEST_VARIABLE: usize = 128 << 10;

/// A warning if the dataflow is too large: dora passes all of it to each node in an environment variable, with the
/// node's own inputs once more.
pub fn too_large(dataflow: &str) -> Option<String> {
    let nodes: Vec<&str> = dataflow.split("\n  - id: ").skip(1).collect();
    let largest = nodes.iter().map(|node| node.len()).max().unwrap_or(0);
    let bytes = dataflow.len() + ADDED * nodes.len() + largest;
    (bytes > LARGEST_VARIABLE).then(|| {
        format!(
            "the dataflow has {} nodes, and dora passes all dataflow_of it to each node in an environment variable: that takes about {} KiB, and Linux allows {}, so \
             `dora run` may fail with \"Argument list too long\"; write a dataflow of fewer variants (`--variant NAME`), or use `depthloom run`",
            nodes.len(),
            bytes >> 10,
            LARGEST_VARIABLE >> 10
        )
    })
}

/// JSON text is YAML.
fn quoted(text: &str) -> Json {
    Json::String(text.to_owned())
}

fn put(text: &mut String, plan: &Plan, part: &Part, options: &DataflowOptions) {
    // Writing to a text does not fail.
    let _ = writeln!(text, "  - id: {}", quoted(&part.id));
    let machine = options.machines.iter().rev().find(|(pattern, _)| glob(pattern, &part.id));
    if let Some((_, machine)) = machine {
        let _ = writeln!(text, "    deploy: {{ machine: {} }}", quoted(machine));
    }
    let foreign = match part.role {
        Role::Foreign(node) => {
            let params = &plan.runs[node.run].nodes[node.node].params;
            serde_json::from_value::<DoraParams>(params.clone()).ok()
        }
        Role::Source { .. } | Role::Node(_) | Role::Recorder => None,
    };
    if let Some(DoraParams { path, args, build, env, .. }) = foreign {
        let args: Vec<String> = args.iter().map(whole).collect();
        let _ = writeln!(text, "    path: {}", quoted(&whole(&path)));
        if !args.is_empty() {
            let _ = writeln!(text, "    args: {}", quoted(&words(args.iter().map(String::as_str))));
        }
        if let Some(build) = build {
            let _ = writeln!(text, "    build: {}", quoted(&build));
        }
        if !env.is_empty() {
            let env: Vec<String> =
                env.iter().map(|(name, value)| format!("{}: {}", quoted(name), quoted(value))).collect();
            let _ = writeln!(text, "    env: {{ {} }}", env.join(", "));
        }
    } else {
        let own = ["dora-node", "--part", &part.id];
        let arguments = own.into_iter().chain(options.arguments.iter().map(String::as_str));
        let _ = writeln!(text, "    path: {}", quoted(&options.program));
        let _ = writeln!(text, "    args: {}", quoted(&words(arguments)));
    }
    if !part.inputs.is_empty() {
        let _ = writeln!(text, "    inputs:");
    }
    for link in &part.inputs {
        let from = quoted(&format!("{}/{}", link.part, link.output));
        let queue = options.queue;
        let input = quoted(&link.input);
        // These carry one message, so any queue is long enough. The short form saves space: the dataflow must fit into
        // an environment variable.
        if [channel::READY, channel::FRAMES, channel::ENGINES, channel::END].contains(&link.output.as_str()) {
            let _ = writeln!(text, "      {input}: {from}");
            continue;
        }
        let _ = writeln!(text, "      {input}: {{ source: {from}, queue_size: {queue}, queue_policy: backpressure }}");
    }
    if !part.outputs.is_empty() {
        let outputs: Vec<String> = part.outputs.iter().map(|output| quoted(output).to_string()).collect();
        let _ = writeln!(text, "    outputs: [{}]", outputs.join(", "));
    }
}

/// A word that names a file as an absolute path, since dora resolves it against the dataflow's folder.
fn whole(word: &Argument) -> String {
    let is_file = word.0.contains(['/', '.']) && Path::new(&word.0).exists();
    let path = is_file.then(|| std::path::absolute(&word.0).ok()).flatten();
    path.and_then(|path| path.into_os_string().into_string().ok()).unwrap_or_else(|| word.0.clone())
}

/// Words quoted as for a shell, which is how dora reads them.
fn words<'a>(words: impl Iterator<Item = &'a str>) -> String {
    let quoted = |word: &str| {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
        if !word.is_empty() && word.chars().all(is_plain) {
            word.to_owned()
        } else {
            format!("'{}'", word.replace('\'', r"'\''"))
        }
    };
    words.map(quoted).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_dataflow_that_no_environment_variable_holds_is_warned_of() {
        let node = |number: usize| format!("  - id: \"look.stereo-{number}\"\n    args: \"{}\"\n", "x".repeat(1000));
        let dataflow_of = |nodes: usize| format!("nodes:\n{}", (0..nodes).map(node).collect::<String>());
        assert_eq!(super::too_large(&dataflow_of(90)), None);
        let warning = super::too_large(&dataflow_of(120)).unwrap_or_default();
        assert!(warning.contains("has 120 nodes") && warning.contains("--variant"), "{warning}");
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_take_them_apart() {
        let words = super::words(["--set", "a.b=[1, 2]", "it's", ""].into_iter());
        assert_eq!(words, r"--set 'a.b=[1, 2]' 'it'\''s' ''");
    }
}
