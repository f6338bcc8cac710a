//! Which file belongs to which frame.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, Frame, counted};
use depthloom_nodes::predictions::{FileMap, MapReader, maps_in_array};
use depthloom_nodes::sources::images::{Match, files_of_pattern};
use depthloom_terminal::{CliError, ExitCode};

use super::Target;
use crate::args::{EvaluateArgs, MatchOption};

/// The largest number of files that a message lists.
const MOST_LISTED: usize = 5;

/// The files of an estimate.
pub(super) enum Matched {
    /// One per frame, in the order of the frames.
    Files { files: Vec<PathBuf>, how: &'static str, surplus: Vec<PathBuf> },
    /// One array of all frames, and its reader.
    Array(PathBuf, MapReader),
}

/// A way to find the file of a frame by its name.
type Rule = (&'static str, fn(&Match, &Frame) -> bool);

/// In this order: the first that finds a file for every frame is used.
const RULES: [Rule; 4] = [
    ("by id", |file, frame| stem(&file.path) == *frame.id || file.open.join("_") == *frame.id),
    ("by id", |file, frame| contains_word(&stem(&file.path), &frame.id)),
    ("by number", |file, frame| numbers(&stem(&file.path)) == numbers(&frame.id) && !numbers(&frame.id).is_empty()),
    ("by number", |file, frame| first_number(file) == Some(frame.index) || first_number(file) == first(&frame.id)),
];

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Whether `id` is in `text` with no letter or digit beside it.
fn contains_word(text: &str, id: &str) -> bool {
    text.match_indices(id).any(|(at, _)| {
        let is_end = |c: Option<char>| !c.is_some_and(char::is_alphanumeric);
        is_end(text[..at].chars().next_back()) && is_end(text[at + id.len()..].chars().next())
    })
}

fn numbers(text: &str) -> Vec<u64> {
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

fn first(text: &str) -> Option<u64> {
    numbers(text).first().copied()
}

fn first_number(file: &Match) -> Option<u64> {
    let open = file.open.last().map(|open| numbers(open)).unwrap_or_default();
    open.first().copied().or_else(|| first(&stem(&file.path)))
}

pub(super) fn match_files(
    args: &EvaluateArgs,
    name: &str,
    pattern: &str,
    array: Option<&str>,
    frames: &[Frame],
) -> Result<Matched, CliError> {
    let failed = |fault| CliError::from_error(ExitCode::Usage, &fault);
    let files = files_of_pattern(Path::new(""), pattern).map_err(failed)?;
    if files.is_empty() {
        let what = format!("{name}: no file matches `{pattern}`");
        let remedy = match Path::new(pattern).is_dir() {
            true => format!("it is a folder: name its files, e.g. {name}='{}/*.npy'", pattern.trim_end_matches('/')),
            false => "correct the pattern; quote it, so that the shell does not change it".to_owned(),
        };
        return Err(CliError::usage(what, remedy));
    }
    if let Some(file) = files.iter().find(|file| file.path.to_string_lossy().contains(['{', '}'])) {
        let what = format!("{name}: the path {} has braces", file.path.display());
        return Err(CliError::usage(what, "rename it: in an experiment, braces stand for the id of a frame"));
    }
    if let [only] = &files[..]
        && let Some(maps) = maps_in_array(&only.path, array).map_err(failed)?
    {
        if maps != frames.len() as u64 {
            let (path, frames) = (only.path.display(), counted(frames.len(), "frame"));
            let what = format!("{name}: {path} has {maps} maps, and {frames} are evaluated");
            return Err(CliError::usage(what, "select the frames of the array by --frames"));
        }
        return Ok(Matched::Array(only.path.clone(), MapReader::default()));
    }
    let by_order = |how| {
        let (files, surplus) = files.split_at(frames.len());
        let paths = |files: &[Match]| files.iter().map(|file| file.path.clone()).collect();
        Matched::Files { files: paths(files), how, surplus: paths(surplus) }
    };
    if args.match_by == MatchOption::Order {
        if files.len() != frames.len() {
            let (files, frames) = (counted(files.len(), "file"), counted(frames.len(), "frame"));
            let what = format!("{name}: {files} for {frames}, and --match order needs as many");
            return Err(CliError::usage(what, "select frames by --frames, or match by id"));
        }
        return Ok(by_order("by order"));
    }
    let mut best: (usize, Vec<&Frame>) = (0, frames.iter().collect());
    for (how, rule) in RULES {
        let of_frame = |frame: &Frame| {
            let mut found = files.iter().filter(|file| rule(file, frame));
            found.next().filter(|_| found.next().is_none())
        };
        let found: Vec<Option<&Match>> = frames.iter().map(of_frame).collect();
        let used: BTreeSet<&Path> = found.iter().flatten().map(|file| file.path.as_path()).collect();
        let count = found.iter().flatten().count();
        if used.len() < count {
            continue;
        }
        if count == frames.len() {
            let surplus = files.iter().filter(|file| !used.contains(file.path.as_path()));
            let surplus = surplus.map(|file| file.path.clone()).collect();
            return Ok(Matched::Files {
                files: found.into_iter().flatten().map(|file| file.path.clone()).collect(),
                how,
                surplus,
            });
        }
        if count > best.0 {
            let missing = frames.iter().zip(&found).filter(|(_, file)| file.is_none()).map(|(frame, _)| frame);
            best = (count, missing.collect());
        }
    }
    let (count, missing) = best;
    if count == 0 && files.len() == frames.len() {
        return Ok(by_order("by order, because no name has the id of a frame"));
    }
    let ids: Vec<&str> = missing.iter().take(MOST_LISTED).map(|frame| &*frame.id).collect();
    let more = if missing.len() > MOST_LISTED { ", ..." } else { "" };
    let what = format!(
        "{name}: no single file for {} of {}: {}{more}",
        missing.len(),
        counted(frames.len(), "frame"),
        ids.join(", ")
    );
    let example = files.first().map_or_else(String::new, |file| file.path.display().to_string());
    Err(CliError::usage(
        what,
        format!(
            "a file's name must contain the frame's id (found {}, such as {example}); or select frames by --frames, or use --match order",
            counted(files.len(), "file")
        ),
    ))
}

/// The first texts of a list.
fn listed(texts: &[String], between: &str) -> String {
    let more = texts.len().saturating_sub(MOST_LISTED);
    let more = if more > 0 { format!("{between}and {more} more") } else { String::new() };
    format!("{}{more}", texts[..texts.len().min(MOST_LISTED)].join(between))
}

/// Medians of the numbers of two frames that differ by more than this factor have different units.
const SAME_UNIT: f32 = 50.0;

fn warnings(empty: &[String], stretched: &BTreeSet<(u32, u32)>, mut medians: Vec<(f32, String)>) -> Vec<String> {
    let mut warnings = Vec::new();
    if !empty.is_empty() {
        warnings.push(format!("all pixels are invalid in {}", listed(empty, ", ")));
    }
    if stretched.len() > 1 {
        warnings.push(
            "frames have different sizes, but the maps of one array have one size: they are stretched".to_owned(),
        );
    }
    medians.sort_by(|a, b| a.0.total_cmp(&b.0));
    if let (Some((least, first)), Some((most, last))) = (medians.first(), medians.last())
        && most / least > SAME_UNIT
    {
        warnings.push(format!(
            "numbers differ by a factor of {:.0} between {first} and {last}: do they have one unit?",
            most / least
        ));
    }
    warnings
}

impl Matched {
    /// The map of a frame, as its file has it.
    pub(super) fn map(&self, position: usize, array: Option<&str>) -> Result<FileMap, CliError> {
        self.read(position, array).map_err(|fault| CliError::from_error(ExitCode::Usage, &fault))
    }

    const fn frames(&self, all: usize) -> usize {
        match self {
            Self::Files { files, .. } => files.len(),
            Self::Array(..) => all,
        }
    }

    /// Reads every map, and reports all that is wrong with them. Returns warnings.
    pub(super) fn check(
        &self,
        args: &EvaluateArgs,
        name: &str,
        (array, invalid): (Option<&str>, Option<f64>),
        target: &Target,
    ) -> Result<Vec<String>, CliError> {
        let (mut wrong, mut empty, mut sizes, mut medians) = (Vec::new(), Vec::new(), 0, Vec::new());
        // Most frames have the size of the first: images are read only where a map has another.
        let usual = target.image_size(0)?;
        let frames = self.frames(target.frames().len());
        let mut stretched = BTreeSet::new();
        for position in 0..frames {
            let called = self.called(position, target);
            let map = match self.read(position, array) {
                Ok(map) => map,
                Err(fault) => {
                    wrong.push(fault.chain());
                    continue;
                }
            };
            let (width, height) = map.numbers.dimensions();
            let image = if (width, height) == usual { usual } else { target.image_size(position)? };
            if args.resize.is_none() && (width, height) != image {
                sizes += 1;
                let (columns, rows) = image;
                wrong.push(format!("{called} is {width}x{height}, and the image is {columns}x{rows}"));
                continue;
            }
            if args.resize.is_some() && matches!(self, Self::Array(..)) {
                stretched.insert(target.image_size(position)?);
            }
            let mut numbers: Vec<f32> = map.numbers.iter().copied().filter(|number| *number > 0.0).collect();
            numbers.retain(|number| number.is_finite() && Some(f64::from(*number)) != invalid);
            let middle = numbers.len() / 2;
            match numbers.is_empty() {
                true => empty.push(called),
                false => medians.push((*numbers.select_nth_unstable_by(middle, f32::total_cmp).1, called)),
            }
        }
        if wrong.is_empty() && empty.len() == frames {
            let what = format!("{name}: no file has a valid number");
            return Err(CliError::usage(what, "check --invalid, and how the files were written"));
        }
        if wrong.is_empty() {
            return Ok(warnings(&empty, &stretched, medians));
        }
        let count = wrong.len();
        let what = format!("{name}: {} cannot be used:\n  {}", counted(count, "map"), listed(&wrong, "\n  "));
        Err(CliError::usage(
            what,
            if sizes == count {
                "if they are predictions for these images, set `--resize bilinear`, or `--resize nearest` for sparse maps"
            } else {
                "write these files again, name an array of them by --array, or select other frames by --frames"
            },
        ))
    }

    fn called(&self, position: usize, target: &Target) -> String {
        match self {
            Self::Files { files, .. } => files[position].display().to_string(),
            Self::Array(path, _) => format!("the map of {} in {}", target.frames()[position].id, path.display()),
        }
    }

    fn read(&self, position: usize, array: Option<&str>) -> Result<FileMap, Fault> {
        match self {
            Self::Files { files, .. } => MapReader::default().read(&files[position], array, None),
            Self::Array(path, reader) => reader.read(path, array, Some(position as u64)),
        }
    }

    pub(super) fn text(&self) -> String {
        match self {
            Self::Files { files, how, .. } => format!("{}, matched {how}", counted(files.len(), "file")),
            Self::Array(path, _) => format!("the array {}, one map per frame in their order", path.display()),
        }
    }

    pub(super) fn warnings(&self) -> Vec<String> {
        let Self::Files { surplus, how, .. } = self else { return Vec::new() };
        let mut warnings = Vec::new();
        if !surplus.is_empty() {
            let named: Vec<String> = surplus.iter().take(3).map(|path| path.display().to_string()).collect();
            let more = if surplus.len() > 3 { ", ..." } else { "" };
            let verbs = if surplus.len() == 1 { "matches no frame and is" } else { "match no frame and are" };
            let count = counted(surplus.len(), "file");
            warnings.push(format!("{count} {verbs} not used: {}{more}", named.join(", ")));
        }
        if how.contains("because") {
            warnings.push(
                "files are matched to frames by order: check that the first file is that of the first frame".to_owned(),
            );
        }
        warnings
    }
}
