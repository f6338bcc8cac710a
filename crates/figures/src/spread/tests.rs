use super::*;
use crate::colours::{BLUE, RED};

fn spread(variant: Option<&str>, name: &str, bins: Vec<Bin>) -> Spread {
    Spread {
        place: Place {
            name: name.to_owned(),
            group: String::new(),
            variant: variant.map(str::to_owned),
            ..Place::default()
        },
        bins,
        valid: Vec::new(),
    }
}

fn bin(metre: u32, count: u64, scale: f64) -> Bin {
    let (from, to) = (f64::from(metre), f64::from(metre + 1));
    Bin { from, to, count, percentiles: [0.1, 0.2, 0.3, 0.4, 0.5].map(|part| part * scale) }
}

fn figure(spreads: Vec<Spread>) -> SpreadFigure {
    SpreadFigure {
        spreads,
        truth: (2_u32..70).map(|metre| (f64::from(metre), f64::from(metre + 1), u64::from(50_000 / metre))).collect(),
        compared: Vec::new(),
        layout: Layout::Multiples,
        labels: ["ground-truth distance t, m".to_owned(), "absolute error, m".to_owned()],
        scale: Scale::Linear,
        thin: 100,
        most: None,
    }
}

#[test]
fn every_variant_has_a_panel_with_what_all_variants_share() {
    let bins = || vec![bin(5, 1000, 1.0), bin(6, 1000, 1.0)];
    let figure = figure(vec![
        spread(None, "stereo", bins()),
        spread(Some("full"), "mono", bins()),
        spread(Some("full"), "fused", bins()),
        spread(Some("bare"), "mono", bins()),
    ]);
    let all = Comparison(figure.spreads.iter().map(|spread| &spread.place).collect(), Layout::Multiples);
    let groups = all.panels();
    let names = |at: &[usize]| at.iter().map(|&at| figure.spreads[at].place.name.as_str()).collect::<Vec<_>>();
    let named: Vec<(&str, Vec<&str>)> = groups.iter().map(|(title, at)| (title.as_str(), names(at))).collect();
    assert_eq!(named, [("full", vec!["stereo", "mono", "fused"]), ("bare", vec!["stereo", "mono"])]);
    // Two wide bands (stereo, mono), three narrow ones, three lines; of two estimates both have all.
    let panels = figure.sheet().panels;
    assert_eq!([panels[0].items.len(), panels[1].items.len()], [2 + 3 + 3, 2 + 2 + 2]);
    let overlaid = Comparison(all.0.clone(), Layout::Overlaid);
    assert_eq!(overlaid.panels().len(), 1);
    assert_ne!(overlaid.stroke(3).colour, overlaid.stroke(1).colour, "the variants of mono differ");
}

/// The top of the error's axis.
fn high(figure: &SpreadFigure) -> f64 {
    figure.sheet().panels[0].y.high
}

#[test]
fn a_bin_of_few_pixels_sets_no_axis_and_is_faint() {
    let wild = figure(vec![spread(
        None,
        "stereo",
        vec![bin(4, 10, 1000.0), bin(5, 100, 1.0), bin(6, 5000, 2.0), bin(7, 5000, 2.0)],
    )]);
    assert!(
        (high(&wild) - 1.03).abs() < 1e-9,
        "95 % of the bins that are not thin, and a little room: {}",
        high(&wild)
    );
    let steps = wild.steps(&wild.spreads[0].bins, (0, 4));
    let pieces: Vec<(usize, bool)> = pieces(&steps).iter().map(|(piece, is_thin)| (piece.len(), *is_thin)).collect();
    assert_eq!(pieces, [(2, true), (3, false)], "the step from a thin bin to the next is thin");
    let faint = &wild.sheet().panels[0].items;
    let dotted = faint.iter().filter(|item| matches!(item, Item::Line(_, stroke) if stroke.dashes == THIN_DASHES));
    assert_eq!(dotted.count(), 1);
    // Where all are thin they set the axis after all.
    assert!(high(&SpreadFigure { thin: 10_000, ..wild }) > 500.0);
}

#[test]
fn a_band_that_few_bins_stretch_is_cut_and_the_cut_is_marked() {
    let bins = (0..40).map(|metre| bin(metre, 5000, if metre == 3 { 150.0 } else { 10.0 })).collect();
    let outlier = figure(vec![spread(None, "stereo", bins)]);
    // The highest median, 45 m, has room; the 95 % of its bin, 75 m, has not.
    assert!((high(&outlier) - 45.0 * 1.15 * 1.03).abs() < 1e-9, "{}", high(&outlier));
    assert!(outlier.sheet().drawing().unwrap().svg().contains(">↑ 75</text>"));
    let usual = (0..40).map(|metre| bin(metre, 5000, 10.0 + 0.1 * f64::from(metre))).collect();
    let usual = figure(vec![spread(None, "stereo", usual)]);
    assert!((high(&usual) - 0.5 * 13.9 * 1.03).abs() < 1e-9, "nothing is cut without an outlier: {}", high(&usual));
}

#[test]
fn a_bin_without_pixels_interrupts_the_curves() {
    let figure = figure(vec![spread(None, "stereo", vec![bin(3, 500, 1.0), bin(4, 500, 1.0), bin(6, 500, 1.0)])]);
    let steps = figure.steps(&figure.spreads[0].bins, (0, 4));
    let pieces: Vec<usize> = pieces(&steps).iter().map(|(piece, _)| piece.len()).collect();
    assert_eq!(pieces, [2, 1]);
}

#[test]
fn equal_numbers_give_equal_bytes() {
    let bins: Vec<Bin> = (2..70).map(|metre| bin(metre, 5000 / u64::from(metre), f64::from(metre))).collect();
    let drawing = || {
        let mut figure = figure(vec![
            spread(None, "stereo", bins.clone()),
            spread(Some("a"), "mono", bins.clone()),
            spread(Some("b"), "mono", bins.clone()),
        ]);
        figure.spreads[0].valid = bins.iter().map(|bin| Bin { count: bin.count * 2, ..*bin }).collect();
        figure.sheet().drawing().unwrap()
    };
    let svg = drawing().svg();
    assert_eq!(svg, drawing().svg(), "equal numbers");
    assert!(svg.starts_with("<svg") && svg.contains(RED) && svg.contains(BLUE) && svg.contains("width=\"180mm\""));
    assert!(svg.contains("median over its valid pixels") && svg.contains("fewer than 100 pixels"));
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    assert_eq!(drawing().pdf("a figure"), drawing().pdf("a figure"));
    assert_eq!(drawing().png(100.0).unwrap(), drawing().png(100.0).unwrap());
}

#[test]
fn nothing_to_draw_is_an_empty_figure() {
    let figure = SpreadFigure { truth: Vec::new(), ..figure(Vec::new()) };
    assert!(figure.sheet().drawing().unwrap().svg().ends_with("</svg>\n"));
}
