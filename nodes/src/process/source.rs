//! `process/source`: frames from a program.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Mutex, OnceLock};

use depthloom_graphs::contracts::{
    Argument, CodePath, Contract, DeclaredPort, DeclaredPorts, Frame, FramePaths, FrameSelection, Observation,
    SourceDeclaration, StreamingSource,
};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Context, Fault, Host, Key, Outputs, Port, Rate, Source, SourceKind, SourceOutputs, Value};
use depthloom_threads::locked;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use super::launch::{Launch, ProgramParams};
use super::modules::Modules;
use super::node::{FRAME_S, check_reads};
use super::permission;
use super::pool::{Answer, Pool};
use super::protocol::{self, Call};
#[cfg(unix)]
use super::stream::ProcessStream;

const KIND: &str = "process/source";

/// Parameters of `process/source`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessSourceParams {
    /// The program and its arguments: `[python3, frames.py]`. It is not a shell command line. An argument with an
    /// extension or a `/` that names a file in the folder of the YAML file becomes the path of that file.
    #[schemars(extend("mandatory" = true))]
    pub command: Vec<Argument>,
    /// Outputs of a frame: `{ left: image, right: image, calibration: calibration }`.
    #[schemars(extend("mandatory" = true))]
    pub outputs: BTreeMap<String, DeclaredPort>,
    /// Whether the program delivers one frame after the other, as a camera does. `depthloom live` runs such a source.
    pub stream: bool,
    /// Largest number of consecutive restarts without a frame, if a streaming program exits, fails or sends nothing
    /// for `timeout_s`. After that, the stream ends with an error.
    #[schemars(extend("operational" = true))]
    pub restarts: u32,
    /// Selected frames: `0..16`, `1..=40` or a list of positions or ids; all by default.
    pub frames: FrameSelection,
    /// Parameters of the program itself, passed unchanged.
    pub params: Map<String, Json>,
    /// Increase this number whenever the program gives other frames. Without `version` and `code`, results are never
    /// reused.
    pub version: Option<u32>,
    /// Files whose content decides the frames, as an alternative to `version`: files, folders (all files in them) and
    /// patterns (`lib/*.py`). When their content changes, results are recomputed.
    pub code: Vec<CodePath>,
    /// Whether cache keys contain what a Python program imports; see `process`.
    pub imports: bool,
    /// Files that the program opens itself for a frame, `images/{frame}.png`, or a list of them. `{frame}` is the id
    /// of the frame, `{index}` its index. Their content is part of the cache key of the frame; a missing file counts
    /// as missing.
    pub reads: FramePaths,
    /// Environment variables, in addition to those of depthloom. They are part of the cache key.
    pub env: BTreeMap<String, String>,
    /// Environment variables that do not affect results, such as a token: `{ TOKEN: "${MY_TOKEN}" }`. Their values
    /// are not recorded and not part of the cache key.
    #[schemars(extend("operational" = true))]
    pub secrets: BTreeMap<String, String>,
    /// Largest number of processes; by default one per concurrent call.
    #[schemars(range(min = 1), extend("operational" = true))]
    pub instances: Option<u16>,
    /// Time limit for a reply, seconds.
    #[schemars(extend("operational" = true))]
    pub timeout_s: f64,
    /// Time limit from the start until the program accepts calls, seconds.
    #[schemars(extend("operational" = true))]
    pub start_timeout_s: f64,
}

impl Default for ProcessSourceParams {
    fn default() -> Self {
        Self {
            command: Vec::new(),
            outputs: BTreeMap::new(),
            stream: false,
            restarts: 5,
            frames: FrameSelection::All,
            params: Map::new(),
            version: None,
            code: Vec::new(),
            imports: true,
            reads: FramePaths::default(),
            env: BTreeMap::new(),
            secrets: BTreeMap::new(),
            instances: None,
            timeout_s: FRAME_S,
            start_timeout_s: 60.0,
        }
    }
}

