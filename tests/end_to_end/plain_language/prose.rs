//! The prose of source files and pages.

/// Comments and string literals of Rust or JavaScript: number of the line that each begins at, and text. Escapes are
/// spaces; a string that continues on the next line is one text.
pub(super) fn code_prose(text: &str) -> Vec<(usize, String)> {
    let bytes = text.as_bytes();
    let (mut found, mut at, mut line) = (Vec::new(), 0, 1);
    while at < bytes.len() {
        let (start, began) = (at, line);
        let rest = &text[at..];
        if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
            found.push((began, text[start..at].to_owned()));
        } else if rest.starts_with("/*") {
            at += rest.find("*/").map_or(rest.len(), |end| end + 2);
            let comment = text[start..at].lines().enumerate();
            found.extend(comment.map(|(index, text)| (began + index, text.to_owned())));
        } else if let Some(end) = raw_string(rest) {
            at += end;
            found.extend(rest[..end].lines().enumerate().map(|(index, text)| (began + index, text.to_owned())));
        } else if bytes[at] == b'"' || (bytes[at] == b'`') {
            at = end_of_string(bytes, at);
            found.push((began, unescaped(&text[start..at])));
        } else if bytes[at] == b'\'' {
            at += character(rest);
        } else {
            at += rest.chars().next().map_or(1, char::len_utf8);
        }
        line += text[start..at].matches('\n').count();
    }
    found
}

/// The length of the raw string literal that `text` begins with.
fn raw_string(text: &str) -> Option<usize> {
    let hashes = text.strip_prefix('r')?.bytes().take_while(|byte| *byte == b'#').count();
    let body = text[1 + hashes..].strip_prefix('"')?;
    let end = format!("\"{}", "#".repeat(hashes));
    Some(2 + hashes + body.find(&end)? + end.len())
}

/// The place behind the closing quote of the string literal that begins at `at`.
fn end_of_string(bytes: &[u8], at: usize) -> usize {
    let quote = bytes[at];
    let mut end = at + 1;
    while end < bytes.len() && bytes[end] != quote {
        end += if bytes[end] == b'\\' { 2 } else { 1 };
    }
    (end + 1).min(bytes.len())
}

/// The length of the character literal that `text` begins with; 1 for a lifetime.
fn character(text: &str) -> usize {
    let mut characters = text.char_indices().skip(1);
    match characters.next() {
        Some((_, '\\')) => text[3..].find('\'').map_or(1, |end| end + 4),
        Some(_) => characters.next().filter(|(_, next)| *next == '\'').map_or(1, |(place, _)| place + 1),
        None => 1,
    }
}

/// A literal on one line: a backslash and what follows it are a space.
fn unescaped(literal: &str) -> String {
    let mut text = String::new();
    let mut characters = literal.chars();
    while let Some(character) = characters.next() {
        if character == '\\' {
            characters.next();
            text.push(' ');
        } else {
            text.push(if character == '\n' { ' ' } else { character });
        }
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Comments and strings of Python, line by line: what is behind `#`, between quotes, or in a text of several lines.
pub(super) fn python_prose(text: &str) -> Vec<(usize, String)> {
    let mut in_text = false;
    let mut found = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let marks = line.matches("\"\"\"").count();
        let parts: Vec<&str> = line.split('"').collect();
        if in_text || marks > 0 {
            found.push((index + 1, line.to_owned()));
        } else if parts.len() > 1 || line.contains('#') {
            let strings = parts.iter().skip(1).step_by(2).copied();
            let comment = line.split_once('#').map_or("", |(_, comment)| comment);
            found.push((index + 1, strings.chain([comment]).collect::<Vec<_>>().join(" ")));
        }
        in_text ^= marks % 2 == 1;
    }
    found
}

/// A line of Markdown without what is between backticks.
pub(super) fn without_inline_code(line: &str) -> String {
    line.split('`').step_by(2).collect::<Vec<_>>().join(" ")
}

/// The sentences of a page of Markdown: number of the line of their paragraph, number of words, text. Headings, tables,
/// code blocks and comments are left out; what is between backticks is one word, a link is its text.
pub(super) fn markdown_sentences(text: &str) -> Vec<(usize, usize, String)> {
    let mut paragraphs: Vec<(usize, String)> = vec![(1, String::new())];
    let mut in_code = false;
    for (index, line) in text.lines().enumerate() {
        let bare = line.trim_start_matches(['>', ' ']);
        let is_fence = bare.starts_with("```") || bare.starts_with("~~~");
        in_code ^= is_fence;
        let item = bare.trim_start_matches(|c: char| c.is_ascii_digit());
        let is_item = ["- ", "* ", ". "].iter().any(|mark| item.starts_with(mark));
        let is_apart = in_code || is_fence || bare.is_empty() || bare.starts_with(['|', '#', '<', '!']);
        if is_apart || is_item {
            paragraphs.push((index + 1, String::new()));
        }
        if !is_apart {
            let (_, paragraph) = paragraphs.last_mut().expect("one at least");
            paragraph.push(' ');
            paragraph.push_str(if is_item { item.get(2..).unwrap_or_default() } else { bare });
        }
    }
    let sentences = |(line, paragraph): (usize, String)| {
        let plain = without_links(&code_as_one_word(&paragraph));
        let mut sentences = vec![Vec::new()];
        for word in plain.split_whitespace() {
            sentences.last_mut().expect("one at least").push(word.to_owned());
            let end = word.trim_end_matches([')', '"', '*', '_']);
            let is_short = ["e.g.", "i.e.", "vs.", "et", "al.", "cf.", "No.", "approx."].contains(&end);
            if end.ends_with(['.', '!', '?']) && !is_short {
                sentences.push(Vec::new());
            }
        }
        let sentences = sentences.into_iter().filter(|words| !words.is_empty());
        sentences.map(move |words: Vec<String>| (line, words.len(), words.join(" "))).collect::<Vec<_>>()
    };
    paragraphs.into_iter().flat_map(sentences).collect()
}

fn code_as_one_word(text: &str) -> String {
    let part = |(index, part): (usize, &str)| if index % 2 == 1 { "`code`".to_owned() } else { part.to_owned() };
    text.split('`').enumerate().map(part).collect()
}

/// `[text](address)` as `text`.
fn without_links(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some(end) = rest.find("](") {
        plain.push_str(&rest[..end].replacen('[', "", 1));
        rest = rest[end..].split_once(')').map_or("", |(_, rest)| rest);
    }
    plain + rest
}

#[test]
fn comments_and_literals_are_found_and_code_is_not() {
    let text = "let a = 'x'; // one\nfn of<'a>() { \"two \\\n  three\"; r#\"four\"# }\n/* five\nsix */ '\\'' \"seven\"";
    let expected =
        [(1, "// one"), (2, "\"two three\""), (3, "r#\"four\"#"), (4, "/* five"), (5, "six */"), (5, "\"seven\"")];
    let found = code_prose(text);
    assert_eq!(found.iter().map(|(line, text)| (*line, text.as_str())).collect::<Vec<_>>(), expected);
}

#[test]
fn sentences_are_counted_in_words() {
    let text = "# A heading of many words\nOne [two three](four/five.md) `six seven`. Eight\nnine!\n\n| a | b |\n- ten\n```sh\nno words\n```\n";
    let found: Vec<(usize, usize)> = markdown_sentences(text).iter().map(|(line, words, _)| (*line, *words)).collect();
    assert_eq!(found, [(1, 4), (1, 2), (6, 1)]);
}
