//! The inputs of a part: admitted frames of its own data, and frames and aggregate values from other parts.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use depthloom_graphs::contracts::AggregateNode;
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Context, Fault, Frame, Inputs, Key, Outputs, Port, Source, SourceOutputs};
use depthloom_runner::Interrupt;

use crate::bridge::Bridge;
use crate::channel;
use crate::mailbox::Gone;
use crate::remedies::{Remedies, keep_remedy};

/// A node that outputs the aggregate value received at an input.
pub(crate) struct Received {
    pub bridge: Arc<Bridge>,
    pub port: Port,
    pub interrupt: Interrupt,
}

impl AggregateNode for Received {
    fn run(&self, _: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let arrived = self.bridge.mailbox.take(self.port.name, None, &|| ctx.host.cancelled());
        let value = arrived.map_err(|gone| ended(&gone, &self.interrupt))?.value(self.port.value_type)?;
        Ok(value.map_or_else(Outputs::none, |value| Outputs::one(self.port.name, value)))
    }
}

/// Frames whose values come from other parts.
pub(crate) struct Incoming {
    pub bridge: Arc<Bridge>,
    pub frames: Vec<Frame>,
    pub ports: Vec<Port>,
    pub interrupt: Interrupt,
}

/// When its input ends, a part stops. The recorder reports why.
fn ended(gone: &Gone, interrupt: &Interrupt) -> Fault {
    if matches!(gone, Gone::Ended(_)) {
        while interrupt.raise() < 2 {}
    }
    Fault::Cancelled
}

impl Source for Incoming {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        Ok(Key::build("dora").number(position.0 as u64).finish())
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        let mut outputs = Outputs::none();
        for port in &self.ports {
            let arrived = self.bridge.mailbox.take(port.name, Some(position), &|| ctx.host.cancelled());
            let arrived = arrived.map_err(|gone| ended(&gone, &self.interrupt))?;
            if let Some(value) = arrived.value(port.value_type)? {
                outputs = outputs.with(port.name, value);
            }
        }
        Ok(SourceOutputs { outputs, key: self.key(position)? })
    }
}

/// A source that reads a frame once the recorder has admitted it.
pub(crate) struct Admitted {
    pub source: Box<dyn Source>,
    pub bridge: Arc<Bridge>,
    /// How many frames are admitted.
    pub so_far: AtomicUsize,
    pub interrupt: Interrupt,
    pub remedies: Arc<Remedies>,
}

impl Admitted {
    /// Waits until a frame is admitted. Several threads may wait: the one that receives the message wakes the others.
    fn wait(&self, position: FrameIndex) -> Result<(), Fault> {
        let is_in = || self.so_far.load(Ordering::SeqCst) > position.0;
        while !is_in() {
            let no_longer = || self.interrupt.aborts() || is_in();
            match self.bridge.mailbox.take(channel::ADMITTED, None, &no_longer) {
                Ok(arrived) => {
                    let count = arrived.json()?.as_u64().and_then(|count| usize::try_from(count).ok());
                    let count = count.ok_or_else(|| Fault::new("the number of admitted frames is malformed"))?;
                    self.so_far.fetch_max(count, Ordering::SeqCst);
                    self.bridge.mailbox.wake();
                }
                Err(_) if is_in() => {}
                Err(gone) => return Err(gone.into()),
            }
        }
        Ok(())
    }
}

impl Source for Admitted {
    fn frames(&self) -> &[Frame] {
        self.source.frames()
    }

    fn key(&self, position: FrameIndex) -> Result<Key, Fault> {
        self.wait(position)?;
        self.source.key(position).inspect_err(|fault| keep_remedy(&self.remedies, Some(position), fault))
    }

    fn read(&self, position: FrameIndex, ctx: &mut Context<'_>) -> Result<SourceOutputs, Fault> {
        self.source.read(position, ctx).inspect_err(|fault| keep_remedy(&self.remedies, Some(position), fault))
    }
}
