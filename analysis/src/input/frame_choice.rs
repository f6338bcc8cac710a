//! Selects frames of a run by number or by id.

use std::collections::BTreeSet;

use depthloom_graphs::contracts::FrameSelection;
use depthloom_graphs::plan::RunId;
use depthloom_recording::{RecordedFrame, Recording};

use crate::error::AnalysisError;

/// Frames selected on the command line: `3`, `3,7`, `0..4`, `1..=40`, ids (`000150_10`), or a file with one id per
/// line. Numbers are frame numbers as in `frames:` of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameChoice {
    /// By number, or by a file of ids.
    Selection(FrameSelection),
    /// By id.
    Ids(Vec<String>),
}

impl FrameChoice {
    /// Parses a selection.
    ///
    /// # Errors
    /// If the text is not a selection; the message contains a suggestion.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<u64>> = text.split(',').map(|index| index.trim().parse().ok()).collect();
        if let Some(numbers) = numbers {
            return Ok(Self::Selection(FrameSelection::List(numbers)));
        }
        FrameSelection::parse(text).map(Self::Selection).or_else(|wrong| {
            let ids: Vec<String> = text.split(',').map(|id| id.trim().to_owned()).collect();
            let is_number = |part: &str| part.trim().parse::<u64>().is_ok();
            let is_id = |id: &String| {
                !id.is_empty()
                    && !id.contains("..")
                    && !id.split_once('-').is_some_and(|(a, b)| is_number(a) && is_number(b))
            };
            if ids.iter().all(is_id) { Ok(Self::Ids(ids)) } else { Err(wrong) }
        })
    }

    /// The same choice for recorded frames: a range may contain frames that were not recorded, because their source
    /// failed.
    pub(crate) fn of_recorded(&self) -> Self {
        match self {
            Self::Selection(FrameSelection::Range(range)) => Self::Selection(FrameSelection::Available(range.clone())),
            other => other.clone(),
        }
    }

    /// Describes the frames of a range that are before the first or after the last recorded number; `None` if it
    /// ends within them.
    fn beyond(&self, recorded: &BTreeSet<u64>) -> Option<String> {
        let Self::Selection(FrameSelection::Range(range)) = self else { return None };
        let (first, last) = (*recorded.first()?, *recorded.last()?);
        // A run of every second frame ends one before its range does.
        let step = recorded.iter().zip(recorded.iter().skip(1)).map(|(one, next)| next - one).min().unwrap_or(1);
        let is_beyond = range.end > last.saturating_add(step) || range.start.saturating_add(step) <= first;
        let known: Vec<(u64, &str)> = recorded.iter().map(|index| (*index, "")).collect();
        is_beyond.then(|| FrameSelection::Available(range.clone()).left_out(&known)).flatten()
    }

    /// The positions of the selected frames among `frames`, in the order of the selection.
    ///
    /// # Errors
    /// If a frame does not exist or is selected twice, or a file of ids cannot be read.
    pub fn positions(&self, frames: &[&RecordedFrame]) -> Result<Vec<usize>, AnalysisError> {
        let matching = |is_match: &dyn Fn(&RecordedFrame) -> bool| -> Vec<usize> {
            (0..frames.len()).filter(|&at| is_match(frames[at])).collect()
        };
        let selection = match self {
            Self::Selection(selection) => selection,
            Self::Ids(ids) => {
                let mut positions = Vec::new();
                for id in ids {
                    let found = matching(&|frame| *frame.id == **id);
                    if found.is_empty() || found.iter().any(|at| positions.contains(at)) {
                        let what =
                            if found.is_empty() { "there is no frame" } else { "several selected frames are called" };
                        return Err(AnalysisError::request(format!("{what} `{id}`"), span(frames)));
                    }
                    positions.extend(found);
                }
                return Ok(positions);
            }
        };
        let has_ids = matches!(selection, FrameSelection::File(_));
        let mut known: Vec<(u64, &str)> = frames.iter().map(|frame| (frame.index, &*frame.id)).collect();
        known.sort_unstable();
        // Stage runs share frames, and concatenated sources may repeat a number.
        known.dedup_by(|one, other| if has_ids { one == other } else { one.0 == other.0 });
        let selected = selection.select(&known).map_err(|fault| {
            let help = fault.remedy_text().map_or_else(|| span(frames), str::to_owned);
            AnalysisError::request(format!("failed to select frames: {}", fault.chain()), help)
        })?;
        let mut seen = BTreeSet::new();
        let frame_positions = |place: usize| {
            let (index, id) = known[place];
            matching(&|frame| if has_ids { &*frame.id == id } else { frame.index == index })
        };
        Ok(selected.into_iter().flat_map(frame_positions).filter(|at| seen.insert(*at)).collect())
    }
}

/// Describes the frames of a range that are before the first or after the last frame of a recording; `None` if it
/// ends within them.
#[must_use]
pub fn frames_beyond(recording: &Recording, choice: &FrameChoice) -> Option<String> {
    let runs = RunId::all(recording.plan().runs.len());
    choice.beyond(&runs.flat_map(|run| recording.frames(run)).map(|frame| frame.index).collect())
}

/// Describes the available frames.
fn span(frames: &[&RecordedFrame]) -> String {
    match frames {
        [] => "there are no frames".to_owned(),
        [only] => format!("there is one frame, {} (`{}`)", only.index, only.id),
        [first, .., last] => {
            let (count, from, to) = (frames.len(), first.index, last.index);
            format!("there are {count} frames, {from} (`{}`) to {to} (`{}`)", first.id, last.id)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{FrameChoice, FrameSelection};

    #[test]
    fn a_range_that_ends_within_the_last_step_is_not_beyond() {
        let beyond = |text: &str| FrameChoice::parse(text).unwrap().beyond(&[150, 152, 154].into());
        for within in ["150..155", "149..156", "152..154", "150,170", "150..170 available"] {
            assert_eq!(beyond(within), None, "{within}");
        }
        let after = "of the frames 152 to 159, 6 of 8 do not exist: 2 are used, 152 to 154";
        assert_eq!(beyond("152..160").as_deref(), Some(after));
        assert!(beyond("140..153").is_some_and(|text| text.contains("2 are used, 150 to 152")));
        assert_eq!(beyond("0..9"), None, "no frame is selected, which is an error");
    }

    #[test]
    fn frames_are_named_by_number_range_or_id() {
        let parsed = |text: &str| FrameChoice::parse(text).unwrap();
        assert_eq!(parsed("3, 7"), FrameChoice::Selection(FrameSelection::List(vec![3, 7])));
        assert_eq!(parsed("1..=40"), FrameChoice::Selection(FrameSelection::Range(1..41)));
        assert_eq!(parsed("list.txt"), FrameChoice::Selection(FrameSelection::File("list.txt".into())));
        assert_eq!(parsed("000150_10,left-7"), FrameChoice::Ids(vec!["000150_10".to_owned(), "left-7".to_owned()]));
        for (text, meant) in [("3-4", "did you mean `3..=4`?"), ("3..", "two ends"), ("a,,b", "does not select frames")]
        {
            let error = FrameChoice::parse(text).unwrap_err();
            assert!(error.contains(meant), "{text}: {error}");
        }
    }
}
