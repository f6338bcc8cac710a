//! Invalid and unusual experiment files.
//!
//! - `neutral`: edits that mean nothing in YAML (comments, empty lines, line ends, quotes) leave the plan as it was.
//! - `broken`: edits that no reading can make right are an error of `check`, `plan`, `graph` and `run`, with exit 2.
//! - `hostile`: anything in any place: an error or an answer, and all four of one mind whether the file is right.
//! - `values`: hostile values under known parameters, run with bounded memory. A run with large values may take long: a
//!   running program gets a signal to stop, and only one that ignores it hangs.

use std::fs;
use std::time::Duration;

use crate::case::Case;
use crate::child::{Ended, program};
use crate::ground::{LEARN, STREET};
use crate::verdict::{Verdict, fault, judge};
use depthloom_test_needs::random::Random;

/// Values in the place where a value is expected.
const PIECES: [&str; 74] = [
    "null",
    "~",
    ".nan",
    ".inf",
    "-.inf",
    "0",
    "-1",
    "-0",
    "1e308",
    "1e-308",
    "1e400",
    "99999999999999999999",
    "-9223372036854775809",
    "18446744073709551615",
    "0x7fffffffffffffff",
    "0o17",
    "017",
    "0b1",
    "1_000",
    "+1",
    ".5",
    "5.",
    "\"\"",
    "''",
    "' '",
    "\"\\0\"",
    "\"\\uD800\"",
    "\"\\x7f\"",
    "../../evil",
    "/etc/passwd",
    "/dev/zero",
    "~/x",
    "CON",
    "a/b",
    "a.b",
    "\u{202e}txt",
    "\u{1f600}",
    "\u{0}",
    "{}",
    "[]",
    "[[[[[[[[]]]]]]]]",
    "{a: {b: {c: {}}}}",
    "[,]",
    "{,}",
    "[",
    "]",
    "{",
    "}",
    "&a [*a]",
    "*a",
    "&a",
    "!!binary aGk=",
    "!!str 1",
    "!!int \"1\"",
    "!!python/object:os.system x",
    "!x",
    "<<: *x",
    "${HOME}",
    "${UNSET_VARIABLE}",
    "${",
    "$",
    "${HOME:-x}",
    "true",
    "yes",
    "2001-01-01",
    "|\n   text",
    ">",
    "? a : b",
    "0..18446744073709551615",
    "5..2",
    "0..=0",
    "-5..5",
    "@x",
    "`x`",
];

/// Parameters of [`STREET`], and values that a person may well give them.
const PARAMETERS: [(&str, &[&str]); 20] = [
    ("sources.street.with.frames", &["0..1", "[3, 1]", "[1, 1]", "999999..=999999", "0..0", "2..4"]),
    ("sources.street.with.seed", &["0", "18446744073709551615"]),
    ("sources.street.with.width", &["16", "17", "33", "8192"]),
    ("sources.street.with.height", &["16", "17", "33", "8192"]),
    ("sources.street.with.ground_truth", &["noc", "occ"]),
    ("look.stereo.with.disparities", &["16", "96", "2032"]),
    ("look.stereo.with.mode", &["hh", "3way", "hh4"]),
    ("look.stereo.with.p1", &["0", "1", "65535"]),
    ("look.stereo.kind", &["stereo/bm", "stereo/census-sgm"]),
    ("look.depth.with.cap", &["null", "1.0e-30", "1.0e+30"]),
    ("look.mono.with.cap", &["null", "1.0e-30", "1.0e+30"]),
    ("look.mono.with.height_m", &["1.0e-30", "1.0e+30"]),
    ("look.weight.kind", &["confidence/edges"]),
    ("look.weight.with.sigma", &["1.0e-3", "1000"]),
    ("look.scaled.with.method", &["none", "average"]),
    ("look.merged.with.weighting", &["confidence", "mean"]),
    ("record.every", &["1", "2", "1000"]),
    ("record", &["[]", "[depth]", "['*']"]),
    ("experiment", &["a", "a b", "run"]),
    ("look.score.preset", &["martins2018", "kitti"]),
];

