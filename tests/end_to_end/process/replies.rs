//! What processes say, right and wrong, as files for the script `peer.py`.

use std::path::Path;

use depthloom_codecs::arrow::{self, Data, DataType, Field, Items, Offsets, Schema, encode};
use depthloom_graphs::ValueType;

/// The size of the maps of these tests.
pub(super) const SIZE: (u32, u32) = (64, 32);
/// Of those whose values lie in shared memory: their modes begin with `shared`.
pub(super) const LARGE: (u32, u32) = (256, 128);

/// A number of a call that stands for any: it occurs nowhere else in a reply.
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
    arrow::field(name, ValueType::Depth).expect("depths cross")
}

fn of_schema(schema: &Schema) -> Vec<u8> {
    let mut bytes = Vec::new();
    arrow::write_schema(schema, &mut bytes).expect("memory");
    bytes
}

fn row(schema: &Schema, says: Data<'_>, number: i64, told: [&str; 2], outputs: Data<'_>) -> Vec<u8> {
    let told = told.map(|text| if text.is_empty() { Data::Null } else { Data::Text(text.to_owned().into()) });
    let [message, trace] = told;
    let mut bytes = Vec::new();
    encode(schema, vec![says, Data::Int(number), message, trace, outputs]).write(&mut bytes).expect("memory");
    bytes
}

fn map(size: (i64, i64), samples: &[f32]) -> Data<'_> {
    Data::Struct(vec![Data::Int(size.0), Data::Int(size.1), Data::List(Items::F32(samples))])
}

/// What processes say that take part in shared memory. Their schema says a word of 32 letters in the place of that
/// which they find.
fn of_shared_memory(put: &dyn Fn(&str, &[u8])) {
    let mut of = schema(vec![depth("depth")]);
    of.metadata.push(("depthloom.shared".to_owned(), "f".repeat(32)));
    of.fields.push(Field::new("bytes", I64).nullable());
    of.fields.push(Field::new("held", DataType::List(Offsets::Narrow, Box::new(Field::new("item", I64)))).nullable());
    let samples = vec![7.5_f32; (LARGE.0 * LARGE.1) as usize];
    let size = (i64::from(LARGE.0), i64::from(LARGE.1));
    let row = |says: &'static str, number: i64, outputs: Data<'_>, bytes: Option<i64>, held: Option<i64>| {
        let bytes = bytes.map_or(Data::Null, Data::Int);
        let held = held.map_or(Data::Null, |held| Data::List(Items::I64(vec![held])));
        let columns = vec![Data::Text(says.into()), Data::Int(number), Data::Null, Data::Null, outputs, bytes, held];
        let mut row = Vec::new();
        encode(&of, columns).write(&mut row).expect("memory");
        row
    };
    let right = || Data::Struct(vec![map(size, &samples)]);
    let values = |number| row("values", number, right(), None, None);
    let lies = |bytes: i64| row("shared", 2, Data::Null, Some(bytes), None);
    let whole = values(2).len() as i64;
    put("shared-schema", &of_schema(&of));
    put("shared-ready", &row("ready", 0, Data::Null, None, None));
    put("shared-first", &row("shared", 1, Data::Null, Some(whole), None));
    put("shared-values-1", &values(1));
    put("shared-values-2", &values(2));
    put("shared-values-5", &values(5));
    put("shared-leads-on", &row("shared", 2, Data::Null, Some(64), None));
    put("shared-lies", &lies(whole));
    put("shared-lies-cut", &lies(whole - 64));
    put("shared-lies-nowhere", &row("shared", 2, Data::Null, None, None));
    put("shared-lies-beyond", &lies(1 << 40));
    put("shared-lies-before", &lies(-1));
    put("shared-holds", &row("values", 2, right(), None, Some(99)));
}

/// The last place where bytes stand: those of values, behind those that describe them.
fn place(bytes: &[u8], of: &[u8]) -> usize {
    bytes.windows(of.len()).rposition(|window| window == of).expect("they are there")
}

