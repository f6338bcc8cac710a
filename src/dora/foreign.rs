//! A part that asks a node of somebody else's: it knows of frames and of what is absent, and the other gets messages and answers them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::View;
use depthloom_graphs::contracts::{PureNode, Signature};
use depthloom_graphs::plan::Plan;
use depthloom_graphs::ready::NotReady;
use depthloom_graphs::values::{Depth, Image, Mask, Pixels, Raster, TrueDisparity, Weight};
use depthloom_graphs::{Context, Fault, Inputs, Instance, Key, Node as _, Outputs, Port, Registry, Value, ValueType};
use depthloom_nodes::dora::{Dora, DoraParams, DoraValues};
use image::{GrayImage, RgbImage};
use serde_json::{Map, Value as Json};

use super::bridge::Bridge;
use super::layout::{answered, asked};
use super::mailbox::{Arrived, Gone};
use super::message::{Row, of_value};

/// The node, as the runner sees it, and what it depends on.
pub fn build(
    plan: &Plan,
    (run, node): (usize, usize),
    _: &Registry,
    bridge: &Arc<Bridge>,
) -> Result<(Instance, Option<Key>), Vec<NotReady>> {
    let run = &plan.runs[run];
    let planned = &run.nodes[node];
    let missing = |fault| {
        let (stage, name, kind) = (run.stage.clone(), planned.name.clone(), planned.kind.clone());
        vec![NotReady::Node { stage, name, kind, fault }]
    };
    let params: DoraParams = serde_json::from_value(planned.params.clone())
        .map_err(|error| missing(Fault::new("its parameters cannot be read").because(error)))?;
    params.ask().map_err(missing)?;
    let fingerprint = Dora::fingerprint(&params).map_err(missing)?;
    let Some(Signature { inputs, outputs, .. }) = Dora::signature(&params) else {
        return Err(missing(Fault::new("it has no ports")));
    };
    let wired = |port: &Port| planned.inputs.iter().any(|input| input.port.name == port.name && input.from.is_some());
    let inputs = inputs.into_iter().filter(wired).collect();
    let patience = Duration::from_secs_f64(params.timeout_s);
    let bridge = Arc::clone(bridge);
    let (turn, is_late) = (Mutex::new(()), AtomicBool::new(false));
    let foreign = Foreign { bridge, inputs, outputs, values: params.values, patience, turn, is_late };
    Ok((Instance::Pure(Box::new(foreign)), fingerprint))
}

struct Foreign {
    bridge: Arc<Bridge>,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    values: DoraValues,
    patience: Duration,
    /// One frame at a time.
    turn: Mutex<()>,
    /// Whether an answer did not come in time: then one that does not say of which frame it is may be of another.
    is_late: AtomicBool,
}

impl PureNode for Foreign {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let position = ctx.host.position().ok_or_else(|| Fault::new("it is asked of no frame"))?;
        let mut size = None;
        for port in &self.inputs {
            let value = inputs.value(port.name);
            size = size.or_else(|| value.and_then(size_of));
            self.ask(port, position, value)?;
        }
        let until = Instant::now() + self.patience;
        let mut outputs = Outputs::none();
        for port in &self.outputs {
            let arrived = self.answer(port, position, until, ctx)?;
            let wrong = |what: String| {
                let (name, value_type) = (port.name, port.value_type);
                Fault::new(format!("what came from dora at `{name}` is no {value_type}: {what}"))
            };
            let value = self.value(&arrived, port.value_type, size).map_err(wrong)?;
            outputs = outputs.with(port.name, value);
        }
        Ok(outputs)
    }
}

impl Foreign {
    fn ask(&self, port: &Port, position: usize, value: Option<&Value>) -> Result<(), Fault> {
        let mut metadata = Map::from_iter([("frame".to_owned(), position.into())]);
        let flat = value
            .filter(|_| self.values == DoraValues::Flat)
            .and_then(|value| Some((size_of(value)?, encoding(value)?)));
        if let Some(((width, height), encoding)) = flat {
            metadata.insert("width".to_owned(), width.into());
            metadata.insert("height".to_owned(), height.into());
            metadata.insert("encoding".to_owned(), encoding.into());
        }
        let stream = value.map(of_value).unwrap_or_default();
        self.bridge.send_with(&asked(port.name), metadata, &stream, flat.is_some())
    }

    /// What it answers at a port for a frame.
    fn answer(&self, port: &Port, position: usize, until: Instant, ctx: &Context<'_>) -> Result<Arrived, Fault> {
        let cancelled = || ctx.host.cancelled() || Instant::now() >= until;
        loop {
            let arrived = match self.bridge.mailbox.take_any(&answered(port.name), &cancelled) {
                Ok(arrived) => arrived,
                Err(Gone::Cancelled) if !ctx.host.cancelled() => {
                    self.is_late.store(true, Ordering::Relaxed);
                    let seconds = self.patience.as_secs_f64();
                    return Err(Fault::new(format!("dora's node gave nothing at `{}` within {seconds} s", port.name))
                        .remedy("look at its log (`dora logs`); `timeout_s` is how long it may take"));
                }
                Err(Gone::Ended(_)) => {
                    return Err(Fault::new("dora's node has ended").remedy("look at its log (`dora logs`)"));
                }
                Err(gone) => return Err(gone.into()),
            };
            match arrived.metadata.get("frame").and_then(Json::as_u64) {
                Some(of) if of == position as u64 => return Ok(arrived),
                // Of a frame that was given up.
                Some(of) if of < position as u64 => {}
                None if !self.is_late.load(Ordering::Relaxed) => return Ok(arrived),
                Some(_) | None => {
                    return Err(Fault::new(format!("dora's node answered at `{}`, and nobody knows for which frame", port.name))
                        .remedy("let it pass on the metadata of what it was sent: `node.send_output(name, value, event[\"metadata\"])`"));
                }
            }
        }
    }

