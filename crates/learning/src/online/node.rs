//! The kind `learn/online`.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::contracts::{Contract, NodeDeclaration, Upstream};
use depthloom_graphs::values::{Artifact, Calibration, Curve, CurvePoint, Image, Number};
use depthloom_graphs::{
    Context, Fault, Frame, Host, Inputs, Instance, Key, Node, OrderedNode, Outputs, Port, Value, ValueType,
};

use super::params::OnlineParams;
use super::predictor::Predictor;
use super::round::{Round, Task, TrainedState};
use crate::compute::ARITHMETIC;
use crate::networks::{Network, ParameterLayout, Size, export, layout};
use crate::onnx::weights::decode_weights;
use crate::samples::{Sample, Sampler, depth_scale, small};
use crate::ssl::{SslParams, fill, matched};
use crate::training::State;

/// Raised whenever equal frames and parameters give other outputs.
const VERSION: u32 = 1;

pub(crate) struct Online {
    params: OnlineParams,
    layout: Arc<ParameterLayout>,
    predictor: Predictor,
    sampler: Sampler,
    /// The most recent samples, the oldest first.
    memory: VecDeque<Arc<Sample>>,
    /// Samples so far, including those that left the memory.
    sample_count: u64,
    /// Frames so far.
    frame_count: u64,
    /// Weights and optimiser of the current network; `None` before the first frame.
    state: Option<Arc<State>>,
    version: u64,
    /// Whether version 0 is the network of the input `model`.
    has_model: bool,
    round: Option<ActiveRound>,
    /// Whether the input `schedule` had a value.
    has_schedule: bool,
    points: Vec<CurvePoint>,
}

struct ActiveRound {
    round: Round,
    /// The number of the frame on which its network is due.
    due: u64,
}

impl Node for Online {
    type Params = OnlineParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "learn/online",
            version: VERSION,
            contract: Contract::Ordered,
            summary: "Trains a monocular network on the stream while it predicts, and replaces it between frames.",
            doc: "\
**Rounds.** Training happens in rounds, on a thread in the background. A round trains the current network for `steps` more steps on the most recent \
`memory` samples. Samples and loss are those of `learn/samples` and `learn/ssl`, with a constant learning rate; Adam's moments are kept between rounds. The first round \
starts with sample number `first`. Its network replaces the current one `period` frames later, before that frame is computed. With this frame the next round starts.\n\n\
**Versions.** `version` is the number of the network that computed a frame. Version 0 is `model`, an ONNX file of `learn/ssl` or `learn/online` with the same \
`network`. Without `model`, version 0 is an untrained network, and its frames have no `depth`. `depth` is what `mono/onnx` computes from the network's file.\n\n\
**Runs that wait.** If a round is not finished when its network is due, the node waits. The outputs then depend only on the frames and the parameters.\n\n\
**Live runs.** A live run never waits. If training takes longer, the network is put into use on the first frame after it has finished. \
From the due frame on, the cache keys of the outputs then differ from those of a run that waits.\n\n\
**Replay.** Record `version` in the live run. A run over the recording that wires the recorded `version` to `schedule` (for example `source/online.version`) replaces \
networks on the same frames. It gives the same networks and depths, bit for bit. `schedule` also makes a live run wait.\n\n\
The outputs `model` and `curve` are those of the last network in use. The curve has one point per version: the mean training loss of its round. An \
unfinished round is cancelled at the end.",
            inputs: vec![
                Port::frame("image", ValueType::Image, "The left image, grey or RGB, no smaller than `size`."),
                Port::frame("target", ValueType::Disparity, "Disparity of the image's pixels, 1/16 px."),
                Port::frame("mask", ValueType::Mask, "Where the disparity is confident enough for training."),
                Port::frame("calibration", ValueType::Calibration, "Focal length and baseline."),
                Port::once("model", ValueType::Model, "The first network, ONNX, with the same `network`.").optional(),
                Port::frame("schedule", ValueType::Number, "The recorded `version` of an earlier run, to repeat it.")
                    .repeats("version")
                    .optional(),
            ],
            outputs: vec![
                Port::frame(
                    "depth",
                    ValueType::Depth,
                    "Depth, f32 metres, NaN = invalid; same size as the image. Absent before there is a trained network.",
                )
                .optional(),
                Port::frame("version", ValueType::Number, "Which network computed this frame: 0, 1, 2, ..."),
                Port::once("model", ValueType::Model, "The last network in use, ONNX."),
                Port::once("curve", ValueType::Curve, "Training loss of each network against steps."),
            ],
        }
    }

    fn check(params: &OnlineParams) -> Result<(), (&'static str, String)> {
        params.sampling().check()?;
        params.check_size()
    }

    fn check_inputs(params: &OnlineParams, upstream: &Upstream<'_>) -> Result<(), Fault> {
        if params.network == Network::FcnVgg16 && upstream.at("model").is_none() {
            return Err(Fault::new("`model` is not wired, and fcn-vgg16 does not train its first 8 convolutions")
                .remedy("wire a trained network to `model`, or choose another `network`"));
        }
        Ok(())
    }

    fn fingerprint(_params: &OnlineParams) -> Result<Option<Key>, Fault> {
        Ok(Some(Key::build("learning").text(ARITHMETIC).finish()))
    }

    fn build(params: OnlineParams) -> Result<Instance, Fault> {
        Ok(Instance::Ordered(Box::new(Self::new(params))))
    }
}