pub(crate) fn neutral(case: &mut Case<'_>) -> Verdict {
    let original = base(case);
    let mut text = original.clone();
    for _ in 0..1 + case.random.below(4) {
        let lines: Vec<&str> = text.lines().collect();
        let at = case.random.below(lines.len() + 1);
        text = match case.random.below(7) {
            0 => insert(&lines, at, "# a comment: { [ * & !"),
            1 => insert(&lines, at, ""),
            2 => insert(&lines, at, "      "),
            3 => text.replace('\n', " \n"),
            4 => format!("# head\n\n{text}\n\n# tail"),
            5 => text.replace("experiment: ", "\"experiment\": "),
            _ => text.replace("kind: stereo/sgbm", "kind: 'stereo/sgbm'"),
        };
    }
    if case.random.chance(4) {
        text = text.replace('\n', "\r\n");
    }
    case.write("original.yaml", &original);
    case.write("experiment.yaml", &text);
    let [before, after] =
        ["original.yaml", "experiment.yaml"].map(|file| case.run(&mut case.depthloom(&["plan", "--json", file])));
    let verdict = judge(&after, || match before.stdout == after.stdout {
        true => Verdict::Equal,
        false => Verdict::different("an edit that means nothing gives another plan"),
    });
    match verdict {
        Verdict::Error => Verdict::different(format!("an edit that means nothing is an error: {}", after.summary())),
        verdict => verdict,
    }
}

pub(crate) fn broken(case: &mut Case<'_>) -> Verdict {
    let original = base(case);
    let broken: [(&str, &str); 22] = [
        ("stages:", "stages: 5\nstages:"),
        ("experiment: ", "experiment: again\nexperiment: "),
        ("kind: stereo/sgbm", "kind: stereo/sgbn"),
        ("kind: stereo/sgbm", "kind: [stereo/sgbm]"),
        ("kind: stereo/sgbm", "kind: stereo/sgbm, kind: stereo/sgbm"),
        ("source/left", "source/lefd"),
        ("source/left", "source"),
        ("source/left", "5"),
        ("source/left", "/"),
        ("inputs: {", "inputs: { another: source/left, "),
        ("disparities: 32", "disparities: 33"),
        ("disparities: 32", "disparities: .nan"),
        ("disparities: 32", "disparities: many"),
        ("disparities: 32", "dispairities: 32"),
        ("width: 96", "width: -96"),
        ("width: 96", "width: 96, width: 96"),
        ("    nodes:", "\tnodes:"),
        ("sources:", "sources: }"),
        ("stages:", "stages: {"),
        ("ground_truth: source/depth", "ground_truth: source/left"),
        ("frames: 0..", "frames: 9..0, x: 0.."),
        ("\n", "\n- a list in a map\n"),
    ];
    let (what, instead) = case.random.pick(&broken);
    let places: Vec<usize> = original.match_indices(what).map(|(at, _)| at).collect();
    let Some(&at) = places.get(case.random.below(places.len().max(1))) else { return Verdict::Equal };
    let text = format!("{}{instead}{}", &original[..at], &original[at + what.len()..]);
    case.note(format!("`{instead}` in place of `{what}` at byte {at}"));
    case.write("experiment.yaml", text);
    for command in ["check", "plan", "graph", "run"] {
        let ended = case.run(&mut case.depthloom(&[command, "experiment.yaml"]));
        match fault(&ended) {
            Some(fault) => return fault,
            None if ended.code == Some(2) => {}
            None => return Verdict::different(format!("{command} of a broken file: {}", ended.summary())),
        }
    }
    Verdict::Error
}

pub(crate) fn hostile(case: &mut Case<'_>) -> Verdict {
    let mut text = base(case);
    for _ in 0..1 + case.random.below(4).saturating_sub(1) {
        text = mutated(&mut case.random, &text);
    }
    let bytes = if case.random.chance(8) {
        let mut bytes = text.into_bytes();
        case.random.flip(&mut bytes);
        bytes
    } else {
        text.into_bytes()
    };
    case.write("experiment.yaml", bytes);
    let commands = ["check", "plan", "graph"];
    let ends = commands.map(|command| case.run(&mut case.depthloom(&[command, "experiment.yaml"])));
    if let Some(fault) = ends.iter().find_map(fault) {
        return fault;
    }
    match ends.map(|ended| ended.code) {
        [Some(0), Some(0), Some(0)] => Verdict::Equal,
        [Some(2), Some(2), Some(2)] => Verdict::Error,
        codes => Verdict::different(format!("check, plan and graph are not of one mind: {codes:?}")),
    }
}

