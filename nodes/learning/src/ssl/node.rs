//! The kind `learn/ssl`.

use std::sync::Arc;
use std::time::Instant;

use depthloom_graphs::contracts::{Contract, NodeDeclaration};
use depthloom_graphs::values::{Artifact, Curve};
use depthloom_graphs::{Context, Fault, Host, Inputs, Instance, Key, Node, OnceNode, Outputs, Port, ValueType};
use rayon::ThreadPool;
use rustix::time::{ClockId, clock_gettime};

use super::checkpoint::Checkpoint;
use super::params::SslParams;
use super::train::{State, Training};
use super::weights;
use crate::networks::{Layout, Network, Size, export, layout};
use crate::onnx::weights::NamedTensor;
use crate::samples::Samples;

/// Raised whenever equal samples and parameters give another network.
const VERSION: u32 = 1;

/// The kind `learn/ssl`.
pub struct Ssl {
    params: SslParams,
    weights: Option<Vec<NamedTensor>>,
    weights_key: Option<Key>,
}

impl Node for Ssl {
    type Params = SslParams;

    fn declaration() -> NodeDeclaration {
        NodeDeclaration {
            kind: "learn/ssl",
            version: VERSION,
            contract: Contract::Once,
            summary: "Teaches a still-mono network from the robot's own stereo: no ground truth.",
            doc: "\
The loss is the paper's, the masked mean absolute error `l = mean over C of |Z_m - Z_s|` (Martins et al. 2018), on inverse depth, depth or log depth; beside it, if asked for, \
the left-right photometric loss of Godard et al. 2017. The optimiser is Adam. A step's samples and their changes depend on `seed` and the step alone, and gradients are added up in a \
fixed order: the same samples give the same network, bit for bit, with any number of workers, killed and resumed or not.\n\n\
The network is an ONNX file (opset 13): input `image`, Nx3xHxW, RGB in [0, 1], area resized to the samples' size; output `disparity_share` (disparity as a share of the image's width) or `depth` \
(metres, `eigen-coarse`). Its metadata tell input size, normalisation, meaning and the training's key.\n\n\
Networks: `unet-lite`, 1.07 M parameters; `fcn-lite`, without skips; `fcn-vgg16`, the paper's, whose first 8 convolutions keep the weights given by `weights` \
(names as torchvision's: `features.0.weight`); `eigen-coarse`, the on-board one.\n\n\
With `validation`, samples of another stage, the network that agrees best with their stereo is given, and `patience` stops early. Every `checkpoint_every` steps \
the state is put down beside the run; a run begun again after a kill goes on there.",
            inputs: vec![
                Port::once("samples", ValueType::Samples, "What to learn from: `learn/samples`."),
                Port::once("validation", ValueType::Samples, "Samples of another stage, to see when it is best.")
                    .optional(),
            ],
            outputs: vec![
                Port::once("model", ValueType::Model, "The network, ONNX."),
                Port::once("curve", ValueType::Curve, "Loss, validation error and learning rate against steps."),
            ],
        }
    }

    fn check(params: &SslParams) -> Result<(), (&'static str, String)> {
        if params.patience.is_some() && params.curve_every > params.steps {
            return Err(("curve_every", "curve_every must not exceed steps where patience waits for it".to_owned()));
        }
        if params.network == Network::FcnVgg16 && params.weights.is_none() {
            return Err((
                "weights",
                "fcn-vgg16 keeps its first 8 convolutions as they are: name a file of pretrained weights".to_owned(),
            ));
        }
        Ok(())
    }

    fn fingerprint(params: &SslParams) -> Result<Option<Key>, Fault> {
        let key = Key::build("learning").text("burn 0.22").text(if cfg!(feature = "gpu") { "gpu" } else { "cpu" });
        Ok(Some(match &params.weights {
            Some(file) => key.key(&weights::read(file.path())?.1).finish(),
            None => key.finish(),
        }))
    }

    fn build(params: SslParams) -> Result<Instance, Fault> {
        let read = params.weights.as_ref().map(|file| weights::read(file.path())).transpose()?;
        let (weights, weights_key) = read.unzip();
        Ok(Instance::Once(Box::new(Self { params, weights, weights_key })))
    }
}

impl OnceNode for Ssl {
    fn run(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let artifact = inputs.get::<Artifact>("samples")?;
        let held_out = inputs.optional::<Artifact>("validation")?;
        let samples = self.samples("samples", artifact)?;
        let validation = held_out.map(|artifact| self.samples("validation", artifact)).transpose()?;
        let size = Size { width: samples.width as usize, height: samples.height as usize };
        self.check_size(size)?;
        if let Some(other) = &validation
            && (other.width, other.height) != (samples.width, samples.height)
        {
            return Err(Fault::new(format!(
                "validation samples are {}x{}, samples {}x{}",
                other.width, other.height, samples.width, samples.height
            ))
            .remedy("give both `learn/samples` the same `size`"));
        }
        if self.params.patience.is_some() && validation.is_none() {
            return Err(Fault::new(
                "`patience` waits for a better validation error, and no samples are wired to `validation`",
            )
            .remedy("wire validation samples, or leave `patience` out"));
        }
        if self.params.photometric > 0.0 && !samples.has_right {
            return Err(Fault::new("the photometric loss needs the right view, which the samples do not hold")
                .remedy("wire `right: source/right` at `learn/samples`"));
        }
        let layout = layout(self.params.network, size);
        let key = self.key(&artifact.hash, held_out.map(|held_out| &held_out.hash))?;
        let learn = || self.learn(&layout, &samples, validation.as_ref(), &key, ctx.host);
        let pool = pool(ctx.host.width(), self.params.batch)?;
        let learned = pool.install(learn);
        ctx.host.spent(spent_ns(&pool));
        let (values, curve) = learned?;
        let file = export(self.params.network, size, &values, &key.to_string());
        Ok(Outputs::one("model", depthloom_graphs::Value::Model(Arc::new(Artifact::new("application/onnx", file))))
            .with("curve", curve))
    }
}

