//! Pairs images, and finds their ground truth, by names, by order if names have nothing in common, or by a list. Images
//! of a single camera have no right image.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};

use depthloom_graphs::{Fault, regular_file};

use crate::sources::dataset::folders::existing_file;
use crate::sources::images::globs::{Match, files};

const SAY: &str = "write the text that differs between left and right, and `*` for the rest, as in `*_left.png` and `*_right.png`, or set \
    `list:`, a CSV file with the columns left[,right][,ground_truth][,frame]";

#[derive(Debug)]
pub(super) struct Row {
    pub id: String,
    pub left: PathBuf,
    /// `None` for a single camera.
    pub right: Result<Option<PathBuf>, Fault>,
    pub truth: Result<Option<PathBuf>, Fault>,
}

#[derive(Debug, Default)]
pub(super) struct Pairs {
    pub rows: Vec<Row>,
    /// Faults that belong to no selected frame.
    pub faults: Vec<Fault>,
    pub warnings: Vec<String>,
    /// Files of frames without a left image: a run leaves them out.
    pub unpaired: Vec<String>,
}

pub(super) fn by_names(root: &Path, left: &str, right: Option<&str>, truth: Option<&str>) -> Result<Pairs, Vec<Fault>> {
    let named = |pattern: &str| {
        let found = files(root, pattern)?;
        let place = root.join(pattern);
        match found.is_empty() {
            true => Err(Fault::new(format!("no file is named {}", place.display())).remedy(
                "patterns are relative to `root`; `*` stands for any text within the name of a file or folder",
            )),
            false => Ok(found),
        }
    };
    let truths = truth.map(named).transpose();
    let rights = right.map(named).transpose();
    let (lefts, rights, truths) = match (named(left), rights, truths) {
        (Ok(lefts), Ok(rights), Ok(truths)) => (lefts, rights, truths),
        (left, right, truth) => return Err([left.err(), right.err(), truth.err()].into_iter().flatten().collect()),
    };
    let mut pairs = Pairs::default();
    let rights = match (rights, right) {
        (Some(rights), Some(right)) => right_images(root, (left, &lefts), (right, &rights), &mut pairs)?,
        _ => lefts.iter().map(|_| Ok(None)).collect(),
    };
    let truths = match truths {
        Some(truths) => {
            let partners = partners(&lefts, &truths, ("left", "ground_truth")).map_err(|fault| vec![fault])?;
            pairs.warnings.extend(partners.warning.clone());
            let without =
                lefts.iter().zip(&partners.positions).filter(|(_, partner)| partner.is_none()).map(|(left, _)| left);
            pairs.warnings.extend(left_over(&without.collect::<Vec<_>>(), "left image", "ground truth"));
            pairs.unpaired.extend(left_over(&partners.without(&truths), "ground-truth file", "left image"));
            partners.positions.into_iter().map(|partner| partner.map(|at| truths[at].path.clone())).collect()
        }
        None => vec![None; lefts.len()],
    };
    for ((one, right), truth) in lefts.iter().zip(rights).zip(truths) {
        pairs.rows.push(Row { id: one.name(), left: one.path.clone(), right, truth: Ok(truth) });
    }
    make_ids_unique(&mut pairs, root);
    Ok(pairs)
}

/// The right image of each left image.
fn right_images(
    root: &Path,
    (left, lefts): (&str, &[Match]),
    (right, rights): (&str, &[Match]),
    pairs: &mut Pairs,
) -> Result<Vec<Result<Option<PathBuf>, Fault>>, Vec<Fault>> {
    let of_rights: BTreeSet<&Path> = rights.iter().map(|right| right.path.as_path()).collect();
    if let Some(both) = lefts.iter().find(|one| of_rights.contains(one.path.as_path())) {
        let what = format!("{} is a left and a right image: `{left}` and `{right}` both name it", both.path.display());
        return Err(vec![Fault::new(what).remedy(SAY)]);
    }
    let partners = partners(lefts, rights, ("left", "right")).map_err(|fault| vec![fault])?;
    pairs.warnings.extend(partners.warning.clone());
    pairs.unpaired.extend(left_over(&partners.without(rights), "right image", "left image"));
    let partner = |(one, partner): (&Match, &Option<usize>)| match partner {
        Some(at) => Ok(Some(rights[*at].path.clone())),
        None => {
            let what = format!("{} has no right image among {}", one.path.display(), root.join(right).display());
            Err(Fault::new(what).remedy(
                "each left image needs a right image; remove left images without one, or exclude them with `frames:`",
            ))
        }
    };
    Ok(lefts.iter().zip(&partners.positions).map(partner).collect())
}

