//! Toy graphs: nodes that mix numbers, a sink that writes everything down, and plans made by hand.
#![allow(dead_code, clippy::allow_attributes, reason = "each test and the bench use a part of it")]
#![allow(missing_docs, reason = "test support")]

pub(crate) mod any_graph;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{Commit, Contract, ErrorMessage, NodeWarning, Sink, Slot};
use depthloom_graphs::plan::{
    FrameIndex, NodeId, Origin, PartId, Plan, PlannedInput, PlannedNode, PlannedOutput, PlannedSource, PortId, Record,
    RunId, StageRun, VariantId,
};
use depthloom_graphs::ready::{Ready, ReadyRun};
use depthloom_graphs::values::{Artifact, Calibration};
use depthloom_graphs::{
    AggregateNode, Context, Fault, Frame, Inputs, Instance, Key, OrderedNode, Outputs, Port, PureNode, Source,
    SourceOutputs, Value, ValueType, value_keys,
};

/// A number as a value. Its low 16 bits are the frame's index all along the graph, so that toys know when to fail.
pub(crate) fn number(n: u64) -> Value {
    let (width, height) = ((n >> 32) as u32, n as u32);
    Value::from(Calibration { width, height, focal_px: 0.0, cx_px: 0.0, cy_px: 0.0, baseline_m: 0.0, doffs_px: 0.0 })
}

pub(crate) fn read(value: &Calibration) -> u64 {
    u64::from(value.width) << 32 | u64::from(value.height)
}

pub(crate) fn mix(a: u64, b: u64) -> u64 {
    let mixed = (a ^ b.rotate_left(23)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9)
}

pub(crate) fn at_frame(n: u64, frame: u64) -> u64 {
    n << 16 | frame & 0xFFFF
}

pub(crate) fn artifact(n: u64) -> Value {
    Value::Samples(Arc::new(Artifact::new("samples", n.to_le_bytes().to_vec())))
}

pub(crate) fn read_artifact(artifact: &Artifact) -> u64 {
    artifact.bytes.iter().rev().fold(0, |n, &byte| n << 8 | u64::from(byte))
}

/// What a toy does on which frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Toy {
    pub salt: u64,
    pub fails_at: BTreeSet<u64>,
    pub panics_at: BTreeSet<u64>,
    pub absent_at: BTreeSet<u64>,
    pub tiles: usize,
    /// Whether an ordered toy has no aggregate output.
    pub has_no_sum: bool,
    pub calls: Arc<AtomicU64>,
}

impl Toy {
    pub(crate) fn salted(salt: u64) -> Self {
        Self { salt, ..Self::default() }
    }

    /// The number made of the inputs; the first tells the frame.
    fn work(&self, frame: u64, inputs: &[Option<u64>], ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.calls.fetch_add(1, Ordering::Relaxed);
        let mixed = inputs.iter().fold(self.salt, |n, input| mix(n, input.unwrap_or(7)));
        // Some calls take longer than others, so that the order of workers varies. To yield takes very
        // long on a machine that has other work: few do.
        (0..mixed % 300).for_each(|_| std::hint::spin_loop());
        if mixed.is_multiple_of(32) {
            std::thread::yield_now();
        }
        let tiles: Vec<AtomicU64> = (0..self.tiles).map(|_| AtomicU64::new(0)).collect();
        ctx.host.tiles(self.tiles, &|t| tiles[t].store(mix(mixed, t as u64), Ordering::Relaxed));
        let mixed = tiles.iter().fold(mixed, |n, tile| mix(n, tile.load(Ordering::Relaxed)));
        if self.fails_at.contains(&frame) {
            return Err(Fault::new("requested failure").remedy("do not request it"));
        }
        assert!(!self.panics_at.contains(&frame), "requested panic");
        let x = Outputs::one("x", number(at_frame(mixed, frame)));
        if self.absent_at.contains(&frame) { Ok(x) } else { Ok(x.with("y", number(at_frame(mixed ^ 1, frame)))) }
    }
}

fn frame_inputs(inputs: &Inputs<'_>) -> Result<(u64, [Option<u64>; 3]), Fault> {
    let a = read(inputs.get::<Calibration>("a")?);
    let b = inputs.optional::<Calibration>("b")?.map(|b| read(b));
    let c = inputs.optional::<Artifact>("c")?.map(|c| read_artifact(c));
    Ok((a & 0xFFFF, [Some(a), b, c]))
}

impl PureNode for Toy {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (frame, numbers) = frame_inputs(inputs)?;
        self.work(frame, &numbers, ctx)
    }
}

/// An ordered toy: every frame's number depends on all before.
pub(crate) struct OrderedToy {
    pub toy: Toy,
    pub state: u64,
}

impl OrderedNode for OrderedToy {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let (index, [a, b, c]) = frame_inputs(inputs)?;
        assert_eq!(index, frame.index, "the frame matches the inputs");
        self.state = mix(self.state, a.unwrap_or(0));
        self.toy.work(index, &[Some(self.state), a, b, c], ctx)
    }

    fn finish(self: Box<Self>, _ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        if self.toy.has_no_sum {
            return Ok(Outputs::none());
        }
        Ok(Outputs::one("sum", artifact(self.state)))
    }
}

