//! `process`: a node in any language.

use std::collections::BTreeMap;

use depthloom_graphs::contracts::{
    AggregateNode, Argument, CodePath, Contract, DeclaredPorts, FramePaths, NodeDeclaration, Observation, OrderedNode,
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

/// How the program is called.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ProcessContract {
    /// Frame by frame, by as many processes as there are workers. The program must not remember frames.
    #[default]
    Pure,
    /// All frames in order, by one process; then `finish`.
    Ordered,
    /// Once, when all inputs are available.
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
    /// The program and its arguments: `[python3, fuse.py]`. It is not a shell command line. An argument with an
    /// extension or a `/` that names a file in the folder of the YAML file becomes the path of that file.
    #[schemars(extend("mandatory" = true))]
    pub command: Vec<Argument>,
    /// Ports: `{ inputs: { stereo: depth, mono: depth }, outputs: { depth: depth } }`.
    pub ports: DeclaredPorts,
    /// How the program is called: `pure`, `ordered` or `once`.
    pub contract: ProcessContract,
    /// Parameters of the program itself, passed unchanged.
    pub params: Map<String, Json>,
    /// Increase this number whenever the program gives other results. Without `version` and `code`, results are never
    /// reused.
    pub version: Option<u32>,
    /// Files whose content decides the results, as an alternative to `version`: files, folders (all files in them)
    /// and patterns (`lib/*.py`). When their content changes, results are recomputed. Imports of a Python program
    /// need not be listed; see `imports`.
    pub code: Vec<CodePath>,
    /// Whether cache keys contain what a Python program imports: the content of its own modules, and the versions of
    /// installed packages. `depthloom.serve` reports the imports: depthloom starts the program before the first
    /// frame, and the program exits without creating its node. Programs in other languages report nothing.
    pub imports: bool,
    /// Files that the program opens itself for a frame, `predictions/{frame}.npy`, or a list of them. `{frame}` is
    /// the id of the frame, `{index}` its index. Their content is part of the cache key of the frame; a missing file
    /// counts as missing. A pure program with `reads` receives the id of its frame.
    pub reads: FramePaths,
    /// Environment variables, in addition to those of depthloom. They are part of the cache key.
    pub env: BTreeMap<String, String>,
    /// Environment variables that do not affect results, such as a token: `{ TOKEN: "${MY_TOKEN}" }`. Their values
    /// are not recorded and not part of the cache key.
    #[schemars(extend("operational" = true))]
    pub secrets: BTreeMap<String, String>,
    /// Largest number of processes; by default one per concurrent call. `ordered` and `once` use one.
    #[schemars(range(min = 1), extend("operational" = true))]
    pub instances: Option<u16>,
    /// Time limit for a reply, seconds; by default 60 for a frame and 3600 for a call outside frames.
    #[schemars(extend("operational" = true))]
    pub timeout_s: Option<f64>,
    /// Time limit from the start until the program accepts calls, seconds.
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
        let (frame_s, aggregate_s) = (self.timeout_s.unwrap_or(FRAME_S), self.timeout_s.unwrap_or(AGGREGATE_S));
        let program = self.program();
        let mut launch = program.launch(instances, &self.reads, [self.start_timeout_s, frame_s, aggregate_s])?;
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
const AGGREGATE_S: f64 = 3600.0;

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
            summary: "A node in any language: a program that receives inputs and returns outputs as Arrow record batches.",
            doc: "\
depthloom starts the program when a worker first needs it and calls it until the stage ends. Values cross its \
standard input and output as Arrow IPC streams, one record batch per call; see the guide's page on the process \
protocol. In Python, `depthloom.serve` implements the protocol. The ports and the contract are declared here, and \
values are checked, planned, recorded and scored like those of any other node.\n\n\
**Values.** Depth is f32 metres with NaN for invalid pixels, disparity is depthloom's fixed point with its scale, \
confidences are f32, images 8 bit. Rows of metrics cannot be sent. A value outside its type (a depth of -5 m, a \
confidence of 7.5) fails the frame.\n\n\
**Permission.** No program starts unless you allow it: with `--allow-exec`, or with `allow_exec` in \
`~/.config/depthloom/config.yaml`. `check` and `plan` never start programs.\n\n\
**Reuse.** The cache key contains `version`, or the content of the files in `code`; without both, results are never \
reused. It also contains what a Python program imports (`imports`) and the files that the program reads for a frame \
(`reads`). If a function imports one of the program's own modules later, the frame fails: import it at the top, or \
list it in `code`. A later import of an installed package is a warning. depthloom cannot detect that a `pure` \
program remembers frames; such a program gives wrong results.\n\n\
**Failures.** If a process exits, sends an invalid reply or sends nothing for `timeout_s`, its frame fails with the \
last lines of its standard error. With `--keep-going`, the next frame gets a new process. Each process has its own \
process group. Ten seconds after its input ends, depthloom sends SIGTERM to the group, and SIGKILL two seconds \
later, even if depthloom itself was killed. A daemon that leaves the group is not stopped.",
            inputs: Vec::new(),
            outputs: Vec::new(),
        }
    }

    fn signature(params: &ProcessParams) -> Option<Signature> {
        let FramePaths(files) = &params.reads;
        let observes = (!files.is_empty()).then(|| Observation { files: files.clone(), ..Observation::default() });
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

impl AggregateNode for Called {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.pool.outputs(Call::Run, self.values(inputs), ctx.host)
    }
}
