//! The program behind the `process` nodes and the `process/source` of random experiments: this test program itself,
//! which starts fast.
//!
//! What it returns depends on everything that it may know: parameters, the variable `GAIN`, its arguments, the content
//! of the files that `params.read` lists and `params.reads` names for a frame, its inputs and, in an ordered node, id,
//! index and time of this frame and of all before. So a cached value is wrong as soon as its key lacks one of them.

use std::hash::Hasher as _;
use std::io;
use std::sync::Arc;

use depthloom_codecs::arrow::{self, Data, DataType, Field, Items, Offsets, Schema, StreamReader};
use depthloom_graphs::values::{Artifact, Calibration, Curve, CurvePoint, Depth, Image, Number, Pixels, Raster};
use depthloom_graphs::{Value, ValueType};
use image::{GrayImage, Luma};
use serde_json::Value as Json;

use crate::files::{HEIGHT, WIDTH, texture};

/// Hashes that are the same on every machine (FNV-1a).
#[derive(Clone)]
pub(crate) struct Digest(u64);

impl Digest {
    pub(crate) const fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl std::hash::Hasher for Digest {
    fn write(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }
}

/// Answers calls until standard input ends.
pub(crate) fn serve(arguments: &[String]) -> io::Result<()> {
    let mut calls = StreamReader::new(io::stdin().lock());
    let broken = |error: &dyn std::fmt::Display| io::Error::other(error.to_string());
    let schema = calls.schema().map_err(|error| broken(&error))?.ok_or_else(|| broken(&"no schema"))?;
    let node = schema.metadata("depthloom.node").ok_or_else(|| broken(&"the schema does not describe a node"))?;
    let node: Json = serde_json::from_str(node)?;
    let mut program = Program::new(&node, arguments)?;
    let mut replies = io::stdout().lock();
    arrow::write_schema(&program.replies, &mut replies)?;
    program.reply("ready", 0, None, None, &mut replies)?;
    while let Some(call) = calls.batch(&schema).map_err(|error| broken(&error))? {
        let column = |name: &str| call.column(&schema, name);
        let number = column("number").and_then(|number| number.int().ok()).unwrap_or(0);
        let name = column("call").and_then(|call| call.text().ok().map(str::to_owned)).unwrap_or_default();
        if name == "frames" {
            let frames = program.frames();
            program.reply("frames", number, None, Some(frames), &mut replies)?;
            continue;
        }
        let mut inputs = Vec::new();
        for (port, value_type) in &program.inputs {
            let value = column("inputs").and_then(|inputs| inputs.part(port));
            inputs.extend(
                value.map(|value| arrow::value(*value_type, &value)).transpose().map_err(|error| broken(&error))?,
            );
        }
        let mut frame = Digest::new();
        if let Some(of) = column("frame") {
            let id = of.part("id").and_then(|id| id.text().ok()).unwrap_or_default();
            frame.write(id.as_bytes());
            // A missing file is another content than an empty one.
            if let Some(pattern) = program.params["reads"].as_str() {
                frame.write(&std::fs::read(pattern.replace("{frame}", id)).unwrap_or_else(|_| b"missing".to_vec()));
            }
            for part in ["index", "time_ns"] {
                frame.write_i64(of.part(part).and_then(|part| part.int().ok()).unwrap_or(-1));
            }
        }
        if program.params["fail"] == true && content(&inputs).is_multiple_of(3) {
            program.reply("failure", number, None, None, &mut replies)?;
            continue;
        }
        let is_finish = name == "finish";
        let values = program.values(&frame, &inputs, is_finish);
        program.reply("values", number, Some(&values), None, &mut replies)?;
    }
    Ok(())
}

/// A port with its type and whether it has a value once per stage.
type Output = (String, ValueType, bool);

struct Program {
    contract: String,
    inputs: Vec<(String, ValueType)>,
    outputs: Vec<Output>,
    params: Json,
    /// All that it knows before its first call.
    knowledge: Digest,
    /// Of an ordered node: the frames so far.
    memory: Digest,
    replies: Schema,
}

impl Program {
    fn new(node: &Json, arguments: &[String]) -> io::Result<Self> {
        let value_type = |name: &str| ValueType::ALL.into_iter().find(|of| of.name() == name);
        let ports = |side: &str| -> Vec<Output> {
            let ports = node[side].as_object().into_iter().flatten();
            let port = |(name, port): (&String, &Json)| {
                Some((name.clone(), value_type(port["type"].as_str()?)?, port["rate"] == "once"))
            };
            ports.filter_map(port).collect()
        };
        let (outputs, params) = (ports("outputs"), node["params"].clone());
        let mut knowledge = Digest::new();
        knowledge.write(params.to_string().as_bytes());
        for argument in arguments {
            knowledge.write(argument.as_bytes());
            knowledge.write_u8(0xff);
        }
        knowledge.write(std::env::var("GAIN").unwrap_or_default().as_bytes());
        if params["random"] == true {
            let time = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_err(io::Error::other)?;
            knowledge.write_u128(time.as_nanos());
        }
        for file in params["read"].as_array().into_iter().flatten().filter_map(Json::as_str) {
            knowledge.write(&std::fs::read(file)?);
        }
        let text = DataType::Utf8(Offsets::Narrow);
        let number = DataType::Int(64, true);
        let list = |of: DataType| DataType::List(Offsets::Narrow, Box::new(Field::new("item", of)));
        let columns = outputs.iter().filter_map(|(name, of, _)| arrow::field(name, *of)).collect();
        let frames = vec![Field::new("id", list(text.clone())), Field::new("time_ns", list(number.clone()))];
        let replies = Schema {
            fields: vec![
                Field::new("says", text),
                Field::new("number", number),
                Field::new("outputs", DataType::Struct(columns)).nullable(),
                Field::new("frames", DataType::Struct(frames)).nullable(),
                Field::new("message", DataType::Utf8(Offsets::Narrow)).nullable(),
            ],
            metadata: vec![("depthloom.protocol".to_owned(), "1".to_owned())],
        };
        Ok(Self {
            contract: node["contract"].as_str().unwrap_or_default().to_owned(),
            inputs: ports("inputs").into_iter().map(|(name, of, _)| (name, of)).collect(),
            outputs,
            params,
            knowledge,
            memory: Digest::new(),
            replies,
        })
    }

