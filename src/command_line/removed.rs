//! Commands and options of version 0.1 that have other names now: an error names the new one and shows the corrected
//! command.

use clap::error::ErrorKind;

/// A removed command, and the words that replace it.
const COMMANDS: [(&[&str], &[&str]); 8] = [
    (&["data"], &["inspect"]),
    (&["info"], &["inspect"]),
    (&["onnx"], &["inspect"]),
    (&["replay"], &["verify"]),
    (&["recover"], &["runs", "recover"]),
    (&["timings"], &["runs", "timings"]),
    (&["samples"], &["analyse", "--samples-only"]),
    (&["runs", "why"], &["runs", "diff"]),
];

/// Commands, an option that was removed from them, and the option that replaces it; `None` if it is not needed any
/// more.
const OPTIONS: [(&[&str], &str, Option<&str>); 14] = [
    (&["table", "compare", "explain", "analyse", "analyze", "figure"], "--set", Some("--pixels")),
    (&["table", "compare", "analyse", "analyze", "figure"], "--estimators", Some("--estimates")),
    (&["compare"], "--scores", Some("--metrics")),
    (&["figure"], "--scores", Some("--metric")),
    (&["compare"], "--score", Some("--metrics")),
    (&["figure"], "--score", Some("--metric")),
    (&["figure"], "--thin", Some("--min-count")),
    (&["figure"], "--most", Some("--y-max")),
    (&["figure"], "--data", Some("--csv")),
    (&["analyse", "analyze"], "--gross", Some("--outlier")),
    (&["inspect", "data"], "--sheet", Some("--contact-sheet")),
    (&["info", "inspect"], "--check", Some("--verify-bytes")),
    (&["verify", "replay"], "--check", None),
    (&["schema"], "--output", Some("--of")),
];

/// The error for arguments with a removed command or option.
pub(super) fn error(command: &mut clap::Command) -> Option<clap::Error> {
    let words: Vec<String> = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let (message, corrected) = corrected(&words)?;
    let shown: Vec<String> = corrected.iter().map(|word| quoted(word)).collect();
    let message = format!("{message}\n\n  tip: use `depthloom {}`", shown.join(" "));
    Some(command.error(ErrorKind::UnknownArgument, message))
}

