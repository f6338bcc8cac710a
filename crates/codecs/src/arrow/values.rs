//! Values as columns, and columns as values.

use depthloom_graphs::values::{
    Artifact, Calibration, Curve, CurvePoint, Depth, Disparity, Image, Mask, Number, Pixels, Raster,
    RelativeInverseDepth, TrueDisparity, Weight,
};
use depthloom_graphs::{Value, ValueType};
use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use std::sync::Arc;

use super::batch::View;
use super::row::{Data, Items};
use super::types::{DataType, Field, Offsets};
use crate::decode::nothing_found;

/// Metadata key of a port's column: its value type.
pub const PORT_TYPE: &str = "depthloom.type";

/// The part of a disparity that holds it in floating point where sixteenths do not; else it is empty.
const FINER: &str = "px";

const I32: DataType = DataType::Int(32, true);
const F64: DataType = DataType::Float(64);

/// A column for the values of a type. `None` for those that do not cross: rows of scores.
#[must_use]
pub fn field(name: &str, value_type: ValueType) -> Option<Field> {
    let list = |of| DataType::List(Offsets::Narrow, Box::new(Field::new("item", of)));
    let map = |data: Field| vec![Field::new("width", I32), Field::new("height", I32), data];
    let data = |of, unit: &str| Field::new("data", list(of)).with_metadata("unit", unit);
    let floats = |unit| map(data(DataType::Float(32), unit));
    let parts = match value_type {
        ValueType::Image => {
            let mut parts = map(data(DataType::Int(8, false), "8 bit, grey or RGB"));
            parts.insert(2, Field::new("channels", I32));
            parts
        }
        ValueType::Disparity => {
            let mut parts = map(data(DataType::Int(16, true), "px").with_metadata("scale", "0.0625"));
            parts.insert(2, Field::new("min_disparity", I32));
            parts.push(Field::new(FINER, list(DataType::Float(32))).with_metadata("unit", "px, NaN = nothing found"));
            parts
        }
        ValueType::TrueDisparity => floats("px, NaN = unknown"),
        ValueType::Depth => floats("m, NaN = invalid"),
        ValueType::RelativeInverseDepth => floats("none, NaN = invalid"),
        ValueType::Weight => floats("share"),
        ValueType::Mask => map(data(DataType::Int(8, false), "255 where set")),
        ValueType::Calibration => {
            let numbers = ["focal_px", "cx_px", "cy_px", "baseline_m", "doffs_px"].map(|name| Field::new(name, F64));
            [Field::new("width", I32), Field::new("height", I32)].into_iter().chain(numbers).collect()
        }
        ValueType::Samples | ValueType::Model | ValueType::Reliability => {
            let media_type = Field::new("media_type", DataType::Utf8(Offsets::Narrow));
            vec![media_type, Field::new("data", DataType::Binary(Offsets::Wide))]
        }
        ValueType::Curve => {
            let step = Field::new("step", list(DataType::Int(64, true)));
            let numbers = ["loss", "validation", "learning_rate"].map(|name| Field::new(name, list(F64)));
            [step].into_iter().chain(numbers).collect()
        }
        ValueType::Number => vec![Field::new("value", F64)],
        ValueType::Scores => return None,
    };
    Some(Field::new(name, DataType::Struct(parts)).nullable().with_metadata(PORT_TYPE, value_type.name()))
}