impl ProcessSourceParams {
    fn program(&self) -> ProgramParams<'_> {
        let Self { command, env, secrets, version, code, .. } = self;
        ProgramParams { command, env, secrets, version: *version, code }
    }

    fn ports(&self) -> Vec<Port> {
        let ports = DeclaredPorts { inputs: BTreeMap::new(), outputs: self.outputs.clone() };
        ports.signature(Contract::Pure).outputs
    }

    fn launch(&self) -> Result<Launch, Fault> {
        let program = self.program();
        let times = [self.start_timeout_s, self.timeout_s, self.timeout_s];
        let mut launch = program.launch(self.instances.map_or(usize::MAX, usize::from), &self.reads, times)?;
        if self.imports && program.has_keys() {
            launch.modules = Modules::Known(OnceLock::new());
        }
        Ok(launch)
    }

    /// What decides the frames, except the frame itself.
    fn program_key(&self, launch: &Launch) -> Result<Key, Fault> {
        let ports = serde_json::to_string(&self.outputs).map_err(|error| Fault::new(error.to_string()))?;
        let key = Key::build(KIND).text(&Json::Object(self.params.clone()).to_string()).text(&ports);
        let key = key.number(self.version.map_or(0, |version| 1 + u64::from(version)));
        let mut key = key.number(self.command.len() as u64);
        for argument in &self.command {
            // Files enter the key by name; `version` and `code` cover their content.
            let name = Path::new(&argument.0).file_name().filter(|_| Path::new(&argument.0).is_file());
            key = key.text(&name.map_or_else(|| argument.0.as_str().into(), |name| name.to_string_lossy()));
        }
        key = key.number(self.env.len() as u64);
        key = self.env.iter().fold(key, |key, (name, value)| key.text(name).text(value));
        let files = self.program().fingerprint()?;
        let modules = launch.modules.fixed().map(|report| report.key(self.version.is_some()));
        for also in [files, modules] {
            key = match also {
                Some(also) => key.number(1).key(&also),
                None => key.number(0),
            };
        }
        Ok(key.finish())
    }
}

/// The kind `process/source`.
pub struct ProcessSource {
    pool: Pool,
    program_key: Key,
    observes: Observation,
    frames: Vec<Frame>,
    warnings: Vec<String>,
}

/// Host of the call that lists the frames, before a run exists, and of streams, which run outside frames.
#[derive(Default)]
pub(super) struct WarningCollector(Mutex<BTreeMap<String, u64>>);

impl WarningCollector {
    pub(super) fn take(&self) -> Vec<String> {
        let warnings = std::mem::take(&mut *locked(&self.0));
        let text = |(what, count): (String, u64)| if count > 0 { format!("{count} {what}") } else { what };
        warnings.into_iter().map(text).collect()
    }
}

impl Host for WarningCollector {
    fn cancelled(&self) -> bool {
        false
    }

    fn warn_n(&self, count: u64, what: &str) {
        let mut warnings = locked(&self.0);
        let counted = warnings.entry(what.to_owned()).or_default();
        *counted = counted.saturating_add(count);
    }

    fn progress(&self, _done: u64, _total: u64, _message: &str) {}

    fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
        (0..n).for_each(f);
    }

    fn width(&self) -> usize {
        1
    }
}

impl SourceKind for ProcessSource {
    type Params = ProcessSourceParams;

    fn declaration() -> SourceDeclaration {
        SourceDeclaration {
            kind: KIND,
            version: 1,
            summary: "Frames from a program in any language: your own data set.",
            doc: "\
The program first lists its frames, each with an id and optionally a time in nanoseconds (default: 100 ms between \
frames). Then depthloom requests the values of single frames, in any order, from several processes at once. So the \
program must support random access, and return the same values for the same frame. Protocol, permission, cache keys \
and failures are those of the node `process`.\n\n\
**Streams.** With `stream: true`, the program lists no frames. It delivers one frame after the other, as a camera \
does, and `depthloom live` processes them as they arrive. One process runs. If it exits, fails or sends nothing for \
`timeout_s`, depthloom starts it again after 0.1 s; the pause doubles with each failure, up to 5 s. The cache key of a \
frame contains the content of its values.",
            outputs: Vec::new(),
        }
    }

