//! Numbers in README and guide: what stands between `<!-- generated: NAME -->` and `<!-- end -->` is rendered from the
//! files in `docs/numbers`, which `docs/numbers/measure.py` writes where data and machine allow it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use serde_json::Value as Json;

use super::page::{pages, read};
use super::{beyond, book, writes};
use crate::support::{Row, number, read_csv, workspace};

const README: &str = "../README.md";
/// The metrics of the table in how-to/paper.md, and whether more is better.
const METRICS: [(&str, bool); 4] = [("a1", true), ("abs_rel", false), ("sq_rel", false), ("rmse", false)];
const VARIANTS: [&str; 4] = ["full", "no_weighting", "no_scaling", "average_scaling"];

/// All blocks, by name.
fn rendered() -> BTreeMap<&'static str, String> {
    let kitti = Kitti::read();
    let measured = fs::read_to_string(book().join("numbers/measured.json")).expect("measured.json");
    let measured: Json = serde_json::from_str(&measured).expect("JSON");
    BTreeMap::from([
        ("kitti-summary", kitti.summary()),
        ("kitti-table", kitti.table()),
        ("kitti-differences", kitti.differences()),
        ("kitti-conditions", conditions(&measured["kitti"])),
        ("beyond-table", beyond::table()),
        ("beyond-differences", beyond::differences()),
        ("beyond-conditions", engine(&measured["beyond"])),
        ("first-build", first_build(&measured)),
        ("build-time", build_time(&measured)),
        ("speed", speed(&measured)),
        ("memory", memory(&measured)),
    ])
}

/// Three decimals for shares and ratios, two for other metrics.
fn digits(metric: &str) -> usize {
    if matches!(metric, "a1" | "abs_rel") { 3 } else { 2 }
}

/// The runs on KITTI: `table --ci`, `compare`, and the paper's Table I.
struct Kitti {
    table: Vec<Row>,
    compare: Vec<Row>,
    common: Vec<Row>,
    paper: Vec<Row>,
}

impl Kitti {
    fn read() -> Self {
        let csv = |name: &str| read_csv(&book().join("numbers").join(name));
        let paper = workspace().join("analysis/src/input/paper_table1.csv");
        let text = fs::read_to_string(&paper).expect("the paper's table");
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
        let header: Vec<&str> = lines[0].split(',').collect();
        let row =
            |line: &&str| header.iter().zip(line.split(',')).map(|(k, v)| ((*k).to_owned(), v.to_owned())).collect();
        Self {
            table: csv("kitti-table.csv"),
            compare: csv("kitti-compare.csv"),
            common: csv("kitti-common.csv"),
            paper: lines[1..].iter().map(row).collect(),
        }
    }

    /// A row of the run, and the paper's; stereo is the same in all variants.
    fn rows(&self, variant: &str, estimate: &str) -> (&Row, &Row) {
        let is_of = |row: &&Row| row["estimate"] == estimate && (estimate == "stereo" || row["variant"] == variant);
        let is_of_paper = |row: &&Row| row["scored_on"] == "all" && is_of(row);
        (self.table.iter().find(is_of).expect("a row"), self.paper.iter().find(is_of_paper).expect("the paper's row"))
    }

    fn frames(&self) -> &str {
        &self.compare[0]["frames"]
    }

    fn summary(&self) -> String {
        let rows = [
            ("stereo", "full", "stereo"),
            ("fused, `full`", "full", "fused"),
            ("fused, `no_scaling`", "no_scaling", "fused"),
        ];
        let mut text = format!(
            "| mean of {} frames, all pixels with ground truth | a1 ↑ | abs_rel ↓ | 95 % interval of abs_rel | paper's abs_rel |\n|---|---|---|---|---|\n",
            self.frames()
        );
        for (name, variant, estimate) in rows {
            let (row, paper) = self.rows(variant, estimate);
            let cell = |metric, more_is_better| {
                let best = rows.iter().map(|(_, variant, estimate)| number(self.rows(variant, estimate).0, metric));
                marked(number(row, metric), best, more_is_better, 3)
            };
            let (low, high) = (number(row, "abs_rel_low"), number(row, "abs_rel_high"));
            let _ = writeln!(
                text,
                "| {name} | {} | {} | {low:.3} to {high:.3} | {:.2} |",
                cell("a1", true),
                cell("abs_rel", false),
                number(paper, "abs_rel")
            );
        }
        let row = self.difference(&self.compare, "abs_rel");
        let _ = write!(
            text,
            "\nWithout scaling, fused depth has a lower abs_rel than stereo on {} of {} frames (difference {:+.3},\n95 % interval {:+.3} to {:+.3}).\n",
            row["wins"],
            row["frames"],
            number(row, "difference"),
            number(row, "difference_low"),
            number(row, "difference_high")
        );
        text
    }