/// Uses complete paths as ids where the open parts of the pattern are not unique.
fn make_ids_unique(pairs: &mut Pairs, root: &Path) {
    let distinct: BTreeSet<&str> = pairs.rows.iter().map(|row| row.id.as_str()).collect();
    if distinct.len() == pairs.rows.len() {
        return;
    }
    for row in &mut pairs.rows {
        let path = row.left.strip_prefix(root).unwrap_or(&row.left);
        row.id = path.to_string_lossy().into_owned();
    }
}

fn left_over(alone: &[&Match], what: &str, whom: &str) -> Option<String> {
    let first = alone.first()?.path.display();
    Some(match alone.len() {
        1 => format!("1 {what} without {whom}: {first}"),
        count => format!("{count} {what}s without {whom}: {first}, ..."),
    })
}

#[derive(Debug)]
struct Partners {
    positions: Vec<Option<usize>>,
    warning: Option<String>,
}

impl Partners {
    fn without<'m>(&self, others: &'m [Match]) -> Vec<&'m Match> {
        let taken: BTreeSet<usize> = self.positions.iter().flatten().copied().collect();
        others.iter().enumerate().filter(|(at, _)| !taken.contains(at)).map(|(_, other)| other).collect()
    }
}

/// Files are partners if their open parts are equal; if none are, if the numbers in them are equal; otherwise by order,
/// with a warning, if both sides have the same count and no number contradicts it.
fn partners(files: &[Match], others: &[Match], (what, other): (&str, &str)) -> Result<Partners, Fault> {
    if let Some(positions) = by_key(files, others, |file| file.open.concat()) {
        return Ok(Partners { positions, warning: None });
    }
    // `*` may include the extension.
    if let Some(positions) = by_key(files, others, stem) {
        return Ok(Partners { positions, warning: None });
    }
    // Without a number there is nothing to go by.
    let numbers = |file: &Match| file.numbers().join(" ");
    let have_numbers = files.iter().chain(others).all(|file| !file.numbers().is_empty());
    if have_numbers && let Some(positions) = by_key(files, others, numbers) {
        return Ok(Partners { positions, warning: None });
    }
    let (count, of_others) = (files.len(), others.len());
    if count != of_others {
        let what = format!(
            "{count} {what} and {of_others} {other} files have no name in common (the first are {} and {}): it is unknown which lack their partner",
            files[0].path.display(),
            others[0].path.display()
        );
        return Err(Fault::new(what).remedy(SAY));
    }
    if let Some(at) = contradiction(files, others) {
        let what = format!(
            "{what} and {other} files have no name in common, and by their order {} would belong to {}, although another's number is nearer",
            files[at].path.display(),
            others[at].path.display()
        );
        return Err(Fault::new(what).remedy(format!("a file may be missing on either side: {SAY}")));
    }
    let (first, last) = (0, count - 1);
    let shown = |at: usize| format!("{} with {}", files[at].path.display(), others[at].path.display());
    let warning = match count {
        1 => None,
        _ => Some(format!(
            "{what} and {other} files have no name in common and are paired in their order: {}, ..., {}",
            shown(first),
            shown(last)
        )),
    };
    Ok(Partners { positions: (0..count).map(Some).collect(), warning })
}

/// The open parts of a name, without an extension.
fn stem(file: &Match) -> String {
    let open = file.open.concat();
    Path::new(&open).with_extension("").to_string_lossy().into_owned()
}

/// The key must be unique on each side, and shared by at least one pair.
fn by_key(files: &[Match], others: &[Match], key: impl Fn(&Match) -> String) -> Option<Vec<Option<usize>>> {
    let keys: BTreeMap<String, usize> = others.iter().enumerate().map(|(at, other)| (key(other), at)).collect();
    let own: Vec<String> = files.iter().map(&key).collect();
    let distinct = own.iter().collect::<BTreeSet<_>>().len() == files.len() && keys.len() == others.len();
    let partners: Vec<Option<usize>> = own.iter().map(|key| keys.get(key).copied()).collect();
    (distinct && partners.iter().any(Option::is_some)).then_some(partners)
}

