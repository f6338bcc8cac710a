//! The one font of all figures: the part of DejaVu Sans that figures need (`crates/figures/fonts`, with its licence).

use std::sync::LazyLock;

use ttf_parser::{Face, GlyphId};

/// The font's file.
pub(super) const BYTES: &[u8] = include_bytes!("../../fonts/dejavu-sans-subset.ttf");
/// Its name in SVG, with fonts of similar widths for machines without it.
pub(super) const FAMILY: &str = "DejaVu Sans, Verdana, sans-serif";

/// The parsed font.
pub(super) static FACE: LazyLock<Face<'static>> =
    LazyLock::new(|| Face::parse(BYTES, 0).expect("the program carries a font"));

/// The glyph of a character; an empty box if the font does not have it.
pub(super) fn glyph(character: char) -> GlyphId {
    FACE.glyph_index(character).unwrap_or(GlyphId(0))
}

/// The width of a glyph, in units of the em.
pub(super) fn advance(glyph: GlyphId) -> f64 {
    f64::from(FACE.glyph_hor_advance(glyph).unwrap_or(0)) / f64::from(FACE.units_per_em())
}

/// The width of words.
pub(crate) fn width(words: &str, size: f64) -> f64 {
    size * words.chars().map(|character| advance(glyph(character))).sum::<f64>()
}

/// The height of digits and capitals.
pub(crate) fn ascent(size: f64) -> f64 {
    size * f64::from(FACE.capital_height().unwrap_or(1493)) / f64::from(FACE.units_per_em())
}
