//! A page of the guide: its blocks, and what the comments before them say.

use std::path::{Path, PathBuf};

use super::book;

/// A fenced block, and the comment right before it.
pub(super) struct Block {
    /// The line of its fence, from 1.
    pub line: usize,
    pub language: String,
    pub text: String,
    /// What the comment says: `not run: why`, `run: expect=3 needs=kitti`, `file: name`.
    comment: Option<String>,
}

/// What a page wants done with a block.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// Its commands are run; they end with this code, and are skipped where what they need is not here.
    Run { expect: i32, needs: Option<String> },
    /// Its commands are not run, for this reason.
    NotRun(String),
    /// The reader writes it to this file.
    File(String),
    /// It is shown.
    Shown,
}

impl Block {
    /// What is done with it.
    ///
    /// # Panics
    /// If its comment is none that is known.
    pub(super) fn used(&self, page: &str) -> Use {
        let comment = self.comment.as_deref();
        let with = |name: &str| comment.and_then(|comment| comment.strip_prefix(name)).map(str::trim);
        if let Some(why) = with("not run:") {
            assert!(!why.is_empty() && self.language == "sh", "{page}:{}: a reason is wanted, of commands", self.line);
            return Use::NotRun(why.to_owned());
        }
        if let Some(name) = with("file:") {
            return Use::File(name.to_owned());
        }
        if self.language != "sh" {
            return Use::Shown;
        }
        let (mut expect, mut needs) = (0, None);
        for word in with("run:").into_iter().flat_map(str::split_whitespace) {
            match word.split_once('=') {
                Some(("expect", code)) => expect = code.parse().expect("an exit code"),
                Some(("needs", what)) => needs = Some(what.to_owned()),
                _ => panic!("{page}:{}: `{word}` is neither expect=CODE nor needs=WHAT", self.line),
            }
        }
        Use::Run { expect, needs }
    }

    /// Its commands: lines that begin one. What goes on behind a `\`, or is said behind a `#`, is none.
    pub(super) fn commands(&self) -> usize {
        let mut goes_on = false;
        let begins = |line: &&str| {
            let begins = !goes_on && !line.trim().is_empty() && !line.trim_start().starts_with('#');
            goes_on = line.ends_with('\\');
            begins
        };
        self.text.lines().filter(begins).count()
    }
}

/// The blocks of a page, in order.
pub(super) fn blocks(text: &str) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    let mut comment = None;
    let mut is_open = false;
    for (line, content) in (1..).zip(text.lines()) {
        if is_open {
            match content.trim_end() {
                "```" => is_open = false,
                _ => {
                    let block = blocks.last_mut().expect("it is open");
                    block.text.push_str(content);
                    block.text.push('\n');
                }
            }
        } else if let Some(language) = content.strip_prefix("```") {
            let (language, comment) = (language.trim().to_owned(), comment.take());
            blocks.push(Block { line, language, text: String::new(), comment });
            is_open = true;
        } else if let Some(said) = content.strip_prefix("<!--").and_then(|rest| rest.trim_end().strip_suffix("-->")) {
            comment = Some(said.trim().to_owned());
        } else if !content.trim().is_empty() {
            comment = None;
        }
    }
    blocks
}

/// A page without its blocks, line for line.
pub(super) fn prose(text: &str) -> String {
    let mut is_open = false;
    let line = |line: &str| {
        let is_fence = line.starts_with("```");
        let is_prose = !is_open && !is_fence;
        is_open ^= is_fence;
        format!("{}\n", if is_prose { line } else { "" })
    };
    text.lines().map(line).collect()
}

/// Every page of the book but its list, by its path from the book's folder.
pub(super) fn pages() -> Vec<String> {
    fn below(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
            if entry.is_dir() {
                below(&entry, found);
            } else if entry.extension().is_some_and(|ending| ending == "md") {
                found.push(entry);
            }
        }
    }
    let mut found = Vec::new();
    below(&book(), &mut found);
    let name = |path: &PathBuf| path.strip_prefix(book()).expect("below").to_str().expect("UTF-8").to_owned();
    let mut names: Vec<String> = found.iter().map(name).filter(|name| name != "SUMMARY.md").collect();
    // Runs of the notebook lie here, and are nobody's pages.
    names.retain(|name| !name.starts_with("runs/"));
    names.sort();
    names
}

/// The text of a page.
pub(super) fn read(page: &str) -> String {
    std::fs::read_to_string(book().join(page)).unwrap_or_else(|error| panic!("{page}: {error}"))
}

#[test]
fn comments_say_what_is_done_with_the_block_behind_them() {
    let text = "<!-- run: expect=3 needs=kitti -->\n```sh\none \\\n  two\n# three\nfour\n```\n\n```text\nfive\n```\n<!-- not run: it takes a day -->\n\n```sh\nsix\n```\n<!-- file: a.yaml -->\nwords\n```yaml\nseven\n```\n";
    let blocks = blocks(text);
    let used: Vec<Use> = blocks.iter().map(|block| block.used("page")).collect();
    let run = Use::Run { expect: 3, needs: Some("kitti".to_owned()) };
    assert_eq!(used, [run, Use::Shown, Use::NotRun("it takes a day".to_owned()), Use::Shown]);
    assert_eq!((blocks[0].line, blocks[0].commands()), (2, 2));
    assert_eq!(prose(text).lines().filter(|line| !line.starts_with("<!--")).collect::<String>(), "words");
}
