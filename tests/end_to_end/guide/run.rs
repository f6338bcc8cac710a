//! Runs the commands of the guide, page by page, as a reader does.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::page::{self, Block, Use, blocks, pages};
use super::pictures;
use super::{book, writes};
use crate::support::{full, python_package, shared, skipped, workspace};

/// The path of KITTI data in the guide; the tests replace it by the real path.
const KITTI: &str = "/data/kitti_stereo_2015";

/// One test per page: its name, and the page.
macro_rules! pages {
    ($($name:ident: $page:literal,)*) => {
        $(#[test]
        fn $name() {
            run($page);
        })*
        const PAGES: &[&str] = &[$($page),*];
    };
}

pages! {
    readme: "../README.md",
    concepts: "concepts.md",
    install: "install.md",
    coming_from: "explanation/coming-from.md",
    comparison: "explanation/comparison.md",
    determinism: "explanation/determinism.md",
    error_against_distance: "explanation/error-against-distance.md",
    keys_and_reuse: "explanation/keys-and-reuse.md",
    scores: "explanation/scores.md",
    figures: "figures.md",
    ask_a_run: "how-to/ask-a-run.md",
    ci: "how-to/ci.md",
    disk_and_memory: "how-to/disk-and-memory.md",
    editor: "how-to/editor.md",
    export: "how-to/export.md",
    kitti: "how-to/kitti.md",
    labels: "how-to/labels.md",
    manage_runs: "how-to/manage-runs.md",
    cluster: "how-to/cluster.md",
    monocular_data: "how-to/monocular-data.md",
    dora: "how-to/dora.md",
    own_data: "how-to/own-data.md",
    own_network: "how-to/own-network.md",
    own_node: "how-to/own-node.md",
    predictions: "how-to/predictions.md",
    python: "how-to/python.md",
    python_node: "how-to/python-node.md",
    pytorch: "how-to/pytorch.md",
    resume: "how-to/resume.md",
    subgraph_files: "how-to/subgraph-files.md",
    train: "how-to/train.md",
    troubleshooting: "how-to/troubleshooting.md",
    viewers: "how-to/viewers.md",
    frames: "reference/frames.md",
    first_run: "tutorial/first-run.md",
    own_ablation: "tutorial/own-ablation.md",
    reading_the_report: "tutorial/reading-the-report.md",
}

#[test]
fn every_page_with_commands_has_a_test() {
    let is_run = |name: &str, block: &Block| matches!(block.declared_use(name), Use::Run { .. });
    let has_commands = |name: &String| blocks(&page::read(name)).iter().any(|block| is_run(name, block));
    let mut untested: Vec<String> = pages().into_iter().filter(has_commands).collect();
    untested.retain(|name| !PAGES.contains(&&**name));
    assert_eq!(untested, [""; 0], "pages with commands and without a test: add them to `pages!`");
}

