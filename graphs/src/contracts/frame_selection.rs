//! Selection of a source's frames.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Fault;
use crate::regular_file;

/// Which frames of a source are used, and in which order: `1..=40`, `0..48`, a list of indices, or a file of frame
/// ids.
///
/// A range or list with a frame that the source lacks is an error. `available` takes all frames, `1..=40 available`
/// those of a range that exist. Lists and files keep their order and may not name a frame twice, which would count it
/// twice in every mean.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum FrameSelection {
    /// All frames: `available`, or nothing.
    #[default]
    All,
    /// Indices from the first to the last (excluded), all of which must exist.
    Range(Range<u64>),
    /// Those of these indices that exist.
    Available(Range<u64>),
    /// These indices, in this order, each once.
    List(Vec<u64>),
    /// The ids in this text file, one per line, in this order, each once.
    File(PathBuf),
}

const MOST_BYTES: u64 = 16 << 20;

impl FrameSelection {
    /// Its forms, for messages.
    pub const FORMS: &str = "`1..=40`, `0..48`, `[3, 7]`, `available`, or a text file with one frame id per line";

    /// Reads `1..=40`, `0..48`, `7`, `available`, `1..=40 available` or the path of a file, which has a `/` or an
    /// extension.
    ///
    /// # Errors
    /// A lower-case fragment saying what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let is_path = text.contains(['/', '\\']);
        if text == "available" {
            return Ok(Self::All);
        }
        if is_path {
            return Ok(Self::File(PathBuf::from(text)));
        }
        if let Some(of) = text.strip_suffix("available").filter(|of| of.ends_with(char::is_whitespace)) {
            return range(of)?.map(Self::Available).ok_or_else(|| misread(text));
        }
        if let Some(range) = range(text)? {
            return Ok(Self::Range(range));
        }
        let ending = Path::new(text).extension().and_then(|ending| ending.to_str());
        match ending.is_some_and(|ending| ending.contains(|c: char| c.is_ascii_alphabetic())) {
            true => Ok(Self::File(PathBuf::from(text))),
            false => Err(misread(text)),
        }
    }

    /// The frames of `1..=40 available` that do not exist, in words; `ids` as for [`FrameSelection::select`].
    pub fn left_out(&self, ids: &[(u64, &str)]) -> Option<String> {
        let Self::Available(range) = self else { return None };
        let there: Vec<u64> = ids.iter().map(|(index, _)| *index).filter(|index| range.contains(index)).collect();
        let (count, wanted) = (there.len(), range.end - range.start);
        let missing = wanted - count as u64;
        let (from, to, first, last) = (range.start, range.end - 1, there.first()?, there.last()?);
        (missing > 0).then(|| {
            format!(
                "of the frames {from} to {to}, {missing} of {wanted} do not exist: {count} are used, {first} to {last}"
            )
        })
    }

    /// Positions of the selected frames in `ids`: index and id of all frames, ascending by index.
    ///
    /// # Errors
    /// If a file of ids cannot be read, a frame does not exist or is named twice, or nothing is selected.
    pub fn select(&self, ids: &[(u64, &str)]) -> Result<Vec<usize>, Fault> {
        let span = || match (ids.first(), ids.last()) {
            (Some(only), Some(_)) if ids.len() == 1 => format!("there is 1 frame, {}", only.0),
            (Some(first), Some(last)) => format!("there are {} frames, {} to {}", ids.len(), first.0, last.0),
            _ => "there are no frames at all".to_owned(),
        };
        let within = |range: &Range<u64>| {
            ids.partition_point(|(index, _)| *index < range.start)..ids.partition_point(|(index, _)| *index < range.end)
        };
        let chosen: Vec<usize> = match self {
            Self::All => (0..ids.len()).collect(),
            Self::Available(range) => within(range).collect(),
            Self::Range(range) => {
                let there = within(range);
                let mut indices = ids[there.clone()].iter().map(|(index, _)| *index);
                if let Some(missing) = range.clone().find(|&index| indices.next() != Some(index)) {
                    let (first, last) = (range.start, range.end - 1);
                    let remedy = format!("{}; `{first}..={last} available` takes those of the range", span());
                    return Err(Fault::new(format!("there is no frame {missing}")).remedy(remedy));
                }
                there.collect()
            }
            Self::List(list) => {
                if let Some(index) = repeated(list) {
                    return Err(Fault::new(named_twice(index)));
                }
                let find = |index: &u64| {
                    ids.binary_search_by_key(index, |(i, _)| *i)
                        .map_err(|_| Fault::new(format!("there is no frame {index}")).remedy(span()))
                };
                list.iter().map(find).collect::<Result<_, _>>()?
            }
            Self::File(path) => from_file(path, ids).map_err(|fault| match fault {
                fault if fault.remedy_text().is_none() => fault.remedy(span()),
                fault => fault,
            })?,
        };
        if chosen.is_empty() {
            return Err(Fault::new("no frame is selected").remedy(span()));
        }
        Ok(chosen)
    }
}