impl Ssl {
    fn samples(&self, port: &str, artifact: &Artifact) -> Result<Samples, Fault> {
        let damaged = |error| Fault::new(format!("what is at `{port}` cannot be read as samples")).because(error);
        let samples = Samples::decode(&artifact.bytes).map_err(damaged)?;
        if samples.is_empty() {
            return Err(Fault::new(format!("there are no samples at `{port}`: no frame had a target")).remedy(
                "see that the stage has frames, and that mask and disparity of `learn/samples` leave something",
            ));
        }
        if self.params.needs_depth() && !samples.has_depth_scale() {
            let network = self.params.network.name();
            return Err(Fault::new(format!(
                "depth cannot be told from the samples at `{port}`: they hold no calibration"
            ))
            .remedy(format!(
                "wire `calibration: source/calibration` at `learn/samples`, which {network} with this loss needs"
            )));
        }
        Ok(samples)
    }

    fn check_size(&self, size: Size) -> Result<(), Fault> {
        let (network, multiple) = (self.params.network, self.params.network.multiple());
        if size.width.is_multiple_of(multiple) && size.height.is_multiple_of(multiple) {
            return Ok(());
        }
        let up = |side: usize| side.next_multiple_of(multiple);
        Err(Fault::new(format!(
            "{} wants images whose sides are multiples of {multiple}; the samples are {}x{}",
            network.name(),
            size.width,
            size.height
        ))
        .remedy(format!("set `size: [{}, {}]` at `learn/samples`", up(size.width), up(size.height))))
    }

    /// Names this training: the samples and every parameter that decides the result.
    fn key(&self, samples: &Key, validation: Option<&Key>) -> Result<Key, Fault> {
        // How often it is put down, and where pretrained weights lie, decide nothing; what is in them does.
        let params = SslParams { checkpoint_every: 1, weights: None, ..self.params.clone() };
        let params =
            serde_json::to_string(&params).map_err(|error| Fault::new("parameters have no text").because(error))?;
        let mut key = Key::build("training").number(u64::from(VERSION)).text(&params).key(samples);
        for of in validation.into_iter().chain(&self.weights_key) {
            key = key.key(of);
        }
        Ok(key.finish())
    }

    fn learn(
        &self,
        layout: &Layout,
        samples: &Samples,
        validation: Option<&Samples>,
        key: &Key,
        host: &dyn Host,
    ) -> Result<(Vec<Vec<f32>>, Curve), Fault> {
        let checkpoint = host.checkpoints().map(|folder| Checkpoint::of(folder, key));
        let state = match checkpoint.as_ref().and_then(|checkpoint| checkpoint.load(layout)) {
            Some(state) => state,
            None => State { values: self.start(layout)?, ..State::default() },
        };
        let mut training = Training::resume(&self.params, layout, samples, validation, state);
        let (began, first) = (Instant::now(), training.step());
        while !training.is_over() {
            if host.cancelled() {
                if let Some(checkpoint) = &checkpoint {
                    checkpoint.save(layout, &training.state())?;
                }
                return Err(Fault::Cancelled);
            }
            training.advance();
            if !training.loss().is_finite() {
                return Err(diverged());
            }
            let step = training.step();
            let seconds = began.elapsed().as_secs_f64();
            let per_second = (step - first) as f64 / seconds.max(1e-9);
            let left = self.params.steps.saturating_sub(step) as f64 / per_second;
            let message = format!("loss {:.5}, {per_second:.1} steps/s, {left:.0} s left", training.loss());
            host.progress(step, self.params.steps, &message);
            if let Some(checkpoint) = &checkpoint
                && step.is_multiple_of(self.params.checkpoint_every)
                && !training.is_over()
            {
                checkpoint.save(layout, &training.state())?;
            }
        }
        let learned = training.learned();
        if learned.iter().flatten().any(|value| !value.is_finite()) {
            return Err(diverged());
        }
        if let Some(checkpoint) = &checkpoint {
            checkpoint.remove();
        }
        Ok((learned, Curve { points: training.points().to_vec() }))
    }

    /// The first values: random ones, and in their place what the file of weights has.
    fn start(&self, layout: &Layout) -> Result<Vec<Vec<f32>>, Fault> {
        let mut values = layout.start(self.params.seed);
        if let (Some(weights), Some(file)) = (&self.weights, &self.params.weights) {
            weights::fill(layout, weights, file.path(), &mut values)?;
        }
        Ok(values)
    }
}

/// Processor time of the pool's threads since they began, nanoseconds.
fn spent_ns(pool: &ThreadPool) -> u64 {
    let of_thread = |_: rayon::BroadcastContext<'_>| {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec.unsigned_abs() * 1_000_000_000 + time.tv_nsec.unsigned_abs()
    };
    pool.broadcast(of_thread).into_iter().sum()
}

fn diverged() -> Fault {
    Fault::new("learning diverged: the loss or the weights are no longer numbers")
        .remedy("lower `learning_rate`, or choose another `seed`")
}

/// The threads of one training. More than the batch has images would find nothing to do. Trainings at once have threads of their own,
/// so that each one's processor time is known; the cores they share.
fn pool(width: usize, batch: u32) -> Result<ThreadPool, Fault> {
    let named = |index| format!("depthloom-learning-{index}");
    let threads = width.min(batch as usize).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(named).build();
    pool.map_err(|error| Fault::new("failed to start the threads of learning").because(error))
}