/// A value as [`field`] describes it; `None` for those that do not cross. Large buffers are the value's own.
#[must_use]
pub fn data(value: &Value) -> Option<Data<'_>> {
    let size = |(width, height): (u32, u32)| [Data::Int(width.into()), Data::Int(height.into())];
    let map = |dimensions, items| Data::Struct(size(dimensions).into_iter().chain([Data::List(items)]).collect());
    Some(match value {
        Value::Image(image) => {
            let (channels, bytes) = match image.pixels() {
                Pixels::Grey(grey) => (1, grey.as_raw()),
                Pixels::Rgb(rgb) => (3, rgb.as_raw()),
            };
            let [width, height] = size(image.dimensions());
            Data::Struct(vec![width, height, Data::Int(channels), Data::List(Items::U8(bytes))])
        }
        Value::Disparity(disparity) => fixed_point(size(disparity.sixteenths_px.dimensions()), disparity, &[]),
        Value::FloatDisparity(map) => fixed_point(size(map.px().dimensions()), map.fixed(), map.px()),
        Value::TrueDisparity(disparity) => map(disparity.px.dimensions(), Items::F32(disparity.px.as_raw())),
        Value::Depth(depth) => map(depth.metres.dimensions(), Items::F32(depth.metres.as_raw())),
        Value::RelativeDepth(relative) => {
            let metres = &relative.depth().metres;
            map(metres.dimensions(), Items::F32(metres.as_raw()))
        }
        Value::RelativeInverseDepth(of) => map(of.values.dimensions(), Items::F32(of.values.as_raw())),
        Value::Weight(weight) => map(weight.share.dimensions(), Items::F32(weight.share.as_raw())),
        Value::Mask(mask) => map(mask.set.dimensions(), Items::U8(mask.set.as_raw())),
        Value::Calibration(of) => {
            let [width, height] = size((of.width, of.height));
            let numbers = [of.focal_px, of.cx_px, of.cy_px, of.baseline_m, of.doffs_px].map(Data::Float);
            Data::Struct([width, height].into_iter().chain(numbers).collect())
        }
        Value::Samples(artifact) | Value::Model(artifact) | Value::Reliability(artifact) => {
            Data::Struct(vec![Data::Text(artifact.media_type.as_str().into()), Data::Bytes(&artifact.bytes)])
        }
        Value::Curve(curve) => {
            let numbers = |of: fn(&CurvePoint) -> f64| Data::List(Items::F64(curve.points.iter().map(of).collect()));
            Data::Struct(vec![
                Data::List(Items::I64(curve.points.iter().map(|point| point.step as i64).collect())),
                numbers(|point| point.loss),
                numbers(|point| point.validation.unwrap_or(f64::NAN)),
                numbers(|point| point.learning_rate),
            ])
        }
        Value::Number(number) => Data::Struct(vec![Data::Float(number.value)]),
        Value::Scores(_) => return None,
    })
}

fn fixed_point<'a>([width, height]: [Data<'a>; 2], disparity: &'a Disparity, finer: &'a [f32]) -> Data<'a> {
    let least = Data::Int(disparity.min_disparity_px.into());
    let sixteenths = Data::List(Items::I16(disparity.sixteenths_px.as_raw()));
    Data::Struct(vec![width, height, least, sixteenths, Data::List(Items::F32(finer))])
}

/// Reads a column as a value of a type.
pub fn value(value_type: ValueType, column: &View<'_>) -> Result<Value, String> {
    column.parts()?;
    let part = |name: &str| column.part(name).ok_or_else(|| format!("it has no `{name}`"));
    let pixels = |name: &str| -> Result<u32, String> {
        let value = part(name)?.int()?;
        u32::try_from(value).ok().filter(|pixels| *pixels > 0).ok_or_else(|| format!("its `{name}` is {value}"))
    };
    let size = || Ok::<_, String>((pixels("width")?, pixels("height")?));
    let floats = || raster(size()?, part("data")?.f32s()?);
    Ok(match value_type {
        ValueType::Image => {
            let (size, bytes) = (size()?, part("data")?.u8s()?);
            let channels = part("channels")?.int()?;
            fits(size, channels, bytes.len())?;
            let (width, height) = size;
            let pixels = match channels {
                1 => GrayImage::from_raw(width, height, bytes.to_vec()).map(Pixels::Grey),
                3 => RgbImage::from_raw(width, height, bytes.to_vec()).map(Pixels::Rgb),
                _ => return Err(format!("it has {channels} channels; an image has 1 or 3")),
            };
            Image::new(pixels.ok_or("its size differs from its stated size")?).into()
        }
        ValueType::Disparity => {
            // Of programs from before, it has no such part.
            let finer = column.part(FINER).map_or_else(|| Ok(Vec::new()), |px| px.f32s())?;
            if !finer.is_empty() {
                let disparity = TrueDisparity { px: raster(size()?, finer)? };
                disparity.validate()?;
                return Ok(Value::disparity_from_px(disparity.px));
            }
            let least = part("min_disparity")?.int()?;
            let known = i32::try_from(least).ok().and_then(|least| Some((least, nothing_found(least)?)));
            let (min_disparity_px, missing) =
                known.ok_or_else(|| format!("disparities from {least} px on do not fit into 16 bits"))?;
            let mut fixed = part("data")?.i16s()?;
            // Whatever is below the least disparity is invalid. In a value of ours one number marks it.
            fixed
                .iter_mut()
                .for_each(|fixed| *fixed = if *fixed < missing.saturating_add(16) { missing } else { *fixed });
            Disparity { sixteenths_px: raster(size()?, fixed)?, min_disparity_px }.into()
        }
        ValueType::TrueDisparity => TrueDisparity { px: floats()? }.into(),
        ValueType::Depth => Depth { metres: floats()? }.into(),
        ValueType::RelativeInverseDepth => RelativeInverseDepth { values: floats()? }.into(),
        ValueType::Weight => Weight { share: floats()? }.into(),
        ValueType::Mask => {
            let set = part("data")?.u8s()?.iter().map(|&set| if set == 0 { 0 } else { 255 }).collect();
            Mask { set: raster(size()?, set)? }.into()
        }
        ValueType::Calibration => {
            let number = |name: &str| -> Result<f64, String> {
                let value = part(name)?.float()?;
                if value.is_finite() { Ok(value) } else { Err(format!("its `{name}` is {value}")) }
            };
            let (width, height) = size()?;
            Calibration {
                width,
                height,
                focal_px: number("focal_px")?,
                cx_px: number("cx_px")?,
                cy_px: number("cy_px")?,
                baseline_m: number("baseline_m")?,
                doffs_px: number("doffs_px")?,
            }
            .into()
        }
        ValueType::Samples | ValueType::Model | ValueType::Reliability => {
            let artifact = Arc::new(Artifact::new(part("media_type")?.text()?, part("data")?.bytes()?));
            Value::from_artifact(value_type, artifact).ok_or_else(|| format!("{value_type} has no artefacts"))?
        }
        ValueType::Curve => {
            let step = part("step")?.i64s()?;
            let [loss, validation, rate] =
                [part("loss")?.f64s()?, part("validation")?.f64s()?, part("learning_rate")?.f64s()?];
            if [&loss, &validation, &rate].iter().any(|list| list.len() != step.len()) {
                return Err("its lists are not of one length".to_owned());
            }
            let point = |(at, step): (usize, &i64)| {
                let step = u64::try_from(*step).map_err(|_| format!("a step is {step}"))?;
                let validation = Some(validation[at]).filter(|loss| !loss.is_nan());
                Ok(CurvePoint { step, loss: loss[at], validation, learning_rate: rate[at] })
            };
            let points = step.iter().enumerate().map(point).collect::<Result<_, String>>()?;
            Curve { points }.into()
        }
        ValueType::Number => Number { value: part("value")?.float()? }.into(),
        ValueType::Scores => return Err("rows of scores do not cross".to_owned()),
    })
}