impl AggregateNode for Toy {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let s = read_artifact(inputs.get::<Artifact>("s")?);
        let t = inputs.optional::<Artifact>("t")?.map(|t| read_artifact(t));
        self.calls.fetch_add(1, Ordering::Relaxed);
        ctx.host.progress(1, 1, "mixed");
        if self.fails_at.contains(&0) {
            return Err(Fault::new("requested failure"));
        }
        Ok(Outputs::one("model", artifact(mix(mix(self.salt, s), t.unwrap_or(3)))))
    }
}

/// A source of numbers.
pub(crate) struct Numbers {
    pub frames: Vec<Frame>,
    pub toy: Toy,
}

impl Numbers {
    pub(crate) fn new(frames: u64) -> Self {
        // Indices start at 1, so that positions and indices are not the same.
        Self { frames: (1..=frames).map(|k| Frame::at_10_hz(format!("f{k}"), k)).collect(), toy: Toy::salted(1) }
    }
}

impl Source for Numbers {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        Ok(Key::of_content(&self.frames[position].index.to_le_bytes()))
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let frame = self.frames[position].index;
        let outputs = self.toy.work(frame, &[Some(frame)], ctx)?;
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}

pub(crate) fn output(port: Port) -> PlannedOutput {
    PlannedOutput { topic: format!("/toys/{}", port.name), port, aliases: Vec::new(), recorded: true }
}

/// What every toy and the source give on a frame.
pub(crate) fn frame_outputs() -> Vec<PlannedOutput> {
    let [x, y] = ["x", "y"].map(|name| Port::frame(name, ValueType::Calibration, "a number"));
    vec![output(x), output(y.optional())]
}

/// A toy in a plan: wired, not built.
pub(crate) fn planned(name: &str, contract: Contract, from: [Option<Origin>; 3]) -> PlannedNode {
    let numbers = |name| Port::frame(name, ValueType::Calibration, "a number");
    let once = |name| Port::once(name, ValueType::Samples, "a number");
    let (ports, outputs) = match contract {
        Contract::Pure => (vec![numbers("a"), numbers("b").optional(), once("c").optional()], frame_outputs()),
        Contract::Ordered => {
            let outputs = frame_outputs().into_iter().chain([output(once("sum"))]).collect();
            (vec![numbers("a"), numbers("b").optional(), once("c").optional()], outputs)
        }
        Contract::Once => (vec![once("s"), once("t").optional()], vec![output(once("model"))]),
    };
    PlannedNode {
        name: name.to_owned(),
        kind: format!("toy/{}", contract.name()),
        version: 1,
        contract,
        params: serde_json::Value::Null,
        shown: serde_json::Value::Null,
        portable: serde_json::Value::Null,
        auto: Vec::new(),
        inputs: ports.into_iter().zip(from).map(|(port, from)| PlannedInput { port, from, shown: None }).collect(),
        outputs,
        observes: None,
        node_hash: Key::of_content(name.as_bytes()),
        variants: vec![VariantId(0)],
    }
}

pub(crate) fn build(contract: Contract, toy: Toy) -> Instance {
    match contract {
        Contract::Pure => Instance::Pure(Box::new(toy)),
        Contract::Ordered => Instance::Ordered(Box::new(OrderedToy { toy, state: 0 })),
        Contract::Once => Instance::Once(Box::new(toy)),
    }
}

/// A plan with what stands behind it, put together by hand.
pub(crate) struct Bench {
    pub plan: Plan,
    pub runs: Vec<ReadyRun>,
}

impl Bench {
    pub(crate) fn new(variants: &[&str]) -> Self {
        let plan = Plan {
            experiment: "toys".to_owned(),
            description: String::new(),
            variants: variants.iter().map(|&v| v.to_owned()).collect(),
            factors: Vec::new(),
            labels: depthloom_graphs::plan::Labels::default(),
            runs: Vec::new(),
            record: Record { every: 1, view: false, points: Vec::new() },
            written: Vec::new(),
            resolved: String::new(),
        };
        Self { plan, runs: Vec::new() }
    }

    pub(crate) fn stage(&mut self, name: &str, source: impl Source + 'static) {
        self.plan.runs.push(StageRun {
            stage: name.to_owned(),
            prefix: format!("/{name}"),
            source: PlannedSource { name: "numbers".to_owned(), parts: Vec::new(), outputs: frame_outputs() },
            nodes: Vec::new(),
            estimates: Vec::new(),
            variants: VariantId::all(self.plan.variants.len()).collect(),
        });
        self.runs.push(ReadyRun { source: Box::new(source), nodes: Vec::new() });
    }

    /// Adds a node to the stage last added.
    pub(crate) fn node(&mut self, planned: PlannedNode, instance: Instance) {
        self.plan.runs.last_mut().expect("a stage was added").nodes.push(planned);
        self.runs.last_mut().expect("a stage was added").nodes.push(instance);
    }

