//! Messages between depthloom and a process. `docs/reference/process-protocol.md` describes them for authors of
//! programs.

use std::time::Instant;

use depthloom_codecs::arrow::{self, Batch, Data, DataType, Field, Offsets, Schema, View};
use depthloom_graphs::{Frame, Port, Value};
use serde_json::{Map, Value as Json, json};

use super::modules::ModuleReport;

/// Raised when an older process would not understand.
const VERSION: &str = "1";
const PROTOCOL: &str = "depthloom.protocol";
const NODE: &str = "depthloom.node";
/// From the engine: path of the shared file. From the process: the word that it found there.
const SHARED: &str = "depthloom.shared";
/// Asks a Python process to report its imports; with `first` it ends afterwards.
const MODULES: &str = "depthloom.modules";

const TEXT: DataType = DataType::Utf8(Offsets::Narrow);
const I64: DataType = DataType::Int(64, true);

#[derive(Clone, Debug)]
pub(super) enum Call {
    /// The frame, if the node may know it.
    Process(Option<Frame>),
    Finish,
    Run,
    Frames,
    /// The next frame of a stream.
    Next,
}

impl Call {
    const fn name(&self) -> &'static str {
        match self {
            Self::Process(_) => "process",
            Self::Finish => "finish",
            Self::Run => "run",
            Self::Frames => "frames",
            Self::Next => "next",
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Request {
    pub number: i64,
    pub call: Call,
    pub inputs: Vec<Option<Value>>,
}

#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Unique within a process.
    pub file: i64,
    pub path: String,
    /// Bytes.
    pub size: i64,
    /// Number of bytes that the row uses.
    pub bytes: i64,
}

/// The parts of a call that are in shared memory.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedPlaces {
    pub call: Option<Place>,
    pub answer: Option<Place>,
}

#[derive(Debug)]
pub(super) struct Reply {
    pub number: i64,
    /// When its first byte arrived.
    pub arrived: Instant,
    pub content: Content,
}

/// A frame of a stream, with what the program states of it.
#[derive(Debug, Default)]
pub(super) struct StatedFrame {
    pub id: Option<String>,
    pub index: Option<u64>,
    pub time_ns: Option<u64>,
    /// Time from its capture until the reply was sent.
    pub age_ns: u64,
    pub missed: u64,
    pub values: Vec<Option<Value>>,
}

#[derive(Debug)]
pub(super) enum Content {
    Ready,
    Progress {
        done: u64,
        total: u64,
        message: String,
    },
    Warning {
        count: u64,
        message: String,
    },
    Modules(ModuleReport),
    Values {
        values: Vec<Option<Value>>,
        cpu_ns: u64,
    },
    /// Ids, and times in nanoseconds if the source has its own.
    Frames {
        ids: Vec<String>,
        times_ns: Option<Vec<u64>>,
    },
    Frame(StatedFrame),
    /// The stream has no more frames.
    End,
    /// The message and the traceback. The process can be called again.
    Failure {
        message: String,
        trace: String,
    },
}

pub(super) fn crosses(port: &Port) -> Result<(), String> {
    let crosses = arrow::field(port.name, port.value_type).is_some();
    if crosses {
        Ok(())
    } else {
        Err(format!("`{}`: values of type {} do not cross to processes", port.name, port.value_type))
    }
}

pub(super) fn request_schema(contract: &str, inputs: &[Port], outputs: &[Port], params: &Map<String, Json>) -> Schema {
    let columns = inputs.iter().filter_map(|port| arrow::field(port.name, port.value_type));
    let frame = vec![Field::new("id", TEXT), Field::new("index", I64), Field::new("time_ns", I64)];
    let place = ["file", "path", "size", "bytes"].map(|name| Field::new(name, if name == "path" { TEXT } else { I64 }));
    let place = |name| Field::new(name, DataType::Struct(place.to_vec())).nullable();
    let described = |ports: &[Port]| {
        let entries = ports.iter().map(|port| {
            let port_json =
                json!({ "type": port.value_type.name(), "rate": port.rate.name(), "optional": port.optional });
            (port.name.to_owned(), port_json)
        });
        Json::Object(entries.collect())
    };
    let node =
        json!({ "contract": contract, "inputs": described(inputs), "outputs": described(outputs), "params": params });
    Schema {
        fields: vec![
            Field::new("number", I64),
            Field::new("call", TEXT),
            Field::new("frame", DataType::Struct(frame)).nullable(),
            Field::new("inputs", DataType::Struct(columns.collect())).nullable(),
            place("lies_in"),
            place("answer_in"),
        ],
        metadata: vec![(PROTOCOL.to_owned(), VERSION.to_owned()), (NODE.to_owned(), node.to_string())],
    }
}

