//! Text of strangers as a terminal may be given it.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Whether a terminal or a reader would interpret a character instead of showing it: control characters (escape
/// sequences begin with one), and those that change the direction of what is around them or end a line.
const fn is_obeyed(c: char) -> bool {
    matches!(
        c,
        '\0'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    )
}

/// A text in which no character is obeyed by a terminal except tabs and line ends: others are written as Rust does,
/// `\u{1b}`.
pub fn visible(text: &str) -> Cow<'_, str> {
    replaced(text, |c| is_obeyed(c) && !matches!(c, '\n' | '\t'), |out, c| out.extend(c.escape_default()))
}

/// The same on one line: what a person is shown as one thing cannot look like several.
pub fn on_one_line(text: &str) -> Cow<'_, str> {
    replaced(text, is_obeyed, |out, c| out.extend(c.escape_default()))
}

/// JSON with those characters escaped as JSON does it; serde_json escapes the first 32 alone.
pub(super) fn in_quotes(json: &str) -> Cow<'_, str> {
    replaced(
        json,
        |c| is_obeyed(c) && !matches!(c, '\n' | '\t'),
        |out, c| {
            let _ = write!(out, "\\u{:04x}", u32::from(c));
        },
    )
}

/// A text of the same length in which no character is obeyed except line ends: for a file's text that places point
/// into.
pub fn same_length(text: &str) -> Cow<'_, str> {
    let is_other = |c| is_obeyed(c) && !matches!(c, '\n' | '\t');
    replaced(text, is_other, |out, c| {
        out.push(match (c, c.len_utf8()) {
            ('\r', _) => ' ',
            (_, 1) => '?',
            (_, 2) => '\u{bf}',
            _ => '\u{fffd}',
        });
    })
}

fn replaced(text: &str, is: impl Fn(char) -> bool, put: impl Fn(&mut String, char)) -> Cow<'_, str> {
    if !text.contains(&is) {
        return Cow::Borrowed(text);
    }
    let mut new = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is(c) { put(&mut new, c) } else { new.push(c) }
    }
    Cow::Owned(new)
}

#[cfg(test)]
mod tests {
    use super::{in_quotes, is_obeyed, on_one_line, same_length, visible};

    const HOSTILE: &str = "a\u{1b}]0;OWNED\u{7}\u{1b}[2K\rb\u{9b}31m \u{202e}c\u{2066}\t\u{8}\u{7f}\u{0}";

    #[test]
    fn nothing_is_left_that_a_terminal_obeys() {
        let harmless = "depth 3 m, größe, 深度, שלום, 👍🏽\n\ttab";
        assert_eq!(visible(harmless), harmless);
        for c in (0..=u32::from(char::MAX)).filter_map(char::from_u32) {
            let text = format!("x{c}y");
            let is_unchanged = matches!(c, '\n' | '\t') || !is_obeyed(c);
            assert_eq!(visible(&text) == text, is_unchanged, "{c:?}");
            assert!(!on_one_line(&text).contains(is_obeyed), "{c:?}");
            assert_eq!(same_length(&text).len(), text.len(), "{c:?}");
            assert!(!c.is_control() || is_obeyed(c), "{c:?}");
        }
        assert_eq!(
            visible(HOSTILE),
            "a\\u{1b}]0;OWNED\\u{7}\\u{1b}[2K\\rb\\u{9b}31m \\u{202e}c\\u{2066}\t\\u{8}\\u{7f}\\u{0}"
        );
        assert_eq!(on_one_line("a\nb\t"), "a\\nb\\t");
    }

    #[test]
    fn json_stays_the_same_value() {
        let value = serde_json::json!({ "name": HOSTILE, HOSTILE: [1, "x"] });
        let text = format!("{value:#}");
        let shown = in_quotes(&text);
        assert!(shown.chars().all(|c| c == '\n' || !is_obeyed(c)));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }
}
