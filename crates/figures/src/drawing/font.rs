//! The one font of all figures: DejaVu Sans, as far as figures need it (`crates/figures/fonts`, with its licence).

use std::sync::OnceLock;

use ttf_parser::{Face, GlyphId};

/// The font's file.
pub(super) const BYTES: &[u8] = include_bytes!("../../fonts/dejavu-sans-subset.ttf");
/// What SVG calls it, and what stands in for it where it is not there: of about its widths.
pub(super) const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// The font, read.
pub(super) fn face() -> &'static Face<'static> {
    static FACE: OnceLock<Face<'static>> = OnceLock::new();
    FACE.get_or_init(|| Face::parse(BYTES, 0).expect("the program carries a font"))
}

/// The glyph of a character; that of an empty box where the font has none.
pub(super) fn glyph(character: char) -> GlyphId {
    face().glyph_index(character).unwrap_or(GlyphId(0))
}

/// How far a glyph moves on, in units of the em.
pub(super) fn advance(glyph: GlyphId) -> f64 {
    f64::from(face().glyph_hor_advance(glyph).unwrap_or(0)) / em()
}

/// Units of an em.
pub(super) fn em() -> f64 {
    f64::from(face().units_per_em())
}

/// How wide words are.
pub fn width(words: &str, size: f64) -> f64 {
    size * words.chars().map(|character| advance(glyph(character))).sum::<f64>()
}

/// How high digits and capitals are.
pub fn ascent(size: f64) -> f64 {
    size * face().capital_height().map_or(0.73, |height| f64::from(height) / em())
}
