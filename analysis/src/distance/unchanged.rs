//! The error against distance of a recording whose maps are mostly those of an earlier run.

use std::collections::BTreeSet;
use std::path::PathBuf;

use depthloom_recording::Recording;

use super::earlier::EarlierBins;
use super::inputs::Input;
use super::maps::{self, CollectedSamples};
use super::samples::Samples;
use super::{DistanceBin, Distances};
use crate::error::AnalysisError;
use crate::estimates::Estimate;
use crate::files::Output;

/// The error against distance, if an earlier report has most of it. Only maps that changed are read, and those of one
/// estimate per group as a check. The result equals that of reading all maps.
///
/// The bins of an estimate depend on its own maps and on the pixels that are valid in its whole group. A report often
/// has an estimate of which every valid pixel is shared, usually the stereo matcher. This estimate is computed again,
/// together with all that changed. If its bins are equal to those of the report, then the shared pixels have not
/// changed, and neither have the bins of the unchanged estimates. If they differ, or the report has no such estimate,
/// all maps must be read, and the result is `None`.
pub(super) fn distances(
    recording: &Recording,
    estimates: &[Estimate],
    inputs: &[Option<Input>],
    reports: &[PathBuf],
    samples_in_memory: usize,
    output: Output<'_>,
) -> Result<Option<Distances>, AnalysisError> {
    let earlier = reports.iter().filter_map(|folder| EarlierBins::read(folder)).map(|earlier| {
        let reused = Reused::new(&earlier, inputs);
        (earlier, reused)
    });
    let best = earlier.max_by_key(|(_, reused)| reused.unread.len());
    let Some((earlier, reused)) = best.filter(|(_, reused)| !reused.unread.is_empty()) else { return Ok(None) };
    let collected = CollectedSamples::empty(Samples::new(estimates.len(), samples_in_memory, output));
    let mut distances = maps::distances(recording, estimates, |index| reused.read.contains(&index), output, collected)?;
    let is_unchanged = |(index, in_report): &(usize, usize)| {
        let bins = distances.bins.iter().filter(|bin| bin.estimate == *index);
        bins.copied().eq(earlier.bins(*in_report, *index))
    };
    if !reused.checked.iter().all(is_unchanged) {
        return Ok(None);
    }
    for (index, in_report) in reused.unread {
        distances.bins.extend(earlier.bins(in_report, index));
        distances.beyond[index] = earlier.beyond(in_report);
    }
    distances.bins.sort_by_key(|bin: &DistanceBin| (bin.estimate, bin.bin_m));
    Ok(Some(distances))
}

/// What is reused of an earlier report. Estimates are given by index, in pairs together with their index in the
/// report.
struct Reused {
    /// The estimates whose maps are read.
    read: BTreeSet<usize>,
    /// Those of them whose bins are compared with the report.
    checked: Vec<(usize, usize)>,
    /// The estimates whose bins are reused, and whose maps are not read.
    unread: Vec<(usize, usize)>,
}

impl Reused {
    fn new(earlier: &EarlierBins, inputs: &[Option<Input>]) -> Self {
        let mut reused = Self { read: BTreeSet::new(), checked: Vec::new(), unread: Vec::new() };
        let groups: BTreeSet<usize> = inputs.iter().flatten().map(|input| input.group).collect();
        for group in groups {
            let members: Vec<usize> =
                (0..inputs.len()).filter(|index| inputs[*index].is_some_and(|input| input.group == group)).collect();
            let keys: Vec<_> = members.iter().map(|index| inputs[*index].and_then(|input| input.key)).collect();
            let matches = earlier.matches(&keys);
            let known = || members.iter().zip(&matches).filter_map(|(index, in_report)| Some((*index, (*in_report)?)));
            let Some(check) = known().find(|(_, in_report)| earlier.is_valid_only_where_shared(*in_report)) else {
                reused.read.extend(members);
                continue;
            };
            let changed =
                members.iter().zip(&matches).filter(|(_, in_report)| in_report.is_none()).map(|(index, _)| *index);
            reused.read.extend(changed.chain([check.0]));
            reused.checked.push(check);
            reused.unread.extend(known().filter(|known| *known != check));
        }
        reused
    }
}