/// `1..=40`, `0..48` or `7`; `None` if the text has another form.
fn range(text: &str) -> Result<Option<Range<u64>>, String> {
    let text = text.trim();
    let only_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let (first, last, closed) = match (text.split_once("..="), text.split_once("..")) {
        (Some((first, last)), _) => (first, last, true),
        (None, Some((first, end))) => (first, end, false),
        (None, None) if only_digits(text) => (text, text, true),
        (None, None) => return Ok(None),
    };
    let number = |digits: &str| match digits.trim() {
        "" => Err(format!("`{text}` is not a range of frames, which has two ends, as in `1..=40`")),
        digits => digits.parse::<u64>().map_err(|_| format!("`{digits}` is not a frame index")),
    };
    let (first, last) = (number(first)?, number(last)?);
    let range = first..if closed { last.saturating_add(1) } else { last };
    if range.is_empty() {
        Err(format!("the range `{text}` contains no frame: `a..b` ends before frame `b`, `a..=b` includes it"))
    } else {
        Ok(Some(range))
    }
}

fn misread(text: &str) -> String {
    let parts = |separator: char| -> Option<Vec<u64>> {
        text.split(separator).map(|part| part.trim().parse().ok()).collect::<Option<Vec<u64>>>()
    };
    let suggestion = match (parts('-'), parts(',')) {
        (Some(ends), _) if ends.len() == 2 => format!("did you mean `{}..={}`?", ends[0], ends[1]),
        (_, Some(list)) => format!("did you mean `{list:?}`, without quotes?"),
        _ => format!("frames are {}, whose name has an extension or a `/`", FrameSelection::FORMS),
    };
    format!("`{text}` does not select frames: {suggestion}")
}

fn named_twice(frame: impl std::fmt::Display) -> String {
    format!(
        "frame {frame} is named twice: a frame can be selected only once, because it would count twice in every mean"
    )
}

fn repeated(list: &[u64]) -> Option<u64> {
    let mut seen = HashSet::with_capacity(list.len());
    list.iter().copied().find(|index| !seen.insert(*index))
}

fn from_file(path: &Path, ids: &[(u64, &str)]) -> Result<Vec<usize>, Fault> {
    let unreadable = || {
        Fault::new(format!("failed to read the list of frames {}", path.display()))
            .remedy(format!("`frames` takes {}", FrameSelection::FORMS))
    };
    let bytes = regular_file::read(path, MOST_BYTES).map_err(|error| unreadable().because(error))?;
    let text = String::from_utf8(bytes).map_err(|_| unreadable().because("it is not UTF-8 text".to_owned()))?;
    let known: HashMap<&str, usize> = ids.iter().enumerate().map(|(position, (_, id))| (*id, position)).collect();
    let mut lines: HashMap<usize, usize> = HashMap::new();
    let mut chosen = Vec::new();
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    for (line, id) in text.lines().enumerate().map(|(line, id)| (line + 1, id.trim())).filter(|(_, id)| !id.is_empty())
    {
        let place = format!("{}:{line}", path.display());
        let shown: String = id.chars().take(40).collect();
        let position = *known
            .get(id)
            .ok_or_else(|| Fault::new(format!("{place}: there is no frame `{}`", shown.escape_debug())))?;
        if let Some(first) = lines.insert(position, line) {
            return Err(
                Fault::new(format!("{place}: {}", named_twice(id))).remedy(format!("it is in line {first} too"))
            );
        }
        chosen.push(position);
    }
    Ok(chosen)
}

impl Serialize for FrameSelection {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::All => serializer.serialize_none(),
            Self::Range(range) => serializer.collect_str(&format_args!("{}..{}", range.start, range.end)),
            Self::Available(range) => serializer.collect_str(&format_args!("{}..{} available", range.start, range.end)),
            Self::List(list) => list.serialize(serializer),
            Self::File(path) => path.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for FrameSelection {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;

        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "`frames` takes `1..=40`, `0..48`, `[3, 7]`, `available`, or a text file with one frame id per line"
        )]
        enum Written {
            All(()),
            One(u64),
            List(Vec<u64>),
            Text(String),
        }
        match Written::deserialize(deserializer)? {
            Written::All(()) => Ok(Self::All),
            Written::One(index) => Ok(Self::List(vec![index])),
            Written::List(list) => match repeated(&list) {
                Some(index) => Err(D::Error::custom(named_twice(index))),
                None if list.is_empty() => Err(D::Error::custom("the list of frames is empty")),
                None => Ok(Self::List(list)),
            },
            Written::Text(text) => Self::parse(&text).map_err(D::Error::custom),
        }
    }
}

// Format `frames`: a range, or a path that the language resolves like a DataPath.
inline_schema!(FrameSelection, { "anyOf": [
    { "type": "string", "format": "frames" },
    { "type": "array", "items": { "type": "integer", "minimum": 0 } },
    { "type": "integer", "minimum": 0 },
    { "type": "null" }
] });

#[cfg(test)]
mod tests {
    use super::FrameSelection;

    const IDS: [(u64, &str); 4] = [(3, "000003_10"), (4, "000004_10"), (7, "000007_10"), (8, "000008_10")];

