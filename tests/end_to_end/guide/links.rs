//! The guide's links and its list of pages; and the built book, if mdBook is installed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use depthloom_test_needs::mdbook;

use super::book;
use super::page::{pages, prose, read};
use crate::support::{succeed, workspace};

/// Files outside the book that link into it, from the checkout's root.
const OUTSIDE: [&str; 5] = ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "CHANGELOG.md", "python/README.md"];

/// The targets of a page's links and pictures, code left out.
fn links(text: &str) -> Vec<String> {
    let prose = prose(text);
    // Code between backticks, every second part, contains no links.
    let words: String =
        prose.lines().map(|line| line.split('`').step_by(2).collect::<Vec<_>>().join("`") + "\n").collect();
    let targets = words.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
    targets.map(|(target, _)| target.split(' ').next().unwrap_or_default().to_owned()).collect()
}

/// The anchors of a page's headings, as GitHub and mdBook generate them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut anchors = BTreeSet::new();
    for heading in prose(text).lines().filter(|line| line.starts_with('#')) {
        let words = heading.trim_start_matches('#').trim().to_lowercase();
        let letter = |letter: char| match letter {
            ' ' => Some('-'),
            letter if letter.is_alphanumeric() || letter == '-' || letter == '_' => Some(letter),
            _ => None,
        };
        let anchor: String = words.chars().filter_map(letter).collect();
        let times = seen.entry(anchor.clone()).or_default();
        anchors.insert(if *times == 0 { anchor } else { format!("{anchor}-{times}") });
        *times += 1;
    }
    anchors
}

/// A path without `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => _ = plain.pop(),
            Component::CurDir => {}
            part => plain.push(part),
        }
    }
    plain
}

#[test]
fn every_link_has_a_target() {
    let book_pages = pages().into_iter().chain(["SUMMARY.md".to_owned()]).map(|page| book().join(page));
    let outside = OUTSIDE.iter().map(|page| workspace().join(page));
    let mut wrong = Vec::new();
    for page in book_pages.chain(outside) {
        let text = std::fs::read_to_string(&page).expect("a page");
        for link in links(&text).into_iter().filter(|link| !link.contains("://")) {
            let (path, anchor) = link.split_once('#').map_or((&*link, None), |(path, anchor)| (path, Some(anchor)));
            let target = match path {
                "" => page.clone(),
                path => plain(&page.with_file_name("").join(path)),
            };
            let mut report = |what: &str| wrong.push(format!("{}: {link}: {what}", page.display()));
            if !target.exists() {
                report("the target does not exist");
                continue;
            }
            if page.starts_with(book()) && !target.starts_with(book()) {
                report("the target is not in the book, so its HTML cannot link to it: name the file without a link");
            }
            let is_anchor = |anchor: &str| anchors(&std::fs::read_to_string(&target).expect("a page")).contains(anchor);
            if anchor.is_some_and(|anchor| !is_anchor(anchor)) {
                report("the page has no such heading");
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_page_is_listed_once_in_the_summary() {
    let mut listed = links(&read("SUMMARY.md"));
    listed.sort();
    assert_eq!(listed, pages());
}

#[test]
fn the_book_is_built_without_a_warning() {
    const TEST: &str = "the_book_is_built_without_a_warning";
    let Some(mdbook) = mdbook(TEST) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut build = Command::new(mdbook);
    build.arg("build").arg(book()).arg("--dest-dir").arg(folder.path()).env_remove("RUST_LOG");
    let output = succeed(&mut build);
    let log = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert!(!log.contains("WARN") && !log.contains("ERROR"), "{log}");
    let html = |page: &str| match page.strip_suffix("README.md") {
        Some(folder) => format!("{folder}index.html"),
        None => page.replace(".md", ".html"),
    };
    for page in pages() {
        let path = folder.path().join(html(&page));
        let built = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        // The anchors that the link check computes exist in the built book.
        let missing: Vec<String> =
            anchors(&read(&page)).into_iter().filter(|anchor| !built.contains(&format!("id=\"{anchor}\""))).collect();
        assert_eq!(missing, [""; 0], "{page}: headings with other anchors in the book");
    }
}

#[test]
fn links_and_anchors_are_extracted() {
    let text = "# A `b/c` of d\n[one](two.md#three) `[no](link.md)`\n## A `b/c` of d\n![four](five.svg \"a title\")\n```sh\n# no heading\n```\n";
    assert_eq!(links(text), ["two.md#three", "five.svg"]);
    assert_eq!(anchors(text), BTreeSet::from(["a-bc-of-d".to_owned(), "a-bc-of-d-1".to_owned()]));
}
