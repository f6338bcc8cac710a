//! Parameter types with a meaning the language knows.

use std::path::{Path, PathBuf};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// A path in a parameter. The language resolves it against the folder of the YAML file it stands in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct DataPath(pub PathBuf);

impl DataPath {
    /// The path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl JsonSchema for DataPath {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "DataPath".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "format": "path" })
    }
}

/// Which frames of a source are taken: `1..=40`, `0..48`, a list of indices, or the path of a file of frame ids.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum FrameSelection {
    /// Every frame.
    #[default]
    All,
    /// Indices from the first to the last, the last excluded.
    Range(std::ops::Range<u64>),
    /// These indices, in this order.
    List(Vec<u64>),
    /// The ids in this text file, one a line.
    File(PathBuf),
}

impl FrameSelection {
    /// Reads `1..=40`, `0..48`, `7` or the path of a file.
    ///
    /// # Errors
    /// A lower-case fragment saying what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let number = |digits: &str| digits.trim().parse::<u64>().map_err(|_| format!("`{digits}` is no frame index"));
        let looks_like_range = |first: &str| first.trim().bytes().all(|b| b.is_ascii_digit());
        let range = match text.split_once("..=") {
            Some((first, last)) if looks_like_range(first) => number(first)?..number(last)?.saturating_add(1),
            _ => match text.split_once("..") {
                Some((first, end)) if looks_like_range(first) && !first.is_empty() => number(first)?..number(end)?,
                _ => match text.trim().parse::<u64>() {
                    Ok(only) => only..only.saturating_add(1),
                    Err(_) => return Ok(Self::File(PathBuf::from(text))),
                },
            },
        };
        if range.is_empty() {
            return Err(format!("the range `{text}` holds no frame"));
        }
        Ok(Self::Range(range))
    }

    /// The indices selected among `ids.len()` frames numbered by `index`, as positions into `ids`.
    ///
    /// `ids` are (index, id) of all frames there are, ascending by index.
    ///
    /// # Errors
    /// If a file of ids cannot be read, a listed frame does not exist, or nothing is selected.
    pub fn select(&self, ids: &[(u64, &str)]) -> Result<Vec<usize>, super::Fault> {
        use super::Fault;
        let span = || match (ids.first(), ids.last()) {
            (Some(first), Some(last)) => format!("there are {} frames, {} to {}", ids.len(), first.0, last.0),
            _ => "there are no frames at all".to_owned(),
        };
        let chosen: Vec<usize> = match self {
            Self::All => (0..ids.len()).collect(),
            Self::Range(range) => (0..ids.len()).filter(|&i| range.contains(&ids[i].0)).collect(),
            Self::List(list) => {
                let find = |index: &u64| {
                    ids.binary_search_by_key(index, |(i, _)| *i)
                        .map_err(|_| Fault::new(format!("there is no frame {index}")).remedy(span()))
                };
                list.iter().map(find).collect::<Result<_, _>>()?
            }
            Self::File(path) => {
                let text = std::fs::read_to_string(path).map_err(|error| {
                    Fault::new(format!("failed to read the list of frames {}", path.display()))
                        .because(error)
                        .remedy("`frames` takes `1..=40`, `0..48`, `[3, 7]` or a text file with one frame id a line")
                })?;
                let mut chosen = Vec::new();
                for (line, id) in text.lines().enumerate().filter(|(_, id)| !id.trim().is_empty()) {
                    let found = ids.iter().position(|(_, known)| *known == id.trim());
                    chosen.push(found.ok_or_else(|| {
                        Fault::new(format!("{}:{}: there is no frame `{}`", path.display(), line + 1, id.trim()))
                            .remedy(span())
                    })?);
                }
                chosen
            }
        };
        if chosen.is_empty() {
            return Err(Fault::new("no frame is selected").remedy(span()));
        }
        Ok(chosen)
    }
}

impl Serialize for FrameSelection {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::All => serializer.serialize_none(),
            Self::Range(range) => serializer.collect_str(&format_args!("{}..{}", range.start, range.end)),
            Self::List(list) => list.serialize(serializer),
            Self::File(path) => path.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for FrameSelection {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "`frames` takes `1..=40`, `0..48`, `[3, 7]` or a text file with one frame id a line"
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
            Written::List(list) => Ok(Self::List(list)),
            Written::Text(text) => Self::parse(&text).map_err(serde::de::Error::custom),
        }
    }
}

impl JsonSchema for FrameSelection {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "FrameSelection".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        // Format `frames`: a range, or a path that the language resolves like a DataPath.
        json_schema!({
            "anyOf": [
                { "type": "string", "format": "frames" },
                { "type": "array", "items": { "type": "integer", "minimum": 0 } },
                { "type": "integer", "minimum": 0 },
                { "type": "null" }
            ]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::FrameSelection;

    #[test]
    fn ranges_are_read_with_and_without_their_last_frame() {
        assert_eq!(FrameSelection::parse("1..=40"), Ok(FrameSelection::Range(1..41)));
        assert_eq!(FrameSelection::parse("0..48"), Ok(FrameSelection::Range(0..48)));
        assert!(FrameSelection::parse("5..5").is_err());
        assert_eq!(FrameSelection::parse("../ids.txt"), Ok(FrameSelection::File("../ids.txt".into())));
    }

    #[test]
    fn a_listed_frame_that_does_not_exist_is_an_error() {
        let ids = [(3, "000003_10"), (7, "000007_10")];
        assert_eq!(FrameSelection::List(vec![7, 3]).select(&ids).expect("both exist"), vec![1, 0]);
        assert!(FrameSelection::List(vec![4]).select(&ids).is_err());
        assert!(FrameSelection::Range(8..9).select(&ids).is_err());
    }
}
