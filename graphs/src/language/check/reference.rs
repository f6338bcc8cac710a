//! References: `node/output`, `source/output`, `stage.node/output`.

use crate::language::text::source_file::Place;
use crate::language::text::word::Word;

/// A reference to an output.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The stage, if it is named.
    pub stage: Option<Word>,
    /// The node, or `source`.
    pub node: Word,
    /// The output port.
    pub output: Word,
}

impl Reference {
    /// Parses a reference that is written at `place`.
    ///
    /// # Errors
    /// Why it is not a reference.
    pub fn parse(text: &str, place: &Place) -> Result<Self, String> {
        let word =
            |start: usize, end: usize| Word { text: text[start..end].to_owned(), place: place.part(text, start..end) };
        let Some(slash) = text.find('/') else {
            return Err(format!("`{text}` does not say which output: a reference is `node/output`"));
        };
        if text[slash + 1..].contains('/') || text.contains(char::is_whitespace) {
            return Err(format!("`{text}` is not a reference"));
        }
        let dot = text[..slash].find('.');
        let node = dot.map_or(0, |dot| dot + 1);
        if text[node..slash].contains('.') {
            return Err(format!("`{text}` is not a reference: at most one `.`, between stage and node"));
        }
        if node == slash || slash + 1 == text.len() || dot == Some(0) {
            return Err(format!("`{text}` is not a reference: a name is missing"));
        }
        Ok(Self { stage: dot.map(|dot| word(0, dot)), node: word(node, slash), output: word(slash + 1, text.len()) })
    }
}
