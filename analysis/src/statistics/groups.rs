//! Groups of frames that are resampled together: frames of a video are correlated.

use std::collections::BTreeMap;
use std::path::PathBuf;

use depthloom_graphs::{natural_order, regular_file};

use crate::error::AnalysisError;

/// The most bytes of a file of groups that are read.
const LARGEST: u64 = 64 << 20;
const FORMAT: &str = "a file of groups is CSV with the columns frame,group and one row per frame";

/// How frames are grouped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Grouping {
    /// Frames of one sequence: a new one begins where the folder in the id changes, or where the number in it restarts.
    Sequence,
    /// Consecutive frames, this number in a group.
    Blocks(usize),
    /// A CSV file with the columns `frame,group`.
    File(PathBuf),
}

impl Grouping {
    /// Parses `sequence`, `blocks:N` or the path of a CSV file.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong =
            || "expected `sequence`, `blocks:N` with N from 2, or a CSV file with the columns frame,group".to_owned();
        match text.split_once(':') {
            _ if text == "sequence" => Ok(Self::Sequence),
            Some(("blocks", count)) => {
                count.parse().ok().filter(|count| *count >= 2).map(Self::Blocks).ok_or_else(wrong)
            }
            _ if text.to_ascii_lowercase().ends_with(".csv") => Ok(Self::File(text.into())),
            _ => Err(wrong()),
        }
    }

    /// `sequences`, for descriptions.
    pub(crate) fn unit(&self) -> String {
        self.named("s")
    }

    /// `3 sequences`, for descriptions.
    pub(crate) fn counted(&self, count: usize) -> String {
        format!("{count} {}", self.named(if count == 1 { "" } else { "s" }))
    }

    fn named(&self, plural: &str) -> String {
        match self {
            Self::Sequence => format!("sequence{plural}"),
            Self::Blocks(frames) => format!("block{plural} of {frames} frames"),
            Self::File(path) => format!("group{plural} of {}", path.display()),
        }
    }

    /// Prepares the grouping: reads its file.
    ///
    /// # Errors
    /// If the file cannot be read, or has other columns.
    pub(crate) fn open(&self) -> Result<Groups, AnalysisError> {
        let Self::File(path) = self else { return Ok(Groups { grouping: self.clone(), by_id: BTreeMap::new() }) };
        let failed = |what: String| AnalysisError::request(format!("{}{what}", path.display()), FORMAT.to_owned());
        let bytes = regular_file::read(path, LARGEST).map_err(|error| failed(format!(": {error}")))?;
        let text = String::from_utf8(bytes).map_err(|_| failed(": the file is not UTF-8 text".to_owned()))?;
        let mut lines =
            text.trim_start_matches('\u{feff}').lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let header: Vec<&str> = lines.next().map_or("", |(_, line)| line).split(',').map(str::trim).collect();
        if header != ["frame", "group"] {
            return Err(failed(format!(":1: the columns are `{}`", header.join(","))));
        }
        let mut by_id = BTreeMap::new();
        for (at, line) in lines {
            // An id may contain commas.
            let Some((id, group)) = line.rsplit_once(',') else {
                return Err(failed(format!(":{}: the line has one field", at + 1)));
            };
            let (id, group) = (id.trim().trim_matches('"').to_owned(), group.trim().to_owned());
            if group.is_empty() {
                return Err(failed(format!(":{}: frame `{id}` has an empty group", at + 1)));
            }
            if by_id.insert(id.clone(), group).is_some() {
                return Err(failed(format!(":{}: frame `{id}` appears twice", at + 1)));
            }
        }
        Ok(Groups { grouping: self.clone(), by_id })
    }
}

/// A grouping whose file was read.
#[derive(Debug)]
pub(crate) struct Groups {
    grouping: Grouping,
    by_id: BTreeMap<String, String>,
}

impl Groups {
    /// The group of each frame, given by its id and its number, from 0 in the order of their first frames.
    ///
    /// # Errors
    /// If the file has no group for a frame.
    pub(crate) fn of_frames(&self, frames: &[(&str, u64)]) -> Result<Vec<usize>, AnalysisError> {
        match &self.grouping {
            Grouping::Blocks(count) => Ok((0..frames.len()).map(|place| place / count).collect()),
            Grouping::Sequence => Ok(sequences(frames)),
            Grouping::File(path) => {
                let mut seen: Vec<&str> = Vec::new();
                let group = |(id, _): &(&str, u64)| {
                    let name = self.by_id.get(*id).ok_or_else(|| {
                        let what = format!("{} has no group for frame `{id}`", path.display());
                        AnalysisError::request(what, FORMAT.to_owned())
                    })?;
                    Ok(seen.iter().position(|known| known == name).unwrap_or_else(|| {
                        seen.push(name);
                        seen.len() - 1
                    }))
                };
                frames.iter().map(group).collect()
            }
        }
    }
}

fn sequences(frames: &[(&str, u64)]) -> Vec<usize> {
    let folder = |id: &str| id.rsplit_once('/').map(|(folder, _)| folder.to_owned());
    let mut group = 0;
    let mut groups = Vec::with_capacity(frames.len());
    for (place, (id, index)) in frames.iter().enumerate() {
        if let Some((before, index_before)) = place.checked_sub(1).map(|before| frames[before]) {
            // Concatenated sources continue the index, but not the names of files.
            let restarts = natural_order(id, before).is_le() || *index <= index_before;
            group += usize::from(folder(before) != folder(id) || restarts);
        }
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn groups(text: &str, frames: &[(&str, u64)]) -> Result<Vec<usize>, String> {
        let groups = Grouping::parse(text)?.open().map_err(|error| error.to_string())?;
        groups.of_frames(frames).map_err(|error| error.to_string())
    }

    #[test]
    fn a_sequence_ends_where_the_folder_changes_or_numbers_restart() {
        let frames = [("a/9", 0), ("a/10", 1), ("b/2", 2), ("b/3", 3), ("b/0", 4), ("b/7", 5)];
        assert_eq!(groups("sequence", &frames).unwrap(), [0, 0, 1, 1, 2, 2]);
        assert_eq!(groups("blocks:4", &frames).unwrap(), [0, 0, 0, 0, 1, 1]);
        for wrong in ["blocks:1", "blocks", "drive", "groups.txt"] {
            assert!(Grouping::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_file_of_groups_names_every_frame_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("groups.csv");
        let text = path.display().to_string();
        let with = |content: &str, frames: &[(&str, u64)]| {
            std::fs::write(&path, content).unwrap();
            groups(&text, frames)
        };
        let frames = [("x,1", 1), ("2", 2), ("3", 3)];
        assert_eq!(with("frame,group\n\"x,1\",sun\n2,rain\n3,sun\n", &frames).unwrap(), [0, 1, 0]);
        for (content, what) in [
            ("frame,group\n2,rain\n", "has no group for frame `x,1`"),
            ("id,group\n2,rain\n", "the columns are `id,group`"),
            ("frame,group\n2,a\n2,b\n", ":3: frame `2` appears twice"),
            ("frame,group\n2\n", ":2: the line has one field"),
            ("frame,group\n2,\n", ":2: frame `2` has an empty group"),
        ] {
            let error = with(content, &frames).unwrap_err();
            assert!(error.contains(what), "{error}");
        }
    }
}
