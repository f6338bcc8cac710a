//! `process`: a node in any language.

use std::collections::BTreeMap;

use depthloom_graphs::contracts::{
    Argument, CodePath, Contract, DeclaredPorts, FramePaths, NodeDeclaration, Observation, OnceNode, OrderedNode,
    Signature,
};
use depthloom_graphs::key::KeyBuilder;
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Key, Node, Outputs, Port, PureNode, Value};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use super::launch::{Launch, ProgramParams};
use super::modules::Modules;
use super::permission;
use super::pool::{self, Pool};
use super::protocol::{self, Call};

/// How a process is called.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ProcessContract {
    /// Frame by frame, by as many processes as there are workers; none remembers a frame when the next comes.
    #[default]
    Pure,
    /// All frames in order, by one process; then `finish`.
    Ordered,
    /// Once, when the inputs are there.
    Once,
}

impl ProcessContract {
    const fn contract(self) -> Contract {
        match self {
            Self::Pure => Contract::Pure,
            Self::Ordered => Contract::Ordered,
            Self::Once => Contract::Once,
        }
    }
}

/// Parameters of `process`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessParams {
    /// The program and its arguments, `[python3, fuse.py]`: never a line for a shell. An argument with an ending or a
    /// `/` that names a file beside the YAML file is that file.
    pub command: Vec<Argument>,
    /// Its ports: `{ inputs: { stereo: depth, mono: depth }, outputs: { depth: depth } }`.
    pub ports: DeclaredPorts,
    /// How it is called: `pure`, `ordered` or `once`.
    pub contract: ProcessContract,
    /// What it is told beside its inputs, as it likes.
    pub params: Map<String, Json>,
    /// Raised whenever it gives other results than before. Without it and without `code` its results are never taken
    /// again.
    pub version: Option<u32>,
    /// What decides its results, instead of `version`: files, folders (all files in them) and patterns (`lib/*.py`).
    /// When their content changes, results are recomputed. What a program in Python imports need not be named; see
    /// `imports`.
    pub code: Vec<CodePath>,
    /// Whether cache keys contain what a program in Python imports: the content of its own modules, and the versions of
    /// installed packages. `depthloom.serve` reports it; for this the program is started before the first frame, and
    /// ends without making its node. A program in another language reports nothing.
    pub imports: bool,
    /// Files that it opens by itself for a frame, `predictions/{frame}.npy`, or a list of them: `{frame}` stands for
    /// the frame's id, `{index}` for its index. Their content is in the frame's cache key; a file that is missing
    /// counts as missing. A pure program with `reads` is told which frame it is called for.
    pub reads: FramePaths,
    /// Variables of its environment, over those that are there. They are part of what decides its results.
    pub env: BTreeMap<String, String>,
    /// Variables of its environment that decide no result, such as a token: `{ TOKEN: "${MY_TOKEN}" }`. Their values
    /// are not recorded, and results are reused whatever these are.
    #[schemars(extend("operational" = true))]
    pub secrets: BTreeMap<String, String>,
    /// How many processes there are at most; by default as many as are called at once. `ordered` and `once` have one.
    #[schemars(range(min = 1), extend("operational" = true))]
    pub instances: Option<u16>,
    /// How long a process may say nothing while it is called, seconds; by default 60 for a frame, and an hour for what
    /// is of no frame.
    #[schemars(extend("operational" = true))]
    pub timeout_s: Option<f64>,
    /// How long it may take until it can be called, seconds.
    #[schemars(extend("operational" = true))]
    pub start_timeout_s: f64,
}

impl Default for ProcessParams {
    fn default() -> Self {
        Self {
            command: Vec::new(),
            ports: DeclaredPorts::default(),
            contract: ProcessContract::Pure,
            params: Map::new(),
            version: None,
            code: Vec::new(),
            imports: true,
            reads: FramePaths::default(),
            env: BTreeMap::new(),
            secrets: BTreeMap::new(),
            instances: None,
            timeout_s: None,
            start_timeout_s: 60.0,
        }
    }
}

impl ProcessParams {
    fn program(&self) -> ProgramParams<'_> {
        let Self { command, env, secrets, version, code, .. } = self;
        ProgramParams { command, env, secrets, version: *version, code }
    }

    /// Starts the program once for its report if its modules enter keys.
    fn launch(&self) -> Result<Launch, Fault> {
        let instances = match self.contract {
            ProcessContract::Pure => self.instances.map_or(usize::MAX, usize::from),
            ProcessContract::Ordered | ProcessContract::Once => 1,
        };
        let (frame_s, once_s) = (self.timeout_s.unwrap_or(FRAME_S), self.timeout_s.unwrap_or(ONCE_S));
        let program = self.program();
        let mut launch = program.launch(instances, &self.reads, [self.start_timeout_s, frame_s, once_s])?;
        // Checked before the first frame, and again at each start.
        permission::check(&launch.command_line())?;
        launch.check_program()?;
        if self.imports && program.has_keys() {
            launch.modules = Modules::known(pool::report_of(&launch));
        }
        Ok(launch)
    }
}

pub(super) fn check_reads(reads: &FramePaths) -> Result<(), (&'static str, String)> {
    let placeholders = reads.0.iter().try_for_each(|path| Observation::is_per_frame(path).map(|_| ()));
    placeholders.map_err(|what| ("reads", format!("reads: {what}")))
}

/// Seconds.
pub(super) const FRAME_S: f64 = 60.0;
const ONCE_S: f64 = 3600.0;

/// The kind `process`.
pub struct Process;

impl Node for Process {
    type Params = ProcessParams;