impl Online {
    pub(super) fn new(params: OnlineParams) -> Self {
        let network = params.training(0).architecture();
        let layout = layout(network, image_size(&params));
        Self {
            predictor: Predictor::new(network, &layout, image_size(&params), params.cap as f32),
            layout: Arc::new(layout),
            sampler: Sampler::new(params.sampling()),
            memory: VecDeque::new(),
            sample_count: 0,
            frame_count: 0,
            state: None,
            version: 0,
            has_model: false,
            round: None,
            has_schedule: false,
            points: Vec::new(),
            params,
        }
    }

    /// The network before the first round: that of `model`, or an untrained one.
    fn initial_state(&self, model: Option<&Artifact>) -> Result<State, Fault> {
        let mut values = self.layout.start(self.params.seed);
        if let Some(model) = model {
            let path = Path::new("model.onnx");
            let tensors = decode_weights(path, &model.bytes)
                .map_err(|error| Fault::new("failed to read the network at `model`").because(error))?;
            let other_network =
                |fault: Fault| fault.remedy("set `network` and `size` to those of the network at `model`");
            let found = matched(&self.layout, &tensors, path).map_err(other_network)?;
            if let Some(missing) = found.iter().position(Option::is_none) {
                let (network, name) = (self.params.network.name(), &self.layout.parameters[missing].name);
                let what = format!("the network at `model` is not {network}: it has no tensor `{name}`");
                return Err(other_network(Fault::new(what)));
            }
            fill(&self.layout, &tensors, path, &mut values)?;
        }
        Ok(State { values, ..State::default() })
    }

    /// The network that replaces the current one on this frame, if any.
    fn replacement(
        &mut self,
        index: u64,
        scheduled: Option<&Number>,
        host: &dyn Host,
    ) -> Result<Option<TrainedState>, Fault> {
        self.has_schedule |= scheduled.is_some();
        if self.has_schedule {
            let Some(scheduled) = scheduled.filter(|number| number.value != self.version as f64) else {
                return Ok(None);
            };
            return match &self.round {
                Some(active) if scheduled.value == (self.version + 1) as f64 => active.round.wait(host).map(Some),
                _ => Err(self.other_schedule(scheduled)),
            };
        }
        let Some(ActiveRound { round, due }) = &self.round else { return Ok(None) };
        if index < *due {
            return Ok(None);
        }
        if !host.is_live() {
            return round.wait(host).map(Some);
        }
        let result = round.try_finish().transpose()?;
        if result.is_none() {
            if index == *due {
                host.notice("a training took longer than `period` frames: its network is put into use later");
            }
            // Keys of later frames contain this one's.
            let key = Key::build("learn/online postponed").number(self.version + 1).number(index).finish();
            host.observe(key);
        }
        Ok(result)
    }

    fn other_schedule(&self, scheduled: &Number) -> Fault {
        let (found, version) = (scheduled.value, self.version);
        let what = match self.round {
            Some(_) => format!("`schedule` is {found} after {version}, expected {version} or {}", version + 1),
            None => format!("`schedule` is {found}, but no training has started since version {version}"),
        };
        Fault::new(what).remedy("wire the recorded `version` of this node, with the parameters and frames of that run")
    }

    fn put_in_use(&mut self, TrainedState { mut state, cpu_ns }: TrainedState, host: &dyn Host) {
        host.add_cpu_time(cpu_ns);
        self.points.append(&mut state.points);
        self.state = Some(Arc::new(state));
        self.version += 1;
        self.round = None;
    }

