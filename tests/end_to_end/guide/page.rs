//! A page of the guide: its code blocks, and the comments that declare their use.

use std::path::{Path, PathBuf};

use super::book;

/// A fenced block, and the comment directly before it.
pub(super) struct Block {
    /// The line of its opening fence, from 1.
    pub line: usize,
    pub language: String,
    pub text: String,
    /// The comment: `not run: why`, `run: expect=3 needs=kitti`, or `file: name`; for a picture, which has no fence,
    /// `figure: ...` or `screenshot: ...`.
    comment: Option<String>,
}

/// The use of a block.
#[derive(Debug, PartialEq)]
pub(super) enum Use {
    /// The test runs its commands and expects this exit code; it skips them if a requirement is missing.
    Run { expect: i32, needs: Option<String> },
    /// The test does not run its commands, for this reason.
    NotRun(String),
    /// The test writes it to this file, as the reader does.
    File(String),
    /// `depthloom figure` with these arguments draws the file of the next picture. Numbers in it may differ by
    /// `tolerance`, because the last bits of a network's output depend on the processor.
    Figure { file: String, tolerance: f64, arguments: String },
    /// The file of the next picture is a section of a run's `report.html`.
    Screenshot(Screenshot),
    /// Output or another text.
    Shown,
}

/// A picture of a section of a report.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Screenshot {
    pub file: String,
    /// The experiment's file and the run's folder, from the working folder of the page.
    pub experiment: String,
    pub run: String,
    /// The `id` of the section.
    pub section: String,
    /// The checksum of the picture's inputs.
    pub inputs: String,
}

impl Block {
    /// The use that its comment and language declare.
    ///
    /// # Panics
    /// If the comment is invalid.
    pub(super) fn declared_use(&self, page: &str) -> Use {
        let comment = self.comment.as_deref();
        let value_of = |name: &str| comment.and_then(|comment| comment.strip_prefix(name)).map(str::trim);
        if let Some(why) = value_of("not run:") {
            assert!(
                !why.is_empty() && self.language == "sh",
                "{page}:{}: `not run:` needs a reason, and commands",
                self.line
            );
            return Use::NotRun(why.to_owned());
        }
        if let Some(name) = value_of("file:") {
            return Use::File(name.to_owned());
        }
        if let Some(picture) = value_of("figure:") {
            return self.figure(page, picture);
        }
        if let Some(picture) = value_of("screenshot:") {
            return self.screenshot(page, picture);
        }
        if self.language != "sh" {
            return Use::Shown;
        }
        let (mut expect, mut needs) = (0, None);
        for word in value_of("run:").into_iter().flat_map(str::split_whitespace) {
            match word.split_once('=') {
                Some(("expect", code)) => expect = code.parse().expect("an exit code"),
                Some(("needs", what)) => needs = Some(what.to_owned()),
                _ => panic!("{page}:{}: `{word}` is neither expect=CODE nor needs=WHAT", self.line),
            }
        }
        Use::Run { expect, needs }
    }

    /// `FILE: ARGUMENTS`, or `FILE tolerance=POINTS: ARGUMENTS`.
    fn figure(&self, page: &str, picture: &str) -> Use {
        let parts = picture.split_once(": ");
        let (file, arguments) = parts.unwrap_or_else(|| panic!("{page}:{}: expected `FILE: ARGUMENTS`", self.line));
        let (file, tolerance) = file.split_once(" tolerance=").map_or((file, 0.0), |(file, tolerance)| {
            (file, tolerance.parse().unwrap_or_else(|error| panic!("{page}:{}: tolerance: {error}", self.line)))
        });
        Use::Figure { file: file.to_owned(), tolerance, arguments: arguments.to_owned() }
    }

    /// `FILE: EXPERIMENT RUN #SECTION inputs=CHECKSUM`.
    fn screenshot(&self, page: &str, picture: &str) -> Use {
        let words: Vec<&str> = picture.split_whitespace().collect();
        let [file, experiment, run, section, inputs] = words[..] else {
            panic!("{page}:{}: expected `FILE: EXPERIMENT RUN #SECTION inputs=CHECKSUM`", self.line);
        };
        Use::Screenshot(Screenshot {
            file: file.trim_end_matches(':').to_owned(),
            experiment: experiment.to_owned(),
            run: run.to_owned(),
            section: section.trim_start_matches('#').to_owned(),
            inputs: inputs.trim_start_matches("inputs=").to_owned(),
        })
    }

