//! The error against distance of a recording of which an earlier run had most of the maps.

use std::collections::BTreeSet;
use std::path::PathBuf;

use depthloom_recording::Recording;

use crate::distance::{DistanceBin, EarlierBins, Input};
use crate::error::AnalysisError;
use crate::estimators::Estimator;
use crate::files::Output;
use crate::reading::{Distances, distances_of_some};

/// The error against distance, if an earlier report has most of it: only maps that changed are read, and those that it is checked with. The
/// result is that of reading all maps.
///
/// An estimator's bins depend on its own maps and on the pixels that all of its group answered. In an earlier report there is often one estimator
/// of which every answered pixel is shared: nearly always the stereo matcher. That one is read again, with all that changed. If its
/// bins are what they were, then the shared pixels are what they were, and so are the bins of all estimators whose maps did not change. If they
/// are not, or there is no such estimator, all maps must be read: `None`.
pub(crate) fn distances(
    recording: &Recording,
    estimators: &[Estimator],
    inputs: &[Option<Input>],
    reports: &[PathBuf],
    samples_in_memory: usize,
    output: Output<'_>,
) -> Result<Option<Distances>, AnalysisError> {
    let earlier = reports.iter().filter_map(|folder| EarlierBins::read(folder));
    let Some((earlier, Reused { read, checked, taken })) = earlier
        .map(|earlier| {
            let reused = Reused::of(&earlier, inputs);
            (earlier, reused)
        })
        .max_by_key(|(_, reused)| reused.taken.len())
        .filter(|(_, reused)| !reused.taken.is_empty())
    else {
        return Ok(None);
    };
    let mut found = distances_of_some(recording, estimators, |index| read.contains(&index), samples_in_memory, output)?;
    let is_unchanged = |(index, of): &(usize, usize)| {
        found.bins.iter().filter(|bin| bin.estimator == *index).copied().eq(earlier.bins(*of, *index))
    };
    if !checked.iter().all(is_unchanged) {
        return Ok(None);
    }
    for (index, of) in taken {
        found.bins.extend(earlier.bins(of, index));
        found.beyond[index] = earlier.beyond(of);
    }
    found.bins.sort_by_key(|bin: &DistanceBin| (bin.estimator, bin.bin_m));
    Ok(Some(found))
}

/// What is taken from an earlier report: indices of estimators, and where with them, their indices in the report.
struct Reused {
    /// Whose maps are read.
    read: BTreeSet<usize>,
    /// Those of them whose bins are compared with the report's.
    checked: Vec<(usize, usize)>,
    /// Whose bins are the report's.
    taken: Vec<(usize, usize)>,
}

impl Reused {
    fn of(earlier: &EarlierBins, inputs: &[Option<Input>]) -> Self {
        let mut reused = Self { read: BTreeSet::new(), checked: Vec::new(), taken: Vec::new() };
        let groups: BTreeSet<usize> = inputs.iter().flatten().map(|input| input.group).collect();
        for group in groups {
            let members: Vec<usize> =
                (0..inputs.len()).filter(|index| inputs[*index].is_some_and(|input| input.group == group)).collect();
            let keys: Vec<_> = members.iter().map(|index| inputs[*index].and_then(|input| input.key)).collect();
            let matches = earlier.matches(&keys);
            let known = || members.iter().zip(&matches).filter_map(|(index, of)| Some((*index, (*of)?)));
            let Some(check) = known().find(|(_, of)| earlier.answers_shared_alone(*of)) else {
                reused.read.extend(members);
                continue;
            };
            let changed = members.iter().zip(&matches).filter(|(_, of)| of.is_none()).map(|(index, _)| *index);
            reused.read.extend(changed.chain([check.0]));
            reused.checked.push(check);
            reused.taken.extend(known().filter(|known| *known != check));
        }
        reused
    }
}