    /// The frames of a source: `params.frames` of them, at intervals of `params.interval_ns` nanoseconds.
    fn frames(&self) -> (Vec<String>, Vec<i64>) {
        let number = |name: &str, default: i64| self.params[name].as_i64().unwrap_or(default);
        let interval = number("interval_ns", 100_000_000);
        let first = number("first", 0);
        (first..first + number("frames", 2)).map(|index| (format!("f{index}"), index * interval)).unzip()
    }

    /// The values of all outputs that this call has.
    fn values(&mut self, frame: &Digest, inputs: &[Value], is_finish: bool) -> Vec<Option<Value>> {
        let mut digest = self.knowledge.clone();
        match self.contract.as_str() {
            // Also a pure node, which receives its frame if it reads files of it.
            "source" | "pure" => {
                digest.write_u64(frame.finish());
                digest.write_u64(content(inputs));
            }
            "ordered" => {
                if !is_finish {
                    self.memory.write_u64(frame.finish());
                    self.memory.write_u64(content(inputs));
                }
                digest.write_u64(self.memory.finish());
            }
            _ => digest.write_u64(content(inputs)),
        }
        let number = digest.finish();
        let is_of_this_call = |is_once: bool| is_once == (is_finish || self.contract == "once");
        let is_noisy = self.params["noise"] == true;
        let value = |(name, of, is_once): &Output| {
            let mut made = is_of_this_call(*is_once).then(|| value(name, *of, number, inputs));
            if let (true, Some(Value::Depth(depth))) = (is_noisy, &mut made) {
                *depth = Arc::new(noisy(depth));
            }
            made
        };
        self.outputs.iter().map(value).collect()
    }

