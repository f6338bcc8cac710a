//! The figure of a report: the absolute error against the true distance, a panel a variant, and the histogram of true distances.
//!
//! Like is compared with like: lines and bands are over the pixels that all estimators answered. A dashed line is the median over all that an
//! estimator answered, where that is more. What is drawn how: [`SpreadFigure`].

use depthloom_graphs::plan::RunId;
use std::collections::BTreeMap;

use crate::distance::{DistanceBin, Spread as OfDistance};
use crate::estimators::Estimator;
use crate::figures::THIN;
use depthloom_figures::{Bin, Drawing, Layout, Place, Scale, Size, Spread, SpreadFigure, added};

/// What the figure shows.
pub(crate) struct Figure<'a> {
    pub(crate) estimators: &'a [Estimator],
    pub(crate) bins: &'a [DistanceBin],
    /// Scored true pixels by metre.
    pub(crate) truth: &'a BTreeMap<u32, u64>,
}

/// The figure as SVG; equal numbers give equal bytes.
pub(crate) fn render(figure: &Figure<'_>) -> String {
    let several_stages = figure.estimators.iter().any(|of| of.lead.stage != figure.estimators[0].lead.stage);
    let spread = |(index, estimator): (usize, &Estimator)| {
        let bins = || figure.bins.iter().filter(move |bin| bin.estimator == index);
        let drawn = |bin: &DistanceBin, of: &OfDistance| Bin {
            from: f64::from(bin.bin_m),
            to: f64::from(bin.bin_m + 1),
            count: of.count,
            percentiles: of.percentiles_m,
        };
        let compared = bins().filter_map(|bin| Some(drawn(bin, figure.compared_of(bin)?)));
        let answered = bins().filter(|_| figure.any_shared()).map(|bin| drawn(bin, &bin.answered));
        Spread {
            of: Place {
                name: estimator.name.clone(),
                group: if several_stages { estimator.lead.stage.clone() } else { String::new() },
                variant: estimator.lead.variant.clone(),
            },
            bins: compared.collect(),
            answered: answered.collect(),
        }
    };
    let bar = |(metre, count): (&u32, &u64)| (f64::from(*metre), f64::from(metre + 1), *count);
    let compared = figure.compared();
    let of = SpreadFigure {
        spreads: figure.estimators.iter().enumerate().map(spread).collect(),
        truth: added(figure.truth.iter().map(bar)),
        compared: if figure.any_shared() { added(compared.iter().map(bar)) } else { Vec::new() },
        layout: Layout::Multiples,
        title: figure.title(),
        x_label: "true distance t, m".to_owned(),
        y_label: "absolute error |y − t|, m".to_owned(),
        x_scale: Scale::Linear,
        thin: THIN,
        most: None,
        size: Size::default(),
    };
    of.drawing().unwrap_or_else(|_| Drawing::new(1.0, 1.0)).svg()
}

impl Figure<'_> {
    /// Whether there are pixels that all estimators answered.
    fn any_shared(&self) -> bool {
        self.bins.iter().any(|bin| bin.shared.is_some())
    }

    /// What lines and bands show of a bin.
    fn compared_of<'a>(&self, bin: &'a DistanceBin) -> Option<&'a OfDistance> {
        if self.any_shared() { bin.shared.as_ref() } else { Some(&bin.answered) }
    }

    /// Which pixels are compared, in words.
    fn title(&self) -> String {
        let what = "Absolute error against true distance";
        if !self.any_shared() {
            return format!("{what}: each on the pixels it answered, not the same ones");
        }
        let (truth, compared): (u64, u64) = (self.truth.values().sum(), self.compared().values().sum());
        if compared == truth {
            return format!("{what}, on all true pixels");
        }
        // Never rounded up to all, nor down to none.
        let share = (100.0 * compared as f64 / truth.max(1) as f64).round().clamp(1.0, 99.0);
        format!("{what}, on the {share} % of true pixels that all estimators answered")
    }

    /// By metre: how many pixels are compared; estimators of one stage run share theirs.
    fn compared(&self) -> BTreeMap<u32, u64> {
        let mut by_run: BTreeMap<(RunId, u32), u64> = BTreeMap::new();
        for bin in self.bins {
            let count = self.compared_of(bin).map_or(0, |spread| spread.count);
            let most = by_run.entry((self.estimators[bin.estimator].run, bin.bin_m)).or_default();
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
mod tests {
    use super::*;
    use depthloom_figures::{BLUE, RED};

    fn estimator(variant: Option<&str>, name: &str) -> Estimator {
        Estimator::of_depths(name, variant, name, &[])
    }

    fn bin(estimator: usize, bin_m: u32) -> DistanceBin {
        let middle = f64::from(bin_m);
        let percentiles_m = [0.1 * middle, 0.2 * middle, 0.3 * middle, 0.4 * middle, 0.5 * middle];
        let answered = OfDistance { count: 10, percentiles_m };
        DistanceBin { estimator, bin_m, answered, shared: Some(answered) }
    }

    #[test]
    fn equal_numbers_give_equal_bytes() {
        let estimators = [estimator(None, "stereo"), estimator(Some("a"), "mono"), estimator(Some("b"), "mono")];
        let bins: Vec<DistanceBin> = (0..3).flat_map(|e| (2..70).map(move |metre| bin(e, metre))).collect();
        let truth = (2..70).map(|metre| (metre, u64::from(5000 / metre))).collect();
        let figure = || render(&Figure { estimators: &estimators, bins: &bins, truth: &truth });
        let svg = figure();
        assert!(svg == figure(), "two renderings of one figure differ");
        assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
    }

    #[test]
    fn fault_39_lines_are_over_the_pixels_that_all_answered_and_the_title_says_so() {
        let estimators = [estimator(None, "stereo"), estimator(Some("full"), "fused")];
        let mut bins = [bin(0, 5), bin(1, 5)];
        bins[1].answered = OfDistance { count: 16, percentiles_m: [9.0; 5] };
        let truth = BTreeMap::from([(5, 16)]);
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &truth };
        assert_eq!(
            figure.title(),
            "Absolute error against true distance, on the 63 % of true pixels that all estimators answered"
        );
        let title = |truth: u64| {
            let truth = BTreeMap::from([(5, truth)]);
            Figure { estimators: &estimators, bins: &bins, truth: &truth }.title()
        };
        assert!(
            [(12, "83 %"), (13, "77 %"), (10_000, "1 %")].iter().all(|(truth, share)| title(*truth).contains(share))
        );
        assert!(bins.iter().all(|bin| figure.compared_of(bin).unwrap().count == 10), "on the same pixels");
        assert!(render(&figure).contains("median of all it answered"));
        // Where nothing is shared, that is said too.
        bins.iter_mut().for_each(|bin| bin.shared = None);
        let figure = Figure { estimators: &estimators, bins: &bins, truth: &truth };
        assert!(figure.title().ends_with("each on the pixels it answered, not the same ones"));
    }

    #[test]
    fn fault_40_figures_scale() {
        let figure =
            Figure { estimators: &[estimator(None, "stereo")], bins: &[bin(0, 5)], truth: &BTreeMap::from([(5, 10)]) };
        let svg = render(&figure);
        assert!(svg.contains(" width=\"180mm\"") && svg.contains(" viewBox=\"0 0 510.236 "), "{}", &svg[..200]);
    }

    #[test]
    fn nothing_to_draw_is_an_empty_figure() {
        let svg = render(&Figure { estimators: &[estimator(None, "stereo")], bins: &[], truth: &BTreeMap::new() });
        assert!(svg.trim_end().ends_with("</svg>"));
    }
}
