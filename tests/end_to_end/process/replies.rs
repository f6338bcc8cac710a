//! Valid and invalid replies of processes, as files for the script `peer.py`.

use std::path::Path;

use depthloom_codecs::arrow::{self, Data, DataType, Field, Items, Offsets, Schema, encode};
use depthloom_graphs::ValueType;

/// The size of the maps of these tests.
pub(super) const SIZE: (u32, u32) = (64, 32);
/// The size of maps in shared memory, for modes that begin with `shared`.
pub(super) const LARGE: (u32, u32) = (256, 128);

/// A placeholder for the number of a call: it occurs nowhere else in a reply.
const ANY: i64 = 0x1122_3344_5566_7788;

const TEXT: DataType = DataType::Utf8(Offsets::Narrow);
const I64: DataType = DataType::Int(64, true);

fn schema(outputs: Vec<Field>) -> Schema {
    let outputs = Field::new("outputs", DataType::Struct(outputs)).nullable();
    let fields = vec![
        Field::new("says", TEXT).nullable(),
        Field::new("number", I64),
        Field::new("message", TEXT).nullable(),
        Field::new("trace", TEXT).nullable(),
        outputs,
    ];
    Schema { fields, metadata: vec![("depthloom.protocol".to_owned(), "1".to_owned())] }
}

fn depth(name: &str) -> Field {
    arrow::field(name, ValueType::Depth).expect("depths can be encoded")
}

fn schema_bytes(schema: &Schema) -> Vec<u8> {
    let mut bytes = Vec::new();
    arrow::write_schema(schema, &mut bytes).expect("memory");
    bytes
}

fn row(schema: &Schema, says: Data<'_>, number: i64, failure: [&str; 2], outputs: Data<'_>) -> Vec<u8> {
    let failure = failure.map(|text| if text.is_empty() { Data::Null } else { Data::Text(text.to_owned().into()) });
    let [message, trace] = failure;
    let mut bytes = Vec::new();
    encode(schema, vec![says, Data::Int(number), message, trace, outputs]).write(&mut bytes).expect("memory");
    bytes
}

fn map(size: (i64, i64), samples: &[f32]) -> Data<'_> {
    Data::Struct(vec![Data::Int(size.0), Data::Int(size.1), Data::List(Items::F32(samples))])
}

/// Replies of processes that use shared memory. Their schema contains a placeholder of 32 letters for the word that
/// `peer.py` reads from the offered file.
fn put_shared_memory_replies(put: &dyn Fn(&str, &[u8])) {
    let mut schema = schema(vec![depth("depth")]);
    schema.metadata.push(("depthloom.shared".to_owned(), "f".repeat(32)));
    schema.fields.push(Field::new("bytes", I64).nullable());
    schema
        .fields
        .push(Field::new("held", DataType::List(Offsets::Narrow, Box::new(Field::new("item", I64)))).nullable());
    let samples = vec![7.5_f32; (LARGE.0 * LARGE.1) as usize];
    let size = (i64::from(LARGE.0), i64::from(LARGE.1));
    let row = |says: &'static str, number: i64, outputs: Data<'_>, bytes: Option<i64>, held_file: Option<i64>| {
        let bytes = bytes.map_or(Data::Null, Data::Int);
        let held_files = held_file.map_or(Data::Null, |file| Data::List(Items::I64(vec![file])));
        let columns =
            vec![Data::Text(says.into()), Data::Int(number), Data::Null, Data::Null, outputs, bytes, held_files];
        let mut row = Vec::new();
        encode(&schema, columns).write(&mut row).expect("memory");
        row
    };
    let valid = || Data::Struct(vec![map(size, &samples)]);
    let values = |number| row("values", number, valid(), None, None);
    let in_memory = |bytes: i64| row("shared", 2, Data::Null, Some(bytes), None);
    let length = values(2).len() as i64;
    put("shared-schema", &schema_bytes(&schema));
    put("shared-ready", &row("ready", 0, Data::Null, None, None));
    put("shared-first", &row("shared", 1, Data::Null, Some(length), None));
    put("shared-values-1", &values(1));
    put("shared-values-2", &values(2));
    put("shared-values-5", &values(5));
    put("shared-leads-on", &row("shared", 2, Data::Null, Some(64), None));
    put("shared-memory", &in_memory(length));
    put("shared-memory-cut", &in_memory(length - 64));
    put("shared-memory-nowhere", &row("shared", 2, Data::Null, None, None));
    put("shared-memory-beyond", &in_memory(1 << 40));
    put("shared-memory-before", &in_memory(-1));
    put("shared-holds", &row("values", 2, valid(), None, Some(99)));
}

