//! Remedies for failures of frames, which failure records do not contain but the recorder reports.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use depthloom_graphs::contracts::{OrderedNode, PureNode};
use depthloom_graphs::plan::FrameIndex;
use depthloom_graphs::{Context, Fault, Frame, Inputs, Instance, Outputs};
use depthloom_threads::locked;

/// By frame.
pub(crate) type Remedies = Mutex<BTreeMap<FrameIndex, String>>;

pub(crate) fn keep_remedy(remedies: &Remedies, position: Option<FrameIndex>, fault: &Fault) {
    if let (Some(position), Some(remedy)) = (position, fault.remedy_text()) {
        locked(remedies).insert(position, remedy.to_owned());
    }
}

/// A node that keeps the remedies of its failures.
pub(crate) fn guarded(instance: Instance, remedies: &Arc<Remedies>) -> Instance {
    match instance {
        Instance::Pure(node) => Instance::Pure(Box::new(Guarded { node, remedies: Arc::clone(remedies) })),
        Instance::Ordered(node) => Instance::Ordered(Box::new(Guarded { node, remedies: Arc::clone(remedies) })),
        // The runner ends by its failure, and reports its remedy.
        Instance::Once(_) => instance,
    }
}

struct Guarded<N: ?Sized> {
    node: Box<N>,
    remedies: Arc<Remedies>,
}

impl OrderedNode for Guarded<dyn OrderedNode> {
    fn process(&mut self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let outputs = self.node.process(frame, inputs, ctx);
        outputs.inspect_err(|fault| keep_remedy(&self.remedies, ctx.host.position(), fault))
    }

    fn finish(self: Box<Self>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.node.finish(ctx)
    }
}

impl PureNode for Guarded<dyn PureNode> {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        self.node.process(inputs, ctx).inspect_err(|fault| keep_remedy(&self.remedies, ctx.host.position(), fault))
    }

    fn process_frame(&self, frame: &Frame, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let processed = self.node.process_frame(frame, inputs, ctx);
        processed.inspect_err(|fault| keep_remedy(&self.remedies, ctx.host.position(), fault))
    }
}
