//! A part that calls a third-party node of dora: it knows frames and absent values, the node only gets messages and
//! replies.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use depthloom_codecs::arrow::View;
use depthloom_graphs::contracts::{PureNode, Signature};
use depthloom_graphs::plan::{FrameIndex, NodeRef, Plan};
use depthloom_graphs::ready::NotReady;
use depthloom_graphs::values::{Depth, Image, Mask, Pixels, Raster, TrueDisparity, Weight};
use depthloom_graphs::{
    Context, Fault, Host, Inputs, Instance, Key, Node as _, Outputs, Port, Registry, Value, ValueType,
};
use depthloom_nodes::dora::{Dora, DoraParams, DoraValues};
use depthloom_threads::locked;
use image::{GrayImage, RgbImage};
use serde_json::{Map, Value as Json};

use crate::bridge::{Bridge, metadata_of};
use crate::layout::{reply_input, request_output};
use crate::mailbox::{Arrived, Gone, Mailbox};
use crate::message::{Row, of_value};

/// Returns the node with the fingerprint of what its results depend on.
pub(crate) fn build(
    plan: &Plan,
    node: NodeRef,
    _: &Registry,
    bridge: &Arc<Bridge>,
) -> Result<(Instance, Option<Key>), Vec<NotReady>> {
    let run = &plan.runs[node.run];
    let planned = &run.nodes[node.node];
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
    let foreign = Foreign { bridge, inputs, outputs, values: params.values, patience, turn: Mutex::default() };
    Ok((Instance::Pure(Box::new(foreign)), fingerprint))
}

struct Foreign {
    bridge: Arc<Bridge>,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    values: DoraValues,
    patience: Duration,
    /// Locked per frame. The positions of frames that timed out before their reply.
    turn: Mutex<BTreeSet<u64>>,
}

/// The request's maps, which a reply that passes on the metadata repeats.
#[derive(Default)]
struct Request {
    /// Columns and rows of the first map.
    size: Option<(u32, u32)>,
    encodings: Vec<&'static str>,
}

impl PureNode for Foreign {
    fn process(&self, inputs: &Inputs<'_>, ctx: &mut Context<'_>) -> Result<Outputs, Fault> {
        let mut timed_out = locked(&self.turn);
        let position = ctx.host.position().ok_or_else(|| Fault::new("it runs without a frame"))?;
        for port in &self.outputs {
            if self.bridge.mailbox.holds(&reply_input(port.name), position) {
                let what = format!("the dora node replied at `{}` before it received this frame", port.name);
                return Err(
                    Fault::new(what).remedy("the node must reply once per frame, after all of its inputs have arrived")
                );
            }
        }
        let mut request = Request::default();
        for port in &self.inputs {
            let value = inputs.value(port.name);
            request.size = request.size.or_else(|| value.and_then(Value::dimensions));
            request.encodings.extend(value.and_then(encoding));
            self.ask(port, position, value)?;
        }
        let until = Instant::now() + self.patience;
        let mut outputs = Outputs::none();
        for port in &self.outputs {
            let arrived = receive(&self.bridge.mailbox, port.name, position, until, &mut timed_out, ctx.host)?;
            let arrived = arrived.ok_or_else(|| {
                let seconds = self.patience.as_secs_f64();
                Fault::new(format!("dora's node gave nothing at `{}` within {seconds} s", port.name))
                    .remedy("look at its log (`dora logs`); `timeout_s` is how long it may take")
            })?;
            arrived.check()?;
            let wrong = |what: String| {
                let (name, value_type) = (port.name, port.value_type);
                Fault::new(format!("what came from dora at `{name}` is not a valid {value_type}: {what}"))
            };
            let value = self.value(&arrived, port.value_type, &request).map_err(wrong)?;
            value.validate().map_err(wrong)?;
            outputs = outputs.with(port.name, value);
        }
        Ok(outputs)
    }
}

impl Foreign {
    fn ask(&self, port: &Port, position: FrameIndex, value: Option<&Value>) -> Result<(), Fault> {
        let frame = self.bridge.frames.get().and_then(|frames| frames.get(position.0));
        let frame = frame.ok_or_else(|| Fault::new(format!("its stage has no frame at position {position}")))?;
        let mut metadata = metadata_of(position, frame);
        let flat = value
            .filter(|_| self.values == DoraValues::Flat)
            .and_then(|value| Some((value.dimensions()?, encoding(value)?)));
        if let Some(((width, height), encoding)) = flat {
            metadata.insert("width".to_owned(), width.into());
            metadata.insert("height".to_owned(), height.into());
            metadata.insert("encoding".to_owned(), encoding.into());
        }
        let stream = value.map(of_value).unwrap_or_default();
        self.bridge.send_with(&request_output(port.name), metadata, &stream, flat.is_some())
    }