/// Writes all replies into a folder.
#[expect(clippy::too_many_lines, reason = "one list of cases")]
pub(super) fn write(folder: &Path) {
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("written");
    of_shared_memory(&put);
    let plain = schema(vec![depth("depth")]);
    let says = |text: &'static str| Data::Text(text.into());
    let (width, height) = (i64::from(SIZE.0), i64::from(SIZE.1));
    let samples = vec![7.5_f32; (width * height) as usize];
    let right = || Data::Struct(vec![map((width, height), &samples)]);
    let values = |number: i64| row(&plain, says("values"), number, [""; 2], right());
    let of_one = |outputs: Data<'_>| row(&plain, says("values"), 1, [""; 2], outputs);
    put("schema", &of_schema(&plain));
    put("ready", &row(&plain, says("ready"), 0, [""; 2], Data::Null));
    put("ready-5", &row(&plain, says("ready"), 5, [""; 2], Data::Null));
    for number in 0..10 {
        put(&format!("values-{number}"), &values(number));
    }
    // The script puts the number of the call into the place of this one.
    put("values-any", &values(ANY));
    put("end", &[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    put("failure-0", &row(&plain, says("failure"), 0, ["ImportError: no torch", "  line 3, in load"], Data::Null));
    put("tells-a-failure", &row(&plain, says("failure"), 1, ["ValueError: too dark", "  line 7, in fuse"], Data::Null));

    // Schemas.
    let whole = of_schema(&plain);
    put("cut-schema", &whole[..whole.len() / 2]);
    put("no-protocol", &of_schema(&Schema { metadata: Vec::new(), ..plain.clone() }));
    let other = vec![("depthloom.protocol".to_owned(), "2".to_owned())];
    put("other-protocol", &of_schema(&Schema { metadata: other, ..plain.clone() }));
    put("no-says", &of_schema(&Schema { fields: plain.fields[1..].to_vec(), ..plain.clone() }));
    put("huge-head", &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f]);
    let mut noise = vec![0xff, 0xff, 0xff, 0xff, 0, 1, 0, 0];
    let mut state = 1_u32;
    noise.extend((0..256).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    }));
    put("random-head", &noise);

    // Bodies that are not as long as they say.
    let one = values(1);
    put("half", &one[..one.len() / 2]);
    let body_bytes = |bytes: &[u8]| {
        let table = 8 + u32::from_le_bytes(bytes[8..12].try_into().expect("four")) as usize;
        let back = i32::from_le_bytes(bytes[table..table + 4].try_into().expect("four"));
        let fields = (table as i64 - i64::from(back)) as usize;
        table + usize::from(u16::from_le_bytes(bytes[fields + 10..fields + 12].try_into().expect("two")))
    };
    let says_of_its_body = |bytes: &[u8], length: i64| {
        let mut bytes = bytes.to_vec();
        let at = body_bytes(&bytes);
        bytes[at..at + 8].copy_from_slice(&length.to_le_bytes());
        bytes
    };
    put("huge-body", &[whole.clone(), says_of_its_body(&one, 1 << 40)].concat());
    put("negative-body", &[whole.clone(), says_of_its_body(&one, -1)].concat());
    put("longer-than-it-says", &says_of_its_body(&one, 64));
    put("shorter-than-it-says", &says_of_its_body(&one, 1 << 31));

    // Rows that are not one of this node.
    let float64 = DataType::List(Offsets::Narrow, Box::new(Field::new("item", DataType::Float(64))));
    let pixels = |name: &str| Field::new(name, DataType::Int(32, true));
    let of_f64 =
        Field::new("depth", DataType::Struct(vec![pixels("width"), pixels("height"), Field::new("data", float64)]));
    let of_f64 = schema(vec![of_f64.nullable()]);
    put("float64-schema", &of_schema(&of_f64));
    let doubles = Data::List(Items::F64(vec![7.5; samples.len()]));
    let doubles = Data::Struct(vec![Data::Struct(vec![Data::Int(width), Data::Int(height), doubles])]);
    put("wrong-type", &row(&of_f64, says("values"), 1, [""; 2], doubles));
    put("too-few-samples", &of_one(Data::Struct(vec![map((width, height), &samples[1..])])));
    put("no-samples", &of_one(Data::Struct(vec![map((width, height), &[])])));
    put("negative-width", &of_one(Data::Struct(vec![map((-width, -height), &samples)])));
    put("zero-width", &of_one(Data::Struct(vec![map((0, height), &[])])));
    put("giant-width", &of_one(Data::Struct(vec![map((i64::from(i32::MAX), i64::from(i32::MAX)), &samples)])));
    put("no-output", &of_one(Data::Struct(vec![Data::Null])));
    put("no-outputs", &of_one(Data::Null));
    put("unknown-word", &row(&plain, says("perhaps"), 1, [""; 2], right()));
    put("says-nothing", &row(&plain, Data::Null, 1, [""; 2], right()));
    put("another-number", &values(2));
    for (name, at, metres) in
        [("negative-depth", 2 * width + 5, -5.0), ("infinite-depth", width * height - 1, f32::INFINITY)]
    {
        let mut samples = samples.clone();
        samples[at as usize] = metres;
        put(name, &of_one(Data::Struct(vec![map((width, height), &samples)])));
    }
    let zeros = vec![0.0_f32; samples.len()];
    put("zero-depth", &of_one(Data::Struct(vec![map((width, height), &zeros)])));
    put("shared-not-agreed", &row(&plain, says("shared"), 1, [""; 2], Data::Null));
    put("ready-again", &row(&plain, says("ready"), 1, [""; 2], Data::Null));
    put("frames-instead", &row(&plain, says("frames"), 1, [""; 2], Data::Null));
    put("a-schema-again", &whole);

    // Bytes that lead astray.
    let patched = |of: &[u8], by: &[u8]| {
        let mut bytes = one.clone();
        let at = place(&bytes, of);
        bytes[at..at + by.len()].copy_from_slice(by);
        bytes
    };
    let ends = [0, samples.len() as i32].map(i32::to_le_bytes).concat();
    put("offsets-lead-out", &patched(&ends, &[0, samples.len() as i32 + 1].map(i32::to_le_bytes).concat()));
    put("offsets-go-back", &patched(&ends, &[5_i32, 4].map(i32::to_le_bytes).concat()));
    put("no-utf-8", &patched(b"values", &[0xff; 6]));
    let rows = |rows: i64| {
        let mut bytes = one.clone();
        let message = body_bytes(&bytes);
        // The first 64-bit one behind the message's table is the number of rows, of which there is one.
        let at = (message + 8..bytes.len()).step_by(8).find(|at| bytes[*at..at + 8] == 1_i64.to_le_bytes());
        let at = at.expect("the number of rows");
        bytes[at..at + 8].copy_from_slice(&rows.to_le_bytes());
        bytes
    };
    put("two-rows", &rows(2));
    put("no-rows", &rows(0));
    put("negative-rows", &rows(-1));
}
