//! Cache keys of values by their content, for frames that cannot be read again.

use depthloom_codecs::arrow::{self, Data, Items};
use depthloom_graphs::key::KeyBuilder;
use depthloom_graphs::{Key, Outputs};

/// The key of a frame: the source, and the names, types and content of its values.
pub(crate) fn of_frame(domain: &str, source: &Key, outputs: &Outputs) -> Key {
    let key = Key::build(domain).key(source);
    let content = outputs.entries().fold(key, |key, (name, value)| {
        let key = key.text(name).text(value.value_type().name());
        add(key, &arrow::data(value).unwrap_or(Data::Null))
    });
    content.finish()
}

fn add(key: KeyBuilder, data: &Data<'_>) -> KeyBuilder {
    match data {
        Data::Null => key.text("null"),
        Data::Int(number) => key.bytes(&number.to_le_bytes()),
        Data::Float(number) => key.bytes(&number.to_le_bytes()),
        Data::Text(text) => key.text(text),
        Data::Bytes(bytes) => key.bytes(bytes),
        Data::Struct(parts) => parts.iter().fold(key.number(parts.len() as u64), add),
        Data::List(items) => match items {
            Items::U8(items) => key.bytes(items),
            Items::I16(items) => key.bytes(&bytes(items.iter().map(|item| item.to_le_bytes()))),
            Items::I64(items) => key.bytes(&bytes(items.iter().map(|item| item.to_le_bytes()))),
            Items::F32(items) => key.bytes(&bytes(items.iter().map(|item| item.to_le_bytes()))),
            Items::F64(items) => key.bytes(&bytes(items.iter().map(|item| item.to_le_bytes()))),
            Items::Text(items) => items.iter().fold(key.number(items.len() as u64), |key, item| key.text(item)),
        },
    }
}

fn bytes<const N: usize>(items: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
    items.flatten().collect()
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::{Depth, Image, Pixels, Raster};
    use depthloom_graphs::{Key, Outputs, Value};
    use image::{GrayImage, RgbImage};

    use super::of_frame;

    #[test]
    fn a_key_depends_on_every_name_type_size_and_pixel() {
        let source = Key::of_content(b"source");
        let key = |name, value: Value| of_frame("camera", &source, &Outputs::none().with(name, value));
        let grey = |width, height, pixel| {
            let mut image = GrayImage::new(width, height);
            image[(1, 1)].0 = [pixel];
            Value::from(Image::new(Pixels::Grey(image)))
        };
        let depth = |metres| Value::from(Depth { metres: Raster::from_raw(2, 1, vec![metres, f32::NAN]).unwrap() });
        let keys = [
            key("left", grey(2, 6, 0)),
            key("right", grey(2, 6, 0)),
            key("left", grey(3, 4, 0)),
            key("left", grey(2, 6, 1)),
            key("left", Image::new(Pixels::Rgb(RgbImage::new(2, 2))).into()),
            key("left", depth(1.0)),
            key("left", depth(1.000_001)),
            of_frame("camera", &source, &Outputs::none()),
            of_frame("camera", &Key::of_content(b"other"), &Outputs::none()),
            of_frame("other", &source, &Outputs::none()),
        ];
        for (at, key) in keys.iter().enumerate() {
            assert!(!keys[..at].contains(key), "{at}");
        }
        assert_eq!(keys[0], key("left", grey(2, 6, 0)));
    }
}
