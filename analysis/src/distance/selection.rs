//! Exact percentiles of samples of one metre that do not fit in memory, [by counting](crate::query).

use super::sample::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};
use crate::error::AnalysisError;
use crate::query::{Memory, OUTSIDE, Pass, Tally, percentiles};

/// The memory for counters and samples: little compared with the samples that did not fit.
const MEMORY: Memory = Memory { samples: 1 << 16, counters: 1 << 16 };
/// The groups that are counted.
const WHICHES: [Which; 2] = [Which::Valid, Which::Shared];

/// The spreads of the errors of a metre: over all valid pixels, and over shared ones. `visit(f)` must call `f(samples)`
/// for all samples each time it is called.
pub(super) fn spreads(
    visit: impl Fn(&mut dyn FnMut(&[u32])) -> Result<(), AnalysisError>,
) -> Result<[Option<Spread>; 2], AnalysisError> {
    let scan = |pass: &Pass| {
        let mut tally = Tally::new(pass);
        let (mut errors, mut groups) = (Vec::new(), Vec::new());
        visit(&mut |samples| {
            errors.clear();
            errors.extend(samples.iter().map(|sample| error_from_bits(error_bits(*sample))));
            for (group, which) in (0..).zip(WHICHES) {
                groups.clear();
                groups.extend(samples.iter().map(|sample| if which.has(*sample) { group } else { OUTSIDE }));
                tally.add(pass, |group| group, &groups, &errors);
            }
        })?;
        Ok(vec![tally])
    };
    let found = percentiles(WHICHES.len(), &PERCENTILES.map(f64::from), MEMORY, scan)?;
    let spread = |group: usize| {
        let percentiles = &found[group];
        let percentiles_m = percentiles.values.as_slice().try_into().ok()?;
        Some(Spread { count: percentiles.count, percentiles_m })
    };
    Ok([spread(0), spread(1)])
}
