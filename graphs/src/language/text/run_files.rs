//! The files of an experiment that a run stores, so that it can be checked and run again.
//!
//! `experiment.yaml` is the main file, `experiment/` has those it extends or takes nodes from, and
//! `experiment.resolved.yaml` is all of it with `--set`. Only paths are rewritten: stored files by their new names,
//! data by absolute paths. Variables stay variables.

use std::collections::HashSet;
use std::ops::Range;
use std::path::Path;

use super::files::{Files, MAIN};
use super::paths::Anywhere;
use super::resolved;
use super::source_file::Place;
use super::tree::Node;

const RESOLVED: &str = "experiment.resolved.yaml";
const FOLDER: &str = "experiment";

pub(crate) fn texts(
    files: &Files<'_>,
    root: &Node,
    typed: &[(&str, String)],
    anywhere: &Anywhere,
) -> Vec<(String, String)> {
    let sources = files.sources();
    let names = names(sources.iter().map(|file| file.name.as_str()));
    let mut texts: Vec<(String, String)> = Vec::with_capacity(sources.len() + 1);
    for (index, file) in sources.iter().enumerate() {
        let mut edits: Vec<(Range<usize>, String)> = Vec::new();
        let here = |place: &Place| std::sync::Arc::ptr_eq(&place.file, file);
        for (place, target) in files.named().filter(|(place, _)| here(place)) {
            let folder = if index == 0 { format!("{FOLDER}/") } else { String::new() };
            edits.extend(replaced(place, &format!("{folder}{}", names[target])));
        }
        for (place, text) in anywhere.iter().filter(|(place, _)| here(place)) {
            edits.extend(replaced(place, text));
        }
        edits.sort_unstable_by_key(|(range, _)| std::cmp::Reverse(range.start));
        edits.dedup_by_key(|(range, _)| range.start);
        let mut text = file.text.clone();
        for (range, with) in edits {
            text.replace_range(range, &with);
        }
        if index == 0 && !typed.is_empty() {
            let start = if text.starts_with('\u{feff}') { '\u{feff}'.len_utf8() } else { 0 };
            text.insert_str(start, &without(typed));
        }
        let name = if index == 0 { MAIN.to_owned() } else { format!("{FOLDER}/{}", names[index]) };
        texts.push((name, text));
    }
    texts.push((RESOLVED.to_owned(), resolved::yaml(root, Some(anywhere))));
    texts
}

/// Bytes; leaves room for a number, an ending and `.partial`.
const LONGEST_STEM: usize = 180;

/// A comment with the command line options that the file does not contain.
fn without(typed: &[(&str, String)]) -> String {
    let one_line = |text: &str| text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>();
    let typed: Vec<String> = typed.iter().map(|(option, text)| format!("{option} '{}'", one_line(text))).collect();
    format!(
        "# As it was written, without what the run set: {}. {RESOLVED} has it all, and repeats the run.\n",
        typed.join(" ")
    )
}

/// File names, each once, with the ending of an experiment.
fn names<'f>(paths: impl Iterator<Item = &'f str>) -> Vec<String> {
    let mut taken = HashSet::new();
    let unique_name = |path: &str| {
        let path = Path::new(path);
        let text = |part: Option<&std::ffi::OsStr>| part.map_or_else(String::new, |p| p.to_string_lossy().into_owned());
        let (mut stem, ending) = match text(path.extension()) {
            ending if ending == "yaml" || ending == "yml" => (text(path.file_stem()), ending),
            _ => (text(path.file_name()), "yaml".to_owned()),
        };
        stem.truncate(stem.floor_char_boundary(LONGEST_STEM));
        let numbered = (2..).map(|number| format!("{stem}-{number}.{ending}"));
        let mut names = std::iter::once(format!("{stem}.{ending}")).chain(numbered);
        names.find(|name| taken.insert(name.clone())).expect("numbers have no end")
    };
    paths.map(unique_name).collect()
}

/// Replaces a scalar within one line. (Blocks of text stay: paths are never written so.)
fn replaced(place: &Place, with: &str) -> Option<(Range<usize>, String)> {
    let text = place.text();
    let whole = !text.is_empty() && !text.contains(['\n', '\r']) && !text.starts_with(['|', '>', '&', '*', '!']);
    // JSON's text is YAML's, in double quotes.
    whole.then(|| (place.span.clone(), serde_json::Value::from(with).to_string()))
}

#[cfg(test)]
mod tests {
    use super::names;

    #[test]
    fn files_keep_their_names_as_far_as_every_file_system_takes_them_and_end_as_an_experiments_do() {
        let long = format!("{}.yaml", "ä".repeat(125));
        let paths = ["a/base.yaml", "b/base.yaml", "c.yml", "nodes.txt", "nodes", ".yaml", long.as_str()];
        let cut = format!("{}.yaml", "ä".repeat(90));
        let expected =
            ["base.yaml", "base-2.yaml", "c.yml", "nodes.txt.yaml", "nodes.yaml", ".yaml.yaml", cut.as_str()];
        assert_eq!(names(paths.into_iter()), expected);
    }
}
