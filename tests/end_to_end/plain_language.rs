//! Plain language: documentation, help, schemas, snapshots, comments, string literals and names of items use the
//! field's terms (`plain_language/phrases.txt`), and no sentence of README or guide has more than 30 words.

mod prose;

use std::path::{Path, PathBuf};

use regex_lite::Regex;

use crate::support::workspace;
use prose::{code_prose, markdown_sentences, python_prose, without_inline_code};

/// The longest sentence of README and guide, in words.
const LONGEST_SENTENCE: usize = 30;

/// Names of items and variables that do not say what a value is.
const UNCLEAR_NAMES: &str = r"\b(?:let|fn|struct|enum|mod|const|type|trait)\s+(?:mut\s+)?(told|said|asked|of|begun|held|kept|lasting|lay|meant|Told|Said|Asked|Begun|Held|Kept|Elsewhere|Giver|Given|Comes|Lead|Leads|Ending|Beside|Silence|Found|Wanted|Lying|Known)\b";

struct Phrase {
    pattern: Regex,
    instead: String,
}

fn phrases() -> Vec<Phrase> {
    let phrase = |line: &str| {
        let (pattern, instead) = line.split_once('\t').expect("a pattern, a tab, a replacement");
        let pattern = Regex::new(&format!("(?i){pattern}")).unwrap_or_else(|error| panic!("{pattern}: {error}"));
        Phrase { pattern, instead: instead.to_owned() }
    };
    let lines = include_str!("plain_language/phrases.txt").lines();
    lines.filter(|line| !line.is_empty() && !line.starts_with('#')).map(phrase).collect()
}

/// `is no X` where `is not an X` is meant; "there is no X", "is no longer" and comparisons are plain.
struct IsNo(Regex);

impl IsNo {
    fn new() -> Self {
        Self(Regex::new(r"(?i)(\bthere )?\b(?:is|are) no\b(?: (\w+))?").expect("a pattern"))
    }

    fn is_in(&self, text: &str) -> bool {
        const COMPARISONS: [&str; 10] =
            ["longer", "more", "less", "fewer", "later", "larger", "smaller", "wider", "better", "worse"];
        self.0.captures_iter(text).any(|found| {
            found.get(1).is_none() && found.get(2).is_none_or(|word| !COMPARISONS.contains(&word.as_str()))
        })
    }
}

/// The files of the repository that people read, without build output, hidden folders and what others wrote.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    const EXTENSIONS: [&str; 9] = ["rs", "md", "yaml", "yml", "py", "js", "mjs", "snap", "json"];
    for entry in std::fs::read_dir(folder).expect("a folder that can be read") {
        let path = entry.expect("an entry that can be read").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if name.starts_with('.') || ["target", "shared", "node_modules", "__pycache__"].contains(&name.as_str()) {
            continue;
        }
        if path.is_dir() && !path.is_symlink() {
            files(&path, found);
        } else if !name.contains("uPlot")
            && path.extension().is_some_and(|extension| EXTENSIONS.iter().any(|known| *known == extension))
            // Of JSON, the schemas: the rest is data.
            && (!name.ends_with(".json") || path.to_string_lossy().contains("schema"))
        {
            found.push(path);
        }
    }
}

/// The prose of a file: number of the line, from 1, and text.
fn prose(path: &Path, text: &str) -> Vec<(usize, String)> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("rs" | "js" | "mjs") => code_prose(text),
        Some("py") => python_prose(text),
        Some("md") => lines(text).map(|(line, text)| (line, without_inline_code(text))).collect(),
        _ => lines(text).map(|(line, text)| (line, text.to_owned())).collect(),
    }
}

fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(index, line)| (index + 1, line))
}

/// Whether a line of code declares an unclear name, not in a comment or a string.
fn is_declared(names: &Regex, line: &str) -> bool {
    let code = line.split("//").next().unwrap_or_default();
    names.find(code).is_some_and(|found| code[..found.start()].matches('"').count().is_multiple_of(2))
}

#[test]
fn texts_and_names_use_the_terms_of_the_field() {
    let mut paths = Vec::new();
    files(workspace(), &mut paths);
    assert!(paths.len() > 1000, "{} files", paths.len());
    let (phrases, is_no) = (phrases(), IsNo::new());
    let names = Regex::new(UNCLEAR_NAMES).expect("a pattern");
    let mut faults = Vec::new();
    for path in &paths {
        // The list of phrases names them.
        if path.ends_with("tests/end_to_end/plain_language.rs") {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(path) else { continue };
        let shown = path.strip_prefix(workspace()).expect("below the workspace").display();
        for (line, text) in prose(path, &text) {
            for phrase in phrases.iter().filter(|phrase| phrase.pattern.is_match(&text)) {
                faults.push(format!("{shown}:{line}: write \"{}\": {}", phrase.instead, text.trim()));
            }
            if is_no.is_in(&text) {
                faults.push(format!("{shown}:{line}: write \"is not a\" or \"there is no\": {}", text.trim()));
            }
        }
        if path.extension().is_some_and(|extension| extension == "rs") {
            let unclear = lines(&text).filter(|(_, text)| is_declared(&names, text));
            faults.extend(unclear.map(|(line, text)| format!("{shown}:{line}: name what it is: {}", text.trim())));
        }
    }
    assert!(faults.is_empty(), "{} texts are not plain:\n{}", faults.len(), faults.join("\n"));
}

#[test]
fn sentences_of_readme_and_guide_have_at_most_30_words() {
    let mut paths = vec![workspace().join("README.md")];
    files(&workspace().join("docs"), &mut paths);
    let mut faults = Vec::new();
    for path in paths.iter().filter(|path| path.extension().is_some_and(|extension| extension == "md")) {
        let text = std::fs::read_to_string(path).expect("a file that can be read");
        for (line, words, sentence) in markdown_sentences(&text) {
            if words > LONGEST_SENTENCE {
                let shown = path.strip_prefix(workspace()).expect("below the workspace").display();
                faults.push(format!("{shown}:{line}: {words} words: {sentence}"));
            }
        }
    }
    assert!(faults.is_empty(), "{} sentences are too long:\n{}", faults.len(), faults.join("\n"));
}
