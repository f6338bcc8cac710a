//! Where the cursor is: the keys that lead to it, and the word that is being typed.
//!
//! It reads the lines up to the cursor only, by indentation and brackets, so it also works in a text that is not YAML
//! yet.

use std::ops::Range;

/// Stands for an item of a list in [`Cursor::keys`].
pub(crate) const ITEM: &str = "-";

/// A place in a text as YAML sees it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cursor {
    /// The keys from the root; [`ITEM`] for an item of a list. Of a value, its own key is the last.
    pub(crate) keys: Vec<String>,
    /// Whether a key is expected; otherwise a value.
    pub(crate) is_key: bool,
    /// The word at the cursor, also the part after the cursor.
    pub(crate) word: Range<usize>,
    /// The text that closes all open quotes and brackets.
    pub(crate) closing: String,
}

impl Cursor {
    /// The keys as text.
    pub(crate) fn keys(&self) -> Vec<&str> {
        self.keys.iter().map(String::as_str).collect()
    }
}

struct Block {
    indent: usize,
    key: String,
}

enum Flow {
    Map(Option<String>),
    List,
}

#[derive(Default)]
struct Scanner {
    blocks: Vec<Block>,
    flows: Vec<Flow>,
    /// The indentation of the key whose text follows as a block of lines.
    text_block: Option<usize>,
    /// The start of the current word within the line, and its quote.
    word: Option<(usize, Option<char>)>,
    in_comment: bool,
    is_value: bool,
}

/// What is at an offset. `None` in a comment or in a block of text.
pub(crate) fn cursor(text: &str, offset: usize) -> Option<Cursor> {
    let offset = text.floor_char_boundary(offset);
    let mut scanner = Scanner::default();
    let mut start = 0;
    for line in text[..offset].split_inclusive('\n').filter(|line| line.ends_with('\n')) {
        scanner.line(line.trim_end_matches(['\n', '\r']), false);
        start += line.len();
    }
    let head = &text[start..offset];
    scanner.line(head, true);
    scanner.finish(text, start, head)
}

impl Scanner {
    fn line(&mut self, line: &str, is_last: bool) {
        (self.word, self.in_comment, self.is_value) = (None, false, false);
        let indent = line.len() - line.trim_start_matches(' ').len();
        let content = &line[indent..];
        if let Some(text_block) = self.text_block {
            if indent > text_block || (content.is_empty() && !is_last) {
                self.in_comment = is_last;
                return;
            }
            self.text_block = None;
        }
        if content.starts_with('#') {
            self.in_comment = true;
            return;
        }
        if content.is_empty() && !is_last {
            return;
        }
        // A bracket that was never closed: the next key of the block ends it.
        let outer = self.blocks.last().map_or(0, |block| block.indent);
        if !self.flows.is_empty() && !content.is_empty() && indent <= outer && key_end(content).is_some() {
            self.flows.clear();
        }
        if self.flows.is_empty() { self.block(line, indent) } else { self.flow(line, indent) }
    }

    fn block(&mut self, line: &str, mut at: usize) {
        while let Some(rest) = line[at..].strip_prefix('-').filter(|rest| rest.is_empty() || rest.starts_with(' ')) {
            self.blocks.retain(|block| block.indent < at || (block.indent == at && block.key != ITEM));
            self.blocks.push(Block { indent: at, key: ITEM.to_owned() });
            at += 1 + rest.len() - rest.trim_start_matches(' ').len();
        }
        let is_item = self.blocks.last().is_some_and(|block| block.key == ITEM && block.indent < at);
        if !is_item || at < line.len() {
            self.blocks.retain(|block| block.indent < at);
        }
        let rest = &line[at..];
        match key_end(rest) {
            Some((key, end)) => {
                self.blocks.push(Block { indent: at, key: key.to_owned() });
                self.is_value = true;
                let value = &line[at + end..];
                let value_at = line.len() - value.trim_start_matches(' ').len();
                let is_text = value.trim_start().starts_with(['|', '>']);
                self.text_block = is_text.then_some(at);
                if !is_text {
                    self.flow(line, value_at);
                }
            }
            None => self.flow(line, at),
        }
    }