    /// The number of commands: lines except comments and continuations after a `\`.
    pub(super) fn commands(&self) -> usize {
        let mut is_continued = false;
        let begins = |line: &&str| {
            let begins = !is_continued && !line.trim().is_empty() && !line.trim_start().starts_with('#');
            is_continued = line.ends_with('\\');
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
                    let block = blocks.last_mut().expect("an open block");
                    block.text.push_str(content);
                    block.text.push('\n');
                }
            }
        } else if let Some(language) = content.strip_prefix("```") {
            let (language, comment) = (language.trim().to_owned(), comment.take());
            blocks.push(Block { line, language, text: String::new(), comment });
            is_open = true;
        } else if let Some(text) = content.strip_prefix("<!--").and_then(|rest| rest.trim_end().strip_suffix("-->")) {
            let text = text.trim().to_owned();
            if text.starts_with("figure:") || text.starts_with("screenshot:") {
                let block = Block { line, language: String::new(), text: String::new(), comment: Some(text) };
                blocks.push(block);
                comment = None;
            } else {
                comment = Some(text);
            }
        } else if !content.trim().is_empty() {
            comment = None;
        }
    }
    blocks
}

/// A page with its code blocks replaced by empty lines.
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

/// Every page of the book except its summary, by its path from the book's folder.
pub(super) fn pages() -> Vec<String> {
    fn below(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()) {
            if entry.is_dir() {
                below(&entry, found);
            } else if entry.extension().is_some_and(|extension| extension == "md") {
                found.push(entry);
            }
        }
    }
    let mut found = Vec::new();
    below(&book(), &mut found);
    let name = |path: &PathBuf| path.strip_prefix(book()).expect("below").to_str().expect("UTF-8").to_owned();
    let mut names: Vec<String> = found.iter().map(name).filter(|name| name != "SUMMARY.md").collect();
    // Runs of the notebook may be here; they are not pages.
    names.retain(|name| !name.starts_with("runs/"));
    names.sort();
    names
}

/// The text of a page.
pub(super) fn read(page: &str) -> String {
    std::fs::read_to_string(book().join(page)).unwrap_or_else(|error| panic!("{page}: {error}"))
}

#[test]
fn comments_declare_the_use_of_the_next_block() {
    let text = "<!-- run: expect=3 needs=kitti -->\n```sh\none \\\n  two\n# three\nfour\n```\n\n```text\nfive\n```\n<!-- not run: it takes a day -->\n\n```sh\nsix\n```\n<!-- file: a.yaml -->\nwords\n```yaml\nseven\n```\n";
    let blocks = blocks(text);
    let uses: Vec<Use> = blocks.iter().map(|block| block.declared_use("page")).collect();
    let run = Use::Run { expect: 3, needs: Some("kitti".to_owned()) };
    assert_eq!(uses, [run, Use::Shown, Use::NotRun("it takes a day".to_owned()), Use::Shown]);
    assert_eq!((blocks[0].line, blocks[0].commands()), (2, 2));
    let pictures = "<!-- figure: a.svg tolerance=0.5: run cdf -->\n![a](a.svg)\n<!-- screenshot: b.jpg: b.yaml runs/b #frames inputs=12 -->\n";
    let uses: Vec<Use> = super::page::blocks(pictures).iter().map(|block| block.declared_use("page")).collect();
    let figure = Use::Figure { file: "a.svg".to_owned(), tolerance: 0.5, arguments: "run cdf".to_owned() };
    assert_eq!(uses[0], figure);
    assert!(matches!(&uses[1], Use::Screenshot(shot) if shot.section == "frames" && shot.inputs == "12"), "{uses:?}");
    assert_eq!(prose(text).lines().filter(|line| !line.starts_with("<!--")).collect::<String>(), "words");
}
