//! Maps and images as pictures with no more pixels than are seen.

use std::ops::Range;

use depthloom_graphs::values::{Image, Pixels, Raster};

use crate::drawing::{Picture, WHITE};
use crate::plot::Bar;

/// A picture of a number of columns, each pixel from a block of those of a map: of columns and of rows.
fn shrunk((width, height): (u32, u32), columns: u32, pixel: impl Fn(Range<u32>, Range<u32>) -> [u8; 3]) -> Picture {
    let rows = (f64::from(columns) * f64::from(height) / f64::from(width)).round().max(1.0) as u32;
    let block = |at: u32, count: u32, size: u32| {
        let edge = |at: u32| u64::from(at) * u64::from(size);
        (edge(at) / u64::from(count)) as u32..(edge(at + 1).div_ceil(u64::from(count)) as u32).min(size)
    };
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
    let rgb = places.flat_map(|(column, row)| pixel(block(column, columns, width), block(row, rows, height)));
    Picture { rgb: rgb.collect(), width: columns, height: rows }
}

/// A map in colours, white where it is invalid. Of the pixels that become one, the valid one nearest its middle.
pub fn coloured(map: &Raster<f32>, columns: u32, bar: &Bar) -> Picture {
    shrunk(map.dimensions(), columns, |xs, ys| {
        let middle = ((xs.start + xs.end) / 2, (ys.start + ys.end) / 2);
        let far = |(x, y): &(u32, u32)| x.abs_diff(middle.0).pow(2) + y.abs_diff(middle.1).pow(2);
        let value = |(x, y): (u32, u32)| map.as_raw()[(y * map.width() + x) as usize];
        let pixels = ys.flat_map(|y| xs.clone().map(move |x| (x, y)));
        let nearest = pixels.filter(|pixel| value(*pixel).is_finite()).min_by_key(far);
        nearest.map_or(WHITE, |pixel| bar.colour(f64::from(value(pixel))))
    })
}

/// An image of fewer pixels, each the mean of those that it stands for.
pub fn reduced(image: &Image, columns: u32) -> Picture {
    let size @ (width, _) = image.dimensions();
    let (channels, raw) = match image.pixels() {
        Pixels::Grey(grey) => (1, grey.as_raw().as_slice()),
        Pixels::Rgb(rgb) => (3, rgb.as_raw().as_slice()),
    };
    shrunk(size, columns.min(width), |xs, ys| {
        let count = (xs.len() * ys.len()).max(1) as u32;
        std::array::from_fn(|channel| {
            let pixels = ys.clone().flat_map(|y| xs.clone().map(move |x| (y * width + x) as usize * channels));
            let sum: u32 = pixels.map(|at| u32::from(raw[at + channel % channels])).sum();
            ((sum + count / 2) / count) as u8
        })
    })
}