    fn check(params: &ProcessSourceParams) -> Result<(), (&'static str, String)> {
        let times = [("timeout_s", params.timeout_s), ("start_timeout_s", params.start_timeout_s)];
        params.program().check(&times)?;
        check_reads(&params.reads)?;
        if params.stream && params.frames != FrameSelection::All {
            let what =
                "frames selects from a list of frames, which a stream does not have: remove `frames` or `stream`";
            return Err(("frames", what.to_owned()));
        }
        if params.stream && !params.reads.0.is_empty() {
            let what = "reads is not used by a stream, because its cache keys contain the values: remove `reads`";
            return Err(("reads", what.to_owned()));
        }
        if params.outputs.is_empty() {
            return Err((
                "outputs",
                "outputs is missing: declare the outputs of a frame, e.g. `{ left: image, right: image }`".to_owned(),
            ));
        }
        if let Some((name, _)) = params.outputs.iter().find(|(_, port)| port.rate == Rate::Once) {
            return Err((
                "outputs",
                format!("outputs: `{name}` is `rate: once`, but a source has one value per frame"),
            ));
        }
        let ports = DeclaredPorts { inputs: BTreeMap::new(), outputs: params.outputs.clone() };
        ports.check(Contract::Pure).map_err(|what| ("outputs", format!("outputs: {what}")))?;
        params.ports().iter().try_for_each(protocol::crosses).map_err(|what| ("outputs", format!("outputs: {what}")))
    }

    fn outputs(params: &ProcessSourceParams) -> Result<Vec<Port>, Fault> {
        Ok(params.ports())
    }

    fn open(params: ProcessSourceParams) -> Result<Box<dyn Source>, Fault> {
        if params.stream {
            let what = "the frames of a source with `stream: true` cannot be listed: each arrives once";
            return Err(Fault::new(what).remedy(
                "run the experiment with `depthloom live`; its recording is then the source of other runs (`kind: mcap`)",
            ));
        }
        let ports = params.ports();
        let launch = params.launch()?;
        permission::check(&launch.command_line())?;
        let program = launch.program();
        let schema = protocol::request_schema("source", &[], &ports, &params.params);
        let pool = Pool::new(launch, schema, ports);
        let warnings = WarningCollector::default();
        let answer = pool.call(Call::Frames, Vec::new(), &warnings)?;
        #[cfg_attr(not(unix), expect(irrefutable_let_patterns, reason = "there it never answers"))]
        let Answer::Frames(ids, times) = answer else {
            return Err(Fault::new(format!("`{program}` sent values instead of its frames")));
        };
        let frames = frames(&ids, times.as_deref())
            .map_err(|what| Fault::new(format!("invalid frames of `{program}`: {what}")))?;
        let ids: Vec<(u64, &str)> = frames.iter().map(|frame| (frame.index, &*frame.id)).collect();
        let places = params.frames.select(&ids)?;
        let frames = places.into_iter().map(|place| frames[place].clone()).collect();
        // By now its first process has reported what it imports.
        let program_key = params.program_key(pool.launch())?;
        let observes = Observation { files: params.reads.0, ..Observation::default() };
        Ok(Box::new(Self { pool, program_key, observes, frames, warnings: warnings.take() }))
    }

    #[cfg(unix)]
    fn stream(params: ProcessSourceParams) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
        if !params.stream {
            return Ok(None);
        }
        let ports = params.ports();
        let mut launch = params.launch()?;
        // Files that it opens for a frame are not in its keys, which contain the values.
        launch.reads = None;
        permission::check(&launch.command_line())?;
        launch.check_program()?;
        let schema = protocol::request_schema("stream", &[], &ports, &params.params);
        let stream = ProcessStream::start(launch, schema, ports, params.restarts, |launch| params.program_key(launch))?;
        Ok(Some(Box::new(stream)))
    }

    #[cfg(not(unix))]
    fn stream(params: ProcessSourceParams) -> Result<Option<Box<dyn StreamingSource>>, Fault> {
        if params.stream { Err(Fault::new("programs are started on Unix alone")) } else { Ok(None) }
    }
}