    fn value(&self, arrived: &Arrived, value_type: ValueType, request: &Request) -> Result<Value, String> {
        if arrived.body.is_empty() {
            return Err("it has no value".to_owned());
        }
        let row = Row::read(&arrived.body)?;
        let size = size_of_reply(&arrived.metadata)?;
        if self.values == DoraValues::Struct {
            let value = row.value(value_type)?;
            return match (size, value.dimensions()) {
                (Some((w, h)), Some((width, height))) if (w, h) != (width, height) => {
                    Err(format!("its metadata state {w}x{h} pixels, but it has {width}x{height}"))
                }
                _ => Ok(value),
            };
        }
        let size = size.or(request.size).ok_or("it has no `width` and `height`")?;
        let encoding = encoding_of_reply(&arrived.metadata, value_type, &request.encodings)?;
        flat_value(&row.column()?.part("data").ok_or("it is not an array of numbers")?, value_type, size, encoding)
    }
}

/// The reply at a port for a frame; `None` after the time limit. Replies come in any order, so a reply must name its
/// frame.
fn receive(
    mailbox: &Mailbox,
    name: &str,
    position: FrameIndex,
    until: Instant,
    timed_out: &mut BTreeSet<u64>,
    host: &dyn Host,
) -> Result<Option<Arrived>, Fault> {
    let position = position.0 as u64;
    let cancelled = || host.cancelled() || Instant::now() >= until;
    let twice = || host.info(&format!("the dora node replied twice to a frame at `{name}`: the first reply is used"));
    loop {
        let arrived = match mailbox.take_any(&reply_input(name), &cancelled) {
            Ok(arrived) => arrived,
            Err(Gone::Cancelled) if !host.cancelled() => {
                timed_out.insert(position);
                return Ok(None);
            }
            Err(Gone::Ended(_)) => {
                return Err(Fault::new("dora's node has ended").remedy("look at its log (`dora logs`)"));
            }
            Err(gone) => return Err(gone.into()),
        };
        match arrived.metadata.get("frame").and_then(Json::as_u64) {
            Some(frame) if frame == position => {
                if arrived.is_repeated {
                    twice();
                }
                return Ok(Some(arrived));
            }
            Some(frame) if timed_out.contains(&frame) => {}
            Some(frame) if frame < position => twice(),
            Some(of) => {
                return Err(Fault::new(format!(
                    "the dora node replied at `{name}` for the frame at position {of} before it received that frame"
                )));
            }
            None => {
                return Err(Fault::new(format!("the dora node replied at `{name}` without naming its frame"))
                    .remedy("let it pass on the metadata of what it was sent: `node.send_output(name, value, event[\"metadata\"])`"));
            }
        }
    }
}

/// Columns and rows from the metadata; `None` if it has neither.
fn size_of_reply(metadata: &Map<String, Json>) -> Result<Option<(u32, u32)>, String> {
    let side = |name: &str| {
        let side = metadata.get(name).map(|side| (side, side.as_u64().and_then(|side| u32::try_from(side).ok())));
        match side {
            None => Ok(None),
            Some((_, Some(side))) if side > 0 => Ok(Some(side)),
            Some((stated, _)) => Err(format!("its metadata state `{name}: {stated}`, expected a number of pixels")),
        }
    };
    match (side("width")?, side("height")?) {
        (Some(width), Some(height)) => Ok(Some((width, height))),
        (None, None) => Ok(None),
        (Some(_), None) => Err("its metadata contain `width` but not `height`".to_owned()),
        (None, Some(_)) => Err("its metadata contain `height` but not `width`".to_owned()),
    }
}

const fn encodings(value_type: ValueType) -> &'static [&'static str] {
    match value_type {
        ValueType::Image => &["rgb8", "bgr8", "mono8"],
        ValueType::Mask => &["mono8"],
        ValueType::Depth => &["32FC1", "16UC1", "mono16"],
        _ => &["32FC1"],
    }
}

/// The encoding from the metadata; empty without one, or if the node passed on the encoding of an input of another
/// type.
fn encoding_of_reply<'a>(
    metadata: &'a Map<String, Json>,
    value_type: ValueType,
    sent: &[&str],
) -> Result<&'a str, String> {
    let Some(stated) = metadata.get("encoding") else { return Ok("") };
    let known = encodings(value_type);
    match stated.as_str() {
        Some(encoding) if known.contains(&encoding) => Ok(encoding),
        Some(encoding) if sent.contains(&encoding) => Ok(""),
        _ => {
            Err(format!("its metadata state `encoding: {stated}`, expected {} for a {value_type}", known.join(" or ")))
        }
    }
}

