//! A drawing as pixels.

use tiny_skia::{
    FillRule, FilterQuality, LineCap, LineJoin, Mask, Paint, PathBuilder, Pixmap, PixmapPaint, PremultipliedColorU8,
    Rect, Stroke as Line, StrokeDash, Transform,
};
use ttf_parser::OutlineBuilder;

use super::{Anchor, At, Colour, Drawing, MM_PER_INCH, Mark, POINTS_PER_INCH, Picture, Text, circle, font};

/// So many pixels a side at most.
const MOST: f64 = 20_000.0;

pub(super) fn written(drawing: &Drawing, dpi: f64) -> Result<Vec<u8>, String> {
    let scale = dpi / POINTS_PER_INCH;
    let (width, height) = ((drawing.width_pt * scale).round(), (drawing.height_pt * scale).round());
    let too_large = || format!("a picture of {width} x {height} pixels is too large");
    if !(1.0..=MOST).contains(&width) || !(1.0..=MOST).contains(&height) {
        return Err(too_large());
    }
    let mut canvas = Pixmap::new(width as u32, height as u32).ok_or_else(too_large)?;
    canvas.fill(tiny_skia::Color::WHITE);
    let mut page = Page { canvas, scale, mask: None };
    drawing.marks.iter().for_each(|mark| page.draw(mark));
    let rgb: Vec<u8> = page.canvas.pixels().iter().flat_map(|of| [of.red(), of.green(), of.blue()]).collect();
    Ok(encoded(page.canvas.width(), page.canvas.height(), &rgb, Some(dpi)))
}

/// Pixels as a PNG file; with `dpi` it says how large they are.
pub(super) fn encoded(width: u32, height: u32, rgb: &[u8], dpi: Option<f64>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    if let Some(dpi) = dpi {
        let a_metre = (dpi / MM_PER_INCH * 1000.0).round() as u32;
        encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: a_metre, yppu: a_metre, unit: png::Unit::Meter }));
    }
    let mut writer = encoder.write_header().expect("memory takes a header");
    writer.write_image_data(rgb).expect("memory takes the rows that were announced");
    writer.finish().expect("memory takes an end");
    bytes
}

/// What is drawn on.
struct Page {
    canvas: Pixmap,
    /// Pixels a point.
    scale: f64,
    mask: Option<Mask>,
}

impl Page {
    fn draw(&mut self, mark: &Mark) {
        match mark {
            Mark::Line { points, stroke } => {
                let Some(path) = path(points, false) else { return };
                let dashes: Vec<f32> = stroke.dashes.iter().map(|dash| *dash as f32).collect();
                let line = Line {
                    width: stroke.width as f32,
                    line_cap: LineCap::Butt,
                    line_join: LineJoin::Round,
                    dash: StrokeDash::new(dashes, 0.0),
                    ..Line::default()
                };
                let (paint, transform) = (paint(stroke.colour, stroke.opacity), self.transform());
                self.canvas.stroke_path(&path, &paint, &line, transform, self.mask.as_ref());
            }
            Mark::Area { points, fill } => {
                let Some(path) = path(points, true) else { return };
                self.fill(&path, fill.colour, fill.opacity, self.transform());
            }
            Mark::Dot { at, radius, fill } => {
                let ((x, y), curves) = circle(*at, *radius);
                let mut builder = PathBuilder::new();
                builder.move_to(x as f32, y as f32);
                for [(ax, ay), (bx, by), (x, y)] in curves {
                    builder.cubic_to(ax as f32, ay as f32, bx as f32, by as f32, x as f32, y as f32);
                }
                builder.close();
                let Some(path) = builder.finish() else { return };
                self.fill(&path, fill.colour, fill.opacity, self.transform());
            }
            Mark::Text(text) => self.text(text),
            Mark::Picture { at, size, picture } => self.picture(*at, *size, picture),
            Mark::Clip { at, size } => {
                let rect = Rect::from_xywh(at.0 as f32, at.1 as f32, size.0 as f32, size.1 as f32);
                self.mask = rect.and_then(|rect| {
                    let mut mask = Mask::new(self.canvas.width(), self.canvas.height())?;
                    mask.fill_path(&PathBuilder::from_rect(rect), FillRule::Winding, true, self.transform());
                    Some(mask)
                });
            }
            Mark::Unclip => self.mask = None,
        }
    }

    fn transform(&self) -> Transform {
        Transform::from_scale(self.scale as f32, self.scale as f32)
    }

    fn fill(&mut self, path: &tiny_skia::Path, colour: Colour, opacity: f64, transform: Transform) {
        self.canvas.fill_path(path, &paint(colour, opacity), FillRule::Winding, transform, self.mask.as_ref());
    }

    fn text(&mut self, text: &Text) {
        let wide = font::width(&text.words, text.size);
        let mut along = match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -wide / 2.0,
            Anchor::End => -wide,
        };
        let mut outline = Outline { builder: PathBuilder::new(), along: 0.0, scale: text.size / font::em() };
        for character in text.words.chars() {
            let glyph = font::glyph(character);
            outline.along = along;
            font::face().outline_glyph(glyph, &mut outline);
            along += text.size * font::advance(glyph);
        }
        let Some(path) = outline.builder.finish() else { return };
        let (x, y, scale) = ((text.at.0 * self.scale) as f32, (text.at.1 * self.scale) as f32, self.scale as f32);
        let transform = match text.upwards {
            false => Transform::from_row(scale, 0.0, 0.0, scale, x, y),
            true => Transform::from_row(0.0, -scale, scale, 0.0, x, y),
        };
        self.fill(&path, text.colour, 1.0, transform);
    }

    fn picture(&mut self, (x, y): At, (width, height): (f64, f64), picture: &Picture) {
        let Some(mut pixels) = Pixmap::new(picture.width, picture.height) else { return };
        for (pixel, rgb) in pixels.pixels_mut().iter_mut().zip(picture.rgb.chunks_exact(3)) {
            *pixel = PremultipliedColorU8::from_rgba(rgb[0], rgb[1], rgb[2], 255).expect("it is opaque");
        }
        let (across, down) = (width / f64::from(picture.width), height / f64::from(picture.height));
        let scale = self.scale;
        let row = [across * scale, down * scale, x * scale, y * scale].map(|of| of as f32);
        let transform = Transform::from_row(row[0], 0.0, 0.0, row[1], row[2], row[3]);
        let quality = FilterQuality::Bilinear;
        let paint = PixmapPaint { quality, ..PixmapPaint::default() };
        self.canvas.draw_pixmap(0, 0, pixels.as_ref(), &paint, transform, self.mask.as_ref());
    }
}

fn paint(colour: Colour, opacity: f64) -> Paint<'static> {
    let [red, green, blue] = colour;
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(red, green, blue, (opacity.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

fn path(points: &[At], is_closed: bool) -> Option<tiny_skia::Path> {
    let mut builder = PathBuilder::new();
    for (place, (x, y)) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if place == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if is_closed {
        builder.close();
    }
    builder.finish()
}

/// A glyph's outline, from units of the em with y upwards to points with y downwards.
struct Outline {
    builder: PathBuilder,
    along: f64,
    scale: f64,
}

impl Outline {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        ((self.along + f64::from(x) * self.scale) as f32, (-f64::from(y) * self.scale) as f32)
    }
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.builder.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}