    fn add_sample(&mut self, sample: Sample) {
        self.sample_count += 1;
        if self.memory.len() == self.params.memory as usize {
            self.memory.pop_front();
        }
        self.memory.push_back(Arc::new(sample));
    }

    /// Starts a round after the frame `index`, if none is active and there are enough samples.
    fn start_round(&mut self, index: u64, state: &Arc<State>, host: &dyn Host) -> Result<(), Fault> {
        if self.round.is_some() || self.sample_count < u64::from(self.params.first) {
            return Ok(());
        }
        let task = Task {
            params: self.params.training(state.step + u64::from(self.params.steps)),
            layout: Arc::clone(&self.layout),
            state: Arc::clone(state),
            size: self.sampler.size(),
            samples: self.memory.iter().cloned().collect(),
        };
        let threads = if host.is_live() { self.params.threads as usize } else { host.width() };
        let round = Round::start(task, threads)?;
        self.round = Some(ActiveRound { round, due: index + u64::from(self.params.period) });
        Ok(())
    }

    /// Waits until the active round, if any, is finished.
    #[cfg(test)]
    pub(super) fn wait_for_training(&self) {
        while self.round.as_ref().is_some_and(|active| !active.round.is_finished()) {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }

    #[cfg(test)]
    pub(super) fn values(&self) -> &Vec<Vec<f32>> {
        &self.state.as_ref().expect("there was a frame").values
    }

    #[cfg(test)]
    pub(super) fn memory_len(&self) -> usize {
        self.memory.len()
    }
}

impl OrderedNode for Online {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let index = self.frame_count;
        self.frame_count += 1;
        if self.state.is_none() {
            let model = inputs.optional::<Artifact>("model")?;
            self.has_model = model.is_some();
            self.state = Some(Arc::new(self.initial_state(model.map(|model| &**model))?));
        }
        let scheduled = inputs.optional::<Number>("schedule")?;
        if let Some(trained) = self.replacement(index, scheduled.map(|number| &**number), ctx.host)? {
            self.put_in_use(trained, ctx.host);
        }
        let state = Arc::clone(self.state.as_ref().expect("the first frame sets it"));
        let (image, calibration) = (inputs.get::<Image>("image")?, inputs.get::<Calibration>("calibration")?);
        let scale = scale_of_depth(calibration, image.dimensions().0, &self.params.training(0))?;
        let planes = small(self.sampler.size(), "image", image)?;
        let mut outputs = Outputs::one("version", Number { value: self.version as f64 });
        if self.has_model || self.version > 0 {
            let depth = self.predictor.depth(&planes, &state.values, calibration, image.dimensions())?;
            outputs = outputs.with("depth", depth);
        }
        if let Some(sample) = self.sampler.sample(frame, inputs, planes, scale)? {
            self.add_sample(sample);
        }
        self.start_round(index, &state, ctx.host)?;
        Ok(outputs)
    }

    fn finish(mut self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.round = None;
        if self.version == 0 && !self.has_model {
            ctx.host.warn("no round of training was finished: the output `model` is an untrained network");
        }
        let state = match self.state.take() {
            Some(state) => state,
            None => Arc::new(self.initial_state(None)?),
        };
        // A hash of the weights and not the node's cache key, so that a replay writes the same file.
        let key = state.values.iter().fold(Key::build("learn/online"), |key, values| {
            key.bytes(&values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
        });
        let network = self.params.training(0).architecture();
        let file = export(network, image_size(&self.params), &state.values, &key.finish().to_string());
        let model = Value::Model(Arc::new(Artifact::model(file)));
        Ok(Outputs::one("model", model).with("curve", Curve { points: self.points }))
    }
}

fn image_size(params: &OnlineParams) -> Size {
    let [width, height] = params.size.map(|side| side as usize);
    Size { width, height }
}

/// `f * B / width`, metres; `None` where the training does not need it and it does not exist.
fn scale_of_depth(calibration: &Calibration, width: u32, training: &SslParams) -> Result<Option<f64>, Fault> {
    if calibration.is_single_camera() {
        return Err(Fault::new("`calibration` is that of a single camera, but training requires a stereo pair")
            .remedy("set `baseline_m` in the calibration of the source"));
    }
    if calibration.doffs_px == 0.0 {
        return depth_scale(calibration, width).map(Some);
    }
    if training.needs_depth() {
        let what = format!(
            "the principal points of `calibration` are {} px apart, but training in metres requires equal ones",
            calibration.doffs_px
        );
        return Err(Fault::new(what).remedy("set `loss: inverse-depth` and a `network` other than eigen-coarse"));
    }
    Ok(None)
}
