//! Allowed names, and suggestions for misspelt ones.

use std::sync::Arc;

use super::diagnostics::{Diagnostic, Report};
use super::source_file::{Place, SourceFile};
use super::tree::{Entry, Node};

pub(crate) const EXPERIMENT_KEYS: &[&str] =
    &["experiment", "description", "extends", "sources", "stages", "variants", "matrix", "only", "labels", "record"];

/// Words of the language.
pub(crate) const RESERVED_NODES: &[&str] = &["source", "score", "graph"];
pub(crate) const RESERVED_STAGES: &[&str] = &["sources", "stages", "record"];

/// Characters; names become topics, labels and parts of paths.
const LONGEST: usize = 100;

/// `what` is the named thing with its article: `a node`.
pub(crate) fn check(name: &str, what: &str, reserved: &[&str], place: &Place, report: &mut Report) -> bool {
    allowed(name, what, "letters, digits, `_` and `-`", &['_', '-'], reserved, place, report)
}

/// Checks the new name of a stage, node, source, variant or estimate; `what` is the named thing with its article:
/// `a node`.
///
/// # Errors
/// Why it cannot be its name.
pub fn check_name(name: &str, what: &str) -> Result<(), String> {
    let reserved = match what {
        "a node" => RESERVED_NODES,
        "a stage" => RESERVED_STAGES,
        _ => &[],
    };
    let mut report = Report::default();
    let place = Place::start_of(&Arc::new(SourceFile::new("", name, "")));
    if check(name, what, reserved, &place, &mut report) {
        return Ok(());
    }
    let found = report.finish(&[]);
    let texts = found.iter().map(|found| match &found.help {
        Some(help) => format!("{}: {help}", found.message),
        None => found.message.clone(),
    });
    Err(texts.collect::<Vec<_>>().join("; "))
}

/// A run without `--out` writes to `runs/<name>`.
pub(crate) fn check_experiment(name: &str, place: &Place, report: &mut Report) -> bool {
    let what = "an experiment";
    let bad = name.starts_with(['.', ' ']).then_some("begin").or_else(|| name.ends_with([' ', '.']).then_some("end"));
    if let Some(verb) = bad {
        let what = format!("the name of {what} cannot {verb} with `.` or a space");
        let error = Diagnostic::error(place, what).label("not a name for an experiment");
        report.push(error.help("its runs are written to a folder of that name"));
        return false;
    }
    allowed(name, what, "letters, digits, `_`, `-`, `.` and spaces", &['_', '-', '.', ' '], &[], place, report)
}

fn allowed(
    name: &str,
    what: &str,
    form: &str,
    others: &[char],
    reserved: &[&str],
    place: &Place,
    report: &mut Report,
) -> bool {
    let allowed = |c: char| c.is_alphanumeric() || others.contains(&c);
    if reserved.contains(&name) {
        let error =
            Diagnostic::error(place, format!("`{name}` cannot name {what}: the language uses that word itself"));
        report.push(error.help("choose another name"));
        return false;
    }
    if name.is_empty() {
        report.push(Diagnostic::error(place, format!("{what} needs a name")));
        return false;
    }
    if name.chars().count() > LONGEST {
        let error = Diagnostic::error(place, format!("the name of {what} is longer than {LONGEST} characters"));
        report
            .push(error.label(format!("not a name for {what}")).help("`description:` takes as many words as you like"));
        return false;
    }
    let Some(bad) = name.chars().find(|&c| !allowed(c)) else { return true };
    let suggestion: String = name.chars().map(|c| if allowed(c) { c } else { '_' }).collect();
    report.push(
        Diagnostic::error(place, format!("the name of {what} cannot hold `{}`", bad.escape_debug()))
            .label(format!("not a name for {what}"))
            .help(format!("names are {form}, e.g. `{}`", suggestion.trim_start_matches('.'))),
    );
    false
}

/// Words of version 0.1 and what they are called now.
const RENAMED: [(&str, &str); 7] = [
    ("about", "description"),
    ("answered", "valid"),
    ("join", "concat"),
    ("paper", "martins2018"),
    ("set", "paths"),
    ("true-disparity", "ground-truth-disparity"),
    ("truth", "ground_truth"),
];

