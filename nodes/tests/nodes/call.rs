//! What the tests of nodes share: one node or source called as the runner would.

use depthloom_graphs::plan::FrameIndex;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use depthloom_graphs::contracts::InlineHost;
use depthloom_graphs::values::Raster;
use depthloom_graphs::{Context, Fault, Frame, Host, Inputs, Instance, Key, Port, Registry, Scratch, Source, Value};
use serde_json::Value as Json;

/// The values at a node's output ports.
pub(crate) type Values = BTreeMap<&'static str, Value>;

/// A node built and called for one frame, as the runner does it: parameters resolved, ports in order, outputs checked.
pub(crate) fn call(kind: &str, params: &Json, inputs: &[(&str, Value)]) -> Result<Values, Fault> {
    let registry = depthloom_nodes::registry();
    let node = registry.node_kind(kind).unwrap_or_else(|| panic!("{kind} is not registered"));
    let resolved =
        node.resolve(params).map_err(|error| Fault::new(format!("{}: {}", error.path.join("."), error.what)))?;
    let signature = node.signature(&resolved)?;
    let ports = &signature.inputs;
    let unknown = inputs.iter().find(|(name, _)| ports.iter().all(|port| port.name != *name));
    assert!(unknown.is_none(), "{kind} has no input {:?}", unknown.map(|(name, _)| name));
    let values: Vec<Option<Value>> = ports
        .iter()
        .map(|port| inputs.iter().find(|(name, _)| *name == port.name).map(|(_, value)| value.clone()))
        .collect();
    let mut scratch = Scratch::default();
    let (inputs, ctx) = (Inputs::new(ports, &values), &mut Context::new(&InlineHost, &mut scratch));
    let outputs = match node.build(&resolved)? {
        Instance::Pure(instance) if signature.observes.is_some() => {
            instance.process_frame(&Frame::at_10_hz("0", 0), &inputs, ctx)?
        }
        Instance::Pure(instance) => instance.process(&inputs, ctx)?,
        Instance::Ordered(mut instance) => {
            instance.process(&Frame::at_10_hz("0", 0), &inputs, ctx)?;
            instance.finish(ctx)?
        }
        Instance::Once(_) => panic!("{kind} takes no frames"),
    };
    let outputs = outputs.in_order_of(&signature.outputs)?;
    let named = signature.outputs.iter().zip(outputs);
    Ok(named.filter_map(|(port, value)| Some((port.name, value?))).collect())
}

/// The only output of a node that is expected to work.
pub(crate) fn value(kind: &str, params: &Json, inputs: &[(&str, &Value)]) -> Value {
    let inputs: Vec<(&str, Value)> = inputs.iter().map(|(name, value)| (*name, (*value).clone())).collect();
    let outputs = call(kind, params, &inputs).unwrap_or_else(|fault| panic!("{kind}: {}", fault.chain()));
    assert_eq!(outputs.len(), 1, "{kind} gives one value");
    outputs.into_values().next().unwrap()
}

/// A source, opened.
pub(crate) struct Opened {
    pub source: Box<dyn Source>,
    outputs: Vec<Port>,
}

/// Opens a source as the runner does.
pub(crate) fn open(kind: &str, params: &Json) -> Result<Opened, Fault> {
    let registry: Registry = depthloom_nodes::registry();
    let entry = registry.source_kind(kind).unwrap_or_else(|| panic!("{kind} is not registered"));
    let resolved =
        entry.resolve(params).map_err(|error| Fault::new(format!("{}: {}", error.path.join("."), error.what)))?;
    Ok(Opened { source: entry.open(&resolved)?, outputs: entry.outputs(&resolved)? })
}

impl Opened {
    /// A frame's values and key.
    pub(crate) fn read(&self, position: FrameIndex) -> Result<(Values, Key), Fault> {
        self.read_on(&InlineHost, position)
    }

    /// As [`Opened::read`], on a host of the test's own.
    pub(crate) fn read_on(&self, host: &dyn Host, position: FrameIndex) -> Result<(Values, Key), Fault> {
        let mut scratch = Scratch::default();
        let key = self.source.key(position)?;
        let read = self.source.read(position, &mut Context::new(host, &mut scratch))?;
        let outputs = read.outputs.in_order_of(&self.outputs)?;
        let named = self.outputs.iter().zip(outputs);
        assert_eq!(key, read.key, "a key is known before the frame is read");
        Ok((named.filter_map(|(port, value)| Some((port.name, value?))).collect(), read.key))
    }
}

/// A depth map's pixels.
pub(crate) fn metres(value: &Value) -> &[f32] {
    value.metres().unwrap_or_else(|| panic!("{} is not a depth", value.value_type())).as_raw()
}

/// A 16-bit PNG of the reference.
pub(crate) fn png_u16(path: &Path) -> Raster<u16> {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let image::DynamicImage::ImageLuma16(map) = image else { panic!("{} has not 16 bits", path.display()) };
    map
}

/// An ONNX model as a once-value.
pub(crate) fn model(bytes: Vec<u8>) -> Value {
    Value::Model(Arc::new(depthloom_graphs::values::Artifact::model(bytes)))
}
