//! A drawing as pixels.

use tiny_skia::{
    Color, FillRule, FilterQuality, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, PixmapPaint,
    PremultipliedColorU8, Rect, Stroke as Line, StrokeDash, Transform,
};
use ttf_parser::OutlineBuilder;

use super::{At, Colour, Drawing, MM_PER_INCH, Mark, POINTS_PER_INCH, Picture, Text, font};

/// The most pixels per side.
const MAX_SIDE: f64 = 20_000.0;

pub(super) fn written(drawing: &Drawing, dpi: f64) -> Result<Vec<u8>, String> {
    let scale = dpi / POINTS_PER_INCH;
    let sides = [drawing.width_pt, drawing.height_pt].map(|side| (side * scale).round());
    let fits = sides.iter().all(|side| (1.0..=MAX_SIDE).contains(side));
    let Some(mut canvas) = fits.then(|| Pixmap::new(sides[0] as u32, sides[1] as u32)).flatten() else {
        return Err(format!("a picture of {} x {} pixels is too large", sides[0], sides[1]));
    };
    canvas.fill(Color::WHITE);
    let (transform, mut mask) = (Transform::from_scale(scale as f32, scale as f32), None);
    for mark in &drawing.marks {
        let mut fill = |path: Option<Path>, colour: Colour, opacity: f64, transform: Transform| {
            let Some(path) = path else { return };
            canvas.fill_path(&path, &paint(colour, opacity), FillRule::Winding, transform, mask.as_ref());
        };
        match mark {
            Mark::Line { points, stroke } => {
                let Some(path) = path(points).finish() else { continue };
                let dash = StrokeDash::new(stroke.dashes.iter().map(|dash| *dash as f32).collect(), 0.0);
                let line = Line { width: stroke.width as f32, line_join: LineJoin::Round, dash, ..Line::default() };
                canvas.stroke_path(&path, &paint(stroke.colour, stroke.opacity), &line, transform, mask.as_ref());
            }
            Mark::Area { points, fill: area } => {
                let mut path = path(points);
                path.close();
                fill(path.finish(), area.colour, area.opacity, transform);
            }
            Mark::Dot { at, radius, fill: dot } => {
                let circle = PathBuilder::from_circle(at.0 as f32, at.1 as f32, *radius as f32);
                fill(circle, dot.colour, dot.opacity, transform);
            }
            Mark::Text(text) => fill(outline(text), text.colour, 1.0, transform),
            Mark::Picture { at, size, picture } => {
                let Some(pixels) = pixmap(picture) else { continue };
                let transform = transform.pre_translate(at.0 as f32, at.1 as f32);
                let across = size.0 / f64::from(picture.width);
                let transform = transform.pre_scale(across as f32, (size.1 / f64::from(picture.height)) as f32);
                let paint = PixmapPaint { quality: FilterQuality::Bilinear, ..PixmapPaint::default() };
                canvas.draw_pixmap(0, 0, pixels.as_ref(), &paint, transform, mask.as_ref());
            }
            Mark::Clip { at, size } => {
                let rect = Rect::from_xywh(at.0 as f32, at.1 as f32, size.0 as f32, size.1 as f32);
                mask = rect.zip(Mask::new(canvas.width(), canvas.height())).map(|(rect, mut mask)| {
                    mask.fill_path(&PathBuilder::from_rect(rect), FillRule::Winding, true, transform);
                    mask
                });
            }
            Mark::Unclip => mask = None,
        }
    }
    let rgb: Vec<u8> = canvas.pixels().iter().flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]).collect();
    Ok(encoded(canvas.width(), canvas.height(), &rgb, Some(dpi)))
}

/// Pixels as a PNG file; with `dpi` it says how large they are.
pub(crate) fn encoded(width: u32, height: u32, rgb: &[u8], dpi: Option<f64>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    encoder.set_pixel_dims(dpi.map(|dpi| {
        let per_metre = (dpi / MM_PER_INCH * 1000.0).round() as u32;
        png::PixelDimensions { xppu: per_metre, yppu: per_metre, unit: png::Unit::Meter }
    }));
    let mut writer = encoder.write_header().expect("memory takes a header");
    writer.write_image_data(rgb).expect("memory takes the announced rows");
    writer.finish().expect("memory takes an end");
    bytes
}

fn paint(colour: Colour, opacity: f64) -> Paint<'static> {
    let [red, green, blue] = colour;
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, (opacity.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

fn path(points: &[At]) -> PathBuilder {
    let mut builder = PathBuilder::new();
    for (place, (x, y)) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if place == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    builder
}

fn pixmap(picture: &Picture) -> Option<Pixmap> {
    let mut pixels = Pixmap::new(picture.width, picture.height)?;
    for (pixel, rgb) in pixels.pixels_mut().iter_mut().zip(picture.rgb.chunks_exact(3)) {
        *pixel = PremultipliedColorU8::from_rgba(rgb[0], rgb[1], rgb[2], 255)?;
    }
    Some(pixels)
}

/// The outlines of words, in points of the page.
fn outline(text: &Text) -> Option<Path> {
    let mut outline = Outline(PathBuilder::new(), -text.anchor.before() * font::width(&text.words, 1.0));
    for character in text.words.chars() {
        font::FACE.outline_glyph(font::glyph(character), &mut outline);
        outline.1 += font::advance(font::glyph(character));
    }
    let (x, y, size) = (text.at.0 as f32, text.at.1 as f32, text.size as f32);
    let transform = match text.upwards {
        false => Transform::from_row(size, 0.0, 0.0, size, x, y),
        true => Transform::from_row(0.0, -size, size, 0.0, x, y),
    };
    outline.0.finish()?.transform(transform)
}

/// Outlines, and how far along the line the next glyph is, in ems with y downwards.
struct Outline(PathBuilder, f64);

impl Outline {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        let em = f64::from(font::FACE.units_per_em());
        ((self.1 + f64::from(x) / em) as f32, (-f64::from(y) / em) as f32)
    }
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.0.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.0.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.0.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.0.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.0.close();
    }
}