/// What a word of version 0.1 is called now, if that is one of the candidates.
pub(crate) fn new_name(written: &str, candidates: &[&str]) -> Option<&'static str> {
    RENAMED.iter().find(|(old, new)| *old == written && candidates.contains(new)).map(|(_, new)| *new)
}

/// The help for a word of version 0.1.
pub(crate) fn renamed(written: &str, candidates: &[&str]) -> Option<String> {
    let new = new_name(written, candidates)?;
    Some(format!("`{written}` is called `{new}` since version 0.2"))
}

/// The help for a key of version 0.1, with the corrected line.
pub(crate) fn renamed_key(entry: &Entry, candidates: &[&str]) -> Option<String> {
    let new = new_name(&entry.key, candidates)?;
    Some(format!("{}: write `{new}: {}`", renamed(&entry.key, candidates)?, short_value(&entry.value)))
}

/// [`suggestion`] for a key, with the corrected line if the key was renamed.
pub(crate) fn key_suggestion(entry: &Entry, candidates: &[&str]) -> Option<String> {
    renamed_key(entry, candidates).or_else(|| suggestion(&entry.key, "keys known here", candidates))
}

/// A value as the line of a help shows it: maps, lists and texts that do not fit are abbreviated.
pub(crate) fn short_value(value: &Node) -> &str {
    const LONGEST: usize = 60;
    let text = value.place.text().trim_end();
    match text.chars().next() {
        Some(_) if text.len() <= LONGEST && !text.contains('\n') => text,
        Some('[' | '-') => "[...]",
        Some('{') => "{ ... }",
        _ => "...",
    }
}

/// The candidate nearest to what was written, if one is near.
pub fn nearest<'a>(written: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Limits for foreign files: a distance costs the product of the lengths.
    const MOST: usize = 2000;
    if written.len() > 100 {
        return None;
    }
    let lower = written.to_lowercase();
    let distance = |candidate: &str| {
        let candidate = candidate.to_lowercase();
        if candidate.replace(['_', '-'], "") == lower.replace(['_', '-'], "") {
            return 0;
        }
        strsim::damerau_levenshtein(&lower, &candidate)
    };
    let near = |candidate: &str, distance: usize| {
        let length = lower.chars().count().max(candidate.chars().count());
        // A third of the word may be wrong; or one is the beginning of the other.
        distance * 3 <= length.max(3)
            || (lower.len() >= 3
                && (candidate.starts_with(&lower) || lower.starts_with(candidate) && candidate.len() >= 3))
            || (lower.len() >= 3 && candidate.ends_with(&lower))
    };
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates.into_iter().take(MOST).filter(|candidate| candidate.len() <= 200) {
        let distance = distance(candidate);
        if near(candidate, distance) && best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

pub(crate) fn suggestion(written: &str, what: &str, candidates: &[&str]) -> Option<String> {
    if candidates.is_empty() {
        return Some(format!("there are no {what}"));
    }
    if let Some(renamed) = renamed(written, candidates) {
        return Some(renamed);
    }
    Some(match nearest(written, candidates.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("{what}: {}", listed(candidates)),
    })
}

pub(crate) fn listed(names: &[&str]) -> String {
    const MOST: usize = 16;
    let quoted: Vec<String> = names.iter().take(MOST).map(|name| format!("`{name}`")).collect();
    let more = names.len().saturating_sub(MOST);
    if more > 0 { format!("{} and {more} more", quoted.join(", ")) } else { quoted.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn the_nearest_name_is_found_and_far_ones_are_not_offered() {
        assert_eq!(nearest("disparites", ["disparities", "block"]), Some("disparities"));
        assert_eq!(nearest("Mode", ["mode"]), Some("mode"));
        assert_eq!(nearest("num-disparities", ["num_disparities"]), Some("num_disparities"));
        assert_eq!(nearest("sgbm", ["stereo/sgbm", "stereo/bm"]), Some("stereo/sgbm"));
        assert_eq!(nearest("zebra", ["disparities", "block"]), None);
        assert_eq!(nearest(&"x".repeat(1 << 20), ["disparities"]), None);
    }
}