    fn reply(
        &self,
        says: &'static str,
        number: i64,
        values: Option<&[Option<Value>]>,
        frames: Option<(Vec<String>, Vec<i64>)>,
        out: &mut impl io::Write,
    ) -> io::Result<()> {
        let outputs = values.map_or(Data::Null, |values| {
            Data::Struct(
                values.iter().map(|value| value.as_ref().and_then(arrow::data).unwrap_or(Data::Null)).collect(),
            )
        });
        let frames = frames.map_or(Data::Null, |(ids, times)| {
            Data::Struct(vec![Data::List(Items::Text(ids)), Data::List(Items::I64(times))])
        });
        let message = if says == "failure" { Data::Text("this frame fails".into()) } else { Data::Null };
        let row = vec![Data::Text(says.into()), Data::Int(number), outputs, frames, message];
        arrow::encode(&self.replies, row).write(out)?;
        out.flush()
    }
}

/// A depth that does not compress: every pixel is multiplied by a number of its own.
fn noisy(depth: &Depth) -> Depth {
    let mut metres = depth.metres.clone();
    for (place, metres) in metres.iter_mut().enumerate() {
        let mut digest = Digest::new();
        digest.write_u64(place as u64);
        *metres *= 1.0 + (digest.finish() % (1 << 23)) as f32 / (1 << 23) as f32;
    }
    Depth { metres }
}

/// A number that follows from the content of values.
fn content(values: &[Value]) -> u64 {
    let mut digest = Digest::new();
    for value in values {
        match value {
            Value::Depth(depth) => depth.metres.as_raw().iter().for_each(|metres| digest.write_u32(metres.to_bits())),
            Value::Samples(artifact) | Value::Model(artifact) => digest.write(&artifact.bytes),
            _ => {}
        }
    }
    digest.finish()
}

/// A value of a type that differs where `number` does.
fn value(name: &str, of: ValueType, number: u64, inputs: &[Value]) -> Value {
    // 1 to 2, by steps that are exact in f32: as many as there are, because two different results must not be equal by
    // chance.
    let factor = 1.0 + (number % (1 << 23)) as f32 / (1 << 23) as f32;
    let depth = inputs.iter().find_map(|input| if let Value::Depth(depth) = input { Some(depth) } else { None });
    match of {
        ValueType::Depth => match depth {
            Some(depth) => {
                let mut metres = depth.metres.clone();
                metres.iter_mut().for_each(|metres| *metres *= factor);
                Depth { metres }.into()
            }
            None => Depth { metres: Raster::from_pixel(WIDTH, HEIGHT, Luma([10.0 * factor])) }.into(),
        },
        ValueType::Image => {
            let shift = if name == "right" { 4 } else { 0 };
            Image::new(Pixels::Grey(GrayImage::from_fn(WIDTH, HEIGHT, |x, y| {
                Luma([texture(number as u32, x + shift, y)])
            })))
            .into()
        }
        ValueType::Calibration => Calibration {
            width: WIDTH,
            height: HEIGHT,
            focal_px: 40.0,
            cx_px: 31.5,
            cy_px: 15.5,
            baseline_m: 0.5,
            doffs_px: 0.0,
        }
        .into(),
        ValueType::Curve => {
            let point = |step: u64| CurvePoint {
                step,
                loss: f64::from(factor) / step as f64,
                validation: None,
                learning_rate: 0.5,
            };
            Curve { points: vec![point(1), point(2)] }.into()
        }
        ValueType::Number => Number { value: f64::from(factor) }.into(),
        ValueType::Samples => Value::Samples(Arc::new(Artifact::new("application/octet-stream", number.to_le_bytes()))),
        _ => Value::Model(Arc::new(Artifact::new("application/onnx", number.to_le_bytes()))),
    }
}
