//! Files by a pattern of their path: `*` stands for any text within a name, `?` for one character.

use std::cmp::Ordering;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, natural_order};

/// A file that a pattern matches.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Match {
    /// What each `*` and `?` matched.
    pub open: Vec<String>,
    /// The file.
    pub path: PathBuf,
}

impl Match {
    /// The numbers in what `*` and `?` matched, without leading zeros.
    #[must_use]
    pub fn numbers(&self) -> Vec<String> {
        let runs = self.open.iter().flat_map(|text| text.split(|c: char| !c.is_ascii_digit()));
        let significant = |digits: &str| match digits.trim_start_matches('0') {
            "" => "0".to_owned(),
            rest => rest.to_owned(),
        };
        runs.filter(|run| !run.is_empty()).map(significant).collect()
    }

    /// What `*` and `?` matched, joined by `_`; of a pattern without them, the file's name without its extension.
    #[must_use]
    pub fn name(&self) -> String {
        let open: Vec<&str> = self.open.iter().map(String::as_str).filter(|text| !text.is_empty()).collect();
        match open.is_empty() {
            true => self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            false => open.join("_"),
        }
    }
}

/// The files that a pattern matches, in natural order: `9` before `10`. `*` stands for any text within a name, `?` for
/// one character; a pattern is relative to `root`.
///
/// # Errors
/// The folder that cannot be listed.
pub fn files(root: &Path, pattern: &str) -> Result<Vec<Match>, Fault> {
    let parts: Vec<&str> = pattern.split('/').filter(|part| !part.is_empty() && *part != ".").collect();
    let start = if pattern.starts_with('/') { PathBuf::from("/") } else { root.to_owned() };
    let mut found = vec![Match { open: Vec::new(), path: start }];
    for (at, part) in parts.iter().enumerate() {
        let is_last = at + 1 == parts.len();
        let mut next = Vec::new();
        for Match { open, path } in found {
            if !is_open(part) {
                next.push(Match { open, path: path.join(part) });
                continue;
            }
            for name in names(&path, is_last)? {
                if let Some(more) = matched(part, &name) {
                    next.push(Match { open: [open.clone(), more].concat(), path: path.join(&name) });
                }
            }
        }
        found = next;
    }
    found.retain(|found| found.path.is_file());
    found.sort_by(|a, b| natural(&a.open, &b.open).then_with(|| a.path.cmp(&b.path)));
    Ok(found)
}

fn is_open(part: &str) -> bool {
    part.contains(['*', '?'])
}

fn names(folder: &Path, files: bool) -> Result<Vec<String>, Fault> {
    let failed = |error| Fault::new(format!("failed to list {}", folder.display())).because(error);
    let listing = match std::fs::read_dir(folder) {
        Ok(listing) => listing,
        // One of several folders that a pattern names may lack the next.
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(Vec::new()),
        Err(error) => return Err(failed(error)),
    };
    let mut names = Vec::new();
    for entry in listing {
        let entry = entry.map_err(failed)?;
        let is_folder = entry.file_type().map_err(failed)?.is_dir();
        if let Ok(name) = entry.file_name().into_string()
            && !(files && is_folder)
        {
            names.push(name);
        }
    }
    Ok(names)
}

/// Each `*` matches as little as possible. Hidden files match only a pattern with a leading dot.
fn matched(pattern: &str, name: &str) -> Option<Vec<String>> {
    if name.starts_with('.') && !pattern.starts_with('.') {
        return None;
    }
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    let (mut p, mut n) = (0, 0);
    let mut open: Vec<(usize, usize)> = Vec::new();
    // The last star: its position, the number of open places up to it, and the end of its match.
    let mut star: Option<(usize, usize, usize)> = None;
    loop {
        match pattern.get(p) {
            Some('*') => {
                open.push((n, n));
                star = Some((p, open.len(), n));
                p += 1;
                continue;
            }
            Some('?') if n < name.len() => {
                open.push((n, n + 1));
                (p, n) = (p + 1, n + 1);
                continue;
            }
            Some(wanted) if name.get(n) == Some(wanted) => {
                (p, n) = (p + 1, n + 1);
                continue;
            }
            None if n == name.len() => break,
            _ => {}
        }
        // The star matches one more character.
        let (at, count, end) = star.filter(|(_, _, end)| *end < name.len())?;
        open.truncate(count);
        open[count - 1].1 = end + 1;
        (p, n) = (at + 1, end + 1);
        star = Some((at, count, end + 1));
    }
    Some(open.into_iter().map(|(from, to)| name[from..to].iter().collect()).collect())
}

fn natural(a: &[String], b: &[String]) -> Ordering {
    let by_part = a.iter().zip(b).map(|(a, b)| natural_order(a, b)).find(|order| order.is_ne());
    by_part.unwrap_or_else(|| a.len().cmp(&b.len()))
}

#[cfg(test)]
mod tests {
    use super::{Match, files, matched};

    fn open(pattern: &str, name: &str) -> Option<Vec<String>> {
        matched(pattern, name)
    }

    #[test]
    fn open_parts_of_a_pattern_are_found() {
        let texts = |parts: &[&str]| Some(parts.iter().map(|part| (*part).to_owned()).collect::<Vec<String>>());
        assert_eq!(open("*.png", "000123.png"), texts(&["000123"]));
        assert_eq!(open("left_*.png", "left_7.png"), texts(&["7"]));
        assert_eq!(open("*_cam?.png", "a_cam_cam0.png"), texts(&["a_cam", "0"]));
        assert_eq!(open("*a*b", "xaab"), texts(&["x", "a"]));
        assert_eq!(open("im?.ppm", "im2.ppm"), texts(&["2"]));
        assert_eq!(open("*", ""), texts(&[""]));
        assert_eq!(open("im2.ppm", "im2.ppm"), texts(&[]));
        for (pattern, name) in [("*.png", "a.jpg"), ("*.png", ".png"), ("a?", "a"), ("a", "ab"), ("*a", "b"), ("", "a")]
        {
            assert_eq!(open(pattern, name), None, "{pattern} {name}");
        }
        // Exponential for a matcher that tries every way.
        assert_eq!(open(&"*a".repeat(40), &"a".repeat(39)), None);
    }

    #[test]
    fn folders_may_be_open_too() {
        let root = tempfile::tempdir().expect("a folder");
        for file in ["run2/left/1.png", "run10/left/1.png", "run2/left/3.txt", "run1/other/1.png", "run2/left/2.png/x"]
        {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().expect("it has one")).expect("made");
            std::fs::write(path, "").expect("written");
        }
        let found = files(root.path(), "./run*/left/*.png").expect("listed");
        let names: Vec<String> = found.iter().map(Match::name).collect();
        assert_eq!(names, ["2_1", "10_1"]);
        assert_eq!(found[0].numbers(), ["2", "1"]);
        assert!(files(root.path(), "nowhere/*.png").expect("nothing is there").is_empty());
    }
}