/// The last position of a pattern: the values, which follow the bytes that describe them.
fn last_position(bytes: &[u8], pattern: &[u8]) -> usize {
    bytes.windows(pattern.len()).rposition(|window| window == pattern).expect("the pattern")
}

/// Writes all replies into a folder.
#[expect(clippy::too_many_lines, reason = "one list of cases")]
pub(super) fn write(folder: &Path) {
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("written");
    put_shared_memory_replies(&put);
    let plain = schema(vec![depth("depth")]);
    let says = |text: &'static str| Data::Text(text.into());
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let samples = vec![7.5_f32; (width * height) as usize];
    let valid = || Data::Struct(vec![map((width, height), &samples)]);
    let values = |number: i64| row(&plain, says("values"), number, [""; 2], valid());
    let reply_1 = |outputs: Data<'_>| row(&plain, says("values"), 1, [""; 2], outputs);
    put("schema", &schema_bytes(&plain));
    put("ready", &row(&plain, says("ready"), 0, [""; 2], Data::Null));
    put("ready-5", &row(&plain, says("ready"), 5, [""; 2], Data::Null));
    for number in 0..10 {
        put(&format!("values-{number}"), &values(number));
    }
    // The script replaces the placeholder by the number of the call.
    put("values-any", &values(ANY));
    put("end", &[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    put("failure-0", &row(&plain, says("failure"), 0, ["ImportError: no torch", "  line 3, in load"], Data::Null));
    put("tells-a-failure", &row(&plain, says("failure"), 1, ["ValueError: too dark", "  line 7, in fuse"], Data::Null));

    // Schemas.
    let plain_schema = schema_bytes(&plain);
    put("cut-schema", &plain_schema[..plain_schema.len() / 2]);
    put("no-protocol", &schema_bytes(&Schema { metadata: Vec::new(), ..plain.clone() }));
    let other = vec![("depthloom.protocol".to_owned(), "2".to_owned())];
    put("other-protocol", &schema_bytes(&Schema { metadata: other, ..plain.clone() }));
    put("no-says", &schema_bytes(&Schema { fields: plain.fields[1..].to_vec(), ..plain.clone() }));
    put("huge-head", &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f]);
    let mut noise = vec![0xff, 0xff, 0xff, 0xff, 0, 1, 0, 0];
    let mut state = 1_u32;
    noise.extend((0..256).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    }));
    put("random-head", &noise);

    // Bodies whose length differs from the declared one.
    let one = values(1);
    put("half", &one[..one.len() / 2]);
    let body_bytes = |bytes: &[u8]| {
        let table = 8 + u32::from_le_bytes(bytes[8..12].try_into().expect("four")) as usize;
        let back = i32::from_le_bytes(bytes[table..table + 4].try_into().expect("four"));
        let fields = (table as i64 - i64::from(back)) as usize;
        table + usize::from(u16::from_le_bytes(bytes[fields + 10..fields + 12].try_into().expect("two")))
    };
    let with_body_length = |bytes: &[u8], length: i64| {
        let mut bytes = bytes.to_vec();
        let at = body_bytes(&bytes);
        bytes[at..at + 8].copy_from_slice(&length.to_le_bytes());
        bytes
    };
    put("huge-body", &[plain_schema.clone(), with_body_length(&one, 1 << 40)].concat());
    put("negative-body", &[plain_schema.clone(), with_body_length(&one, -1)].concat());
    put("longer-than-it-says", &with_body_length(&one, 64));
    put("shorter-than-it-says", &with_body_length(&one, 1 << 31));

    // Rows with invalid values.
    let float64 = DataType::List(Offsets::Narrow, Box::new(Field::new("item", DataType::Float(64))));
    let pixels = |name: &str| Field::new(name, DataType::Int(32, true));
    let f64_field =
        Field::new("depth", DataType::Struct(vec![pixels("width"), pixels("height"), Field::new("data", float64)]));
    let f64_schema = schema(vec![f64_field.nullable()]);
    put("float64-schema", &schema_bytes(&f64_schema));
    let doubles = Data::List(Items::F64(vec![7.5; samples.len()]));
    let doubles = Data::Struct(vec![Data::Struct(vec![Data::Int(width), Data::Int(height), doubles])]);
    put("wrong-type", &row(&f64_schema, says("values"), 1, [""; 2], doubles));
    put("too-few-samples", &reply_1(Data::Struct(vec![map((width, height), &samples[1..])])));
    put("no-samples", &reply_1(Data::Struct(vec![map((width, height), &[])])));
    put("negative-width", &reply_1(Data::Struct(vec![map((-width, -height), &samples)])));
    put("zero-width", &reply_1(Data::Struct(vec![map((0, height), &[])])));
    put("giant-width", &reply_1(Data::Struct(vec![map((i64::from(i32::MAX), i64::from(i32::MAX)), &samples)])));
    put("no-output", &reply_1(Data::Struct(vec![Data::Null])));
    put("no-outputs", &reply_1(Data::Null));
    put("unknown-word", &row(&plain, says("perhaps"), 1, [""; 2], valid()));
    put("says-nothing", &row(&plain, Data::Null, 1, [""; 2], valid()));
    put("another-number", &values(2));
    for (name, at, metres) in
        [("negative-depth", 2 * width + 5, -5.0), ("infinite-depth", width * height - 1, f32::INFINITY)]
    {
        let mut samples = samples.clone();
        samples[at as usize] = metres;
        put(name, &reply_1(Data::Struct(vec![map((width, height), &samples)])));
    }
    let zeros = vec![0.0_f32; samples.len()];
    put("zero-depth", &reply_1(Data::Struct(vec![map((width, height), &zeros)])));
    put("shared-not-agreed", &row(&plain, says("shared"), 1, [""; 2], Data::Null));
    put("ready-again", &row(&plain, says("ready"), 1, [""; 2], Data::Null));
    put("frames-instead", &row(&plain, says("frames"), 1, [""; 2], Data::Null));
    put("a-schema-again", &plain_schema);

    // Rows with invalid offsets, text or numbers of rows.
    let patched = |pattern: &[u8], replacement: &[u8]| {
        let mut bytes = one.clone();
        let at = last_position(&bytes, pattern);
        bytes[at..at + replacement.len()].copy_from_slice(replacement);
        bytes
    };
    let ends = [0, samples.len() as i32].map(i32::to_le_bytes).concat();
    put("offsets-lead-out", &patched(&ends, &[0, samples.len() as i32 + 1].map(i32::to_le_bytes).concat()));
    put("offsets-go-back", &patched(&ends, &[5_i32, 4].map(i32::to_le_bytes).concat()));
    put("no-utf-8", &patched(b"values", &[0xff; 6]));
    let rows = |rows: i64| {
        let mut bytes = one.clone();
        let message = body_bytes(&bytes);
        // The first 64-bit value 1 after the message's table is the number of rows.
        let at = (message + 8..bytes.len()).step_by(8).find(|at| bytes[*at..at + 8] == 1_i64.to_le_bytes());
        let at = at.expect("the number of rows");
        bytes[at..at + 8].copy_from_slice(&rows.to_le_bytes());
        bytes
    };
    put("two-rows", &rows(2));
    put("no-rows", &rows(0));
    put("negative-rows", &rows(-1));
}
