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

/// How values are sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DoraValues {
    /// As the structs of the process protocol: one row with width and height.
    #[default]
    Struct,
    /// As dora nodes pass images: only the numbers of the pixels, with `width`, `height` and `encoding` in the
    /// metadata. Encodings are `rgb8`, `bgr8` and `mono8` for images, `32FC1` for maps, and `16UC1` for depths in
    /// millimetres.
    Flat,
}

/// Parameters of `dora`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DoraParams {
    /// The program or Python file that dora starts (`path` of the dora node). A relative path is resolved against the
    /// folder of the YAML file if the file exists there.
    #[schemars(extend("mandatory" = true))]
    pub path: Argument,
    /// Arguments of the program: `[--model, small]`. An argument that names a file in the folder of the YAML file
    /// becomes the path of that file.
    pub args: Vec<Argument>,
    /// Command that `dora build` runs to install the node: `pip install dora-yolo`.
    pub build: Option<String>,
    /// Environment variables of the node.
    pub env: BTreeMap<String, String>,
    /// Ports: `{ inputs: { image: image }, outputs: { depth: depth } }`. They are the inputs and outputs in the
    /// dataflow. The node must send every output for every frame.
    pub ports: DeclaredPorts,
    /// How values are sent.
    pub values: DoraValues,
    /// Increase this number whenever the program gives other results. Without `version` and `code`, results are never
    /// reused.
    pub version: Option<u32>,
    /// Files whose content decides the results, as an alternative to `version`: files, folders (all files in them)
    /// and patterns (`lib/*.py`).
    pub code: Vec<CodePath>,
    /// Time limit per frame, seconds.
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

    /// Fails unless the user allowed the start of programs.
    ///
    /// # Errors
    /// Names the program and how to allow it.
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
            summary: "A node of a dora dataflow that knows nothing of depthloom; runs only in a dataflow.",
            doc: "\
`depthloom dora EXPERIMENT` writes the experiment as a dataflow of dora. This node is part of that dataflow: dora \
starts it, and it exchanges messages through dora's own library. `depthloom run` cannot start it; use `process` for \
a program that runs in both.\n\n\
The inputs and outputs of the dora node have the names of the ports. For each frame with all required inputs, the \
node gets one message per input and replies with one message per output. It sees one frame at a time. The metadata \
contain `frame` (the position in the stage), `frame_id` and `time_ns`. The node must pass them on with its reply, as \
dora nodes usually do. A reply without `frame` cannot be assigned to a frame and fails.\n\n\
With `values: struct`, a value is one row as in the process protocol. With `values: flat`, a map is the array of its \
pixels, as in dora's cameras and viewers, with `width`, `height` and `encoding` in the metadata in both directions. \
A reply without `width` and `height` has the size of the first map of the request. A reply whose metadata contradict \
its data fails.\n\n\
The node must not remember frames. Its results are reused only if `version` or `code` is set; the cache key contains \
`version` or the content of the files in `code`.",
            inputs: Vec::new(),
            outputs: Vec::new(),
        }
    }

    fn signature(params: &DoraParams) -> Option<Signature> {
        // The messages name their frame.
        let observes = Some(Observation::default());
        Some(Signature { observes, ..params.ports.signature(Contract::Pure) })
    }

    fn check(params: &DoraParams) -> Result<(), (&'static str, String)> {
        if params.path.0.is_empty() {
            return Err(("path", "path is missing: the program or Python file that dora starts".to_owned()));
        }
        let (command, none) = (params.command(), BTreeMap::new());
        params.program(&command, &none).check(&[("timeout_s", params.timeout_s)])?;
        params.ports.check(Contract::Pure).map_err(|what| ("ports", what))?;
        let Signature { inputs, outputs, .. } = params.ports.signature(Contract::Pure);
        if inputs.is_empty() || outputs.is_empty() {
            let what = "ports needs inputs and outputs: `{ inputs: { image: image }, outputs: { depth: depth } }`";
            return Err(("ports", what.to_owned()));
        }
        if let Some(output) = outputs.iter().find(|output| output.optional) {
            let what = format!(
                "ports: output `{}` is optional, but a dora node must send every output for every frame",
                output.name
            );
            return Err(("ports", what));
        }
        if let Some(port) = inputs.iter().chain(&outputs).find(|port| port.rate == Rate::Once) {
            return Err((
                "ports",
                format!(
                    "ports: `{}` is `rate: once`, but a dora node receives and sends one value per frame",
                    port.name
                ),
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
                Err((
                    "ports",
                    format!("ports: `{name}`: values of type {of} cannot be sent in this form (see `values`)"),
                ))
            }
        }
    }

    fn fingerprint(params: &DoraParams) -> Result<Option<Key>, Fault> {
        params.program(&params.command(), &BTreeMap::new()).fingerprint()
    }

    fn build(_: DoraParams) -> Result<Instance, Fault> {
        Err(Fault::new("a node of kind `dora` runs only in a dora dataflow")
            .remedy("`depthloom dora EXPERIMENT > dataflow.yml`, then `dora run dataflow.yml`; a program that both can start is a `process`"))
    }
}