    fn table(&self) -> String {
        let mut text = "| | stereo | full: mono / fused | no weighting: fused | no scaling: mono / fused | average scaling: fused |\n|---|---|---|---|---|---|\n".to_owned();
        for (metric, more_is_better) in METRICS {
            let decimals = digits(metric);
            let fused = || VARIANTS.iter().map(|variant| number(self.rows(variant, "fused").0, metric));
            let stereo = number(self.rows("", "stereo").0, metric);
            let cell = |variant: &str, estimate: &str| {
                let (row, paper) = self.rows(variant, estimate);
                let all = fused().chain([stereo]);
                let value = number(row, metric);
                let value = if estimate == "mono" {
                    format!("{value:.decimals$}")
                } else {
                    marked(value, all, more_is_better, decimals)
                };
                format!("{value} ({:.2})", number(paper, metric))
            };
            let both = |variant: &str| format!("{} / {}", cell(variant, "mono"), cell(variant, "fused"));
            let _ = writeln!(
                text,
                "| {metric} {} | {} | {} | {} | {} | {} |",
                if more_is_better { '↑' } else { '↓' },
                cell("", "stereo"),
                both("full"),
                cell("no_weighting", "fused"),
                both("no_scaling"),
                cell("average_scaling", "fused")
            );
        }
        text
    }

    fn difference<'a>(&self, rows: &'a [Row], metric: &str) -> &'a Row {
        let is_wanted =
            |row: &&Row| row["score"] == metric && row["variant"] == "no_scaling" && row["estimate"] == "fused";
        rows.iter().find(is_wanted).expect("a difference")
    }

    fn differences(&self) -> String {
        let mut text = "| pixels | metric | stereo | fused, no scaling | difference | 95 % interval | frames better |\n|---|---|---|---|---|---|---|\n".to_owned();
        for (pixels, rows) in [("all", &self.compare), ("common", &self.common)] {
            for metric in ["abs_rel", "a1", "rmse"] {
                let _ = writeln!(
                    text,
                    "| `{pixels}` | {metric} | {}",
                    difference(self.difference(rows, metric), digits(metric))
                );
            }
        }
        text
    }
}

/// Baseline, value, difference, interval and wins of a row of `compare`, as cells.
pub(super) fn difference(row: &Row, decimals: usize) -> String {
    let value = |column: &str| number(row, column);
    format!(
        "{:.decimals$} | {:.decimals$} | {:+.decimals$} | {:+.decimals$} to {:+.decimals$} | {} of {} |",
        value("baseline"),
        value("value"),
        value("difference"),
        value("difference_low"),
        value("difference_high"),
        row["wins"],
        row["frames"]
    )
}

/// A number, bold where it is the best.
fn marked(value: f64, all: impl Iterator<Item = f64>, more_is_better: bool, decimals: usize) -> String {
    let best = all.fold(value, if more_is_better { f64::max } else { f64::min });
    if value == best { format!("**{value:.decimals$}**") } else { format!("{value:.decimals$}") }
}

fn text(value: &Json) -> &str {
    value.as_str().unwrap_or_else(|| panic!("{value}: expected a text"))
}

fn conditions(measured: &Json) -> String {
    format!(
        "Computed on {} with {} on {}. Training took {} of {} minutes.\n",
        text(&measured["date"]),
        text(&measured["engine"]),
        text(&measured["machine"]),
        measured["training_minutes"],
        measured["minutes"]
    )
}

fn engine(measured: &Json) -> String {
    let [date, engine, machine] = ["date", "engine", "machine"].map(|key| text(&measured[key]));
    format!("Computed on {date} with {engine} on {machine}.\n")
}

fn first_build(measured: &Json) -> String {
    let (build, table1) = (&measured["build"], &measured["table1"]);
    format!(
        "The first build takes about {} minutes on {} and up to {} GB of disk; the experiment takes about {} seconds.\n",
        build["minutes"],
        text(&build["machine"]),
        build["gigabytes"],
        table1["seconds"]
    )
}

