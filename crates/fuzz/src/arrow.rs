//! What a program of another language says: a stream of Arrow's.

use depthloom_codecs::arrow::{self, DataType, Field, Items, Offsets, Schema, StreamReader, View};
use depthloom_graphs::values::{
    Artifact, Calibration, Curve, CurvePoint, Depth, Disparity, Image, Mask, Pixels, Raster,
};
use depthloom_graphs::{Value, ValueType};
use image::RgbImage;

use crate::Target;

/// A stream, read to its end as the replies of a process are, and every column as a value of every type.
pub(crate) fn target() -> Target {
    Target::new("arrow_stream", vec![values(), replies()], |bytes, _| {
        let mut reader = StreamReader::new(bytes);
        let schema = reader.schema().map_err(|error| error.to_string())?.ok_or("it has no schema")?;
        while let Some(batch) = reader.batch(&schema).map_err(|error| error.to_string())? {
            for field in &schema.fields {
                if let Some(column) = batch.column(&schema, &field.name) {
                    read(&column)?;
                }
            }
        }
        Ok(())
    })
}

/// Reads a column in every way; an error if a program may not send such a column.
fn read(column: &View<'_>) -> Result<(), String> {
    let read = [
        ValueType::ALL.into_iter().any(|of| arrow::value(of, column).is_ok()),
        column.int().is_ok(),
        column.float().is_ok(),
        column.text().is_ok(),
        column.bytes().is_ok(),
        column.u8s().is_ok(),
        column.i16s().is_ok(),
        column.i64s().is_ok(),
        column.f32s().is_ok(),
        column.f64s().is_ok(),
        column.texts().is_ok(),
    ];
    let mut is_read = read.contains(&true);
    for part in column.parts().unwrap_or_default() {
        is_read |= column.part(&part.name).is_none_or(|part| self::read(&part).is_ok());
    }
    if is_read { Ok(()) } else { Err(format!("column `{}` cannot be read", column.field.name)) }
}

fn stream(schema: &Schema, rows: Vec<Vec<arrow::Data<'_>>>) -> Vec<u8> {
    let mut stream = Vec::new();
    arrow::write_schema(schema, &mut stream).expect("memory");
    for row in rows {
        arrow::encode(schema, row).write(&mut stream).expect("memory");
    }
    stream.extend([0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    stream
}

/// Values of most types, and a row of none.
fn values() -> Vec<u8> {
    let camera =
        Calibration { width: 3, height: 2, focal_px: 700.0, cx_px: 1.5, cy_px: 1.0, baseline_m: 0.5, doffs_px: 0.0 };
    let curve = Curve { points: vec![CurvePoint { step: 1, loss: 0.5, validation: None, learning_rate: 0.1 }] };
    let values = [
        Value::from(Depth { metres: Raster::from_raw(3, 2, vec![1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0]).expect("six") }),
        Disparity {
            sixteenths_px: Raster::from_raw(3, 2, vec![-16, 0, 16, 32, 48, 64]).expect("six"),
            min_disparity_px: 0,
        }
        .into(),
        Mask { set: Raster::from_raw(3, 2, vec![0, 255, 0, 255, 255, 0]).expect("six") }.into(),
        Image::new(Pixels::Rgb(RgbImage::from_raw(3, 2, (0..18).collect()).expect("eighteen"))).into(),
        camera.into(),
        curve.into(),
        Value::Model(Artifact::new("application/onnx", &b"onnx"[..]).into()),
    ];
    let fields =
        values.iter().filter_map(|value| arrow::field(value.value_type().name(), value.value_type())).collect();
    let schema = Schema { fields, metadata: vec![("depthloom.protocol".to_owned(), "1".to_owned())] };
    let row = values.iter().filter_map(arrow::data).collect();
    stream(&schema, vec![row, values.iter().map(|_| arrow::Data::Null).collect()])
}

/// What a source says, with the wide offsets that others may send.
fn replies() -> Vec<u8> {
    let list = |of| DataType::List(Offsets::Wide, Box::new(Field::new("item", of)));
    let frames = DataType::Struct(vec![
        Field::new("id", list(DataType::Utf8(Offsets::Wide))),
        Field::new("time_ns", list(DataType::Int(64, true))),
    ]);
    let numbers = ["index", "time_ns", "age_ns", "missed"].map(|name| Field::new(name, DataType::Int(64, true)));
    let id = Field::new("id", DataType::Utf8(Offsets::Wide));
    let frame = DataType::Struct([id].into_iter().chain(numbers).collect());
    let fields = vec![
        Field::new("says", DataType::Utf8(Offsets::Wide)),
        Field::new("number", DataType::Int(64, true)),
        Field::new("frames", frames).nullable(),
        Field::new("frame", frame).nullable(),
    ];
    let ids = arrow::Data::List(Items::Text(vec!["a".to_owned(), "b".to_owned()]));
    let frames = arrow::Data::Struct(vec![ids, arrow::Data::List(Items::I64(vec![0, 100_000_000]))]);
    let stated = [4, 5, 6, 1].map(arrow::Data::Int);
    let frame = arrow::Data::Struct([arrow::Data::Text("a".into())].into_iter().chain(stated).collect());
    let row =
        |says: &'static str, frames, frame| vec![arrow::Data::Text(says.into()), arrow::Data::Int(1), frames, frame];
    let (none, end) = (arrow::Data::Null, row("end", arrow::Data::Null, arrow::Data::Null));
    let rows = vec![
        row("ready", none.clone(), none.clone()),
        row("frames", frames, none.clone()),
        row("frame", none, frame),
        end,
    ];
    stream(&Schema { fields, metadata: Vec::new() }, rows)
}