pub(crate) fn values(case: &mut Case<'_>) -> Verdict {
    if program("prlimit").is_none() {
        return Verdict::Skipped("this machine has no `prlimit`".to_owned());
    }
    let mut arguments: Vec<String> = ["run", "experiment.yaml", "--out", "run"].map(str::to_owned).to_vec();
    for _ in 0..1 + case.random.below(2) {
        let (path, known) = case.random.pick(&PARAMETERS);
        let value = if case.random.chance(2) { case.random.pick(known) } else { case.random.pick(&PIECES) };
        if !value.contains('\0') {
            arguments.extend(["--set".to_owned(), format!("{path}={value}")]);
        }
    }
    case.write("experiment.yaml", STREET);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    // The system refuses memory beyond this.
    let mut running = case.start(&mut case.depthloom_by(&["prlimit", "--as=2147483648"], &arguments));
    running.wait(Duration::from_secs(5));
    let long = !running.has_ended();
    running.signal("TERM");
    let ended = case.end(running);
    match (fault(&ended), long) {
        (Some(fault), _) => fault,
        (None, true) => Verdict::Error,
        (None, false) => finished(case, &ended),
    }
}

/// A run that ended by itself has a folder exactly if it reports success.
fn finished(case: &Case<'_>, ended: &Ended) -> Verdict {
    let exists = fs::metadata(case.at("run").join("recording.mcap")).is_ok();
    match (ended.code, exists) {
        (Some(0), true) => Verdict::Equal,
        (Some(3), _) | (Some(1 | 2), false) => Verdict::Error,
        _ => Verdict::different(format!(
            "{}, and the folder is {}",
            ended.summary(),
            if exists { "there" } else { "not there" }
        )),
    }
}

fn base(case: &mut Case<'_>) -> String {
    case.random.pick(&[STREET, LEARN]).to_string()
}

fn insert(lines: &[&str], at: usize, line: &str) -> String {
    let mut lines = lines.to_vec();
    lines.insert(at, line);
    lines.join("\n") + "\n"
}

fn mutated(random: &mut Random, text: &str) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let mut changed: Vec<String> = lines.iter().map(|&line| line.to_owned()).collect();
    if changed.is_empty() {
        return (random.pick(&PIECES)).to_owned();
    }
    let (at, other) = (random.below(lines.len()), random.below(lines.len()));
    match random.below(18) {
        0 => drop(changed.remove(at)),
        1 => changed.insert(at, lines[other].to_owned()),
        2 => changed.swap(at, other),
        3 => changed[at] = format!(" {}", changed[at]),
        4 => changed[at] = changed[at].trim_start().to_owned(),
        5 => {
            changed[at].push_str(random.pick(&PIECES));
        }
        6 => changed.truncate(at),
        7 => changed.insert(at, nested(random)),
        8 => changed[at] = changed[at].replacen(": ", ": &x ", 1),
        9 => changed[at] = changed[at].replacen(": ", ": *x ", 1),
        10 => changed[at] = changed[at].replacen(": ", ":", 1),
        // What may well be right.
        11 => changed.insert(at, format!("description: {}", random.pick(&PIECES))),
        12 => changed.insert(0, format!("description: {}", random.pick(&PIECES))),
        13 => {
            let digits = ["1", "2", "3", "4", "5", "6", "8", "9"];
            let [from, to] = [random.pick(&digits), random.pick(&digits)];
            changed[at] = changed[at].replace(from, to);
        }
        _ => return replaced(random, text),
    }
    changed.join("\n") + "\n"
}

/// One value or key, replaced by a piece.
fn replaced(random: &mut Random, text: &str) -> String {
    let ends = |c: char| ",}]\n".contains(c);
    let starts: Vec<usize> = text.match_indices(": ").map(|(at, _)| at).collect();
    let Some(&colon) = starts.get(random.below(starts.len().max(1))) else { return text.to_owned() };
    let piece = random.pick(&PIECES);
    if random.chance(5) {
        let start = text[..colon].rfind([' ', '\n', '{', ',']).map_or(0, |at| at + 1);
        return format!("{}{piece}{}", &text[..start], &text[colon..]);
    }
    let start = colon + 2;
    let end = text[start..].find(ends).map_or(text.len(), |at| start + at);
    format!("{}{piece}{}", &text[..start], &text[end..])
}

/// Deep, wide or self-similar.
fn nested(random: &mut Random) -> String {
    let count = 1 << random.within(4..16);
    match random.below(5) {
        0 => format!("deep: {}", "[".repeat(count)),
        1 => format!("deep: {}{}", "{a: ".repeat(count.min(4096)), "}".repeat(count.min(4096))),
        2 => format!("long: {}", "x".repeat(count)),
        3 => (0..count.min(4096)).map(|key| format!("k{key}: {key}\n")).collect(),
        _ => {
            let mut text = "a0: &a0 [x, x]\n".to_owned();
            (1..40).for_each(|n| text.push_str(&format!("a{n}: &a{n} [*a{0}, *a{0}]\n", n - 1)));
            text
        }
    }
}
