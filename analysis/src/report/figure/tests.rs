use super::*;
use depthloom_figures::{BLUE, RED};

fn estimate(variant: Option<&str>, name: &str) -> Estimate {
    Estimate::of_depths(name, variant, name, &[])
}

fn bin(estimate: usize, bin_m: u32) -> DistanceBin {
    let middle = f64::from(bin_m);
    let percentiles_m = [0.1 * middle, 0.2 * middle, 0.3 * middle, 0.4 * middle, 0.5 * middle];
    let valid = BinSpread { count: 10, percentiles_m };
    DistanceBin { estimate, bin_m, valid, shared: Some(valid) }
}

#[test]
fn equal_numbers_give_equal_bytes() {
    let estimates = [estimate(None, "stereo"), estimate(Some("a"), "mono"), estimate(Some("b"), "mono")];
    let bins: Vec<DistanceBin> = (0..3).flat_map(|e| (2..70).map(move |metre| bin(e, metre))).collect();
    let truth = (2..70).map(|metre| (metre, u64::from(5000 / metre))).collect();
    let figure = || render(&Figure { estimates: &estimates, bins: &bins, truth: &truth, titles: &Titles::default() });
    let svg = figure();
    assert!(svg == figure(), "two renderings of one figure differ");
    assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE));
}

#[test]
fn fault_39_lines_cover_pixels_valid_in_all_and_the_title_states_it() {
    let estimates = [estimate(None, "stereo"), estimate(Some("full"), "fused")];
    let mut bins = [bin(0, 5), bin(1, 5)];
    bins[1].valid = BinSpread { count: 16, percentiles_m: [9.0; 5] };
    let truth = BTreeMap::from([(5, 16)]);
    let figure = Figure { estimates: &estimates, bins: &bins, truth: &truth, titles: &Titles::default() };
    assert_eq!(
        figure.title(),
        "Absolute error against ground-truth distance, on the 63 % of pixels with ground truth that are valid in all estimates"
    );
    let title = |truth: u64| {
        let truth = BTreeMap::from([(5, truth)]);
        Figure { estimates: &estimates, bins: &bins, truth: &truth, titles: &Titles::default() }.title()
    };
    assert!([(12, "83 %"), (13, "77 %"), (10_000, "1 %")].iter().all(|(truth, share)| title(*truth).contains(share)));
    assert!(bins.iter().all(|bin| figure.compared_in(bin).unwrap().count == 10), "on the same pixels");
    assert!(render(&figure).contains("median over its valid pixels"));
    // Without shared pixels, the title states that, too.
    bins.iter_mut().for_each(|bin| bin.shared = None);
    let figure = Figure { estimates: &estimates, bins: &bins, truth: &truth, titles: &Titles::default() };
    assert!(figure.title().ends_with("each estimate on its own valid pixels"));
}

#[test]
fn fault_40_figures_have_a_physical_size() {
    let figure = Figure {
        estimates: &[estimate(None, "stereo")],
        bins: &[bin(0, 5)],
        truth: &BTreeMap::from([(5, 10)]),
        titles: &Titles::default(),
    };
    let svg = render(&figure);
    assert!(svg.contains(" width=\"180mm\"") && svg.contains(" viewBox=\"0 0 510.236 "), "{}", &svg[..200]);
}

#[test]
fn a_figure_without_data_is_empty() {
    let svg = render(&Figure {
        estimates: &[estimate(None, "stereo")],
        bins: &[],
        truth: &BTreeMap::new(),
        titles: &Titles::default(),
    });
    assert!(svg.trim_end().ends_with("</svg>"));
}