    /// Scans words and brackets.
    fn flow(&mut self, line: &str, from: usize) {
        let mut quote: Option<char> = None;
        let mut before = ' ';
        for (at, character) in line[from..].char_indices().map(|(at, character)| (from + at, character)) {
            if let Some(open) = quote {
                quote = if character == open { None } else { quote };
                before = character;
                continue;
            }
            let in_flow = !self.flows.is_empty();
            let after = line[at + character.len_utf8()..].chars().next().unwrap_or(' ');
            match character {
                '#' if before == ' ' => {
                    self.in_comment = true;
                    return;
                }
                '"' | '\'' if self.word.is_none() => {
                    self.word = Some((at + 1, Some(character)));
                    quote = Some(character);
                }
                '{' | '[' if self.word.is_none() => {
                    self.flows.push(if character == '{' { Flow::Map(None) } else { Flow::List });
                }
                '}' | ']' if in_flow => {
                    self.flows.pop();
                    self.word = None;
                }
                ',' if in_flow => {
                    self.word = None;
                    if let Some(Flow::Map(key)) = self.flows.last_mut() {
                        *key = None;
                    }
                }
                ':' if in_flow && matches!(after, ' ' | ',' | '}' | ']' | '{' | '[') => {
                    let key =
                        self.word.take().map(|(start, quote)| line[start..at].trim_end_matches(|c| Some(c) == quote));
                    if let Some(Flow::Map(slot @ None)) = self.flows.last_mut() {
                        *slot = Some(key.unwrap_or_default().trim_end().to_owned());
                    }
                }
                ' ' | '\t' => {}
                _ if self.word.is_none() => self.word = Some((at, None)),
                _ => {}
            }
            before = character;
        }
        // A word whose quote was closed is complete.
        if quote.is_none() && matches!(self.word, Some((_, Some(_)))) {
            self.word = self.word.map(|(start, _)| (start, None));
        }
    }

    fn finish(self, text: &str, start: usize, head: &str) -> Option<Cursor> {
        if self.in_comment {
            return None;
        }
        let offset = start + head.len();
        let (word_start, quote) = self.word.map_or((offset, None), |(at, quote)| (start + at, quote));
        let is_end = |c: char| match quote {
            Some(quote) => c == quote || c == '\n' || c == '\r',
            None => c.is_whitespace() || matches!(c, ',' | '}' | ']' | ':' | '#'),
        };
        let end = text[offset..].find(is_end).map_or(text.len(), |length| offset + length);
        let mut keys: Vec<String> = self.blocks.iter().map(|block| block.key.clone()).collect();
        let mut closing: String = quote.into_iter().collect();
        for flow in self.flows.iter().rev() {
            closing.push(if matches!(flow, Flow::Map(_)) { '}' } else { ']' });
        }
        let is_key = match self.flows.last() {
            Some(Flow::Map(key)) => key.is_none(),
            Some(Flow::List) => false,
            None => !self.is_value,
        };
        keys.extend(self.flows.into_iter().filter_map(|flow| match flow {
            Flow::Map(key) => key,
            Flow::List => Some(ITEM.to_owned()),
        }));
        Some(Cursor { keys, is_key, word: word_start..end, closing })
    }
}

/// The key that a line of a block begins with, and where its value may begin.
fn key_end(content: &str) -> Option<(&str, usize)> {
    if let Some(quote @ ('"' | '\'')) = content.chars().next() {
        let end = content[1..].find(quote)? + 1;
        return content[end + 1..].starts_with(':').then(|| (&content[1..end], end + 2));
    }
    if content.starts_with(['{', '[', '#', '&', '*', '!', '|', '>']) {
        return None;
    }
    let is_end = |at: &usize| content[at + 1..].is_empty() || content[at + 1..].starts_with(' ');
    let end = content.match_indices(':').map(|(at, _)| at).find(is_end)?;
    let key = content[..end].trim_end();
    (!key.is_empty() && !content[..end].contains(" #")).then_some((key, end + 1))
}

