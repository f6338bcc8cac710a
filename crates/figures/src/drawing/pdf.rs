//! A drawing as PDF of one page: paths are paths, and words are words.

use std::collections::BTreeMap;

use miniz_oxide::deflate::compress_to_vec_zlib;
use pdf_writer::types::{CidFontType, FontFlags, LineJoinStyle, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish as _, Name, Pdf, Rect, Ref, Str, TextStr};

use super::{Anchor, At, Colour, Drawing, Mark, Picture, Text, circle, font};

const CATALOGUE: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const CONTENT: Ref = Ref::new(4);
const INFO: Ref = Ref::new(5);
const FONT: Ref = Ref::new(6);
const CID_FONT: Ref = Ref::new(7);
const DESCRIPTOR: Ref = Ref::new(8);
const FONT_FILE: Ref = Ref::new(9);
const TO_UNICODE: Ref = Ref::new(10);
/// From here on opacities, then pictures.
const REST: i32 = 11;

const FONT_NAME: Name<'static> = Name(b"F");
/// As a subset is called: six letters before.
const BASE_FONT: Name<'static> = Name(b"DPTHLM+DejaVuSans");
/// The thousandths of an em that PDF counts widths in.
const WIDTHS: f64 = 1000.0;
const COMPRESSION: u8 = 6;

pub(super) fn written(drawing: &Drawing, title: &str) -> Vec<u8> {
    let mut page = Page {
        content: Content::new(),
        height: drawing.height_pt,
        opacities: Vec::new(),
        pictures: Vec::new(),
        glyphs: BTreeMap::new(),
    };
    drawing.marks.iter().for_each(|mark| page.draw(mark));
    let Page { content, opacities, pictures, glyphs, .. } = page;
    let reference = |place: usize| Ref::new(REST + place as i32);

    let mut pdf = Pdf::new();
    pdf.catalog(CATALOGUE).pages(PAGES);
    pdf.pages(PAGES).kids([PAGE]).count(1);
    pdf.document_info(INFO).title(TextStr(title)).creator(TextStr("depthloom"));
    let mut of_page = pdf.page(PAGE);
    of_page.parent(PAGES).contents(CONTENT);
    of_page.media_box(Rect::new(0.0, 0.0, drawing.width_pt as f32, drawing.height_pt as f32));
    let mut resources = of_page.resources();
    resources.fonts().pair(FONT_NAME, FONT);
    if !opacities.is_empty() {
        let mut states = resources.ext_g_states();
        for (place, opacity) in opacities.iter().enumerate() {
            states.pair(Name(named("G", *opacity as usize).as_bytes()), reference(place));
        }
    }
    if !pictures.is_empty() {
        let mut objects = resources.x_objects();
        for place in 0..pictures.len() {
            objects.pair(Name(named("P", place).as_bytes()), reference(opacities.len() + place));
        }
    }
    resources.finish();
    of_page.finish();
    for (place, opacity) in opacities.iter().enumerate() {
        let share = f32::from(*opacity) / 1000.0;
        pdf.ext_graphics(reference(place)).non_stroking_alpha(share).stroking_alpha(share);
    }
    for (place, picture) in pictures.iter().enumerate() {
        let packed = compress_to_vec_zlib(&picture.rgb, COMPRESSION);
        let mut image = pdf.image_xobject(reference(opacities.len() + place), &packed);
        image.filter(Filter::FlateDecode);
        image.width(picture.width as i32).height(picture.height as i32).bits_per_component(8);
        image.color_space().device_rgb();
    }
    let packed = compress_to_vec_zlib(&content.finish(), COMPRESSION);
    pdf.stream(CONTENT, &packed).filter(Filter::FlateDecode);
    write_font(&mut pdf, &glyphs);
    pdf.finish()
}

/// The font with all its glyphs, and which characters those that are there stand for.
fn write_font(pdf: &mut Pdf, glyphs: &BTreeMap<u16, char>) {
    let face = font::face();
    let thousandths = |units: i16| (f64::from(units) / font::em() * WIDTHS) as f32;
    let system = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };
    let mut of_all = pdf.type0_font(FONT);
    of_all.base_font(BASE_FONT).encoding_predefined(Name(b"Identity-H"));
    of_all.descendant_font(CID_FONT).to_unicode(TO_UNICODE);
    of_all.finish();
    let mut cid_font = pdf.cid_font(CID_FONT);
    cid_font.subtype(CidFontType::Type2).base_font(BASE_FONT).system_info(system);
    cid_font.font_descriptor(DESCRIPTOR).default_width(0.0).cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = cid_font.widths();
    for glyph in glyphs.keys() {
        widths.same(*glyph, *glyph, (font::advance(ttf_parser::GlyphId(*glyph)) * WIDTHS) as f32);
    }
    widths.finish();
    cid_font.finish();
    let bounds = face.global_bounding_box();
    let bounds = [bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max].map(thousandths);
    pdf.font_descriptor(DESCRIPTOR)
        .name(BASE_FONT)
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(Rect::new(bounds[0], bounds[1], bounds[2], bounds[3]))
        .italic_angle(0.0)
        .ascent(thousandths(face.ascender()))
        .descent(thousandths(face.descender()))
        .cap_height(thousandths(face.capital_height().unwrap_or(face.ascender())))
        .stem_v(80.0)
        .font_file2(FONT_FILE);
    let packed = compress_to_vec_zlib(font::BYTES, COMPRESSION);
    let mut file = pdf.stream(FONT_FILE, &packed);
    file.filter(Filter::FlateDecode).pair(Name(b"Length1"), font::BYTES.len() as i32);
    file.finish();
    let mut map = UnicodeCmap::new(Name(b"DepthloomUnicode"), system);
    glyphs.iter().for_each(|(glyph, character)| map.pair(*glyph, *character));
    let map = map.finish();
    pdf.cmap(TO_UNICODE, &map).finish();
}