/// Runs all blocks of a page in order, in a folder with the checkout's `experiments` and `examples` and the program on
/// the PATH.
fn run(name: &str) {
    let text = page::read(name);
    let blocks = blocks(&text);
    let test = format!("guide::{name}");
    if !full(&test) {
        return;
    }
    if Command::new("bash").arg("--version").output().is_err() {
        return skipped(&test, "there is no bash");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let here = folder.path().join("here");
    fs::create_dir(&here).expect("made");
    for shared in ["experiments", "examples"] {
        copy(&workspace().join(shared), &here.join(shared));
    }
    let bin = folder.path().join("bin");
    fs::create_dir(&bin).expect("made");
    let program = bin.join("depthloom").with_extension(std::env::consts::EXE_EXTENSION);
    fs::hard_link(env!("CARGO_BIN_EXE_depthloom"), &program)
        .or_else(|_| fs::copy(env!("CARGO_BIN_EXE_depthloom"), &program).map(|_| ()))
        .expect("the program");
    let mut updated = text.clone();
    let mut wrong = Vec::new();
    for (index, block) in blocks.iter().enumerate() {
        match block.declared_use(name) {
            Use::File(file) => fs::write(here.join(file), &block.text).expect("written"),
            Use::NotRun(_) | Use::Shown => {}
            Use::Figure { file, tolerance, arguments } => {
                let output = Needs::default().run(&pictures::command(&arguments), &here, &bin);
                if output.code != Some(0) {
                    wrong.push(format!("docs/{name}:{}: {}{}", block.line, output.out, output.err));
                } else if let Err(error) = pictures::check_figure(&file, tolerance, &here) {
                    wrong.push(format!("docs/{name}:{}: {error}", block.line));
                }
            }
            Use::Screenshot(picture) => match pictures::check_screenshot(&picture, &here, &test) {
                Ok(inputs) => {
                    let old = format!("inputs={} ", picture.inputs);
                    updated = updated.replacen(&old, &format!("inputs={inputs} "), 1);
                }
                Err(error) => wrong.push(format!("docs/{name}:{}: {error}", block.line)),
            },
            Use::Run { expect, needs } => {
                let Some(needs) = needs.map_or_else(|| Some(Needs::default()), |what| Needs::parse(&what, &test))
                else {
                    continue;
                };
                let output = needs.run(&block.text, &here, &bin);
                if output.code != Some(expect) {
                    wrong.push(format!(
                        "docs/{name}:{}: exit code {:?} instead of {expect}\n{}\n{}{}",
                        block.line, output.code, block.text, output.out, output.err
                    ));
                    break;
                }
                let shown = blocks.get(index + 1).filter(|next| next.language == "text" && is_next(&text, block, next));
                if let Some(shown) = shown
                    && let Err(line) = is_shown(&shown.text, &format!("{}{}", output.out, output.err))
                {
                    let is_complete = !shown.text.contains(['…']) && !shown.text.lines().any(|line| line == "...");
                    if writes() && is_complete {
                        let printed = if output.out.is_empty() { &output.err } else { &output.out };
                        let (old, new) = (&shown.text, &trimmed(printed));
                        updated = updated.replacen(&format!("```text\n{old}```"), &format!("```text\n{new}```"), 1);
                    } else {
                        wrong.push(format!(
                            "docs/{name}:{}: the commands do not print: {line}\nthey print\n{}{}",
                            shown.line, output.out, output.err
                        ));
                    }
                }
            }
        }
    }
    if updated != text {
        fs::write(book().join(name), updated).expect("written");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

/// Whether only prose without a heading is between the commands and the shown output.
fn is_next(text: &str, block: &Block, shown: &Block) -> bool {
    let from = block.line + block.text.lines().count() + 1;
    text.lines().take(shown.line - 1).skip(from).all(|line| !line.starts_with('#'))
}

/// Requirements of commands besides the program.
#[derive(Default)]
struct Needs {
    kitti: Option<PathBuf>,
    python: Option<PathBuf>,
}

/// Output and exit code of commands.
struct Printed {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Needs {
    /// `None` if the requirement is missing; the test is then reported as skipped.
    fn parse(what: &str, test: &str) -> Option<Self> {
        match what {
            "kitti" => {
                let kitti = shared(test)?.join("data/kitti_stereo_2015");
                Some(Self { kitti: Some(kitti), ..Self::default() })
            }
            "python" => Some(Self { python: Some(python_package(test)?), ..Self::default() }),
            other => panic!("{test}: unknown requirement `needs={other}`"),
        }
    }

    /// Runs a block as a script that stops at the first failing command.
    fn run(&self, commands: &str, here: &Path, bin: &Path) -> Printed {
        #[cfg(unix)]
        depthloom_test_needs::signals::restore_defaults();
        let mut path = vec![bin.to_owned()];
        path.extend(self.python.as_ref().and_then(|python| python.parent()).map(Path::to_owned));
        path.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()));
        let mut shell = Command::new("bash");
        shell.args(["-euo", "pipefail", "-c"]).current_dir(here).env("NO_COLOR", "1").env("LC_ALL", "C.UTF-8");
        shell.env("PATH", std::env::join_paths(path).expect("paths without colons"));
        // The engine that every machine has: others compute other last digits.
        shell.env("DEPTHLOOM_ONNX_ENGINE", "tract");
        for other in ["KITTI_STEREO_2015", "MONO_MODEL", "DEPTHLOOM_FRESH", "DEPTHLOOM", "COLUMNS"] {
            shell.env_remove(other);
        }
        let real = self.kitti.as_ref().map(|kitti| kitti.canonicalize().expect("a folder").display().to_string());
        let real = real.as_deref().unwrap_or(KITTI);
        let output = shell.arg(commands.replace(KITTI, real)).output().expect("bash starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).replace(real, KITTI);
        Printed { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
    }
}

/// Copies a folder.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("made");
    for entry in fs::read_dir(from).expect("a folder").map(|entry| entry.expect("an entry").path()) {
        let to = to.join(entry.file_name().expect("a name"));
        if entry.is_dir() {
            copy(&entry, &to);
        } else {
            fs::copy(&entry, &to).expect("copied");
        }
    }
}

/// Removes spaces at the ends of lines, and empty lines at both ends.
fn trimmed(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    format!("{}\n", lines.join("\n").trim_matches('\n'))
}

/// Whether the output contains the shown lines in this order. They must be consecutive except where a line `...` stands
/// for omitted lines; `…` within a line stands for any text.
///
/// # Errors
/// The first line that is missing.
fn is_shown(shown: &str, printed: &str) -> Result<(), String> {
    let printed: Vec<&str> = printed.lines().map(str::trim_end).collect();
    let mut rest = &printed[..];
    for part in trimmed(shown).split("...\n").filter(|part| !part.trim().is_empty()) {
        let lines: Vec<&str> = part.trim_matches('\n').lines().collect();
        let equal =
            |at: usize| lines.iter().zip(&rest[at..]).take_while(|(shown, printed)| is_line(shown, printed)).count();
        let last = (rest.len() + 1).saturating_sub(lines.len());
        let Some(at) = (0..last).find(|at| equal(*at) == lines.len()) else {
            let best = (0..rest.len()).map(equal).max().unwrap_or(0);
            return Err(lines.get(best).unwrap_or(&"").to_string());
        };
        rest = &rest[at + lines.len()..];
    }
    Ok(())
}

/// Whether a printed line matches the shown one: `…` stands for any text.
fn is_line(shown: &str, printed: &str) -> bool {
    let mut parts = shown.split('…');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = printed.strip_prefix(first) else { return false };
    let mut parts = parts.peekable();
    if parts.peek().is_none() {
        return rest.is_empty();
    }
    while let Some(part) = parts.next() {
        if parts.peek().is_none() {
            return rest.ends_with(part);
        }
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    true
}

#[test]
fn shown_output_may_omit_lines_and_parts_of_lines() {
    let printed = "a 1\nb 22 c\nd\ne\n";
    for right in ["a 1\nb 22 c\n", "d\n", "a 1\n...\ne\n", "...\nb … c\nd\n", "b …\n", "… c\n"] {
        assert_eq!(is_shown(right, printed), Ok(()), "{right}");
    }
    for (wrong, line) in [("a 1\nd\n", "d"), ("e\n...\na 1\n", "a 1"), ("b … d\n", "b … d"), ("a\n", "a")] {
        assert_eq!(is_shown(wrong, printed), Err(line.to_owned()), "{wrong}");
    }
}