fn build_time(measured: &Json) -> String {
    let build = &measured["build"];
    format!(
        "The first build takes about {} minutes on {} and up to {} GB of disk for the folder `target/`, because it\ncompiles polars and tract.\n",
        build["minutes"],
        text(&build["machine"]),
        build["gigabytes"]
    )
}

fn speed(measured: &Json) -> String {
    let (speed, table1) = (&measured["speed"], &measured["table1"]);
    let pair = |name: &str| (&speed["ms"][name][0], &speed["ms"][name][1]);
    let (sgbm, hh, bm, fusion) = (pair("sgbm"), pair("hh"), pair("bm"), pair("fusion"));
    format!(
        "- Time per KITTI frame, one thread. Semi-global matching: {} ms ({}: {} ms). Its mode `hh`: {} ms\n  ({} ms). Block \
         matching {} ms ({} ms), the fusion chain {} ms (with NumPy: {} ms). Medians, release build,\n  {}, {} (`bench/stereo.sh`, `bench/fusion.sh`).\n\
         - After a change of the last filter, `experiments/table1.yaml` takes {} s, not {} s: stereo and network are reused.\n",
        sgbm.0,
        text(&speed["peer"]),
        sgbm.1,
        hh.0,
        hh.1,
        bm.0,
        bm.1,
        fusion.0,
        fusion.1,
        text(&speed["machine"]),
        text(&speed["date"]),
        table1["seconds_after_a_change"],
        table1["seconds"]
    )
}

fn memory(measured: &Json) -> String {
    let table1 = &measured["table1"];
    format!(
        "The peak for `experiments/table1.yaml` with {} workers, training included, is {} MB ({}).\n",
        table1["workers"],
        table1["peak_mb"],
        text(&table1["date"])
    )
}

/// A page with its blocks as they are rendered; the names of its blocks.
fn refreshed(page: &str, old: &str, blocks: &BTreeMap<&'static str, String>) -> (String, Vec<String>) {
    const BEGIN: &str = "<!-- generated: ";
    const END: &str = "<!-- end -->";
    let (mut new, mut names) = (String::new(), Vec::new());
    let mut rest = old;
    while let Some(at) = rest.find(BEGIN) {
        let (before, marked) = rest.split_at(at);
        let head = marked.split_once('\n').unwrap_or_else(|| panic!("{page}: a block without lines")).0;
        let name = head[BEGIN.len()..].trim_end_matches("-->").trim();
        let block = blocks.get(name).unwrap_or_else(|| panic!("{page}: `{name}` is not a block of numbers"));
        let end = marked.find(END).unwrap_or_else(|| panic!("{page}: `{name}` has no `{END}`"));
        let _ = write!(new, "{before}{head}\n{block}{END}");
        names.push(name.to_owned());
        rest = &marked[end + END.len()..];
    }
    (new + rest, names)
}

#[test]
fn number_blocks_are_rendered_from_the_measured_files() {
    let blocks = rendered();
    let (mut stale, mut used) = (Vec::new(), Vec::new());
    for page in pages().into_iter().chain([README.to_owned()]) {
        let old = read(&page);
        let (new, names) = refreshed(&page, &old, &blocks);
        used.extend(names);
        if new != old {
            if writes() {
                fs::write(book().join(&page), new).expect("written");
            } else {
                stale.push(page);
            }
        }
    }
    assert_eq!(
        stale, [""; 0],
        "stale: DEPTHLOOM_WRITE_GUIDE=1 cargo test --release -p depthloom --test end_to_end -- guide::numbers"
    );
    used.sort_unstable();
    used.dedup();
    assert_eq!(used, blocks.into_keys().collect::<Vec<_>>(), "blocks that no page shows");
}

#[test]
fn a_block_is_replaced_between_its_marks() {
    let blocks = BTreeMap::from([("a", "new\n".to_owned())]);
    let page = "x\n<!-- generated: a -->\nold\n<!-- end -->\ny\n";
    let (text, names) = refreshed("page", page, &blocks);
    assert_eq!((&*text, names), ("x\n<!-- generated: a -->\nnew\n<!-- end -->\ny\n", vec!["a".to_owned()]));
    assert_eq!(refreshed("page", &text, &blocks).0, text);
}
