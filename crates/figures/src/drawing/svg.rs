//! A drawing as SVG.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;

use super::{Anchor, At, Colour, Drawing, MM_PER_INCH, Mark, POINTS_PER_INCH, Picture, font, number, png};
use crate::xml::escaped;

pub(super) fn written(drawing: &Drawing) -> String {
    let mm = |points: f64| number(points / POINTS_PER_INCH * MM_PER_INCH);
    let (width, height) = (drawing.width_pt, drawing.height_pt);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}mm\" height=\"{}mm\" viewBox=\"0 0 {} {}\" font-family=\"{}\">\n",
        mm(width),
        mm(height),
        number(width),
        number(height),
        font::FAMILY,
    );
    let _ = writeln!(svg, "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>");
    let mut clips = 0;
    for mark in &drawing.marks {
        write(&mut svg, mark, &mut clips);
    }
    svg.push_str("</svg>\n");
    svg
}

fn write(svg: &mut String, mark: &Mark, clips: &mut usize) {
    // Writing to a text does not fail.
    let _ = match mark {
        Mark::Line { points, stroke } => {
            let _ = write!(
                svg,
                "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"",
                path(points),
                hex(stroke.colour),
                number(stroke.width)
            );
            opacity(svg, "stroke-opacity", stroke.opacity);
            if !stroke.dashes.is_empty() {
                let dashes: Vec<String> = stroke.dashes.iter().map(|dash| number(*dash)).collect();
                let _ = write!(svg, " stroke-dasharray=\"{}\"", dashes.join(" "));
            }
            writeln!(svg, "/>")
        }
        Mark::Area { points, fill } => {
            let _ = write!(svg, "<path d=\"{}Z\" fill=\"{}\"", path(points), hex(fill.colour));
            opacity(svg, "fill-opacity", fill.opacity);
            writeln!(svg, "/>")
        }
        Mark::Dot { at, radius, fill } => {
            let (x, y) = (number(at.0), number(at.1));
            let _ =
                write!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\" fill=\"{}\"", number(*radius), hex(fill.colour));
            opacity(svg, "fill-opacity", fill.opacity);
            writeln!(svg, "/>")
        }
        Mark::Text(text) => {
            let (x, y) = (number(text.at.0), number(text.at.1));
            let _ = write!(svg, "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\"", number(text.size));
            if text.colour != super::BLACK {
                let _ = write!(svg, " fill=\"{}\"", hex(text.colour));
            }
            match text.anchor {
                Anchor::Start => {}
                Anchor::Middle => svg.push_str(" text-anchor=\"middle\""),
                Anchor::End => svg.push_str(" text-anchor=\"end\""),
            }
            if text.upwards {
                let _ = write!(svg, " transform=\"rotate(-90 {x} {y})\"");
            }
            writeln!(svg, ">{}</text>", escaped(&text.words))
        }
        Mark::Picture { at, size, picture } => writeln!(
            svg,
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" href=\"data:image/png;base64,{}\"/>",
            number(at.0),
            number(at.1),
            number(size.0),
            number(size.1),
            BASE64_STANDARD.encode(encoded(picture)),
        ),
        Mark::Clip { at, size } => {
            *clips += 1;
            writeln!(
                svg,
                "<clipPath id=\"clip-{clips}\"><rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></clipPath><g clip-path=\"url(#clip-{clips})\">",
                number(at.0),
                number(at.1),
                number(size.0),
                number(size.1)
            )
        }
        Mark::Unclip => writeln!(svg, "</g>"),
    };
}

fn opacity(svg: &mut String, name: &str, opacity: f64) {
    if opacity < 1.0 {
        let _ = write!(svg, " {name}=\"{}\"", number(opacity));
    }
}

fn path(points: &[At]) -> String {
    let mut path = String::new();
    for (place, (x, y)) in points.iter().enumerate() {
        let _ = write!(path, "{}{} {}", if place == 0 { 'M' } else { 'L' }, number(*x), number(*y));
    }
    path
}

fn hex([red, green, blue]: Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn encoded(picture: &Picture) -> Vec<u8> {
    png::encoded(picture.width, picture.height, &picture.rgb, None)
}
