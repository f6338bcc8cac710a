//! A contact sheet: many frames of a data set in one picture, left images and beneath them what is true of them.

use std::io::Cursor;

use depthloom_codecs::picture::picture;
use depthloom_graphs::Value;
use depthloom_graphs::values::{Depth, Image, Pixels, Raster, TrueDisparity};
use image::imageops::FilterType;
use image::{ImageFormat, Rgb, RgbImage};

/// Pixels across a frame, between frames, and frames in a row.
const ACROSS: u32 = 320;
const GAP: u32 = 6;
const COLUMNS: usize = 4;
const GROUND: Rgb<u8> = Rgb([24, 24, 24]);

#[derive(Debug, Default)]
pub(crate) struct Sheet {
    sources: Vec<Vec<RgbImage>>,
}

impl Sheet {
    /// The frames that come are of another source: they begin a row of their own.
    pub(crate) fn begin(&mut self) {
        self.sources.push(Vec::new());
    }

    pub(crate) fn add(&mut self, left: Option<&Value>, truth: Option<&Value>) {
        let Some(Value::Image(left)) = left else { return };
        let Some(left) = reduced(left) else { return };
        let truth = truth.and_then(|truth| coloured(truth, left.dimensions()));
        let beneath = if truth.is_some() { left.height() } else { 0 };
        let mut frame = RgbImage::from_pixel(left.width(), left.height() + beneath, GROUND);
        image::imageops::replace(&mut frame, &left, 0, 0);
        if let Some(truth) = truth {
            image::imageops::replace(&mut frame, &truth, 0, i64::from(left.height()));
        }
        if let Some(frames) = self.sources.last_mut() {
            frames.push(frame);
        }
    }

    /// The sheet, a PNG's bytes; `None` without a frame.
    pub(crate) fn png(&self) -> Option<Vec<u8>> {
        let rows: Vec<&[RgbImage]> = self.sources.iter().flat_map(|frames| frames.chunks(COLUMNS)).collect();
        let height_of = |row: &[RgbImage]| row.iter().map(RgbImage::height).max().unwrap_or(0) + GAP;
        let width = rows.iter().map(|row| row.iter().map(|frame| frame.width() + GAP).sum::<u32>()).max()? + GAP;
        let height = rows.iter().map(|row| height_of(row)).sum::<u32>() + GAP;
        let mut sheet = RgbImage::from_pixel(width, height, GROUND);
        let mut y = GAP;
        for row in rows {
            let mut x = GAP;
            for frame in row {
                image::imageops::replace(&mut sheet, frame, x.into(), y.into());
                x += frame.width() + GAP;
            }
            y += height_of(row);
        }
        let mut bytes = Cursor::new(Vec::new());
        sheet.write_to(&mut bytes, ImageFormat::Png).ok()?;
        Some(bytes.into_inner())
    }
}

/// A size of [`ACROSS`] pixels across, at most.
fn size((width, height): (u32, u32)) -> Option<(u32, u32)> {
    let across = width.min(ACROSS);
    let down = (u64::from(height) * u64::from(across)).checked_div(width.into())?.clamp(1, 4 * u64::from(ACROSS));
    Some((across, down as u32))
}

fn reduced(image: &Image) -> Option<RgbImage> {
    let (width, height) = size(image.dimensions())?;
    let rgb = match image.pixels() {
        Pixels::Rgb(rgb) => rgb.clone(),
        Pixels::Grey(grey) => {
            RgbImage::from_fn(grey.width(), grey.height(), |x, y| Rgb([grey.get_pixel(x, y).0[0]; 3]))
        }
    };
    Some(image::imageops::resize(&rgb, width, height, FilterType::Triangle))
}

/// A truth in the colours of recordings' pictures, of the reduced image's size. Sparse points stay: of the pixels that
/// become one the nearest is shown.
fn coloured(truth: &Value, (width, height): (u32, u32)) -> Option<RgbImage> {
    // Pictures are of every second pixel and row.
    let near = |map: &Raster<f32>, nearer: fn(f32, f32) -> f32| {
        let range = |at: u32, of: u32, count: u32| {
            let begin = (u64::from(at) * u64::from(count) / u64::from(of)) as u32;
            let end = (u64::from(at + 1) * u64::from(count)).div_ceil(of.into()) as u32;
            begin..end.min(count)
        };
        let (columns, rows) = map.dimensions();
        Raster::from_fn(2 * width, 2 * height, |x, y| {
            let pixels = range(y / 2, height, rows)
                .flat_map(|row| range(x / 2, width, columns).map(move |column| (column, row)));
            image::Luma([pixels.map(|(column, row)| map.get_pixel(column, row).0[0]).fold(f32::NAN, nearer)])
        })
    };
    let small: Value = match truth {
        Value::RelativeDepth(of) => Depth { metres: near(&of.depth().metres, f32::min) }.into(),
        Value::Depth(depth) => Depth { metres: near(&depth.metres, f32::min) }.into(),
        Value::TrueDisparity(truth) => TrueDisparity { px: near(&truth.px, f32::max) }.into(),
        _ => return None,
    };
    image::load_from_memory(&picture(&small)?).ok().map(image::DynamicImage::into_rgb8)
}