    pub(crate) fn toy(&mut self, name: &str, contract: Contract, from: [Option<Origin>; 3], toy: Toy) {
        self.node(planned(name, contract, from), build(contract, toy));
    }

    pub(crate) fn ready(self) -> Ready {
        Ready {
            plan: self.plan,
            runs: self.runs,
            files: BTreeMap::new(),
            warnings: Vec::new(),
            builders: BTreeMap::new(),
        }
    }
}

pub(crate) fn source(port: usize) -> Option<Origin> {
    Some(Origin::Here(Slot::Source { port: PortId(port) }))
}

pub(crate) fn node(node: usize, port: usize) -> Option<Origin> {
    Some(Origin::Here(node_slot(node, port)))
}

pub(crate) fn once(run: usize, node: usize, port: usize) -> Option<Origin> {
    Some(Origin::Once { run: RunId(run), node: NodeId(node), port: PortId(port) })
}

pub(crate) const fn node_slot(node: usize, port: usize) -> Slot {
    Slot::Node { node: NodeId(node), port: PortId(port) }
}

/// What a sink was given, in words.
pub(crate) fn told_value(value: &Value) -> String {
    match value {
        Value::Calibration(number) => format!("{:x}", read(number)),
        Value::Samples(bytes) => format!("{:x}", read_artifact(bytes)),
        other => format!("{other:?}"),
    }
}

/// A panic's message without its place.
pub(crate) fn without_place(what: &str) -> &str {
    if what.starts_with("panicked at ") { what.rsplit(": ").next().unwrap_or(what) } else { what }
}

pub(crate) fn commit_text(commit: &Commit<'_>, parts: &[String]) -> String {
    let keys: Vec<_> = commit.keys.iter().map(|k| format!("{}:{}", k.node, k.key)).collect();
    let failures: Vec<_> = commit.failures.iter().map(|f| format!("{:?} {}", f.node, without_place(&f.what))).collect();
    format!("{} {} {:?} {keys:?} {failures:?} {parts:?}", commit.run, commit.frame.id, commit.source_key)
}

pub(crate) fn part_text(part: PartId, values: &[(Slot, Value)]) -> String {
    let values: Vec<_> = values.iter().map(|(slot, value)| format!("{slot:?}={}", told_value(value))).collect();
    format!("{part}: {}", values.join(" "))
}

/// A sink that writes down all it is given. Values go to one of `parts` parts; with none, nothing is taken.
#[derive(Default)]
pub(crate) struct Notebook {
    pub parts: usize,
    pub lines: Mutex<Vec<String>>,
    pub refuses_to_encode: BTreeSet<u64>,
    pub refuses_to_write: BTreeSet<u64>,
    pub on_write: Option<Box<dyn Fn(u64) + Send + Sync>>,
}

impl Notebook {
    pub(crate) fn with_parts(parts: usize) -> Self {
        Self { parts, ..Self::default() }
    }

    pub(crate) fn lines(&self) -> Vec<String> {
        self.lines.lock().expect("the lock is not poisoned").clone()
    }
}

/// Which part of the notebook a slot belongs to; some belong to none.
pub(crate) fn part_of(parts: usize, slot: Slot) -> Option<PartId> {
    let n = match slot {
        Slot::Source { port } => port.0,
        Slot::Node { node, port } => 3 * node.0 + port.0,
    };
    if parts == 0 || n % 5 == 4 { None } else { Some(PartId(n % parts)) }
}

impl Sink for Notebook {
    type Part = String;

    fn parts(&self, _run: RunId) -> usize {
        self.parts
    }

    fn part(&self, _run: RunId, slot: Slot) -> Option<PartId> {
        part_of(self.parts, slot)
    }

    fn encode(
        &self,
        _: RunId,
        (_, frame): (FrameIndex, &Frame),
        part: PartId,
        values: &[(Slot, Value)],
    ) -> Result<String, ErrorMessage> {
        if self.refuses_to_encode.contains(&frame.index) {
            return Err(ErrorMessage::new("no ink"));
        }
        Ok(part_text(part, values))
    }

    fn write(&self, commit: &Commit<'_>, parts: Vec<String>) -> Result<(), ErrorMessage> {
        if self.refuses_to_write.contains(&commit.frame.index) {
            return Err(ErrorMessage::new("no paper"));
        }
        self.lines.lock().expect("the lock is not poisoned").push(commit_text(commit, &parts));
        self.on_write.iter().for_each(|f| f(commit.frame.index));
        Ok(())
    }

    fn once(&self, run: RunId, slot: Slot, key: &Key, value: &Value, _: &[NodeWarning]) -> Result<(), ErrorMessage> {
        self.lines
            .lock()
            .expect("the lock is not poisoned")
            .push(format!("{run} {slot:?} {key} {}", told_value(value)));
        Ok(())
    }
}

/// The key under which a value enters other keys: an artefact's hash, or that of its port.
pub(crate) fn aggregate_key(value: &Value, node: &Key, port: &str) -> Key {
    match value {
        Value::Samples(artifact) => artifact.hash,
        _ => value_keys::port(node, port),
    }
}