impl Request {
    /// A row in shared memory carries neither frame nor inputs in the pipe.
    pub(super) fn row<'a>(&'a self, places: &'a SharedPlaces) -> Vec<Data<'a>> {
        let is_here = places.call.is_none();
        let frame = match &self.call {
            Call::Process(Some(frame)) if is_here => Data::Struct(vec![
                Data::Text((&*frame.id).into()),
                Data::Int(frame.index as i64),
                Data::Int(frame.time_ns as i64),
            ]),
            _ => Data::Null,
        };
        let inputs = self.inputs.iter().map(|value| value.as_ref().and_then(arrow::data).unwrap_or(Data::Null));
        let inputs = if is_here { Data::Struct(inputs.collect()) } else { Data::Null };
        let place = |place: &'a Option<Place>| {
            let Some(Place { file, path, size, bytes }) = place else { return Data::Null };
            Data::Struct(vec![Data::Int(*file), Data::Text(path.as_str().into()), Data::Int(*size), Data::Int(*bytes)])
        };
        let call = Data::Text(self.call.name().into());
        vec![Data::Int(self.number), call, frame, inputs, place(&places.call), place(&places.answer)]
    }
}

pub(super) fn offering_shared(schema: &Schema, path: Option<String>) -> Schema {
    let mut schema = schema.clone();
    schema.metadata.extend(path.map(|path| (SHARED.to_owned(), path)));
    schema
}

pub(super) fn requesting_modules(mut schema: Schema, and_nothing_else: bool) -> Schema {
    let value = if and_nothing_else { "first" } else { "report" };
    schema.metadata.push((MODULES.to_owned(), value.to_owned()));
    schema
}

pub(super) fn shared_word(schema: &Schema) -> Option<&str> {
    schema.metadata(SHARED)
}

pub(super) fn check_schema(schema: &Schema) -> Result<(), String> {
    match schema.metadata(PROTOCOL) {
        Some(VERSION) => {}
        Some(other) => return Err(format!("it speaks version {other} of the protocol, and this is version {VERSION}")),
        None => return Err(format!("the metadata of its schema lack `{PROTOCOL}`")),
    }
    match schema.fields.iter().find(|field| field.name == "says") {
        Some(_) => Ok(()),
        None => Err("its schema has no column `says`".to_owned()),
    }
}

pub(super) fn reply(schema: &Schema, batch: &Batch, outputs: &[Port], arrived: Instant) -> Result<Reply, String> {
    let column = |name: &str| batch.column(schema, name);
    let number = |name: &str| column(name).map_or(Ok(0), |column| column.int());
    let count = |name: &str| {
        let count = number(name)?;
        u64::try_from(count).map_err(|_| format!("its `{name}` is {count}, which must not be negative"))
    };
    let text = |name: &str| column(name).map_or(Ok(String::new()), |column| column.text().map(str::to_owned));
    let content = match column("says").ok_or("a reply has no value in the column `says`")?.text()? {
        "ready" => Content::Ready,
        "progress" => Content::Progress { done: count("done")?, total: count("total")?, message: text("message")? },
        "warning" => Content::Warning { count: count("count")?, message: text("message")? },
        "modules" => Content::Modules(ModuleReport::parse(&text("message")?)?),
        "failure" => Content::Failure { message: text("message")?, trace: text("trace")? },
        "frames" => {
            let frames = column("frames").ok_or("a reply with frames lacks the column `frames`")?;
            let ids = frames.part("id").ok_or("frames have no `id`")?.texts()?;
            let times = frames.part("time_ns").map(|times| times.i64s()).transpose()?;
            let times_ns = times.map(|times| {
                let time = |time: &i64| u64::try_from(*time).map_err(|_| format!("a frame's time is {time} ns"));
                times.iter().map(time).collect::<Result<Vec<_>, _>>()
            });
            Content::Frames { ids: ids.into_iter().map(str::to_owned).collect(), times_ns: times_ns.transpose()? }
        }
        "values" => Content::Values { values: values(column("outputs").as_ref(), outputs)?, cpu_ns: count("cpu_ns")? },
        "frame" => Content::Frame(StatedFrame {
            values: values(column("outputs").as_ref(), outputs)?,
            ..column("frame").map_or(Ok(StatedFrame::default()), |frame| stated_frame(&frame))?
        }),
        "end" => Content::End,
        other => return Err(format!("it says `{other}`, which is not a message of the protocol")),
    };
    Ok(Reply { number: number("number")?, arrived, content })
}

