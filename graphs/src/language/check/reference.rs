//! References: `node/output`, `source/output`, `stage.node/output`.

use crate::language::text::source_file::Place;
use crate::language::text::word::Word;

#[derive(Clone, Debug)]
pub(crate) struct Reference {
    pub(crate) stage: Option<Word>,
    pub(crate) node: Word,
    pub(crate) output: Word,
}

impl Reference {
    pub(crate) fn parse(text: &str, place: &Place) -> Result<Self, String> {
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
