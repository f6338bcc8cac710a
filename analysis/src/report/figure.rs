//! The figure of a report: the absolute error against the ground-truth distance, one panel per variant, and the
//! histogram of ground-truth distances.
//!
//! Lines and bands cover the pixels that are valid in all estimates, so that the estimates are comparable. A dashed
//! line is the median over all valid pixels of an estimate, if there are more. [`SpreadFigure`] draws the figure.

use depthloom_graphs::plan::RunId;
use std::collections::BTreeMap;

use depthloom_figures::{Bin, Layout, Scale, Sheet, Spread, SpreadFigure};

use crate::distance::{DistanceBin, Spread as BinSpread};
use crate::estimates::Estimate;
use crate::figures::MIN_COUNT;
use crate::titles::Titles;

/// The contents of the figure.
pub(crate) struct Figure<'a> {
    pub(crate) estimates: &'a [Estimate],
    pub(crate) bins: &'a [DistanceBin],
    /// Pixels with ground truth by metre.
    pub(crate) truth: &'a BTreeMap<u32, u64>,
    /// The labels of the experiment.
    pub(crate) titles: &'a Titles,
}

/// The figure as SVG; equal numbers give equal bytes.
pub(crate) fn render(figure: &Figure<'_>) -> String {
    let stage = |estimate: &Estimate| estimate.row_key.stage.clone();
    let several_stages = figure.estimates.iter().any(|estimate| stage(estimate) != stage(&figure.estimates[0]));
    let spread = |(index, estimate): (usize, &Estimate)| {
        let bins = || figure.bins.iter().filter(move |bin| bin.estimate == index);
        let drawn = |bin: &DistanceBin, spread: &BinSpread| {
            let (from, to) = (f64::from(bin.bin_m), f64::from(bin.bin_m + 1));
            Bin { from, to, count: spread.count, percentiles: spread.percentiles_m }
        };
        Spread {
            place: figure.titles.place(
                estimate.name.clone(),
                if several_stages { stage(estimate) } else { String::new() },
                estimate.row_key.variant.clone(),
            ),
            bins: bins().filter_map(|bin| Some(drawn(bin, figure.compared_in(bin)?))).collect(),
            valid: bins().filter(|_| figure.any_shared()).map(|bin| drawn(bin, &bin.valid)).collect(),
        }
    };
    let bar = |(metre, count): (&u32, &u64)| (f64::from(*metre), f64::from(metre + 1), *count);
    let drawn = SpreadFigure {
        spreads: figure.estimates.iter().enumerate().map(spread).collect(),
        truth: figure.truth.iter().map(bar).collect(),
        compared: figure.compared().iter().filter(|_| figure.any_shared()).map(bar).collect(),
        layout: Layout::Multiples,
        labels: ["ground-truth distance t, m".to_owned(), "absolute error |y − t|, m".to_owned()],
        scale: Scale::Linear,
        thin: MIN_COUNT,
        most: None,
    };
    Sheet { title: figure.title(), ..drawn.sheet() }.drawing().unwrap_or_default().svg()
}

impl Figure<'_> {
    /// Whether there are pixels that are valid in all estimates.
    fn any_shared(&self) -> bool {
        self.bins.iter().any(|bin| bin.shared.is_some())
    }

    /// The spread that lines and bands show in a bin.
    fn compared_in<'a>(&self, bin: &'a DistanceBin) -> Option<&'a BinSpread> {
        if self.any_shared() { bin.shared.as_ref() } else { Some(&bin.valid) }
    }

    /// The title, which names the compared pixels.
    fn title(&self) -> String {
        let what = "Absolute error against ground-truth distance";
        if !self.any_shared() {
            return format!("{what}, each estimate on its own valid pixels");
        }
        let (truth, compared): (u64, u64) = (self.truth.values().sum(), self.compared().values().sum());
        if compared == truth {
            return format!("{what}, on all pixels with ground truth");
        }
        // Never rounded to 100 % or 0 %.
        let share = (100.0 * compared as f64 / truth.max(1) as f64).round().clamp(1.0, 99.0);
        format!("{what}, on the {share} % of pixels with ground truth that are valid in all estimates")
    }

    /// The number of compared pixels by metre. Estimates of one stage run share their pixels.
    fn compared(&self) -> BTreeMap<u32, u64> {
        let mut by_run: BTreeMap<(RunId, u32), u64> = BTreeMap::new();
        for bin in self.bins {
            let count = self.compared_in(bin).map_or(0, |spread| spread.count);
            let most = by_run.entry((self.estimates[bin.estimate].run, bin.bin_m)).or_default();
            *most = count.max(*most);
        }
        let mut compared = BTreeMap::new();
        for ((_, metre), count) in by_run {
            *compared.entry(metre).or_default() += count;
        }
        compared
    }
}

#[cfg(test)]
mod tests;
