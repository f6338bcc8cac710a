//! Values as Arrow arrays of one row, as in messages of dora: those of processes
//! (`docs/reference/process-protocol.md`), with what a recording needs in addition.

use std::sync::Arc;

use depthloom_codecs::arrow::{
    Batch, Data, DataType, Field, Offsets, Schema, StreamReader, View, data, encode, field, value, write_schema,
};
use depthloom_codecs::decode;
use depthloom_codecs::messages::ScoreMessage;
use depthloom_graphs::values::{Encoded, Image, ImageFormat};
use depthloom_graphs::{Value, ValueType};

const COLUMN: &str = "value";
/// Columns of an image from a file: the file's bytes, which a recording keeps, and their format.
const FILE: &str = "file";
const FILE_FORMAT: &str = "file_format";
/// The column of score rows: messages of a recording, each after its length (u32, little endian).
const ROWS: &str = "rows";

/// The stream of a text: one row of utf8.
pub fn of_text(text: &str) -> Vec<u8> {
    let field = Field::new(COLUMN, DataType::Utf8(Offsets::Wide));
    stream(field, Data::Text(text.into()))
}

/// The stream of a value: one row of a struct.
pub fn of_value(given: &Value) -> Vec<u8> {
    if let Value::Scores(rows) = given {
        let rows = rows.iter().map(|row| ScoreMessage::encoded("", row));
        let bytes: Vec<u8> = rows.flat_map(|row| [&(row.len() as u32).to_le_bytes(), &*row].concat()).collect();
        let parts = vec![Field::new(ROWS, DataType::Binary(Offsets::Wide))];
        return stream(Field::new(COLUMN, DataType::Struct(parts)), Data::Struct(vec![Data::Bytes(&bytes)]));
    }
    // Every other type crosses.
    let (Some(mut field), Some(mut row)) = (field(COLUMN, given.value_type()), data(given)) else { return Vec::new() };
    if let (Value::Image(image), DataType::Struct(parts), Data::Struct(values)) =
        (given, &mut field.data_type, &mut row)
        && let Some(encoded) = image.encoded()
    {
        parts.push(Field::new(FILE, DataType::Binary(Offsets::Wide)));
        parts.push(Field::new(FILE_FORMAT, DataType::Utf8(Offsets::Narrow)));
        values.extend([Data::Bytes(&encoded.bytes), Data::Text(encoded.format.name().into())]);
    }
    stream(field, row)
}

fn stream(field: Field, row: Data<'_>) -> Vec<u8> {
    let schema = Schema { fields: vec![field], metadata: Vec::new() };
    let mut bytes = Vec::new();
    // A vector takes all that is written to it.
    let _ = write_schema(&schema, &mut bytes).and_then(|()| encode(&schema, vec![row]).write(&mut bytes));
    bytes
}

/// A row.
pub struct Row {
    schema: Schema,
    batch: Batch,
}

impl Row {
    /// Reads the row of a stream.
    ///
    /// # Errors
    /// A lower-case fragment.
    pub fn read(stream: &[u8]) -> Result<Self, String> {
        let mut reader = StreamReader::new(stream);
        let none = || "it has no row".to_owned();
        let schema = reader.schema().map_err(|error| error.to_string())?.ok_or_else(none)?;
        let batch = reader.batch(&schema).map_err(|error| error.to_string())?.ok_or_else(none)?;
        Ok(Self { schema, batch })
    }

    /// The column.
    ///
    /// # Errors
    /// If it is null.
    pub fn column(&self) -> Result<View<'_>, String> {
        self.batch.column(&self.schema, COLUMN).ok_or_else(|| "it is null".to_owned())
    }

    /// The text.
    ///
    /// # Errors
    /// If it is not a text.
    pub fn text(&self) -> Result<&str, String> {
        self.column()?.text()
    }

    /// The value.
    ///
    /// # Errors
    /// If it is not a value of that type.
    pub fn value(&self, value_type: ValueType) -> Result<Value, String> {
        let column = self.column()?;
        if value_type == ValueType::Scores {
            let rows = column.part(ROWS).ok_or("it has no `rows`")?;
            return scores(rows.bytes()?);
        }
        let read = value(value_type, &column)?;
        let (Value::Image(image), Some(file)) = (&read, column.part(FILE)) else { return Ok(read) };
        let format = column.part(FILE_FORMAT).ok_or("its file is of no format")?;
        let format = match format.text()? {
            name if name == ImageFormat::Png.name() => ImageFormat::Png,
            name if name == ImageFormat::Jpeg.name() => ImageFormat::Jpeg,
            other => return Err(format!("its file is of the format `{other}`")),
        };
        let encoded = Encoded { format, bytes: file.bytes()?.into() };
        Ok(Image::with_encoded(image.pixels().clone(), encoded).into())
    }
}

fn scores(mut bytes: &[u8]) -> Result<Value, String> {
    let mut rows = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        let row = rest.get(..length).ok_or("a row of scores is cut off")?;
        rows.push(decode::score(row)?);
        bytes = &rest[length..];
    }
    Ok(Value::Scores(Arc::new(rows)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use depthloom_codecs::encode::{Stamp, put};
    use depthloom_graphs::values::{Artifact, Depth, Encoded, Image, ImageFormat, Pixels, Raster};
    use depthloom_graphs::{Value, ValueType};
    use image::GrayImage;

    use super::{Row, of_text, of_value};

    fn back(value: &Value) -> Value {
        Row::read(&of_value(value)).unwrap().value(value.value_type()).unwrap()
    }

    /// What a recording would hold.
    fn recorded(value: &Value) -> Vec<u8> {
        let mut message = Vec::new();
        put(&mut message, Stamp { time_ns: 0, frame_id: "left" }, value).unwrap();
        message
    }

    #[test]
    fn values_come_as_they_went_and_images_with_their_files() {
        let depth = Value::from(Depth { metres: Raster::from_raw(2, 1, vec![1.5, f32::NAN]).unwrap() });
        let pixels = || Pixels::Grey(GrayImage::from_raw(2, 1, vec![7, 9]).unwrap());
        let encoded = Encoded { format: ImageFormat::Png, bytes: Arc::from(&b"a file"[..]) };
        for value in [depth, Image::new(pixels()).into(), Image::with_encoded(pixels(), encoded).into()] {
            assert_eq!(recorded(&back(&value)), recorded(&value));
        }
        let model = Value::Model(Artifact::model(b"onnx".to_vec()).into());
        assert_eq!(back(&model).artifact().unwrap().hash, model.artifact().unwrap().hash);
    }

    #[test]
    fn a_text_is_a_text_and_no_value() {
        let stream = of_text("Grüße");
        let row = Row::read(&stream).unwrap();
        assert_eq!(row.text(), Ok("Grüße"));
        assert!(row.value(ValueType::Depth).is_err());
        for cut in 0..stream.len() - 8 {
            let _ = Row::read(&stream[..cut]).map(|row| row.text().map(str::to_owned));
        }
    }
}
