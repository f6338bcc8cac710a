//! A drawing as PDF of one page: paths are paths, and words are words.

use std::collections::BTreeMap;

use miniz_oxide::deflate::compress_to_vec_zlib;
use pdf_writer::types::{CidFontType, FontFlags, LineCapStyle, LineJoinStyle, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish as _, Name, Pdf, Rect, Ref, Str, TextStr};
use ttf_parser::GlyphId;

use super::{At, Colour, Drawing, Mark, Text, font};

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
/// The first reference of opacities and pictures.
const OTHERS: i32 = 11;

const FONT_NAME: Name<'static> = Name(b"F");
/// The name of a subset: six letters before that of the font.
const BASE_FONT: Name<'static> = Name(b"DPTHLM+DejaVuSans");
const COMPRESSION: u8 = 6;

pub(super) fn written(drawing: &Drawing, title: &str) -> Vec<u8> {
    let mut page = Page {
        pdf: Pdf::new(),
        content: Content::new(),
        height: drawing.height_pt,
        opacities: BTreeMap::new(),
        pictures: Vec::new(),
        glyphs: BTreeMap::new(),
    };
    drawing.marks.iter().for_each(|mark| page.draw(mark));
    let Page { mut pdf, content, opacities, pictures, glyphs, .. } = page;
    pdf.catalog(CATALOGUE).pages(PAGES);
    pdf.pages(PAGES).kids([PAGE]).count(1);
    pdf.document_info(INFO).title(TextStr(title)).creator(TextStr("depthloom"));
    let mut dictionary = pdf.page(PAGE);
    dictionary.parent(PAGES).contents(CONTENT);
    dictionary.media_box(Rect::new(0.0, 0.0, drawing.width_pt as f32, drawing.height_pt as f32));
    let mut resources = dictionary.resources();
    resources.fonts().pair(FONT_NAME, FONT);
    let mut states = resources.ext_g_states();
    opacities.values().for_each(|state| _ = states.pair(Name(name(*state).as_bytes()), *state));
    states.finish();
    let mut objects = resources.x_objects();
    pictures.iter().for_each(|picture| _ = objects.pair(Name(name(*picture).as_bytes()), *picture));
    objects.finish();
    resources.finish();
    dictionary.finish();
    let packed = compress_to_vec_zlib(&content.finish(), COMPRESSION);
    pdf.stream(CONTENT, &packed).filter(Filter::FlateDecode);
    write_font(&mut pdf, &glyphs);
    pdf.finish()
}

/// The name of an opacity or a picture in the content.
fn name(reference: Ref) -> String {
    format!("R{}", reference.get())
}

/// The font with all its glyphs, and the characters of those that are used.
fn write_font(pdf: &mut Pdf, glyphs: &BTreeMap<u16, char>) {
    let face = &font::FACE;
    let thousandths = |units: i16| f32::from(units) / f32::from(face.units_per_em()) * 1000.0;
    let system = SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };
    let mut type0 = pdf.type0_font(FONT);
    type0.base_font(BASE_FONT).encoding_predefined(Name(b"Identity-H"));
    type0.descendant_font(CID_FONT).to_unicode(TO_UNICODE);
    type0.finish();
    let mut cid_font = pdf.cid_font(CID_FONT);
    cid_font.subtype(CidFontType::Type2).base_font(BASE_FONT).system_info(system);
    cid_font.font_descriptor(DESCRIPTOR).default_width(0.0).cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = cid_font.widths();
    for glyph in glyphs.keys() {
        widths.same(*glyph, *glyph, (font::advance(GlyphId(*glyph)) * 1000.0) as f32);
    }
    widths.finish();
    cid_font.finish();
    let bounds = face.global_bounding_box();
    let [left, bottom, right, top] = [bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max].map(thousandths);
    pdf.font_descriptor(DESCRIPTOR)
        .name(BASE_FONT)
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(Rect::new(left, bottom, right, top))
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
    pdf.cmap(TO_UNICODE, &map.finish());
}

/// The page while it is drawn.
struct Page {
    pdf: Pdf,
    content: Content,
    height: f64,
    /// The opacities that are used, in thousandths.
    opacities: BTreeMap<u16, Ref>,
    pictures: Vec<Ref>,
    /// The glyphs that are used, each with a character.
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
                self.begin(stroke.colour, stroke.opacity);
                self.content.set_line_width(stroke.width as f32).set_line_join(LineJoinStyle::RoundJoin);
                self.content.set_dash_pattern(stroke.dashes.iter().map(|dash| *dash as f32), 0.0);
                self.path(points).stroke().restore_state();
            }
            Mark::Area { points, fill } => {
                self.begin(fill.colour, fill.opacity);
                self.path(points).close_path().fill_nonzero().restore_state();
            }
            Mark::Dot { at, radius, fill } => {
                // A line without length has round ends all the same.
                self.begin(fill.colour, fill.opacity);
                self.content.set_line_width(2.0 * *radius as f32).set_line_cap(LineCapStyle::RoundCap);
                self.path(&[*at, *at]).stroke().restore_state();
            }
            Mark::Text(text) => self.text(text),
            Mark::Picture { at, size, picture } => {
                let reference = self.next();
                let packed = compress_to_vec_zlib(&picture.rgb, COMPRESSION);
                let mut image = self.pdf.image_xobject(reference, &packed);
                image.filter(Filter::FlateDecode);
                image.width(picture.width as i32).height(picture.height as i32).bits_per_component(8);
                image.color_space().device_rgb();
                image.finish();
                self.pictures.push(reference);
                let (x, y) = self.at((at.0, at.1 + size.1));
                self.content.save_state().transform([size.0 as f32, 0.0, 0.0, size.1 as f32, x, y]);
                self.content.x_object(Name(name(reference).as_bytes())).restore_state();
            }
            Mark::Clip { at, size } => {
                let (x, y) = self.at((at.0, at.1 + size.1));
                self.content.save_state().rect(x, y, size.0 as f32, size.1 as f32).clip_nonzero().end_path();
            }
            Mark::Unclip => _ = self.content.restore_state(),
        }
    }

    fn next(&self) -> Ref {
        Ref::new(OTHERS + (self.opacities.len() + self.pictures.len()) as i32)
    }

    /// A state of its own.
    fn begin(&mut self, colour: Colour, opacity: f64) {
        self.content.save_state();
        let thousandths = (opacity.clamp(0.0, 1.0) * 1000.0).round() as u16;
        if thousandths < 1000 {
            let (reference, share) = (self.next(), f32::from(thousandths) / 1000.0);
            let state = *self.opacities.entry(thousandths).or_insert_with(|| {
                self.pdf.ext_graphics(reference).non_stroking_alpha(share).stroking_alpha(share);
                reference
            });
            self.content.set_parameters(Name(name(state).as_bytes()));
        }
        let [red, green, blue] = shares(colour);
        self.content.set_stroke_rgb(red, green, blue).set_fill_rgb(red, green, blue);
    }

    fn path(&mut self, points: &[At]) -> &mut Content {
        for (place, point) in points.iter().enumerate() {
            let (x, y) = self.at(*point);
            _ = if place == 0 { self.content.move_to(x, y) } else { self.content.line_to(x, y) };
        }
        &mut self.content
    }

    fn text(&mut self, text: &Text) {
        let back = text.anchor.before() * font::width(&text.words, text.size);
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