#[cfg(test)]
mod tests {
    use super::cursor;

    /// The cursor at `|`: its keys, whether a key is expected, and its word.
    fn at(marked: &str) -> Option<(String, bool, String)> {
        let offset = marked.find('|').expect("a cursor");
        let text = marked.replacen('|', "", 1);
        let cursor = cursor(&text, offset)?;
        Some((cursor.keys.join(" "), cursor.is_key, text[cursor.word].to_owned()))
    }

    fn key(keys: &str, word: &str) -> Option<(String, bool, String)> {
        Some((keys.to_owned(), true, word.to_owned()))
    }

    fn value(keys: &str, word: &str) -> Option<(String, bool, String)> {
        Some((keys.to_owned(), false, word.to_owned()))
    }

    #[test]
    fn keys_and_values_of_blocks() {
        assert_eq!(at("|"), key("", ""));
        assert_eq!(at("exp|"), key("", "exp"));
        assert_eq!(at("experiment: a\nsou|rces:\n"), key("", "sources"));
        assert_eq!(at("a:\n  b:\n    |\nc: 1\n"), key("a b", ""));
        assert_eq!(at("a:\n  b:\n    c: 1\n  |"), key("a", ""));
        assert_eq!(at("a:\n  b: x|y # z\n"), value("a b", "xy"));
        assert_eq!(at("a:\n  b: |"), value("a b", ""));
        assert_eq!(at("a:\n  b: \"x|y\"\n"), value("a b", "xy"));
        assert_eq!(at("a:\n  - b: 1\n    c|"), key("a -", "c"));
        assert_eq!(at("a:\n- b|"), key("a -", "b"));
        assert_eq!(at("a:\n  - x\n  - |"), key("a -", ""));
    }

    #[test]
    fn keys_and_values_of_brackets() {
        assert_eq!(at("a: { b: { c: 1 }, d: x|y }"), value("a d", "xy"));
        assert_eq!(at("a: { b: 1, |"), key("a", ""));
        assert_eq!(at("a: { b: { c|"), key("a b", "c"));
        assert_eq!(at("a: { b: [x, y|"), value("a b -", "y"));
        assert_eq!(at("a: {\n  b: 1,\n  c: |\n}"), value("a c", ""));
        assert_eq!(at("a: { s.n.with.p: | }"), value("a s.n.with.p", ""));
        assert_eq!(at("a: { b: source/le|ft, c: 1 }"), value("a b", "source/left"));
        assert_eq!(at("a:\n  b: { c: 1\n  d: { e: |"), value("a d e", ""), "the first bracket is not closed");
    }

    #[test]
    fn nothing_is_expected_in_comments_and_texts() {
        assert_eq!(at("a: 1 # x|"), None);
        assert_eq!(at("# x|"), None);
        assert_eq!(at("a: >\n  words and w|"), None);
        assert_eq!(at("a: >\n  words\nb: |"), value("b", ""));
    }

    #[test]
    fn every_place_of_every_text_has_a_cursor_within_the_text() {
        let text = include_str!("../../../experiments/table1.yaml");
        for (offset, removed) in text.char_indices().skip(900).step_by(7) {
            let mut other = text.to_owned();
            other.remove(offset);
            for text in [text, &text[..offset], &other, &text.replace(removed, "ä")] {
                for at in [offset, offset + 1, offset + 40, text.len()] {
                    let Some(found) = cursor(text, at) else { continue };
                    assert!(text.get(found.word.clone()).is_some(), "{:?} at {at}", found.word);
                    assert!(found.word.start <= at.min(text.len()), "{:?} at {at}", found.word);
                }
            }
        }
    }

    #[test]
    fn closing_brackets_complete_the_line() {
        let closing = |text: &str| cursor(text, text.len()).expect("a cursor").closing;
        assert_eq!(closing("a: { b: [x, { c: \"d"), "\"}]}");
        assert_eq!(closing("a: { b: 1 }"), "");
    }
}
