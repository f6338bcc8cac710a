//! Percentiles of samples of one metre that do not fit in memory: exact, [by counting](crate::query).

use super::sample::{Which, error_bits, error_from_bits};
use super::{PERCENTILES, Spread};
use crate::error::AnalysisError;
use crate::query::{Memory, OUTSIDE, Pass, Tally, percentiles};

/// Counters and samples held: little beside the samples that did not fit.
const MEMORY: Memory = Memory { samples: 1 << 16, counters: 1 << 16 };
/// The groups that are counted.
const WHICHES: [Which; 2] = [Which::Valid, Which::Shared];

/// How the errors of a metre spread, all valid ones and those that are shared. `visit(f)` calls `f(samples)`
/// for all samples, and does so again when asked again.
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
        let of = &found[group];
        let percentiles_m = of.values.as_slice().try_into().ok()?;
        Some(Spread { count: of.count, percentiles_m })
    };
    Ok([spread(0), spread(1)])
}
