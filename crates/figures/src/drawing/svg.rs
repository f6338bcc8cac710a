//! A drawing as SVG.

use std::fmt::{self, Display, Formatter};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use super::{At, BLACK, Colour, Drawing, Mark, font, png};
use crate::xml::escaped;

pub(super) fn written(drawing: &Drawing) -> String {
    let ((width, height), (width_mm, height_mm)) = ((drawing.width_pt, drawing.height_pt), drawing.size_mm());
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width_mm}mm\" height=\"{height_mm}mm\" viewBox=\"0 0 {} {}\" font-family=\"{}\">\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n",
        Number(width),
        Number(height),
        font::FAMILY,
    );
    for (place, mark) in drawing.marks.iter().enumerate() {
        svg.push_str(&element(mark, place));
        svg.push('\n');
    }
    svg + "</svg>\n"
}

fn element(mark: &Mark, place: usize) -> String {
    match mark {
        Mark::Line { points, stroke } => {
            let dashes: Vec<String> = stroke.dashes.iter().map(|dash| Number(*dash).to_string()).collect();
            let dashes = if dashes.is_empty() { "none".to_owned() } else { dashes.join(" ") };
            let (path, colour, width, opacity) =
                (path(points), Hex(stroke.colour), Number(stroke.width), Number(stroke.opacity));
            format!(
                "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-opacity=\"{opacity}\" stroke-dasharray=\"{dashes}\" stroke-linejoin=\"round\"/>"
            )
        }
        Mark::Area { points, fill } => {
            let (path, colour, opacity) = (path(points), Hex(fill.colour), Number(fill.opacity));
            format!("<path d=\"{path}Z\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>")
        }
        Mark::Dot { at, radius, fill } => {
            let [x, y, radius, opacity] = [at.0, at.1, *radius, fill.opacity].map(Number);
            let colour = Hex(fill.colour);
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>")
        }
        Mark::Text(text) => {
            let [x, y, size] = [text.at.0, text.at.1, text.size].map(Number);
            let anchor = format!("{:?}", text.anchor).to_lowercase();
            let colour = if text.colour == BLACK { String::new() } else { format!(" fill=\"{}\"", Hex(text.colour)) };
            let turn = if text.upwards { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
            let words = escaped(&text.words);
            format!(
                "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{colour}{turn}>{words}</text>"
            )
        }
        Mark::Picture { at, size, picture } => {
            let png = BASE64_STANDARD.encode(png::encoded(picture.width, picture.height, &picture.rgb, None));
            format!("<image {} preserveAspectRatio=\"none\" href=\"data:image/png;base64,{png}\"/>", sides(*at, *size))
        }
        Mark::Clip { at, size } => format!(
            "<clipPath id=\"clip-{place}\"><rect {}/></clipPath><g clip-path=\"url(#clip-{place})\">",
            sides(*at, *size)
        ),
        Mark::Unclip => "</g>".to_owned(),
    }
}

fn sides(at: At, size: (f64, f64)) -> String {
    let [x, y, width, height] = [at.0, at.1, size.0, size.1].map(Number);
    format!("x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"")
}

fn path(points: &[At]) -> String {
    let points: Vec<String> = points.iter().map(|(x, y)| format!("{} {}", Number(*x), Number(*y))).collect();
    format!("M{}", points.join("L"))
}

/// A number with three decimals at most; never `-0`.
#[derive(Clone, Copy)]
struct Number(f64);

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}", (self.0 * 1000.0).round() / 1000.0 + 0.0)
    }
}

struct Hex(Colour);

impl Display for Hex {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self([red, green, blue]) = self;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}