/// dora's name for the numbers of a map.
fn encoding(value: &Value) -> Option<&'static str> {
    match value {
        Value::Image(image) => Some(match image.pixels() {
            Pixels::Grey(_) => "mono8",
            Pixels::Rgb(_) => "rgb8",
        }),
        Value::Mask(_) => Some("mono8"),
        Value::Depth(_) | Value::RelativeDepth(_) | Value::Weight(_) | Value::TrueDisparity(_) => Some("32FC1"),
        _ => None,
    }
}

fn flat_value(
    data: &View<'_>,
    value_type: ValueType,
    (width, height): (u32, u32),
    encoding: &str,
) -> Result<Value, String> {
    let pixels = width as usize * height as usize;
    let misfit = |count: usize| format!("it has {count} numbers, which is not {width}x{height} pixels");
    let floats = || raster(data.f32s()?, pixels, (width, height)).map_err(misfit);
    Ok(match value_type {
        ValueType::Image => {
            let mut bytes = data.u8s()?.to_vec();
            let count = bytes.len();
            let channels = if count == pixels { 1 } else { 3 };
            if count != pixels * channels {
                return Err(misfit(count));
            }
            if !encoding.is_empty() && (encoding == "mono8") != (channels == 1) {
                return Err(format!(
                    "its metadata state `encoding: {encoding}`, but it has {channels} numbers per pixel"
                ));
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
            let set = data.u8s()?.iter().map(|&set| if set == 0 { 0 } else { 255 }).collect();
            Mask { set: raster(set, pixels, (width, height)).map_err(misfit)? }.into()
        }
        ValueType::Depth if matches!(encoding, "16UC1" | "mono16") => {
            let metres = |mm| if mm == 0 { f32::NAN } else { f32::from(mm) / 1000.0 };
            let metres = data.u16s()?.into_iter().map(metres).collect();
            Depth { metres: raster(metres, pixels, (width, height)).map_err(misfit)? }.into()
        }
        ValueType::Depth => Depth { metres: floats()? }.into(),
        ValueType::Weight => Weight { share: floats()? }.into(),
        ValueType::TrueDisparity => TrueDisparity { px: floats()? }.into(),
        other => return Err(format!("values of type {other} do not cross as numbers alone")),
    })
}

/// A raster of this size.
///
/// # Errors
/// The number of samples, if it is another one.
fn raster<T>(samples: Vec<T>, pixels: usize, (width, height): (u32, u32)) -> Result<Raster<T>, usize>
where
    image::Luma<T>: image::Pixel<Subpixel = T>,
{
    let count = samples.len();
    Raster::from_raw(width, height, samples).filter(|_| count == pixels).ok_or(count)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::sync::Mutex;
    use std::time::{Duration, Instant};

    use depthloom_graphs::plan::FrameIndex;
    use depthloom_graphs::values::{Depth, Pixels, Raster};
    use depthloom_graphs::{Fault, Host, Value, ValueType};
    use depthloom_runner::Interrupt;
    use serde_json::{Map, Value as Json, json};

    use super::{Arrived, Mailbox, Row, encoding_of_reply, flat_value, of_value, receive, reply_input, size_of_reply};

    fn object(metadata: &Json) -> Map<String, Json> {
        metadata.as_object().cloned().unwrap_or_default()
    }

    /// Keeps notices.
    #[derive(Default)]
    struct Notices(Mutex<Vec<String>>);

    impl Host for Notices {
        fn cancelled(&self) -> bool {
            false
        }
        fn info(&self, what: &str) {
            self.0.lock().unwrap().push(what.to_owned());
        }
        fn progress(&self, _: u64, _: u64, _: &str) {}
        fn tiles(&self, n: usize, f: &(dyn Fn(usize) + Sync)) {
            (0..n).for_each(f);
        }
        fn width(&self) -> usize {
            1
        }
    }

    /// The reply for frame 2 and the warnings, after these messages have arrived and frame 1 was given
    /// up.
    fn taken(messages: &[(Json, &str)]) -> (Result<Option<String>, Fault>, Vec<String>) {
        let mailbox = Mailbox::new(Interrupt::default(), false);
        for (metadata, body) in messages {
            mailbox.put(Arrived::new(reply_input("depth"), object(metadata), body.as_bytes().to_vec()));
        }
        let (host, until) = (Notices::default(), Instant::now() + Duration::from_millis(10));
        let taken = receive(&mailbox, "depth", FrameIndex(2), until, &mut BTreeSet::from([1]), &host);
        let body = |arrived: Arrived| String::from_utf8(arrived.body).unwrap();
        (taken.map(|arrived| arrived.map(body)), host.0.into_inner().unwrap())
    }

    #[test]
    fn a_reply_is_used_only_for_the_frame_that_it_names() {
        let metadata_of = |frame: u64| json!({ "frame": frame });
        let two = || Some("two".to_owned());
        let (found, warnings) = taken(&[(metadata_of(2), "two")]);
        assert_eq!((found.unwrap(), warnings.len()), (two(), 0));
        assert_eq!(taken(&[]).0.unwrap(), None);
        // Late, of a frame that was given up.
        let (found, warnings) = taken(&[(metadata_of(1), "one"), (metadata_of(2), "two")]);
        assert_eq!((found.unwrap(), warnings.len()), (two(), 0));
        // Answered twice: the frame itself, or one before.
        for messages in
            [[(metadata_of(2), "two"), (metadata_of(2), "other")], [(metadata_of(0), "zero"), (metadata_of(2), "two")]]
        {
            let (found, warnings) = taken(&messages);
            assert_eq!(found.unwrap(), two());
            assert!(warnings[0].contains("replied twice to a frame at `depth`"), "{warnings:?}");
        }
        let early = taken(&[(metadata_of(3), "three")]).0.unwrap_err().chain();
        assert!(early.contains("for the frame at position 3 before it received that frame"), "{early}");
        // It may be of any frame: of one that was answered twice, for example.
        for metadata in [json!({}), json!({ "frame": "2" }), json!({ "frame": -1 })] {
            let unnamed = taken(&[(metadata, "two"), (metadata_of(2), "two")]).0.unwrap_err().chain();
            assert!(unnamed.contains("without naming its frame"), "{unnamed}");
        }
    }

    #[test]
    fn a_size_is_two_whole_numbers_or_absent() {
        let stated = |metadata: Json| size_of_reply(&object(&metadata));
        assert_eq!(stated(json!({})), Ok(None));
        assert_eq!(stated(json!({ "width": 3, "height": 2 })), Ok(Some((3, 2))));
        assert!(stated(json!({ "width": 3 })).unwrap_err().contains("`width` but not `height`"));
        assert!(stated(json!({ "height": 3 })).unwrap_err().contains("`height` but not `width`"));
        for wrong in [json!(-3), json!(0), json!("3"), json!(1.5), Json::Null] {
            let what = stated(json!({ "width": wrong, "height": 2 })).unwrap_err();
            assert!(what.contains("expected a number of pixels"), "{what}");
        }
    }

    #[test]
    fn an_encoding_is_one_of_its_type_or_one_that_is_passed_on() {
        let stated = |encoding: &str, value_type: ValueType, sent: &[&str]| {
            encoding_of_reply(&object(&json!({ "encoding": encoding })), value_type, sent).map(str::to_owned)
        };
        assert_eq!(encoding_of_reply(&Map::new(), ValueType::Depth, &[]), Ok(""));
        assert_eq!(stated("16UC1", ValueType::Depth, &[]).unwrap(), "16UC1");
        // An image went, and a depth comes back with its metadata.
        assert_eq!(stated("rgb8", ValueType::Depth, &["rgb8"]).unwrap(), "");
        let refused = stated("rgb8", ValueType::Depth, &["mono8"]).unwrap_err();
        assert!(refused.contains("expected 32FC1 or 16UC1 or mono16 for a depth"), "{refused}");
        assert!(stated("rgba8", ValueType::Image, &["rgb8"]).unwrap_err().contains("rgb8 or bgr8 or mono8"));
    }

    #[test]
    fn pixels_are_as_many_as_size_and_encoding_say() {
        let flat = |numbers: &[f32]| {
            let metres = Raster::from_raw(numbers.len() as u32, 1, numbers.to_vec()).unwrap();
            Row::read(&of_value(&Value::from(Depth { metres }))).unwrap()
        };
        let row = flat(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let data = row.column().unwrap().part("data").unwrap();
        assert!(flat_value(&data, ValueType::Depth, (3, 2), "32FC1").is_ok());
        let what = flat_value(&data, ValueType::Depth, (3, 3), "").unwrap_err();
        assert!(what.contains("6 numbers, which is not 3x3 pixels"), "{what}");
        assert!(flat_value(&data, ValueType::Depth, (3, 2), "16UC1").is_err(), "floats are not millimetres");

        let grey = Pixels::Grey(image::GrayImage::from_raw(6, 1, vec![1, 2, 3, 4, 5, 6]).unwrap());
        let row = Row::read(&of_value(&depthloom_graphs::values::Image::new(grey).into())).unwrap();
        let data = row.column().unwrap().part("data").unwrap();
        assert!(flat_value(&data, ValueType::Image, (2, 1), "bgr8").is_ok());
        assert!(flat_value(&data, ValueType::Image, (3, 2), "mono8").is_ok());
        for (size, encoding) in [((2, 1), "mono8"), ((3, 2), "rgb8")] {
            let what = flat_value(&data, ValueType::Image, size, encoding).unwrap_err();
            assert!(what.contains(&format!("`encoding: {encoding}`, but it has")), "{what}");
        }
    }
}