    fn value(&self, arrived: &Arrived, value_type: ValueType, size: Option<(u32, u32)>) -> Result<Value, String> {
        if arrived.body.is_empty() {
            return Err("it is nothing".to_owned());
        }
        let row = Row::read(&arrived.body)?;
        if self.values == DoraValues::Struct {
            return row.value(value_type);
        }
        let side =
            |name: &str| arrived.metadata.get(name).and_then(Json::as_u64).and_then(|side| u32::try_from(side).ok());
        let size = side("width").zip(side("height")).or(size).ok_or("it has no `width` and `height`")?;
        let encoding = arrived.metadata.get("encoding").and_then(Json::as_str).unwrap_or_default();
        flat_value(&row.column()?.part("data").ok_or("it is no array of numbers")?, value_type, size, encoding)
    }
}

/// Columns and rows of a map.
fn size_of(value: &Value) -> Option<(u32, u32)> {
    Some(match value {
        Value::Image(image) => image.dimensions(),
        Value::Disparity(of) => of.sixteenths_px.dimensions(),
        Value::TrueDisparity(of) => of.px.dimensions(),
        Value::Depth(of) => of.metres.dimensions(),
        Value::Weight(of) => of.share.dimensions(),
        Value::Mask(of) => of.set.dimensions(),
        Value::Calibration(_) | Value::Scores(_) | Value::Samples(_) | Value::Model(_) | Value::Curve(_) => {
            return None;
        }
    })
}

/// What dora's nodes call the numbers of a map.
fn encoding(value: &Value) -> Option<&'static str> {
    match value {
        Value::Image(image) => Some(match image.pixels() {
            Pixels::Grey(_) => "mono8",
            Pixels::Rgb(_) => "rgb8",
        }),
        Value::Mask(_) => Some("mono8"),
        Value::Depth(_) | Value::Weight(_) | Value::TrueDisparity(_) => Some("32FC1"),
        _ => None,
    }
}

/// The numbers of a map as a value.
fn flat_value(
    data: &View<'_>,
    value_type: ValueType,
    (width, height): (u32, u32),
    encoding: &str,
) -> Result<Value, String> {
    let misfit = |count: usize| format!("it has {count} numbers, which is not {width}x{height} pixels");
    let floats = || -> Result<Raster<f32>, String> {
        let numbers = data.f32s()?;
        let count = numbers.len();
        Raster::from_raw(width, height, numbers)
            .filter(|_| count == fitting(width, height, 1))
            .ok_or_else(|| misfit(count))
    };
    Ok(match value_type {
        ValueType::Image => {
            let mut bytes = data.u8s()?.to_vec();
            let count = bytes.len();
            let channels = if count == fitting(width, height, 1) { 1 } else { 3 };
            if count != fitting(width, height, channels) {
                return Err(misfit(count));
            }
            if encoding == "bgr8" {
                bytes.as_chunks_mut::<3>().0.iter_mut().for_each(|pixel| pixel.swap(0, 2));
            }
            let pixels = if channels == 1 {
                GrayImage::from_raw(width, height, bytes).map(Pixels::Grey)
            } else {
                RgbImage::from_raw(width, height, bytes).map(Pixels::Rgb)
            };
            Image::new(pixels.ok_or_else(|| misfit(count))?).into()
        }
        ValueType::Mask => {
            let set: Vec<u8> = data.u8s()?.iter().map(|&set| if set == 0 { 0 } else { 255 }).collect();
            let count = set.len();
            let raster = Raster::from_raw(width, height, set).filter(|_| count == fitting(width, height, 1));
            Mask { set: raster.ok_or_else(|| misfit(count))? }.into()
        }
        ValueType::Depth if matches!(encoding, "16UC1" | "mono16") => {
            let millimetres = data.u16s()?;
            let count = millimetres.len();
            let metres = millimetres.into_iter().map(|mm| if mm == 0 { f32::NAN } else { f32::from(mm) / 1000.0 });
            let raster =
                Raster::from_raw(width, height, metres.collect()).filter(|_| count == fitting(width, height, 1));
            Depth { metres: raster.ok_or_else(|| misfit(count))? }.into()
        }
        ValueType::Depth => Depth { metres: floats()? }.into(),
        ValueType::Weight => Weight { share: floats()? }.into(),
        ValueType::TrueDisparity => TrueDisparity { px: floats()? }.into(),
        other => return Err(format!("values of type {other} do not cross as numbers alone")),
    })
}

const fn fitting(width: u32, height: u32, channels: usize) -> usize {
    width as usize * height as usize * channels
}