    const OWN_PORTS: bool = true;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "process",
            version: 1,
            contract: Contract::Pure,
            summary: "A node in any language: a program that gets its inputs as Arrow record batches, and answers with its outputs.",
            doc: "\
The program is started when a worker first needs it and is called until the stage ends: values cross its standard input and output as Arrow IPC streams, a record batch a call \
(the guide's page on the protocol says all of it; in Python `depthloom.serve` speaks it). Its ports and its contract are declared here, and are checked, planned, recorded and scored as \
any other node's. Depths are f32 metres with NaN for no answer, disparities the engine's fixed point with its scale, weights f32, images 8 bit; rows of scores do not cross. \
Values that are none of their type (a depth of -5 m, a weight of 7.5) fail the frame.\n\n\
Nothing is started unless the person who runs the experiment allows it: with `--allow-exec`, or in a file of their own (`allow_exec` in `~/.config/depthloom/config.yaml`). `check` and `plan` start nothing.\n\n\
Results enter keys by `version` or by the content of the files in `code`; with neither they are never reused. What a program in Python imports is part of the key too (`imports`), and so are the files that it `reads` for a frame. A module of the program's own that is imported later, in a function, fails the frame: import it at the top, or name it in `code`; an installed package that is imported later is a warning. A `pure` program that remembers frames breaks that promise, and nobody can see it.\n\n\
A process that ends, says what is no reply, or says nothing for `timeout_s` fails the frame it was called for, with the end of its standard error; the next frame gets a new one (`--keep-going`). \
It runs in a process group of its own, and everything in that group ends with it: ten seconds after its input it is told (SIGTERM), and killed two seconds later, also when depthloom itself is killed. What leaves the group, a daemon, is out of reach.",
            inputs: Vec::new(),
            outputs: Vec::new(),
        }
    }

    fn signature(params: &ProcessParams) -> Option<Signature> {
        let FramePaths(files) = &params.reads;
        let observes = (!files.is_empty()).then(|| Observation { files: files.clone() });
        Some(Signature { observes, ..params.ports.signature(params.contract.contract()) })
    }

    fn check(params: &ProcessParams) -> Result<(), (&'static str, String)> {
        let times = [("timeout_s", params.timeout_s.unwrap_or(FRAME_S)), ("start_timeout_s", params.start_timeout_s)];
        params.program().check(&times)?;
        check_reads(&params.reads)?;
        let contract = params.contract.contract();
        if contract == Contract::Once && !params.reads.0.is_empty() {
            return Err((
                "reads",
                "reads names files of frames, and a `once` program sees no frame: name them in `code`".to_owned(),
            ));
        }
        params.ports.check(contract).map_err(|what| ("ports", what))?;
        let Signature { inputs, outputs, .. } = params.ports.signature(contract);
        if inputs.is_empty() && contract != Contract::Once {
            return Err((
                "ports",
                "ports declares no inputs: `{ inputs: { image: image }, outputs: { depth: depth } }`".to_owned(),
            ));
        }
        let mut ports = inputs.iter().chain(&outputs);
        ports.try_for_each(protocol::crosses).map_err(|what| ("ports", format!("ports: {what}")))
    }

    fn fingerprint(params: &ProcessParams) -> Result<Option<Key>, Fault> {
        let files = params.program().fingerprint()?;
        let modules = params.launch()?.modules.fixed();
        let program = match (files, modules) {
            (files, None) => files,
            (files, Some(report)) => {
                let key = Key::build("program").number(u64::from(files.is_some()));
                let key = files.iter().fold(key, KeyBuilder::key);
                Some(key.key(&report.key(params.version.is_some())).finish())
            }
        };
        // A program sees its parameters in the order of the file; the key of a node's parameters does not have it.
        Ok(match order_of(&params.params) {
            None => program,
            Some(order) => {
                let key = Key::build("program and order").number(u64::from(program.is_some()));
                Some(program.iter().fold(key, KeyBuilder::key).key(&order).finish())
            }
        })
    }

    fn build(params: ProcessParams) -> Result<Instance, Fault> {
        let contract = params.contract.contract();
        let signature = params.ports.signature(contract);
        let launch = params.launch()?;
        let Signature { inputs, outputs, .. } = signature;
        let schema = protocol::request_schema(contract.name(), &inputs, &outputs, &params.params);
        let called = Called { pool: Pool::new(launch, schema, outputs), inputs };
        Ok(match contract {
            Contract::Pure => Instance::Pure(Box::new(called)),
            Contract::Ordered => Instance::Ordered(Box::new(called)),
            Contract::Once => Instance::Once(Box::new(called)),
        })
    }
}

/// `None` if the parameters are sorted by name.
fn order_of(params: &Map<String, Json>) -> Option<Key> {
    let written = Json::Object(params.clone());
    let mut sorted = written.clone();
    sorted.sort_all_objects();
    let (text, in_order) = (written.to_string(), sorted.to_string());
    (text != in_order).then(|| Key::build("order of parameters").text(&text).finish())
}

struct Called {
    pool: Pool,
    inputs: Vec<Port>,
}

impl Called {
    fn values(&self, inputs: &Inputs<'_>) -> Vec<Option<Value>> {
        self.inputs.iter().map(|port| inputs.value(port.name).cloned()).collect()
    }

    fn nothing(&self) -> Vec<Option<Value>> {
        self.inputs.iter().map(|_| None).collect()
    }
}

impl PureNode for Called {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Process(None), self.values(inputs), ctx.host)
    }

    fn process_frame(&self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Process(Some(frame.clone())), self.values(inputs), ctx.host)
    }
}

impl OrderedNode for Called {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Process(Some(frame.clone())), self.values(inputs), ctx.host)
    }

    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Finish, self.nothing(), ctx.host)
    }
}

impl OnceNode for Called {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Run, self.values(inputs), ctx.host)
    }
}