fn frames(ids: &[String], times: Option<&[u64]>) -> Result<Vec<Frame>, String> {
    if times.is_some_and(|times| times.len() != ids.len()) {
        return Err("the numbers of times and ids differ".to_owned());
    }
    let mut seen = BTreeSet::new();
    for id in ids {
        check_id(id)?;
        if !seen.insert(id.as_str()) {
            return Err(format!("two have the id `{id}`"));
        }
    }
    let at = |index: usize| times.map(|times| times[index]);
    let frame = |(index, id): (usize, &String)| {
        let plain = Frame::at_10_hz(id.as_str(), index as u64);
        Frame { time_ns: at(index).unwrap_or(plain.time_ns), ..plain }
    };
    Ok(ids.iter().enumerate().map(frame).collect())
}

pub(super) fn check_id(id: &str) -> Result<(), String> {
    if id.is_empty() || id.len() > 200 || id.chars().any(char::is_control) {
        return Err(format!("{id:?} is not a valid id: one line of at most 200 bytes"));
    }
    Ok(())
}

impl Source for ProcessSource {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        let frame = &self.frames[position];
        let key = Key::build("process/source frame").key(&self.program_key).number(frame.index).text(&frame.id);
        let key = key.number(frame.time_ns);
        Ok(match self.observes.content(frame)? {
            Some(files) => key.number(1).key(&files).finish(),
            None => key.number(0).finish(),
        })
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let call = Call::Process(Some(self.frames[position].clone()));
        let outputs = self.pool.outputs(call, Vec::new(), ctx.host)?;
        check_sizes(&outputs)?;
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}

/// Depth computed with a calibration for another size would be wrong.
pub(super) fn check_sizes(outputs: &Outputs) -> Result<(), Fault> {
    for (name, value) in outputs.entries() {
        let Value::Calibration(calibration) = value else { continue };
        let size = (calibration.width, calibration.height);
        let maps: Vec<_> = outputs.entries().filter_map(|(port, map)| Some((port, map.dimensions()?))).collect();
        if let Some((port, (width, height))) = maps.first()
            && maps.iter().all(|(_, of_map)| *of_map != size)
        {
            let (w, h) = size;
            return Err(Fault::new(format!("`{name}` is for {w}x{h} pixels, but `{port}` is {width}x{height}"))
                .remedy("`width` and `height` of a calibration are those of the images that it is for"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Key;
    use serde_json::{Value as Json, json};

    use super::ProcessSourceParams;

    fn program_key(more: &Json) -> Key {
        let mut params = json!({ "command": ["cam"], "outputs": { "left": "image" }, "version": 1 });
        let more = more.as_object().expect("a map").clone();
        params.as_object_mut().expect("a map").extend(more);
        let params: ProcessSourceParams = serde_json::from_value(params).expect("parameters");
        params.program_key(&params.launch().expect("nothing is read")).expect("a key")
    }

    #[test]
    fn command_and_environment_are_kept_apart_and_how_it_is_called_is_not_in_the_key() {
        let arguments = program_key(&json!({ "command": ["cam", "MODE", "fast"] }));
        assert_ne!(arguments, program_key(&json!({ "env": { "MODE": "fast" } })));
        assert_ne!(
            program_key(&json!({ "command": ["cam", "a", "b"] })),
            program_key(&json!({ "command": ["cam", "a b"] }))
        );
        let plain = program_key(&json!({}));
        assert_eq!(plain, program_key(&json!({ "instances": 2, "timeout_s": 99, "start_timeout_s": 9 })));
        assert_ne!(plain, program_key(&json!({ "params": { "mode": "fast" } })));
    }
}