/// The first file whose number is nearer to another file than to its partner by order.
fn contradiction(files: &[Match], others: &[Match]) -> Option<usize> {
    let number = |file: &Match| match file.numbers().as_slice() {
        [one] => one.parse::<u128>().ok(),
        _ => None,
    };
    let own: Vec<u128> = files.iter().map(number).collect::<Option<_>>()?;
    let theirs: Vec<u128> = others.iter().map(number).collect::<Option<_>>()?;
    let is_nearest = |at: usize, from: &[u128], among: &[u128]| {
        let away = |other: Option<&u128>| other.map_or(u128::MAX, |other| other.abs_diff(from[at]));
        let before = at.checked_sub(1).and_then(|before| among.get(before));
        away(among.get(at)) <= away(before).min(away(among.get(at + 1)))
    };
    (0..own.len()).find(|&at| !is_nearest(at, &own, &theirs) || !is_nearest(at, &theirs, &own))
}

/// Bytes.
const MOST_BYTES: u64 = 64 << 20;
const LONGEST_HEADER: u64 = 4096;

const LIST: &str = "a list is a CSV file: a header with the columns left[,right][,ground_truth][,frame], then one row per frame; paths are relative to `root`";

const COLUMNS: [&str; 4] = ["left", "right", "ground_truth", "frame"];

pub(super) fn by_list(root: &Path, list: &Path) -> Result<Pairs, Fault> {
    let at = |line: usize, what: String| Fault::new(format!("{}:{line}: {what}", list.display()));
    let bytes = regular_file::read(list, MOST_BYTES)
        .map_err(|error| Fault::new(format!("failed to read {}", list.display())).because(error).remedy(LIST))?;
    let text = String::from_utf8(bytes).map_err(|_| at(1, "the list is not UTF-8 text".to_owned()).remedy(LIST))?;
    let text = text.trim_start_matches('\u{feff}');
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (line, header) = lines.next().ok_or_else(|| at(1, "the list is empty".to_owned()).remedy(LIST))?;
    let columns = fields(header).ok_or_else(|| at(line + 1, "a quote is not closed".to_owned()).remedy(LIST))?;
    let mut places: BTreeMap<&str, usize> = BTreeMap::new();
    for (place, name) in columns.iter().enumerate() {
        let known = COLUMNS.into_iter().find(|known| name.trim().eq_ignore_ascii_case(known));
        let known = known.ok_or_else(|| at(line + 1, format!("`{name}` is not a column of a list")).remedy(LIST))?;
        if places.insert(known, place).is_some() {
            return Err(at(line + 1, format!("the column `{known}` appears twice")).remedy(LIST));
        }
    }
    if !places.contains_key("left") {
        return Err(at(line + 1, "the column `left` is missing".to_owned()).remedy(LIST));
    }
    let mut pairs = Pairs::default();
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    for (line, text) in lines {
        let line = line + 1;
        match row(root, &places, columns.len(), text) {
            Ok(mut row) => {
                let placed = |fault: Fault| fault.map_what(|what| format!("{}:{line}: {what}", list.display()));
                row.right = row.right.map_err(placed);
                row.truth = row.truth.map_err(placed);
                if let Some(first) = seen.insert(row.id.clone(), line) {
                    let what = format!("the frame `{}` is in line {first} already", row.id);
                    pairs.faults.push(at(line, what).remedy("names of frames must be unique: add a column `frame`"));
                    continue;
                }
                pairs.rows.push(row);
            }
            Err(what) => pairs.faults.push(at(line, what).remedy(LIST)),
        }
    }
    if pairs.rows.is_empty() && pairs.faults.is_empty() {
        return Err(Fault::new(format!("{} names no frame", list.display())).remedy(LIST));
    }
    Ok(pairs)
}

fn row(root: &Path, places: &BTreeMap<&str, usize>, columns: usize, text: &str) -> Result<Row, String> {
    let fields = fields(text).ok_or("a quote is not closed")?;
    if fields.len() != columns {
        return Err(format!("the line has {} fields, and the header {columns}", fields.len()));
    }
    let field = |name: &str| places.get(name).map(|at| fields[*at].trim()).filter(|text| !text.is_empty());
    let path = |name: &str| field(name).map(|text| root.join(text)).ok_or_else(|| format!("`{name}` is empty"));
    let left = path("left")?;
    let right = places.contains_key("right").then(|| path("right")).transpose()?;
    let there = |path: PathBuf| existing_file(path, "paths in a list are relative to `root`");
    let stem = || Path::new(field("left").unwrap_or_default()).with_extension("").to_string_lossy().into_owned();
    let id = field("frame").map_or_else(stem, ToOwned::to_owned);
    let truth = path("ground_truth").ok().map(there).transpose();
    // Of two missing files the first is reported.
    let right = there(left.clone()).and_then(|_| right.map(there).transpose());
    Ok(Row { id, left, right, truth })
}

