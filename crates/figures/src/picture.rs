//! Maps and images as pictures of no more pixels than are seen.

use depthloom_graphs::values::{Image, Pixels, Raster};

use crate::drawing::{Colour, Picture, WHITE};
use crate::plot::Bar;

/// How many rows of pixels belong to so many columns of a map of this size.
fn rows_of(columns: u32, (width, height): (u32, u32)) -> u32 {
    (f64::from(columns) * f64::from(height) / f64::from(width)).round().max(1.0) as u32
}

/// The pixels of a larger map that a pixel is of.
fn block(at: u32, of: u32, size: u32) -> std::ops::Range<u32> {
    let from = u64::from(at) * u64::from(size) / u64::from(of);
    let to = (u64::from(at + 1) * u64::from(size)).div_ceil(u64::from(of));
    from as u32..(to as u32).min(size)
}

/// A map in colours, white where it has no answer. Of the pixels that become one, the answer nearest its middle.
pub fn coloured(map: &Raster<f32>, columns: u32, bar: &Bar) -> Picture {
    let size @ (width, height) = map.dimensions();
    let rows = rows_of(columns, size);
    let mut rgb = Vec::with_capacity(3 * (columns * rows) as usize);
    for row in 0..rows {
        for column in 0..columns {
            let (xs, ys) = (block(column, columns, width), block(row, rows, height));
            let middle = (i64::from(xs.start + xs.end) / 2, i64::from(ys.start + ys.end) / 2);
            let mut nearest: Option<(i64, f32)> = None;
            for y in ys {
                for x in xs.clone() {
                    let value = map.as_raw()[(y * width + x) as usize];
                    let (dx, dy) = (i64::from(x) - middle.0, i64::from(y) - middle.1);
                    let far = dx * dx + dy * dy;
                    if value.is_finite() && nearest.is_none_or(|(least, _)| far < least) {
                        nearest = Some((far, value));
                    }
                }
            }
            let colour: Colour = nearest.map_or(WHITE, |(_, value)| bar.colour(f64::from(value)));
            rgb.extend(colour);
        }
    }
    Picture { width: columns, height: rows, rgb }
}

/// An image of fewer pixels, each the mean of those that it stands for.
pub fn reduced(image: &Image, columns: u32) -> Picture {
    let pixels = image.pixels();
    let size @ (width, height) = image.dimensions();
    let columns = columns.min(width);
    let rows = rows_of(columns, size);
    let (channels, raw) = match pixels {
        Pixels::Grey(grey) => (1, grey.as_raw().as_slice()),
        Pixels::Rgb(rgb) => (3, rgb.as_raw().as_slice()),
    };
    let mut rgb = Vec::with_capacity(3 * (columns * rows) as usize);
    for row in 0..rows {
        for column in 0..columns {
            let (xs, ys) = (block(column, columns, width), block(row, rows, height));
            let count = (xs.len() * ys.len()).max(1) as u32;
            let mut sums = [0_u32; 3];
            for y in ys {
                for x in xs.clone() {
                    let at = (y * width + x) as usize * channels;
                    sums.iter_mut().enumerate().for_each(|(of, sum)| *sum += u32::from(raw[at + of % channels]));
                }
            }
            rgb.extend(sums.map(|sum| ((sum + count / 2) / count) as u8));
        }
    }
    Picture { width: columns, height: rows, rgb }
}