fn fits((width, height): (u32, u32), channels: i64, samples: usize) -> Result<(), String> {
    if i128::from(width) * i128::from(height) * i128::from(channels) == samples as i128 {
        return Ok(());
    }
    let channels = if channels == 1 { String::new() } else { format!(" of {channels} channels") };
    Err(format!("it has {samples} samples, which is not {width}x{height} pixels{channels}"))
}

fn raster<T>(size: (u32, u32), samples: Vec<T>) -> Result<Raster<T>, String>
where
    Luma<T>: image::Pixel<Subpixel = T>,
    T: image::Primitive,
{
    fits(size, 1, samples.len())?;
    ImageBuffer::from_raw(size.0, size.1, samples).ok_or_else(|| "its size differs from its stated size".to_owned())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use depthloom_graphs::values::{
        Artifact, Calibration, Curve, CurvePoint, Depth, Disparity, Image, Mask, Number, Pixels, Raster, TrueDisparity,
        Weight,
    };
    use depthloom_graphs::{Value, ValueType};
    use image::{GrayImage, RgbImage};

    use super::{data, field, value};
    use crate::arrow::{Schema, StreamReader, encode, write_schema};

    fn values() -> Vec<Value> {
        let floats = || Raster::from_raw(3, 2, vec![1.5, f32::NAN, -0.0, f32::INFINITY, 1e-40, 7.0]).unwrap();
        let point = |step, validation| CurvePoint { step, loss: 0.5, validation, learning_rate: 1e-3 };
        let (width, height) = (3, 2);
        let rgb = RgbImage::from_raw(3, 2, (0..18).collect()).unwrap();
        vec![
            Image::new(Pixels::Grey(GrayImage::from_raw(3, 2, (0..6).collect()).unwrap())).into(),
            Image::new(Pixels::Rgb(rgb)).into(),
            Disparity {
                sixteenths_px: Raster::from_raw(3, 2, vec![-48, 0, 1, -1, 32767, -32]).unwrap(),
                min_disparity_px: -2,
            }
            .into(),
            Value::disparity_from_px(Raster::from_raw(3, 2, vec![10.03, f32::NAN, 0.0, 1.0, 2.5, -3.0]).unwrap()),
            TrueDisparity { px: floats() }.into(),
            Depth { metres: floats() }.into(),
            Weight { share: floats() }.into(),
            Mask { set: Raster::from_raw(3, 2, vec![0, 255, 255, 0, 0, 255]).unwrap() }.into(),
            Calibration { width, height, focal_px: 721.5, cx_px: 1.0, cy_px: 0.5, baseline_m: 0.53, doffs_px: 3.0 }
                .into(),
            Value::Model(Arc::new(Artifact::model(b"onnx".to_vec()))),
            Value::Samples(Arc::new(Artifact::samples(Vec::new()))),
            Value::Reliability(Arc::new(Artifact::reliability("{}".to_owned()))),
            Curve { points: vec![point(1, None), point(20, Some(0.25))] }.into(),
            Curve::default().into(),
            Number { value: -0.0 }.into(),
        ]
    }

    /// As text: NaN is equal to NaN there.
    fn as_text(value: &Value) -> String {
        match value {
            Value::Image(image) => format!("{:?}", image.pixels()),
            Value::Depth(depth) => format!("{:?}", depth.metres.iter().map(|z| z.to_bits()).collect::<Vec<_>>()),
            other => format!("{other:?}"),
        }
    }

    #[test]
    fn every_value_is_restored_next_to_absent_values() {
        for given in values() {
            let value_type = given.value_type();
            let others = ValueType::ALL.into_iter().filter_map(|of| field(&format!("no {of}"), of));
            let fields = others.chain(field("it", value_type)).collect();
            let schema = Schema { fields, metadata: vec![("key".to_owned(), "ü".to_owned())] };
            let nothing = vec![super::Data::Null; schema.fields.len() - 1];
            let row = nothing.into_iter().chain(data(&given)).collect();
            let mut stream = Vec::new();
            write_schema(&schema, &mut stream).unwrap();
            encode(&schema, row).write(&mut stream).unwrap();
            assert_eq!(stream.len() % 8, 0);
            let mut reader = StreamReader::new(&stream[..]);
            let read = reader.schema().unwrap().unwrap();
            assert_eq!(read, schema);
            let batch = reader.batch(&read).unwrap().unwrap();
            assert!(batch.column(&read, "no depth").is_none());
            let back = value(value_type, &batch.column(&read, "it").unwrap()).unwrap();
            assert_eq!(as_text(&back), as_text(&given));
            assert!(reader.batch(&read).unwrap().is_none());
        }
    }

    /// Whatever is flipped or cut: an error or another value, never a panic.
    #[test]
    fn no_damage_to_a_stream_panics() {
        let mut random = depthloom_random::SplitMix64::new(1);
        for given in values() {
            let schema = Schema { fields: field("it", given.value_type()).into_iter().collect(), metadata: Vec::new() };
            let mut stream = Vec::new();
            write_schema(&schema, &mut stream).unwrap();
            encode(&schema, data(&given).into_iter().collect()).write(&mut stream).unwrap();
            for _ in 0..400 {
                let mut broken = stream.clone();
                for _ in 0..=random.below(4) {
                    let at = random.below(broken.len());
                    broken[at] = if random.below(2) == 0 { random.below(256) as u8 } else { 0xff };
                }
                broken.truncate(random.below(2 * broken.len()) + 1);
                let mut reader = StreamReader::new(&broken[..]);
                let Ok(Some(schema)) = reader.schema() else { continue };
                let Ok(Some(batch)) = reader.batch(&schema) else { continue };
                for field in &schema.fields {
                    let Some(column) = batch.column(&schema, &field.name) else { continue };
                    for of in ValueType::ALL {
                        let _ = value(of, &column);
                    }
                }
            }
        }
    }

    /// In the protocol, values below the smallest disparity are invalid. Some nodes use `(min_disparity - 1) *
    /// 16` alone for that.
    #[test]
    fn disparities_below_the_least_become_the_one_number_for_nothing_found() {
        let given = Value::from(Disparity {
            sixteenths_px: Raster::from_raw(3, 2, vec![-1, -15, -16, i16::MIN, 0, 5]).unwrap(),
            min_disparity_px: 0,
        });
        let schema = Schema { fields: field("it", ValueType::Disparity).into_iter().collect(), metadata: Vec::new() };
        let mut stream = Vec::new();
        write_schema(&schema, &mut stream).unwrap();
        encode(&schema, data(&given).into_iter().collect()).write(&mut stream).unwrap();
        let mut reader = StreamReader::new(&stream[..]);
        let schema = reader.schema().unwrap().unwrap();
        let batch = reader.batch(&schema).unwrap().unwrap();
        let read = value(ValueType::Disparity, &batch.column(&schema, "it").unwrap()).unwrap();
        let Value::Disparity(read) = read else { panic!("{read:?}") };
        assert_eq!(read.sixteenths_px.as_raw()[..], [-16, -16, -16, -16, 0, 5]);
    }
}
