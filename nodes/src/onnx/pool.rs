//! A model in the process's engine, with as many sessions as work at once.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use depthloom_graphs::values::Artifact;
use depthloom_graphs::{Fault, Key};
use depthloom_threads::locked;

use super::binding::{Binding, Feed, OutputTensor};
use super::choice;
use super::engine::Engine;
use super::fit::Sizes;
use super::model::Declared;
use super::provider::Provider;
use super::session::EngineSession;
use super::shapes::Axes;

/// Reads a model's declaration and checks that the engine offers the provider.
pub(crate) fn declared(model: &Artifact, provider: Provider) -> Result<Declared, Fault> {
    let engine = choice::find()?;
    engine.offers(provider)?;
    let declared = Declared::read(&model.bytes).map_err(|what| engine.cannot_load(&model.bytes, what))?;
    if let Some(file) = &declared.external {
        return Err(Fault::new(format!(
            "the network keeps weights in another file (`{file}`), and is run from one alone"
        ))
        .remedy("save it whole: python -c \"import onnx; onnx.save(onnx.load('net.onnx'), 'whole.onnx')\""));
    }
    Ok(declared)
}

/// A node's network, loaded with the first frame and again when a frame brings another model.
pub(crate) struct CachedNetwork<N>(Mutex<Option<(Key, Arc<N>)>>);

impl<N> Default for CachedNetwork<N> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<N> CachedNetwork<N> {
    pub(crate) fn get(&self, model: &Artifact, load: impl FnOnce() -> Result<N, Fault>) -> Result<Arc<N>, Fault> {
        let mut cached = locked(&self.0);
        match &*cached {
            Some((hash, network)) if *hash == model.hash => Ok(Arc::clone(network)),
            _ => {
                let network = Arc::new(load()?);
                *cached = Some((model.hash, Arc::clone(&network)));
                Ok(network)
            }
        }
    }
}

/// The part of a node's fingerprint that the engine decides.
pub(crate) fn engine_key(provider: Provider) -> Result<Option<Key>, Fault> {
    choice::find().map(|engine| Some(engine.fingerprint(provider)))
}

/// A tensor that a model is fed.
pub(crate) struct PoolInput {
    pub name: String,
    pub axes: Axes,
    pub images: usize,
    /// Planes of one image.
    pub planes: usize,
}

/// A model, bound to tensors of each size that the network sees.
pub(crate) struct Pools {
    model: Artifact,
    provider: Provider,
    threads: u32,
    pub inputs: Vec<PoolInput>,
    pub outputs: Vec<String>,
    by_size: Mutex<HashMap<(usize, usize), Arc<Pool>>>,
}

impl Pools {
    pub(crate) fn new(
        model: &Artifact,
        (provider, threads): (Provider, u32),
        inputs: Vec<PoolInput>,
        outputs: Vec<String>,
    ) -> Self {
        Self { model: model.clone(), provider, threads, inputs, outputs, by_size: Mutex::default() }
    }

    pub(crate) fn get(&self, size: (usize, usize)) -> Result<Arc<Pool>, Fault> {
        let mut pools = locked(&self.by_size);
        if let Some(pool) = pools.get(&size) {
            return Ok(Arc::clone(pool));
        }
        let feed = |PoolInput { name, axes, images, planes }: &PoolInput| {
            let shape = axes.shape(*images, *planes, size);
            Feed { name: name.clone(), element: axes.element, shape }
        };
        let binding = Binding { inputs: self.inputs.iter().map(feed).collect(), outputs: self.outputs.clone() };
        let pool = Arc::new(Pool::load(&self.model, self.provider, self.threads, binding)?);
        pools.insert(size, Arc::clone(&pool));
        Ok(pool)
    }

    /// Loads the model at once if its inputs fix the size.
    pub(crate) fn load_fixed(&self, sizes: Sizes) -> Result<(), Fault> {
        sizes.width.zip(sizes.height).map_or(Ok(()), |size| self.get(size).map(|_| ()))
    }
}

pub(crate) struct Pool {
    engine: &'static Engine,
    model: Arc<[u8]>,
    provider: Provider,
    threads: usize,
    binding: Binding,
    // A session's `run` is not thread-safe: every worker borrows a separate session and returns it afterwards.
    sessions: Mutex<Vec<EngineSession>>,
}

impl Pool {
    fn load(model: &Artifact, provider: Provider, threads: u32, binding: Binding) -> Result<Self, Fault> {
        let (model, threads) = (Arc::clone(&model.bytes), threads as usize);
        let pool = Self { engine: choice::find()?, model, provider, threads, binding, sessions: Mutex::default() };
        let session = pool.session()?;
        pool.give_back(session);
        Ok(pool)
    }

    /// Takes one tensor per input of the binding and returns one per output.
    pub(crate) fn run(&self, tensors: &[&[f32]]) -> Result<Vec<OutputTensor>, Fault> {
        let idle = locked(&self.sessions).pop();
        let mut session = idle.map_or_else(|| self.session(), Ok)?;
        let result = session.run(&self.binding, tensors);
        self.give_back(session);
        result.map_err(|error| Fault::new(format!("{} failed to run the network", self.engine.title())).because(error))
    }

    fn session(&self) -> Result<EngineSession, Fault> {
        let mut session = self.engine.session(&self.model, self.provider, self.threads)?;
        session.prepare(&self.binding).map_err(|what| self.engine.cannot_load(&self.model, what))?;
        Ok(session)
    }

    fn give_back(&self, session: EngineSession) {
        locked(&self.sessions).push(session);
    }
}
