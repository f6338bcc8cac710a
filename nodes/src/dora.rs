//! `dora`: a foreign node of a dora dataflow.

use std::collections::BTreeMap;

use depthloom_graphs::contracts::{
    Argument, CodePath, Contract, DeclaredPorts, NodeDeclaration, Observation, Signature,
};
use depthloom_graphs::{Fault, Instance, Key, Node, Rate, ValueType};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::process::{ProgramParams, command_line, permission};

/// The kind's name.
pub const KIND: &str = "dora";

/// How values cross.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DoraValues {
    /// As the structs of the process protocol: one row, with its width and height.
    #[default]
    Struct,
    /// As nodes of dora's pass images on: the numbers of the pixels alone, with `width`, `height` and `encoding` in the
    /// metadata (`rgb8`, `bgr8`, `mono8`; `32FC1`, or `16UC1` for depths in millimetres).
    Flat,
}

/// Parameters of `dora`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DoraParams {
    /// What dora starts, its `path`: a program, or a file in Python. A file that stands beside the YAML file is that
    /// one.
    pub path: Argument,
    /// Its arguments, `[--model, small]`. Of those that name a file beside the YAML file it is that one.
    pub args: Vec<Argument>,
    /// What dora runs to install it (`pip install dora-yolo`), by `dora build`.
    pub build: Option<String>,
    /// Variables of its environment.
    pub env: BTreeMap<String, String>,
    /// Its ports: `{ inputs: { image: image }, outputs: { depth: depth } }`. They are its inputs and outputs in the
    /// dataflow; it answers every frame at every output.
    pub ports: DeclaredPorts,
    /// How values cross.
    pub values: DoraValues,
    /// Raised whenever it gives other results than before. Without it and without `code` its results are never taken
    /// again.
    pub version: Option<u32>,
    /// What decides its results, instead of `version`: files, folders (all files in them) and patterns (`lib/*.py`).
    pub code: Vec<CodePath>,
    /// How long it may take for a frame, seconds.
    #[schemars(extend("operational" = true))]
    pub timeout_s: f64,
}

impl Default for DoraParams {
    fn default() -> Self {
        Self {
            path: Argument::default(),
            args: Vec::new(),
            build: None,
            env: BTreeMap::new(),
            ports: DeclaredPorts::default(),
            values: DoraValues::Struct,
            version: None,
            code: Vec::new(),
            timeout_s: 60.0,
        }
    }
}

impl DoraParams {
    fn command(&self) -> Vec<Argument> {
        [&self.path].into_iter().chain(&self.args).cloned().collect()
    }

    fn program<'a>(&'a self, command: &'a [Argument], none: &'a BTreeMap<String, String>) -> ProgramParams<'a> {
        ProgramParams { command, env: &self.env, secrets: none, version: self.version, code: &self.code }
    }

    /// Refuses unless the person allowed programs to be started.
    ///
    /// # Errors
    /// What would be started, and how it is allowed.
    pub fn ask(&self) -> Result<(), Fault> {
        permission::check(&command_line(&self.command()))
    }
}

/// The kind `dora`.
pub struct Dora;

impl Node for Dora {
    type Params = DoraParams;

    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: KIND,
            version: 1,
            contract: Contract::Pure,
            summary: "A node of dora's, by somebody else, where the experiment runs as a dataflow of dora's.",
            doc: "\
`depthloom dora EXPERIMENT` writes the experiment as a dataflow, in which this node stands beside ours: dora starts it, and it gets and sends messages by dora's own library, knowing nothing of \
depthloom. `depthloom run` cannot start it; a `process` stands in both.\n\n\
Its inputs and outputs have the names of its ports. For every frame on which its required inputs are there it gets one message at each of them, a frame at a time, and answers with one at each output. \
Metadata has `frame` (the position in the stage), `frame_id` and `time_ns`. It passes them on with its answer, as nodes of dora's do: an answer without `frame` could be of any frame, and fails.\n\n\
With `values: struct` a value is one row as processes get it; with `flat` a map is the array of its pixels, as cameras and viewers of dora's have it: `width`, `height` and `encoding` in \
the metadata, on both ways; an answer without them has the size of the first map that it was asked with, and one whose metadata contradict its numbers fails. It sees no frame before another and remembers none: results are taken again by \
`version` or by the content of the files in `code`, otherwise never.",
            inputs: Vec::new(),
            outputs: Vec::new(),
        }
    }

    fn signature(params: &DoraParams) -> Option<Signature> {
        // Its messages say which frame they are of.
        let observes = Some(Observation::default());
        Some(Signature { observes, ..params.ports.signature(Contract::Pure) })
    }

    fn check(params: &DoraParams) -> Result<(), (&'static str, String)> {
        if params.path.0.is_empty() {
            return Err(("path", "path names what dora starts: a program, or a file in Python".to_owned()));
        }
        let (command, none) = (params.command(), BTreeMap::new());
        params.program(&command, &none).check(&[("timeout_s", params.timeout_s)])?;
        params.ports.check(Contract::Pure).map_err(|what| ("ports", what))?;
        let Signature { inputs, outputs, .. } = params.ports.signature(Contract::Pure);
        if inputs.is_empty() || outputs.is_empty() {
            let what =
                "ports declares no inputs, or no outputs: `{ inputs: { image: image }, outputs: { depth: depth } }`";
            return Err(("ports", what.to_owned()));
        }
        if let Some(output) = outputs.iter().find(|output| output.optional) {
            let what =
                format!("ports: `{}` is optional; a node of dora's answers every frame at every output", output.name);
            return Err(("ports", what));
        }
        if let Some(port) = inputs.iter().chain(&outputs).find(|port| port.rate == Rate::Once) {
            return Err((
                "ports",
                format!("ports: `{}` is `rate: once`; a node of dora's gets and gives values of frames", port.name),
            ));
        }
        let crosses = |of: ValueType| match params.values {
            DoraValues::Struct => of != ValueType::Scores,
            DoraValues::Flat => matches!(
                of,
                ValueType::Image | ValueType::Depth | ValueType::Weight | ValueType::Mask | ValueType::TrueDisparity
            ),
        };
        match inputs.iter().chain(&outputs).find(|port| !crosses(port.value_type)) {
            None => Ok(()),
            Some(port) => {
                let (name, of) = (port.name, port.value_type);
                Err(("ports", format!("ports: `{name}`: values of type {of} do not cross in this form (`values`)")))
            }
        }
    }

    fn fingerprint(params: &DoraParams) -> Result<Option<Key>, Fault> {
        params.program(&params.command(), &BTreeMap::new()).fingerprint()
    }

    fn build(_: DoraParams) -> Result<Instance, Fault> {
        Err(Fault::new("a node of dora's runs in a dataflow of dora's")
            .remedy("`depthloom dora EXPERIMENT > dataflow.yml`, then `dora run dataflow.yml`; a program that both can start is a `process`"))
    }
}