fn named(what: &str, number: usize) -> String {
    format!("{what}{number}")
}

/// What the page's content is made of.
struct Page {
    content: Content,
    height: f64,
    /// The opacities that are used, thousandths.
    opacities: Vec<u16>,
    pictures: Vec<Picture>,
    /// The glyphs that are used, and a character that each is of.
    glyphs: BTreeMap<u16, char>,
}

impl Page {
    /// PDF counts from the lower left corner.
    fn at(&self, (x, y): At) -> (f32, f32) {
        (x as f32, (self.height - y) as f32)
    }

    fn draw(&mut self, mark: &Mark) {
        match mark {
            Mark::Line { points, stroke } => {
                self.content.save_state();
                self.opacity(stroke.opacity);
                let [red, green, blue] = shares(stroke.colour);
                self.content.set_stroke_rgb(red, green, blue);
                self.content.set_line_width(stroke.width as f32).set_line_join(LineJoinStyle::RoundJoin);
                if !stroke.dashes.is_empty() {
                    self.content.set_dash_pattern(stroke.dashes.iter().map(|dash| *dash as f32), 0.0);
                }
                self.path(points);
                self.content.stroke();
                self.content.restore_state();
            }
            Mark::Area { points, fill } => {
                self.content.save_state();
                self.opacity(fill.opacity);
                let [red, green, blue] = shares(fill.colour);
                self.content.set_fill_rgb(red, green, blue);
                self.path(points);
                self.content.close_path().fill_nonzero();
                self.content.restore_state();
            }
            Mark::Dot { at, radius, fill } => {
                self.content.save_state();
                self.opacity(fill.opacity);
                let [red, green, blue] = shares(fill.colour);
                self.content.set_fill_rgb(red, green, blue);
                let (start, curves) = circle(*at, *radius);
                let (x, y) = self.at(start);
                self.content.move_to(x, y);
                for curve in curves {
                    let [(ax, ay), (bx, by), (x, y)] = curve.map(|point| self.at(point));
                    self.content.cubic_to(ax, ay, bx, by, x, y);
                }
                self.content.close_path().fill_nonzero();
                self.content.restore_state();
            }
            Mark::Text(text) => self.text(text),
            Mark::Picture { at, size, picture } => {
                self.content.save_state();
                let (x, y) = self.at((at.0, at.1 + size.1));
                self.content.transform([size.0 as f32, 0.0, 0.0, size.1 as f32, x, y]);
                self.content.x_object(Name(named("P", self.pictures.len()).as_bytes()));
                self.content.restore_state();
                self.pictures.push(picture.clone());
            }
            Mark::Clip { at, size } => {
                self.content.save_state();
                let (x, y) = self.at((at.0, at.1 + size.1));
                self.content.rect(x, y, size.0 as f32, size.1 as f32).clip_nonzero().end_path();
            }
            Mark::Unclip => {
                self.content.restore_state();
            }
        }
    }

    fn path(&mut self, points: &[At]) {
        for (place, point) in points.iter().enumerate() {
            let (x, y) = self.at(*point);
            if place == 0 {
                self.content.move_to(x, y)
            } else {
                self.content.line_to(x, y)
            };
        }
    }

    fn opacity(&mut self, opacity: f64) {
        let thousandths = (opacity.clamp(0.0, 1.0) * 1000.0).round() as u16;
        if thousandths == 1000 {
            return;
        }
        if !self.opacities.contains(&thousandths) {
            self.opacities.push(thousandths);
        }
        self.content.set_parameters(Name(named("G", usize::from(thousandths)).as_bytes()));
    }

    fn text(&mut self, text: &Text) {
        let back = match text.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => font::width(&text.words, text.size) / 2.0,
            Anchor::End => font::width(&text.words, text.size),
        };
        let at = if text.upwards { (text.at.0, text.at.1 + back) } else { (text.at.0 - back, text.at.1) };
        let (x, y) = self.at(at);
        let mut glyphs = Vec::with_capacity(2 * text.words.len());
        for character in text.words.chars() {
            let glyph = font::glyph(character).0;
            self.glyphs.entry(glyph).or_insert(character);
            glyphs.extend(glyph.to_be_bytes());
        }
        let [red, green, blue] = shares(text.colour);
        self.content.begin_text().set_font(FONT_NAME, text.size as f32).set_fill_rgb(red, green, blue);
        let matrix = if text.upwards { [0.0, 1.0, -1.0, 0.0, x, y] } else { [1.0, 0.0, 0.0, 1.0, x, y] };
        self.content.set_text_matrix(matrix).show(Str(&glyphs)).end_text();
    }
}

fn shares(colour: Colour) -> [f32; 3] {
    colour.map(|part| f32::from(part) / 255.0)
}