/// A message on the first removed name in the arguments, and the corrected arguments.
fn corrected(words: &[String]) -> Option<(String, Vec<String>)> {
    let mut messages = Vec::new();
    // An option of the program, which has a value of its own, may be in front of the command.
    let mut start = 0;
    while words.get(start)?.starts_with('-') {
        start += if words[start] == "--color" { 2 } else { 1 };
    }
    let name = words[start].clone();
    let is_of =
        |old: &[&str]| old.iter().enumerate().all(|(at, word)| words.get(start + at).is_some_and(|w| w == word));
    let replaced = COMMANDS.iter().find(|(old, _)| is_of(old));
    let mut corrected = words[..start].to_vec();
    let rest = match replaced {
        Some((old, new)) => {
            messages.push(format!("the command `{}` was renamed to `{}`", old.join(" "), new.join(" ")));
            corrected.extend(new.iter().map(|word| (*word).to_owned()));
            &words[start + old.len()..]
        }
        None => {
            corrected.push(name.clone());
            &words[start + 1..]
        }
    };
    let is_of_runs = name == "runs";
    let mut is_positional = false;
    for word in rest {
        let (option, value) = match word.split_once('=') {
            Some((option, value)) => (option, Some(value)),
            None => (word.as_str(), None),
        };
        is_positional |= word == "--";
        let known = OPTIONS.iter().find(|(names, old, _)| names.contains(&name.as_str()) && *old == option);
        let new = match known {
            Some((.., new)) => Some(*new),
            None if is_of_runs && option == "--in" => Some(Some("--runs")),
            None => None,
        };
        match new.filter(|_| !is_positional) {
            None => corrected.push(word.clone()),
            Some(new) => {
                messages.push(match new {
                    Some(new) => format!("the option `{option}` was renamed to `{new}`"),
                    None => format!("the option `{option}` is not needed any more"),
                });
                if let Some(new) = new {
                    corrected.push(value.map_or_else(|| new.to_owned(), |value| format!("{new}={value}")));
                }
            }
        }
    }
    if let Some(answered) = pixel_set_answered(&corrected) {
        messages.push("the pixel set `answered` was renamed to `valid`".to_owned());
        corrected[answered] = corrected[answered].replace("answered", "valid");
    }
    if messages.is_empty() { None } else { Some((messages.join("; "), corrected)) }
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

/// The place of the word with the pixel sets, if they contain `answered`.
fn pixel_set_answered(words: &[String]) -> Option<usize> {
    let is_answered = |sets: &str| sets.split(',').any(|set| set == "answered");
    let place = words.iter().position(|word| *word == "--pixels").map(|option| option + 1);
    let place = place.or_else(|| words.iter().position(|word| word.starts_with("--pixels=")))?;
    is_answered(words.get(place)?.trim_start_matches("--pixels=")).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::{COMMANDS, OPTIONS, corrected};
    use clap::CommandFactory as _;

    use crate::args::Cli;

    fn correct(line: &str) -> Option<(String, String)> {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        corrected(&words).map(|(message, words)| (message, words.join(" ")))
    }

    #[test]
    fn removed_names_are_corrected() {
        for (line, right) in [
            ("data /data/kitti --sheet a.png", "inspect /data/kitti --contact-sheet a.png"),
            ("info RUN --check --keys", "inspect RUN --verify-bytes --keys"),
            ("onnx net.onnx", "inspect net.onnx"),
            ("replay RUN --check fused", "verify RUN fused"),
            ("--color never timings RUN --json", "--color never runs timings RUN --json"),
            ("recover X.partial --out a.mcap", "runs recover X.partial --out a.mcap"),
            ("samples RUN", "analyse --samples-only RUN"),
            ("runs why a b", "runs diff a b"),
            ("runs --in /data list", "runs --runs /data list"),
            ("table RUN --set=all", "table RUN --pixels=all"),
            ("compare RUN --scores d1 --set common", "compare RUN --metrics d1 --pixels common"),
            ("figure RUN cdf --most 3 --thin 5 --data a.csv", "figure RUN cdf --y-max 3 --min-count 5 --csv a.csv"),
            ("schema --output run", "schema --of run"),
            ("table RUN --set answered", "table RUN --pixels valid"),
            ("analyse RUN --pixels=all,answered", "analyse RUN --pixels=all,valid"),
            ("figure RUN cdf --scores rmse", "figure RUN cdf --metric rmse"),
        ] {
            assert_eq!(correct(line).map(|(_, corrected)| corrected).as_deref(), Some(right), "{line}");
        }
        let (message, _) = correct("replay RUN --check").unwrap();
        assert!(message.starts_with("the command `replay` was renamed to `verify`; "), "{message}");
        for line in ["run first.yaml --set a=1", "check first.yaml --data", "table RUN -- --set", "--json"] {
            assert_eq!(correct(line), None, "{line}");
        }
    }

    #[test]
    fn new_names_exist_and_old_names_do_not() {
        let program = Cli::command();
        for (old, new) in COMMANDS {
            let find = |words: &[&str]| words.iter().try_fold(&program, |at, word| at.find_subcommand(word)).is_some();
            let new: Vec<&str> = new.iter().copied().filter(|word| !word.starts_with('-')).collect();
            assert!(find(&new) && !find(old), "{old:?}");
        }
        for (names, old, new) in OPTIONS {
            for name in names {
                let Some(command) = program.find_subcommand(name) else { continue };
                let has = |option: &str| command.get_arguments().any(|arg| arg.get_long() == option.strip_prefix("--"));
                assert!(!has(old) && new.is_none_or(has), "{name} {old}");
            }
        }
    }
}
