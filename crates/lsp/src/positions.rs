//! Positions of the protocol (line, UTF-16 units) and byte offsets of a text.

use std::ops::Range as Span;

use gen_lsp_types::{Position, Range};

/// The offsets at which lines begin. Lines end with `\n`, `\r\n` or `\r`.
fn line_starts(text: &str) -> impl Iterator<Item = usize> {
    let bytes = text.as_bytes();
    let ends = (0..bytes.len())
        .filter(move |&at| bytes[at] == b'\n' || (bytes[at] == b'\r' && bytes.get(at + 1) != Some(&b'\n')));
    std::iter::once(0).chain(ends.map(|at| at + 1))
}

/// The line that begins at an offset, without its end.
fn line_at(text: &str, start: usize) -> &str {
    let rest = &text[start..];
    rest.find(['\n', '\r']).map_or(rest, |end| &rest[..end])
}

/// The byte offset of a position; the end of the line or of the text if the position is beyond it.
pub(crate) fn offset(text: &str, position: Position) -> usize {
    let Some(start) = line_starts(text).nth(position.line as usize) else { return text.len() };
    let line = line_at(text, start);
    let mut units = 0;
    for (at, character) in line.char_indices() {
        if units >= position.character as usize {
            return start + at;
        }
        units += character.len_utf16();
    }
    start + line.len()
}

/// The position of a byte offset.
pub(crate) fn position(text: &str, offset: usize) -> Position {
    let offset = text.floor_char_boundary(offset);
    let (line, start) = line_starts(text).take_while(|start| *start <= offset).enumerate().last().unwrap_or_default();
    let units = text[start..offset].encode_utf16().count();
    Position { line: u32::try_from(line).unwrap_or(u32::MAX), character: u32::try_from(units).unwrap_or(u32::MAX) }
}

/// The range of a stretch of bytes.
pub(crate) fn range(text: &str, span: &Span<usize>) -> Range {
    Range { start: position(text, span.start), end: position(text, span.end.max(span.start)) }
}

/// The byte offsets of a range.
pub(crate) fn span(text: &str, range: Range) -> Span<usize> {
    let start = offset(text, range.start);
    start..offset(text, range.end).max(start)
}

#[cfg(test)]
mod tests {
    use gen_lsp_types::Position;

    use super::{offset, position};

    #[test]
    fn columns_are_utf_16_units() {
        // `ä` has 2 bytes and 1 unit, `𝄞` 4 bytes and 2 units.
        let text = "a: ä𝄞b\r\nc: d\n";
        let at = |line, character| Position { line, character };
        for (bytes, line, character) in [(0, 0, 0), (3, 0, 3), (5, 0, 4), (9, 0, 6), (10, 0, 7), (12, 1, 0), (17, 2, 0)]
        {
            assert_eq!(position(text, bytes), at(line, character), "byte {bytes}");
            assert_eq!(offset(text, at(line, character)), bytes, "{line}:{character}");
        }
    }

    #[test]
    fn positions_beyond_the_text_are_its_end() {
        let text = "ab\ncd";
        let at = |line, character| offset(text, Position { line, character });
        assert_eq!([at(0, 9), at(1, 9), at(7, 0)], [2, 5, 5]);
        assert_eq!(offset("𝄞b", Position { line: 0, character: 1 }), 4, "within a pair of units: after it");
    }
}