    fn fault(selection: &FrameSelection) -> String {
        let fault = selection.select(&IDS).expect_err("it is refused");
        format!("{fault} ({})", fault.remedy_text().unwrap_or_default())
    }

    #[test]
    fn ranges_are_read_with_and_without_their_last_frame() {
        assert_eq!(FrameSelection::parse("1..=40"), Ok(FrameSelection::Range(1..41)));
        assert_eq!(FrameSelection::parse("0..48"), Ok(FrameSelection::Range(0..48)));
        assert!(FrameSelection::parse("5..5").is_err());
        assert_eq!(FrameSelection::parse("../ids.txt"), Ok(FrameSelection::File("../ids.txt".into())));
    }

    #[test]
    fn a_listed_frame_that_does_not_exist_is_an_error() {
        assert_eq!(FrameSelection::List(vec![7, 3]).select(&IDS).expect("both exist"), vec![2, 0]);
        assert!(FrameSelection::List(vec![5]).select(&IDS).is_err());
        assert!(FrameSelection::Range(9..10).select(&IDS).is_err());
    }

    #[test]
    fn fault_32_a_range_beyond_what_exists_is_an_error_unless_available_is_asked_for() {
        let remedy = "there are 4 frames, 3 to 8; `7..=160 available` takes those of the range";
        assert_eq!(fault(&FrameSelection::Range(7..161)), format!("there is no frame 9 ({remedy})"));
        assert!(fault(&FrameSelection::Range(3..9)).starts_with("there is no frame 5 "), "a hole is no less missing");
        assert!(fault(&FrameSelection::Range(0..u64::MAX)).starts_with("there is no frame 0 "));
        assert_eq!(FrameSelection::parse("7..=160 available"), Ok(FrameSelection::Available(7..161)));
        assert_eq!(FrameSelection::Available(4..161).select(&IDS).expect("some are there"), vec![1, 2, 3]);
        assert_eq!(fault(&FrameSelection::Available(100..161)), "no frame is selected (there are 4 frames, 3 to 8)");
        assert_eq!(FrameSelection::parse("available"), Ok(FrameSelection::All));
        let left_out = FrameSelection::Available(4..161).left_out(&IDS).expect("some do not exist");
        assert_eq!(left_out, "of the frames 4 to 160, 154 of 157 do not exist: 3 are used, 4 to 8");
        assert_eq!(FrameSelection::Available(7..9).left_out(&IDS), None);
        assert_eq!(FrameSelection::All.left_out(&IDS), None);
    }

    #[test]
    fn fault_32_frames_are_selected_once_and_in_the_order_of_the_list() {
        let read = |text: &str| serde_json::from_str::<FrameSelection>(text).map_err(|error| error.to_string());
        assert!(read("[3, 7, 3]").expect_err("3 is there twice").starts_with("frame 3 is named twice"));
        assert_eq!(read("[7, 3]").expect("in any order").select(&IDS).expect("both exist"), vec![2, 0]);
        assert!(read("[]").is_err());
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ids.txt");
        std::fs::write(&path, "\u{feff}000007_10\r\n\r\n000003_10\r\n").expect("written");
        assert_eq!(FrameSelection::File(path.clone()).select(&IDS).expect("both exist"), vec![2, 0]);
        std::fs::write(&path, "000007_10\n000003_10\n000007_10\n").expect("written");
        let message = fault(&FrameSelection::File(path.clone()));
        assert!(message.contains("ids.txt:3: frame 000007_10 is named twice"), "{message}");
        std::fs::write(&path, "\n000009_10").expect("written");
        let message = fault(&FrameSelection::File(path));
        assert!(message.contains("ids.txt:2: there is no frame `000009_10`"), "{message}");
    }

    #[test]
    fn fault_32_text_that_is_neither_a_range_nor_a_path_is_refused() {
        let refused = |text: &str| FrameSelection::parse(text).expect_err(text);
        assert!(refused("151-155").ends_with("did you mean `151..=155`?"));
        assert!(refused("151,152").ends_with("did you mean `[151, 152]`, without quotes?"));
        for text in
            ["", "ids", "000150_10", "..", "..5", "5..", "..=5", "0..4.x", "1...3", "all", "x available", "-1", "1.5"]
        {
            refused(text);
        }
        for text in ["ids.txt", "./ids", "lists/ids", "/data/ids", "1/2", "2011_09_26.list"] {
            assert_eq!(FrameSelection::parse(text), Ok(FrameSelection::File(text.into())));
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_not_a_list_of_frames() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ids.txt");
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo is there");
        assert!(made.success());
        assert!(
            fault(&FrameSelection::File(path)).contains("failed to read the list of frames"),
            "the read does not block"
        );
    }

    #[test]
    fn what_was_read_is_written_so_that_it_reads_back() {
        for text in ["null", "[3,7]", "\"1..=40\"", "\"0..48 available\"", "\"./ids\"", "5"] {
            let read: FrameSelection = serde_json::from_str(text).expect(text);
            let written = serde_json::to_string(&read).expect("it can be written");
            assert_eq!(serde_json::from_str::<FrameSelection>(&written).expect("it reads back"), read);
        }
    }
}