/// Whether the header of a list has the column `right`. `None` if it cannot be read or lacks the column `left`: this is
/// reported when the list is opened.
pub(super) fn list_has_pairs(list: &Path) -> Option<bool> {
    let mut head = Vec::new();
    let read = regular_file::open(list).and_then(|file| file.take(LONGEST_HEADER).read_to_end(&mut head));
    let text = String::from_utf8_lossy(&head);
    let header = text.trim_start_matches('\u{feff}').lines().find(|line| !line.trim().is_empty()).and_then(fields);
    let has = |name: &str, columns: &[String]| columns.iter().any(|column| column.trim().eq_ignore_ascii_case(name));
    match (read, header) {
        (Ok(_), Some(columns)) => has("left", &columns).then(|| has("right", &columns)),
        _ => None,
    }
}

/// CSV with quotes; `None` if a quote is not closed.
fn fields(line: &str) -> Option<Vec<String>> {
    let mut fields = vec![String::new()];
    let (mut quoted, mut letters) = (false, line.chars().peekable());
    while let Some(letter) = letters.next() {
        let field = fields.last_mut()?;
        match letter {
            '"' if quoted && letters.peek() == Some(&'"') => {
                letters.next();
                field.push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            _ => field.push(letter),
        }
    }
    (!quoted).then_some(fields)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::{Match, Partners, fields, partners};

    fn matches(open: &[&str]) -> Vec<Match> {
        let file = |open: &&str| Match { open: vec![(*open).to_owned()], path: PathBuf::from(format!("{open}.png")) };
        open.iter().map(file).collect()
    }

    fn paired(lefts: &[&str], rights: &[&str]) -> Result<Partners, String> {
        partners(&matches(lefts), &matches(rights), ("left", "right")).map_err(|fault| fault.to_string())
    }

    #[test]
    fn files_pair_by_name_then_by_number_then_by_order_with_a_warning() {
        let same = paired(&["1", "2", "4"], &["1", "4", "5"]).unwrap();
        assert_eq!((same.positions, same.warning), (vec![Some(0), None, Some(1)], None));
        let numbers = paired(&["l001", "l002"], &["r2", "r1"]).unwrap();
        assert_eq!((numbers.positions, numbers.warning), (vec![Some(1), Some(0)], None));
        let order = paired(&["a", "b"], &["c", "d"]).unwrap();
        assert_eq!(order.positions, [Some(0), Some(1)]);
        assert!(order.warning.unwrap().ends_with("in their order: a.png with c.png, ..., b.png with d.png"));
        assert!(paired(&["a", "b"], &["c"]).unwrap_err().contains("it is unknown which lack their partner"));
    }

    #[test]
    fn open_parts_may_include_the_extension() {
        let paired = paired(&["a_1.png", "a_2.png", "Thumbs.db"], &["a_2.npy", "a_1.npy"]).unwrap();
        assert_eq!((paired.positions, paired.warning), (vec![Some(1), Some(0), None], None));
    }

    #[test]
    fn times_that_a_missing_file_shifted_are_not_paired_in_their_order() {
        assert!(paired(&["1000", "2000", "3000"], &["1003", "2001", "2998"]).is_ok());
        let shifted = paired(&["1000", "2000", "3000"], &["2003", "3001", "3998"]).unwrap_err();
        assert!(
            shifted.contains("by their order 1000.png would belong to 2003.png") || shifted.contains("nearer"),
            "{shifted}"
        );
    }

    #[test]
    fn ambiguous_numbers_pair_no_files() {
        let order = paired(&["a1", "b1"], &["c1", "d1"]).unwrap();
        assert!(order.warning.is_some());
    }

    #[test]
    fn a_comma_in_quotes_is_a_letter() {
        let parsed = |line| fields(line).unwrap();
        assert_eq!(parsed("a,b"), ["a", "b"]);
        assert_eq!(parsed("\"a,b\",\"c\"\"d\","), ["a,b", "c\"d", ""]);
        assert_eq!(fields("\"a,b"), None);
    }
}