fn stated_frame(frame: &View<'_>) -> Result<StatedFrame, String> {
    let number = |name: &str| {
        let Some(column) = frame.part(name) else { return Ok(None) };
        let number = column.int()?;
        u64::try_from(number)
            .map(Some)
            .map_err(|_| format!("the frame's `{name}` is {number}, which must not be negative"))
    };
    let id = frame.part("id").map(|id| id.text().map(str::to_owned)).transpose()?;
    Ok(StatedFrame {
        id,
        index: number("index")?,
        time_ns: number("time_ns")?,
        age_ns: number("age_ns")?.unwrap_or(0),
        missed: number("missed")?.unwrap_or(0),
        values: Vec::new(),
    })
}

/// The values of the column `outputs`, in the order of the ports.
fn values(given: Option<&View<'_>>, outputs: &[Port]) -> Result<Vec<Option<Value>>, String> {
    if let Some(given) = given {
        let strange = given
            .parts()?
            .iter()
            .find(|field| outputs.iter().all(|port| port.name != field.name) && given.part(&field.name).is_some());
        if let Some(strange) = strange {
            return Err(format!("it sent a value at `{}`, which the node does not declare", strange.name));
        }
    }
    let value = |port: &Port| {
        let Some(column) = given.and_then(|given| given.part(port.name)) else { return Ok(None) };
        let value = arrow::value(port.value_type, &column);
        value
            .map(Some)
            .map_err(|what| format!("its value at `{}` is not a valid {}: {what}", port.name, port.value_type))
    };
    outputs.iter().map(value).collect()
}

#[cfg(test)]
mod tests {
    use depthloom_codecs::arrow::{StreamReader, encode, write_schema};
    use depthloom_graphs::values::{Depth, Raster};
    use depthloom_graphs::{Frame, Port, Value, ValueType};
    use serde_json::Map;

    use super::{Call, DataType, Field, I64, Request, Schema, SharedPlaces, TEXT, reply, request_schema};

    fn replied(says: &str, column: &str, number: i64) -> Result<super::Reply, String> {
        use depthloom_codecs::arrow::Data;
        let outputs = Field::new("outputs", DataType::Struct(Vec::new())).nullable();
        let fields = vec![Field::new("says", TEXT), Field::new("number", I64), Field::new(column, I64), outputs];
        let schema = Schema { fields, metadata: Vec::new() };
        let row = vec![Data::Text(says.into()), Data::Int(1), Data::Int(number), Data::Null];
        let mut stream = Vec::new();
        write_schema(&schema, &mut stream).unwrap();
        encode(&schema, row).write(&mut stream).unwrap();
        let mut reader = StreamReader::new(&stream[..]);
        let schema = reader.schema().unwrap().unwrap();
        reply(&schema, &reader.batch(&schema).unwrap().unwrap(), &[], std::time::Instant::now())
    }

    #[test]
    fn numbers_that_a_program_reports_are_not_negative() {
        for (says, column) in [("values", "cpu_ns"), ("warning", "count"), ("progress", "done"), ("progress", "total")]
        {
            assert!(replied(says, column, 7).is_ok(), "{column}");
            let what = replied(says, column, -7).unwrap_err();
            assert_eq!(what, format!("its `{column}` is -7, which must not be negative"));
        }
    }

    #[test]
    fn a_call_is_one_row_with_its_frame_and_its_values() {
        let inputs =
            [Port::frame("depth", ValueType::Depth, ""), Port::frame("other", ValueType::Depth, "").optional()];
        let schema = request_schema("ordered", &inputs, &[], &Map::new());
        let depth = Value::from(Depth { metres: Raster::from_raw(2, 1, vec![1.0, f32::NAN]).unwrap() });
        let call = Call::Process(Some(Frame::at_10_hz("a", 3)));
        let request = Request { number: 7, call, inputs: vec![Some(depth), None] };
        let mut stream = Vec::new();
        write_schema(&schema, &mut stream).unwrap();
        encode(&schema, request.row(&SharedPlaces::default())).write(&mut stream).unwrap();
        let mut reader = StreamReader::new(&stream[..]);
        let schema = reader.schema().unwrap().unwrap();
        let batch = reader.batch(&schema).unwrap().unwrap();
        let column = |name| batch.column(&schema, name).unwrap();
        assert_eq!((column("number").int(), column("call").text()), (Ok(7), Ok("process")));
        assert_eq!(column("frame").part("time_ns").unwrap().int(), Ok(300_000_000));
        let given = column("inputs");
        assert_eq!(given.part("depth").unwrap().part("data").unwrap().f32s().unwrap()[0], 1.0);
        assert!(given.part("other").is_none());
    }
}
